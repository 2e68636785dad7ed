//! How fast the machine at hand is.

use crate::affine::ViewCamera;
use crate::random::CounterRng;
use crate::splat::appearance::Appearance;
use crate::splat::satellite::NovelView;
use crate::splat::splats::Splats;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// How long pictures are rendered.
const MEASURED_FOR: Duration = Duration::from_millis(300);
/// Pictures in a second by one core of the machine that the constants of [`Cost`](super::Cost) are of (Intel Xeon, AVX-512).
const PICTURES_PER_CORE: f64 = 90.0;
/// Number of splats, side of the ground that they cover in metres, and columns and rows of the picture.
const SPLATS: usize = 40_000;
const SIDE_M: f64 = 100.0;
const SIDE_PX: usize = 256;
/// Purpose of the random numbers.
const DRAW: u64 = 0x6d61_6368;

/// Number of cores of the model's machine that train as fast as this one with all threads that it may use: a measurement of a third
/// of a second.
#[must_use]
pub fn measured_cores() -> f64 {
    let splats = scattered();
    let scale = SIDE_PX as f64 / SIDE_M;
    let middle = 0.5 * (SIDE_PX as f64 - 1.0);
    let camera = ViewCamera::affine([[scale, 0.0, 0.1], [0.0, -scale, 0.1]], [middle; 2]);
    let view = NovelView { camera, size: (SIDE_PX, SIDE_PX), sun_shear: None };
    let render = || black_box(view.picture(&splats, &Appearance::default(), (0.0, 10.0)));
    // The first picture brings splats and code into the caches.
    render();
    let (started, mut pictures) = (Instant::now(), 0);
    while started.elapsed() < MEASURED_FOR {
        render();
        pictures += 1;
    }
    f64::from(pictures) / started.elapsed().as_secs_f64() / PICTURES_PER_CORE
}

/// Splats evenly over the ground, as a trained town has them.
fn scattered() -> Splats {
    let mut draw = CounterRng::new(0, DRAW, 0, 0);
    let mut splats = Splats::default();
    for _ in 0..SPLATS {
        let [east, north] = std::array::from_fn(|_| ((draw.uniform() - 0.5) * SIDE_M) as f32);
        let (altitude, color) = (10.0 * draw.uniform() as f32, [draw.uniform() as f32; 3]);
        splats.push([east, north, altitude], 0.4, 0.7, color);
    }
    splats
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_more_than_a_tenth_of_a_core_and_less_than_ten_for_each_thread() {
        let cores = measured_cores();
        let most = 10.0 * rayon::current_num_threads() as f64;
        assert!((0.1 / 16.0..most).contains(&cores), "{cores}");
    }
}
