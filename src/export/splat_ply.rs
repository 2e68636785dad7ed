//! Splat files in the variants that viewers ask for.

use super::Axes;
use crate::frame::SiteGrid;
use crate::splat::splats::Splats;
use std::fmt::Write as _;

/// Coefficients of spherical harmonics above degree 0 in a file of degree 3.
const REST: usize = 45;

/// A variant of the PLY file of 3DGS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyVariant {
    /// All columns that 3DGS writes, also those of spherical harmonics above degree 0; z is up.
    #[default]
    Full,
    /// As [`PlyVariant::Full`], with the axes of scenes of COLMAP, whose y points down: x is east, y down, z north. Viewers
    /// turn these upright.
    YDown,
}

impl PlyVariant {
    /// The directions of x, y and z.
    #[must_use]
    pub fn axes(self) -> Axes {
        match self {
            Self::Full => Axes::EastNorthUp,
            Self::YDown => Axes::EastDownNorth,
        }
    }

    /// The comments in the header of splats in these axes: their place, and which axis is vertical.
    #[must_use]
    pub fn comments(self, site: Option<&SiteGrid>) -> Vec<String> {
        let Some(site) = site else { return Vec::new() };
        let ([east, north, height], axes) = (site.origin.xyz(), self.axes().names().join(", "));
        let vertical = if self == Self::Full { "z" } else { "-y" };
        vec![
            format!("metres {axes} from EPSG:{} {east} {north}, ellipsoidal height {height}", site.epsg),
            format!("Vertical Axis: {vertical}"),
        ]
    }

    /// The content of the file, of splats in the axes of the variant; the site is that of their frame if they are on the map.
    #[must_use]
    pub fn encode(self, splats: &Splats, site: Option<&SiteGrid>) -> Vec<u8> {
        let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
        for comment in self.comments(site) {
            let _ = writeln!(header, "comment {comment}");
        }
        let _ = writeln!(header, "element vertex {}", splats.len());
        let rest: Vec<String> = (0..REST).map(|k| format!("f_rest_{k}")).collect();
        let first = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
        let last = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
        for name in first.into_iter().chain(rest.iter().map(String::as_str)).chain(last) {
            let _ = writeln!(header, "property float {name}");
        }
        header.push_str("end_header\n");
        let mut bytes = header.into_bytes();
        for i in 0..splats.len() {
            let values = splats.position[i]
                .into_iter()
                .chain([0.0; 3])
                .chain(splats.f_dc[i])
                .chain(splats.f_rest.get(i).copied().unwrap_or([0.0; REST]))
                .chain(splats.opacity_logit[i])
                .chain(splats.log_scale[i])
                .chain(splats.rotation[i]);
            values.for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;
    use crate::splat::ply;
    use glam::{DMat3, DQuat, DVec3};

    /// The shape of a splat: its covariance without the scale of its axes' order.
    fn covariance(splats: &Splats) -> DMat3 {
        let [w, x, y, z] = splats.rotation[0].map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scale = DVec3::from_array(splats.log_scale[0].map(|s| f64::from(s).exp().powi(2)));
        rotation * DMat3::from_diagonal(scale) * rotation.transpose()
    }

    #[test]
    fn files_have_the_62_columns_of_3dgs_and_are_read_back() {
        let mut splats = Splats::default();
        splats.push([1.0, 2.0, 3.0], 0.4, 0.8, [0.2, 0.4, 0.6]);
        splats.rotation[0] = [0.9, 0.1, -0.3, 0.2];
        splats.log_scale[0] = [0.1, -0.5, 0.7];
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
        let folder = tempfile::tempdir().unwrap();
        let read = |variant: PlyVariant| {
            let path = folder.path().join("splats.ply");
            let bytes = variant.encode(&variant.axes().from_site(splats.clone()), Some(&site));
            let head = String::from_utf8_lossy(&bytes).into_owned();
            assert_eq!(head.matches("property float").count(), 62);
            std::fs::write(&path, bytes).unwrap();
            ply::read(&path).unwrap()
        };
        assert_eq!(read(PlyVariant::Full), splats);
        let turned = read(PlyVariant::YDown);
        assert_eq!(turned.position[0], [1.0, -3.0, 2.0]);
        let turn = DMat3::from_cols_array_2d(&[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]);
        let expected = turn * covariance(&splats) * turn.transpose();
        assert!((covariance(&turned) - expected).abs_diff_eq(DMat3::ZERO, 1e-6));
        assert_eq!(turned.f_dc, splats.f_dc);
        splats.f_rest.push([0.25; REST]);
        let path = folder.path().join("directional.ply");
        std::fs::write(&path, PlyVariant::Full.encode(&splats, None)).unwrap();
        assert_eq!(ply::read(&path).unwrap(), splats);
    }
}
