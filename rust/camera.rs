//! Camera models: a ray in the camera frame to a pixel, and back.
//!
//! Coefficients are in OpenCV's order. Pixels are `(u, v)`; an integer pixel is a pixel centre.

use nalgebra::{Matrix2, Matrix2x3, Point2, Vector2, Vector3};

use crate::error::{Error, Result};

/// The largest incidence angle that a fisheye lens is asked about: it sees behind itself, but never all round.
const MAX_FISHEYE_ANGLE: f64 = std::f64::consts::PI * 0.95;
/// A polynomial lens maps the half-space in front of it; past this normalised radius (87 degrees) it is not evaluated.
const MAX_POLYNOMIAL_RADIUS: f64 = 20.0;
/// Samples of the radius on which a distortion is checked to be monotone.
const MONOTONE_STEPS: usize = 4096;
const NEWTON_STEPS: usize = 50;
/// Two orders below the tolerance to which the inverse is tested, in normalised image units.
const NEWTON_TOLERANCE: f64 = 1e-12;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Lens {
    /// k1 k2 p1 p2 k3 k4 k5 k6: plumb_bob is the case k4 = k5 = k6 = 0.
    Polynomial([f64; 8]),
    /// Kannala-Brandt, k1 k2 k3 k4 on powers of the incidence angle.
    Fisheye([f64; 4]),
}

/// A calibrated camera: picture size, focal lengths, principal point and lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    focal: Vector2<f64>,
    center: Vector2<f64>,
    lens: Lens,
    /// The lens is monotone, hence invertible, up to here: a normalised radius, or an angle for fisheye.
    limit: f64,
}

impl Camera {
    /// Builds a camera from `model` (`plumb_bob`, `rational_polynomial` or `fisheye`), size in pixels, `K` and
    /// `distortion`.
    ///
    /// # Errors
    /// The model is unknown, or the number of coefficients is not the model's, or a number is not finite.
    pub fn new(
        model: &str,
        (width, height): (usize, usize),
        k: [[f64; 3]; 3],
        distortion: &[f64],
    ) -> Result<Self> {
        let numbers = k.iter().flatten().chain(distortion);
        if !numbers.clone().all(|x| x.is_finite()) || k[0][0] <= 0.0 || k[1][1] <= 0.0 {
            return Err(Error::Input(
                "camera: K and distortion need finite numbers and positive focal lengths".into(),
            ));
        }
        let mut c = [0.0; 8];
        let lens = match (model, distortion.len()) {
            ("plumb_bob", 0 | 4 | 5) | ("rational_polynomial", 0 | 8) => {
                c[..distortion.len()].copy_from_slice(distortion);
                Lens::Polynomial(c)
            }
            ("fisheye", 0 | 4) => {
                c[..distortion.len()].copy_from_slice(distortion);
                Lens::Fisheye([c[0], c[1], c[2], c[3]])
            }
            _ => {
                return Err(Error::Input(format!(
                    "camera: model {model} with {} distortion coefficients is not known",
                    distortion.len()
                )));
            }
        };
        Ok(Self {
            width,
            height,
            focal: Vector2::new(k[0][0], k[1][1]),
            center: Vector2::new(k[0][2], k[1][2]),
            lens,
            limit: monotone_limit(&lens),
        })
    }

    /// The pixel of a point (camera frame, metres); `None` where the model does not hold. The pixel may lie outside
    /// the picture: see [`Camera::contains`].
    #[inline]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Point2<f64>> {
        let distorted = match &self.lens {
            Lens::Polynomial(c) => {
                if point.z <= 0.0 {
                    return None;
                }
                let normalised = point.xy() / point.z;
                if normalised.norm_squared() > self.limit * self.limit {
                    return None;
                }
                distort(c, normalised)
            }
            Lens::Fisheye(c) => {
                let radius = point.xy().norm();
                let angle = radius.atan2(point.z);
                if angle > self.limit || (radius == 0.0 && point.z <= 0.0) {
                    return None;
                }
                if radius < f64::EPSILON {
                    point.xy() / point.z
                } else {
                    point.xy() * (fisheye_radius(c, angle) / radius)
                }
            }
        };
        Some(Point2::from(self.focal.component_mul(&distorted) + self.center))
    }

    /// The same with the Jacobian of the pixel with respect to the point, pixels a metre.
    pub fn project_with_jacobian(&self, point: &Vector3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let pixel = self.project(point)?;
        Some((pixel, self.jacobian(point)))
    }

    /// The Jacobian of the pixel of a point that the camera projects, pixels a metre.
    pub fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let jacobian = match &self.lens {
            Lens::Polynomial(c) => {
                let (x, y, inverse) = (point.x / point.z, point.y / point.z, 1.0 / point.z);
                let normalised = Matrix2x3::new(inverse, 0.0, -x * inverse, 0.0, inverse, -y * inverse);
                distort_jacobian(c, Vector2::new(x, y)) * normalised
            }
            Lens::Fisheye(c) => fisheye_jacobian(c, point),
        };
        Matrix2::from_diagonal(&self.focal) * jacobian
    }

    /// The unit ray (camera frame) that lands on a pixel; `None` where the lens reaches no such pixel.
    pub fn unproject(&self, pixel: &Point2<f64>) -> Option<Vector3<f64>> {
        let distorted = (pixel.coords - self.center).component_div(&self.focal);
        match &self.lens {
            Lens::Polynomial(c) => {
                let normalised = undistort(c, distorted)?;
                (normalised.norm() <= self.limit).then(|| normalised.push(1.0).normalize())
            }
            Lens::Fisheye(c) => {
                let radius = distorted.norm();
                let angle = invert_monotone(|a| fisheye_radius(c, a), radius, self.limit)?;
                let scale = if radius < f64::EPSILON { 1.0 } else { angle.sin() / radius };
                Some((distorted * scale).push(angle.cos()))
            }
        }
    }

    /// The largest normalised radius (or, for a fisheye lens, incidence angle in radians) at which the model holds.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Whether a pixel lies inside the picture, whose pixels reach half a pixel beyond their centres.
    #[inline]
    pub fn contains(&self, pixel: &Point2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x < self.width as f64 - 0.5
            && pixel.y < self.height as f64 - 0.5
    }
}

/// OpenCV's radial and tangential distortion of normalised image coordinates.
#[inline]
fn distort(c: &[f64; 8], xy: Vector2<f64>) -> Vector2<f64> {
    let [_, _, p1, p2, ..] = *c;
    let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
    let tangential =
        Vector2::new(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
    xy * radial_factor(c, r2) + tangential
}

#[inline]
fn radial_factor(c: &[f64; 8], r2: f64) -> f64 {
    let [k1, k2, _, _, k3, k4, k5, k6] = *c;
    (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
}

/// The Jacobian of [`distort`].
fn distort_jacobian(c: &[f64; 8], xy: Vector2<f64>) -> Matrix2<f64> {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = *c;
    let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
    let denominator = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let factor = radial_factor(c, r2);
    // With respect to r^2.
    let slope = (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) - factor * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6)))
        / denominator;
    let tangential = Matrix2::new(
        2.0 * p1 * y + 6.0 * p2 * x,
        2.0 * p1 * x + 2.0 * p2 * y,
        2.0 * p1 * x + 2.0 * p2 * y,
        6.0 * p1 * y + 2.0 * p2 * x,
    );
    Matrix2::identity() * factor + xy * xy.transpose() * (2.0 * slope) + tangential
}

/// The Jacobian of a fisheye lens's distorted coordinates with respect to the point.
fn fisheye_jacobian(c: &[f64; 4], point: &Vector3<f64>) -> Matrix2x3<f64> {
    let (xy, radius, range2) = (point.xy(), point.xy().norm(), point.norm_squared());
    if radius < f64::EPSILON {
        return Matrix2x3::new(1.0 / point.z, 0.0, 0.0, 0.0, 1.0 / point.z, 0.0);
    }
    let angle = radius.atan2(point.z);
    let a2 = angle * angle;
    let slope = 1.0 + a2 * (3.0 * c[0] + a2 * (5.0 * c[1] + a2 * (7.0 * c[2] + a2 * 9.0 * c[3])));
    let (unit, scale) = (xy / radius, fisheye_radius(c, angle) / radius);
    // Along the radius the distorted radius changes with the angle, d angle = (z dr - r dz) / range^2; across it the
    // picture only turns.
    let along = Vector3::new(unit.x * point.z, unit.y * point.z, -radius) * (slope / range2);
    let across = (Matrix2::identity() - unit * unit.transpose()) * scale;
    unit * along.transpose() + across * Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
}

#[inline]
fn fisheye_radius(c: &[f64; 4], angle: f64) -> f64 {
    let a2 = angle * angle;
    angle * (1.0 + a2 * (c[0] + a2 * (c[1] + a2 * (c[2] + a2 * c[3]))))
}

/// Newton's method on [`distort`], with a Jacobian by central differences.
fn undistort(c: &[f64; 8], distorted: Vector2<f64>) -> Option<Vector2<f64>> {
    const STEP: f64 = 1e-6;
    let mut xy = distorted;
    for _ in 0..NEWTON_STEPS {
        let residual = distort(c, xy) - distorted;
        if residual.norm() < NEWTON_TOLERANCE {
            return Some(xy);
        }
        let column =
            |axis: Vector2<f64>| (distort(c, xy + axis * STEP) - distort(c, xy - axis * STEP)) / (2.0 * STEP);
        let jacobian = Matrix2::from_columns(&[column(Vector2::x()), column(Vector2::y())]);
        xy -= jacobian.lu().solve(&residual)?;
    }
    None
}

/// Bisection for `f(x) = y` on `[0, limit]`, where `f` grows.
fn invert_monotone(f: impl Fn(f64) -> f64, y: f64, limit: f64) -> Option<f64> {
    if y > f(limit) {
        return None;
    }
    let (mut low, mut high) = (0.0, limit);
    while high - low > NEWTON_TOLERANCE {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if f(middle) < y {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// The radius (or angle) at which the distorted radius stops growing: beyond it pixels would wrap.
fn monotone_limit(lens: &Lens) -> f64 {
    let (limit, radius): (f64, Box<dyn Fn(f64) -> f64>) = match *lens {
        Lens::Polynomial(c) => (MAX_POLYNOMIAL_RADIUS, Box::new(move |r| r * radial_factor(&c, r * r))),
        Lens::Fisheye(c) => (MAX_FISHEYE_ANGLE, Box::new(move |a| fisheye_radius(&c, a))),
    };
    let at = |step: usize| limit * step as f64 / MONOTONE_STEPS as f64;
    (1..=MONOTONE_STEPS)
        .find(|&step| radius(at(step)) <= radius(at(step - 1)))
        .map_or(limit, |step| at(step - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(model: &str, distortion: &[f64]) -> Camera {
        let k = [[600.0, 0.0, 639.5], [0.0, 610.0, 359.5], [0.0, 0.0, 1.0]];
        Camera::new(model, (1280, 720), k, distortion).expect("a valid camera")
    }

    fn cameras() -> Vec<Camera> {
        vec![
            camera("plumb_bob", &[]),
            camera("plumb_bob", &[-0.3, 0.1, 0.001, -0.002, -0.01]),
            camera("rational_polynomial", &[0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02]),
            camera("fisheye", &[-0.02, 0.003, -0.001, 0.0]),
        ]
    }

    #[test]
    fn unproject_then_project_is_the_identity_on_the_picture() {
        for camera in cameras() {
            let mut seen = 0;
            for v in (0..720).step_by(40) {
                for u in (0..1280).step_by(40) {
                    let pixel = Point2::new(u as f64, v as f64);
                    let Some(ray) = camera.unproject(&pixel) else {
                        continue;
                    };
                    assert!((ray.norm() - 1.0).abs() < 1e-9);
                    let back = camera.project(&(ray * 7.0)).expect("a ray of the lens projects");
                    assert!((back - pixel).norm() < 1e-6, "{camera:?} {pixel} {back}");
                    seen += 1;
                }
            }
            assert!(seen > 400, "{camera:?} reaches only {seen} of 576 pixels");
        }
    }

    #[test]
    fn jacobians_are_those_of_finite_differences() {
        const STEP: f64 = 1e-6;
        for camera in cameras() {
            for point in
                [Vector3::new(0.0, 0.0, 3.0), Vector3::new(0.8, -0.3, 2.0), Vector3::new(-1.5, 0.7, 1.9)]
            {
                let (_, jacobian) = camera.project_with_jacobian(&point).expect("in front");
                for axis in 0..3 {
                    let mut step = Vector3::zeros();
                    step[axis] = STEP;
                    let pixel = |p: Vector3<f64>| camera.project(&p).expect("in front");
                    let slope = (pixel(point + step) - pixel(point - step)) / (2.0 * STEP);
                    assert!((slope - jacobian.column(axis)).norm() < 1e-5, "{camera:?} {point} {axis}");
                }
            }
        }
    }

    #[test]
    fn points_behind_a_camera_never_fold_to_its_front() {
        for camera in cameras() {
            assert!(camera.project(&Vector3::new(0.0, 0.0, -1.0)).is_none());
        }
        assert!(camera("plumb_bob", &[]).project(&Vector3::new(1.0, 1.0, -1.0)).is_none());
    }

    #[test]
    fn a_lens_ends_where_its_distortion_turns_back() {
        // r (1 - 0.3 r^2) grows up to r = 1 / sqrt(0.9) = 1.054.
        let camera = camera("plumb_bob", &[-0.3, 0.0, 0.0, 0.0]);
        assert!(camera.project(&Vector3::new(1.04, 0.0, 1.0)).is_some());
        assert!(camera.project(&Vector3::new(1.07, 0.0, 1.0)).is_none());
    }

    #[test]
    fn a_wrong_number_of_coefficients_is_refused() {
        let k = [[600.0, 0.0, 639.5], [0.0, 610.0, 359.5], [0.0, 0.0, 1.0]];
        assert!(Camera::new("plumb_bob", (1280, 720), k, &[0.1]).is_err());
        assert!(Camera::new("fisheye", (1280, 720), k, &[0.1; 5]).is_err());
    }
}
