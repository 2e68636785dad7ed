//! Reads an RPC camera, projects a point of the ground into the image, and localises the pixel again.
//!
//! `cargo run --example project_point -- IMAGE_OR_RPC_FILE`, or without arguments on an image of `data/town`.

#![allow(clippy::print_stdout)]

use satgs::scene::read_camera;
use std::path::PathBuf;

mod town;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let town = town::Town::new()?;
    let image = arguments.first().cloned().unwrap_or_else(|| town.scene().join("VIEW_01.tif"));
    let rpc = read_camera(&image, false)?.rpc;

    // Longitude and latitude in degrees, height in metres above the WGS 84 ellipsoid.
    let ground = rpc.center();
    // Pixel (0, 0) is the centre of the first pixel.
    let pixel = rpc.project(ground);
    println!(
        "lon {:.6}, lat {:.6}, h {:.1} m is seen at column {:.2}, row {:.2}",
        ground.lon_deg(),
        ground.lat_deg(),
        ground.height_m(),
        pixel.col,
        pixel.row
    );
    let again = rpc.localize(pixel, ground.height_m())?;
    println!("and that pixel at that height is lon {:.6}, lat {:.6}", again.lon_deg(), again.lat_deg());
    Ok(())
}
