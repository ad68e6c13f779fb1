//! The angular cells of a sweep: rings where it has any, else rows of a width that suits its density.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;

use crate::spherical::{azimuth, elevation};

/// Size of the bins in the histogram of elevations that shows rings, radians.
const BIN: f64 = 2e-4;
const NUM_BINS: usize = (PI / BIN) as usize + 1;
/// Bins with less than this share of the fullest bin's returns are empty.
const EMPTY_BIN_SHARE: f64 = 0.02;
/// Rings are parted by at least this many empty bins.
const MIN_GAP_BINS: usize = 3;
/// Largest share of the bins, from the lowest ring to the highest, that rings fill.
const MAX_FILLED_SHARE: f64 = 0.5;
/// Least number of rings.
const MIN_RINGS: usize = 4;
/// Least number of returns of a ring, on average.
const MIN_RETURNS: usize = 90;
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
        let mut filled = vec![false; 90 * 180];
        for direction in directions {
            counts[bin(direction.elevation)] += 1;
            filled[coarse_cell(direction)] = true;
        }
        let rings = rings(&counts);
        if rings.len() >= MIN_RINGS && directions.len() >= MIN_RETURNS * rings.len() {
            Self::of_rings(&rings, share_of_turn(&filled))
        } else {
            let cell = (RETURNS_PER_CELL * solid_angle(&filled) / directions.len() as f64).sqrt();
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

/// Returns at about one elevation.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// The middle bin.
    bin: usize,
    returns: u32,
}

/// The rings that a histogram of elevations shows; none if most of it is filled.
fn rings(counts: &[u32]) -> Vec<Ring> {
    let fullest = counts.iter().copied().max().unwrap_or(0);
    let is_filled = |count: u32| f64::from(count) > EMPTY_BIN_SHARE * f64::from(fullest);
    let filled: Vec<usize> = (0..counts.len()).filter(|&bin| is_filled(counts[bin])).collect();
    let span = filled.last().zip(filled.first()).map_or(0, |(last, first)| last - first + 1);
    if filled.len() as f64 > MAX_FILLED_SHARE * span as f64 {
        return Vec::new();
    }
    let ring =
        |run: &[usize]| Ring { bin: run[run.len() / 2], returns: run.iter().map(|&bin| counts[bin]).sum() };
    filled.chunk_by(|a, b| b - a <= MIN_GAP_BINS).map(ring).collect()
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

fn coarse_cell(direction: &Direction) -> usize {
    let row = (((direction.elevation + FRAC_PI_2) / COARSE) as usize).min(89);
    row * 180 + (((direction.azimuth + PI) / COARSE) as usize).min(179)
}

/// Share of the azimuths that have returns.
fn share_of_turn(filled: &[bool]) -> f64 {
    let is_filled = |column: &usize| filled.iter().skip(*column).step_by(180).any(|&x| x);
    (0..180).filter(is_filled).count().max(1) as f64 / 180.0
}

/// Part of the sphere that has returns, steradians.
fn solid_angle(filled: &[bool]) -> f64 {
    let elevation = |row: usize| (row as f64 + 0.5) * COARSE - FRAC_PI_2;
    let of_row = |(row, cells): (usize, &[bool])| {
        cells.iter().filter(|&&x| x).count() as f64 * elevation(row).cos() * COARSE * COARSE
    };
    filled.chunks(180).enumerate().map(of_row).sum()
}
