//! Range images in the form that networks for sweeps need, and the transfer of their pixels back to points.

use std::f64::consts::TAU;

use geometry::angles::{azimuth, elevation};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::label_image::NO_ID;
use crate::point_cloud::to_f64;
use crate::spherical::nearest;

/// Index of a pixel without a point, or of a point without a pixel.
pub use crate::spherical::EMPTY;

const MAX_PIXELS: usize = 1 << 24;
/// Largest side of the window in which neighbours are searched.
const MAX_SEARCH: usize = 31;

/// A range image: rows from top to bottom, columns from left to right. Angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeView {
    pub rows: usize,
    pub columns: usize,
    pub up: f64,
    pub down: f64,
    /// Azimuth of the left border, which is larger than that of the right one.
    pub left: f64,
    pub right: f64,
    /// Whether points above and below are clamped to the outermost rows, as in RangeNet++; otherwise they are left
    /// out.
    pub clamps: bool,
}

/// The points of a sweep in a range image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RangeProjection {
    /// The nearest point of each pixel, or [`EMPTY`].
    pub points: Vec<u32>,
    /// The pixel of each point, or [`EMPTY`].
    pub pixels: Vec<u32>,
}

/// Nearest-neighbour voting for the class of a point: Milioto et al., RangeNet++, 2019, algorithm 1. The fields are
/// those of `NeighborsConfig` in Python, which documents them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbors {
    pub count: usize,
    pub search: usize,
    pub sigma_px: f64,
    pub max_difference_m: f64,
}

impl RangeView {
    /// Checks the numbers.
    pub fn check(&self) -> Result<()> {
        let pixels = self.rows.checked_mul(self.columns).filter(|&n| (1..=MAX_PIXELS).contains(&n));
        let (around, high) = (self.left - self.right, self.up - self.down);
        let is_field = high > 0.0 && high.is_finite() && around > 0.0 && around <= TAU + 1e-9;
        if pixels.is_none() || !is_field {
            return Err(Error::Input(format!(
                "range image: found {} x {} pixels from {:.3} to {:.3} radians up and {:.3} to {:.3} around, needed \
                 1 to {MAX_PIXELS} pixels, the upper border above the lower, and the left one up to a turn left of the \
                 right",
                self.rows, self.columns, self.down, self.up, self.left, self.right
            )));
        }
        Ok(())
    }

    /// Whether the right border coincides with the left one after a full turn.
    fn is_round(&self) -> bool {
        self.left - self.right > TAU - 1e-6
    }

    /// Projects the points of a sweep. Each pixel keeps its nearest point, the first in a tie. With `rings`, a
    /// point's row is its ring, and row 0 is the first.
    pub fn project(&self, points: &[[f32; 3]], rings: Option<&[u16]>) -> RangeProjection {
        let pixel = |index: usize| {
            let ring = rings.map(|rings| usize::from(rings[index]));
            self.pixel(&points[index], ring).unwrap_or(EMPTY)
        };
        let pixels: Vec<u32> = (0..points.len()).into_par_iter().map(pixel).collect();
        let seen = pixels.iter().map(|&pixel| (pixel != EMPTY).then_some(pixel as usize));
        RangeProjection { points: nearest(points, seen, self.rows * self.columns), pixels }
    }

    fn pixel(&self, point: &[f32; 3], ring: Option<usize>) -> Option<u32> {
        let direction = to_f64(point);
        let range = direction.norm();
        if !(range > 0.0 && range.is_finite()) {
            return None;
        }
        let down = match ring {
            Some(ring) => ring as f64 / self.rows as f64,
            None => (self.up - elevation(&direction)) / (self.up - self.down),
        };
        // Angle to the right of the left border, less than a turn.
        let aside = (self.left - azimuth(&direction)).rem_euclid(TAU);
        let across = aside / (self.left - self.right);
        if ring.is_none() && !self.clamps && !(0.0..1.0).contains(&down)
            || ring.is_some_and(|ring| ring >= self.rows)
        {
            return None;
        }
        if !self.is_round() && across >= 1.0 {
            return None;
        }
        let row = ((down * self.rows as f64).max(0.0) as usize).min(self.rows - 1);
        let column = ((across * self.columns as f64) as usize).min(self.columns - 1);
        Some((row * self.columns + column) as u32)
    }

    /// Transfers the classes of pixels back to points. Each point gets the majority class of its nearest
    /// neighbours, by range, among the pixels around its own; the lowest class in a tie. Pixels of `NO_ID` do not
    /// vote.
    pub fn carry_back(
        &self,
        projection: &RangeProjection,
        points: &[[f32; 3]],
        classes: &[u16],
        neighbors: &Neighbors,
    ) -> Result<Vec<u16>> {
        let Neighbors { count, search, .. } = *neighbors;
        if search % 2 == 0 || search > MAX_SEARCH || count == 0 {
            return Err(Error::Input(format!(
                "neighbors: found {count} in a window of {search}, needed at least 1 and an odd window up to {MAX_SEARCH}"
            )));
        }
        let ranges: Vec<f64> = points.par_iter().map(|point| to_f64(point).norm()).collect();
        let distance_factors = distance_factors(search, neighbors.sigma_px);
        let class = |index: usize, near: &mut Vec<(f64, u16)>| {
            let pixel = projection.pixels[index];
            if pixel == EMPTY {
                return NO_ID;
            }
            near.clear();
            self.around(pixel as usize, search, |place, other| {
                let point = projection.points[other];
                if point == EMPTY || classes[other] == NO_ID {
                    return;
                }
                // A point counts in its own pixel, even if a nearer point occludes it there.
                let is_own = other == pixel as usize;
                let difference = if is_own { 0.0 } else { (ranges[point as usize] - ranges[index]).abs() };
                near.push((difference * distance_factors[place], classes[other]));
            });
            vote(near, count, neighbors.max_difference_m)
        };
        Ok((0..points.len()).into_par_iter().map_init(Vec::new, |near, index| class(index, near)).collect())
    }

    /// Visits the pixels of a window around a pixel, with their places in it. Columns wrap around a full turn.
    fn around(&self, pixel: usize, search: usize, mut visit: impl FnMut(usize, usize)) {
        let (row, column, half) = (pixel / self.columns, pixel % self.columns, search / 2);
        for place in 0..search * search {
            let (down, across) = (row + place / search, column + place % search);
            if !(half..self.rows + half).contains(&down) {
                continue;
            }
            let is_inside = (half..self.columns + half).contains(&across);
            if is_inside || self.is_round() && search <= self.columns {
                let other = (across + self.columns - half) % self.columns;
                visit(place, (down - half) * self.columns + other);
            }
        }
    }
}

/// Factors on the distance of the pixels of a window: one minus a Gaussian with sum one.
fn distance_factors(search: usize, sigma_px: f64) -> Vec<f64> {
    let middle = (search / 2) as f64;
    let height = |place: usize| {
        let (y, x) = ((place / search) as f64 - middle, (place % search) as f64 - middle);
        (-(x * x + y * y) / (2.0 * sigma_px * sigma_px)).exp()
    };
    let heights: Vec<f64> = (0..search * search).map(height).collect();
    let sum: f64 = heights.iter().sum();
    heights.into_iter().map(|height| 1.0 - height / sum).collect()
}

/// The majority class of the nearest, the lowest in a tie.
fn vote(near: &mut [(f64, u16)], count: usize, max_difference_m: f64) -> u16 {
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let is_near = |(difference, _): &&(f64, u16)| *difference <= max_difference_m;
    let valid = near.iter().take(count).take_while(is_near).count();
    let voting = &mut near[..valid];
    voting.sort_by_key(|(_, class)| *class);
    let mut best = (0, NO_ID);
    for same in voting.chunk_by(|a, b| a.1 == b.1) {
        if same.len() > best.0 {
            best = (same.len(), same[0].1);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use geometry::angles::from_angles;

    const NEAREST: Neighbors = Neighbors { count: 5, search: 5, sigma_px: 1.0, max_difference_m: 1.0 };

    fn round() -> RangeView {
        RangeView { rows: 4, columns: 8, up: 0.4, down: -0.4, left: PI, right: -PI, clamps: true }
    }

    fn at(azimuth: f64, elevation: f64, range: f64) -> [f32; 3] {
        let point = from_angles(azimuth, elevation) * range;
        [point.x as f32, point.y as f32, point.z as f32]
    }

    #[test]
    fn columns_run_to_the_right_and_rows_down() {
        let points =
            [at(3.1, 0.39, 5.0), at(0.1, 0.1, 5.0), at(-3.1, -0.39, 5.0), at(0.0, 1.2, 5.0), [0.0; 3]];
        assert_eq!(round().project(&points, None).pixels, [0, 8 + 3, 24 + 7, 4, EMPTY]);
        let strict = RangeView { clamps: false, ..round() };
        assert_eq!(strict.project(&points, None).pixels[3], EMPTY);
        let front = RangeView { left: 0.8, right: -0.8, ..round() };
        assert_eq!(front.project(&points, None).pixels, [EMPTY, 8 + 3, EMPTY, 4, EMPTY]);
        assert_eq!(round().project(&points, Some(&[3, 3, 0, 4, 0])).pixels, [24, 24 + 3, 7, EMPTY, EMPTY]);
    }

    #[test]
    fn a_hidden_point_takes_the_class_of_what_is_as_far_away() {
        let view = RangeView { rows: 4, columns: 64, ..round() };
        // A near post occludes a wall; the wall's pixels are to the left and to the right.
        let wall = |azimuth: f64| at(azimuth, 0.05, 20.0);
        let points = [at(0.05, 0.05, 4.0), wall(0.05), wall(0.15), wall(0.25), wall(-0.05), wall(-0.15)];
        let projection = view.project(&points, None);
        let mut classes = vec![NO_ID; 4 * 64];
        for (index, &pixel) in projection.pixels.iter().enumerate() {
            if projection.points[pixel as usize] == index as u32 {
                classes[pixel as usize] = if index == 0 { 7 } else { 2 };
            }
        }
        assert_eq!(
            view.carry_back(&projection, &points, &classes, &NEAREST).expect("valid"),
            [7, 2, 2, 2, 2, 2]
        );
    }
}
