//! The file of a trained colour model: `appearance.safetensors`.
//!
//! Tensors, all float32: `networks` (all parameters, in the order of [`Networks::ranges`]), `embeddings` (a row for each
//! view), `colors` (a row of `f_dc` for each splat, as the networks take them) and `visibility.N` (the visibility of the
//! patches of view N, row by row; absent where pixels count alike). The metadata hold the shapes of the
//! networks, the cube, the views' names, times and suns, and the hash of the splats that the colours belong to.

use super::{Cube, Networks};
use crate::io::{Grid2, WriteError, write_file};
use crate::nn::tensors::values;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The only key of the metadata: the kind and version of the file. Several keys would be written in any order.
const FORMAT: &str = "satgs appearance 1";
/// Largest numbers of levels, of entries of a table (as a power of two) and of outputs of a layer that are read.
const MOST_LEVELS: usize = 32;
const MOST_LOG2_ENTRIES: u32 = 24;
const MOST_OUTPUTS: usize = 1024;

/// Why the file of a colour model cannot be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum AppearanceError {
    /// The file cannot be read.
    #[error("`{path}` cannot be read: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// The file is damaged or not one of this version.
    #[error("`{path}` is not a colour model of this version: {reason}")]
    #[diagnostic(help("`satgs train RUN --recipe satgs --overwrite` makes it again"))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The colours belong to other splats.
    #[error("`{path}` belongs to other splats than `{splats}`")]
    #[diagnostic(help("the two files of a run are made together; copy both, or train again"))]
    OtherSplats {
        /// The file of the colour model.
        path: PathBuf,
        /// The file of the splats.
        splats: PathBuf,
    },
}

/// A view of the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedView {
    /// Its name.
    pub name: String,
    /// When it was taken, UTC, if known.
    pub acquired: Option<String>,
    /// Unit vector to the sun in site axes, if known.
    pub sun: Option<[f32; 3]>,
    /// Columns and rows of the patches whose visibility is known, pixels; none where pixels count alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patch_px: Option<usize>,
}

/// What the metadata hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AppearanceContent {
    /// The shapes of the networks.
    pub networks: Networks,
    /// The cube that the encoding of positions covers.
    pub cube: Cube,
    /// The views, in the order of the embeddings.
    pub views: Vec<TrainedView>,
    /// Index of the view whose colours and sun `splats.ply` has.
    pub reference: usize,
    /// BLAKE3 hash of the file of the splats.
    pub splats: String,
}

/// A trained colour model.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedAppearance {
    /// Shapes, views and origin.
    pub content: AppearanceContent,
    /// Parameters of the networks.
    pub shared: Vec<f32>,
    /// The embedding of each view.
    pub embeddings: Vec<Vec<f32>>,
    /// `f_dc` of each splat, before the networks.
    pub colors: Vec<[f32; 3]>,
    /// The visibility of the patches of each view, 0 to 1; none where pixels count alike.
    pub visibility: Vec<Option<Grid2>>,
}

impl TrainedAppearance {
    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let content = serde_json::to_string(&self.content).map_err(|e| WriteError::new(path, e))?;
        let metadata = HashMap::from([(FORMAT.to_owned(), content)]);
        let bytes =
            |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
        let embedding = self.content.networks.embedding;
        let mut tensors = vec![
            ("networks".to_owned(), vec![self.shared.len()], bytes(&mut self.shared.iter().copied())),
            (
                "embeddings".to_owned(),
                vec![self.embeddings.len(), embedding],
                bytes(&mut self.embeddings.iter().flatten().copied()),
            ),
            (
                "colors".to_owned(),
                vec![self.colors.len(), 3],
                bytes(&mut self.colors.iter().flatten().copied()),
            ),
        ];
        for (view, visibility) in self.visibility.iter().enumerate() {
            let Some(Grid2 { width, height, data }) = visibility else { continue };
            tensors.push((visibility_name(view), vec![*height, *width], bytes(&mut data.iter().copied())));
        }
        let views: Result<Vec<_>, _> = tensors
            .iter()
            .map(|(name, shape, bytes)| {
                TensorView::new(Dtype::F32, shape.clone(), bytes).map(|view| (name.clone(), view))
            })
            .collect();
        let views = views.map_err(|e| WriteError::new(path, e))?;
        let file = safetensors::serialize(views, Some(metadata)).map_err(|e| WriteError::new(path, e))?;
        write_file(path, file)
    }

    /// Reads the file.
    ///
    /// # Errors
    /// [`AppearanceError`] if it cannot be read, is cut short, of another version, or its parts do not fit together.
    pub fn read(path: &Path) -> Result<Self, AppearanceError> {
        let bytes = std::fs::read(path)
            .map_err(|e| AppearanceError::Io { path: path.into(), reason: e.to_string() })?;
        decode(&bytes).map_err(|reason| AppearanceError::Format { path: path.into(), reason })
    }

    /// Index of the view of this name.
    #[must_use]
    pub fn view(&self, name: &str) -> Option<usize> {
        self.content.views.iter().position(|view| view.name == name)
    }
}

/// The name of the tensor of a view's visibility.
fn visibility_name(view: usize) -> String {
    format!("visibility.{view}")
}

/// The colour model in the bytes of a file; an error says what is wrong.
fn decode(bytes: &[u8]) -> Result<TrainedAppearance, String> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let text = metadata.get(FORMAT).ok_or_else(|| format!("its metadata lack `{FORMAT}`"))?;
    let content: AppearanceContent = serde_json::from_str(text).map_err(|e| format!("`{FORMAT}`: {e}"))?;
    check(&content)?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let (views, embedding) = (content.views.len(), content.networks.embedding);
    let shared = values(&tensors, "networks", &[Some(content.networks.parameters())])?;
    let embeddings = values(&tensors, "embeddings", &[Some(views), Some(embedding)])?;
    let colors = values(&tensors, "colors", &[None, Some(3)])?;
    let embeddings = embeddings.chunks(embedding).map(<[f32]>::to_vec).collect();
    let colors = colors.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
    let visibility = content.views.iter().enumerate().map(|(k, view)| {
        let name = visibility_name(k);
        let of_patches = |_| {
            let data = values(&tensors, &name, &[None, None])?;
            let shape = tensors.tensor(&name).map_err(|e| e.to_string())?.shape().to_vec();
            Ok::<_, String>(Grid2 { width: shape[1], height: shape[0], data })
        };
        view.patch_px.map(of_patches).transpose()
    });
    let visibility = visibility.collect::<Result<_, _>>()?;
    Ok(TrainedAppearance { content, shared, embeddings, colors, visibility })
}

/// Checks the shapes that the metadata state, before anything of their size is allocated.
fn check(content: &AppearanceContent) -> Result<(), String> {
    let Networks { embedding, grid, tone, shadow, sky } = &content.networks;
    let is_size = |n: usize| (1..=MOST_OUTPUTS).contains(&n);
    let widths =
        [tone, shadow, sky].map(|mlp| mlp.hidden.iter().all(|n| is_size(*n)) && mlp.hidden.len() <= 8);
    if !is_size(*embedding)
        || !(1..=MOST_LEVELS).contains(&grid.levels)
        || !(1..=MOST_LOG2_ENTRIES).contains(&grid.log2_entries)
        || grid.cells.iter().any(|n| !(1..=1 << 20).contains(n))
        || widths != [true; 3]
    {
        return Err("the shapes of its networks are out of range".into());
    }
    if !content.networks.fit_together() {
        return Err("its networks do not fit together".into());
    }
    let is_sound = content.cube.side_m > 0.0 && content.cube.corner.iter().all(|v| v.is_finite());
    if !is_sound
        || content.reference >= content.views.len()
        || content.views.iter().any(|v| v.patch_px == Some(0))
    {
        return Err("its cube or its reference view is out of range".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::hash_grid::HashGrid;

    fn appearance() -> TrainedAppearance {
        let grid = HashGrid { levels: 8, log2_entries: 4, cells: [2, 9] };
        let networks = Networks { grid, ..Networks::default() };
        let view = |name: &str, patch_px: Option<usize>| TrainedView {
            name: name.into(),
            acquired: None,
            sun: Some([0.0, 0.6, 0.8]),
            patch_px,
        };
        let shared = networks.start(1);
        let embeddings = (0..2).map(|v| networks.start_embedding(1, v)).collect();
        let cube = Cube { corner: [-1.0, -2.0, -3.0], side_m: 9.0 };
        let views = vec![view("a", None), view("b", Some(8))];
        let visibility = vec![None, Some(Grid2::from_fn(3, 2, |col, row| 0.1 * (col + 3 * row) as f32))];
        let content = AppearanceContent { networks, cube, views, reference: 1, splats: "hash".into() };
        TrainedAppearance { content, shared, embeddings, colors: vec![[0.1, 0.2, 0.3]; 5], visibility }
    }

    #[test]
    fn a_written_model_is_read_back_equal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("appearance.safetensors");
        appearance().write(&path).unwrap();
        assert_eq!(TrainedAppearance::read(&path).unwrap(), appearance());
    }

    #[test]
    fn damaged_files_and_files_of_other_shapes_are_refused_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("appearance.safetensors");
        appearance().write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let message = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            TrainedAppearance::read(&path).unwrap_err().to_string()
        };
        for length in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
            assert!(message(&bytes[..length]).contains("appearance.safetensors"), "{length}");
        }
        let mut nan = bytes.clone();
        let end = nan.len();
        nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(message(&nan).contains("not finite"));
        let mut other = appearance();
        other.shared.pop();
        other.write(&path).unwrap();
        assert!(TrainedAppearance::read(&path).unwrap_err().to_string().contains("tensor `networks`"));
        let mut other = appearance();
        other.content.reference = 2;
        other.write(&path).unwrap();
        assert!(matches!(TrainedAppearance::read(&path), Err(AppearanceError::Format { .. })));
    }
}
