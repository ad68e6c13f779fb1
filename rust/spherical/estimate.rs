//! Estimation of a sensor's angular grid from its points, if it has no description.

use std::f64::consts::{PI, TAU};

use geometry::angles::{azimuth, elevation};
use rayon::prelude::*;

use super::rings::{BIN, FilledCells, MIN_RETURNS, rings};
use super::{MAX_PIXELS, SphericalGrid};
use crate::error::{Error, Result};
use crate::point_cloud::to_f64;

/// Share of the points at each end of the elevation range that count as stray returns.
const STRAY_SHARE: f64 = 0.002;
/// Number of points per cell of an estimated grid: cells hit at random are then 86 % filled.
const POINTS_PER_CELL: f64 = 2.0;
/// Limits of an estimated cell, radians.
const MIN_ESTIMATED_CELL: f64 = 1e-3;
const MAX_ESTIMATED_CELL: f64 = 0.035;
/// Size of the cells that measure which part of the sphere the points fill, radians.
const COARSE: f64 = PI / 180.0;
/// Number of points in one task.
const CHUNK: usize = 4096;

/// Estimates the grid of a sensor from its sweeps: that of a spinning LiDAR if the points form channels; otherwise
/// square cells, small enough for the pattern and large enough that the points fill them.
pub fn estimate(sweeps: &[&[[f32; 3]]]) -> Result<SphericalGrid> {
    let of_point = |point: &[f32; 3]| {
        let point = to_f64(point);
        let elevation = elevation(&point);
        (elevation, FilledCells::cell(COARSE, azimuth(&point), elevation))
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
            "the points span {:.3} degrees of elevation, expected a sensor that scans in two directions",
            (top - bottom).to_degrees()
        )));
    }
    let filled = FilledCells::with(COARSE, cells);
    let per_sweep = elevations.len() as f64 / sweeps.len() as f64;
    if let Some(channels) = count_channels(within, bottom, top) {
        let columns = (per_sweep / channels as f64 / filled.share_of_turn()) as usize;
        if columns >= MIN_RETURNS {
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

/// Number of rings in sorted elevations; `None` if there are no rings.
fn count_channels(elevations: &[f64], bottom: f64, top: f64) -> Option<usize> {
    let mut counts = vec![0u32; ((top - bottom) / BIN) as usize + 1];
    for elevation in elevations {
        counts[((elevation - bottom) / BIN) as usize] += 1;
    }
    Some(rings(&counts, 1).len()).filter(|&channels| channels > 0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::spherical::EMPTY;
    use streets::{Lidar, Pattern};

    fn sweep(lidar: Lidar) -> Vec<[f32; 3]> {
        let ranged =
            |(i, direction): (usize, Vector3<f64>)| (direction * (5.0 + (i % 17) as f64)).map(|x| x as f32);
        lidar.directions(0).into_iter().enumerate().map(ranged).map(Into::into).collect()
    }

    fn rosette(columns: usize, fov_up_deg: f64, fov_down_deg: f64) -> Lidar {
        Lidar {
            pattern: Pattern::Rosette,
            channels: 1,
            columns,
            fov_up_deg,
            fov_down_deg,
            ..Lidar::default()
        }
    }

    #[test]
    fn channels_and_columns_are_found_in_the_points() {
        for (channels, columns) in [(16, 1800), (32, 1024), (64, 512), (128, 1024)] {
            let lidar =
                Lidar { channels, columns, fov_up_deg: 15.0, fov_down_deg: -25.0, ..Lidar::default() };
            let sweep = sweep(lidar);
            let grid = estimate(&[&sweep]).expect("a grid");
            assert_eq!((grid.rows, grid.columns), (channels, columns));
            assert!((grid.top - 0.5 * grid.cell_height - 15f64.to_radians()).abs() < 1e-4);
        }
    }

    #[test]
    fn a_rosette_fills_its_cells() {
        let points = 40_000;
        let sweep = sweep(rosette(points, 52.0, -7.0));
        let grid = estimate(&[&sweep]).expect("a grid");
        let filled = grid.project(&sweep).iter().filter(|&&i| i != EMPTY).count();
        let cells = grid.rows * grid.columns;
        assert!(filled as f64 > 0.6 * cells as f64, "{filled} of {cells} cells");
        assert!(cells > points / 5, "{cells} cells are few for {points} points");
    }

    #[test]
    fn a_sparse_rosette_has_no_channels() {
        for points in [1000, 2000, 3000, 4000] {
            let sweep = sweep(rosette(points, 10.0, -30.0));
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
