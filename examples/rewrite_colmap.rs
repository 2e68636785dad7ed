//! Reads a COLMAP model, prints its mean reprojection error, and writes it as text or binary files.
//!
//! `cargo run --example rewrite_colmap -- MODEL OUT bin|txt`, or without arguments on a model that it makes.

#![allow(clippy::print_stdout)]

use satgs::perspective::LensModel;
use satgs::perspective::colmap::{self, ColmapCamera, ColmapImage, ColmapModel, Format};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let (model, out, format) = match arguments {
        [model, out, format] => {
            let format = if format.as_os_str() == "txt" { Format::Text } else { Format::Binary };
            (colmap::read(model)?, out.clone(), format)
        }
        _ => (one_image(), folder.path().join("sparse"), Format::Text),
    };
    if let Some(fit) = model.reprojection() {
        println!("{:.12} px over {} observations", fit.mean_px, fit.observations);
    }
    colmap::write(&out, &model, format)?;
    println!("{} cameras, {} images, {} points", model.cameras.len(), model.images.len(), model.points.len());
    Ok(())
}

/// A model of one image without keypoints.
fn one_image() -> ColmapModel {
    let camera = ColmapCamera {
        id: 1,
        model: LensModel::Pinhole,
        width: 640,
        height: 480,
        // Focal lengths and principal point; COLMAP's centre of the first pixel is (0.5, 0.5).
        parameters: vec![500.0, 500.0, 320.0, 240.0],
    };
    let image = ColmapImage {
        id: 1,
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation: [0.0; 3],
        camera: 1,
        name: "image.jpg".into(),
        observations: Vec::new(),
    };
    ColmapModel { cameras: vec![camera], images: vec![image], points: Vec::new() }
}
