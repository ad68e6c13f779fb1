//! The range image of a sweep in coarse cells, which tells whether sweeps show the same scene from the same place.

use std::f32::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

/// Cells of directions, of 2 degrees each: around the z axis, and from straight down to straight up.
const COLUMNS: usize = 180;
const ROWS: usize = 90;
/// Number of points of a sweep that are used, or up to twice as many.
const MAX_POINTS: usize = 30_000;
/// Largest difference of two ranges that count as the same: metres, plus a share of the range.
const SAME_RANGE_M: f32 = 0.05;
const SAME_RANGE: f32 = 0.01;
/// Points whose cells are computed together, so that the compiler uses vector instructions.
const LANES: usize = 64;

/// Range of the nearest point in each cell of directions, metres; infinite without one.
#[derive(Clone, Debug, PartialEq)]
pub struct NearestRanges(Vec<f32>);

impl Default for NearestRanges {
    fn default() -> Self {
        Self(vec![f32::INFINITY; ROWS * COLUMNS])
    }
}

impl NearestRanges {
    /// Computes the ranges of a sweep, metres, seen from the origin.
    pub fn of(points: &[[f32; 3]]) -> Self {
        let step = (points.len() / MAX_POINTS).max(1);
        let mut nearest = Self::default();
        nearest.set(&points.iter().step_by(step).copied().collect::<Vec<_>>(), [0.0; 3]);
        nearest
    }

    /// Replaces the ranges by those of points seen from a place, metres.
    pub fn set(&mut self, points: &[[f32; 3]], from: [f32; 3]) {
        self.0.fill(f32::INFINITY);
        for points in points.chunks(LANES) {
            let (mut cells, mut ranges) = ([0; LANES], [0.0; LANES]);
            for ((point, cell), range) in points.iter().zip(&mut cells).zip(&mut ranges) {
                let [x, y, z] = std::array::from_fn(|axis| point[axis] - from[axis]);
                (*cell, *range) = cell_and_range(x, y, z);
            }
            for (&cell, &range) in cells.iter().zip(&ranges).take(points.len()) {
                let nearest = &mut self.0[cell as usize];
                *nearest = nearest.min(range);
            }
        }
    }

    /// The share of the directions seen in either sweep that have the same range in both.
    pub fn share_alike(&self, other: &Self) -> f64 {
        let (mut num_alike, mut num_seen) = (0_u32, 0_u32);
        for (&own, &other) in self.0.iter().zip(&other.0) {
            let nearer = own.min(other);
            // The difference of two infinite ranges is NaN, which compares false.
            num_alike += u32::from((own - other).abs() < SAME_RANGE_M + SAME_RANGE * nearer);
            num_seen += u32::from(nearer.is_finite());
        }
        f64::from(num_alike) / f64::from(num_seen.max(1))
    }
}

/// [`NearestRanges::share_alike`] of each two of a drive's sweeps, row by row.
pub fn shares_alike(sweeps: &[&NearestRanges]) -> Vec<f64> {
    // A LiDAR looks neither up nor down: most cells have no point in any sweep.
    let seen: Vec<usize> =
        (0..ROWS * COLUMNS).filter(|&cell| sweeps.iter().any(|sweep| sweep.0[cell].is_finite())).collect();
    let sweeps: Vec<NearestRanges> =
        sweeps.iter().map(|sweep| NearestRanges(seen.iter().map(|&cell| sweep.0[cell]).collect())).collect();
    let below: Vec<Vec<f64>> = (0..sweeps.len())
        .into_par_iter()
        .map(|row| sweeps[..=row].iter().map(|other| sweeps[row].share_alike(other)).collect())
        .collect();
    let count = sweeps.len();
    (0..count * count).map(|k| (k / count, k % count)).map(|(i, j)| below[i.max(j)][i.min(j)]).collect()
}

fn cell_and_range(x: f32, y: f32, z: f32) -> (u32, f32) {
    let flat = (x * x + y * y).sqrt();
    let column = (angle(x, y) / (2.0 * PI) + 0.5) * COLUMNS as f32;
    let row = (angle(flat, z) / PI + 0.5) * ROWS as f32;
    let (column, row) = ((column as u32).min(COLUMNS as u32 - 1), (row as u32).min(ROWS as u32 - 1));
    (row * COLUMNS as u32 + column, (flat * flat + z * z).sqrt())
}

/// The angle of (x, y) from the x axis, radians, to 1e-5 (Hastings; Abramowitz and Stegun, 4.4.47).
fn angle(x: f32, y: f32) -> f32 {
    let (along, across) = (x.abs(), y.abs());
    let tangent = along.min(across) / along.max(across).max(f32::MIN_POSITIVE);
    let square = tangent * tangent;
    let series = [0.180_141, -0.330_299_5, 0.999_866]
        .into_iter()
        .fold(0.020_835_1 * square - 0.085_133, |sum, factor| sum * square + factor);
    let of_octant = tangent * series;
    let of_quadrant = if across > along { FRAC_PI_2 - of_octant } else { of_octant };
    let of_half = if x < 0.0 { PI - of_quadrant } else { of_quadrant };
    of_half.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_library_within_a_thousandth_of_a_cell() {
        for number in 0..36_000 {
            let (y, x) = (number as f32 * 1e-2).to_radians().sin_cos();
            let difference = (angle(3.0 * x, 3.0 * y) - y.atan2(x)).abs();
            assert!(difference.min(2.0 * PI - difference) < 3e-5, "{number}: {difference}");
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
    }

    #[test]
    fn points_in_all_directions_fill_all_cells() {
        let directions = (0..ROWS * COLUMNS).map(|cell| {
            let azimuth = ((cell % COLUMNS) as f32 + 0.5) / COLUMNS as f32 * 2.0 * PI - PI;
            let elevation = ((cell / COLUMNS) as f32 + 0.5) / ROWS as f32 * PI - FRAC_PI_2;
            [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()]
        });
        let nearest = NearestRanges::of(&directions.collect::<Vec<_>>());
        assert!(nearest.0.iter().all(|&range| (range - 1.0).abs() < 1e-5));
    }

    #[test]
    fn a_sweep_is_alike_itself_and_unlike_what_it_does_not_see() {
        let [near, far, other] = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let sweeps: Vec<_> =
            [vec![near, far], vec![near, other], vec![]].iter().map(|s| NearestRanges::of(s)).collect();
        assert_eq!(
            shares_alike(&sweeps.iter().collect::<Vec<_>>()),
            [1.0, 0.5, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0]
        );
    }
}
