//! Graphs as rten computes them: nodes that the file's version of the operators defines otherwise are replaced.
//!
//! rten reads every node as one of a recent version of the operators (<https://onnx.ai/onnx/operators/>). The rules are in
//! `operators.rs`; here is the walk through the file. A subgraph is converted like the graph around it.

use super::fault::Fault;
use super::graph::{MODEL_GRAPH, NODE_ATTRIBUTE};
use super::node::{Constants, Node};
use super::operators::replacement;
use super::wire::{Field, Slice};
use super::writer::block;
use std::collections::BTreeSet;

/// Versions of the operators that are converted: onnxruntime's oldest one, and the newest one whose operators are tested.
const OLDEST_VERSION: i64 = 7;
const NEWEST_VERSION: i64 = 28;

/// Numbers of fields.
const MODEL_VERSIONS: u64 = 8;
const VERSION_DOMAIN: u64 = 1;
const VERSION_NUMBER: u64 = 2;
const GRAPH_NODE: u64 = 1;
const GRAPH_INITIALISER: u64 = 5;
const GRAPH_INPUT: u64 = 11;
const VALUE_NAME: u64 = 1;
const TENSOR_EXTERNAL: u64 = 13;
const ENTRY_KEY: u64 = 1;
const ENTRY_VALUE: u64 = 2;
const ATTRIBUTE_GRAPH: u64 = 6;

/// The file with nodes that rten computes as they are defined; none if it has no other ones.
pub fn converted(bytes: &[u8]) -> Result<Option<Vec<u8>>, Fault> {
    let model = Slice::file(bytes);
    let version = version(model)?;
    if !version.is_some_and(|v| (OLDEST_VERSION..=NEWEST_VERSION).contains(&v)) {
        return Err(Fault::Version { found: version });
    }
    let walk = Walk { version: version.unwrap_or_default() };
    rewritten(model, |field| match (field.number, field.content()) {
        (MODEL_GRAPH, Some(graph)) => {
            Ok(walk.graph(graph, &Constants::default())?.map(|graph| block(MODEL_GRAPH, &graph)))
        }
        _ => Ok(None),
    })
}

/// Names of the files beside a model that hold its weights.
pub fn data_files(bytes: &[u8]) -> Result<BTreeSet<&str>, Fault> {
    let mut names = BTreeSet::new();
    for graph in Slice::file(bytes).all(MODEL_GRAPH)? {
        for tensor in graph.all(GRAPH_INITIALISER)? {
            for entry in tensor.all(TENSOR_EXTERNAL)? {
                if entry.text(ENTRY_KEY)? == Some("location") {
                    names.extend(entry.text(ENTRY_VALUE)?);
                }
            }
        }
    }
    Ok(names)
}

/// The version of ONNX's own operators.
fn version(model: Slice) -> Result<Option<i64>, Fault> {
    let mut found = None;
    for versions in model.all(MODEL_VERSIONS)? {
        if matches!(versions.text(VERSION_DOMAIN)?, None | Some("" | "ai.onnx")) {
            found = versions.integers(VERSION_NUMBER)?.first().copied();
        }
    }
    Ok(found)
}

/// The message with some of its fields replaced; none if all stay.
fn rewritten<'a>(
    message: Slice<'a>,
    mut replace: impl FnMut(&Field<'a>) -> Result<Option<Vec<u8>>, Fault>,
) -> Result<Option<Vec<u8>>, Fault> {
    let mut out: Option<Vec<u8>> = None;
    for field in message.fields() {
        let field = field?;
        let new = replace(&field)?;
        if new.is_some() && out.is_none() {
            out = Some(message.bytes[..field.start - message.start].to_vec());
        }
        if let Some(out) = &mut out {
            out.extend_from_slice(new.as_deref().unwrap_or(field.bytes));
        }
    }
    Ok(out)
}

struct Walk {
    version: i64,
}

impl Walk {
    /// A graph within one that has these constants.
    fn graph<'a>(&self, graph: Slice<'a>, outer: &Constants<'a>) -> Result<Option<Vec<u8>>, Fault> {
        let mut constants = outer.clone();
        let mut initialised = Vec::new();
        for tensor in graph.all(GRAPH_INITIALISER)? {
            initialised.push(constants.add_initialiser(tensor)?);
        }
        for node in graph.all(GRAPH_NODE)? {
            constants.add_node(&Node::read(node)?)?;
        }
        rewritten(graph, |field| match (field.number, field.content()) {
            (GRAPH_NODE, Some(node)) => self.node(node, &constants),
            // An initialiser that is an input too is its default value; before version 4 of the format all had to be inputs.
            (GRAPH_INPUT, Some(input)) => {
                let name = input.text(VALUE_NAME)?.unwrap_or_default();
                Ok(initialised.contains(&name).then(Vec::new))
            }
            _ => Ok(None),
        })
    }

    fn node<'a>(&self, content: Slice<'a>, constants: &Constants<'a>) -> Result<Option<Vec<u8>>, Fault> {
        let node = Node::read(content)?;
        if let Some(nodes) = replacement(&node, self.version, constants)? {
            return Ok(Some(nodes));
        }
        let with_subgraphs = rewritten(content, |field| match (field.number, field.content()) {
            (NODE_ATTRIBUTE, Some(attribute)) => {
                let attribute = rewritten(attribute, |field| match (field.number, field.content()) {
                    (ATTRIBUTE_GRAPH, Some(graph)) => {
                        Ok(self.graph(graph, constants)?.map(|graph| block(ATTRIBUTE_GRAPH, &graph)))
                    }
                    _ => Ok(None),
                })?;
                Ok(attribute.map(|attribute| block(NODE_ATTRIBUTE, &attribute)))
            }
            _ => Ok(None),
        })?;
        Ok(with_subgraphs.map(|node| block(GRAPH_NODE, &node)))
    }
}
