//! The ground of a sweep, with slopes and steps.
//!
//! Cells of a polar grid, whose rings widen with range, are visited outward from the sensor. The low points of a
//! cell are ground if they are near the plane through the ground of the cells around it that are nearer to the
//! sensor. Every point near the plane through the ground of all cells around its own is ground.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector3};

const NUM_SECTORS: usize = 120;
const NUM_RINGS: usize = 64;
/// Outer radius of the innermost ring, metres, and ratio of the outer radii of consecutive rings.
const FIRST_RADIUS_M: f64 = 2.0;
const RING_GROWTH: f64 = 1.08;
/// Rings inward of a cell, and sectors to its sides, that predict its height; and those around it that define its
/// plane.
const INWARD: isize = 8;
const BESIDE: isize = 3;
const AROUND: isize = 2;
/// Largest rise of the ground above the prediction, metres, and metres per metre from the nearest known cell.
const STEP_M: f64 = 0.15;
const BEND: f64 = 0.12;
/// Thickness of the low points of a cell, metres.
const LOW_M: f64 = 0.15;
/// Fraction of a cell's points that may be stray returns from below the ground.
const STRAY_SHARE: f64 = 0.05;
/// Range within which the height of the sensor is estimated, metres, and the height of its bins.
const NEAR_M: f64 = 30.0;
const HEIGHT_BIN_M: f64 = 0.2;
/// Largest height of a sensor above the ground, metres.
const MAX_HEIGHT_M: f64 = 20.0;
/// A lower level counts if it has at least this fraction of the cells of the most common one.
const LOWER_LEVEL_SHARE: f64 = 0.5;

/// Flags the points that are ground, in a frame whose z points up.
pub(super) fn find(points: &[Vector3<f64>], tolerance_m: f64) -> Vec<bool> {
    let cells = Cells::of(points);
    let Some(level) = level_below(&cells) else { return vec![false; points.len()] };
    let (known, predicted) = grow(&cells, level);
    let planes: Vec<Plane> = (0..NUM_RINGS * NUM_SECTORS)
        .map(|cell| {
            let around = (-AROUND..=AROUND, -AROUND..=AROUND);
            plane_through(&known, cell, around, &predicted[cell]).0.unwrap_or(predicted[cell])
        })
        .collect();
    let above = |(p, &cell): (&Vector3<f64>, &usize)| p.z - planes[cell].height(p.x, p.y);
    points.iter().zip(&cells.of_point).map(|pair| above(pair).abs() <= tolerance_m).collect()
}

/// The points of each cell, from the lowest to the highest.
struct Cells {
    of_point: Vec<usize>,
    points: Vec<Vector3<f64>>,
    starts: Vec<usize>,
}

impl Cells {
    fn of(points: &[Vector3<f64>]) -> Self {
        let of_point: Vec<usize> = points.iter().map(cell_of).collect();
        let mut starts = vec![0; NUM_RINGS * NUM_SECTORS + 1];
        of_point.iter().for_each(|&cell| starts[cell + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let mut next = starts.clone();
        let mut sorted = vec![Vector3::zeros(); points.len()];
        for (point, &cell) in points.iter().zip(&of_point) {
            sorted[next[cell]] = *point;
            next[cell] += 1;
        }
        for i in 1..starts.len() {
            sorted[starts[i - 1]..starts[i]].sort_unstable_by(|a, b| a.z.total_cmp(&b.z));
        }
        Self { of_point, points: sorted, starts }
    }

    fn at(&self, cell: usize) -> &[Vector3<f64>] {
        &self.points[self.starts[cell]..self.starts[cell + 1]]
    }
}

fn cell_of(point: &Vector3<f64>) -> usize {
    let radius = point.x.hypot(point.y);
    let ring = ((radius / FIRST_RADIUS_M).ln() / RING_GROWTH.ln() + 1.0).max(0.0) as usize;
    let sector = (point.y.atan2(point.x) + PI) / TAU * NUM_SECTORS as f64;
    ring.min(NUM_RINGS - 1) * NUM_SECTORS + (sector as usize).min(NUM_SECTORS - 1)
}

fn middle(cell: usize) -> [f64; 2] {
    let (ring, sector) = (cell / NUM_SECTORS, cell % NUM_SECTORS);
    let radius = if ring == 0 { 0.0 } else { FIRST_RADIUS_M * RING_GROWTH.powf(ring as f64 - 0.5) };
    let angle = (sector as f64 + 0.5) / NUM_SECTORS as f64 * TAU - PI;
    [radius * angle.cos(), radius * angle.sin()]
}

/// Height of the ground below the sensor: the lowest one supported by the low points of many cells, each with the
/// uncertainty of a slope.
fn level_below(cells: &Cells) -> Option<f64> {
    let num_bins = (MAX_HEIGHT_M / HEIGHT_BIN_M) as usize + 1;
    let mut votes = vec![0.0; num_bins];
    for low in (0..NUM_RINGS * NUM_SECTORS).filter_map(|cell| low_point(cells.at(cell))) {
        let radius = low.x.hypot(low.y);
        if radius < NEAR_M && (-MAX_HEIGHT_M..0.0).contains(&low.z) {
            let bin = (-low.z / HEIGHT_BIN_M) as usize;
            let reach = (BEND * radius / HEIGHT_BIN_M) as usize;
            for vote in &mut votes[bin.saturating_sub(reach)..=(bin + reach).min(num_bins - 1)] {
                *vote += 1.0 / (2 * reach + 1) as f64;
            }
        }
    }
    let most = votes.iter().copied().fold(0.0, f64::max);
    let is_common = |bin: usize| votes[bin] > 0.0 && votes[bin] >= LOWER_LEVEL_SHARE * most;
    let mut bin = (0..num_bins).rev().find(|&bin| is_common(bin))?;
    // Up to the top of that level.
    while bin > 0 && votes[bin - 1] > votes[bin] {
        bin -= 1;
    }
    Some(-(bin as f64 + 0.5) * HEIGHT_BIN_M)
}

/// The lowest of sorted points, except for stray returns.
fn low_point(points: &[Vector3<f64>]) -> Option<&Vector3<f64>> {
    points.get((points.len() as f64 * STRAY_SHARE) as usize)
}

/// The middle of each cell's ground, if any, and the plane near which it was searched.
fn grow(cells: &Cells, level: f64) -> (Vec<Option<Vector3<f64>>>, Vec<Plane>) {
    let mut known: Vec<Option<Vector3<f64>>> = vec![None; NUM_RINGS * NUM_SECTORS];
    let mut predicted = vec![Plane::level(level); NUM_RINGS * NUM_SECTORS];
    for ring in 0..NUM_RINGS {
        for sector in 0..NUM_SECTORS {
            let cell = ring * NUM_SECTORS + sector;
            let inside = cell.checked_sub(NUM_SECTORS).map_or(Plane::level(level), |inner| predicted[inner]);
            let (plane, distance) = plane_through(&known, cell, (-INWARD..=-1, -BESIDE..=BESIDE), &inside);
            predicted[cell] = plane.unwrap_or(inside);
            let [x, y] = middle(cell);
            let may_rise = STEP_M + BEND * distance.min(x.hypot(y));
            known[cell] = ground_of(cells.at(cell), &predicted[cell], may_rise);
        }
    }
    (known, predicted)
}

/// The middle of the lowest of sorted points near a plane.
fn ground_of(points: &[Vector3<f64>], plane: &Plane, may_rise: f64) -> Option<Vector3<f64>> {
    let above = |p: &Vector3<f64>| p.z - plane.height(p.x, p.y);
    let near: Vec<&Vector3<f64>> = points.iter().filter(|p| above(p).abs() <= may_rise).collect();
    let lowest = above(near.get((near.len() as f64 * STRAY_SHARE) as usize)?);
    let low: Vec<&Vector3<f64>> =
        near.into_iter().filter(|p| (lowest..=lowest + LOW_M).contains(&above(p))).collect();
    Some(low.iter().copied().sum::<Vector3<f64>>() / low.len() as f64)
}

/// The plane through the known cells around one, and the distance of the nearest of them.
fn plane_through(
    known: &[Option<Vector3<f64>>],
    cell: usize,
    (rings, sectors): (RangeInclusive<isize>, RangeInclusive<isize>),
    prior: &Plane,
) -> (Option<Plane>, f64) {
    let at = middle(cell);
    let spacing = at[0].hypot(at[1]) * (RING_GROWTH - 1.0) + 0.1;
    let mut fit = PlaneFit::near(at, prior);
    let mut nearest = f64::INFINITY;
    let (ring, sector) = ((cell / NUM_SECTORS) as isize, (cell % NUM_SECTORS) as isize);
    for ring in rings.map(|offset| ring + offset).filter(|ring| (0..NUM_RINGS as isize).contains(ring)) {
        for sector in sectors.clone().map(|offset| (sector + offset).rem_euclid(NUM_SECTORS as isize)) {
            let Some(point) = &known[ring as usize * NUM_SECTORS + sector as usize] else { continue };
            let distance = (point.x - at[0]).hypot(point.y - at[1]);
            nearest = nearest.min(distance);
            fit.add(point, 1.0 / (1.0 + (distance / spacing).powi(2)));
        }
    }
    (fit.solve(), nearest)
}

/// Weight of a level plane relative to one point 1 m away: points at a single spot determine no slope.
const LEVEL_WEIGHT: f64 = 1.0;

/// A height as a plane over (x, y).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    height: f64,
    slope: [f64; 2],
    at: [f64; 2],
}

impl Plane {
    pub(super) fn level(height: f64) -> Self {
        Self { height, ..Self::default() }
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.height + self.slope[0] * (x - self.at[0]) + self.slope[1] * (y - self.at[1])
    }
}

/// Weighted least squares with a pull towards a given slope.
pub(super) struct PlaneFit {
    at: [f64; 2],
    prior: [f64; 2],
    matrix: Matrix3<f64>,
    vector: Vector3<f64>,
}

impl PlaneFit {
    /// A plane near a place, with the slope of `prior` where points do not determine it.
    pub(super) fn near(at: [f64; 2], prior: &Plane) -> Self {
        let matrix = Matrix3::from_diagonal(&Vector3::new(0.0, LEVEL_WEIGHT, LEVEL_WEIGHT));
        Self { at, prior: prior.slope, matrix, vector: Vector3::zeros() }
    }

    pub(super) fn add(&mut self, point: &Vector3<f64>, weight: f64) {
        let (dx, dy) = (point.x - self.at[0], point.y - self.at[1]);
        let row = Vector3::new(1.0, dx, dy);
        self.matrix += weight * row * row.transpose();
        self.vector += weight * (point.z - self.prior[0] * dx - self.prior[1] * dy) * row;
    }

    /// The plane; `None` without points.
    pub(super) fn solve(&self) -> Option<Plane> {
        let solution = self.matrix.cholesky()?.solve(&self.vector);
        let slope = [solution[1] + self.prior[0], solution[2] + self.prior[1]];
        solution.iter().all(|x| x.is_finite()).then_some(Plane { height: solution[0], slope, at: self.at })
    }
}
