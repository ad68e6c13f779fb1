//! Spherical range images: points of a sweep on a grid of azimuth and elevation about the LiDAR's z axis.

mod estimate;
pub mod rings;

use std::f64::consts::{PI, TAU};

use geometry::angles::{azimuth, elevation, from_angles};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::classes::NO_CLASS;
use crate::error::{Error, Result};
use crate::observation::{Frame, Observations};
use crate::point_cloud::to_f64;

pub use estimate::estimate;

/// Index of a pixel without a return.
pub const EMPTY: u32 = u32::MAX;

/// Largest number of pixels of a spherical image, ten times that of the densest sensors.
const MAX_PIXELS: usize = 1 << 24;

/// A regular angular grid over all azimuths. Row 0 is the highest; columns run with decreasing azimuth, that is to
/// the right, from straight back over the left, front and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalGrid {
    pub rows: usize,
    pub columns: usize,
    /// Elevation of the upper border, radians.
    pub top: f64,
    pub cell_height: f64,
}

impl SphericalGrid {
    /// The grid of a spinning LiDAR, one row per channel; `fov_up` and `fov_down` are the elevations of the outer
    /// channels.
    pub fn from_scan(channels: usize, columns: usize, fov_up: f64, fov_down: f64) -> Result<Self> {
        let pixels = channels.checked_mul(columns).filter(|&n| n <= MAX_PIXELS);
        let upright = fov_up.partial_cmp(&fov_down) == Some(std::cmp::Ordering::Greater);
        if channels < 2 || columns < 4 || pixels.is_none() || !upright {
            return Err(Error::Input(format!(
                "lidar: found {channels} channels x {columns} columns from {:.3} to {:.3} degrees, needed at least \
                 2 x 4, at most {MAX_PIXELS} pixels, and fov_up above fov_down",
                fov_up.to_degrees(),
                fov_down.to_degrees()
            )));
        }
        let cell_height = (fov_up - fov_down) / (channels - 1) as f64;
        Ok(Self { rows: channels, columns, top: fov_up + 0.5 * cell_height, cell_height })
    }

    /// Returns a grid of the same field of view in cells of about `cell` radians, never finer than this grid.
    pub fn coarsened(&self, cell: f64) -> Self {
        let rows = (self.rows as f64 * self.cell_height / cell).round().clamp(1.0, self.rows as f64);
        let columns = (TAU / cell).round().clamp(4.0, self.columns as f64);
        Self {
            rows: rows as usize,
            columns: columns as usize,
            top: self.top,
            cell_height: self.rows as f64 * self.cell_height / rows,
        }
    }

    /// The (row, column) that a direction falls into, if it is within the elevations.
    pub fn cell(&self, direction: &Vector3<f64>) -> Option<(usize, usize)> {
        let row = (self.top - elevation(direction)) / self.cell_height;
        if !(row >= 0.0 && row < self.rows as f64) {
            return None;
        }
        let column = (PI - azimuth(direction)) / TAU * self.columns as f64;
        Some((row as usize, (column as usize).min(self.columns - 1)))
    }

    /// The unit direction (LiDAR frame) of a cell's centre.
    pub fn direction(&self, row: usize, column: usize) -> Vector3<f64> {
        let elevation = self.top - (row as f64 + 0.5) * self.cell_height;
        let azimuth = PI - (column as f64 + 0.5) / self.columns as f64 * TAU;
        from_angles(azimuth, elevation)
    }

    /// Elevation of the lower border, radians.
    pub fn bottom(&self) -> f64 {
        self.top - self.rows as f64 * self.cell_height
    }

    /// For each pixel, the index of its nearest return, or [`EMPTY`] (Alg. 2, line 1).
    pub fn project(&self, points: &[[f32; 3]]) -> Vec<u32> {
        let pixel =
            |point: &[f32; 3]| self.cell(&to_f64(point)).map(|(row, column)| row * self.columns + column);
        nearest(points, points.iter().map(pixel), self.rows * self.columns)
    }
}

/// For each pixel, the index of its nearest point, the first in a tie, or [`EMPTY`]. `pixel_of` holds the pixels of
/// the points.
pub fn nearest(
    points: &[[f32; 3]],
    pixel_of: impl Iterator<Item = Option<usize>>,
    num_pixels: usize,
) -> Vec<u32> {
    let mut nearest = vec![(f64::INFINITY, EMPTY); num_pixels];
    for ((index, point), pixel) in points.iter().enumerate().zip(pixel_of) {
        let Some(pixel) = pixel else { continue };
        let range = to_f64(point).norm_squared();
        if range < nearest[pixel].0 {
            nearest[pixel] = (range, index as u32);
        }
    }
    nearest.into_iter().map(|(_, index)| index).collect()
}

/// The spherical images of all frames (Alg. 2, line 1), as the labelled returns that are the nearest in a pixel of
/// the grid.
#[derive(Clone, Debug)]
pub struct SphericalImages {
    pub grid: SphericalGrid,
    /// Position (metres, LiDAR frame) and class of each return, frame after frame.
    pub returns: Vec<Vec<LabelledReturn>>,
}

/// A return (metres, LiDAR frame) and its class.
pub type LabelledReturn = ([f32; 3], u8);

impl SphericalImages {
    pub fn new(observations: &Observations, grid: SphericalGrid) -> Self {
        let labelled = |frame: &Frame| {
            let winners = grid.project(&frame.points).into_iter().filter(|&i| i != EMPTY);
            let returns = winners.map(|i| (frame.points[i as usize], frame.point_classes[i as usize]));
            returns.filter(|&(_, class)| class != NO_CLASS).collect()
        };
        Self { grid, returns: observations.frames.par_iter().map(labelled).collect() }
    }

    pub fn num_returns(&self) -> usize {
        self.returns.iter().map(Vec::len).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> SphericalGrid {
        SphericalGrid::from_scan(64, 1024, 10f64.to_radians(), -30f64.to_radians()).expect("a valid scan")
    }

    #[test]
    fn the_outer_channels_lie_in_the_outer_rows() {
        let at = |deg: f64| grid().cell(&from_angles(0.1, deg.to_radians())).map(|(row, _)| row);
        assert_eq!((at(10.0), at(-30.0), at(10.4), at(-30.4)), (Some(0), Some(63), None, None));
    }

    proptest! {
        #[test]
        fn every_pixel_has_its_nearest_return(points in prop::collection::vec(prop::array::uniform3(-8f32..8f32), 1..300)) {
            let grid = grid().coarsened(0.3);
            for (pixel, &index) in grid.project(&points).iter().enumerate() {
                let cell = Some((pixel / grid.columns, pixel % grid.columns));
                let inside = (0..points.len()).filter(|&i| grid.cell(&to_f64(&points[i])) == cell);
                let range = |i: &usize| to_f64(&points[*i]).norm_squared();
                let nearest = inside.min_by(|a, b| range(a).total_cmp(&range(b)));
                prop_assert_eq!(nearest.map_or(EMPTY, |i| i as u32), index);
            }
        }

        #[test]
        fn a_cells_centre_lies_in_it(row in 0usize..64, column in 0usize..1024) {
            prop_assert_eq!(grid().cell(&grid().direction(row, column)), Some((row, column)));
        }
    }
}
