//! A COLMAP model of local pinhole cameras, with the tie points of the adjustment.

use super::{LocalPinhole, Resampled};
use crate::frame::{CenterPx, CornerPx, Pixel, Point, Site};
use crate::perspective::colmap::{ColmapCamera, ColmapImage, ColmapModel, ColmapObservation, ColmapPoint};
use crate::perspective::{LensModel, PinholeCamera, ScenePoint};
use glam::DQuat;

/// Fewest observations of a point.
const FEWEST: usize = 2;

/// A COLMAP model to which views are added one by one. Its world is the site frame.
#[derive(Debug)]
pub struct ColmapBuilder {
    positions: Vec<Point<Site>>,
    /// Of each point: numbers of the images that see it and of the keypoints in them, and sums over these of the colours and
    /// of the distances from its projections.
    tracks: Vec<Vec<(u32, u32)>>,
    colors: Vec<[f64; 3]>,
    distances: Vec<f64>,
    model: ColmapModel,
}

impl ColmapBuilder {
    /// A model without views, of points at these positions.
    #[must_use]
    pub fn new(positions: Vec<Point<Site>>) -> Self {
        let n = positions.len();
        Self {
            positions,
            tracks: vec![Vec::new(); n],
            colors: vec![[0.0; 3]; n],
            distances: vec![0.0; n],
            model: ColmapModel { cameras: vec![], images: vec![], points: vec![] },
        }
    }

    /// Adds a view whose image is the file `name`. `seen` holds the indices of the points that it sees and where in the
    /// original image; those outside of the resampled image or where it has no data are left out.
    pub fn add_view(
        &mut self,
        name: String,
        pinhole: &LocalPinhole,
        image: &Resampled,
        seen: impl Iterator<Item = (usize, Pixel<CenterPx>)>,
    ) {
        let LocalPinhole { camera, map, .. } = pinhole;
        let id = self.model.images.len() as u32 + 1;
        let mut observations = Vec::new();
        for (point, px) in seen {
            let Some(position) = self.positions.get(point) else { continue };
            let Some(px) = map.resampled_from_original(px) else { continue };
            let Some(color) = color_at(image, px) else { continue };
            let Some(projected) = camera.project(*position) else { continue };
            self.tracks[point].push((id, observations.len() as u32));
            for (sum, value) in self.colors[point].iter_mut().zip(color) {
                *sum += f64::from(value);
            }
            self.distances[point] += projected.distance(px);
            let Pixel { col: x, row: y, .. } = Pixel::<CornerPx>::from(px);
            // Points are numbered from 1.
            observations.push(ColmapObservation { x, y, point: Some(point as u64 + 1) });
        }
        self.model.push_view(id, name, camera, observations);
    }

    /// The model with the points that two or more of its views see.
    #[must_use]
    pub fn finish(mut self) -> ColmapModel {
        let is_kept: Vec<bool> = self.tracks.iter().map(|track| track.len() >= FEWEST).collect();
        for observation in self.model.images.iter_mut().flat_map(|image| &mut image.observations) {
            observation.point = observation.point.filter(|id| is_kept[*id as usize - 1]);
        }
        for (i, track) in self.tracks.into_iter().enumerate().filter(|(i, _)| is_kept[*i]) {
            let n = track.len() as f64;
            self.model.points.push(ColmapPoint {
                id: i as u64 + 1,
                position: self.positions[i].xyz(),
                rgb: self.colors[i].map(|sum| (sum / n).round() as u8),
                error: self.distances[i] / n,
                track,
            });
        }
        self.model
    }
}

impl ColmapModel {
    /// A model of photographs, each an image file and its camera, with points that are not linked to pixels.
    #[must_use]
    pub fn of_photographs<'a>(
        views: impl Iterator<Item = (&'a str, PinholeCamera)>,
        points: &[ScenePoint],
    ) -> Self {
        let mut model = Self { cameras: vec![], images: vec![], points: vec![] };
        for (id, (name, camera)) in (1..).zip(views) {
            model.push_view(id, name.into(), &camera, vec![]);
        }
        let point = |(id, p): (u64, &ScenePoint)| {
            let (position, rgb) = (p.position.xyz(), p.rgb);
            ColmapPoint { id, position, rgb, error: 0.0, track: vec![] }
        };
        model.points = (1..).zip(points).map(point).collect();
        model
    }

    /// Adds an image with a camera of its own.
    fn push_view(
        &mut self,
        id: u32,
        name: String,
        camera: &PinholeCamera,
        observations: Vec<ColmapObservation>,
    ) {
        let [x, y, z, w] = DQuat::from_mat3(&camera.cam_from_site).normalize().to_array();
        let principal =
            Pixel::<CornerPx>::from(Pixel::<CenterPx>::new(camera.principal.x, camera.principal.y));
        self.cameras.push(ColmapCamera {
            id,
            model: LensModel::Pinhole,
            width: camera.size.0 as u64,
            height: camera.size.1 as u64,
            parameters: vec![camera.focal.x, camera.focal.y, principal.col, principal.row],
        });
        self.images.push(ColmapImage {
            id,
            rotation: [w, x, y, z],
            translation: (-(camera.cam_from_site * camera.center)).to_array(),
            camera: id,
            name,
            observations,
        });
    }
}

/// The colour of the pixel nearest to a position; none outside of the image and where it has no data.
fn color_at(image: &Resampled, px: Pixel<CenterPx>) -> Option<[u8; 3]> {
    let (col, row) = (px.col.round(), px.row.round());
    let colors = &image.colors;
    if !(col >= 0.0 && row >= 0.0 && col < colors.width as f64 && row < colors.height as f64) {
        return None;
    }
    let (col, row) = (col as usize, row as usize);
    let has_data = image.mask.as_ref().is_none_or(|mask| mask[row * colors.width + col] > 0);
    has_data.then(|| colors.at(col, row))
}

#[cfg(test)]
mod tests {
    use super::super::Fitted;
    use super::*;
    use crate::affine::ViewCamera;
    use crate::io::RgbImage;

    #[test]
    fn points_are_where_the_cameras_of_the_model_see_them() {
        let positions =
            vec![Point::new(3.0, -8.0, 4.0), Point::new(-20.0, 15.0, -2.0), Point::new(500.0, 0.0, 0.0)];
        let mut builder = ColmapBuilder::new(positions.clone());
        for lean in [0.4, -0.3] {
            let view = ViewCamera::affine([[2.0, 0.1, lean], [0.0, -2.0, 0.2]], [100.0, 100.0]);
            let area = (-40.0, -40.0, 40.0, 40.0);
            let Fitted::Pinhole(pinhole) = LocalPinhole::fit(&view, (200, 200), area, (-5.0, 10.0)) else {
                panic!("it looks down");
            };
            let (width, height) = pinhole.camera.size;
            let colors = RgbImage { width, height, data: vec![80; 3 * width * height] };
            let image = Resampled { colors, mask: None };
            let seen = positions.iter().map(|p| view.project(*p)).enumerate();
            builder.add_view(format!("{lean}.png"), &pinhole, &image, seen);
        }
        let model = builder.finish();
        // The third point is outside of the images.
        assert_eq!(model.points.iter().map(|p| p.id).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(model.points[0].rgb, [80; 3]);
        assert_eq!(model.points[1].track, [(1, 1), (2, 1)]);
        let found = model.reprojection().unwrap();
        assert_eq!(found.observations, 4);
        let stated = found.stated_px.unwrap();
        assert!(found.mean_px < 0.1 && (found.mean_px - stated).abs() < 1e-9, "{found:?}");
    }
}
