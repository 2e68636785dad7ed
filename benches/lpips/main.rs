//! Times of LPIPS for scores and for the loss, on one thread and on two: `cargo bench --bench lpips`.
//!
//! The weights are read from the folder `SATGS_LPIPS`, which `scripts/fetch-weights` fills. Operations are the
//! multiplications and additions of the convolutions as the networks define them.

#![allow(clippy::print_stdout)]

use rayon::ThreadPoolBuilder;
use satgs::nn::{Backbone, Lpips, LpipsError, PlanarRgb};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Runs of which the fastest counts.
const RUNS: usize = 15;
/// Columns and rows of the images: a crop in training, and one for scores.
const SIDES: [usize; 2] = [128, 512];

/// Operations of a forward pass for each pixel of an image, without losses at borders.
fn operations_per_pixel(backbone: Backbone) -> f64 {
    // Channels in, channels out, side of the kernel, pixels of the image for each pixel of the output along one axis.
    let layers: &[(f64, f64, f64, f64)] = match backbone {
        Backbone::AlexNet => &[
            (3.0, 64.0, 11.0, 4.0),
            (64.0, 192.0, 5.0, 8.0),
            (192.0, 384.0, 3.0, 16.0),
            (384.0, 256.0, 3.0, 16.0),
            (256.0, 256.0, 3.0, 16.0),
        ],
        Backbone::Vgg16 => &[
            (3.0, 64.0, 3.0, 1.0),
            (64.0, 64.0, 3.0, 1.0),
            (64.0, 128.0, 3.0, 2.0),
            (128.0, 128.0, 3.0, 2.0),
            (128.0, 256.0, 3.0, 4.0),
            (256.0, 256.0, 3.0, 4.0),
            (256.0, 256.0, 3.0, 4.0),
            (256.0, 512.0, 3.0, 8.0),
            (512.0, 512.0, 3.0, 8.0),
            (512.0, 512.0, 3.0, 8.0),
            (512.0, 512.0, 3.0, 16.0),
            (512.0, 512.0, 3.0, 16.0),
            (512.0, 512.0, 3.0, 16.0),
        ],
    };
    layers.iter().map(|(inputs, outputs, side, step)| 2.0 * inputs * outputs * (side / step).powi(2)).sum()
}

/// The fastest of several runs, seconds.
fn fastest<E>(mut run: impl FnMut() -> Result<(), E>) -> Result<f64, E> {
    let mut fastest = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        run()?;
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    Ok(fastest)
}

fn measure(file: &Path) -> Result<(), LpipsError> {
    let mut lpips = Lpips::<f32>::read(file)?;
    for side in SIDES {
        let image = |speed: f32| -> Vec<f32> {
            (0..3 * side * side).map(|k| 0.5 + 0.5 * (k as f32 * speed).sin()).collect()
        };
        let (picture, target) = (image(0.37), image(0.41));
        let rgb = |data| {
            let planes: Vec<&[f32]> = <[f32]>::chunks(data, side * side).collect();
            PlanarRgb::new(side, side, [planes[0], planes[1], planes[2]])
        };
        let (picture, target) = (rgb(&picture)?, rgb(&target)?);
        let forward = 1e-9 * operations_per_pixel(lpips.backbone()) * (side * side) as f64;
        let score = fastest(|| lpips.distance(picture, target).map(drop))?;
        let mut by_picture = Vec::new();
        let loss = fastest(|| lpips.distance_with_gradient(picture, target, &mut by_picture).map(drop))?;
        println!(
            "{:8} {side:4}²   distance {:7.1} ms, {:4.0} Gop/s   with gradient {:7.1} ms, {:4.0} Gop/s",
            lpips.backbone().name(),
            1e3 * score,
            2.0 * forward / score,
            1e3 * loss,
            3.0 * forward / loss,
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Some(folder) = std::env::var_os("SATGS_LPIPS").map(PathBuf::from) else {
        println!("skipped: SATGS_LPIPS names no folder that scripts/fetch-weights has filled");
        return Ok(());
    };
    for threads in [1, 2] {
        println!("{threads} threads");
        for name in ["lpips-alexnet.safetensors", "lpips-vgg16.safetensors"] {
            ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| measure(&folder.join(name)))?;
        }
    }
    Ok(())
}
