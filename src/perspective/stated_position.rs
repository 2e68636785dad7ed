//! What a list or a photograph states about the place and the attitude of a camera.

use super::pose::Pose;
use crate::io::ImageFile;
use glam::DVec3;

/// Elements of XMP in which DJI's drones state the attitude of the gimbal and the accuracy of RTK positions.
const PITCH: &str = "drone-dji:GimbalPitchDegree";
const ROLL: &str = "drone-dji:GimbalRollDegree";
const RTK: [&str; 3] = ["drone-dji:RtkStdLon", "drone-dji:RtkStdLat", "drone-dji:RtkStdHgt"];

/// A camera and where it stands as stated.
#[derive(Clone, Debug)]
pub(super) struct StatedPosition {
    /// Name of its image.
    pub name: String,
    /// Its pose in the frame of the file.
    pub pose: Pose,
    /// In the coordinates of an EPSG code (longitude and latitude in this order), with a height in metres above the ellipsoid.
    pub position: [f64; 3],
    /// Standard deviations of east, north and height, metres, if they are stated.
    pub sigma_m: Option<DVec3>,
    /// The upward direction in camera axes (right, down, forward), if the attitude is stated.
    pub up_in_camera: Option<DVec3>,
}

impl StatedPosition {
    /// Longitude, latitude, altitude of a photograph's EXIF, and what its XMP states. Altitudes are taken as heights above the
    /// ellipsoid, which they are in EXIF 3.0 unless the reference says sea level. None without a position.
    pub fn of_photograph(name: &str, pose: Pose, file: &ImageFile) -> Option<Self> {
        let position = exif_position(|key| file.metadata(&format!("EXIF_GPS{key}"), ""))?;
        let xmp = file.xmp().unwrap_or_default();
        let sigma = RTK.map(|key| xmp_number(&xmp, key).filter(|s| *s > 0.0));
        let sigma_m = match sigma {
            [Some(east), Some(north), Some(up)] => Some(DVec3::new(east, north, up)),
            _ => None,
        };
        let pitch = xmp_number(&xmp, PITCH);
        let up_in_camera = pitch.map(|pitch| up_of_gimbal(pitch, xmp_number(&xmp, ROLL).unwrap_or(0.0)));
        Some(Self { name: name.into(), pose, position, sigma_m, up_in_camera })
    }

    /// The upward direction in the frame of the file.
    pub fn up(&self) -> Option<DVec3> {
        Some(self.pose.cam_from_world.transpose() * self.up_in_camera?)
    }

    /// Where the camera looks, in the frame of the file.
    pub fn forward(&self) -> DVec3 {
        self.pose.cam_from_world.row(2)
    }
}

/// The upward direction in camera axes of a gimbal with a pitch (0 level, -90 straight down) and a roll (clockwise), degrees.
fn up_of_gimbal(pitch_deg: f64, roll_deg: f64) -> DVec3 {
    let ((sin, cos), (sin_roll, cos_roll)) =
        (pitch_deg.to_radians().sin_cos(), roll_deg.to_radians().sin_cos());
    DVec3::new(-cos * sin_roll, -cos * cos_roll, sin)
}

/// The number of an attribute `key="+1.5"` or an element `<key>+1.5</key>`.
fn xmp_number(xmp: &str, key: &str) -> Option<f64> {
    let after = &xmp[xmp.find(key)? + key.len()..];
    let value = after.trim_start_matches(['=', '"', '\'', '>', ' ']);
    let end = value.find(['"', '\'', '<', ' ']).unwrap_or(value.len());
    value[..end].trim_start_matches('+').parse().ok().filter(|v: &f64| v.is_finite())
}

/// Longitude, latitude, altitude of the EXIF items `Latitude`, `LatitudeRef`, …, written as GDAL does: `(46) (50) (33.9)`.
fn exif_position(item: impl Fn(&str) -> Option<String>) -> Option<[f64; 3]> {
    let numbers = |key: &str| -> Option<Vec<f64>> {
        let text = item(key)?;
        text.split(['(', ')', ' ']).filter(|w| !w.is_empty()).map(|w| w.parse().ok()).collect()
    };
    let degrees = |key: &str, negative: &str| {
        let parts = numbers(key)?;
        let value = parts.iter().zip([1.0, 60.0, 3600.0]).map(|(part, unit)| part / unit).sum::<f64>();
        let sign = if item(&format!("{key}Ref"))?.trim().eq_ignore_ascii_case(negative) { -1.0 } else { 1.0 };
        Some(sign * value)
    };
    let altitude = *numbers("Altitude")?.first()?;
    // 1 and 3 are below the ellipsoid and below sea level.
    let is_below = item("AltitudeRef").is_some_and(|r| r.ends_with(['1', '3']));
    Some([degrees("Longitude", "W")?, degrees("Latitude", "S")?, if is_below { -altitude } else { altitude }])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_exif_have_the_signs_of_their_hemispheres() {
        let items = |key: &str| {
            let text = match key {
                "Latitude" => "(46) (50) (33.9993)",
                "LatitudeRef" => "S",
                "Longitude" => "(91) (59) (39.4778)",
                "LongitudeRef" => "W",
                "Altitude" => "(12.5)",
                "AltitudeRef" => "0x01",
                _ => return None,
            };
            Some(text.to_owned())
        };
        let [lon, lat, height] = exif_position(items).unwrap();
        assert!((lon + 91.994_299_388_9).abs() < 1e-9 && (lat + 46.842_777_583_3).abs() < 1e-9);
        assert!((height + 12.5).abs() < 1e-12);
        assert_eq!(exif_position(|key| if key == "Altitude" { None } else { items(key) }), None);
    }

    #[test]
    fn numbers_of_xmp_are_attributes_or_elements() {
        let xmp = r#"<rdf:Description drone-dji:GimbalPitchDegree="-89.90" drone-dji:RtkStdLon='0.012'>
            <drone-dji:GimbalRollDegree>+0.50</drone-dji:GimbalRollDegree>"#;
        assert_eq!(xmp_number(xmp, PITCH), Some(-89.9));
        assert_eq!(xmp_number(xmp, ROLL), Some(0.5));
        assert_eq!((xmp_number(xmp, RTK[0]), xmp_number(xmp, RTK[1])), (Some(0.012), None));
    }

    #[test]
    fn up_is_behind_a_camera_that_looks_down_and_above_a_level_one() {
        assert!((up_of_gimbal(-90.0, 0.0) - DVec3::NEG_Z).length() < 1e-12);
        assert!((up_of_gimbal(0.0, 0.0) - DVec3::NEG_Y).length() < 1e-12);
        // Turned clockwise, the top of the image leans to the right of what is up: up is to the left in the image.
        assert!((up_of_gimbal(0.0, 90.0) - DVec3::NEG_X).length() < 1e-12);
        assert!(up_of_gimbal(-45.0, 0.0).z < 0.0);
    }
}
