//! Properties of predictions that hold for any parameters of the network.

use super::image_features::FEATURE_MAPS;
use super::input::SeenCloud;
use super::light::Light;
use super::model::ModelContent;
use super::network::SplatNetwork;
use super::{Cloud, ImageObserver, ImageSample, Model, Predictor, predict, write_onnx};
use crate::frame::{CenterPx, Pixel};
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::splat::splats::Splats;

/// Two images that show every position, in colours that depend on its place relative to an origin.
struct Painted {
    origin: [f64; 3],
}

impl ImageObserver for Painted {
    fn views(&self) -> usize {
        2
    }

    fn observe(&self, view: usize, p: [f64; 3]) -> Option<ImageSample> {
        let wave = |k: usize| 0.3 + 0.2 * (0.7 * (p[k] - self.origin[k]) + view as f64).sin();
        let color = std::array::from_fn(|k| wave(k) as f32);
        Some(ImageSample { color, visibility: 1.0, sunlight: 1.0 })
    }

    fn project(&self, _: usize, _: [f64; 3]) -> Option<Pixel<CenterPx>> {
        None
    }

    fn features(&self, _: usize, p: [f64; 3]) -> Option<[f32; FEATURE_MAPS]> {
        Some(std::array::from_fn(|k| (0.2 * (p[k % 3] - self.origin[k % 3])).cos() as f32))
    }
}

/// A model whose parameters are random throughout.
fn random_model() -> Model {
    let network = SplatNetwork { width: 16, ..SplatNetwork::default() };
    let mut model = Model::untrained(ModelContent { network, ..ModelContent::default() }, 1);
    let mut draw = CounterRng::new(4, 0, 0, 0);
    model.parameters.iter_mut().for_each(|v| *v += 0.1 * draw.normal() as f32);
    model
}

/// A block of 10 m on level ground of 70 m, which is two tiles wide.
fn points(origin: [f64; 3]) -> Vec<[f64; 3]> {
    let point = |i: u64| {
        let mut draw = CounterRng::new(2, 0, 0, i);
        let (x, y) = (70.0 * draw.uniform(), 20.0 * draw.uniform());
        let z = if (30.0..40.0).contains(&x) && (5.0..15.0).contains(&y) { 9.0 } else { 0.02 * x };
        [x + origin[0], y + origin[1], z + 0.05 * draw.normal() + origin[2]]
    };
    (0..9000).map(point).collect()
}

fn splats(points: &[[f64; 3]], origin: [f64; 3]) -> Splats {
    splats_by(&random_model().into(), points, origin)
}

fn splats_by(predictor: &Predictor, points: &[[f64; 3]], origin: [f64; 3]) -> Splats {
    let (cloud, _) = Cloud::new(points, 0.5).unwrap();
    let images = Painted { origin };
    let lights = [Light::default(); 2];
    let seen = SeenCloud::new(&cloud, &images, &lights);
    let [x, y, _] = origin;
    predict(predictor, &seen, (x, y, x + 70.0, y + 20.0), true, &NoProgress).unwrap()
}

#[test]
fn the_order_of_points_and_the_number_of_threads_do_not_change_a_bit() {
    let points = points([0.0; 3]);
    let expected = splats(&points, [0.0; 3]);
    assert!(expected.len() > 5000, "{}", expected.len());
    let reversed: Vec<[f64; 3]> = points.iter().rev().copied().collect();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| splats(&reversed, [0.0; 3])) == expected, "{threads} threads");
    }
}

#[test]
fn a_shifted_scene_has_the_same_splats_shifted() {
    let shift = [64.0, -32.0, 16.0];
    let (here, there) = (splats(&points([0.0; 3]), [0.0; 3]), splats(&points(shift), shift));
    assert_eq!(here.len(), there.len());
    let mut off: f32 = 0.0;
    for i in 0..here.len() {
        for k in 0..3 {
            off = off.max((there.position[i][k] - shift[k] as f32 - here.position[i][k]).abs());
            off = off.max((there.log_scale[i][k] - here.log_scale[i][k]).abs());
            off = off.max((there.f_dc[i][k] - here.f_dc[i][k]).abs());
        }
    }
    // Positions are rounded to single precision at other places.
    assert!(off < 1e-2, "{off}");
}

#[test]
fn the_network_as_an_onnx_file_gives_the_same_splats() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    write_onnx(&random_model(), &path).unwrap();
    let points: Vec<[f64; 3]> = points([0.0; 3]).into_iter().step_by(7).collect();
    let own = splats(&points, [0.0; 3]);
    let other = splats_by(&Predictor::read(&path).unwrap(), &points, [0.0; 3]);
    assert_eq!(own.len(), other.len());
    for (a, b) in own.groups().into_iter().flatten().zip(other.groups().into_iter().flatten()) {
        assert!((a - b).abs() < 1e-4 * a.abs().max(1.0), "{a} {b}");
    }
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(Predictor::read(&path).is_err());
}

#[test]
fn splats_lie_near_the_points_and_on_the_wall() {
    let found = splats(&points([0.0; 3]), [0.0; 3]);
    let is_near = |p: &[f32; 3]| p[2] > -2.0 && p[2] < 11.0;
    assert!(found.position.iter().all(is_near));
    let walls = found.position.iter().filter(|p| p[2] > 3.0 && p[2] < 7.0).count();
    assert!(walls > 300, "{walls} splats on four walls of 10 m");
}
