//! Neighbours along the scan lines of a sweep whose points are in the order of the scan.
//!
//! A laser that sits beside or above the point where rays are said to start seems to change its direction where the
//! range steps: those of an HDL-64E by 2 degrees at 5 m. A neighbour at the same elevation is then another laser's.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use geometry::angles::wrapped;

use super::rays::{MIN_ANGLE, Neighbour, REACH, Ray, Sides};

/// Smallest share of pairs of consecutive directions of one laser that advance along the scan at about one elevation. It is
/// 0.90 to 1.0 for sweeps of eight real sets in the order of their scans, and 0.41 at most for others.
const MIN_ADVANCING: f64 = 0.75;
/// Largest step against the scan, radians: neighbours may change places where the range steps, by 0.1 degrees for an
/// HDL-64E whose lasers sit 2.6 cm beside its axis.
const MAX_BACK: f64 = 0.002;
/// Smallest share of the turns that are seen to end at the seam.
const MIN_AT_SEAM: f64 = 0.3;
/// Number of rays before the end of a turn that are compared with its first.
const RAYS_AT_SEAM: usize = 3;
/// Largest number of returns of one firing that are compared with those of the next.
const MAX_RETURNS: usize = 4;

/// The rays ring by ring; without rings, as they are.
pub fn ring_by_ring(rays: &[Ray], rings: Option<&[u16]>) -> Vec<Ray> {
    let mut sorted = rays.to_vec();
    if let Some(rings) = rings {
        sorted.sort_by_key(|ray| rings[ray.index]);
    }
    sorted
}

/// Puts the rays in the order of their scan lines, and finds the neighbours of each; `None` if they are not in the order of
/// a scan.
///
/// Without rings, one line must follow another, each a turn long or from one border of the view to the other.
pub fn neighbours(rays: &[Ray], rings: Option<&[u16]>) -> Option<(Vec<Ray>, Vec<Sides>)> {
    let sorted = ring_by_ring(rays, rings);
    let direction = direction_of_scan(&sorted, rings)?;
    let mut neighbours = Vec::with_capacity(sorted.len());
    for line in lines(&sorted, rings, direction) {
        let directions = directions(&sorted, line);
        for (at, own) in directions.iter().enumerate() {
            let beside = |other: Option<&Range<usize>>, sign: f64| {
                other.cloned().or_else(|| at_other_end(&sorted, &directions, own.start, sign * direction))
            };
            let next = beside(directions.get(at + 1), 1.0);
            let last = beside(at.checked_sub(1).map(|at| &directions[at]), -1.0);
            for ray in own.clone() {
                let sides = [(&next, direction), (&last, -direction)]
                    .map(|(returns, sign)| neighbour(&sorted, ray, returns.clone()?, sign));
                neighbours.push(if direction > 0.0 { sides } else { [sides[1], sides[0]] });
            }
        }
    }
    Some((sorted, neighbours))
}

pub fn is_one_ring(a: &Ray, b: &Ray, rings: Option<&[u16]>) -> bool {
    rings.is_none_or(|rings| rings[a.index] == rings[b.index])
}

/// Sign of the turn from ray to ray; `None` if the rays are not in the order of a scan.
fn direction_of_scan(rays: &[Ray], rings: Option<&[u16]>) -> Option<f64> {
    let is_pair = |pair: &&[Ray]| {
        let [a, b] = [&pair[0], &pair[1]];
        is_one_ring(a, b, rings) && !(a.is_in_line_with(b) && a.is_level_with(b, 0.0))
    };
    let pairs =
        || rays.windows(2).filter(is_pair).map(|pair| (&pair[0], &pair[1], pair[0].turn_to(&pair[1])));
    let near = |turn: &f64| MIN_ANGLE < turn.abs() && turn.abs() < REACH;
    let direction = pairs().map(|(.., turn)| turn).filter(near).map(f64::signum).sum::<f64>().signum();
    let is_advancing = |(a, b, turn): &(&Ray, &Ray, f64)| {
        let forward = direction * turn;
        -MAX_BACK < forward && forward < REACH && a.is_level_with(b, turn.abs())
    };
    let advancing = pairs().filter(is_advancing).count();
    (advancing > 0 && advancing as f64 >= MIN_ADVANCING * pairs().count() as f64).then_some(direction)
}

/// The scan lines, as ranges of the rays.
fn lines(rays: &[Ray], rings: Option<&[u16]>, direction: f64) -> Vec<Range<usize>> {
    let mut starts = match rings {
        Some(_) => (1..rays.len()).filter(|&at| !is_one_ring(&rays[at - 1], &rays[at], rings)).collect(),
        None => Scan::new(rays, direction).starts(),
    };
    starts.insert(0, 0);
    starts.push(rays.len());
    starts.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// Rays in the order of a scan.
struct Scan<'a> {
    rays: &'a [Ray],
    direction: f64,
    /// Turn from the first ray to each, radians of azimuth.
    turned: Vec<f64>,
}

impl<'a> Scan<'a> {
    fn new(rays: &'a [Ray], direction: f64) -> Self {
        let steps = rays.windows(2).map(|pair| direction * pair[0].turn_to(&pair[1]));
        let sums = steps.scan(0.0, |turned, step| {
            *turned += step;
            Some(*turned)
        });
        Self { rays, direction, turned: [0.0].into_iter().chain(sums).collect() }
    }

    /// The first rays of all lines but the first.
    fn starts(&self) -> Vec<usize> {
        let (seam, mut starts, mut start) = (self.seam(), Vec::new(), 0);
        for at in 1..self.rays.len() {
            let [a, b] = [&self.rays[at - 1], &self.rays[at]];
            let (step, turned) = (self.direction * a.turn_to(b), self.turned[at] - self.turned[start]);
            let is_full = || match seam {
                // The first line may be a short part of one.
                Some(seam) => turned > if start == 0 { REACH } else { PI } && self.passes(at, seam),
                None => turned > TAU + REACH || turned > TAU - REACH && !a.is_level_with(b, step.abs()),
            };
            if step < -REACH || is_full() {
                starts.push(at);
                start = at;
            }
        }
        starts
    }

    /// The azimuth at which lines of a turn each end; `None` if most turns end nowhere.
    ///
    /// To count turns is not enough: the first line may begin late, as where a laser sees the sky, and then all lines would.
    fn seam(&self) -> Option<f64> {
        let num_turns = self.turned.last()? / TAU;
        if num_turns < 2.0 {
            return None;
        }
        let begins = (1..self.rays.len()).filter(|&at| self.begins_line(at));
        let mut azimuths: Vec<f64> = begins.map(|at| self.rays[at].azimuth).collect();
        azimuths.sort_by(f64::total_cmp);
        let num_until = |end: f64| azimuths.partition_point(|azimuth| *azimuth < end);
        let count = |&azimuth: &f64| num_until(azimuth + REACH / 2.0) - num_until(azimuth - REACH / 2.0);
        let seam = *azimuths.iter().max_by_key(|azimuth| count(azimuth))?;
        (count(&seam) as f64 > MIN_AT_SEAM * num_turns).then_some(seam)
    }

    /// Whether a line begins at a ray: at the elevation of the ray a turn later, and not of the ray before.
    fn begins_line(&self, at: usize) -> bool {
        let [a, b] = [&self.rays[at - 1], &self.rays[at]];
        let is_level = |other: &Ray| b.is_level_with(other, b.turn_to(other).abs());
        if is_level(a) || self.turned[at] - self.turned[at - 1] > REACH {
            return false;
        }
        let later = at + self.turned[at..].partition_point(|turned| *turned < self.turned[at] + TAU);
        self.rays[at + 1..later.max(at + 1)].iter().rev().take(RAYS_AT_SEAM).any(is_level)
    }

    /// Whether a ray is the first of a line, if lines end at an azimuth: where the elevation steps, or else the first beyond.
    fn passes(&self, at: usize, seam: f64) -> bool {
        let from_seam = |at: usize| self.direction * wrapped(self.rays[at].azimuth - seam);
        if from_seam(at).abs() < REACH / 2.0 && self.begins_line(at) {
            return true;
        }
        from_seam(at - 1) < REACH / 2.0 && from_seam(at) >= REACH / 2.0 && from_seam(at) < PI / 2.0
    }
}

/// The rays of a line in each direction: a firing may have several returns, and placeholders may share one direction.
fn directions(rays: &[Ray], line: Range<usize>) -> Vec<Range<usize>> {
    let mut directions = Vec::new();
    let mut start = line.start;
    for at in line.clone() {
        if !rays[start].is_in_line_with(&rays[at]) {
            directions.push(start..at);
            start = at;
        }
    }
    directions.push(start..line.end);
    directions
}

/// The nearest direction beyond the end of a line, where it has gone once around; a sign tells the side.
fn at_other_end(rays: &[Ray], directions: &[Range<usize>], from: usize, sign: f64) -> Option<Range<usize>> {
    let turn = |other: &Range<usize>| sign * rays[from].turn_to(&rays[other.start]);
    let beyond = directions.iter().filter(|other| turn(other) > MIN_ANGLE);
    beyond.min_by(|a, b| turn(a).total_cmp(&turn(b))).cloned()
}

/// The return of the next firing on one side whose range is most like that of a ray.
fn neighbour(rays: &[Ray], from: usize, returns: Range<usize>, sign: f64) -> Option<Neighbour> {
    let ray = &rays[from];
    let difference = |at: &usize| (rays[*at].range - ray.range).abs();
    let at = returns.take(MAX_RETURNS).min_by(|a, b| difference(a).total_cmp(&difference(b)))?;
    let distance = ray.arc_to(&rays[at]);
    let is_on_side = sign * ray.turn_to(&rays[at]) > -MAX_BACK;
    (is_on_side && distance > MIN_ANGLE).then_some(Neighbour { at, distance })
}

#[cfg(test)]
mod tests {
    use geometry::angles::from_angles;

    use super::*;

    const RINGS: usize = 8;
    const COLUMNS: usize = 720;

    /// Rays over a plane, ring by ring from azimuth 0, without the first rays of the first ring.
    fn scan(missing: usize) -> Vec<Ray> {
        let ray = |index: usize| {
            let (ring, column) = (index / COLUMNS, index % COLUMNS);
            let elevation = -0.02 - 0.006 * ring as f64;
            let azimuth = wrapped(TAU * (column as f64 + 0.3) / COLUMNS as f64);
            Ray::to(&(from_angles(azimuth, elevation) * (-1.7 / elevation.sin())), index - missing)
        };
        (missing..RINGS * COLUMNS).map(ray).collect()
    }

    #[test]
    fn lines_end_at_the_seam_though_the_first_begins_late() {
        for missing in [0, 1, 70, 400] {
            let starts: Vec<usize> = lines(&scan(missing), None, 1.0).iter().map(|line| line.start).collect();
            let expected: Vec<usize> =
                (0..RINGS).map(|ring| (ring * COLUMNS).saturating_sub(missing)).collect();
            assert_eq!(starts, expected, "{missing}");
        }
    }
}
