//! Cameras against what s2p, shareloc, rpcm and GDAL make of the same files (spec 5.1).
use crate::common;
use satgs::frame::{Pixel, Point};
use satgs::io::ImageFile;
use satgs::rpc::{Rpc, formats};
use std::path::Path;

/// The camera that GDAL shows of a raster.
fn as_gdal_reads(image: &Path) -> Rpc {
    let domain = ImageFile::open(image).unwrap().metadata_domain("RPC");
    formats::from_gdal(image, &domain).unwrap().expect("an RPC domain")
}

/// s2p's region of interest of a polygon at the camera's middle height: column, row, width, height.
#[test]
fn the_region_of_interest_of_a_polygon_agrees_with_s2p() {
    let Some(data) = common::data_dir() else { return };
    let rpc = as_gdal_reads(&data.join("s2p/input_pair/img_01.tif"));
    assert_eq!(rpc.center().height_m(), 1295.0);
    let (lons, lats) = ([55.649_517, 55.651_502], [-21.231_542, -21.229_672]);
    let corners = lons.map(|lon| lats.map(|lat| rpc.project(Point::new(lon, lat, 1295.0))));
    let corners = corners.as_flattened();
    let span = |along: fn(&Pixel<_>) -> f64| {
        let of = corners.iter().map(along);
        (of.clone().fold(f64::INFINITY, f64::min), of.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (top, bottom)) = (span(|p| p.col), span(|p| p.row));
    let found = [left, top, right - left, bottom - top];
    for (ours, theirs) in found.iter().zip([271.485_31, 1.590_19, 407.378_61, 413.530_10]) {
        assert!((ours - theirs).abs() < 1e-3, "{found:?}");
    }
}

/// s2p's virtual matches of a pair: pixels of the first image, localised at five heights, in the second.
#[test]
fn virtual_matches_agree_with_s2p() {
    let Some(data) = common::data_dir() else { return };
    let [first, second] =
        ["img_01.tif", "img_02.tif"].map(|f| as_gdal_reads(&data.join("s2p/input_pair").join(f)));
    let text = std::fs::read_to_string(data.join("s2p/expected/units/unit_matches_from_rpc.txt")).unwrap();
    let theirs: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
    assert_eq!(theirs.len(), 125 * 4);
    // A tenth of the region's sides away from its edges, and the heights from end to end.
    let along = |i: usize| 100.0 + 200.0 * (0.1 + 0.2 * i as f64);
    let (low, high) = first.height_range();
    for (k, theirs) in theirs.chunks(4).enumerate() {
        let px = Pixel::new(along(k % 5), along(k / 5 % 5));
        let height_m = low + 0.25 * (high - low) * (k / 25) as f64;
        let there = second.project(first.localize(px, height_m).unwrap());
        for (ours, theirs) in [px.col, px.row, there.col, there.row].iter().zip(theirs) {
            assert!((ours - theirs).abs() < 0.1 + 0.01 * theirs.abs(), "{k}: {there:?}, {theirs}");
        }
    }
}

/// The fixed-width numbers of a NITF's RPC00B, and its pixels there and back.
#[test]
fn nitf_coefficients_agree_with_shareloc() {
    let Some(data) = common::data_dir() else { return };
    let rpc = as_gdal_reads(&data.join("rpc/shareloc/wv3_20.NTF"));
    let c = rpc.coefficients();
    let axes = [c.row, c.col, c.lat, c.lon, c.height];
    assert_eq!(axes.map(|a| a.offset), [17_495.0, 20_749.0, -34.5043, -58.6024, 31.0]);
    assert_eq!(axes.map(|a| a.scale), [17_996.0, 21_250.0, 0.0531, 0.0803, 501.0]);
    assert_eq!(c.row_num[..4], [0.002_401_507, -0.002_429_637, 1.002_863, -0.000_763_385_8]);
    assert_eq!(c.col_num[..4], [0.005_014_126, -1.021_695, -0.000_226_516_1, 0.020_714_51]);
    assert_eq!((c.err_bias_m, c.err_rand_m), (Some(0.87), Some(0.33)));
    let px = Pixel::new(501.0, 501.0);
    assert!(rpc.project(rpc.localize(px, 10.0).unwrap()).distance(px) < 1e-8);
}

/// Two levels of one Planet frame: another sampling of the same camera (rpcm's `equal_projection`).
#[test]
fn two_processing_levels_of_planet_have_the_same_polynomials() {
    let Some(data) = common::data_dir() else { return };
    let [a, b] = ["rpc_PLANET_L1A.txt", "rpc_PLANET_L1B.txt"]
        .map(|f| formats::read(&data.join("rpc/rpcm").join(f)).unwrap().rpc.coefficients().clone());
    assert_eq!((a.col_num, a.col_den, a.row_num, a.row_den), (b.col_num, b.col_den, b.row_num, b.row_den));
    assert!(a.col.scale < b.col.scale && a.row.offset < b.row.offset);
}

/// GDAL finds these beside an image and reads them itself; it knows neither OSSIM's `.geom` nor DIMAP 1.
#[test]
fn rpc_files_of_vendors_give_the_same_camera_as_in_gdal() {
    let Some(data) = common::data_dir() else { return };
    let (phr, neo) = ("PHR1B_P_201709281038045_SEN_PRG_FC_178608-001", "PNEO3_202111071029126_PAN_trimmed");
    for (file, image) in [
        (format!("shareloc/RPC_{phr}.XML"), format!("IMG_{phr}_R1C1.TIF")),
        (format!("wv-metadata/pleiades/RPC_{neo}.XML"), format!("IMG_{neo}_R1C1.TIF")),
        ("rpcm/rpc_WV1.xml".into(), "rpc_WV1.tif".into()),
        ("rpcm/rpc_WV3.xml".into(), "rpc_WV3.tif".into()),
    ] {
        let (file, folder) = (data.join("rpc").join(file), tempfile::tempdir().unwrap());
        let image = folder.path().join(image);
        common::image(&image, 1, None, &[]);
        std::fs::copy(&file, folder.path().join(file.file_name().unwrap())).unwrap();
        let (ours, mut theirs) = (formats::read(&file).unwrap().rpc, as_gdal_reads(&image));
        if file.ends_with(format!("RPC_{neo}.XML")) {
            // Before 3.8 GDAL counts Pléiades Neo's pixels from the validity domain's first (its pull request 7653).
            let (a, b) = (ours.coefficients(), theirs.coefficients());
            theirs = theirs.shifted(a.col.offset - b.col.offset, a.row.offset - b.row.offset);
        }
        let (low, high) = ours.height_range();
        for height_m in [low, high] {
            let ground = ours.center().at_height(height_m);
            let apart = ours.project(ground).distance(theirs.project(ground));
            assert!(apart < 1e-6, "{}: {apart} px", file.display());
        }
    }
}

/// GDAL reads the older form too; in which order nobody can check here.
#[test]
fn an_rpc00a_in_a_nitf_is_refused() {
    let Some(data) = common::data_dir() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = std::fs::read(data.join("rpc/shareloc/wv3_20.NTF")).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(folder.path().join("a.ntf"), bytes).unwrap();
        satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default())
    };
    assert_eq!(read(&bytes).unwrap().views[0].rpc_source, "RPC00B segment");
    let at = bytes.windows(11).position(|w| w == b"RPC00B01041").unwrap();
    bytes[at + 5] = b'A';
    let error = read(&bytes).unwrap_err().to_string();
    assert!(error.contains("a.ntf` holds an RPC00A"), "{error}");
}
