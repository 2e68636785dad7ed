//! Choice of the RPC of an image among sidecars, chips, crops and maps; overlap of views at different heights.
use crate::common::{camera, data_dir, image, satgs, two_views};
use satgs::io::decode_text;
use satgs::rpc::Rpc;
use satgs::rpc::formats::{parse, to_rpb, to_text};
use satgs::scene::{Aoi, ReadOptions, Scene, read, read_camera};
use std::path::{Path, PathBuf};

/// A folder of `../shared/data/inputs`.
fn input(name: &str) -> Option<PathBuf> {
    data_dir().map(|d| d.join("inputs").join(name)).filter(|d| d.is_dir())
}

fn scene(path: &Path) -> Result<Scene, String> {
    read(path, &ReadOptions::default()).map_err(|e| e.to_string())
}

fn trusted(path: &Path) -> Scene {
    read(path, &ReadOptions { trust_rpc: true, ..Default::default() }).unwrap()
}

/// The camera with scales and offsets of an image of `size` pixels a side, as vendors write them.
fn spanning(rpc: &Rpc, size: f64) -> Rpc {
    let mut c = rpc.coefficients().clone();
    let by = 0.5 * size / c.col.scale;
    c.lon.scale *= by;
    c.lat.scale *= by;
    c.col_num[3] /= by;
    (c.col.scale, c.row.scale, c.col.offset, c.row.offset) = (0.5 * size, 0.5 * size, 0.5 * size, 0.5 * size);
    Rpc::new(c).unwrap()
}

#[test]
fn the_rpc_of_a_nitf_chip_is_shifted_to_its_position_in_the_full_image() {
    let Some(folder) = input("nitf-ichipb") else { return };
    let file = read_camera(&folder.join("VIEW_01.ntf"), false).unwrap();
    // Offsets in RPC00B are rounded, which gives an error of a tenth of a pixel here.
    let px = file.rpc.project(satgs::frame::Point::new(5.499763161, 43.300094268, 160.0));
    assert!((px.col - 50.0).abs() < 0.1 && (px.row - 50.0).abs() < 0.1, "{px:?}");
    assert!(
        file.warnings.iter().any(|w| w.contains("column 40, row 60 of the full image (ICHIPB)")),
        "{file:?}"
    );
}

#[test]
fn orthorectified_images_are_refused_and_approximate_geotransforms_accepted() {
    let Some(folder) = input("mapprojected-with-rpc") else { return };
    let error = scene(&folder).unwrap_err();
    assert!(error.contains("VIEW_01.tif` is orthorectified"), "{error}");
    assert_eq!(trusted(&folder).views.len(), 3);
    let Some(folder) = input("rough-geotransform") else { return };
    let read = scene(&folder).unwrap();
    assert_eq!(read.views.len(), 2);
    assert!(read.warnings.iter().any(|w| w.contains("its map position and its")), "{:?}", read.warnings);
}

#[test]
fn images_resampled_without_their_rpc_are_refused() {
    for size in [32.0, 128.0, 16.0, 256.0] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        image(&path, 1, Some(&spanning(&camera(5.44, 0.2), size)), &[]);
        let error = scene(folder.path()).unwrap_err();
        assert!(error.contains(&format!("for an image of about {size:.0} x {size:.0}")), "{error}");
        // Far outside of its validity volume, the RPC cannot be inverted.
        if size > 16.0 {
            assert_eq!(trusted(folder.path()).views.len(), 1);
        }
    }
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("a.tif"), 1, Some(&spanning(&camera(5.44, 0.2), 64.0)), &[]);
    assert!(scene(folder.path()).unwrap().warnings.iter().all(|w| !w.contains("RPC")));
}

#[test]
fn a_tile_with_its_own_rpb_is_read_beside_its_products_metadata() {
    let folder = tempfile::tempdir().unwrap();
    let product = "<isd><IMD><NUMROWS>128</NUMROWS><NUMCOLUMNS>128</NUMCOLUMNS></IMD></isd>";
    std::fs::write(folder.path().join("17JUL-P1BS-05_P001.XML"), product).unwrap();
    let tile = folder.path().join("17JUL-P1BS_R1C2-05_P001.TIF");
    image(&tile, 1, None, &[]);
    let rpc = camera(5.44, 0.2);
    std::fs::write(tile.with_extension("RPB"), to_rpb(&rpc)).unwrap();
    assert_eq!(read_camera(&tile, false).unwrap().rpc, rpc);
    // The offset in the .TIL file shifts the RPB of the product to the tile.
    std::fs::remove_file(tile.with_extension("RPB")).unwrap();
    std::fs::write(folder.path().join("17JUL-P1BS-05_P001.RPB"), to_rpb(&rpc.shifted(64.0, 0.0))).unwrap();
    let til = "bandId = \"P\";\nnumTiles = 2;\nBEGIN_GROUP = TILE_1\n\tfilename = \"17JUL-P1BS_R1C1-05_P001.TIF\";\n\
               \tULColOffset = 0;\n\tULRowOffset = 0;\nEND_GROUP = TILE_1\nBEGIN_GROUP = TILE_2\n\
               \tfilename = \"17JUL-P1BS_R1C2-05_P001.TIF\";\n\tULColOffset = 64;\n\tULRowOffset = 0;\n\
               END_GROUP = TILE_2\nEND;\n";
    std::fs::write(folder.path().join("17JUL-P1BS-05_P001.TIL"), til).unwrap();
    let found = read_camera(&tile, false).unwrap().rpc;
    assert_eq!(found.coefficients().col.offset, rpc.coefficients().col.offset);
    let Some(folder) = input("maxar-tiles-product-xml") else { return };
    assert_eq!(scene(&folder).unwrap().views.len(), 4);
}

#[test]
fn the_rpc_that_fits_is_taken_from_several() {
    let Some(data) = data_dir() else { return };
    let crop = data.join("rpc/shareloc/PHR1B_P_201709281038393_SEN_PRG_FC_178609-001.tif");
    let file = read_camera(&crop, false).unwrap();
    assert!(file.warnings.iter().any(|w| w.contains(".geom is not for this image")), "{:?}", file.warnings);
}

#[test]
fn the_rpc_in_a_virtual_raster_has_precedence() {
    let Some(folder) = input("vrt-sidecar") else { return };
    let read = scene(&folder.join("scene.toml")).unwrap();
    assert_eq!(read.views[0].rpc_source, "RPC read by GDAL");
    assert!((read.views[0].rpc.coefficients().col.offset - 88.994).abs() < 0.01);
    let sources = satgs::scene::sources_of(&folder.join("VIEW_01.vrt"));
    assert_eq!(sources, [folder.join("VIEW_01.tif")]);
}

#[test]
fn views_that_overlap_only_at_the_terrain_height_are_accepted() {
    // Views 6° either side of the vertical (0.2 m a 0.5 m pixel and metre), of the same ground 900 m above the middle.
    let view = |lean: f64| {
        let mut c = camera(5.44, lean).coefficients().clone();
        for axis in [&mut c.lon, &mut c.lat, &mut c.col, &mut c.row] {
            axis.scale *= 10.0;
        }
        c.height.scale = 1000.0;
        c.col_num[3] *= 2.0;
        Rpc::new(c).unwrap()
    };
    let folder = tempfile::tempdir().unwrap();
    for (name, seed, lean) in [("a", 1, 0.2), ("b", 2, -0.2)] {
        let crop = view(lean).shifted(-900.0 * lean, 0.0);
        image(&folder.path().join(format!("{name}.tif")), seed, Some(&crop), &[]);
    }
    let scene = scene(folder.path()).unwrap();
    let overlap = scene.overlap().unwrap();
    assert!((overlap.height_m - 1000.0).abs() < 35.0, "{overlap:?}");
    assert!(overlap.nearest.iter().all(|n| n.unwrap().1 > 80.0), "{overlap:?}");
    scene.require_shared_ground(scene.height_range()).unwrap();
    assert!(scene.require_shared_ground((0.0, 200.0)).is_err());
}

#[test]
fn companions_are_masks_and_other_rasters_are_named() {
    let folder = two_views();
    image(&folder.path().join("a_udm2.tif"), 3, None, &[]);
    std::fs::write(folder.path().join("c.dat"), b"raw").unwrap();
    let read = scene(folder.path()).unwrap();
    assert_eq!(read.views.len(), 2);
    assert_eq!(read.views[0].mask.as_deref(), Some(folder.path().join("a_udm2.tif").as_path()));
    let said = read.warnings.join("\n");
    assert!(
        said.contains("a_udm2.tif` is used as the mask of a") && said.contains("c.dat` is left out"),
        "{said}"
    );
    let Some(folder) = input("planet-udm2") else { return };
    assert!(scene(&folder).unwrap().views.iter().all(|v| v.mask.is_some()));
}

#[test]
fn spelling_variants_of_rpc_text_are_read() {
    let rpc = camera(5.44, 0.2);
    let text = to_text(&rpc);
    let file = Path::new("a_RPC.TXT");
    for good in [
        format!("ERR_BIAS:\nERR_RAND: N/A\n{text}"),
        text.replace(": ", " "),
        decode_text(
            &[0xff, 0xfe]
                .into_iter()
                .chain(text.encode_utf16().flat_map(u16::to_le_bytes))
                .collect::<Vec<u8>>(),
        ),
    ] {
        assert_eq!(parse(file, &good).unwrap().rpc, rpc);
    }
    let error = parse(file, &format!("{text}SAMP_OFF: 0\n")).unwrap_err().to_string();
    assert!(error.contains("`SAMP_OFF` is given twice, as 31.5 and as 0"), "{error}");
    for name in ["a_RPC_ORG.TXT", "rpc_a.txt", "a.tif.rpc"] {
        let folder = tempfile::tempdir().unwrap();
        image(&folder.path().join("a.tif"), 1, None, &[]);
        std::fs::write(folder.path().join(name), &text).unwrap();
        assert_eq!(scene(folder.path()).unwrap().views[0].rpc_source, name);
    }
}

#[test]
fn areas_may_have_several_polygons_and_byte_order_marks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.geojson");
    let square =
        |w: f64, s: f64| format!("[[[{w},{s}],[{e},{s}],[{e},{n}],[{w},{s}]]]", e = w + 0.01, n = s + 0.01);
    let two =
        format!(r#"{{"type":"MultiPolygon","coordinates":[{},{}]}}"#, square(5.4, 43.2), square(5.5, 43.3));
    std::fs::write(&path, format!("\u{feff}{two}")).unwrap();
    let area = Aoi::from_geojson(&path).unwrap();
    assert_eq!(area.place(), "lon 5.4000 to 5.5100, lat 43.2000 to 43.3100");
    let Some(folder) = input("test-txt-bom") else { return };
    let read = scene(&folder).unwrap();
    assert_eq!(read.views[0].role, satgs::scene::Role::Test);
}

#[test]
fn trust_rpc_is_an_option_of_every_command_that_reads_cameras() {
    for command in [["info", "--help"], ["ba", "--help"], ["rpc", "--help"]] {
        let help = satgs(&command);
        assert!(String::from_utf8_lossy(&help.stdout).contains("--trust-rpc"), "{command:?}");
    }
}
