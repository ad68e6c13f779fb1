//! Distortion of normalised image coordinates: OpenCV's polynomials, their inverse, and the radius up to which
//! they, or radii as functions of the incidence angle, do not fold.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Vector2};

/// Largest normalised radius, 87 degrees, at which a lens that maps the half-space in front of it is evaluated.
pub(super) const MAX_RADIUS: f64 = 20.0;
/// Number of radii, and of directions, at which a distortion is checked for folds.
const RADII: usize = 4096;
const DIRECTIONS: usize = 16;
/// At the limit itself the derivative of a distortion vanishes, and Newton's method stalls.
const NEAR_LIMIT: f64 = 0.95;
const FEW_NEWTON_STEPS: usize = 6;
const MAX_NEWTON_STEPS: usize = 50;

/// k1 k2 p1 p2 k3 k4 k5 k6: radial, rational and tangential.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Distortion(pub [f64; 8]);

impl Distortion {
    /// Whether it leaves everything where it is, as in rectified images.
    pub fn is_none(&self) -> bool {
        self.0 == [0.0; 8]
    }

    #[inline]
    pub fn at(&self, xy: Vector2<f64>) -> Vector2<f64> {
        let [_, _, p1, p2, ..] = self.0;
        let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
        let tangential = Vector2::new(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        xy * self.radial_factor(r2) + tangential
    }

    #[inline]
    fn radial_factor(&self, r2: f64) -> f64 {
        let [k1, k2, _, _, k3, k4, k5, k6] = self.0;
        (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    }

    pub fn jacobian(&self, xy: Vector2<f64>) -> Matrix2<f64> {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.0;
        let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
        let denominator = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let factor = self.radial_factor(r2);
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
}

/// The normalised coordinates, within a radius, that a distortion maps to `distorted`. Newton's method starts
/// there, which is enough for most lenses and pixels, or else from the solution for a radial distortion.
pub(super) fn undistort(
    distort: impl Fn(Vector2<f64>) -> Vector2<f64>,
    jacobian: impl Fn(Vector2<f64>) -> Matrix2<f64>,
    distorted: &Vector2<f64>,
    limit: f64,
) -> Option<Vector2<f64>> {
    let tolerance = TOLERANCE * (1.0 + distorted.norm());
    let newton = |mut xy: Vector2<f64>, steps: usize| {
        for _ in 0..steps {
            // Beyond the limit, where the distortion may fold, the iteration would lead anywhere.
            xy *= (limit / xy.norm()).min(1.0);
            let residual = distort(xy) - distorted;
            if residual.norm() < tolerance {
                return Some(xy);
            }
            xy -= jacobian(xy).try_inverse()? * residual;
        }
        None
    };
    newton(*distorted, FEW_NEWTON_STEPS)
        .or_else(|| newton(along(&distort, distorted, limit), MAX_NEWTON_STEPS))
}

/// The point in the direction of `distorted` that is mapped to the same distance from the middle, or one near the
/// limit.
fn along(
    distort: impl Fn(Vector2<f64>) -> Vector2<f64>,
    distorted: &Vector2<f64>,
    limit: f64,
) -> Vector2<f64> {
    let Some(unit) = distorted.try_normalize(f64::MIN_POSITIVE) else { return *distorted };
    let radius = invert_monotone(|radius| distort(unit * radius).dot(&unit), distorted.norm(), limit);
    unit * radius.unwrap_or(NEAR_LIMIT * limit)
}

/// The radius, at most `largest`, up to which a distortion with this Jacobian does not fold in any direction.
pub(super) fn unfolded_radius(jacobian: impl Fn(Vector2<f64>) -> Matrix2<f64>, largest: f64) -> f64 {
    let at = |step: usize| largest * step as f64 / RADII as f64;
    let unit = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / DIRECTIONS as f64).sin_cos();
        Vector2::new(cos, sin)
    };
    let units: [Vector2<f64>; DIRECTIONS] = std::array::from_fn(unit);
    // All directions, without a branch between them, so that divisions overlap.
    let unfolded = |step: usize| {
        units.iter().fold(true, |all, unit| all & (jacobian(unit * at(step)).determinant() > 0.0))
    };
    (1..=RADII).find(|&step| !unfolded(step)).map_or(largest, |step| at(step - 1))
}

/// Far below a pixel, in normalised image units; relative where those are large, above round-off.
pub(super) const TOLERANCE: f64 = 1e-12;
/// Number of samples at which a radius is checked to be monotone.
const STEPS: usize = 4096;

/// Bisection for `f(x) = y` on `[0, limit]`, where `f` increases.
pub(super) fn invert_monotone(f: impl Fn(f64) -> f64, y: f64, limit: f64) -> Option<f64> {
    (y <= f(limit)).then_some(())?;
    let (mut low, mut high) = (0.0, limit);
    while high - low > TOLERANCE {
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

/// The angle at which a radius stops growing, at most `largest`: beyond it pixels would wrap.
pub(super) fn monotone_limit(radius: impl Fn(f64) -> f64, largest: f64) -> f64 {
    let at = |step: usize| largest * step as f64 / STEPS as f64;
    let grows = |step: usize| radius(at(step)) > radius(at(step - 1));
    (1..=STEPS).find(|&step| !grows(step)).map_or(largest, |step| at(step - 1))
}
