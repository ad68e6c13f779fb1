//! The angular grid of a sensor without a description, estimated from its points.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{MAX_PIXELS, SphericalGrid, azimuth, elevation};
use crate::error::{Error, Result};
use crate::point_cloud::to_f64;

/// Share of the points at each end of the elevation range that is taken for stray returns when a grid is estimated.
const STRAY_SHARE: f64 = 0.002;
/// Number of points for each cell of an estimated grid: of cells hit at random, 86 % are then filled.
const POINTS_PER_CELL: f64 = 2.0;
/// Limits of an estimated cell, radians.
const MIN_ESTIMATED_CELL: f64 = 1e-3;
const MAX_ESTIMATED_CELL: f64 = 0.035;
/// Size of the bins, radians, in the histogram of elevations that shows channels.
const CHANNEL_BIN: f64 = 2e-4;
/// Largest share of the bins that channels fill.
const MAX_CHANNEL_SHARE: f64 = 0.5;
/// Least number of channels.
const MIN_CHANNELS: usize = 4;
/// Least number of returns of a channel in each turn.
const MIN_COLUMNS: usize = 90;
/// Bins with less than this share of the fullest bin's returns are empty.
const EMPTY_BIN_SHARE: f64 = 0.02;
/// Points that one task looks at.
const CHUNK: usize = 4096;

/// The grid of a sensor without a description, from its sweeps: that of a spinning LiDAR if the points lie in channels;
/// else square cells, small enough for the pattern and large enough that the points fill them.
///
/// # Errors
/// There are no points, or they span no elevation range.
pub fn estimate(sweeps: &[&[[f32; 3]]]) -> Result<SphericalGrid> {
    let of_point = |point: &[f32; 3]| {
        let point = to_f64(point);
        (elevation(&point), Filled::cell(&point))
    };
    let points = sweeps.par_iter().flat_map(|sweep| sweep.par_iter().with_min_len(CHUNK));
    let (mut elevations, cells): (Vec<f64>, Vec<usize>) = points.map(of_point).unzip();
    let stray = (elevations.len() as f64 * STRAY_SHARE) as usize;
    elevations.par_sort_unstable_by(f64::total_cmp);
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
    let filled = Filled::with(&cells);
    let per_sweep = elevations.len() as f64 / sweeps.len() as f64;
    if let Some(channels) = count_channels(within, bottom, top) {
        let columns = (per_sweep / channels as f64 / filled.share_of_turn()) as usize;
        // A sparse pattern leaves bins empty, too, but puts few points into each of its many "channels".
        if columns >= MIN_COLUMNS {
            return SphericalGrid::from_scan(channels, columns.min(MAX_PIXELS / channels), top, bottom);
        }
    }
    let cell = (POINTS_PER_CELL * filled.solid_angle() / per_sweep).sqrt();
    let cell = cell.clamp(MIN_ESTIMATED_CELL, MAX_ESTIMATED_CELL);
    let rows = ((top - bottom) / cell).ceil();
    let margin = 0.5 * (rows * cell - (top - bottom));
    Ok(SphericalGrid {
        rows: rows as usize,
        columns: (TAU / cell).round() as usize,
        top: top + margin,
        cell_height: cell,
    })
}

/// The number of runs of filled bins in the histogram of (sorted) elevations, one for each channel, if most are empty.
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

/// The cells of about a degree that contain a point of any sweep.
struct Filled {
    cells: Vec<bool>,
}

impl Filled {
    const SIDE: f64 = PI / 180.0;
    const ROWS: usize = 180;
    const COLUMNS: usize = 360;

    fn with(filled: &[usize]) -> Self {
        let mut cells = vec![false; Self::ROWS * Self::COLUMNS];
        filled.iter().for_each(|&cell| cells[cell] = true);
        Self { cells }
    }

    /// The cell of a point.
    fn cell(point: &Vector3<f64>) -> usize {
        let row = ((FRAC_PI_2 - elevation(point)) / Self::SIDE) as usize;
        let column = ((PI - azimuth(point)) / Self::SIDE) as usize;
        row.min(Self::ROWS - 1) * Self::COLUMNS + column.min(Self::COLUMNS - 1)
    }

    /// Number of cells filled in each row.
    fn rows(&self) -> impl Iterator<Item = usize> {
        self.cells.chunks_exact(Self::COLUMNS).map(|row| row.iter().filter(|&&filled| filled).count())
    }

    /// Solid angle of the filled cells, steradian.
    fn solid_angle(&self) -> f64 {
        let of_cell = |row: usize| ((row as f64 + 0.5) * Self::SIDE).sin() * Self::SIDE * Self::SIDE;
        self.rows().enumerate().map(|(row, count)| count as f64 * of_cell(row)).sum()
    }

    /// The filled share of the turn, in the row where it is largest.
    fn share_of_turn(&self) -> f64 {
        self.rows().max().unwrap_or(0) as f64 / Self::COLUMNS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spherical::EMPTY;
    use crate::world::ScanPattern;

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
            let grid = estimate(&[&sweep]).expect("a grid");
            assert_eq!((grid.rows, grid.columns), (channels, columns));
            assert!((grid.top - 0.5 * grid.cell_height - 15f64.to_radians()).abs() < 1e-4);
        }
    }

    #[test]
    fn a_rosette_fills_its_cells() {
        let points = 40_000;
        let sweep = sweep(ScanPattern::Rosette { points, fov_up_deg: 52.0, fov_down_deg: -7.0 });
        let grid = estimate(&[&sweep]).expect("a grid");
        let filled = grid.project(&sweep).iter().filter(|&&i| i != EMPTY).count();
        let cells = grid.rows * grid.columns;
        assert!(filled as f64 > 0.6 * cells as f64, "{filled} of {cells} cells");
        assert!(cells > points / 5, "{cells} cells are few for {points} points");
    }

    #[test]
    fn a_sparse_rosette_has_no_channels() {
        for points in [1000, 2000, 3000, 4000] {
            let sweep = sweep(ScanPattern::Rosette { points, fov_up_deg: 10.0, fov_down_deg: -30.0 });
            let grid = estimate(&[&sweep]).expect("a grid");
            assert!(
                (grid.cell_height - TAU / grid.columns as f64).abs() < 1e-3,
                "{grid:?} for {points} points"
            );
        }
    }

    #[test]
    fn a_flat_or_an_empty_sweep_has_no_grid() {
        let flat: Vec<[f32; 3]> = (0..100).map(|i| [i as f32 - 50.0, 3.0, 0.0]).collect();
        for sweep in [flat, Vec::new()] {
            assert!(estimate(&[&sweep]).is_err());
        }
    }
}
