//! Lines of sight: where the rays of a LiDAR end beside points, before them, at them or beyond them.
//!
//! A ray that passes beyond a point shows that nothing was there when it was fired. Rays that end before a point on all
//! sides of it hide it. A straight border that passes beside a point leaves one of its four quadrants free.

use std::cmp::Ordering;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use geometry::angles::{azimuth, elevation};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::point_cloud::to_f64;

/// Number of points that one task compares.
const CHUNK: usize = 1024;

/// Which rays lie beside a point, and which ranges are the same.
#[derive(Clone, Copy, Debug)]
pub struct Beside {
    /// Largest angle between a ray and the direction of a point, radians.
    pub angle: f64,
    /// Largest number of rays that are compared with a point: the nearest ones.
    pub max_rays: usize,
    /// Largest difference of two ranges that are the same, metres.
    pub same_m: f64,
    /// Share of a point's range that is added to this difference.
    pub same_share: f64,
}

/// Counts the rays beside each point that end before it, at it and beyond it, and its quadrants in which rays end before
/// it.
///
/// Rays and points are vectors from one origin, metres. Those without a direction count for nothing.
pub fn count_beside(rays: &[[f32; 3]], points: &[[f32; 3]], beside: &Beside) -> Vec<[u16; 4]> {
    let grid = Grid::of(rays, beside.angle);
    points
        .par_iter()
        .with_min_len(CHUNK)
        .map_init(Vec::new, |near, point| grid.count(&to_f64(point), beside, near))
        .collect()
}

#[derive(Clone, Copy, Debug)]
struct Ray {
    direction: Vector3<f64>,
    range: f64,
}

impl Ray {
    fn of(point: &Vector3<f64>) -> Option<Self> {
        let range = point.norm();
        (range.is_finite() && range > 0.0).then(|| Self { direction: point / range, range })
    }
}

/// A ray beside a point.
struct Near {
    /// Squared chord from the direction of the point.
    apart2: f64,
    range: f64,
    direction: Vector3<f64>,
}

/// Rays by the cells of their directions, in rows of one elevation whose cells are at least as wide as they are high.
struct Grid {
    /// Height of a row, radians.
    height: f64,
    /// First cell of each row, and the number of cells at the end.
    rows: Vec<usize>,
    /// First ray of each cell, and the number of rays at the end.
    cells: Vec<usize>,
    /// Rays in the order of their cells.
    rays: Vec<Ray>,
}

impl Grid {
    fn of(points: &[[f32; 3]], height: f64) -> Self {
        let num_rows = (PI / height).floor().max(1.0) as usize;
        let height = PI / num_rows as f64;
        let mut rows = vec![0];
        for row in 0..num_rows {
            let ends = [row, row + 1].map(|edge| (edge as f64 * height - FRAC_PI_2).cos());
            let width = TAU * ends[0].min(ends[1]);
            rows.push(rows[row] + ((width / height).floor() as usize).max(1));
        }
        let mut grid = Self { height, rows, cells: vec![], rays: vec![] };
        let mut placed: Vec<(usize, Ray)> = points
            .iter()
            .filter_map(|point| Ray::of(&to_f64(point)))
            .map(|ray| (grid.cell(&ray.direction), ray))
            .collect();
        placed.sort_by_key(|(cell, _)| *cell);
        grid.cells = vec![0; grid.rows[num_rows] + 1];
        for (cell, _) in &placed {
            grid.cells[cell + 1] += 1;
        }
        for cell in 1..grid.cells.len() {
            grid.cells[cell] += grid.cells[cell - 1];
        }
        grid.rays = placed.into_iter().map(|(_, ray)| ray).collect();
        grid
    }

    fn row(&self, elevation: f64) -> usize {
        let row = ((elevation + FRAC_PI_2) / self.height).floor().max(0.0) as usize;
        row.min(self.rows.len() - 2)
    }

    fn cell(&self, direction: &Vector3<f64>) -> usize {
        let row = self.row(elevation(direction));
        let width = self.rows[row + 1] - self.rows[row];
        let turn = (azimuth(direction) / TAU).rem_euclid(1.0);
        self.rows[row] + ((turn * width as f64) as usize).min(width - 1)
    }

    /// Counts the nearest rays beside a point by where they end; `near` is memory to use again.
    fn count(&self, point: &Vector3<f64>, beside: &Beside, near: &mut Vec<Near>) -> [u16; 4] {
        near.clear();
        let Some(Ray { direction, range }) = Ray::of(point) else { return [0; 4] };
        // A chord is exact where the cosine of a small angle is not.
        let chord2 = (2.0 * (0.5 * beside.angle).sin()).powi(2);
        for cell in self.cells_beside(&direction, beside.angle) {
            for ray in &self.rays[self.cells[cell]..self.cells[cell + 1]] {
                let apart2 = (ray.direction - direction).norm_squared();
                if apart2 <= chord2 {
                    near.push(Near { apart2, range: ray.range, direction: ray.direction });
                }
            }
        }
        if near.len() > beside.max_rays {
            let by_angle = |a: &Near, b: &Near| {
                let order = a.apart2.partial_cmp(&b.apart2).unwrap_or(Ordering::Equal);
                order.then(a.range.partial_cmp(&b.range).unwrap_or(Ordering::Equal))
            };
            near.select_nth_unstable_by(beside.max_rays, by_angle);
            near.truncate(beside.max_rays);
        }
        let same_m = beside.same_m + beside.same_share * range;
        let (mut counts, mut quadrants) = ([0u16; 4], 0u8);
        for ray in near.iter() {
            let end = if ray.range - range > same_m { 2 } else { usize::from(range - ray.range <= same_m) };
            counts[end] = counts[end].saturating_add(1);
            if end == 0 {
                let is_left = direction.x * ray.direction.y > direction.y * ray.direction.x;
                let is_above = ray.direction.z > direction.z;
                quadrants |= 1 << (2 * u8::from(is_left) + u8::from(is_above));
            }
        }
        counts[3] = quadrants.count_ones() as u16;
        counts
    }

    /// The cells that hold all directions within an angle of one.
    fn cells_beside(&self, direction: &Vector3<f64>, angle: f64) -> impl Iterator<Item = usize> {
        let at = elevation(direction);
        let turn = azimuth(direction) / TAU;
        // Azimuths differ most where a meridian touches the circle around the direction.
        let (sine, cosine) = (angle.sin(), at.cos());
        let reach = if sine < cosine { (sine / cosine).asin() / TAU } else { 0.5 };
        (self.row(at - angle)..=self.row(at + angle)).flat_map(move |row| {
            let (first, width) = (self.rows[row], self.rows[row + 1] - self.rows[row]);
            let from = ((turn - reach) * width as f64).floor() as i64;
            let to = ((turn + reach) * width as f64).floor() as i64;
            let count = (to - from + 1).min(width as i64);
            (from..from + count).map(move |column| first + column.rem_euclid(width as i64) as usize)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::angles::from_angles;

    const BESIDE: Beside = Beside { angle: 0.02, max_rays: 1000, same_m: 0.2, same_share: 0.01 };

    fn points(directions: &[Vector3<f64>], range: impl Fn(usize) -> f64) -> Vec<[f32; 3]> {
        let scaled = directions.iter().enumerate().map(|(i, direction)| direction * range(i));
        scaled.map(|point| point.cast::<f32>().into()).collect()
    }

    /// Directions all over the sphere, evenly, also at the poles and where azimuths begin anew.
    fn sphere(count: usize) -> Vec<Vector3<f64>> {
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        (0..count)
            .map(|i| {
                let sine = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
                from_angles(TAU * (golden * i as f64).fract(), sine.asin())
            })
            .collect()
    }

    #[test]
    fn the_grid_finds_the_rays_that_a_search_of_all_finds() {
        let (rays, queries) = (sphere(20_000), sphere(777));
        let range = |i: usize| [5.0, 10.0, 20.0][i % 3];
        let counts = count_beside(&points(&rays, range), &points(&queries, |_| 10.0), &BESIDE);
        for (direction, counts) in queries.iter().zip(counts) {
            let mut expected = [0; 3];
            for (i, ray) in rays.iter().enumerate() {
                expected[i % 3] += u16::from(ray.angle(direction) <= BESIDE.angle);
            }
            assert_eq!(counts[..3], expected);
        }
    }

    #[test]
    fn only_the_nearest_rays_count() {
        let rays = [0.001, 0.002, 0.003].map(|azimuth| from_angles(azimuth, 0.0));
        let rays = points(&rays, |i| [10.0, 20.0, 5.0][i]);
        let two = Beside { max_rays: 2, ..BESIDE };
        assert_eq!(
            count_beside(&rays, &[[10.0, 0.0, 0.0], [0.0; 3], [f32::NAN; 3]], &two),
            [[0, 1, 1, 0], [0; 4], [0; 4]]
        );
    }

    #[test]
    fn a_straight_border_leaves_a_quadrant_free() {
        let rays = sphere(200_000);
        let tilted = Vector3::new(0.1, 1.0, 0.7);
        let wall: Vec<_> = rays.into_iter().filter(|ray| ray.dot(&tilted) > 0.0).collect();
        let wall = points(&wall, |_| 5.0);
        let behind = |azimuth: f64| points(&[from_angles(azimuth, 0.3)], |_| 10.0);
        let quadrants = |azimuth: f64| count_beside(&wall, &behind(azimuth), &BESIDE)[0][3];
        let border = -(0.7 * 0.3_f64.tan() / 1.01_f64.sqrt()).asin() - 0.1_f64.atan();
        assert_eq!(quadrants(border + 0.01), 4);
        assert!((1..4).contains(&quadrants(border - 0.001)));
        assert_eq!(quadrants(border - 0.05), 0);
    }
}
