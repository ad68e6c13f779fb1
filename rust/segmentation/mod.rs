//! Segments of a sweep from geometry alone: cells of the ground, and objects on it.
//!
//! The ground is grown outward from the sensor over a polar grid, as in Patchwork (Lim, Oh and Myung, RA-L 2021),
//! but with planes through the low points of neighbouring cells instead of one plane per cell, since a cell of a
//! sparse sweep holds part of one ring. The remaining points form components of neighbouring returns, as in
//! Bogoslavskyi and Stachniss, *Fast Range Image-Based Segmentation of Sparse 3D Laser Scans for Online Operation*
//! (IROS 2016), but in cells that keep all returns, so that any scan pattern works. Large segments are split into
//! pieces.

mod components;
mod cut;
mod ground;
#[cfg(test)]
mod tests;
mod turned;
mod up;

use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use rayon::prelude::*;

pub use turned::turned;
pub use up::estimate_up;

use crate::point_cloud::to_f64;

/// The segment id of a point in no segment.
pub const NO_SEGMENT: u32 = u32::MAX;
/// Points nearer to the sensor than this are not returns, metres.
const MIN_RANGE_M: f64 = 0.05;
/// Points beyond this are not returns, metres: no LiDAR reaches that far.
const MAX_RANGE_M: f64 = 1000.0;
/// Number of returns of a sweep from which on a segment needs `min_points`; in a sparser sweep it needs
/// proportionally fewer.
const DENSE_SWEEP: f64 = 50_000.0;
/// Smallest number of points of a segment in any sweep.
const FEWEST_POINTS: usize = 6;

/// Settings: the fields of `SegmentationConfig` in Python, which documents them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentationConfig {
    pub ground_tolerance_m: f64,
    pub ground_cell_m: f64,
    pub object_gap_m: f64,
    pub object_gap_rays: f64,
    pub object_cell_m: f64,
    pub min_points: usize,
}

impl SegmentationConfig {
    /// The largest gap within an object, metres, if neighbouring rays are `rays` radians apart.
    pub(super) fn gap(&self, range: f64, rays: f64) -> f64 {
        self.object_gap_m + self.object_gap_rays * range * rays
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// The surface on which everything stands.
    Ground = 0,
    /// Anything else.
    Object = 1,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SegmentedSweep {
    /// Segment of each point, or [`NO_SEGMENT`]. Segments of the ground come first.
    pub ids: Vec<u32>,
    pub kinds: Vec<Kind>,
    /// Direction away from the ground, LiDAR frame; `None` if no ground was found, and everything is an object.
    pub up: Option<UnitVector3<f64>>,
}

/// Segments each of a drive's sweeps. Without `up`, the direction is estimated from all of them together.
pub fn segment_sweeps(
    sweeps: &[&[[f32; 3]]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> Vec<SegmentedSweep> {
    let up = up.or_else(|| estimate_up(sweeps).map(|up| up.direction));
    sweeps.par_iter().map(|sweep| segment_with(sweep, up, config)).collect()
}

/// Segments one sweep. Without `up`, the direction is estimated from it.
pub fn segment_sweep(
    points: &[[f32; 3]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> SegmentedSweep {
    segment_with(points, up.or_else(|| estimate_up(&[points]).map(|up| up.direction)), config)
}

fn segment_with(
    points: &[[f32; 3]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> SegmentedSweep {
    let returns = Returns::of(points);
    let min_points = least_points(returns.points.len(), config.min_points);
    let is_ground = match up {
        Some(up) => ground::find(&upright(&returns.points, &up), config.ground_tolerance_m),
        None => vec![false; returns.points.len()],
    };
    let mut segments = Segments { ids: vec![NO_SEGMENT; points.len()], kinds: Vec::new() };
    let (ground, rest): (Vec<usize>, Vec<usize>) = (0..returns.points.len()).partition(|&i| is_ground[i]);
    let cut = |members, size| cut::into_pieces(&returns.points, members, size, min_points);
    segments.extend(Kind::Ground, cut(ground, config.ground_cell_m), &returns.index);
    for component in components::find(&returns.points, &rest, config) {
        segments.extend(Kind::Object, cut(component, config.object_cell_m), &returns.index);
    }
    SegmentedSweep { ids: segments.ids, kinds: segments.kinds, up }
}

/// Whether a point, metres, LiDAR frame, is a return of a LiDAR beam.
pub fn is_return(point: &Vector3<f64>) -> bool {
    // NaN is in no interval.
    (MIN_RANGE_M..MAX_RANGE_M).contains(&point.norm())
}

struct Returns {
    points: Vec<Vector3<f64>>,
    index: Vec<usize>,
}

impl Returns {
    fn of(points: &[[f32; 3]]) -> Self {
        let all = points.iter().map(to_f64).enumerate();
        let (index, points) = all.filter(|(_, point)| is_return(point)).unzip();
        Self { points, index }
    }
}

struct Segments {
    ids: Vec<u32>,
    kinds: Vec<Kind>,
}

impl Segments {
    /// Gives each piece the next number; `index` maps returns to points.
    fn extend(&mut self, kind: Kind, pieces: Vec<Vec<usize>>, index: &[usize]) {
        for piece in pieces {
            for member in piece {
                self.ids[index[member]] = self.kinds.len() as u32;
            }
            self.kinds.push(kind);
        }
    }
}

/// Smallest number of points of a segment in a sweep of `num_returns`.
fn least_points(num_returns: usize, min_points: usize) -> usize {
    let share = (num_returns as f64 / DENSE_SWEEP).min(1.0);
    ((share * min_points as f64).round() as usize).max(FEWEST_POINTS.min(min_points)).max(1)
}

/// The points, rotated so that `up` is z.
fn upright(points: &[Vector3<f64>], up: &UnitVector3<f64>) -> Vec<Vector3<f64>> {
    let to_z = UnitQuaternion::rotation_between(up, &Vector3::z());
    let turn =
        to_z.unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let turn = turn.to_rotation_matrix();
    points.iter().map(|point| turn * point).collect()
}
