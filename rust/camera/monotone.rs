//! Radii that grow with the incidence angle, or with another radius: how far they do, and their inverse.

/// Far below a pixel, in normalised image units; where those are large, a share of them, above round-off.
pub(super) const TOLERANCE: f64 = 1e-12;
/// Samples on which a radius is checked to be monotone.
const STEPS: usize = 4096;

/// Bisection for `f(x) = y` on `[0, limit]`, where `f` grows.
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
