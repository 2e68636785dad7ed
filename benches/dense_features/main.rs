//! Time of the features without weights for a picture of 750 x 800 pixels on one thread and on two, fastest of several runs:
//! `cargo bench --bench dense_features`.

#![allow(clippy::print_stdout)]

use satgs::io::Grid2;
use satgs::nn::features::{DenseFeatures, FeatureError, HandFeatures};
use satgs::random::CounterRng;
use std::time::Instant;

const SIZE: (usize, usize) = (750, 800);
/// Runs of which the fastest counts.
const RUNS: usize = 30;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rgb = [0, 1, 2].map(|c| {
        let mut draw = CounterRng::new(0, c, 0, 0);
        Grid2::from_fn(SIZE.0, SIZE.1, |_, _| draw.uniform() as f32)
    });
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let fastest = pool.install(|| fastest_s(&rgb))?;
        println!("{} x {} pixels, {threads} threads: {:.2} ms", SIZE.0, SIZE.1, 1e3 * fastest);
    }
    Ok(())
}

fn fastest_s(rgb: &[Grid2; 3]) -> Result<f64, FeatureError> {
    let mut fastest = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        std::hint::black_box(HandFeatures::default().extract(rgb)?);
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    Ok(fastest)
}
