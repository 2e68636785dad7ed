//! Configuration of GDAL, and coordinate transforms.

use gdal::config::{
    clear_thread_local_config_option, get_config_option, set_config_option, set_thread_local_config_option,
};
use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, SpatialRef};
use std::sync::Once;

/// Options for reading over a network, where the user has not set them: requests share a connection, failed ones are
/// repeated, and GDAL keeps at most 256 MB of decoded blocks, whatever the memory of the machine.
const OPTIONS: [(&str, &str); 4] = [
    ("GDAL_HTTP_MULTIPLEX", "YES"),
    ("GDAL_HTTP_MAX_RETRY", "5"),
    ("GDAL_HTTP_RETRY_DELAY", "1"),
    ("GDAL_CACHEMAX", "256"),
];
/// Where Debian and its relatives keep the certificates of servers. The libcurl that packages of satgs contain looks elsewhere.
const CERTIFICATES: &str = "/etc/ssl/certs/ca-certificates.crt";
/// Options that name a file of certificates, the one that GDAL prefers first.
const CERTIFICATE_OPTIONS: [&str; 3] = ["GDAL_CURL_CA_BUNDLE", "CURL_CA_BUNDLE", "SSL_CERT_FILE"];
/// The option that keeps GDAL from listing the folder of every file that it opens.
const NO_LISTING: &str = "GDAL_DISABLE_READDIR_ON_OPEN";
/// Options that hold only while a file of a virtual file system is opened, where the user has not set them: GDAL does not
/// list its folder, and keeps parts of the file in memory. For local files the first would hide the files beside them.
const REMOTE_OPTIONS: [(&str, &str); 2] = [(NO_LISTING, "EMPTY_DIR"), ("VSI_CACHE", "TRUE")];

/// Configures GDAL at the first call. Messages of GDAL are written to the log only, because errors contain them.
pub(super) fn set_up_gdal() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Tiles of large rasters are decoded in parallel.
        let _ = set_config_option("GDAL_NUM_THREADS", &rayon::current_num_threads().to_string());
        for (key, value) in OPTIONS.into_iter().filter(|(key, _)| !is_set(key)) {
            let _ = set_config_option(key, value);
        }
        if !CERTIFICATE_OPTIONS.iter().any(|key| is_set(key)) && std::path::Path::new(CERTIFICATES).exists() {
            let _ = set_config_option(CERTIFICATE_OPTIONS[0], CERTIFICATES);
        }
        gdal::config::set_error_handler(|class, number, message| {
            tracing::debug!("GDAL {class:?} {number}: {message}");
        });
    });
}

/// Whether an option of GDAL is set, in the environment or by a program.
fn is_set(key: &str) -> bool {
    get_config_option(key, "").is_ok_and(|value| !value.is_empty())
}

/// Whether the user asks GDAL not to list folders.
pub(super) fn listing_is_off() -> bool {
    let value = get_config_option(NO_LISTING, "NO").unwrap_or_default().to_ascii_uppercase();
    ["YES", "TRUE", "ON", "1", "EMPTY_DIR"].contains(&value.as_str())
}

/// Sets [`REMOTE_OPTIONS`] for this thread until the returned value is dropped.
pub(super) fn remote_options() -> RemoteOptions {
    let open: Vec<&str> = REMOTE_OPTIONS
        .into_iter()
        .filter(|(key, value)| !is_set(key) && set_thread_local_config_option(key, value).is_ok())
        .map(|(key, _)| key)
        .collect();
    RemoteOptions(open)
}

/// See [`remote_options`].
pub(super) struct RemoteOptions(Vec<&'static str>);

impl Drop for RemoteOptions {
    fn drop(&mut self) {
        for key in &self.0 {
            let _ = clear_thread_local_config_option(key);
        }
    }
}

/// Transforms coordinates in place. x is east or longitude and y north or latitude, whatever order the CRS defines.
pub(super) fn transform(
    mut from: SpatialRef,
    mut to: SpatialRef,
    x: &mut [f64],
    y: &mut [f64],
    z: &mut [f64],
) -> Option<()> {
    from.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    to.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    CoordTransform::new(&from, &to).ok()?.transform_coords(x, y, z).ok()
}
