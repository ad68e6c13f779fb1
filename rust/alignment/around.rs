//! The mutual information at poses around one, of the points that are visible there: what a curve shows.

use std::sync::Arc;

use nalgebra::Isometry3;
use rayon::prelude::*;

use super::level::Level;
use super::sample::Counted;
use crate::observation::Observations;

/// The mutual information in full resolution at each of the poses, nats, of the points that are visible at the anchor.
///
/// Points count with the weights that they have there, so that nothing but the pose changes along a curve.
pub fn information_around(
    observations: &Arc<Observations>,
    anchor: &Isometry3<f64>,
    poses: &[Isometry3<f64>],
) -> Vec<f64> {
    let level = Level::new(Arc::clone(observations), 1, 0, usize::MAX);
    let samples = level.samples(anchor, Counted::Visible);
    poses.par_iter().map(|pose| level.information(&level.joint(&samples, pose))).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::super::scene::scene;
    use super::*;
    use crate::agreement::measure;
    use crate::se3;

    #[test]
    fn at_the_anchor_it_is_the_agreement_and_beside_the_truth_it_is_less() {
        let observations = scene(0.0);
        let beside = |by: f64| se3::exp(&Vector6::new(0.0, 0.0, 0.0, by, 0.0, 0.0));
        let poses = [0.0, 0.01, -0.01].map(beside);
        let found = information_around(&observations, &poses[0], &poses);
        let there = measure(&observations, &poses[0]).joint.mutual_information();
        assert!((found[0] - there).abs() < 1e-6, "{found:?} {there}");
        assert!(found[1] < found[0] && found[2] < found[0], "{found:?}");
    }
}
