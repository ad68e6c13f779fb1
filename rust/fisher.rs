//! The upper tail of Fisher's F distribution, for the limits of tests.

use statrs::function::beta::{beta_reg, ln_beta};

/// Largest probability of a tail; Newton's method is sure to converge in it.
pub const MAX_TAIL: f64 = 0.1;
/// Newton's steps; they double the digits, and five reach the last one.
const NUM_STEPS: usize = 20;

/// The value that F exceeds with probability `alpha`; none unless `0 < alpha <= MAX_TAIL` and both degrees of freedom
/// are finite, at least 1 and above 0.
///
/// With a = `denominator` / 2, b = `numerator` / 2 and y = a / (a + b F), the probability is the incomplete beta function
/// I_y(a, b). Its logarithm is almost linear in that of y, over which Newton's method solves for `alpha`.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_two_degrees_of_freedom_above_the_tail_is_a_power() {
        for denominator in [1.0f64, 6.0, 300.0, 1e6] {
            for alpha in [MAX_TAIL, 1e-3, 1e-7] {
                let expected = 0.5 * denominator * (alpha.powf(-2.0 / denominator) - 1.0);
                let found = fisher_limit(alpha, 2.0, denominator).expect("known");
                // statrs subtracts logarithms of gamma functions, which are up to 1e7.
                assert!((found / expected - 1.0).abs() < 1e-9, "{denominator} {alpha}: {found} {expected}");
            }
        }
    }

    #[test]
    fn what_is_no_tail_has_no_limit() {
        for (alpha, numerator, denominator) in
            [(0.2, 6.0, 9.0), (0.0, 6.0, 9.0), (f64::NAN, 6.0, 9.0), (0.05, 0.5, 9.0), (0.05, 6.0, 0.0)]
        {
            assert_eq!(fisher_limit(alpha, numerator, denominator), None);
        }
        assert_eq!(fisher_limit(0.05, 6.0, f64::INFINITY), None);
    }
}
