//! Powell's conjugate-direction method: minimisation without derivatives.
//!
//! Source: Powell, *An efficient method for finding the minimum of a function of several variables without calculating
//! derivatives*, The Computer Journal 7 (1964); the line search is Brent's.

use nalgebra::SVector;

/// Settings of the search: the stopping rule, and the reach of the first line searches.
#[derive(Clone, Copy, Debug)]
pub struct PowellConfig<const N: usize> {
    pub step: [f64; N],
    pub tolerance: f64,
    pub max_rounds: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct Minimum<const N: usize> {
    pub x: [f64; N],
    pub value: f64,
    pub num_evaluations: usize,
}

/// Minimises `f` from `start`.
///
/// Each line is searched within one `step` of the current point: the objective is a registration whose optimum is
/// known to be near the start, and a far better value elsewhere is another hypothesis.
pub fn minimize<const N: usize>(
    mut f: impl FnMut(&[f64; N]) -> f64,
    start: [f64; N],
    config: &PowellConfig<N>,
) -> Minimum<N> {
    let mut evaluations = 0;
    // In units of `step`, so that one tolerance serves all axes.
    let mut value_at = |x: &SVector<f64, N>| {
        evaluations += 1;
        f(&std::array::from_fn(|i| start[i] + x[i] * config.step[i]))
    };
    let mut directions: Vec<SVector<f64, N>> =
        (0..N).map(|i| SVector::from_fn(|j, _| if i == j { 1.0 } else { 0.0 })).collect();
    let mut x = SVector::<f64, N>::zeros();
    let mut value = value_at(&x);
    for _ in 0..config.max_rounds {
        let (round_start, round_value) = (x, value);
        let (mut largest_drop, mut largest) = (0.0, 0);
        for (index, direction) in directions.iter().enumerate() {
            let before = value;
            (x, value) = search_line(&mut value_at, x, value, direction, config.tolerance);
            if before - value > largest_drop {
                (largest_drop, largest) = (before - value, index);
            }
        }
        let moved = x - round_start;
        if moved.norm() <= config.tolerance {
            break;
        }
        // Powell's test: the total move of the round becomes a direction only if the function still falls along it
        // and no single direction caused most of the decrease.
        let extrapolated = value_at(&(x + moved));
        let curvature = round_value - 2.0 * value + extrapolated;
        let left = (round_value - value - largest_drop).powi(2);
        let right = (round_value - extrapolated).powi(2);
        if extrapolated < round_value && 2.0 * curvature * left < largest_drop * right {
            let direction = moved.normalize();
            (x, value) = search_line(&mut value_at, x, value, &direction, config.tolerance);
            directions.remove(largest);
            directions.push(direction);
        }
    }
    let x = std::array::from_fn(|i| start[i] + x[i] * config.step[i]);
    Minimum { x, value, num_evaluations: evaluations }
}

/// Brent's minimisation of `t -> f(x + t direction)` on `[-1, 1]`, which never ends above its start.
fn search_line<const N: usize>(
    f: &mut impl FnMut(&SVector<f64, N>) -> f64,
    start: SVector<f64, N>,
    start_value: f64,
    direction: &SVector<f64, N>,
    tolerance: f64,
) -> (SVector<f64, N>, f64) {
    const GOLDEN: f64 = 0.381_966_011_250_105;
    const MAX_STEPS: usize = 40;
    let (mut low, mut high) = (-1.0f64, 1.0f64);
    // Best, second best and third best so far, with their values.
    let (mut t, mut w, mut v) = (0.0, 0.0, 0.0);
    let (mut f_t, mut f_w, mut f_v) = (start_value, start_value, start_value);
    let (mut step, mut step_before) = (0.0f64, 0.0f64);
    for _ in 0..MAX_STEPS {
        let middle = 0.5 * (low + high);
        if (t - middle).abs() + 0.5 * (high - low) <= 2.0 * tolerance {
            break;
        }
        let parabola = parabolic_step([(t, f_t), (w, f_w), (v, f_v)])
            .filter(|p| p.abs() < 0.5 * step_before.abs() && (low..high).contains(&(t + p)));
        let side = if t >= middle { low - t } else { high - t };
        (step, step_before) = parabola.map_or((GOLDEN * side, side), |p| (p, step));
        let u = t + if step.abs() >= tolerance { step } else { tolerance.copysign(step) };
        let f_u = f(&(start + direction * u));
        if f_u <= f_t {
            if u >= t {
                low = t
            } else {
                high = t
            }
            (v, f_v, w, f_w, t, f_t) = (w, f_w, t, f_t, u, f_u);
        } else {
            if u < t {
                low = u
            } else {
                high = u
            }
            if f_u <= f_w || w == t {
                (v, f_v, w, f_w) = (w, f_w, u, f_u);
            } else if f_u <= f_v || v == t || v == w {
                (v, f_v) = (u, f_u);
            }
        }
    }
    if f_t < start_value { (start + direction * t, f_t) } else { (start, start_value) }
}

/// The step from the first point to the vertex of the parabola through three.
fn parabolic_step([(t, f_t), (w, f_w), (v, f_v)]: [(f64, f64); 3]) -> Option<f64> {
    let r = (t - w) * (f_t - f_v);
    let q = (t - v) * (f_t - f_w);
    let step = -0.5 * ((t - v) * q - (t - w) * r) / (q - r);
    step.is_finite().then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: PowellConfig<2> = PowellConfig { step: [1.0, 1.0], tolerance: 1e-6, max_rounds: 100 };

    #[test]
    fn finds_the_minimum_of_a_skewed_quadratic() {
        let f = |x: &[f64; 2]| {
            let (a, b) = (x[0] - 2.5, x[1] + 1.5);
            a * a + 1.8 * a * b + b * b
        };
        let minimum = minimize(f, [0.0, 0.0], &CONFIG);
        assert!((minimum.x[0] - 2.5).abs() < 1e-4 && (minimum.x[1] + 1.5).abs() < 1e-4, "{minimum:?}");
    }

    #[test]
    fn never_ends_above_its_start() {
        let steps = |x: &[f64; 2]| (x[0] * 3.0).round().abs() + (x[1] * 5.0).sin() * 0.3;
        for i in 0..20 {
            let start = [f64::from(i) * 0.17 - 1.0, f64::from(i) * 0.31];
            assert!(minimize(steps, start, &CONFIG).value <= steps(&start));
        }
    }
}
