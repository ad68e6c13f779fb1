//! Connected components of returns.
//!
//! The returns of an angular cell that follow one another in range without a gap form one patch of a surface.
//! Patches of neighbouring cells are connected if the distance between them is less than a gap that grows with the
//! distance of neighbouring rays (it plays the part of the angle in Bogoslavskyi and Stachniss, 2016).
//!
//! Angular cells are rings if the sweep has any, and otherwise rows of a width that suits its density.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use geometry::angles::{azimuth, elevation};
use nalgebra::Vector3;

use super::SegmentationConfig;
use crate::spherical::rings::{BIN, FilledCells, MIN_RETURNS, Ring, rings};

/// Number of cells across which patches are connected: upwards, and to either side.
const REACH: (usize, isize) = (2, 3);

/// Components of some of the points, identified by their first point.
pub(super) fn find(
    points: &[Vector3<f64>],
    members: &[usize],
    config: &SegmentationConfig,
) -> Vec<Vec<usize>> {
    if members.is_empty() {
        return Vec::new();
    }
    let directions: Vec<BeamDirection> = points.iter().map(BeamDirection::of).collect();
    let places = members.iter().map(|&member| (directions[member], points[member].norm())).collect();
    let patches = Patches::of(Scan::of(&directions), places, config);
    let mut sets = DisjointSets::new(patches.patches.len());
    for row in 0..patches.scan.rows.len() {
        for column in 0..patches.scan.rows[row].columns {
            patches.connect((row, column), config, &mut sets);
        }
    }
    let mut component_of_root = vec![usize::MAX; patches.patches.len()];
    let mut components: Vec<Vec<usize>> = Vec::new();
    for (&member, &patch) in members.iter().zip(&patches.of_member) {
        let component = &mut component_of_root[sets.root(patch)];
        if *component == usize::MAX {
            *component = components.len();
            components.push(Vec::new());
        }
        components[*component].push(member);
    }
    components
}

/// An interval of range, metres, that returns of one cell fill without a gap.
#[derive(Clone, Copy, Debug)]
struct Patch {
    nearest: f64,
    farthest: f64,
}

struct Patches {
    scan: Scan,
    patches: Vec<Patch>,
    /// Index of the first patch of each cell.
    starts: Vec<usize>,
    of_member: Vec<usize>,
}

impl Patches {
    /// The patches of members with these directions and ranges.
    fn of(scan: Scan, places: Vec<(BeamDirection, f64)>, config: &SegmentationConfig) -> Self {
        let place = |(number, (direction, range)): (usize, (BeamDirection, f64))| {
            let (row, column) = scan.place(&direction);
            // Positive floats sort as their bits do.
            ((scan.rows[row].first + column) as u32, (range as f32).to_bits(), number as u32, row as u32)
        };
        let mut placed: Vec<(u32, u32, u32, u32)> = places.into_iter().enumerate().map(place).collect();
        placed.sort_unstable_by_key(|&(cell, range, number, _)| {
            (u64::from(cell) << 32 | u64::from(range), number)
        });
        let mut starts = vec![0; scan.num_cells() + 1];
        let mut patches: Vec<Patch> = Vec::new();
        let mut of_member = vec![0; placed.len()];
        let mut last_cell = u32::MAX;
        for (cell, range, number, row) in placed {
            let range = f64::from(f32::from_bits(range));
            let gap = config.gap(range, scan.rows[row as usize].spacing);
            match patches.last_mut().filter(|patch| cell == last_cell && range - patch.farthest <= gap) {
                Some(patch) => patch.farthest = range,
                None => {
                    patches.push(Patch { nearest: range, farthest: range });
                    starts[cell as usize + 1] += 1;
                }
            }
            last_cell = cell;
            of_member[number as usize] = patches.len() - 1;
        }
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        Self { scan, patches, starts, of_member }
    }

    fn at(&self, row: &Row, column: usize) -> std::ops::Range<usize> {
        self.starts[row.first + column]..self.starts[row.first + column + 1]
    }

    /// Connects a cell's patches to those of cells to the right and above.
    fn connect(&self, (row, column): (usize, usize), config: &SegmentationConfig, sets: &mut DisjointSets) {
        let rows = &self.scan.rows;
        let here = self.at(&rows[row], column);
        if here.is_empty() {
            return;
        }
        let below = rows[row.saturating_sub(1)].elevation;
        for other in row..=(row + REACH.0).min(rows.len() - 1) {
            // The sparser side of unevenly spaced rings decides what is near.
            let height = rows[other].elevation - rows[row].elevation;
            let rays = if other == row {
                rows[row].spacing
            } else {
                (height / (other - row) as f64).max(rows[row].elevation - below).max(rows[row].spacing)
            };
            let columns = rows[other].columns;
            let opposite = (2 * column + 1) * columns / (2 * rows[row].columns);
            for offset in if other == row { 1..=REACH.1 } else { -REACH.1..=REACH.1 } {
                let there = self.at(&rows[other], wrapped(opposite as isize + offset, columns));
                if !there.is_empty() {
                    let angle = height.hypot(offset as f64 * rows[row].spacing);
                    self.connect_patches(here.clone(), there, (angle, rays), config, sets);
                }
            }
        }
    }

    fn connect_patches(
        &self,
        here: std::ops::Range<usize>,
        there: std::ops::Range<usize>,
        (angle, rays): (f64, f64),
        config: &SegmentationConfig,
        sets: &mut DisjointSets,
    ) {
        for a in here {
            for b in there.clone() {
                let (one, other) = (&self.patches[a], &self.patches[b]);
                let apart = (one.nearest - other.farthest).max(other.nearest - one.farthest).max(0.0);
                let range = one.nearest.min(other.nearest);
                if apart.hypot(range * angle) <= config.gap(range, rays) {
                    sets.join(a, b);
                }
            }
        }
    }
}

/// Wraps a column that is less than a turn outside the grid.
fn wrapped(column: isize, columns: usize) -> usize {
    let columns = columns as isize;
    let inside = if column < 0 { column + columns } else { column };
    (if inside >= columns { inside - columns } else { inside }).clamp(0, columns - 1) as usize
}

/// Disjoint sets of numbers.
struct DisjointSets(Vec<usize>);

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn root(&mut self, mut number: usize) -> usize {
        while self.0[number] != number {
            self.0[number] = self.0[self.0[number]];
            number = self.0[number];
        }
        number
    }

    /// The smaller root stays, so that the result does not depend on the order of joining.
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}

/// Number of elevation bins over the half-turn.
const NUM_BINS: usize = (PI / BIN) as usize + 1;
/// Smallest number of empty bins between rings.
const MIN_GAP_BINS: usize = 3;
/// Number of returns per cell if there are no rings.
const RETURNS_PER_CELL: f64 = 2.0;
/// Limits of a cell, radians.
const MIN_CELL: f64 = 1e-3;
const MAX_CELL: f64 = 0.06;
/// Size of the cells that measure which part of the sphere a sweep fills, radians.
const COARSE: f64 = PI / 90.0;

/// Angles of a point about the LiDAR's z axis, radians.
#[derive(Clone, Copy, Debug)]
pub(super) struct BeamDirection {
    azimuth: f64,
    elevation: f64,
}

impl BeamDirection {
    pub(super) fn of(point: &Vector3<f64>) -> Self {
        Self { azimuth: azimuth(point), elevation: elevation(point) }
    }
}

/// A row of cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Elevation, radians.
    pub(super) elevation: f64,
    pub(super) columns: usize,
    /// Angle between neighbouring columns, radians of arc.
    pub(super) spacing: f64,
    /// Index of the row's first cell.
    pub(super) first: usize,
}

#[derive(Clone, Debug)]
pub(super) struct Scan {
    /// Rows from the lowest to the highest.
    pub(super) rows: Vec<Row>,
    /// The row of each bin of elevation.
    row_of_bin: Vec<u16>,
}

impl Scan {
    /// Chooses cells that suit a sweep of these directions.
    pub(super) fn of(directions: &[BeamDirection]) -> Self {
        let mut counts = vec![0u32; NUM_BINS];
        directions.iter().for_each(|direction| counts[bin(direction.elevation)] += 1);
        let cells = directions.iter().map(|ray| FilledCells::cell(COARSE, ray.azimuth, ray.elevation));
        let filled = FilledCells::with(COARSE, cells);
        let rings = rings(&counts, MIN_GAP_BINS);
        if !rings.is_empty() && directions.len() >= MIN_RETURNS * rings.len() {
            Self::of_rings(&rings, filled.share_in_any_row())
        } else {
            let cell = (RETURNS_PER_CELL * filled.solid_angle() / directions.len() as f64).sqrt();
            Self::of_squares(cell.clamp(MIN_CELL, MAX_CELL))
        }
    }

    /// Rows with borders half-way between rings.
    fn of_rings(rings: &[Ring], share_of_turn: f64) -> Self {
        let mut returns: Vec<u32> = rings.iter().map(|ring| ring.returns).collect();
        returns.sort_unstable();
        // Rings into the sky have few returns; the fullest ones show the number of firings per turn.
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

    pub(super) fn num_cells(&self) -> usize {
        self.rows.last().map_or(0, |row| row.first + row.columns)
    }

    pub(super) fn place(&self, direction: &BeamDirection) -> (usize, usize) {
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
