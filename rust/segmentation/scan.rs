//! The angular cells of a sweep: rings where it has any, else rows of a width that suits its density.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;

use crate::spherical::rings::{BIN, Filled, MIN_RETURNS, Ring, rings};
use crate::spherical::{azimuth, elevation};

/// Bins of elevation over the half-turn.
const NUM_BINS: usize = (PI / BIN) as usize + 1;
/// Rings are parted by at least this many empty bins.
const MIN_GAP_BINS: usize = 3;
/// Number of returns of each cell where there are no rings.
const RETURNS_PER_CELL: f64 = 2.0;
/// Limits of a cell, radians.
const MIN_CELL: f64 = 1e-3;
const MAX_CELL: f64 = 0.06;
/// Size of the cells that tell which part of the sphere a sweep fills, radians.
const COARSE: f64 = PI / 90.0;

/// Angles of a point about the LiDAR's z axis, radians.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction {
    azimuth: f64,
    elevation: f64,
}

impl Direction {
    pub(super) fn of(point: &Vector3<f64>) -> Self {
        Self { azimuth: azimuth(point), elevation: elevation(point) }
    }
}

/// A row of cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Radians.
    pub(super) elevation: f64,
    /// Cells around the turn.
    pub(super) columns: usize,
    /// Angle between neighbouring columns, radians of arc.
    pub(super) spacing: f64,
    /// Number of the row's first cell.
    pub(super) first: usize,
}

/// The cells of a sweep.
#[derive(Clone, Debug)]
pub(super) struct Scan {
    /// From the lowest to the highest.
    pub(super) rows: Vec<Row>,
    /// The row of each bin of elevation.
    row_of_bin: Vec<u16>,
}

impl Scan {
    /// The cells that suit a sweep of these directions.
    pub(super) fn of(directions: &[Direction]) -> Self {
        let mut counts = vec![0u32; NUM_BINS];
        directions.iter().for_each(|direction| counts[bin(direction.elevation)] += 1);
        let cells = directions.iter().map(|each| Filled::cell(COARSE, each.azimuth, each.elevation));
        let filled = Filled::with(COARSE, cells);
        let rings = rings(&counts, MIN_GAP_BINS);
        if !rings.is_empty() && directions.len() >= MIN_RETURNS * rings.len() {
            Self::of_rings(&rings, filled.share_in_any_row())
        } else {
            let cell = (RETURNS_PER_CELL * filled.solid_angle() / directions.len() as f64).sqrt();
            Self::of_squares(cell.clamp(MIN_CELL, MAX_CELL))
        }
    }

    /// Rows that part half-way between rings.
    fn of_rings(rings: &[Ring], share_of_turn: f64) -> Self {
        let mut returns: Vec<u32> = rings.iter().map(|ring| ring.returns).collect();
        returns.sort_unstable();
        // Rings into the sky return little; the fullest ones show the firings of a turn.
        let firings = f64::from(returns[returns.len() * 9 / 10]) / share_of_turn;
        let columns = firings.clamp(TAU / MAX_CELL, TAU / MIN_CELL) as usize;
        let mut row_of_bin = vec![0; NUM_BINS];
        let mut row = 0;
        for (bin, of_bin) in row_of_bin.iter_mut().enumerate() {
            while row + 1 < rings.len() && 2 * bin > rings[row].bin + rings[row + 1].bin {
                row += 1;
            }
            *of_bin = row as u16;
        }
        let elevations = rings.iter().map(|ring| (ring.bin as f64 + 0.5) * BIN - FRAC_PI_2);
        Self { rows: numbered(elevations.map(|elevation| (elevation, columns))), row_of_bin }
    }

    /// Rows of cells that are about as wide as high.
    fn of_squares(cell: f64) -> Self {
        let num_rows = (PI / cell).ceil() as usize;
        let elevations = (0..num_rows).map(|row| (row as f64 + 0.5) * PI / num_rows as f64 - FRAC_PI_2);
        let rows = elevations.map(|elevation| (elevation, (TAU * elevation.cos() / cell).ceil() as usize));
        let row_of_bin = (0..NUM_BINS).map(|bin| (bin * num_rows / NUM_BINS) as u16).collect();
        Self { rows: numbered(rows), row_of_bin }
    }

    /// Number of the cells.
    pub(super) fn num_cells(&self) -> usize {
        self.rows.last().map_or(0, |row| row.first + row.columns)
    }

    /// The row and the column of a direction.
    pub(super) fn place(&self, direction: &Direction) -> (usize, usize) {
        let row = usize::from(self.row_of_bin[bin(direction.elevation)]);
        let columns = self.rows[row].columns;
        let column = (direction.azimuth + PI) / TAU * columns as f64;
        (row, (column as usize).min(columns - 1))
    }
}

fn numbered(rows: impl Iterator<Item = (f64, usize)>) -> Vec<Row> {
    let mut first = 0;
    let row = |(elevation, columns): (f64, usize)| {
        let spacing = TAU / columns as f64 * elevation.cos();
        let row = Row { elevation, columns, spacing, first };
        first += columns;
        row
    };
    rows.map(row).collect()
}

fn bin(elevation: f64) -> usize {
    (((elevation + FRAC_PI_2) / BIN) as usize).min(NUM_BINS - 1)
}
