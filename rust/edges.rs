//! Edges of a sweep: points beside which, along the scan, the range or the intensity steps.
//!
//! Rays are compared with their neighbours of direction, to the left and to the right at about the same elevation, so
//! that a pattern needs no rings and points may come in any order. Of two surfaces only the nearer one has an edge: the
//! other goes on behind it. Comparing along the scan follows Levinson and Thrun, *Automatic Online Calibration of Cameras
//! and Lasers* (RSS 2013), who take steps in range within a ring against edges of images.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::point_cloud::to_f64;
use crate::segmentation::is_return;
use crate::spherical::{azimuth, elevation, from_angles};

/// Height of the rows by which neighbours are looked up, radians.
const ROW: f64 = 1e-3;
/// Nearer rays have the same direction, radians.
const LEAST_ANGLE: f64 = 3e-4;
/// A neighbour may be off by this elevation, radians, and by this share of its distance: a ring is no circle where the
/// sensor is tilted or corrects for where its lasers sit, and a rosette has no rings.
const LEAST_HEIGHT: f64 = 5e-4;
const SLOPE: f64 = 0.3;
/// A neighbour is at most this far away, radians.
const REACH: f64 = 0.02;
/// A gap of more than this many times the usual distance of neighbours means that returns are missing.
const GAP: f64 = 7.0;

/// Smallest cosine of an elevation: at the poles azimuths mean nothing.
const LEAST_COSINE: f64 = 1e-3;

/// What changes from each point of a sweep to its neighbours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    /// By how much the farther one of the two neighbours is farther than the point, metres: infinite where there is no
    /// return beside the point, NaN where the point is none itself.
    pub range_m: Vec<f32>,
    /// From each point to half-way towards that neighbour's ray, metres: the surface ends in between.
    pub to_range_step_m: Vec<[f32; 3]>,
    /// The larger difference of intensity to a neighbour on the same surface, NaN where no neighbour is; `None` without
    /// intensities.
    pub intensity: Option<Vec<f32>>,
    /// From each point to half-way towards that neighbour, metres.
    pub to_intensity_step_m: Vec<[f32; 3]>,
    pub spacing: f64,
}

/// The points of a sweep, metres, LiDAR frame, and the intensity of each, if there is one.
pub type Scanned<'a> = (&'a [[f32; 3]], Option<&'a [f32]>);

/// The steps of each of some sweeps.
///
/// A neighbour is on the same surface if its range differs by less than `same_surface_m`.
pub fn steps(sweeps: &[Scanned], same_surface_m: f64) -> Vec<Steps> {
    sweeps.par_iter().map(|(points, intensity)| of_sweep(points, *intensity, same_surface_m)).collect()
}

fn of_sweep(points: &[[f32; 3]], intensity: Option<&[f32]>, same_surface_m: f64) -> Steps {
    let rays = Rays::of(points);
    let beside: Vec<[Option<Beside>; 2]> =
        (0..rays.sorted.len()).into_par_iter().map(|at| rays.beside(at)).collect();
    let spacing = usual_distance(&beside);
    let mut found = Steps {
        range_m: vec![f32::NAN; points.len()],
        to_range_step_m: vec![[0.0; 3]; points.len()],
        intensity: intensity.map(|values| vec![f32::NAN; values.len()]),
        to_intensity_step_m: vec![[0.0; 3]; points.len()],
        spacing,
    };
    for (ray, sides) in rays.sorted.iter().zip(&beside) {
        let sides = sides.map(|side| side.filter(|beside| beside.distance <= GAP * spacing));
        let step = |side: Option<Beside>| {
            side.map_or(f64::INFINITY, |beside| rays.sorted[beside.at].range - ray.range)
        };
        let [left, right] = sides.map(step);
        let side = usize::from(right > left);
        found.range_m[ray.index] = f64::max(left, right) as f32;
        let neighbour = sides[side].map(|beside| rays.sorted[beside.at]);
        found.to_range_step_m[ray.index] = ray.half_way(neighbour, side, spacing);
        if let Some((intensity, values)) = intensity.zip(found.intensity.as_mut()) {
            for (side, beside) in sides.iter().enumerate() {
                let Some(other) = beside.map(|beside| rays.sorted[beside.at]) else { continue };
                let difference = (intensity[other.index] - intensity[ray.index]).abs();
                let is_same = (other.range - ray.range).abs() < same_surface_m;
                let value = &mut values[ray.index];
                if is_same && (value.is_nan() || difference > *value) {
                    *value = difference;
                    found.to_intensity_step_m[ray.index] = ray.half_way(Some(other), side, spacing);
                }
            }
        }
    }
    found
}

#[derive(Clone, Copy, Debug)]
struct Ray {
    azimuth: f64,
    elevation: f64,
    range: f64,
    /// Among all points of the sweep.
    index: usize,
}

impl Ray {
    fn direction(&self) -> Vector3<f64> {
        from_angles(self.azimuth, self.elevation)
    }

    /// From the point, metres, to its range half-way to a neighbour's ray on a side; without a neighbour, that is half
    /// the usual spacing of rays, radians.
    fn half_way(&self, neighbour: Option<Self>, side: usize, spacing: f64) -> [f32; 3] {
        let own = self.direction();
        let middle = match neighbour {
            Some(other) => own + other.direction(),
            None => {
                let turn =
                    if side == 0 { 0.5 } else { -0.5 } * spacing / self.elevation.cos().max(LEAST_COSINE);
                from_angles(self.azimuth + turn, self.elevation)
            }
        };
        let by = (middle.normalize() - own) * self.range;
        [by.x as f32, by.y as f32, by.z as f32]
    }
}

#[derive(Clone, Copy, Debug)]
struct Beside {
    /// Among the sorted rays.
    at: usize,
    /// Radians of arc.
    distance: f64,
}

/// All rays with returns, by row and azimuth.
struct Rays {
    sorted: Vec<Ray>,
    /// The first ray of each row, and the end.
    starts: Vec<usize>,
}

impl Rays {
    fn of(points: &[[f32; 3]]) -> Self {
        let ray = |(index, point): (usize, &[f32; 3])| {
            let point = to_f64(point);
            is_return(&point).then(|| Ray {
                azimuth: azimuth(&point),
                elevation: elevation(&point),
                range: point.norm(),
                index,
            })
        };
        let mut sorted: Vec<Ray> = points.iter().enumerate().filter_map(ray).collect();
        sorted.sort_unstable_by(|a, b| {
            (row(a.elevation), a.azimuth, a.index)
                .partial_cmp(&(row(b.elevation), b.azimuth, b.index))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        let num_rows = row(FRAC_PI_2) + 1;
        let mut starts = vec![0; num_rows + 1];
        sorted.iter().for_each(|ray| starts[row(ray.elevation) + 1] += 1);
        (0..num_rows).for_each(|row| starts[row + 1] += starts[row]);
        Self { sorted, starts }
    }

    /// The neighbours of a ray: in the direction of larger azimuths, and of smaller ones.
    fn beside(&self, at: usize) -> [Option<Beside>; 2] {
        let ray = &self.sorted[at];
        let reach_rows = ((LEAST_HEIGHT + SLOPE * REACH) / ROW).ceil() as usize;
        let own = row(ray.elevation);
        let mut found = [None, None];
        let last = self.starts.len() - 2;
        // Nearer rows first: a ray of a farther one is at least so far away that a nearer neighbour rules it out.
        let rows = (0..=reach_rows).flat_map(|away| {
            let below = own.checked_sub(away);
            let above = (away > 0 && own + away <= last).then_some(own + away);
            below.into_iter().chain(above).map(move |row| (away, row))
        });
        for (away, row) in rows {
            let nearest = ((away as f64 - 1.0) * ROW - LEAST_HEIGHT) / SLOPE;
            for (side, found) in found.iter_mut().enumerate() {
                let within = found.map_or(REACH, |best: Beside| best.distance);
                if found.is_none() || within >= nearest {
                    *found = self.beside_in_row(ray, row, side, within).or(*found);
                }
            }
        }
        found
    }

    /// The neighbour of a ray on one side in a row, at most so far away, radians of arc.
    fn beside_in_row(&self, ray: &Ray, row: usize, side: usize, within: f64) -> Option<Beside> {
        let rays = &self.sorted[self.starts[row]..self.starts[row + 1]];
        let across = ray.elevation.cos().max(LEAST_COSINE);
        let least = LEAST_ANGLE / across;
        // Rays that are nearer than `least` are passed over at once, however many there are.
        let first = wrapped(ray.azimuth + if side == 0 { least } else { -least });
        let middle = rays.partition_point(|other| other.azimuth < first);
        for step in 0..rays.len() {
            let place = match side {
                0 => (middle + step) % rays.len(),
                _ => (middle + rays.len() - 1 - step) % rays.len(),
            };
            let other = &rays[place];
            let turn = if side == 0 { other.azimuth - ray.azimuth } else { ray.azimuth - other.azimuth };
            let turn = turn.rem_euclid(TAU);
            let distance = turn * across;
            // After a whole turn come the rays that were passed over; round-off puts none of the first there.
            if turn < 0.5 * least || turn > TAU - least || distance > within {
                return None;
            }
            let height = (other.elevation - ray.elevation).abs();
            if distance > LEAST_ANGLE && height <= LEAST_HEIGHT + SLOPE * distance {
                return Some(Beside { at: self.starts[row] + place, distance });
            }
        }
        None
    }
}

/// The median distance of neighbours, radians.
fn usual_distance(beside: &[[Option<Beside>; 2]]) -> f64 {
    let mut distances: Vec<f64> = beside.iter().flatten().flatten().map(|beside| beside.distance).collect();
    if distances.is_empty() {
        return 0.0;
    }
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// An azimuth in [-pi, pi).
fn wrapped(azimuth: f64) -> f64 {
    (azimuth + PI).rem_euclid(TAU) - PI
}

fn row(elevation: f64) -> usize {
    ((elevation + FRAC_PI_2) / ROW) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at 10 m with a pole at 5 m before it, scanned by rings: points, and intensities, which step on the wall.
    fn scene(turned_rad: f64) -> (Vec<[f32; 3]>, Vec<f32>) {
        let (mut points, mut intensity) = (Vec::new(), Vec::new());
        for ring in 0..8 {
            for column in -60..=60 {
                let (azimuth, elevation) = (f64::from(column) * 3e-3 + turned_rad, f64::from(ring) * 0.01);
                let range = if (-4..=4).contains(&column) { 5.0 } else { 10.0 };
                let (across, up) = (range * elevation.cos(), range * elevation.sin());
                points.push([across * azimuth.cos(), across * azimuth.sin(), up].map(|x| x as f32));
                intensity.push(if column > 30 { 0.75 } else { 0.25 });
            }
        }
        (points, intensity)
    }

    fn columns_where(found: &[f32], is_edge: impl Fn(f32) -> bool) -> Vec<usize> {
        let mut columns: Vec<usize> = found
            .iter()
            .enumerate()
            .filter(|(_, step)| is_edge(**step))
            .map(|(index, _)| index % 121)
            .collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    #[test]
    fn only_the_near_side_has_an_edge_in_range_and_both_sides_one_in_intensity() {
        for turned_rad in [0.0, 1.0, std::f64::consts::PI] {
            let (points, intensity) = scene(turned_rad);
            let found = &steps(&[(&points, Some(&intensity))], 0.3)[0];
            assert_eq!(columns_where(&found.range_m, |step| step.is_finite() && step > 4.0), [56, 64]);
            // Nothing is beside the scan's own ends.
            assert_eq!(columns_where(&found.range_m, f32::is_infinite), [0, 120]);
            assert_eq!(
                columns_where(found.intensity.as_deref().unwrap_or_default(), |step| step > 0.4),
                [90, 91]
            );
        }
    }

    #[test]
    fn points_in_one_direction_are_passed_over() {
        // Quadratic, each takes half a minute: backward, at the seam of azimuths, and overhead.
        let (alone, _) = scene(0.0);
        for placeholder in [[-50.0, 0.0, 0.0], [0.0, 0.0, 50.0]] {
            let all: Vec<_> =
                alone.iter().copied().chain(std::iter::repeat_n(placeholder, 100_000)).collect();
            let [without, with] = [&alone, &all].map(|points| steps(&[(points, None)], 0.3)[0].clone());
            assert_eq!(with.range_m[..alone.len()], without.range_m);
            assert_eq!(with.spacing, without.spacing);
        }
    }
}
