//! Neighbours at about the same elevation, for points in any order.

use std::cmp::Ordering;
use std::f64::consts::{FRAC_PI_2, TAU};

use geometry::angles::wrapped;
use rayon::prelude::*;

use super::rays::{HEIGHT_TOLERANCE, MIN_ANGLE, Neighbour, REACH, Ray, SLOPE, Sides};

/// Height of the rows used to look up neighbours, radians.
const ROW: f64 = 1e-3;
/// Number of rays that are tried before all of a row are searched.
const AHEAD: usize = 8;

/// Sorts the rays by row and azimuth, and finds the neighbours of each.
pub fn neighbours(rays: Vec<Ray>) -> (Vec<Ray>, Vec<Sides>) {
    let rays = Rays::of(rays);
    let neighbours = rays.neighbours();
    (rays.sorted, neighbours)
}

/// All rays with returns, by row and azimuth.
struct Rays {
    sorted: Vec<Ray>,
    /// Index of the first ray of each row, and the end.
    starts: Vec<usize>,
}

impl Rays {
    fn of(mut rays: Vec<Ray>) -> Self {
        rays.sort_unstable_by(|a, b| {
            let by_azimuth = || a.azimuth.partial_cmp(&b.azimuth).unwrap_or(Ordering::Equal);
            row(a.elevation).cmp(&row(b.elevation)).then_with(by_azimuth).then(a.index.cmp(&b.index))
        });
        let num_rows = row(FRAC_PI_2) + 1;
        let mut starts = vec![0; num_rows + 1];
        rays.iter().for_each(|ray| starts[row(ray.elevation) + 1] += 1);
        (0..num_rows).for_each(|row| starts[row + 1] += starts[row]);
        Self { sorted: rays, starts }
    }

    /// Neighbours of each ray towards larger azimuths, and towards smaller ones.
    fn neighbours(&self) -> Vec<Sides> {
        let of_row = |row: usize| {
            let mut rows = RowsAround::of(self, row);
            self.row(row).iter().map(move |ray| rows.neighbours(ray))
        };
        (0..self.starts.len() - 1).into_par_iter().flat_map_iter(of_row).collect()
    }

    fn row(&self, row: usize) -> &[Ray] {
        &self.sorted[self.starts[row]..self.starts[row + 1]]
    }
}

/// The rows in reach of one row, nearer ones first.
struct RowsAround<'a> {
    rows: Vec<RowAround<'a>>,
}

/// A row in reach, and where in it the search for the last ray began on each side: that for the next ray begins near by.
struct RowAround<'a> {
    rays: &'a [Ray],
    /// Index of the first among the sorted rays.
    start: usize,
    /// Distance, radians of arc, of the nearest neighbour that the row may have.
    nearest: f64,
    begun: [usize; 2],
}

impl<'a> RowsAround<'a> {
    fn of(rays: &'a Rays, own: usize) -> Self {
        let reach = ((HEIGHT_TOLERANCE + SLOPE * REACH) / ROW).ceil() as usize;
        let last = rays.starts.len() - 2;
        let numbers = (0..=reach).flat_map(|away| {
            let below = own.checked_sub(away);
            let above = (away > 0 && own + away <= last).then_some(own + away);
            below.into_iter().chain(above).map(move |row| (away, row))
        });
        let around = |(away, row): (usize, usize)| RowAround {
            rays: rays.row(row),
            start: rays.starts[row],
            nearest: ((away as f64 - 1.0) * ROW - HEIGHT_TOLERANCE) / SLOPE,
            begun: [0; 2],
        };
        Self { rows: numbers.map(around).filter(|row| !row.rays.is_empty()).collect() }
    }

    /// Neighbours of a ray towards larger azimuths, and towards smaller ones.
    fn neighbours(&mut self, ray: &Ray) -> Sides {
        let across = ray.across();
        let mut neighbours = [None, None];
        // A ray of a farther row is at least as far away as that row, so a nearer neighbour rules it out.
        for row in &mut self.rows {
            for (side, nearest_yet) in neighbours.iter_mut().enumerate() {
                let within = nearest_yet.map_or(REACH, |best: Neighbour| best.distance);
                if nearest_yet.is_none() || within >= row.nearest {
                    *nearest_yet = row.neighbour(ray, across, side, within).or(*nearest_yet);
                }
            }
        }
        neighbours
    }
}

impl RowAround<'_> {
    /// Neighbour of a ray on one side, within a distance in radians of arc. At its elevation, azimuths are `across` times
    /// as far apart.
    fn neighbour(&mut self, ray: &Ray, across: f64, side: usize, within: f64) -> Option<Neighbour> {
        let count = self.rays.len();
        let least = MIN_ANGLE / across;
        // Rays nearer than `least` are skipped at once, however many there are.
        let middle = self.first_from(wrapped(ray.azimuth + if side == 0 { least } else { -least }), side);
        for step in 0..count {
            let place = match side {
                0 if middle + step < count => middle + step,
                0 => middle + step - count,
                _ if middle > step => middle - step - 1,
                _ => middle + count - step - 1,
            };
            let other = &self.rays[place];
            let turn = if side == 0 { other.azimuth - ray.azimuth } else { ray.azimuth - other.azimuth };
            let turn = if turn < 0.0 { turn + TAU } else { turn };
            let distance = turn * across;
            // The skipped rays come after a whole turn; round-off puts none of the first there.
            if turn < 0.5 * least || turn > TAU - least || distance > within {
                return None;
            }
            if distance > MIN_ANGLE && ray.is_level_with(other, distance) {
                return Some(Neighbour { at: self.start + place, distance });
            }
        }
        None
    }

    /// Index of the first ray whose azimuth is not smaller, from where the search on this side began before.
    fn first_from(&mut self, azimuth: f64, side: usize) -> usize {
        let begun = &mut self.begun[side];
        let is_before = |ray: &Ray| ray.azimuth < azimuth;
        let ahead = self.rays[*begun..].iter().take(AHEAD).take_while(|ray| is_before(ray)).count();
        let is_near = ahead < AHEAD && (*begun == 0 || is_before(&self.rays[*begun - 1]));
        *begun = if is_near { *begun + ahead } else { self.rays.partition_point(is_before) };
        *begun
    }
}

fn row(elevation: f64) -> usize {
    ((elevation + FRAC_PI_2) / ROW) as usize
}
