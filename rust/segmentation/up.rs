//! The direction away from the ground, for a LiDAR mounted in any orientation.
//!
//! The ground is the plane that contains most nearby returns and has almost none below it. It is found by RANSAC
//! over the returns of all frames together, since the LiDAR keeps its pose relative to the ground.

use nalgebra::{Matrix3, UnitQuaternion, UnitVector3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::point_cloud::to_f64;
use crate::thinning::{stride, thinned};

/// Number of sweeps used, and of returns used from each before voxels are thinned.
const MAX_SWEEPS: usize = 20;
const MAX_RETURNS: usize = 20_000;
/// Side of a voxel, metres: each keeps one return, so that planes count by their area.
const VOXEL_M: f64 = 0.5;
/// Range of the returns used, metres: nearer ones may be the vehicle.
const RANGE_M: std::ops::Range<f64> = 1.5..30.0;
/// Number of returns of all sweeps that score a plane, and number of planes tried.
const MAX_POOL: usize = 8000;
const NUM_PLANES: u64 = 1500;
/// Thickness of the ground plane, metres, and distance below it at which a return contradicts it.
const ON_PLANE_M: f64 = 0.2;
const BELOW_M: f64 = 0.5;
/// Possible heights of the sensor above the ground, metres.
const HEIGHT_M: std::ops::Range<f64> = 0.1..15.0;
/// Smallest share of the returns on the plane of the ground, and largest share below it.
const MIN_SHARE_ON_PLANE: f64 = 0.1;
const MAX_SHARE_BELOW: f64 = 0.1;
/// Penalty of a return below a plane, in returns on it.
const COST_BELOW: f64 = 3.0;
const NUM_REFINEMENTS: usize = 5;

/// The direction away from the ground, and the height above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Up {
    /// Direction away from the ground, LiDAR frame.
    pub direction: UnitVector3<f64>,
    /// Height of the sensor above the ground, metres.
    pub height_m: f64,
}

/// The direction away from the ground of a drive's sweeps; `None` if no plane has nearly all returns on one side.
pub fn estimate_up(sweeps: &[&[[f32; 3]]]) -> Option<Up> {
    let step = stride(sweeps.len(), MAX_SWEEPS);
    let chosen: Vec<&[[f32; 3]]> = sweeps.iter().copied().step_by(step).collect();
    let of_sweeps: Vec<Vec<Vector3<f64>>> = chosen.par_iter().map(|sweep| spread_evenly(sweep)).collect();
    let of_sweeps: Vec<_> = of_sweeps.into_iter().filter(|points| points.len() >= 3).collect();
    let pool = of_sweeps.concat();
    let pool: Vec<_> = thinned(pool.len(), stride(pool.len(), MAX_POOL)).map(|i| pool[i]).collect();
    if of_sweeps.is_empty() {
        return None;
    }
    let tried = (0..NUM_PLANES).into_par_iter().filter_map(|number| {
        let plane = random_plane(&of_sweeps[number as usize % of_sweeps.len()], number)?;
        Some((plane.score(&pool), number, plane))
    });
    // The first in a tie, whatever the number of threads.
    let best = tried.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
    let refined = (0..NUM_REFINEMENTS).fold(best.2, |plane, _| plane.refined(&pool).unwrap_or(plane));
    refined.assessed(&pool)
}

/// Some of a sweep's returns, one in each voxel.
fn spread_evenly(points: &[[f32; 3]]) -> Vec<Vector3<f64>> {
    let near: Vec<Vector3<f64>> =
        points.iter().map(to_f64).filter(|point| RANGE_M.contains(&point.norm())).collect();
    let some = thinned(near.len(), stride(near.len(), MAX_RETURNS)).map(|i| near[i]);
    let mut by_voxel: Vec<([i32; 3], Vector3<f64>)> =
        some.map(|p| ((p / VOXEL_M).map(|x| x.floor() as i32).into(), p)).collect();
    by_voxel.sort_by_key(|&(voxel, _)| voxel);
    by_voxel.dedup_by_key(|&mut (voxel, _)| voxel);
    by_voxel.into_iter().map(|(_, point)| point).collect()
}

/// Points `p` with `up . p = -height`.
#[derive(Clone, Copy, Debug)]
struct GroundPlane {
    up: UnitVector3<f64>,
    height: f64,
}

/// The plane through three of the points; `None` if no sensor could be above it.
fn random_plane(points: &[Vector3<f64>], seed: u64) -> Option<GroundPlane> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let [a, b, c] = std::array::from_fn(|_| points[random.random_range(0..points.len())]);
    GroundPlane::new((b - a).cross(&(c - a)), &a)
}

impl GroundPlane {
    /// The plane through a point with a given normal. The sensor is above it.
    fn new(normal: Vector3<f64>, point: &Vector3<f64>) -> Option<Self> {
        let normal = UnitVector3::try_new(normal, 1e-6)?;
        let up = if normal.dot(point) > 0.0 { -normal } else { normal };
        let height = -up.dot(point);
        HEIGHT_M.contains(&height).then_some(Self { up, height })
    }

    fn above(&self, point: &Vector3<f64>) -> f64 {
        self.up.dot(point) + self.height
    }

    /// Numbers of points on the plane and below it.
    fn count(&self, points: &[Vector3<f64>]) -> (usize, usize) {
        points.iter().map(|point| self.above(point)).fold((0, 0), |(on, below), above| {
            (on + usize::from(above.abs() <= ON_PLANE_M), below + usize::from(above < -BELOW_M))
        })
    }

    fn score(&self, points: &[Vector3<f64>]) -> f64 {
        let (on, below) = self.count(points);
        on as f64 - COST_BELOW * below as f64
    }

    /// The least-squares plane through the points on it.
    fn refined(&self, points: &[Vector3<f64>]) -> Option<Self> {
        let on: Vec<&Vector3<f64>> = points.iter().filter(|p| self.above(p).abs() <= ON_PLANE_M).collect();
        let mean = on.iter().copied().sum::<Vector3<f64>>() / on.len() as f64;
        let offsets = on.into_iter().map(|point| point - mean);
        let eigen =
            offsets.map(|x| x * x.transpose()).sum::<Matrix3<f64>>().try_symmetric_eigen(1e-12, 100)?;
        Self::new(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into(), &mean)
    }

    fn assessed(&self, points: &[Vector3<f64>]) -> Option<Up> {
        let (on, below) = self.count(points);
        let share = |count: usize| count as f64 / points.len() as f64;
        let is_distinct = share(on) >= MIN_SHARE_ON_PLANE && share(below) <= MAX_SHARE_BELOW;
        is_distinct.then_some(Up { direction: self.up, height_m: self.height })
    }
}

/// The points, rotated so that `up` is z.
pub(super) fn upright(points: &[Vector3<f64>], up: &UnitVector3<f64>) -> Vec<Vector3<f64>> {
    let to_z = UnitQuaternion::rotation_between(up, &Vector3::z());
    let turn =
        to_z.unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let turn = turn.to_rotation_matrix();
    points.iter().map(|point| turn * point).collect()
}
