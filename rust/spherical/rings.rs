//! The rings of a sweep, found from its elevations, and the part of the sphere that it fills.

use std::f64::consts::{FRAC_PI_2, PI};

/// Bin size of the elevation histogram in which rings are found, radians.
pub const BIN: f64 = 2e-4;
/// Bins with less than this share of the fullest bin's returns are empty.
const EMPTY_BIN_SHARE: f64 = 0.02;
/// Largest share of the bins, from the lowest ring to the highest, that rings may fill.
const MAX_FILLED_SHARE: f64 = 0.5;
/// Smallest number of rings, and of returns per ring on average: a sparse pattern also leaves bins empty, but has
/// few returns in each of its many "rings".
const MIN_RINGS: usize = 4;
pub const MIN_RETURNS: usize = 90;

/// Returns at about one elevation.
#[derive(Clone, Copy, Debug)]
pub struct Ring {
    /// Index of the middle bin.
    pub bin: usize,
    /// Number of returns.
    pub returns: u32,
}

/// Finds the rings in a histogram of elevations. Filled bins less than `gap` empty ones apart form one ring. There
/// are none if most bins are filled, or too few rings are found.
pub fn rings(counts: &[u32], gap: usize) -> Vec<Ring> {
    let fullest = counts.iter().copied().max().unwrap_or(0);
    let is_filled = |count: u32| f64::from(count) > EMPTY_BIN_SHARE * f64::from(fullest);
    let filled: Vec<usize> = (0..counts.len()).filter(|&bin| is_filled(counts[bin])).collect();
    let span = filled.last().zip(filled.first()).map_or(0, |(last, first)| last - first + 1);
    if filled.len() as f64 > MAX_FILLED_SHARE * span as f64 {
        return Vec::new();
    }
    let ring =
        |run: &[usize]| Ring { bin: run[run.len() / 2], returns: run.iter().map(|&bin| counts[bin]).sum() };
    let rings: Vec<Ring> = filled.chunk_by(|a, b| b - a <= gap).map(ring).collect();
    if rings.len() < MIN_RINGS { Vec::new() } else { rings }
}

/// The cells of a grid over the sphere that contain a return.
pub struct FilledCells {
    /// Size of a cell, radians, which divides a half-turn.
    side: f64,
    /// Cells from top to bottom, and to the right from straight back.
    cells: Vec<bool>,
}

impl FilledCells {
    /// The grid with the cells of some returns filled, as indexed by [`FilledCells::cell`].
    pub fn with(side: f64, filled: impl IntoIterator<Item = usize>) -> Self {
        let rows = (PI / side).round() as usize;
        let mut cells = vec![false; rows * 2 * rows];
        filled.into_iter().for_each(|cell| cells[cell] = true);
        Self { side, cells }
    }

    /// The cell of a direction in a grid.
    pub fn cell(side: f64, azimuth: f64, elevation: f64) -> usize {
        let rows = (PI / side).round() as usize;
        let row = ((FRAC_PI_2 - elevation) / side) as usize;
        let column = ((PI - azimuth) / side) as usize;
        row.min(rows - 1) * 2 * rows + column.min(2 * rows - 1)
    }

    fn rows(&self) -> impl Iterator<Item = &[bool]> {
        self.cells.chunks_exact((PI / self.side).round() as usize * 2)
    }

    /// Solid angle of the filled cells, steradian.
    pub fn solid_angle(&self) -> f64 {
        let of_cell = |row: usize| ((row as f64 + 0.5) * self.side).sin() * self.side * self.side;
        self.rows().enumerate().map(|(row, cells)| count(cells) as f64 * of_cell(row)).sum()
    }

    /// Filled share of the turn, in the row where it is largest.
    pub fn share_of_turn(&self) -> f64 {
        self.rows().map(|cells| count(cells) as f64 / cells.len() as f64).fold(0.0, f64::max)
    }

    /// Share of the turn that is filled in some row.
    pub fn share_in_any_row(&self) -> f64 {
        let columns = self.rows().next().map_or(1, <[bool]>::len);
        let is_filled = |&column: &usize| self.rows().any(|cells| cells[column]);
        (0..columns).filter(is_filled).count().max(1) as f64 / columns as f64
    }
}

fn count(cells: &[bool]) -> usize {
    cells.iter().filter(|&&filled| filled).count()
}
