//! A node of a graph, its attributes, and the constants that it may refer to.

use super::fault::Fault;
use super::graph::{ATTRIBUTE_NAME, ATTRIBUTE_STRING, NODE_ATTRIBUTE, NODE_INPUT, NODE_OP_TYPE};
use super::graph::{NODE_OUTPUT, name_of};
use super::wire::Slice;
use std::collections::BTreeMap;

/// Numbers of fields.
const ATTRIBUTE_FLOAT: u64 = 2;
const ATTRIBUTE_INT: u64 = 3;
const ATTRIBUTE_TENSOR: u64 = 5;
const ATTRIBUTE_FLOATS: u64 = 7;
const ATTRIBUTE_INTS: u64 = 8;
const TENSOR_DIMS: u64 = 1;
const TENSOR_FLOATS: u64 = 4;
const TENSOR_INTEGERS: u64 = 7;
const TENSOR_NAME: u64 = 8;
const TENSOR_RAW: u64 = 9;

/// A node as the file has it.
pub struct Node<'a> {
    pub content: Slice<'a>,
    pub op_type: &'a str,
    pub inputs: Vec<&'a str>,
    pub outputs: Vec<&'a str>,
    pub attributes: Vec<Slice<'a>>,
}

impl<'a> Node<'a> {
    pub fn read(content: Slice<'a>) -> Result<Self, Fault> {
        Ok(Self {
            content,
            op_type: content.text(NODE_OP_TYPE)?.unwrap_or_default(),
            inputs: content.texts(NODE_INPUT)?,
            outputs: content.texts(NODE_OUTPUT)?,
            attributes: content.all(NODE_ATTRIBUTE)?,
        })
    }

    /// The input of a number; none if it is left out.
    pub fn input(&self, k: usize) -> Option<&'a str> {
        self.inputs.get(k).copied().filter(|name| !name.is_empty())
    }

    fn attribute(&self, name: &str) -> Result<Option<Slice<'a>>, Fault> {
        for attribute in &self.attributes {
            if attribute.text(ATTRIBUTE_NAME)? == Some(name) {
                return Ok(Some(*attribute));
            }
        }
        Ok(None)
    }

    pub fn has(&self, name: &str) -> Result<bool, Fault> {
        Ok(self.attribute(name)?.is_some())
    }

    pub fn text(&self, name: &str) -> Result<Option<&'a str>, Fault> {
        self.attribute(name)?.map_or(Ok(None), |attribute| attribute.text(ATTRIBUTE_STRING))
    }

    pub fn int(&self, name: &str) -> Result<Option<i64>, Fault> {
        let Some(attribute) = self.attribute(name)? else { return Ok(None) };
        Ok(attribute.integers(ATTRIBUTE_INT)?.first().copied())
    }

    pub fn float(&self, name: &str) -> Result<Option<f32>, Fault> {
        let Some(attribute) = self.attribute(name)? else { return Ok(None) };
        Ok(attribute.floats(ATTRIBUTE_FLOAT)?.first().copied())
    }

    pub fn ints(&self, name: &str) -> Result<Option<Vec<i64>>, Fault> {
        self.attribute(name)?.map(|attribute| attribute.integers(ATTRIBUTE_INTS)).transpose()
    }

    pub fn floats(&self, name: &str) -> Result<Option<Vec<f32>>, Fault> {
        self.attribute(name)?.map(|attribute| attribute.floats(ATTRIBUTE_FLOATS)).transpose()
    }

    /// The attributes but those of these names, as fields of a node.
    pub fn attributes_without(&self, names: &[&str]) -> Result<Vec<Vec<u8>>, Fault> {
        let mut kept = Vec::new();
        for attribute in &self.attributes {
            if !attribute.text(ATTRIBUTE_NAME)?.is_some_and(|name| names.contains(&name)) {
                kept.push(super::writer::block(NODE_ATTRIBUTE, attribute.bytes));
            }
        }
        Ok(kept)
    }

    /// The error that the node cannot be computed as it is defined.
    pub fn fault(&self, reason: impl Into<String>) -> Fault {
        match name_of(self.content) {
            Ok(node) => Fault::Operator { node, op_type: self.op_type.to_owned(), reason: reason.into() },
            Err(fault) => fault,
        }
    }
}

/// A constant tensor of a graph.
#[derive(Clone)]
pub struct Constant<'a> {
    pub dims: Vec<i64>,
    tensor: Slice<'a>,
}

impl Constant<'_> {
    /// Its shape; a negative side counts as 0.
    pub fn shape(&self) -> Vec<usize> {
        self.dims.iter().map(|side| usize::try_from(*side).unwrap_or(0)).collect()
    }

    /// Its values of 64-bit integers; none if they are of another type or in another file.
    pub fn integers(&self) -> Result<Vec<i64>, Fault> {
        match self.tensor.first(TENSOR_RAW)? {
            Some(raw) => Ok(raw.bytes.as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b)).collect()),
            None => self.tensor.integers(TENSOR_INTEGERS),
        }
    }

    /// Its values of single precision; none if they are of another type or in another file.
    pub fn floats(&self) -> Result<Vec<f32>, Fault> {
        match self.tensor.first(TENSOR_RAW)? {
            Some(raw) => Ok(raw.as_floats().collect()),
            None => self.tensor.floats(TENSOR_FLOATS),
        }
    }
}

/// The constants that the nodes of a graph may refer to, by their names.
#[derive(Clone, Default)]
pub struct Constants<'a>(BTreeMap<&'a str, Constant<'a>>);

impl<'a> Constants<'a> {
    pub fn get(&self, name: &str) -> Option<&Constant<'a>> {
        self.0.get(name)
    }

    /// Adds the constant of an initialiser; gives its name.
    pub fn add_initialiser(&mut self, tensor: Slice<'a>) -> Result<&'a str, Fault> {
        let name = tensor.text(TENSOR_NAME)?.unwrap_or_default();
        self.add(name, tensor)?;
        Ok(name)
    }

    /// Adds what a node is if it is a `Constant`.
    pub fn add_node(&mut self, node: &Node<'a>) -> Result<(), Fault> {
        if let ("Constant", Some(attribute), [name, ..]) =
            (node.op_type, node.attribute("value")?, &node.outputs[..])
            && let Some(tensor) = attribute.first(ATTRIBUTE_TENSOR)?
        {
            self.add(name, tensor)?;
        }
        Ok(())
    }

    fn add(&mut self, name: &'a str, tensor: Slice<'a>) -> Result<(), Fault> {
        self.0.insert(name, Constant { dims: tensor.integers(TENSOR_DIMS)?, tensor });
        Ok(())
    }
}
