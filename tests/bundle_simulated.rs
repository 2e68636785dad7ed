//! Bundle adjustment of simulated images against the true cameras, on gentle and on hilly ground.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;

use common::disagreement_px;
use satgs::bundle::{Options, adjust};
use satgs::event::ignore;
use satgs::frame::Pixel;
use satgs::rpc::{Rpc, formats};
use satgs::scene::{ReadOptions, read};
use satgs::simulate::{self, Relief, simulate};

/// Largest distance of a corrected camera from the true one, pixels, once the common translation is taken out.
const SHIFT_TOLERANCE_PX: f64 = 0.1;

fn worst_shift_px(relief: Relief) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let options = simulate::Options { relief, ..simulate::Options::default() };
    simulate(folder.path(), &options, &ignore).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    let made = adjust(&scene, &Options::default(), &ignore).unwrap();
    assert_eq!(made.cameras.len(), options.views);
    let truth = folder.path().join("truth/rpcs");
    let pairs: Vec<(Rpc, Rpc)> = made
        .cameras
        .into_iter()
        .map(|(name, rpc)| (rpc, formats::read(&truth.join(format!("{name}.json"))).unwrap().rpc))
        .collect();
    let middle = options.size_px as f64 / 2.0;
    let worst = disagreement_px(&pairs, Pixel::new(middle, middle)).into_iter().fold(0.0, f64::max);
    println!("{relief:?}: {worst:.3} px");
    worst
}

#[test]
fn shifts_on_gentle_ground_are_the_true_ones_to_a_tenth_of_a_pixel() {
    assert!(worst_shift_px(Relief::Rolling) < SHIFT_TOLERANCE_PX);
}

#[test]
fn shifts_on_hilly_ground_are_the_true_ones_to_a_tenth_of_a_pixel() {
    assert!(worst_shift_px(Relief::Hilly) < SHIFT_TOLERANCE_PX);
}
