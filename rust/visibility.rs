//! LiDAR points in the image, and those of them that nearer points hide from the camera.

use nalgebra::{Isometry3, Point2, Vector3};

use crate::camera::Camera;
use crate::spherical::to_f64;

/// A point inside the image.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Index of the point.
    pub index: usize,
    /// `(u, v)`.
    pub pixel: Point2<f64>,
    /// Distance from the camera's centre, metres.
    pub range: f64,
    /// Unit direction from the LiDAR, LiDAR frame.
    pub direction_lidar: Vector3<f64>,
    /// Unit direction from the camera, camera frame.
    pub direction_camera: Vector3<f64>,
}

/// Only what is nearer than this share of the range hides: parallax between things closer to one another is small, and
/// range noise, slanted and rough surfaces would hide themselves.
const NEARER: f64 = 0.8;

/// Chords of the unit sphere that differ by less are equal.
const ROUND_OFF: f64 = 1e-9;

/// Projects points (metres, LiDAR frame), and keeps those inside the image, in their order.
pub fn project_points(
    camera: &Camera,
    points: &[[f32; 3]],
    t_camera_lidar: &Isometry3<f64>,
) -> Vec<Projected> {
    let rotation = t_camera_lidar.rotation.to_rotation_matrix();
    let project = |(index, point): (usize, &[f32; 3])| {
        let p_lidar = to_f64(point);
        let p_camera = rotation * p_lidar + t_camera_lidar.translation.vector;
        let pixel = camera.project(&p_camera).filter(|pixel| camera.contains(pixel))?;
        let range = p_camera.norm();
        Some(Projected {
            index,
            pixel,
            range,
            direction_lidar: p_lidar.normalize(),
            direction_camera: p_camera / range,
        })
    };
    points.iter().enumerate().filter_map(project).collect()
}

/// Tells which of the projected points are hidden from the camera.
///
/// A return hides a farther one if both project onto about the same place of the image while the LiDAR, from beside the
/// camera, sees past the nearer one. So a point is hidden when some nearer return projects within about one spacing of the
/// projected points, and the LiDAR separates the two by more than the camera does: without a baseline nothing is hidden.
/// Some visible points beside an edge are lost to this; what counts is that hidden ones do not pull at it.
pub fn hidden(camera: &Camera, projected: &[Projected]) -> Vec<bool> {
    let area = (camera.width * camera.height) as f64;
    let spacing = (area / projected.len().max(1) as f64).sqrt().max(1.0);
    let buffer = NearestReturns::new(camera, projected, spacing);
    let hides = |near: &Projected, far: &Projected| {
        // Chords instead of angles: for what is close together they are the same, and exact.
        let seen_from_lidar = (near.direction_lidar - far.direction_lidar).norm();
        let seen_from_camera = (near.direction_camera - far.direction_camera).norm();
        seen_from_lidar > seen_from_camera + ROUND_OFF
    };
    let is_hidden =
        |l: &Projected| buffer.nearer_around(&l.pixel, NEARER * l.range).any(|near| hides(near, l));
    projected.iter().map(is_hidden).collect()
}

/// Tells of each point (metres, LiDAR frame) whether it is inside the image and hidden from the camera.
pub fn hidden_points(camera: &Camera, points: &[[f32; 3]], t_camera_lidar: &Isometry3<f64>) -> Vec<bool> {
    let projected = project_points(camera, points, t_camera_lidar);
    let mut flags = vec![false; points.len()];
    for (point, hidden) in projected.iter().zip(hidden(camera, &projected)) {
        flags[point.index] = hidden;
    }
    flags
}

/// A coarse z-buffer: the nearest of the points that project into each square block.
struct NearestReturns<'a> {
    block: f64,
    columns: usize,
    rows: usize,
    /// Ranges, infinite in blocks without a point, and the points: most are only compared by their range.
    nearest: Vec<(f64, Option<&'a Projected>)>,
}

impl<'a> NearestReturns<'a> {
    fn new(camera: &Camera, projected: &'a [Projected], block: f64) -> Self {
        let blocks = |size: usize| (size as f64 / block).ceil() as usize;
        let (columns, rows) = (blocks(camera.width), blocks(camera.height));
        let mut buffer = Self { block, columns, rows, nearest: vec![(f64::INFINITY, None); columns * rows] };
        for point in projected {
            let (column, row) = buffer.at(&point.pixel);
            let nearest = &mut buffer.nearest[row * columns + column];
            if point.range < nearest.0 {
                *nearest = (point.range, Some(point));
            }
        }
        buffer
    }

    fn at(&self, pixel: &Point2<f64>) -> (usize, usize) {
        let index = |x: f64, count: usize| (((x + 0.5) / self.block) as usize).min(count - 1);
        (index(pixel.x, self.columns), index(pixel.y, self.rows))
    }

    /// The nearest returns of the 3 x 3 blocks around a pixel that are nearer than a range.
    fn nearer_around(&self, pixel: &Point2<f64>, range: f64) -> impl Iterator<Item = &'a Projected> {
        let (column, row) = self.at(pixel);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(move |row| &self.nearest[row * self.columns..][columns.clone()])
            .filter(move |(nearest, _)| *nearest < range)
            .filter_map(|(_, point)| *point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 10 m and a post 3 m before the camera, as a LiDAR `baseline` metres to its left sees them both; the camera
    /// looks along the z axis of the LiDAR frame.
    fn scene(baseline: f64) -> (Camera, Vec<[f32; 3]>, Isometry3<f64>) {
        let k = [[400.0, 0.0, 319.5], [0.0, 400.0, 239.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (640, 480), k, &[]).expect("a valid camera");
        let grid = (-30..30).flat_map(|v| (-40..40).map(move |u| (u as f32 * 0.2, v as f32 * 0.2)));
        let wall = grid.map(|(x, y)| [x + baseline as f32, y, 10.0]);
        let post = (-30..30).map(|v| [baseline as f32, v as f32 * 0.06, 3.0]);
        let t_camera_lidar = Isometry3::translation(-baseline, 0.0, 0.0);
        (camera, wall.chain(post).collect(), t_camera_lidar)
    }

    #[test]
    fn the_wall_behind_the_post_is_hidden_and_nothing_else() {
        let (camera, points, t_camera_lidar) = scene(0.5);
        let projected = project_points(&camera, &points, &t_camera_lidar);
        let mut num_hidden = 0;
        for (point, hidden) in projected.iter().zip(hidden(&camera, &projected)) {
            let Projected { pixel, range, .. } = point;
            let behind_the_post = *range > 5.0 && (pixel.x - 319.5).abs() < 17.0;
            assert!(behind_the_post || !hidden, "{pixel} at {range} m");
            num_hidden += usize::from(hidden);
        }
        assert!(num_hidden >= 50, "a column of the wall has 60 points, found {num_hidden} hidden");
    }

    #[test]
    fn without_a_baseline_nothing_is_hidden() {
        let (camera, points, t_camera_lidar) = scene(0.0);
        assert!(!hidden(&camera, &project_points(&camera, &points, &t_camera_lidar)).contains(&true));
    }
}
