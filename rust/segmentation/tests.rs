//! Sweeps of simple scenes, and properties of any sweep.

use nalgebra::{Rotation3, Unit, UnitVector3, Vector3};
use proptest::prelude::*;

use super::sweep::{Returns, min_points_of_segment};
use super::*;
use crate::point_cloud::to_f64;

/// Height of the sensor above the ground, metres.
const HEIGHT: f64 = 1.8;
const CONFIG: SegmentationConfig = SegmentationConfig {
    ground_tolerance_m: 0.2,
    ground_cell_m: 3.0,
    object_gap_m: 0.25,
    object_gap_rays: 1.5,
    object_cell_m: 3.0,
    min_points: 20,
};

fn segment_sweep(
    points: &[[f32; 3]],
    up: Option<UnitVector3<f64>>,
    config: &SegmentationConfig,
) -> SegmentedSweep {
    segment_sweeps(&[points], up, config).remove(0)
}

/// A box at an angle to the axes: its lowest and its highest corner.
type Box3 = ([f64; 3], [f64; 3]);

/// The first hit of a ray from the sensor, on a box or on the ground `z = ground(x, y) - HEIGHT`, and whether it is
/// a box.
fn hit(ray: &Vector3<f64>, ground: fn(f64, f64) -> f64, boxes: &[Box3]) -> Option<(Vector3<f64>, bool)> {
    let enters = |(low, high): &Box3| {
        let sides = (0..3).map(|i| (low[i] / ray[i], high[i] / ray[i]));
        let (near, far) = sides
            .fold((0.0f64, f64::INFINITY), |(near, far), (a, b)| (near.max(a.min(b)), far.min(a.max(b))));
        (near > 0.0 && near < far).then_some(near)
    };
    let to_box = boxes.iter().filter_map(enters).fold(f64::INFINITY, f64::min);
    let is_below = |range: f64| ray.z * range < ground(ray.x * range, ray.y * range) - HEIGHT;
    let to_ground = (1..4000).map(|step| f64::from(step) * 0.02).find(|&range| is_below(range));
    let range = to_ground.unwrap_or(f64::INFINITY).min(to_box);
    range.is_finite().then(|| (ray * range, to_box <= range))
}

/// A sweep of 64 or 16 rings, with a flag for points on a box.
fn sweep(rings: usize, ground: fn(f64, f64) -> f64, boxes: &[Box3]) -> (Vec<[f32; 3]>, Vec<bool>) {
    let ray = |number: usize| {
        let elevation = (2.0 - 32.0 * ((number % rings) as f64 + 0.5) / rings as f64).to_radians();
        let azimuth = (0.5 * (number / rings) as f64 + 0.1).to_radians();
        geometry::angles::from_angles(azimuth, elevation)
    };
    let hits = (0..rings * 720).filter_map(|number| hit(&ray(number), ground, boxes));
    hits.map(|(point, is_box)| (<[f32; 3]>::from(point.map(|x| x as f32)), is_box)).unzip()
}

/// Share of the points of ground, or of boxes, whose segment has the given kind.
fn share(sweep: &SegmentedSweep, on_box: &[bool], of_boxes: bool, kind: SegmentKind) -> f64 {
    let of_these: Vec<u32> =
        sweep.ids.iter().zip(on_box).filter(|(_, on_box)| **on_box == of_boxes).map(|(&id, _)| id).collect();
    let is_kind = |id: &&u32| sweep.kinds.get(**id as usize) == Some(&kind);
    of_these.iter().filter(is_kind).count() as f64 / of_these.len() as f64
}

fn objects(sweep: &SegmentedSweep) -> usize {
    sweep.kinds.iter().filter(|&&kind| kind == SegmentKind::Object).count()
}

fn z() -> Option<UnitVector3<f64>> {
    Some(Vector3::z_axis())
}

#[test]
fn a_box_on_a_slope_is_one_object_and_the_slope_is_ground() {
    let slope = |x: f64, _: f64| 0.12 * x;
    let boxes = [([7.0, -1.0, 0.8 - HEIGHT], [9.0, 1.0, 2.6 - HEIGHT])];
    for rings in [64, 32, 16] {
        let (points, on_box) = sweep(rings, slope, &boxes);
        let found = segment_sweep(&points, z(), &CONFIG);
        assert_eq!(share(&found, &on_box, false, SegmentKind::Object), 0.0, "{rings} rings");
        assert_eq!(objects(&found), 1, "{rings} rings");
        // The lowest 0.2 m of the box count as ground.
        assert!(share(&found, &on_box, true, SegmentKind::Object) > 0.75, "{rings} rings");
        assert!(share(&found, &on_box, false, SegmentKind::Ground) > 0.95, "{rings} rings");
    }
}

#[test]
fn a_kerb_stays_ground() {
    let kerb = |_: f64, y: f64| if y.abs() > 3.5 { 0.15 } else { 0.0 };
    for rings in [64, 16] {
        let (points, on_box) = sweep(rings, kerb, &[]);
        let found = segment_sweep(&points, z(), &CONFIG);
        assert_eq!(objects(&found), 0, "{rings} rings");
        assert!(share(&found, &on_box, false, SegmentKind::Ground) > 0.97, "{rings} rings");
    }
}

#[test]
fn boxes_apart_are_objects_apart_and_a_long_wall_is_cut() {
    let level = |_: f64, _: f64| 0.0;
    let side_by_side = [([7.0, -2.0, -HEIGHT], [7.2, -0.5, -0.3]), ([7.0, 0.5, -HEIGHT], [7.2, 2.0, -0.3])];
    let (points, _) = sweep(64, level, &side_by_side);
    assert_eq!(objects(&segment_sweep(&points, z(), &CONFIG)), 2);
    let wall = [([8.0, -8.0, -HEIGHT], [8.5, 8.0, 0.0])];
    let (points, _) = sweep(64, level, &wall);
    assert!((6..=11).contains(&objects(&segment_sweep(&points, z(), &CONFIG))));
}

#[test]
fn without_ground_everything_is_an_object() {
    let points: Vec<[f32; 3]> = (0..4000)
        .map(|i| {
            geometry::angles::from_angles(f64::from(i) * 2.399_963, (f64::from(i) / 2000.0 - 1.0).asin())
        })
        .map(|ray| (ray * 8.0).map(|x| x as f32).into())
        .collect();
    assert_eq!(estimate_up(&[&points]), None);
    let found = segment_sweep(&points, None, &CONFIG);
    assert!(found.up.is_none() && objects(&found) == found.kinds.len() && !found.kinds.is_empty());
}

#[test]
fn few_or_equal_points_are_no_trouble() {
    for points in [vec![], vec![[1.0, 2.0, 3.0]], vec![[0.0; 3]; 9], vec![[5.0, 1.0, -1.0]; 100_000]] {
        for up in [None, z()] {
            let found = segment_sweep(&points, up, &CONFIG);
            assert_eq!(found.ids.len(), points.len());
            assert_eq!(found.kinds.len(), usize::from(points.len() == 100_000));
        }
    }
}

fn turned(points: &[[f32; 3]], turn: &Rotation3<f64>) -> Vec<[f32; 3]> {
    points.iter().map(|point| (turn * to_f64(point)).map(|x| x as f32).into()).collect()
}

/// Arbitrary points: on a coarse grid, so that they share cells, or wild.
fn any_points() -> impl Strategy<Value = Vec<[f32; 3]>> {
    let near = (-40i16..40, -40i16..40, -9i16..9).prop_map(|(x, y, z)| [x, y, z].map(|x| f32::from(x) / 3.0));
    let wild = [any::<f32>(), any::<f32>(), any::<f32>()];
    prop::collection::vec(prop_oneof![9 => near, 1 => wild], 0..2000)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn segments_are_numbered_from_zero_and_large_enough(
        points in any_points(), up in [-1f64..1.0, -1f64..1.0, 0.01f64..1.0], knows_up: bool
    ) {
        let up = knows_up.then(|| Unit::new_normalize(Vector3::from(up)));
        let found = segment_sweep(&points, up, &CONFIG);
        let mut sizes = vec![0; found.kinds.len()];
        for &id in found.ids.iter().filter(|&&id| id != NO_SEGMENT) {
            sizes[id as usize] += 1;
        }
        let num_returns = Returns::of(&points).points.len();
        prop_assert!(sizes.iter().all(|&size| size >= min_points_of_segment(num_returns, CONFIG.min_points)));
        prop_assert!(found.kinds.is_sorted_by_key(|&kind| kind as u8));
    }

    #[test]
    fn kinds_turn_with_the_sweep(angle in 0f64..6.3, tilt in -0.3f64..0.3) {
        let boxes = [([7.0, -1.0, -HEIGHT], [9.0, 1.0, 0.5]), ([-9.0, 3.0, -HEIGHT], [5.0, 4.0, 0.5])];
        let (points, _) = sweep(32, |x, _| 0.05 * x, &boxes);
        let turn = Rotation3::from_euler_angles(tilt, 0.0, angle);
        let up = Unit::new_unchecked(turn * Vector3::z());
        let (one, other) = (
            segment_sweep(&points, z(), &CONFIG),
            segment_sweep(&turned(&points, &turn), Some(up), &CONFIG),
        );
        let kind = |sweep: &SegmentedSweep, i: usize| sweep.kinds.get(sweep.ids[i] as usize).copied();
        let alike = (0..points.len()).filter(|&i| kind(&one, i) == kind(&other, i)).count();
        prop_assert!(alike as f64 > 0.97 * points.len() as f64, "{} of {}", alike, points.len());
    }
}

#[test]
fn turned_segments_lie_where_the_turn_takes_them() {
    const NUM_TURNS: usize = 3;
    let boxes = [([8.0, -2.0, -2.0], [9.0, 2.0, 0.5]), ([-2.0, 10.0, -2.0], [2.0, 11.0, 0.5])];
    let (points, _) = sweep(64, |_, _| 0.0, &boxes);
    let segmented = segment_sweep(&points, z(), &CONFIG);
    let found = crate::segmentation::turned(&[&points], &[&segmented], NUM_TURNS).expect("few segments");
    let row =
        |point: usize, turn: usize| usize::from(found[0].rows(point)[turn]) - turn * segmented.kinds.len();
    let (mut num_seen, mut num_ground) = (0, 0);
    for (point, position) in points.iter().enumerate() {
        if segmented.ids[point] != NO_SEGMENT {
            assert_eq!(row(point, 0), segmented.ids[point] as usize);
            // A quarter turn moves the objects ahead to where there is only ground, and those on the left to the
            // back.
            if position[0] > 3.0
                && segmented.kinds[row(point, 0)] == SegmentKind::Object
                && position[1].abs() < 2.5
            {
                num_seen += 1;
                num_ground += usize::from(segmented.kinds[row(point, 3)] == SegmentKind::Ground);
            }
        }
    }
    assert!(num_seen > 100 && num_ground > num_seen * 7 / 10, "{num_ground} of {num_seen}");
}
