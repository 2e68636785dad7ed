//! Whether images are linear or processed for display is found from their values.
use crate::common::{copy_folder, data_dir, succeeds};
use gdal::Dataset;
use satgs::scene::{ReadOptions, read};
use std::path::Path;

fn gamma(scene: &Path) -> f64 {
    let rpcs = scene.join("rpcs_raw").is_dir().then(|| "rpcs_raw".into());
    read(scene, &ReadOptions { rpcs, ..Default::default() }).unwrap().transfer_function.gamma()
}

/// Copies a scene of 8-bit images, with the values that its images have for display.
fn encoded_for_display(scene: &Path, copy: &Path) {
    copy_folder(scene, copy);
    for entry in std::fs::read_dir(copy).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "tif") {
            continue;
        }
        let options =
            gdal::DatasetOptions { open_flags: gdal::GdalOpenFlags::GDAL_OF_UPDATE, ..Default::default() };
        let dataset = Dataset::open_ex(&path, options).unwrap();
        let size = dataset.raster_size();
        for band in 1..=dataset.raster_count() {
            let mut band = dataset.rasterband(band).unwrap();
            let mut values = band.read_as::<u8>((0, 0), size, size, None).unwrap();
            values
                .data_mut()
                .iter_mut()
                .for_each(|v| *v = (255.0 * (f32::from(*v) / 255.0).powf(1.0 / 2.2)) as u8);
            band.write((0, 0), size, &mut values).unwrap();
        }
        dataset.close().unwrap();
    }
}

#[test]
fn simulated_scenes_are_linear_and_their_encoded_copies_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let kinds: [&[&str]; 5] = [
        &["--seed", "3", "--gsd", "0.35"],
        &["--seed", "65552"],
        &["--seed", "65553", "--hilly"],
        &["--seed", "2", "--seasons", "--cars", "2"],
        &["--seed", "5", "--seasons", "--hilly"],
    ];
    for (k, kind) in kinds.iter().enumerate() {
        let [linear, encoded] = ["linear", "encoded"].map(|name| folder.path().join(format!("{name}_{k}")));
        let size = ["simulate", linear.to_str().unwrap(), "-q", "--views", "6", "--size", "160"];
        succeeds(&[&size, *kind].concat());
        encoded_for_display(&linear, &encoded);
        assert_eq!((gamma(&linear), gamma(&encoded)), (1.0, 2.2), "{kind:?}");
    }
}

#[test]
fn images_of_dfc2019_are_processed_for_display_and_those_of_pleiades_with_12_bits_are_not() {
    let Some(data) = data_dir() else { return };
    assert_eq!(gamma(&data.join("jax068")), 2.2);
    assert_eq!(gamma(&data.join("s2p/input_triplet")), 1.0);
}
