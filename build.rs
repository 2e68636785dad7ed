//! Refuses a GDAL that satgs does not work with, before anything is compiled against it.

/// The oldest GDAL that satgs is tested with, as GDAL_COMPUTE_VERSION writes 3.6.0. Systems with an older one have a PROJ older
/// than 9, beside which `proj-sys` would put another one of its own.
const OLDEST: u32 = 3_060_000;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // `gdal-sys` names the version that it binds; one that is newer than its bindings it refuses by itself.
    let version = std::env::var("DEP_GDAL_VERSION_NUMBER").ok().and_then(|v| v.parse::<u32>().ok());
    if let Some(found) = version.filter(|found| *found < OLDEST) {
        println!(
            "cargo::error=GDAL {}.{}.{} is too old: satgs needs 3.6 to 3.12. docs/guide/install.md names systems that have one, and \
             packages that contain one",
            found / 1_000_000,
            found / 10_000 % 100,
            found / 100 % 100
        );
    }
}
