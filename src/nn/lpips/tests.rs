//! The distance and its gradient by small networks with random weights; the published values by the real ones.

use super::architecture::{Architecture, Backbone, ConvolutionLayer, compared, pool};
use super::network::{Buffers, Network};
use super::{Lpips, LpipsError, PlanarRgb, naive_tests};
use crate::random::CounterRng;
use crate::simd::{Real, SimdReal};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// Kernels, strides, padding and windows of AlexNet.
const STRIDED: Architecture = Architecture {
    first: ConvolutionLayer::new(0, 5, 11, 2).compared(),
    stride: 4,
    others: &[pool(3), compared(1, 18, 5, 2), compared(2, 3, 3, 1)],
};

/// Those of VGG16.
const PLAIN: Architecture = Architecture {
    first: ConvolutionLayer::new(0, 18, 3, 1),
    stride: 1,
    others: &[compared(1, 4, 3, 1), pool(2), compared(2, 20, 3, 1)],
};

/// Windows that leave pixels of the image over.
const COARSE: Architecture =
    Architecture { first: ConvolutionLayer::new(0, 3, 4, 0).compared(), stride: 4, others: &[] };

/// Random weights of the size with which features keep theirs from layer to layer.
fn random_tensors(architecture: &Architecture) -> BTreeMap<String, Vec<f64>> {
    let mut tensors = BTreeMap::new();
    let _: Result<Network<f64>, Infallible> = Network::new(architecture, |name, shape| {
        let mut random = CounterRng::new(7, 0, 0, tensors.len() as u64);
        let inputs = shape[1..].iter().product::<usize>();
        let mut value = || match name {
            _ if name.starts_with("lin") => random.uniform(),
            _ if name.ends_with("bias") => 0.3 + 0.1 * random.normal(),
            _ => random.normal() / (inputs as f64).sqrt(),
        };
        let values: Vec<f64> = (0..shape.iter().product()).map(|_| value()).collect();
        tensors.insert(name.to_owned(), values.clone());
        Ok(values)
    });
    tensors
}

fn network<T: SimdReal>(architecture: &Architecture) -> Network<T> {
    let tensors = random_tensors(architecture);
    let rounded = |values: &Vec<f64>| values.iter().map(|value| T::from_f64(*value)).collect();
    let network: Result<_, Infallible> = Network::new(architecture, |name, _| Ok(rounded(&tensors[name])));
    network.unwrap()
}

/// An image of random values in [0, 1), channel after channel.
fn random_image<T: Real>(width: usize, height: usize, item: u64) -> Vec<T> {
    let mut random = CounterRng::new(8, 0, 0, item);
    (0..3 * width * height).map(|_| T::from_f64(random.uniform())).collect()
}

fn rgb<T>(width: usize, height: usize, data: &[T]) -> PlanarRgb<'_, T> {
    let (red, others) = data.split_at(width * height);
    let (green, blue) = others.split_at(width * height);
    PlanarRgb::new(width, height, [red, green, blue]).unwrap()
}

/// The networks with an image size that is the smallest or leaves pixels over at every tile, stripe and window.
fn cases() -> [(Architecture, usize, usize); 5] {
    [(STRIDED, 15, 15), (STRIDED, 42, 29), (PLAIN, 2, 2), (PLAIN, 17, 11), (COARSE, 7, 9)]
}

#[test]
fn distances_are_those_of_the_definition() {
    for (architecture, width, height) in cases() {
        let [a, b] = [0, 1].map(|item| random_image::<f64>(width, height, item));
        let images = [rgb(width, height, &a), rgb(width, height, &b)];
        let expected = naive_tests::distance(&architecture, &random_tensors(&architecture), images);
        let found = network(&architecture).distance(images);
        assert!(expected > 0.01 && (found - expected).abs() < 1e-12 * expected, "{found} {expected}");

        let [a, b] = [0, 1].map(|item| random_image::<f32>(width, height, item));
        let found = network(&architecture).distance([rgb(width, height, &a), rgb(width, height, &b)]);
        assert!((found - expected).abs() < 1e-5 * expected, "{found} {expected}");
    }
}

#[test]
fn an_image_has_no_distance_from_itself() {
    let image = random_image::<f32>(54, 33, 0);
    let image = rgb(54, 33, &image);
    assert_eq!(network(&STRIDED).distance([image, image]), 0.0);
    let mut by_picture = Vec::new();
    network(&STRIDED).distance_with_gradient(image, image, &mut Buffers::default(), &mut by_picture);
    assert!(by_picture.iter().all(|by| *by == 0.0));
}

#[test]
fn gradients_are_central_differences() {
    const STEP: f64 = 1e-5;
    for (architecture, width, height) in cases() {
        let network = network::<f64>(&architecture);
        let [mut picture, target] = [0, 1].map(|item| random_image::<f64>(width, height, item));
        let target = rgb(width, height, &target);
        let (mut buffers, mut by_picture) = (Buffers::default(), Vec::new());
        // The second call finds the buffers of the first, of another image.
        network.distance_with_gradient(target, target, &mut buffers, &mut by_picture);
        let distance = network.distance_with_gradient(
            rgb(width, height, &picture),
            target,
            &mut buffers,
            &mut by_picture,
        );
        assert_eq!(distance, network.distance([rgb(width, height, &picture), target]));
        let largest = by_picture.iter().fold(0.0f64, |largest, by| largest.max(by.abs()));
        for k in (0..picture.len()).step_by(picture.len() / 8) {
            let start = picture[k];
            let mut at = |value| {
                picture[k] = value;
                network.distance([rgb(width, height, &picture), target])
            };
            let expected = (at(start + STEP) - at(start - STEP)) / (2.0 * STEP);
            picture[k] = start;
            let error = (by_picture[k] - expected).abs();
            assert!(
                error < 1e-6 * largest,
                "{width} x {height}, value {k}: {} for {expected}",
                by_picture[k]
            );
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let (width, height) = (70, 37);
    let [picture, target] = [0, 1].map(|item| random_image::<f32>(width, height, item));
    for architecture in [STRIDED, PLAIN] {
        let compute = || {
            let (network, mut by_picture) = (network(&architecture), Vec::new());
            let images = [rgb(width, height, &picture), rgb(width, height, &target)];
            let distance = network.distance_with_gradient(
                images[0],
                images[1],
                &mut Buffers::default(),
                &mut by_picture,
            );
            (distance.to_bits(), by_picture.into_iter().map(f32::to_bits).collect::<Vec<_>>())
        };
        let [one, four] =
            [1, 4].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(compute));
        assert!(one == four);
    }
}

#[test]
fn images_that_cannot_be_compared_are_refused() {
    assert_eq!([Backbone::AlexNet, Backbone::Vgg16].map(Backbone::smallest_side_px), [31, 16]);
    let lpips =
        Lpips { backbone: Backbone::AlexNet, network: network(&STRIDED), buffers: Buffers::default() };
    let image = random_image::<f32>(31, 31, 0);
    let distance = |a: usize, b: usize, height: usize| {
        let of_width = |width: usize| rgb(width, height, &image[..3 * width * height]);
        lpips.distance(of_width(a), of_width(b))
    };
    assert!(distance(31, 31, 31).is_ok());
    assert!(matches!(distance(31, 30, 31), Err(LpipsError::Sizes { second: (30, 31), .. })));
    assert!(matches!(distance(31, 31, 30), Err(LpipsError::TooSmall { height: 30, smallest: 31, .. })));
    assert!(matches!(distance(0, 0, 0), Err(LpipsError::TooSmall { width: 0, .. })));
    let planes = [&image[..9], &image[..9], &image[..8]];
    assert!(matches!(PlanarRgb::new(3, 3, planes), Err(LpipsError::Plane { channel: 2, found: 8, .. })));
}

/// An example image of the authors' package, channel after channel, with its columns and rows.
#[allow(clippy::print_stdout)]
fn example(name: &str) -> Option<(usize, usize, Vec<f32>)> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("SATGS_DATA").map_or(here, PathBuf::from).join("lpips");
    let Ok(image) = image::open(folder.join(name)) else {
        println!("skipped: no {name} at {} (SATGS_DATA names another place)", folder.display());
        return None;
    };
    let image = image.to_rgb8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let channel = |c: usize| image.as_raw().iter().skip(c).step_by(3).map(|v| f32::from(*v) / 255.0);
    Some((width, height, (0..3).flat_map(channel).collect()))
}

#[test]
#[allow(clippy::print_stdout)]
fn distances_are_the_published_ones() {
    let Some(weights) = std::env::var_os("SATGS_LPIPS").map(PathBuf::from) else {
        println!("skipped: SATGS_LPIPS names no folder that scripts/fetch-weights has filled");
        return;
    };
    let examples = ["ex_ref.png", "ex_p0.png", "ex_p1.png"].map(example);
    let [Some((width, height, reference)), Some((.., p0)), Some((.., p1))] = examples else { return };
    let image = |data| rgb(width, height, data);
    let files = [("lpips-alexnet", [0.7219, 0.1376]), ("lpips-vgg16", [0.5686, 0.4217])];
    for (file, expected) in files {
        let lpips = Lpips::<f32>::read(&weights.join(file).with_extension("safetensors")).unwrap();
        for (picture, expected) in [&p0, &p1].into_iter().zip(expected) {
            let found = lpips.distance(image(picture), image(&reference)).unwrap();
            println!("{file}: {found:.5}, published {expected}");
            assert!((found - expected).abs() < 1e-3);
        }
    }
}
