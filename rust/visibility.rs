//! Where LiDAR points land in the picture, and which of them the camera cannot see because nearer ones stand in the way.

use nalgebra::{Isometry3, Point2};

use crate::camera::Camera;
use crate::spherical::to_f64;

/// A point inside the picture.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    /// `(u, v)`.
    pub pixel: Point2<f64>,
    /// Distance from the camera's centre, metres.
    pub range: f64,
}

/// Projects points (metres, LiDAR frame); `None` for those outside the picture.
pub fn land(
    camera: &Camera,
    points: &[[f32; 3]],
    t_camera_lidar: &Isometry3<f64>,
) -> Vec<Option<Landing>> {
    let land = |point: &[f32; 3]| {
        let p_camera = t_camera_lidar.rotation * to_f64(point) + t_camera_lidar.translation.vector;
        let pixel = camera.project(&p_camera)?;
        let range = p_camera.norm();
        camera.contains(&pixel).then_some(Landing { pixel, range })
    };
    points.iter().map(land).collect()
}

/// Tells which points are hidden from the camera.
///
/// Two returns that the LiDAR separates by an angle can fall on one place of the picture only if the parallax between
/// them, `baseline * (1/z_near - 1/z_far)`, makes up for that angle. So a point is hidden when some return within
/// about one spacing of the projected points is nearer by more than that; with no baseline, nothing is hidden.
///
/// `baseline` is the distance between the sensors' centres in metres.
pub fn hidden(camera: &Camera, landings: &[Option<Landing>], baseline: f64) -> Vec<bool> {
    let num_inside = landings.iter().flatten().count().max(1);
    let area = (camera.width * camera.height) as f64;
    let spacing = (area / num_inside as f64).sqrt().max(1.0);
    let spacing_angle = spacing / camera.mean_focal();
    let nearest = InverseRanges::new(camera, landings, spacing);
    let is_hidden =
        |l: &Landing| baseline * (nearest.around(&l.pixel) - 1.0 / l.range) > spacing_angle;
    landings
        .iter()
        .map(|l| l.as_ref().is_some_and(is_hidden))
        .collect()
}

/// A coarse z-buffer: the largest inverse range of the points that land in each square block.
struct InverseRanges {
    block: f64,
    columns: usize,
    rows: usize,
    largest: Vec<f64>,
}

impl InverseRanges {
    fn new(camera: &Camera, landings: &[Option<Landing>], block: f64) -> Self {
        let blocks = |size: usize| (size as f64 / block).ceil() as usize;
        let (columns, rows) = (blocks(camera.width), blocks(camera.height));
        let mut buffer = Self {
            block,
            columns,
            rows,
            largest: vec![0.0; columns * rows],
        };
        for landing in landings.iter().flatten() {
            let (column, row) = buffer.at(&landing.pixel);
            let largest = &mut buffer.largest[row * columns + column];
            *largest = largest.max(1.0 / landing.range);
        }
        buffer
    }

    fn at(&self, pixel: &Point2<f64>) -> (usize, usize) {
        let index = |x: f64, count: usize| (((x + 0.5) / self.block) as usize).min(count - 1);
        (index(pixel.x, self.columns), index(pixel.y, self.rows))
    }

    /// The largest value in the 3 x 3 blocks around a pixel.
    fn around(&self, pixel: &Point2<f64>) -> f64 {
        let (column, row) = self.at(pixel);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(|row| &self.largest[row * self.columns..][columns.clone()])
            .fold(0.0, |a, &b| b.max(a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at 10 m, a post at 3 m before pixel column 322, seen with a spacing of 8 pixels.
    fn scene() -> (Camera, Vec<Option<Landing>>) {
        let k = [[400.0, 0.0, 319.5], [0.0, 400.0, 239.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (640, 480), k, &[]).expect("a valid camera");
        let landing = |u: i32, v: i32, range| {
            Some(Landing {
                pixel: Point2::new(f64::from(u), f64::from(v)),
                range,
            })
        };
        let grid = (0..60).flat_map(|v| (0..80).map(move |u| (u * 8, v * 8)));
        let wall = grid.map(|(u, v)| landing(u, v, 10.0));
        let post = (0..60).map(|v| landing(322, v * 8, 3.0));
        (camera, wall.chain(post).chain([None]).collect())
    }

    #[test]
    fn the_wall_behind_the_post_is_hidden_and_nothing_else() {
        let (camera, landings) = scene();
        for (landing, hidden) in landings.iter().zip(hidden(&camera, &landings, 0.5)) {
            let Some(Landing { pixel, range }) = landing else {
                assert!(!hidden);
                continue;
            };
            let aside = (pixel.x - 322.0).abs();
            // Between one block and two, what counts as beside the post depends on where blocks begin.
            if *range == 3.0 || aside > 20.0 {
                assert!(!hidden, "{pixel}");
            } else if aside < 8.0 {
                assert!(hidden, "{pixel}");
            }
        }
    }

    #[test]
    fn without_a_baseline_nothing_is_hidden() {
        let (camera, landings) = scene();
        assert!(!hidden(&camera, &landings, 0.0).contains(&true));
    }
}
