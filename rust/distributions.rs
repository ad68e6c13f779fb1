//! Quantiles of Student's t and the upper tail of Fisher's F, for confidence intervals and test limits.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};
use statrs::function::beta::{beta_reg, ln_beta};

/// Smallest tail probability of Student's t, and its fewest degrees of freedom: beyond them the inverse of the
/// incomplete beta function is inaccurate.
pub const MIN_TAIL: f64 = 1e-9;
pub const MIN_DEGREES: f64 = 0.3;
/// From this many degrees of freedom on, that inverse loses precision, and an expansion has full precision.
const MANY_DEGREES: f64 = 1e5;

/// The quantile of Student's t; `None` unless `MIN_TAIL <= probability <= 1 - MIN_TAIL` and the degrees of freedom are
/// finite and at least [`MIN_DEGREES`].
#[must_use]
pub fn student_quantile(probability: f64, degrees_of_freedom: f64) -> Option<f64> {
    let is_known = (MIN_TAIL..=1.0 - MIN_TAIL).contains(&probability) && degrees_of_freedom >= MIN_DEGREES;
    if !(is_known && degrees_of_freedom.is_finite()) {
        return None;
    }
    if degrees_of_freedom < MANY_DEGREES {
        return Some(StudentsT::new(0.0, 1.0, degrees_of_freedom).ok()?.inverse_cdf(probability));
    }
    // Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.5.
    let z = Normal::standard().inverse_cdf(probability);
    let (first, second) = ((z.powi(3) + z) / 4.0, (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0);
    Some(z + (first + second / degrees_of_freedom) / degrees_of_freedom)
}

/// Largest tail probability, for which Newton's method is sure to converge.
pub const MAX_TAIL: f64 = 0.1;
/// Newton steps. Each doubles the number of digits, and five reach the last one.
const NUM_STEPS: usize = 20;

/// The value that F exceeds with probability `alpha`; `None` unless `0 < alpha <= MAX_TAIL` and both degrees of
/// freedom are finite, at least 1 and above 0.
///
/// With a = `denominator` / 2, b = `numerator` / 2 and y = a / (a + b F), the probability is the incomplete beta
/// function I_y(a, b). Its logarithm is almost linear in log y, over which Newton's method solves for `alpha`.
#[must_use]
pub fn fisher_limit(alpha: f64, numerator: f64, denominator: f64) -> Option<f64> {
    let (a, b) = (0.5 * denominator, 0.5 * numerator);
    let is_known = alpha > 0.0 && alpha <= MAX_TAIL && b >= 0.5 && a > 0.0;
    if !(is_known && a.is_finite() && b.is_finite()) {
        return None;
    }
    let mut ln_y = (a / (a + b)).ln();
    for _ in 0..NUM_STEPS {
        let rest = -ln_y.exp_m1();
        let tail = beta_reg(a, b, ln_y.exp());
        let slope = (a * ln_y + (b - 1.0) * rest.ln() - ln_beta(a, b)).exp();
        ln_y -= (tail / alpha).ln() * tail / slope;
    }
    Some(a / b * (-ln_y).exp_m1())
}
