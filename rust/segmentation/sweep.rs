//! Segments of one sweep: its ground, and the objects on it.

use nalgebra::{UnitVector3, Vector3};
use rayon::prelude::*;

use super::up::{estimate_up, upright};
use super::{
    NO_SEGMENT, SegmentKind, SegmentationConfig, SegmentedSweep, components, cut, ground, is_return,
};
use crate::point_cloud::to_f64;

/// Number of returns of a sweep from which on a segment needs `min_points`; in a sparser sweep it needs
/// proportionally fewer.
const DENSE_SWEEP: f64 = 50_000.0;
/// Smallest number of points of a segment in any sweep.
const MIN_POINTS: usize = 6;

/// Segments each of a drive's sweeps. Without `up`, the direction is estimated from all of them together.
pub fn segment_sweeps(
    sweeps: &[&[[f32; 3]]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> Vec<SegmentedSweep> {
    let up = up.or_else(|| estimate_up(sweeps).map(|up| up.direction));
    sweeps.par_iter().map(|sweep| segment_with(sweep, up, config)).collect()
}

fn segment_with(
    points: &[[f32; 3]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> SegmentedSweep {
    let returns = Returns::of(points);
    let min_points = min_points_of_segment(returns.points.len(), config.min_points);
    let is_ground = match up {
        Some(up) => ground::find(&upright(&returns.points, &up), config.ground_tolerance_m),
        None => vec![false; returns.points.len()],
    };
    let mut segments = Segments { ids: vec![NO_SEGMENT; points.len()], kinds: Vec::new() };
    let (ground, rest): (Vec<usize>, Vec<usize>) = (0..returns.points.len()).partition(|&i| is_ground[i]);
    let cut = |members, size| cut::into_pieces(&returns.points, members, size, min_points);
    segments.extend(SegmentKind::Ground, cut(ground, config.ground_cell_m), &returns.index);
    for component in components::find(&returns.points, &rest, config) {
        segments.extend(SegmentKind::Object, cut(component, config.object_cell_m), &returns.index);
    }
    SegmentedSweep { ids: segments.ids, kinds: segments.kinds, up }
}

pub(super) struct Returns {
    pub points: Vec<Vector3<f64>>,
    index: Vec<usize>,
}

impl Returns {
    pub fn of(points: &[[f32; 3]]) -> Self {
        let all = points.iter().map(to_f64).enumerate();
        let (index, points) = all.filter(|(_, point)| is_return(point)).unzip();
        Self { points, index }
    }
}

struct Segments {
    ids: Vec<u32>,
    kinds: Vec<SegmentKind>,
}

impl Segments {
    /// Adds each piece as the next segment; `index` maps returns to points.
    fn extend(&mut self, kind: SegmentKind, pieces: Vec<Vec<usize>>, index: &[usize]) {
        for piece in pieces {
            for member in piece {
                self.ids[index[member]] = self.kinds.len() as u32;
            }
            self.kinds.push(kind);
        }
    }
}

/// Smallest number of points of a segment in a sweep of `num_returns`.
pub(super) fn min_points_of_segment(num_returns: usize, min_points: usize) -> usize {
    let share = (num_returns as f64 / DENSE_SWEEP).min(1.0);
    ((share * min_points as f64).round() as usize).max(MIN_POINTS.min(min_points)).max(1)
}
