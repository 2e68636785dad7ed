//! Georeferencing of scenes: UTM zones, heights above a geoid, ortho-ready images.
use crate::common::{camera, dem_grid, image, satgs, two_views};
use satgs::frame::SiteGrid;
use satgs::io::{Cog, Grid2, MapGrid, VerticalReference};
use satgs::rpc::formats::to_text;
use satgs::rpc::{Rpc, RpcCoefficients};
use satgs::scene::{ReadOptions, read};

/// All views of a scene use the UTM zone of its centre.
#[test]
fn scenes_across_zones_the_equator_and_the_antimeridian_have_one_zone() {
    for (lons, lat, zones) in [
        ([5.9999, 6.0001], 43.26, [32631, 32632]),
        ([5.44, 5.44], 0.0, [32631, 32731]),
        ([179.9999, -179.9999], 43.26, [32660, 32601]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        for (name, seed, lon, lean) in [("a.tif", 1, lons[0], 0.2), ("b.tif", 2, lons[1], -0.2)] {
            let mut c = RpcCoefficients::from(camera(lon, lean));
            c.lat.offset = lat;
            image(&folder.path().join(name), seed, Some(&Rpc::new(c).unwrap()), &[]);
        }
        let done = satgs(&["info", folder.path().to_str().unwrap()]);
        assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
        let scene = read(folder.path(), &ReadOptions::default()).unwrap();
        let overlap = scene.overlap().unwrap();
        assert!(zones.contains(&overlap.epsg) && overlap.common_m2 > 500.0, "{overlap:?}");
    }
}

/// Height above the ellipsoid = height above the geoid + undulation.
#[test]
fn heights_above_a_geoid_are_converted_by_its_undulation() {
    let folder = two_views();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    let made = tempfile::tempdir().unwrap();
    // PROJ asks a geoid grid for its description and unit, if it has any.
    let write = |name: &str, grid: MapGrid, value: f32, [description, unit]: [&str; 2]| {
        let raster = Grid2::filled(grid.width, grid.height, value);
        let path = made.path().join(name);
        let cog = Cog { grid, metadata: &[], heights_from: None };
        cog.write_f32(&path, &[(description, unit, &raster)]).unwrap();
        path
    };
    let degrees = MapGrid { epsg: 4326, west: 4.0, north: 45.0, cell: 0.5, width: 8, height: 8 };
    let (dem, geoid) = (
        write("dem.tif", dem_grid(), 50.0, ["height", "m"]),
        write("geoid.tif", degrees, 49.3, ["geoid_undulation", "metre"]),
    );
    let vertical = VerticalReference::read(geoid.to_str().unwrap()).unwrap();
    let dem = scene.dem(&dem, Some(&vertical)).unwrap();
    let (low, high) = dem.heights_to_search();
    assert!((low - 79.3).abs() < 1e-3 && (high - 179.3).abs() < 1e-3, "{low} {high}");
    assert!((dem.height_m(scene.center().unwrap()) - 99.3).abs() < 1e-3);
}

/// An ortho-ready image (Maxar OR2A) is a map with an RPC of its own, and is accepted.
#[test]
fn an_ortho_ready_image_keeps_its_camera() {
    let folder = two_views();
    let rpc = camera(5.44, 0.2);
    let origin = SiteGrid::at(rpc.center()).unwrap().origin;
    let (west, north) = (origin.x() - 16.0, origin.y() + 16.0);
    let grid = MapGrid { epsg: 32631, west, north, cell: 0.5, width: 64, height: 64 };
    let ready = Cog { grid, metadata: &[], heights_from: None };
    let pixels = (0..64 * 64).map(|i| (i % 251) as u8).collect();
    ready.write_u8(&folder.path().join("ready.tif"), vec![pixels], None).unwrap();
    std::fs::write(folder.path().join("ready_RPC.TXT"), to_text(&rpc)).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    assert!(scene.views.iter().any(|v| v.name == "ready" && v.rpc == rpc), "{:?}", scene.warnings);
}
