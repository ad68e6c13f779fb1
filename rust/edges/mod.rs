//! Edges of a sweep: points next to which, along the scan, range or intensity steps.
//!
//! Each ray is compared with its neighbours to the left and right: those of the same laser where the points are in the
//! order of the scan or have rings, otherwise those at about the same elevation. Of two surfaces only the nearer one has an edge: the
//! other continues behind it. Comparison along the scan follows Levinson and Thrun, *Automatic Online Calibration of
//! Cameras and Lasers* (RSS 2013), who match range steps within a ring against image edges.

mod rays;
mod same_elevation;
mod scan_axis;
mod scan_lines;

use std::borrow::Cow;

use nalgebra::{Rotation3, UnitVector3, Vector3};
use rayon::prelude::*;

use crate::point_cloud::to_f64;
use rays::{Neighbour, REACH, Ray, Sides};

/// A gap of more than this many times the usual distance of neighbours means that returns are missing.
const MAX_GAP: f64 = 7.0;

/// Largest share of directions without a return beside them at which returns are missing. If there are more, the pattern of
/// the scan leaves gaps, which say nothing of the scene. It is 0 to 0.06 for the spinning LiDARs of twelve real sets, 0.18
/// for an HDL-32E with placeholders, and 0.62 for a synthetic rosette.
const MAX_OPEN: f64 = 0.3;

/// Where a surface ends beside its last ray, in rays. A ray is wide, so that less than half of it on the surface still
/// makes a return there. Against 0.5, the information at the maximum rises from 0.0266 to 0.0280 nats on 14 pairs of
/// KITTI object, from 0.0325 to 0.0366 on 15 of KITTI raw, and from 0.180 to 0.182 with a VLP-16; 0.2 adds nothing.
/// Behind a gap the next return says nothing of where the surface ended.
const RANGE_STEP: f64 = 0.35;

/// Changes from each point of a sweep to its neighbours.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// How far the next ray reaches beyond the point's surface, on the side where that is more, metres: infinite if there
    /// is no return next to the point, NaN if the point itself is not a return or the pattern has no ray next to it.
    pub range_m: Vec<f32>,
    /// Vector from each point towards that neighbour's ray, metres, to where the surface ends: see [`RANGE_STEP`].
    pub to_range_step_m: Vec<[f32; 3]>,
    /// Larger intensity difference to a neighbour on the same surface, NaN if there is none; `None` without
    /// intensities.
    pub intensity: Option<Vec<f32>>,
    /// Vector from each point half-way to that neighbour, metres.
    pub to_intensity_step_m: Vec<[f32; 3]>,
    pub spacing: f64,
    /// Axis about which the LiDAR turns, LiDAR frame; `None` if the points are not in the order of a scan.
    pub axis: Option<UnitVector3<f64>>,
}

/// A sweep.
#[derive(Clone, Copy, Debug)]
pub struct Scanned<'a> {
    /// Points, metres, from where the rays start.
    pub points: &'a [[f32; 3]],
    /// Intensity of each point.
    pub intensity: Option<&'a [f32]>,
    /// Laser that measured each point.
    pub rings: Option<&'a [u16]>,
}

/// Computes the steps of each sweep.
///
/// A neighbour is on the same surface if its range differs by less than `same_surface_m`.
pub fn steps(sweeps: &[Scanned], same_surface_m: f64) -> Vec<Steps> {
    let rays: Vec<LinkedRays> = sweeps.par_iter().map(LinkedRays::of).collect();
    let open: usize = rays.iter().map(|rays| rays.num_open).sum();
    let all: usize = rays.iter().map(|rays| rays.num_directions).sum();
    let is_pattern_open = open as f64 > MAX_OPEN * all as f64;
    sweeps
        .par_iter()
        .zip(&rays)
        .map(|(sweep, rays)| of_sweep(*sweep, rays, same_surface_m, is_pattern_open))
        .collect()
}

/// The rays of a sweep, and their neighbours.
struct LinkedRays<'a> {
    /// Points, metres, in the frame in which the LiDAR turns about the z axis.
    points: Cow<'a, [[f32; 3]]>,
    /// Turns the frame of the LiDAR to that of these points.
    turn: Option<Rotation3<f64>>,
    /// Axis about which the LiDAR turns, LiDAR frame; `None` if the points are not in the order of a scan.
    axis: Option<UnitVector3<f64>>,
    rays: Vec<Ray>,
    neighbours: Vec<Sides>,
    /// Median angle between neighbours, radians.
    spacing: f64,
    num_directions: usize,
    /// Number of directions without a return beside them.
    num_open: usize,
}

impl<'a> LinkedRays<'a> {
    fn of(sweep: &Scanned<'a>) -> Self {
        let points = Cow::Borrowed(sweep.points);
        let rays = rays::returns(sweep.points);
        if let Some(linked) = scan_lines::neighbours(&rays, sweep.rings) {
            return Self::with(points, None, Some(Vector3::z_axis()), linked);
        }
        Self::about_another_axis(sweep, &rays)
            .unwrap_or_else(|| Self::with(points, None, None, same_elevation::neighbours(rays)))
    }

    /// The rays of a LiDAR that turns about another axis than z; `None` if they are not in the order of its scan, or take up
    /// less than half a turn.
    fn about_another_axis(sweep: &Scanned, rays: &[Ray]) -> Option<Self> {
        let axis = scan_axis::scan_axis(rays, sweep.rings, sweep.points)?;
        let turn = Rotation3::rotation_between(&axis, &Vector3::z())?;
        let points: Vec<[f32; 3]> = sweep.points.iter().map(|point| turned(&turn, point)).collect();
        let rays = rays::returns(&points);
        let linked = scan_axis::is_all_around(&rays).then(|| scan_lines::neighbours(&rays, sweep.rings))?;
        Some(Self::with(Cow::Owned(points), Some(turn), Some(axis), linked?))
    }

    fn with(
        points: Cow<'a, [[f32; 3]]>,
        turn: Option<Rotation3<f64>>,
        axis: Option<UnitVector3<f64>>,
        (rays, mut neighbours): (Vec<Ray>, Vec<Sides>),
    ) -> Self {
        let spacing = median_distance(&neighbours);
        let is_beside = |beside: &Neighbour| beside.distance <= MAX_GAP * spacing;
        neighbours.iter_mut().flatten().for_each(|side| *side = side.filter(is_beside));
        let directions = rays.windows(2).zip(&neighbours);
        let directions = directions.filter(|(pair, _)| !pair[0].is_in_line_with(&pair[1]));
        let is_open: Vec<bool> = directions.map(|(_, sides)| sides.iter().any(Option::is_none)).collect();
        let num_open = is_open.iter().filter(|&&is_open| is_open).count();
        Self { points, turn, axis, rays, neighbours, spacing, num_directions: is_open.len(), num_open }
    }

    /// A vector in the frame of the LiDAR.
    fn in_lidar(&self, vector: [f32; 3]) -> [f32; 3] {
        self.turn.map_or(vector, |turn| turned(&turn.inverse(), &vector))
    }
}

fn of_sweep(sweep: Scanned, linked: &LinkedRays, same_surface_m: f64, is_pattern_open: bool) -> Steps {
    let intensity = sweep.intensity;
    let LinkedRays { points, rays, neighbours, spacing, .. } = linked;
    let mut steps = Steps {
        range_m: vec![f32::NAN; points.len()],
        to_range_step_m: vec![[0.0; 3]; points.len()],
        intensity: intensity.map(|values| vec![f32::NAN; values.len()]),
        to_intensity_step_m: vec![[0.0; 3]; points.len()],
        spacing: *spacing,
        axis: linked.axis,
    };
    let step_to_nothing = if is_pattern_open { f64::NEG_INFINITY } else { f64::INFINITY };
    for (ray, sides) in rays.iter().zip(neighbours) {
        let [left, right] = [0, 1].map(|side| {
            let Some(beside) = sides[side] else { return step_to_nothing };
            let reach =
                |neighbour: Neighbour| Reach { range: rays[neighbour.at].range, arc: neighbour.distance };
            let [behind, beyond] = [sides[1 - side], neighbours[beside.at][side]].map(|side| side.map(reach));
            step_beyond_surface(ray.range, behind, reach(beside), beyond)
        });
        let side = usize::from(right > left);
        let step = f64::max(left, right);
        steps.range_m[ray.index] = if step == f64::NEG_INFINITY { f32::NAN } else { step as f32 };
        let gap = sides[side].map_or(*spacing, |beside| beside.distance.min(*spacing));
        let arc = RANGE_STEP * gap * if side == 0 { 1.0 } else { -1.0 };
        steps.to_range_step_m[ray.index] = linked.in_lidar(ray.turned(arc, points));
        if let Some((intensity, values)) = intensity.zip(steps.intensity.as_mut()) {
            for beside in sides {
                let Some(other) = beside.map(|beside| &rays[beside.at]) else { continue };
                let difference = (intensity[other.index] - intensity[ray.index]).abs();
                let is_same = (other.range - ray.range).abs() < same_surface_m;
                let value = &mut values[ray.index];
                if is_same && (value.is_nan() || difference > *value) {
                    *value = difference;
                    steps.to_intensity_step_m[ray.index] = linked.in_lidar(ray.half_way(other, points));
                }
            }
        }
    }
    steps
}

fn turned(turn: &Rotation3<f64>, vector: &[f32; 3]) -> [f32; 3] {
    (turn * to_f64(vector)).map(|axis| axis as f32).into()
}

/// A neighbour of a ray.
struct Reach {
    /// Metres.
    range: f64,
    /// Distance from the ray before it, radians of arc.
    arc: f64,
}

/// How far the ray beside another one reaches beyond the surface that the other one hit, metres.
///
/// On a plane, inverse ranges are linear in small angles, so that a wall along the line of sight, whose ranges grow from
/// ray to ray, has no step.
fn step_beyond_surface(range: f64, behind: Option<Reach>, beside: Reach, beyond: Option<Reach>) -> f64 {
    let surface = behind.zip(beyond).map_or(range, |(behind, beyond)| {
        let slope_behind = (1.0 / range - 1.0 / behind.range) / behind.arc;
        let slope_beyond = (1.0 / beyond.range - 1.0 / range) / (beside.arc + beyond.arc);
        1.0 / (1.0 / range + slope_behind.max(slope_beyond) * beside.arc)
    });
    // A negative surface is one that ends before the ray beside.
    let surface = if surface < 0.0 { f64::INFINITY } else { surface };
    beside.range - surface.max(range).min(beside.range.max(range))
}

/// Median distance of neighbours within reach, radians.
fn median_distance(neighbours: &[Sides]) -> f64 {
    let distances = neighbours.iter().flatten().flatten().map(|neighbour| neighbour.distance);
    let mut distances: Vec<f64> = distances.filter(|&distance| distance <= REACH).collect();
    if distances.is_empty() {
        return 0.0;
    }
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use geometry::angles::from_angles;

    use super::*;

    /// A wall at 10 m with a pole at 5 m in front of it, scanned in rings: points, and intensities, which step on
    /// the wall.
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

    fn columns_where(steps: &[f32], num_columns: usize, is_edge: impl Fn(f32) -> bool) -> Vec<usize> {
        let mut columns: Vec<usize> = steps
            .iter()
            .enumerate()
            .filter(|(_, step)| is_edge(**step))
            .map(|(index, _)| index % num_columns)
            .collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    #[test]
    fn only_the_near_side_has_an_edge_in_range_and_both_sides_one_in_intensity() {
        for turned_rad in [0.0, 1.0, std::f64::consts::PI] {
            let (points, intensity) = scene(turned_rad);
            let steps =
                &steps(&[Scanned { points: &points, intensity: Some(&intensity), rings: None }], 0.3)[0];
            assert_eq!(columns_where(&steps.range_m, 121, |step| step.is_finite() && step > 4.0), [56, 64]);
            // The ends of the scan have no neighbour.
            assert_eq!(columns_where(&steps.range_m, 121, f32::is_infinite), [0, 120]);
            assert_eq!(
                columns_where(steps.intensity.as_deref().unwrap_or_default(), 121, |step| step > 0.4),
                [90, 91]
            );
        }
    }

    /// The ring of a laser above the origin at an elevation, radians: a wall at 10 m and a pole at 3 m in front of it.
    fn ring_from_above(elevation: f64) -> Vec<[f32; 3]> {
        let ray = |column: i32| {
            let azimuth = f64::from(column) * TAU / 720.0;
            let range = if (355..=365).contains(&column) { 3.0 } else { 10.0 };
            let (across, up) = (range * elevation.cos(), range * elevation.sin() + 0.2);
            [across * azimuth.cos(), across * azimuth.sin(), up].map(|x| x as f32)
        };
        (0..720).map(ray).collect()
    }

    #[test]
    fn neighbours_are_of_one_laser_where_the_order_or_the_rings_tell() {
        let rings: Vec<Vec<[f32; 3]>> = (0..6).map(|ring| ring_from_above(f64::from(ring) * 0.01)).collect();
        let edges = |points: &[[f32; 3]], rings: Option<&[u16]>| {
            let steps = steps(&[Scanned { points, intensity: None, rings }], 0.3);
            let of_pole = |index: &usize| steps[0].range_m[*index] > 0.3;
            (0..points.len()).filter(of_pole).collect::<Vec<_>>()
        };
        let ends_of_pole = |ring: usize| [720 * ring + 355, 720 * ring + 365];
        let by_laser = rings.concat();
        assert_eq!(edges(&by_laser, None), (0..6).flat_map(ends_of_pole).collect::<Vec<_>>());

        // All lasers fire at once: their numbers put the points in order.
        let by_firing: Vec<[f32; 3]> =
            (0..720).flat_map(|column| rings.iter().map(move |ring| ring[column])).collect();
        let lasers: Vec<u16> = (0..720).flat_map(|_| 0..6).collect();
        let firings = |column: usize| (6 * column..6 * column + 6).collect::<Vec<_>>();
        assert_eq!(edges(&by_firing, Some(&lasers)), [firings(355), firings(365)].concat());

        // Without them, neighbours are at the same elevation, where the pole is seen beside its ends, too.
        assert_ne!(edges(&by_firing, None), [firings(355), firings(365)].concat());
    }

    #[test]
    fn lines_are_found_about_any_axis() {
        let rings: Vec<Vec<[f32; 3]>> = (0..6).map(|ring| ring_from_above(f64::from(ring) * 0.01)).collect();
        let points = rings.concat();
        let steps_of = |points: &[[f32; 3]]| {
            steps(&[Scanned { points, intensity: None, rings: None }], 0.3).swap_remove(0)
        };
        let upright = steps_of(&points);
        for angles in [[1.5, 0.0, 0.4], [0.0, -1.5, 1.0], [0.9, 0.5, 0.0]] {
            let turn = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
            let from_turned: Vec<[f32; 3]> = points.iter().map(|point| turned(&turn, point)).collect();
            let found = steps_of(&from_turned);
            assert!(found.axis.unwrap().dot(&(turn * Vector3::z_axis())).abs() > 0.9999, "{angles:?}");
            // A view of 120 degrees may as well be scanned column by column.
            let in_view: Vec<[f32; 3]> =
                rings.iter().flat_map(|ring| &ring[300..540]).map(|point| turned(&turn, point)).collect();
            assert_eq!(steps_of(&in_view).axis, None);
            for (index, step) in upright.range_m.iter().enumerate() {
                let own = found.range_m[index];
                assert!(own == *step || (own - step).abs() < 1e-3, "{angles:?} {index}: {own} {step}");
                if *step > 0.3 {
                    let expected = to_f64(&turned(&turn, &upright.to_range_step_m[index]));
                    assert!(
                        (to_f64(&found.to_range_step_m[index]) - expected).norm() < 1e-3,
                        "{angles:?} {index}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_wall_along_the_line_of_sight_has_no_step_but_at_its_end() {
        // Ten rings on a wall 2 m to the left, from 40 m ahead of the sensor to 8 m, and a building 60 m ahead.
        let ray = |column: usize, elevation: f64| {
            let azimuth = 0.002 * column as f64 - 0.06;
            let range =
                if azimuth < 0.05 { 60.0 / azimuth.cos() } else { 2.0 / azimuth.sin() } / elevation.cos();
            from_angles(azimuth, elevation).map(|axis| (axis * range) as f32).into()
        };
        let points: Vec<[f32; 3]> = (0..10)
            .flat_map(|ring| (0..125).map(move |column| ray(column, 0.01 * f64::from(ring))))
            .collect();
        let steps = &steps(&[Scanned { points: &points, intensity: None, rings: None }], 0.3)[0];
        assert_eq!(columns_where(&steps.range_m, 125, |step| step.is_finite() && step > 0.3), [55]);
    }

    #[test]
    fn gaps_of_a_pattern_are_no_steps() {
        // Two rays beside each other, and a gap, as on a rosette; then without the gaps.
        let wall = |columns: &[i32]| {
            let rays = columns.iter().flat_map(|column| (0..20).map(move |ring| (*column, ring)));
            let points: Vec<[f32; 3]> = rays
                .map(|(column, ring)| {
                    from_angles(f64::from(column) * 0.002, f64::from(ring) * 0.01)
                        .map(|axis| (10.0 * axis) as f32)
                        .into()
                })
                .collect();
            steps(&[Scanned { points: &points, intensity: None, rings: None }], 0.3)[0].range_m.clone()
        };
        let pairs: Vec<i32> = (0..10).flat_map(|pair| [20 * pair, 20 * pair + 1]).collect();
        assert!(wall(&pairs).iter().all(|step| *step < 0.3));
        let all: Vec<i32> = (0..100).collect();
        assert!(wall(&all).iter().any(|step| step.is_infinite()));
    }

    #[test]
    fn both_directions_of_the_scan_find_the_ends_of_a_pole_among_placeholders() {
        let (points, _) = scene(0.0);
        let placeholders = std::iter::repeat_n([-50.0, 0.0, 0.0], 5_000);
        let backwards: Vec<_> = points.iter().rev().copied().chain(placeholders).collect();
        let steps = &steps(&[Scanned { points: &backwards, intensity: None, rings: None }], 0.3)[0];
        for (index, point) in backwards.iter().enumerate().take(points.len()) {
            if steps.range_m[index].is_finite() && steps.range_m[index] > 4.0 {
                assert_eq!(steps.to_range_step_m[index][1].signum(), point[1].signum());
            }
        }
        assert_eq!(steps.range_m.iter().filter(|&&step| step.is_finite() && step > 4.0).count(), 16);
    }

    #[test]
    fn rings_that_tell_nothing_change_nothing() {
        let (points, _) = scene(0.0);
        let by_firing: Vec<_> = (0..121)
            .flat_map(|column| (0..8).map(move |ring| 121 * ring + column))
            .map(|at| points[at])
            .collect();
        let rings = vec![0; by_firing.len()];
        let [with, without] = [Some(rings.as_slice()), None]
            .map(|rings| steps(&[Scanned { points: &by_firing, intensity: None, rings }], 0.3)[0].clone());
        assert_eq!(with.range_m, without.range_m);
    }

    #[test]
    fn a_fence_that_every_ray_passes_through_has_no_step() {
        let ray = |column: i32, range: f64| {
            from_angles(f64::from(column) * 0.003, 0.1).map(|axis| (range * axis) as f32).into()
        };
        let points: Vec<[f32; 3]> =
            (-100..100).flat_map(|column| [5.0, 10.0].map(|range| ray(column, range))).collect();
        let steps = &steps(&[Scanned { points: &points, intensity: None, rings: None }], 0.3)[0];
        assert!(steps.range_m.iter().all(|&step| step.is_infinite() || step < 0.3));
    }

    #[test]
    fn points_in_one_direction_are_passed_over() {
        // A quadratic search would take half a minute for each: backward, at the azimuth seam, and overhead.
        let (alone, _) = scene(0.0);
        for placeholder in [[-50.0, 0.0, 0.0], [0.0, 0.0, 50.0]] {
            let all: Vec<_> =
                alone.iter().copied().chain(std::iter::repeat_n(placeholder, 100_000)).collect();
            let [without, with] = [&alone, &all]
                .map(|points| steps(&[Scanned { points, intensity: None, rings: None }], 0.3)[0].clone());
            assert_eq!(with.range_m[..alone.len()], without.range_m);
            assert_eq!(with.spacing, without.spacing);
        }
    }
}
