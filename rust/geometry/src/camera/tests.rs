use std::f64::consts::{PI, TAU};

use nalgebra::{Point2, Vector3};
use proptest::prelude::*;

use super::{Camera, Intrinsic, IntrinsicSlopes};

const SIZE: (usize, usize) = (1280, 720);
const K: [[f64; 3]; 3] = [[600.0, 0.0, 639.5], [0.0, 610.0, 359.5], [0.0, 0.0, 1.0]];

fn camera_of(focal: f64, model: &str, distortion: &[f64], parameters: &[(&str, f64)]) -> Camera {
    let k = [[focal, 0.0, 639.5], [0.0, focal * 61.0 / 60.0, 359.5], [0.0, 0.0, 1.0]];
    let parameters: Vec<_> = parameters.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    Camera::with_parameters(model, SIZE, k, distortion, &parameters).expect("a valid camera")
}

/// A camera whose pixel axes are not at a right angle.
fn skewed(model: &str, distortion: &[f64]) -> Camera {
    let k = [[600.0, 4.0, 639.5], [0.0, 610.0, 359.5], [0.0, 0.0, 1.0]];
    Camera::new(model, SIZE, k, distortion).expect("a valid camera")
}

fn camera(model: &str, distortion: &[f64]) -> Camera {
    camera_of(600.0, model, distortion, &[])
}

const RATIONAL: [f64; 14] =
    [0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02, 0.003, -0.001, 0.002, 0.0005, 0.02, -0.03];

fn cameras() -> Vec<Camera> {
    vec![
        camera("plumb_bob", &[]),
        camera("plumb_bob", &[-0.3, 0.1, 0.001, -0.002, -0.01]),
        skewed("plumb_bob", &[-0.3, 0.1, 0.001, -0.002, -0.01]),
        skewed("fisheye", &[-0.02, 0.003, -0.001, 0.0]),
        camera("rational_polynomial", &RATIONAL[..8]),
        camera("thin_prism", &RATIONAL[..12]),
        camera("thin_prism", &RATIONAL),
        camera("fisheye", &[-0.02, 0.003, -0.001, 0.0]),
        // 210 degrees from the left to the right.
        camera_of(349.0, "fisheye", &[0.0; 4], &[]),
        // KITTI-360's left fisheye, scaled to a smaller image: a circle within it.
        camera_of(700.0, "omnidirectional", &[0.0168, 1.655, 0.0004, 0.0004], &[("xi", 2.2134)]),
        camera_of(500.0, "omnidirectional", &[-0.1, 0.01, 0.001, 0.0], &[("xi", 0.9)]),
        camera_of(1280.0 / TAU, "equirectangular", &[], &[]),
        camera_of(400.0, "fov", &[0.93], &[]),
        camera_of(350.0, "double_sphere", &[], &[("xi", -0.2), ("alpha", 0.6)]),
        camera_of(500.0, "double_sphere", &[], &[("xi", 0.3), ("alpha", 0.4)]),
    ]
}

/// A unit vector at an angle from the optical axis, turned about it.
fn at(angle: f64, turn: f64) -> Vector3<f64> {
    Vector3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos())
}

#[test]
fn jacobians_are_those_of_finite_differences() {
    const STEP: f64 = 1e-6;
    for camera in cameras() {
        for (share, turn) in [(0.0, 0.0), (0.2, 1.0), (0.5, 2.5), (0.5, 5.0), (0.9, -1.0)] {
            let point = at(share * f64::min(camera.limit(), 2.5), turn) * 3.0;
            let jacobian = camera.jacobian(&point);
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = STEP;
                let pixel = |p: Vector3<f64>| camera.project(&p).expect("within the limit");
                let slope = (pixel(point + step) - pixel(point - step)) / (2.0 * STEP);
                let error = (slope - jacobian.column(axis)).norm();
                // Round-off of the pixel, and curvature where pixels run away.
                assert!(error < 1e-7 * (1.0 + jacobian.norm()), "{camera:?} {point} {axis}: {error}");
            }
        }
    }
}

#[test]
fn nothing_beyond_the_view_is_in_the_image() {
    const STEPS: i32 = 200;
    // Less than a turn, with what is straight back in its middle and not on its border.
    let k = [[1280.0 / TAU, 0.0, -0.5], [0.0, 1280.0 / TAU, 119.5], [0.0, 0.0, 1.0]];
    let backward = Camera::new("equirectangular", (900, 240), k, &[]).expect("a valid camera");
    for camera in cameras().into_iter().chain([backward]) {
        let (min_cosine, mut least) = (camera.view_cosine(), 1.0f64);
        for (i, j) in (0..=STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
            let ray = at(PI * f64::from(i) / f64::from(STEPS), TAU * f64::from(j) / f64::from(STEPS));
            if camera.project(&ray).is_some_and(|pixel| camera.contains(&pixel)) {
                least = least.min(ray.z);
            }
        }
        assert!(min_cosine <= least, "{camera:?}: {min_cosine}, {least}");
        // It is no wider than it has to be, except where the image's corners see nothing.
        assert!(
            min_cosine == -1.0 || least.acos() + 0.1 > min_cosine.acos(),
            "{camera:?}: {min_cosine}, {least}"
        );
    }
}

#[test]
fn limits_are_those_of_the_closed_forms() {
    let limit = |camera: Camera| camera.limit();
    // r (1 - 0.3 r^2) grows up to r = 1 / sqrt(0.9); the limit is searched in steps of 0.005.
    let plumb_bob = limit(camera("plumb_bob", &[-0.3, 0.0, 0.0, 0.0]));
    assert!((plumb_bob.tan() - 0.9f64.sqrt().recip()).abs() < 0.005);
    // y + 3 p1 y^2 grows down to y = -1 / (6 p1), and across it y = -1 / (2 p1) is farther.
    let tangential = limit(camera("plumb_bob", &[0.0, 0.0, 0.1, 0.0]));
    assert!((tangential.tan() - 0.6f64.recip()).abs() < 0.005);
    let fisheye = limit(camera("fisheye", &[-0.1, 0.0, 0.0, 0.0]));
    assert!((fisheye - 0.3f64.sqrt().recip()).abs() < 0.001);
    // From 2 behind the sphere, its outline is seen at 60 degrees from behind.
    let mirror = limit(camera_of(600.0, "omnidirectional", &[], &[("xi", 2.0)]));
    assert!((mirror - 2.0 * PI / 3.0).abs() < 1e-12);
    // With xi = 0 the one sphere is seen from alpha / (1 - alpha) behind, here 2 too.
    let spheres = camera_of(600.0, "double_sphere", &[], &[("xi", 0.0), ("alpha", 2.0 / 3.0)]);
    assert!((spheres.limit() - 2.0 * PI / 3.0).abs() < 1e-12);
}

#[test]
fn models_are_one_another_where_they_meet() {
    let (mirror, sphere) = ("omnidirectional", "double_sphere");
    let same = [
        (camera("plumb_bob", &RATIONAL[..4]), camera_of(600.0, mirror, &RATIONAL[..4], &[("xi", 0.0)])),
        (camera("plumb_bob", &[]), camera_of(600.0, sphere, &[], &[("xi", 0.0), ("alpha", 0.0)])),
        // One sphere: xi is alpha / (1 - alpha), and focal lengths are divided by 1 - alpha.
        (
            camera_of(600.0 / 0.4, mirror, &[], &[("xi", 1.5)]),
            camera_of(600.0, sphere, &[], &[("xi", 0.0), ("alpha", 0.6)]),
        ),
    ];
    for (a, b) in same {
        assert!((a.limit() - b.limit()).abs() < 1e-9, "{a:?} {b:?}");
        for (angle, turn) in [(0.1, 1.0), (0.7, 4.0), (1.2, -2.0)] {
            let [one, other] = [&a, &b].map(|camera| camera.project(&at(angle, turn)).expect("in front"));
            assert!((one - other).norm() < 1e-9, "{a:?} {b:?}");
        }
    }
}

#[test]
fn pixels_are_those_of_the_closed_forms() {
    // A fisheye without coefficients: 600 pixels a radian, also behind.
    let pixel = camera("fisheye", &[]).project(&at(1.9, 0.0)).expect("the lens sees behind itself");
    assert!((pixel - Point2::new(639.5 + 600.0 * 1.9, 359.5)).norm() < 1e-9);
    let pixel = camera("fov", &[0.8]).project(&Vector3::new(0.5, 0.0, 1.0)).expect("in front");
    assert!((pixel.x - 639.5 - 600.0 * (2.0 * 0.4f64.tan() * 0.5).atan() / 0.8).abs() < 1e-9);
    let globe = camera_of(1280.0 / TAU, "equirectangular", &[], &[]);
    let (right, up) = (Vector3::new(9.0, 0.0, 0.0), Vector3::new(0.0, -1.0, 1.0));
    let quarter = Point2::new(639.5 + 320.0, 359.5);
    assert!((globe.project(&right).expect("all round") - quarter).norm() < 1e-9);
    let eighth = Point2::new(639.5, 359.5 - 160.0 * 61.0 / 60.0);
    assert!((globe.project(&up).expect("all round") - eighth).norm() < 1e-9);
}

#[test]
fn a_turn_of_an_equirectangular_image_begins_at_its_left_border() {
    // Forward is at the left border: what lies behind is in the middle.
    let k = [[1280.0 / TAU, 0.0, -0.5], [0.0, 200.0, 359.5], [0.0, 0.0, 1.0]];
    let camera = Camera::new("equirectangular", SIZE, k, &[]).expect("a valid camera");
    let behind = camera.project(&-Vector3::z()).expect("all round");
    assert!((behind - Point2::new(639.5, 359.5)).norm() < 1e-9);
    let left = camera.project(&-Vector3::x()).expect("all round");
    assert!((left - Point2::new(959.5, 359.5)).norm() < 1e-9 && camera.contains(&left));
}

#[test]
fn pixels_a_radian_are_counted_on_the_axis() {
    assert!((camera("plumb_bob", &[]).pixels_per_radian() - 600.0).abs() < 1e-9);
    let mirror = camera_of(600.0, "omnidirectional", &[], &[("xi", 2.0)]);
    assert!((mirror.pixels_per_radian() - 200.0).abs() < 1e-9);
}

#[test]
fn what_no_model_has_is_refused() {
    let refusal = |model: &str, distortion: &[f64], parameters: &[(&str, f64)]| {
        let parameters: Vec<_> = parameters.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        let made = Camera::with_parameters(model, SIZE, K, distortion, &parameters);
        made.expect_err(model).to_string()
    };
    for (model, count) in
        [("plumb_bob", 3), ("thin_prism", 13), ("equirectangular", 1), ("fov", 0), ("none", 4)]
    {
        let message = refusal(model, &vec![0.1; count], &[]);
        assert!(
            message.ends_with(&format!("model {model} with {count} distortion coefficients is not known"))
        );
    }
    for (model, distortion, parameters, complaint) in [
        ("omnidirectional", &[][..], &[][..], r#"found [], expected ["xi"] for omnidirectional"#),
        ("double_sphere", &[], &[("xi", 0.1)], r#"found ["xi"], expected ["xi", "alpha"] for double_sphere"#),
        ("plumb_bob", &[], &[("xi", 0.1)], r#"found ["xi"], expected [] for plumb_bob"#),
        ("omnidirectional", &[], &[("xi", -0.1)], "found xi -0.1, needed at least 0 and at most 100"),
        (
            "double_sphere",
            &[],
            &[("xi", 1.0), ("alpha", 0.5)],
            "found xi 1, needed more than -1 and less than 1",
        ),
        (
            "double_sphere",
            &[],
            &[("xi", 0.0), ("alpha", 1.5)],
            "found alpha 1.5, needed at least 0 and at most 1",
        ),
        ("fov", &[3.2], &[], "found w 3.2, needed more than 0 and less than pi"),
        ("fov", &[f64::NAN], &[], "need finite numbers"),
    ] {
        let message = refusal(model, distortion, parameters);
        assert!(message.contains(complaint), "{message}");
    }
    let skewed = [[600.0, 1.0, 639.5], K[1], K[2]];
    let message = Camera::new("equirectangular", SIZE, skewed, &[]).expect_err("azimuths").to_string();
    assert!(message.contains("found a skew in K"), "{message}");
}

proptest! {
    /// Whatever the coefficients, a point that projects is recovered from its pixel: no two directions share one.
    #[test]
    fn no_coefficients_make_two_directions_share_a_pixel(
        which in 0usize..6, c in prop::array::uniform12(-0.5..0.5f64), angle in 0.0..3.1f64, turn in 0.0..TAU,
    ) {
        let camera = match which {
            0 => camera("plumb_bob", &[c[0], c[1], 0.0, 0.0, c[2]]),
            1 => camera("rational_polynomial", &[c[0], c[1], 0.0, 0.0, c[2], c[3], c[4], c[5]]),
            2 => camera("fisheye", &c[..4]),
            3 => camera_of(600.0, "omnidirectional", &[c[0], c[1], 0.0, 0.0], &[("xi", 4.0 * c[2].abs())]),
            4 => camera("fov", &[1.0 + c[0]]),
            _ => camera_of(600.0, "double_sphere", &[], &[("xi", 1.9 * c[0]), ("alpha", c[1] + 0.5)]),
        };
        prop_assert!(camera.limit() > 0.0 && camera.limit() < PI);
        let ray = at(angle, turn);
        // Close to the limit pixels hardly move, and the inverse loses precision.
        if angle > 0.95 * camera.limit() {
            return Ok(());
        }
        let pixel = camera.project(&ray).expect("within the limit");
        let back = camera.unproject(&pixel);
        prop_assert!(back.is_some_and(|back| (back - ray).norm() < 1e-6), "{camera:?} {pixel} {back:?} {ray}");
    }
}

#[test]
fn pixels_move_with_the_intrinsics_as_by_finite_differences() {
    const STEP: f64 = 1e-5;
    for camera in cameras() {
        let numbers =
            (0..).map(Intrinsic::Coefficient).take_while(|&number| camera.intrinsic(number).is_some());
        let k = [Intrinsic::Fx, Intrinsic::Fy, Intrinsic::Cx, Intrinsic::Cy];
        let intrinsics: Vec<Intrinsic> = k.into_iter().chain(numbers).collect();
        let slopes = IntrinsicSlopes::new(&camera, &intrinsics).expect("numbers of the lens");
        let point = at(0.5 * f64::min(camera.limit(), 2.5), 2.5) * 3.0;
        let pixel = camera.project(&point).expect("within the limit");
        slopes.for_each(&camera, &point, &pixel, |index, slope| {
            let moved = camera.changed([(intrinsics[index], STEP)]).expect("a small change");
            let value = |camera: &Camera| camera.intrinsic(intrinsics[index]).expect("a number of the lens");
            assert!((value(&moved) - value(&camera) - STEP).abs() < 1e-9);
            let found = (moved.project(&point).expect("within the limit") - pixel) / STEP;
            assert!(
                (slope - found).norm() < 1e-2 * (1.0 + found.norm()),
                "{camera:?} {index} {slope} {found}"
            );
        });
    }
}

#[test]
fn a_number_that_a_lens_has_not_is_refused() {
    let pinhole = camera("plumb_bob", &[]);
    assert!(pinhole.changed([(Intrinsic::Coefficient(0), 0.1)]).is_err());
    assert!(IntrinsicSlopes::new(&pinhole, &[Intrinsic::Coefficient(0)]).is_err());
    let sphere = camera_of(350.0, "double_sphere", &[], &[("xi", -0.2), ("alpha", 0.6)]);
    assert!(sphere.changed([(Intrinsic::Coefficient(1), 0.5)]).is_err(), "alpha is at most 1");
}
