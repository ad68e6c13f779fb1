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
mod sweep;
#[cfg(test)]
mod tests;
mod turned;
mod up;

use nalgebra::{UnitVector3, Vector3};

pub use sweep::segment_sweeps;
pub use turned::turned;
pub use up::{Up, estimate_up};

/// The segment id of a point in no segment.
pub const NO_SEGMENT: u32 = u32::MAX;
/// Points nearer to the sensor than this are not returns, metres.
const MIN_RANGE_M: f64 = 0.05;
/// Points beyond this are not returns, metres: no LiDAR reaches that far.
const MAX_RANGE_M: f64 = 1000.0;
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
pub enum SegmentKind {
    /// The surface on which everything stands.
    Ground = 0,
    /// Anything else.
    Object = 1,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SegmentedSweep {
    /// Segment of each point, or [`NO_SEGMENT`]. Segments of the ground come first.
    pub ids: Vec<u32>,
    pub kinds: Vec<SegmentKind>,
    /// Direction away from the ground, LiDAR frame; `None` if no ground was found, and everything is an object.
    pub up: Option<UnitVector3<f64>>,
}

/// Whether a point, metres, LiDAR frame, is a return of a LiDAR beam.
pub fn is_return(point: &Vector3<f64>) -> bool {
    // NaN is in no interval.
    (MIN_RANGE_M..MAX_RANGE_M).contains(&point.norm())
}
