//! Connected components of returns.
//!
//! The returns of an angular cell that follow one another in range without a gap are one patch of a surface. Patches of
//! neighbouring cells are connected where the distance between them is less than a gap that grows with the distance of
//! neighbouring rays (its part is that of the angle in Bogoslavskyi and Stachniss, 2016).

use nalgebra::Vector3;

use super::config::SegmentationConfig;
use super::scan::{Direction, Row, Scan};

/// Cells across which patches are connected: up, and to either side.
const REACH: (usize, isize) = (2, 3);

/// The components of some of the points, by their first point.
pub(super) fn find(
    points: &[Vector3<f64>],
    members: &[usize],
    config: &SegmentationConfig,
) -> Vec<Vec<usize>> {
    if members.is_empty() {
        return Vec::new();
    }
    let directions: Vec<Direction> = points.iter().map(Direction::of).collect();
    let places = members.iter().map(|&member| (directions[member], points[member].norm())).collect();
    let patches = Patches::of(Scan::of(&directions), places, config);
    let mut sets = Sets::new(patches.patches.len());
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

/// Ranges, metres, that returns of one cell fill without a gap.
#[derive(Clone, Copy, Debug)]
struct Patch {
    nearest: f64,
    farthest: f64,
}

struct Patches {
    scan: Scan,
    /// By cell, then by range.
    patches: Vec<Patch>,
    /// The first patch of each cell.
    starts: Vec<usize>,
    of_member: Vec<usize>,
}

impl Patches {
    /// Those of members with these directions and ranges.
    fn of(scan: Scan, places: Vec<(Direction, f64)>, config: &SegmentationConfig) -> Self {
        let place = |(number, (direction, range)): (usize, (Direction, f64))| {
            let (row, column) = scan.place(&direction);
            // Positive numbers sort as their bits do.
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

    /// The numbers of a cell's patches.
    fn at(&self, row: &Row, column: usize) -> std::ops::Range<usize> {
        self.starts[row.first + column]..self.starts[row.first + column + 1]
    }

    /// Connects a cell's patches with those of cells to the right and above.
    fn connect(&self, (row, column): (usize, usize), config: &SegmentationConfig, sets: &mut Sets) {
        let rows = &self.scan.rows;
        let here = self.at(&rows[row], column);
        if here.is_empty() {
            return;
        }
        let below = rows[row.saturating_sub(1)].elevation;
        for other in row..=(row + REACH.0).min(rows.len() - 1) {
            // The sparser side of unevenly spaced rings tells what is near.
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
        sets: &mut Sets,
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

/// A column less than a turn outside of the first or the last one.
fn wrapped(column: isize, columns: usize) -> usize {
    let columns = columns as isize;
    let inside = if column < 0 { column + columns } else { column };
    (if inside >= columns { inside - columns } else { inside }).clamp(0, columns - 1) as usize
}

/// Disjoint sets of numbers.
struct Sets(Vec<usize>);

impl Sets {
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

    /// The smaller root stays, so that no order of joining matters.
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}
