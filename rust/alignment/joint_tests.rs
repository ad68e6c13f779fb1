//! Tests of Newton's method on the pose, alone and with intrinsics and time offset.

use std::sync::Arc;

use geometry::camera::{Camera, Intrinsic};
use geometry::se3;
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector6};

use super::joint::{AscentConfig, maximise};
use super::level::Level;
use super::newton::PenalisedInformation;
use super::projection::Neighbourhood;
use super::sample::Counted;
use super::selection::Selection;
use super::test_scene::{scene, segmented};
use super::variables::{Estimate, Variables, within_baseline};
use crate::agreement::measure;
use crate::classes::NO_CLASS;
use crate::observation::{Frame, Observations};

fn variables(observations: &Observations) -> Variables {
    let names = ["fx", "fy", "cx", "cy", "0", "1"];
    let twist = Vector6::new(3.0, -1.0, 0.5, 0.2, -0.1, 0.3);
    let twists = (0..observations.frames.len()).map(|frame| twist * (1.0 + frame as f64)).collect();
    Variables {
        intrinsics: names.iter().filter_map(|name| Intrinsic::of(name)).collect(),
        twists: Some(twists),
    }
}

fn config(count: usize) -> AscentConfig {
    AscentConfig {
        factors: vec![2, 1],
        max_coarse_points: usize::MAX,
        max_rounds: 10,
        max_steps: 8,
        tolerance: 1e-3,
        changes: vec![0.0; count - 6],
        sigmas: vec![1.0; count - 6],
        evidence: 1e4,
    }
}

#[test]
fn the_gradient_is_that_of_finite_differences() {
    const STEP: f64 = 1e-6;
    // Pairs of segments lighter than a tenth of a point have the slope of one with that weight.
    for (observations, tolerance) in [(scene(0.3), 1e-4), (segmented(2), 1e-2)] {
        let variables = variables(&observations);
        let n = variables.count();
        let pose = se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006));
        let anchor = Estimate { pose, camera: observations.camera.clone(), offset_s: 0.0 };
        let level = Level::new(Arc::clone(&observations), &[], 4, usize::MAX);
        let mut samples = level.samples(&pose, Counted::All);
        let near = Neighbourhood::new(&variables, &anchor).expect("numbers of the lens");
        let at = DVector::from_fn(n, |i, _| if i < 6 { 0.0 } else { 1e-3 * (i as f64).sin() });
        // Points that cross the middle of a block within the step are left out: the slope jumps there.
        let there = near.projection(&at).expect("a possible camera");
        samples.retain(|sample| {
            let (_, pixel) = there.place(sample).expect("in front");
            let place = |x: f64| ((x + 0.5) / level.factor as f64 - 0.5).rem_euclid(1.0);
            [pixel.x, pixel.y].iter().all(|&x| (1e-3..0.999).contains(&place(x)))
        });
        let offset_from_prior = DVector::from_element(n, 0.1);
        let precision = DVector::from_fn(n, |i, _| if i < 6 { 0.0 } else { 0.01 });
        let penalised = PenalisedInformation {
            level: &level,
            samples: &samples,
            constant: &level.empty_joint(),
            near: &near,
            precision: &precision,
            offset_from_prior: &offset_from_prior,
            steps: DMatrix::identity(n, n),
            blocks: DMatrix::identity(n, n),
        };
        let (_, placed) = penalised.value(&at).expect("a possible camera");
        let gradient = penalised.gradient(&at, placed);
        for axis in 0..n {
            let value = |by: f64| {
                let mut moved = at.clone();
                moved[axis] += by;
                penalised.value(&moved).expect("a possible camera").0
            };
            let slope = (value(STEP) - value(-STEP)) / (2.0 * STEP);
            let allowed = tolerance * (1.0 + gradient.norm());
            assert!((slope - gradient[axis]).abs() < allowed, "{axis}: {slope} {}", gradient[axis]);
        }
    }
}

#[test]
fn at_the_longest_baseline_it_settles_higher_than_it_began() {
    let intrinsics = vec![Intrinsic::Fx, Intrinsic::Fy, Intrinsic::Cx, Intrinsic::Cy];
    let variables = Variables { intrinsics, twists: None };
    // The stated camera is wrong, and its best place is farther away than it may move.
    let best = Isometry3::translation(0.4, 0.0, 0.0);
    let frame = scene(0.0).frames[0].clone();
    let point = |point: &[f32; 3]| (best.inverse() * Point3::from(*point).cast::<f64>()).cast::<f32>().into();
    let points: Vec<[f32; 3]> = frame.points.iter().map(point).collect();
    let mut observations = scene(0.0).with_frames(vec![Frame { points: Arc::new(points.into()), ..frame }]);
    let changes = [(Intrinsic::Fx, 4.0), (Intrinsic::Fy, -3.0), (Intrinsic::Cx, 0.8)];
    observations.camera = observations.camera.changed(changes).expect("a possible camera");
    for max_baseline_m in [0.1, 0.2, 0.3] {
        let config =
            AscentConfig { factors: vec![4, 2, 1], sigmas: vec![10.0; 4], ..config(variables.count()) };
        observations.max_baseline_m = max_baseline_m;
        let start = within_baseline(&best, max_baseline_m);
        let found =
            maximise(&Arc::new(observations.clone()), &start, &variables, None, &config).expect("a top");
        let information = |camera: &Camera, pose: &Isometry3<f64>| {
            let mut seen = observations.clone();
            seen.camera = camera.clone();
            measure(&seen, pose).joint.mutual_information()
        };
        let Estimate { pose, camera, .. } = &found.estimate;
        // The polish counts as settled below this, pixels.
        assert!(found.moved_px < 0.1, "{max_baseline_m}: {}", found.moved_px);
        assert!(pose.translation.vector.norm() < max_baseline_m + 1e-12, "{pose}");
        assert!(information(camera, pose) > information(&observations.camera, &start), "{max_baseline_m}");
    }
}

#[test]
fn the_histogram_at_a_pose_is_that_of_the_samples_there() {
    let pose = se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006));
    let mut unlabelled = (*scene(0.3)).clone();
    let classes = Arc::make_mut(&mut unlabelled.frames[0].point_classes);
    classes.iter_mut().step_by(3).for_each(|class| *class = NO_CLASS);
    for observations in [scene(0.3), segmented(2), Arc::new(unlabelled)] {
        for (counted, max_points) in [
            (Counted::All, usize::MAX),
            (Counted::Visible, usize::MAX),
            (Counted::All, 200),
            (Counted::Visible, 200),
        ] {
            let level = Level::new(Arc::clone(&observations), &[pose], 4, max_points);
            let samples = level.samples(&pose, counted);
            assert!(samples.iter().all(|sample| sample.class != NO_CLASS));
            let (joint, num_samples) = level.joint_at(&pose, counted);
            assert_eq!(num_samples, samples.len());
            let expected = level.joint(&samples, &level.projection(&pose));
            let pairs = joint.weights.iter().zip(&expected.weights);
            assert!(
                pairs.into_iter().all(|(found, expected)| (found - expected).abs() < 1e-4),
                "{counted:?}"
            );
        }
    }
}

#[test]
fn where_nothing_changes_a_polish_neither_settles_nor_has_a_curvature() {
    let mut blank = (*scene(0.0)).clone();
    Arc::make_mut(&mut blank.frames[0].point_classes).fill(0);
    let (start, pose_alone) = (Isometry3::identity(), Variables::default());
    let found = maximise(&Arc::new(blank), &start, &pose_alone, None, &config(6)).expect("a possible camera");
    assert_eq!((found.moved_px, found.inverse_curvature), (f64::INFINITY, None));
}

#[test]
fn points_amid_one_class_are_summed_up_once() {
    let level = Level::new(scene(0.0), &[], 1, usize::MAX);
    let pose = Isometry3::identity();
    let all = level.samples(&pose, Counted::All);
    let Selection { moving: left, constant, .. } = level.select(&pose, Counted::All, 2);
    assert!(left.len() < all.len() && constant.total() > 0.0);
    // A third of a pixel away, the points that were left out have not changed.
    let nearby = level.projection(&se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.005, 0.0, 0.0)));
    let (whole, whole_gradient) = level.joint_and_gradient(&all, &level.empty_joint(), &nearby);
    let (split, split_gradient) = level.joint_and_gradient(&left, &constant, &nearby);
    assert!((whole.mutual_information() - split.mutual_information()).abs() < 1e-12);
    assert!((whole_gradient - split_gradient).norm() < 1e-9);
}

#[test]
fn plain_points_are_counted_and_pull_nothing() {
    let mut observations = (*scene(0.3)).clone();
    observations.frames[0].plain_class = Some(1);
    let (level, pose) = (Level::new(Arc::new(observations), &[], 1, usize::MAX), Isometry3::identity());
    let all = level.samples(&pose, Counted::Visible);
    let Selection { moving, constant, .. } = level.select_for_newton(&pose, &Variables::default());
    assert!(all.iter().any(|sample| sample.class == 1) && !moving.is_empty());
    assert!(moving.iter().all(|sample| sample.class != 1));
    let here = level.projection(&pose);
    let whole = level.joint(&all, &here);
    let (split, _) = level.joint_and_gradient(&moving, &constant, &here);
    let apart = whole.weights.iter().zip(&split.weights).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-3);
    for (names, are_counted) in [(&["cx"][..], true), (&["cy"], false), (&["cx", "cy"], false)] {
        let intrinsics = names.iter().filter_map(|name| Intrinsic::of(name)).collect();
        let variables = Variables { intrinsics, twists: None };
        let Selection { moving, .. } = level.select_for_newton(&pose, &variables);
        assert_eq!(moving.iter().all(|sample| sample.class != 1), are_counted, "{names:?}");
    }
}
