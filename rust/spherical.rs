//! Spherical range images: points of a sweep on a grid of azimuth and elevation about the LiDAR's z axis.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::observation::{Frame, NO_CLASS, Observations};

/// No return fell into this pixel.
pub const EMPTY: u32 = u32::MAX;

/// A spherical image has at most so many pixels, ten times those of the densest sensors.
const MAX_PIXELS: usize = 1 << 24;

/// Share of the points at each end of the elevation range that is taken for stray returns when a grid is estimated.
const STRAY_SHARE: f64 = 0.002;

/// An estimated grid has so many points to a cell: of cells hit at random, 86 % are then filled.
const POINTS_PER_CELL: f64 = 2.0;
/// Limits of an estimated cell, radians.
const MIN_ESTIMATED_CELL: f64 = 1e-3;
const MAX_ESTIMATED_CELL: f64 = 0.035;
/// Channels are looked for in a histogram of elevations with bins of this size, radians ...
const CHANNEL_BIN: f64 = 2e-4;
/// ... of which they may fill at most this share; ...
const MAX_CHANNEL_SHARE: f64 = 0.5;
/// ... there are at least so many ...
const MIN_CHANNELS: usize = 4;
/// ... and bins with less than this share of the fullest's returns are empty.
const EMPTY_BIN_SHARE: f64 = 0.02;

/// A regular angular grid over all azimuths. Row 0 is the highest; columns run with falling azimuth, that is to the
/// right, from straight back over the left, front and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalGrid {
    /// Cells from top to bottom.
    pub rows: usize,
    /// Cells around.
    pub columns: usize,
    /// Elevation of the upper border, radians.
    pub top: f64,
    /// Height of a cell, radians.
    pub cell_height: f64,
}

impl SphericalGrid {
    /// The grid of a spinning LiDAR, one row a channel; `fov_up` and `fov_down` are the outer channels' elevations.
    ///
    /// # Errors
    /// There are fewer than two channels or four columns, or far too many, or the field of view is empty.
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

    /// The grid of a sensor that is not described, from its sweeps: that of a spinning LiDAR if the points lie in
    /// channels, else square cells, small enough for the pattern and large enough that its points fill them.
    ///
    /// # Errors
    /// There are no points, or they span no elevation range.
    pub fn estimate(sweeps: &[&[[f32; 3]]]) -> Result<Self> {
        let mut elevations: Vec<f64> =
            sweeps.iter().copied().flatten().map(|p| elevation(&to_f64(p))).collect();
        let stray = (elevations.len() as f64 * STRAY_SHARE) as usize;
        elevations.sort_unstable_by(f64::total_cmp);
        let within = &elevations[stray..elevations.len() - stray];
        let (Some(&bottom), Some(&top)) = (within.first(), within.last()) else {
            return Err(Error::Calibration("the point clouds are empty".into()));
        };
        if top - bottom < MIN_ESTIMATED_CELL {
            return Err(Error::Calibration(format!(
                "the points span {:.3} degrees of elevation, needed is a sensor that scans in two directions",
                (top - bottom).to_degrees()
            )));
        }
        let filled = Filled::by(sweeps);
        let per_sweep = elevations.len() as f64 / sweeps.len() as f64;
        if let Some(channels) = count_channels(within, bottom, top) {
            let columns = per_sweep / channels as f64 / filled.share_of_turn();
            let columns = (columns as usize).clamp(4, MAX_PIXELS / channels);
            return Self::from_scan(channels, columns, top, bottom);
        }
        let cell = (POINTS_PER_CELL * filled.solid_angle() / per_sweep).sqrt();
        let cell = cell.clamp(MIN_ESTIMATED_CELL, MAX_ESTIMATED_CELL);
        let rows = ((top - bottom) / cell).ceil();
        let margin = 0.5 * (rows * cell - (top - bottom));
        Ok(Self {
            rows: rows as usize,
            columns: (TAU / cell).round() as usize,
            top: top + margin,
            cell_height: cell,
        })
    }

    /// The same field of view in cells of about `cell` radians, never finer than this grid's own.
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

    /// The (row, column) a direction falls into, if it lies within the elevations.
    #[inline]
    pub fn cell(&self, direction: &Vector3<f64>) -> Option<(usize, usize)> {
        let row = (self.top - elevation(direction)) / self.cell_height;
        if !(row >= 0.0 && row < self.rows as f64) {
            return None;
        }
        let column = (PI - azimuth(direction)) / TAU * self.columns as f64;
        Some((row as usize, (column as usize).min(self.columns - 1)))
    }

    /// The unit direction (LiDAR frame) of a cell's centre.
    #[inline]
    pub fn direction(&self, row: usize, column: usize) -> Vector3<f64> {
        let elevation = self.top - (row as f64 + 0.5) * self.cell_height;
        let azimuth = PI - (column as f64 + 0.5) / self.columns as f64 * TAU;
        from_angles(azimuth, elevation)
    }

    /// Elevation of the lower border, radians.
    pub fn bottom(&self) -> f64 {
        self.top - self.rows as f64 * self.cell_height
    }

    /// For each pixel, the index of its nearest return, or [`EMPTY`] (Alg. 2, line 1). Equal ranges go to the lowest
    /// index.
    pub fn project(&self, points: &[[f32; 3]]) -> Vec<u32> {
        let mut index = vec![EMPTY; self.rows * self.columns];
        let mut nearest = vec![f64::INFINITY; index.len()];
        for (i, point) in points.iter().enumerate() {
            let point = to_f64(point);
            if let Some((row, column)) = self.cell(&point) {
                let pixel = row * self.columns + column;
                let range = point.norm_squared();
                if range < nearest[pixel] {
                    (nearest[pixel], index[pixel]) = (range, i as u32);
                }
            }
        }
        index
    }
}

/// The number of runs of filled bins in the histogram of (sorted) elevations, if most bins are empty: one a channel.
fn count_channels(elevations: &[f64], bottom: f64, top: f64) -> Option<usize> {
    let num_bins = ((top - bottom) / CHANNEL_BIN) as usize + 1;
    let mut counts = vec![0u32; num_bins];
    for elevation in elevations {
        counts[((elevation - bottom) / CHANNEL_BIN) as usize] += 1;
    }
    let fullest = counts.iter().copied().max().unwrap_or(0);
    let is_filled = |&count: &u32| f64::from(count) > EMPTY_BIN_SHARE * f64::from(fullest);
    let filled = counts.iter().filter(|c| is_filled(c)).count();
    let channels =
        counts.chunk_by(|a, b| is_filled(a) == is_filled(b)).filter(|run| is_filled(&run[0])).count();
    let sparse = (filled as f64) < MAX_CHANNEL_SHARE * num_bins as f64;
    (sparse && channels >= MIN_CHANNELS).then_some(channels)
}

/// The spherical images of all frames (Alg. 2, line 1), as the labelled returns that win a pixel of the grid.
#[derive(Clone, Debug)]
pub struct SphericalImages {
    /// What their pixels are.
    pub grid: SphericalGrid,
    /// Position (metres, LiDAR frame) and class of each, frame after frame.
    pub returns: Vec<Vec<LabelledReturn>>,
}

/// A return (metres, LiDAR frame) and its class.
pub type LabelledReturn = ([f32; 3], u8);

impl SphericalImages {
    /// Projects all frames.
    pub fn new(observations: &Observations, grid: SphericalGrid) -> Self {
        let labelled = |frame: &Frame| {
            let winners = grid.project(&frame.points).into_iter().filter(|&i| i != EMPTY);
            let returns = winners.map(|i| (frame.points[i as usize], frame.point_classes[i as usize]));
            returns.filter(|&(_, class)| class != NO_CLASS).collect()
        };
        Self { grid, returns: observations.frames.par_iter().map(labelled).collect() }
    }

    /// Returns of all frames.
    pub fn num_returns(&self) -> usize {
        self.returns.iter().map(Vec::len).sum()
    }
}

/// The cells of about a degree that any point of any sweep falls into.
struct Filled {
    cells: Vec<bool>,
}

impl Filled {
    const SIDE: f64 = PI / 180.0;
    const ROWS: usize = 180;
    const COLUMNS: usize = 360;

    fn by(sweeps: &[&[[f32; 3]]]) -> Self {
        let mut cells = vec![false; Self::ROWS * Self::COLUMNS];
        for point in sweeps.iter().copied().flatten() {
            let point = to_f64(point);
            let row = ((FRAC_PI_2 - elevation(&point)) / Self::SIDE) as usize;
            let column = ((PI - azimuth(&point)) / Self::SIDE) as usize;
            cells[row.min(Self::ROWS - 1) * Self::COLUMNS + column.min(Self::COLUMNS - 1)] = true;
        }
        Self { cells }
    }

    /// Cells filled in each row.
    fn rows(&self) -> impl Iterator<Item = usize> {
        self.cells.chunks_exact(Self::COLUMNS).map(|row| row.iter().filter(|&&filled| filled).count())
    }

    /// Steradian.
    fn solid_angle(&self) -> f64 {
        let of_cell = |row: usize| ((row as f64 + 0.5) * Self::SIDE).sin() * Self::SIDE * Self::SIDE;
        self.rows().enumerate().map(|(row, count)| count as f64 * of_cell(row)).sum()
    }

    /// The share of the turn that is filled, in the row where it is largest.
    fn share_of_turn(&self) -> f64 {
        self.rows().max().unwrap_or(0) as f64 / Self::COLUMNS as f64
    }
}

/// A point as read, for geometry.
#[inline]
pub fn to_f64(point: &[f32; 3]) -> Vector3<f64> {
    Vector3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2]))
}

/// Angle from the x axis towards y, in (-pi, pi].
#[inline]
pub fn azimuth(direction: &Vector3<f64>) -> f64 {
    direction.y.atan2(direction.x)
}

/// Angle above the x-y plane.
#[inline]
pub fn elevation(direction: &Vector3<f64>) -> f64 {
    direction.z.atan2(direction.x.hypot(direction.y))
}

/// The unit vector of an azimuth and an elevation.
#[inline]
pub fn from_angles(azimuth: f64, elevation: f64) -> Vector3<f64> {
    Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::ScanPattern;
    use proptest::prelude::*;

    fn grid() -> SphericalGrid {
        SphericalGrid::from_scan(64, 1024, 10f64.to_radians(), -30f64.to_radians()).expect("a valid scan")
    }

    #[test]
    fn the_outer_channels_lie_in_the_outer_rows() {
        let at = |deg: f64| grid().cell(&from_angles(0.1, deg.to_radians())).map(|(row, _)| row);
        assert_eq!((at(10.0), at(-30.0), at(10.4), at(-30.4)), (Some(0), Some(63), None, None));
    }

    #[test]
    fn nearest_return_wins_and_keeps_its_index() {
        let point = |range: f32| [range, range * 1e-4, 0.0];
        let index = grid().project(&[point(9.0), point(3.0), point(3.0), point(5.0)]);
        let filled: Vec<u32> = index.into_iter().filter(|&i| i != EMPTY).collect();
        assert_eq!(filled, [1]);
    }

    fn sweep(pattern: ScanPattern) -> Vec<[f32; 3]> {
        let ranged =
            |(i, direction): (usize, Vector3<f64>)| (direction * (5.0 + (i % 17) as f64)).map(|x| x as f32);
        pattern.directions(0).into_iter().enumerate().map(ranged).map(Into::into).collect()
    }

    #[test]
    fn channels_and_columns_are_found_in_the_points() {
        for (channels, columns) in [(16, 1800), (32, 1024), (64, 512), (128, 1024)] {
            let sweep =
                sweep(ScanPattern::Spinning { channels, columns, fov_up_deg: 15.0, fov_down_deg: -25.0 });
            let grid = SphericalGrid::estimate(&[&sweep]).expect("a grid");
            assert_eq!((grid.rows, grid.columns), (channels, columns));
            assert!((grid.top - 0.5 * grid.cell_height - 15f64.to_radians()).abs() < 1e-4);
        }
    }

    #[test]
    fn a_rosette_fills_its_cells() {
        let points = 40_000;
        let sweep = sweep(ScanPattern::Rosette { points, fov_up_deg: 52.0, fov_down_deg: -7.0 });
        let grid = SphericalGrid::estimate(&[&sweep]).expect("a grid");
        let filled = grid.project(&sweep).iter().filter(|&&i| i != EMPTY).count();
        let cells = grid.rows * grid.columns;
        assert!(filled as f64 > 0.6 * cells as f64, "{filled} of {cells} cells");
        assert!(cells > points / 5, "{cells} cells are few for {points} points");
    }

    #[test]
    fn a_flat_or_an_empty_sweep_has_no_grid() {
        let flat: Vec<[f32; 3]> = (0..100).map(|i| [i as f32 - 50.0, 3.0, 0.0]).collect();
        for sweep in [flat, Vec::new()] {
            assert!(SphericalGrid::estimate(&[&sweep]).is_err());
        }
    }

    proptest! {
        #[test]
        fn a_cells_centre_lies_in_it(row in 0usize..64, column in 0usize..1024) {
            prop_assert_eq!(grid().cell(&grid().direction(row, column)), Some((row, column)));
        }
    }
}
