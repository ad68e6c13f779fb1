//! LiDAR points in the image, and their occlusion by nearer points.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use geometry::camera::{Camera, RUN};
use nalgebra::{Isometry3, Point2, Vector3};
use rayon::prelude::*;

use crate::point_cloud::to_f64;
use crate::view_cone::{Ball, Cone};

#[derive(Clone, Copy, Debug)]
pub struct Projected {
    pub index: usize,
    pub pixel: Point2<f64>,
    /// Position in metres, camera frame.
    pub p_camera: Vector3<f64>,
}

impl Projected {
    /// Squared distance from the camera centre.
    fn range2(&self) -> f64 {
        self.p_camera.norm_squared()
    }
}

/// The points of a sweep (metres, LiDAR frame), with their visibility from the last pose, which the checks of a
/// calibration query repeatedly.
#[derive(Debug, Default)]
pub struct Sweep {
    points: Vec<[f32; 3]>,
    /// Balls around each [`GROUP`] of points, where they are needed.
    balls: OnceLock<Vec<Ball>>,
    last: Mutex<Option<CachedView>>,
}

/// The points in the image of a camera at a pose.
#[derive(Clone, Debug)]
struct CachedView {
    camera: Camera,
    pose: Isometry3<f64>,
    origin: Vector3<f64>,
    indices: Arc<Vec<u32>>,
    hidden: Arc<Vec<bool>>,
}

impl From<Vec<[f32; 3]>> for Sweep {
    fn from(points: Vec<[f32; 3]>) -> Self {
        Self { points, ..Self::default() }
    }
}

impl Deref for Sweep {
    type Target = [[f32; 3]];

    fn deref(&self) -> &Self::Target {
        &self.points
    }
}

impl Sweep {
    /// The points inside the image of a camera at a pose, in their order, and whether each is occluded: see
    /// [`hidden`].
    pub fn in_image(
        &self,
        camera: &Camera,
        pose: &Isometry3<f64>,
        origin: &Vector3<f64>,
    ) -> (Vec<Projected>, Arc<Vec<bool>>) {
        let last = self.last().clone();
        let is_same =
            |seen: &CachedView| seen.pose == *pose && seen.camera == *camera && seen.origin == *origin;
        if let Some(seen) = last.filter(is_same) {
            let points = seen.indices.iter().map(|&index| (index as usize, &self.points[index as usize]));
            return (project_points(camera, points, pose), seen.hidden);
        }
        let cone = Cone::of(camera, pose);
        let of_part = |part| project_in_cone(camera, self.in_cone(&cone, part), &cone);
        let parts = 0..self.points.len().div_ceil(GROUP * GROUPS_A_TASK);
        let parts: Vec<_> = parts.into_par_iter().map(of_part).collect();
        // One part is not copied.
        let projected = <[_; 1]>::try_from(parts).map_or_else(|parts| parts.concat(), |[all]| all);
        let hidden = Arc::new(hidden(camera, self, origin, &projected));
        let indices = Arc::new(projected.iter().map(|point| point.index as u32).collect());
        let hidden_then = Arc::clone(&hidden);
        let seen =
            CachedView { camera: camera.clone(), pose: *pose, origin: *origin, indices, hidden: hidden_then };
        *self.last() = Some(seen);
        (projected, hidden)
    }

    /// Points (metres, LiDAR frame) of a part of the sweep, with their indices, without groups of neighbours that lie
    /// outside a cone.
    fn in_cone(&self, cone: &Cone, part: usize) -> impl Iterator<Item = (usize, &[f32; 3])> {
        let balls = self.balls.get_or_init(|| self.points.chunks(GROUP).map(Ball::around).collect());
        let groups = (part * GROUPS_A_TASK..balls.len()).take(GROUPS_A_TASK);
        groups.filter(|&group| !cone.excludes(&balls[group])).flat_map(|group| {
            let start = group * GROUP;
            (start..).zip(&self.points[start..self.points.len().min(start + GROUP)])
        })
    }

    fn last(&self) -> MutexGuard<'_, Option<CachedView>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Number of neighbours in the order of a sweep that are left out together: 3 degrees of a ring of an HDL-64E, mostly of
/// one surface.
const GROUP: usize = 16;

/// Number of groups of one task. A sweep of an HDL-64E has two; those of several frames are tasks anyway.
const GROUPS_A_TASK: usize = 4096;

/// Only points nearer than this fraction of the range occlude: parallax between closer surfaces is small, and rough
/// or slanted surfaces and range noise would occlude themselves.
const MAX_OCCLUDER_RANGE: f64 = 0.8;

/// Distance behind the camera, metres, beyond which single precision is certain, of coordinates up to a million metres.
const BEHIND_M: f32 = 0.5;

/// Chords of the unit sphere that differ by less are equal.
const ROUND_OFF: f64 = 1e-9;

/// Projects points (metres, LiDAR frame), given with their indices, and keeps those inside the image, in their order.
///
/// Most points of a sweep are far outside the image, where no lens is needed to tell.
pub fn project_points<'a>(
    camera: &Camera,
    points: impl IntoIterator<Item = (usize, &'a [f32; 3])>,
    t_camera_lidar: &Isometry3<f64>,
) -> Vec<Projected> {
    project_in_cone(camera, points, &Cone::of(camera, t_camera_lidar))
}

fn project_in_cone<'a>(
    camera: &Camera,
    points: impl IntoIterator<Item = (usize, &'a [f32; 3])>,
    cone: &Cone,
) -> Vec<Projected> {
    let axis: [f32; 3] = std::array::from_fn(|column| cone.rotation[(2, column)] as f32);
    // Metres; a point this far behind the camera is there in single precision, too.
    let behind = -cone.translation.z as f32 - BEHIND_M;
    let is_behind = |[x, y, z]: [f32; 3]| axis[0] * x + axis[1] * y + axis[2] * z < behind;
    let left = points.into_iter().filter(|(_, point)| cone.cosine < 0.0 || !is_behind(**point));
    let in_camera = left.map(|(index, point)| (index, cone.to_camera(&to_f64(point))));
    project(camera, in_camera.filter(|(_, p_camera)| cone.contains(p_camera)))
}

/// Projects points (metres, camera frame), given with their indices, and keeps those inside the image, in their order.
fn project(camera: &Camera, points: impl Iterator<Item = (usize, Vector3<f64>)>) -> Vec<Projected> {
    let (mut run, mut projected) = (Vec::with_capacity(RUN), Vec::new());
    let mut take = |run: &mut Vec<Option<Projected>>| {
        projected.extend(run.iter().flatten().filter(|point| camera.contains(&point.pixel)));
        run.clear();
    };
    points.for_each(|(index, p_camera)| {
        run.push(camera.project(&p_camera).map(|pixel| Projected { index, pixel, p_camera }));
        if run.len() == RUN {
            take(&mut run);
        }
    });
    take(&mut run);
    projected
}

/// Smallest number of projected points of one task, about half of those of a sweep of an HDL-64E in a narrow view.
const MIN_PROJECTED: usize = 8192;

/// Flags the projected points that are occluded from the camera.
///
/// A return occludes a farther one if both project to about the same place of the image while the LiDAR, from its
/// position next to the camera, sees past the nearer one. So a point is occluded when some nearer return projects
/// within about one spacing of the projected points, and the LiDAR separates the two by more than the camera does:
/// without a baseline nothing is occluded. This also drops some visible points next to edges; what
/// matters is that occluded ones do not pull at the edge.
///
/// `points` are all points from which `projected` was taken, and `origin` is where their rays start, metres, LiDAR
/// frame.
pub fn hidden(
    camera: &Camera,
    points: &[[f32; 3]],
    origin: &Vector3<f64>,
    projected: &[Projected],
) -> Vec<bool> {
    let area = (camera.width * camera.height) as f64;
    let spacing = (area / projected.len().max(1) as f64).sqrt().max(1.0);
    let buffer = NearestReturns::new(camera, projected, spacing);
    // Unit directions from the LiDAR and from the camera, each in its own frame.
    let directions =
        |point: &Projected| ((to_f64(&points[point.index]) - origin).normalize(), point.p_camera.normalize());
    let is_hidden = |(far, block): (&Projected, &u32)| {
        let range2 = MAX_OCCLUDER_RANGE * MAX_OCCLUDER_RANGE * far.range2();
        if buffer.min_around[*block as usize] >= range2 {
            return false;
        }
        let (far_lidar, far_camera) = directions(far);
        buffer.nearer_around(&far.pixel, range2).any(|near| {
            // Chords instead of angles: they are equal for small angles, and exact.
            let (near_lidar, near_camera) = directions(near);
            (near_lidar - far_lidar).norm() > (near_camera - far_camera).norm() + ROUND_OFF
        })
    };
    projected.par_iter().zip(&buffer.block_of).with_min_len(MIN_PROJECTED).map(is_hidden).collect()
}

/// A coarse z-buffer: the nearest of the points that project into each square block.
struct NearestReturns<'a> {
    block: f64,
    columns: usize,
    rows: usize,
    /// The block of each point.
    block_of: Vec<u32>,
    /// Squared ranges of the nearest points, infinite in blocks without one, and these points: most are compared only by
    /// range.
    ranges2: Vec<f64>,
    points: Vec<Option<&'a Projected>>,
    /// Smallest squared range in the 3 x 3 blocks around each: most points are no farther, and need no further
    /// test.
    min_around: Vec<f64>,
}

impl<'a> NearestReturns<'a> {
    fn new(camera: &Camera, projected: &'a [Projected], block: f64) -> Self {
        let blocks = |size: usize| (size as f64 / block).ceil() as usize;
        let (columns, rows) = (blocks(camera.width), blocks(camera.height));
        let (ranges2, points) = (vec![f64::INFINITY; columns * rows], vec![None; columns * rows]);
        let block_of = Vec::with_capacity(projected.len());
        let mut buffer = Self { block, columns, rows, block_of, ranges2, points, min_around: Vec::new() };
        for point in projected {
            let (column, row) = buffer.at(&point.pixel);
            let index = row * columns + column;
            buffer.block_of.push(index as u32);
            let range2 = point.range2();
            if range2 < buffer.ranges2[index] {
                (buffer.ranges2[index], buffer.points[index]) = (range2, Some(point));
            }
        }
        buffer.min_around = buffer.min_around();
        buffer
    }

    fn min_around(&self) -> Vec<f64> {
        let lower = |values: &mut [f64], limits: &[f64]| {
            values.iter_mut().zip(limits).for_each(|(value, limit)| *value = value.min(*limit));
        };
        let mut least = self.ranges2.clone();
        let lines = self.ranges2.chunks_exact(self.columns);
        for (least, line) in least.chunks_exact_mut(self.columns).zip(lines) {
            lower(&mut least[1..], line);
            lower(least, &line[1..]);
        }
        let of_lines = least.clone();
        lower(&mut least[self.columns..], &of_lines);
        lower(&mut least, &of_lines[self.columns..]);
        least
    }

    fn at(&self, pixel: &Point2<f64>) -> (usize, usize) {
        // Conversions of 32 bits are faster than those of 64, and no image is that wide.
        let index = |x: f64, count: usize| (((x + 0.5) / self.block) as u32 as usize).min(count - 1);
        (index(pixel.x, self.columns), index(pixel.y, self.rows))
    }

    /// The nearest returns of the 3 x 3 blocks around a pixel that are nearer than the given squared range.
    fn nearer_around(&self, pixel: &Point2<f64>, range2: f64) -> impl Iterator<Item = &'a Projected> {
        let (column, row) = self.at(pixel);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.columns + column))
            .filter(move |&block| self.ranges2[block] < range2)
            .filter_map(|block| self.points[block])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at 10 m and a post at 3 m in front of the camera, as a LiDAR `baseline` metres to its left sees both;
    /// the camera looks along the z axis of the LiDAR frame.
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
        let projected = project_points(&camera, points.iter().enumerate(), &t_camera_lidar);
        let mut num_hidden = 0;
        for (point, hidden) in projected.iter().zip(hidden(&camera, &points, &Vector3::zeros(), &projected)) {
            let (pixel, range) = (point.pixel, point.p_camera.norm());
            let behind_the_post = range > 5.0 && (pixel.x - 319.5).abs() < 17.0;
            assert!(behind_the_post || !hidden, "{pixel} at {range} m");
            num_hidden += usize::from(hidden);
        }
        assert!(num_hidden >= 50, "a column of the wall has 60 points, found {num_hidden} hidden");
    }

    #[test]
    fn groups_are_left_out_only_where_none_of_their_points_is_in_the_image() {
        let (camera, ..) = scene(0.5);
        let k = [[200.0, 0.0, 319.5], [0.0, 200.0, 239.5], [0.0, 0.0, 1.0]];
        let fisheye = Camera::new("fisheye", (640, 480), k, &[0.0; 4]).expect("a valid camera");
        // Rings around the LiDAR, far and near, one after the other, in more than one task; some coordinates are no
        // numbers, or infinite.
        let ring = |tilt: i32| {
            (0..3001).map(move |i| {
                let (azimuth, range) = (f64::from(i) * 0.0021, f64::from(1 + (i / 240 + tilt).rem_euclid(9)));
                let [x, y, z] =
                    [azimuth.sin() * range, f64::from(tilt) * 0.04 * range, azimuth.cos() * range];
                match i % 997 {
                    1 => [x as f32, f32::NAN, z as f32],
                    2 => [f32::NAN; 3],
                    3 => [f32::INFINITY, y as f32, z as f32],
                    _ => [x as f32, y as f32, z as f32],
                }
            })
        };
        let points: Vec<[f32; 3]> = (-12..12).flat_map(ring).collect();
        assert!(points.len() > GROUP * GROUPS_A_TASK && !points.len().is_multiple_of(GROUP));
        let indices = |points: &[Projected]| points.iter().map(|point| point.index).collect::<Vec<_>>();
        for (camera, turned) in
            [0.0, 0.7, 2.0, 3.1].into_iter().flat_map(|by| [(&camera, by), (&fisheye, by)])
        {
            let pose = Isometry3::new(Vector3::new(0.3, -0.1, 0.2), Vector3::new(0.1, turned, 0.05));
            let sweep = Sweep::from(points.clone());
            let (found, _) = sweep.in_image(camera, &pose, &Vector3::zeros());
            let all = project_points(camera, points.iter().enumerate(), &pose);
            assert_eq!(indices(&found), indices(&all));
            let cone = Cone::of(camera, &pose);
            let left: usize = (0..2).map(|part| sweep.in_cone(&cone, part).count()).sum();
            let is_left_out = left < points.len() / 2;
            assert!(!all.is_empty() && is_left_out == (cone.cosine > 0.0), "{left} of {}", points.len());
        }
    }

    #[test]
    fn what_was_seen_last_is_not_taken_for_another_pose_or_camera() {
        let (camera, points, pose) = scene(0.5);
        let k = [[300.0, 0.0, 319.5], [0.0, 300.0, 239.5], [0.0, 0.0, 1.0]];
        let wider = Camera::new("plumb_bob", (640, 480), k, &[]).expect("a valid camera");
        let nearer = Isometry3::translation(-0.2, 0.0, 0.0);
        let kept = Sweep::from(points.clone());
        for (camera, pose) in [(&camera, pose), (&camera, pose), (&wider, pose), (&wider, nearer)] {
            let (found, found_hidden) = kept.in_image(camera, &pose, &Vector3::zeros());
            let (anew, anew_hidden) = Sweep::from(points.clone()).in_image(camera, &pose, &Vector3::zeros());
            let pixels = |points: &[Projected]| points.iter().map(|p| (p.index, p.pixel)).collect::<Vec<_>>();
            assert_eq!((pixels(&found), found_hidden), (pixels(&anew), anew_hidden));
        }
    }
}
