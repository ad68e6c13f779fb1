//! What an ascent maximises: mutual information, or an objective that also has a sign.
//!
//! Mutual information does not ask in which direction classes differ: it is as high where the edges of sweeps lie on
//! weak gradients as where they lie on strong ones. Where the classes of pixels are levels in ascending order, and
//! points of class 0, the plain ones, belong on lower levels than all others, the objectives here ask for that.

use crate::mutual_information::JointHistogram;

/// What an ascent maximises.
#[derive(Clone, Debug, PartialEq)]
pub enum Objective {
    /// Mutual information, or the adjusted one if points have partitions.
    Information,
    /// Mutual information, to which a class of points contributes negatively where its mean level is below that of
    /// plain points.
    SignedInformation,
    /// The mean level under points of all classes but the plain one, which have a weight each, less that under plain
    /// points. It is linear in the levels, so that its maxima are wider than those of information.
    Contrast(Vec<f64>),
}

/// Contribution of each pair to the contrast of a joint histogram.
///
/// With the weight `a_x` of each class (that of plain points is not used), the share `p_x` of its points, and its mean
/// level `m_x`, the contrast is `C = sum_x a_x p_x m_x / sum_x a_x p_x - m_0`. A pair with level `y` contributes
/// `y a_x / sum_x a_x p_x`, or `-y / p_0` if the point is plain: the mean over all points is C. As long as points keep
/// their weights, only the `m_x` change with the pose, so that its slope is that of C.
pub(super) fn contrast(joint: &JointHistogram, num_levels: usize, weights: &[f64]) -> Vec<f64> {
    let total = joint.total();
    let shares: Vec<f64> =
        joint.weights.chunks_exact(num_levels).map(|row| row.iter().sum::<f64>() / total).collect();
    let of_edges: f64 = shares.iter().zip(weights).skip(1).map(|(share, weight)| share * weight).sum();
    let mut factors: Vec<f64> = weights.iter().map(|weight| weight / of_edges).collect();
    match shares.first() {
        Some(&of_plain) if of_plain > 0.0 && of_edges > 0.0 => factors[0] = -1.0 / of_plain,
        _ => factors.fill(0.0),
    }
    factors.iter().flat_map(|factor| (0..num_levels).map(move |level| factor * level as f64)).collect()
}

/// Contribution of each pair to the signed information, given its pointwise mutual information.
///
/// With the sign `s_x` of each class, the signed information is `S = sum_xy p(x, y) s_x pmi(x, y)`, and a pair
/// contributes `s_x pmi(x, y) - E[s | y] + E[s]`: the mean is S. The marginals of the levels no longer cancel from
/// its slope, as they do where all signs are equal, but leave the second term.
pub(super) fn signed(joint: &JointHistogram, num_levels: usize, pointwise: Vec<f64>) -> Vec<f64> {
    let signs = signs(joint, num_levels);
    let total = joint.total();
    let (mut columns, mut of_columns) = (vec![0.0; num_levels], vec![0.0; num_levels]);
    for (row, sign) in joint.weights.chunks_exact(num_levels).zip(&signs) {
        for (level, weight) in row.iter().enumerate() {
            columns[level] += weight;
            of_columns[level] += sign * weight;
        }
    }
    let of_all = if total > 0.0 { of_columns.iter().sum::<f64>() / total } else { 0.0 };
    let mean_sign =
        |level: usize| if columns[level] > 0.0 { of_columns[level] / columns[level] } else { of_all };
    let mut values = pointwise;
    for (row, sign) in values.chunks_exact_mut(num_levels).zip(&signs) {
        row.iter_mut()
            .enumerate()
            .for_each(|(level, value)| *value = sign * *value - mean_sign(level) + of_all);
    }
    values
}

/// Sign of each class of points: -1 where its mean level is below that of the plain points.
fn signs(joint: &JointHistogram, num_levels: usize) -> Vec<f64> {
    let mean_level = |row: &[f64]| {
        let weight: f64 = row.iter().sum();
        let levels = row.iter().enumerate().map(|(level, weight)| level as f64 * weight);
        (weight > 0.0).then(|| levels.sum::<f64>() / weight)
    };
    let means: Vec<Option<f64>> = joint.weights.chunks_exact(num_levels).map(mean_level).collect();
    let plain = means.first().copied().flatten();
    means
        .iter()
        .map(|&mean| if mean.zip(plain).is_some_and(|(mean, plain)| mean < plain) { -1.0 } else { 1.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geometry::se3;
    use nalgebra::Vector6;

    use super::super::level::Level;
    use super::super::sample::Counted;
    use super::super::test_scene::scene;
    use super::*;

    /// Plain points, of which a quarter are on level 1, and as many edges.
    fn histogram(edges: [f64; 2]) -> JointHistogram {
        let mut joint = JointHistogram::new(2, 2);
        joint.weights = [3.0, 1.0, edges[0], edges[1]].to_vec();
        joint
    }

    fn mean_value(joint: &JointHistogram, values: &[f64]) -> f64 {
        joint.weights.iter().zip(values).map(|(weight, value)| weight * value).sum::<f64>() / joint.total()
    }

    #[test]
    fn closed_forms() {
        let contrast = |edges| mean_value(&histogram(edges), &contrast(&histogram(edges), 2, &[0.0, 3.0]));
        assert!((contrast([1.0, 3.0]) - (0.75 - 0.25)).abs() < 1e-15);
        assert!((contrast([4.0, 0.0]) - (0.0 - 0.25)).abs() < 1e-15);
        let signed = |edges| {
            let joint = histogram(edges);
            mean_value(&joint, &signed(&joint, 2, joint.pointwise()))
        };
        let right = histogram([1.0, 3.0]);
        assert!((signed([1.0, 3.0]) - right.mutual_information()).abs() < 1e-15);
        // Edges on weaker gradients than plain points: of all points, 7 and 1 of 8 are on the two levels.
        let of_plain = 0.75 * (0.75f64 / 0.875).ln() + 0.25 * (0.25f64 / 0.125).ln();
        let of_edges = (1.0f64 / 0.875).ln();
        let wrong = histogram([4.0 - 1e-12, 1e-12]);
        let value = mean_value(&wrong, &super::signed(&wrong, 2, wrong.pointwise()));
        assert!((value - 0.5 * (of_plain - of_edges)).abs() < 1e-9, "{value}");
    }

    #[test]
    fn without_plain_points_there_is_no_contrast() {
        let mut joint = JointHistogram::new(2, 2);
        joint.weights = [0.0, 0.0, 1.0, 3.0].to_vec();
        assert_eq!(contrast(&joint, 2, &[0.0, 1.0]), [0.0; 4]);
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        const STEP: f64 = 1e-6;
        let pose = se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006));
        // Plain points lie on level 1 here, and those of class 1 below them: the signs of the classes differ.
        let mut observations = (*scene(0.3)).clone();
        let classes = Arc::make_mut(&mut observations.frames[0].point_classes);
        classes.iter_mut().for_each(|class| *class = [1, 0, 2][usize::from(*class)]);
        let observations = Arc::new(observations);
        for objective in [Objective::SignedInformation, Objective::Contrast(vec![0.0, 1.0, 3.0])] {
            let is_signed = objective == Objective::SignedInformation;
            let level = Level { objective, ..Level::new(Arc::clone(&observations), &[], 4, usize::MAX) };
            let mut samples = level.samples(&pose, Counted::All);
            let at = level.projection(&pose);
            // Points that cross the middle of a block within the step are left out: the slope jumps there.
            samples.retain(|sample| {
                let (_, pixel) = at.place(sample).expect("in front");
                let place = |x: f64| ((x + 0.5) / level.factor as f64 - 0.5).rem_euclid(1.0);
                [pixel.x, pixel.y].iter().all(|&x| (1e-3..0.999).contains(&place(x)))
            });
            let (joint, gradient) = level.joint_and_gradient(&samples, &level.empty_joint(), &at);
            if is_signed {
                assert!((level.score(&joint) - joint.mutual_information()).abs() > 1e-3);
            }
            for axis in 0..6 {
                let value = |by: f64| {
                    let twist = Vector6::from_fn(|i, _| if i == axis { by } else { 0.0 });
                    level.score(&level.joint(&samples, &level.projection(&(se3::exp(&twist) * pose))))
                };
                let slope = (value(STEP) - value(-STEP)) / (2.0 * STEP);
                let allowed = 1e-4 * (1.0 + gradient.norm());
                assert!((slope - gradient[axis]).abs() < allowed, "{axis}: {slope} {}", gradient[axis]);
            }
        }
    }
}
