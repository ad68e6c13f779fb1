//! Information of segments about the images at a pose, frame by frame, and the gain from one pose to another.
//!
//! Segments of one frame say nothing about those of another, so a frame cannot be judged by the histogram of other
//! frames. Each pose is judged by the histogram of the same frames at that pose, so that neither pose has an
//! advantage.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Isometry3;
use rayon::prelude::*;

use super::level::Level;
use super::projection::Projection;
use super::sample::{Counted, Sample};
use super::selection::in_view;
use crate::agreement::InformationGain;
use crate::observation::Observations;

/// Number of squares across an image, which are taken to be independent.
const SQUARES_ACROSS: f64 = 8.0;

/// Information of the visible points in one square of a frame's image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SquareInformation {
    /// Sum over the points, weighted by their weight: pointwise information, nats, for classes; contributions to
    /// the adjusted mutual information for segments.
    pub sum: f64,
    /// Total weight of the points.
    pub weight: f64,
}

/// Full-resolution information at a pose, by frame and by row and column of the squares of the images.
pub fn information(
    observations: &Arc<Observations>,
    pose: &Isometry3<f64>,
) -> BTreeMap<[u32; 3], SquareInformation> {
    let level = Level::new(in_view(observations, &[*pose]), &[], 1, usize::MAX);
    let samples = level.samples(pose, Counted::Visible);
    let at = level.projection(pose);
    let square_of = square_of(&level, &at);
    let mut squares: BTreeMap<[u32; 3], SquareInformation> = BTreeMap::new();
    for (sample, value) in samples.iter().zip(level.contributions(&samples, &at)) {
        if let Some(square) = square_of(sample) {
            let square = squares.entry(square).or_default();
            square.sum += value;
            square.weight += f64::from(sample.weight);
        }
    }
    squares
}

/// Frame of a point, and row and column of its square at a pose.
fn square_of<'a>(level: &Level, at: &'a Projection<'_>) -> impl Fn(&Sample) -> Option<[u32; 3]> + use<'a> {
    let side = level.observations.camera.width as f64 / SQUARES_ACROSS;
    move |sample| {
        let (_, pixel) = at.place(sample)?;
        Some([sample.frame, (pixel.y / side) as u32, (pixel.x / side) as u32])
    }
}

/// Gains in mean information from one pose to each of the others, over the points visible at the first pose.
/// Squares of the images are independent, and paired; those of one scene are summed first.
pub fn information_gains(
    observations: &Arc<Observations>,
    before: &Isometry3<f64>,
    after: &[Isometry3<f64>],
) -> Vec<InformationGain> {
    let all: Vec<Isometry3<f64>> = after.iter().chain([before]).copied().collect();
    let level = Level::new(in_view(observations, &all), &[], 1, usize::MAX);
    let samples = level.samples(before, Counted::Visible);
    let total = samples.iter().map(|s| f64::from(s.weight)).sum::<f64>().max(1.0);
    let here = level.projection(before);
    let squares: Vec<Option<[u32; 3]>> = samples.iter().map(square_of(&level, &here)).collect();
    let at_first = level.contributions(&samples, &here);
    let gain = |pose| {
        let mut gains: BTreeMap<[u32; 3], f64> = BTreeMap::new();
        for (square, (first, there)) in
            squares.iter().zip(at_first.iter().zip(level.contributions(&samples, &level.projection(pose))))
        {
            if let Some([frame, row, column]) = *square {
                let square = [observations.scene_of(frame), row, column];
                *gains.entry(square).or_default() += (there - first) / total;
            }
        }
        InformationGain::of_parts(gains.into_values().collect())
    };
    after.iter().map(gain).collect()
}

impl Level {
    /// Weighted contribution of each point to the information at a pose: zero where the point does not project.
    fn contributions(&self, samples: &[Sample], at: &Projection<'_>) -> Vec<f64> {
        let values = self.values(&self.joint(samples, at));
        let contribution = |shares: &mut Vec<f64>, sample: &Sample| {
            let Some((_, pixel)) = at.place(sample) else { return 0.0 };
            shares.fill(0.0);
            self.shares_under(sample, &pixel).add_to(shares, 1.0);
            let sum = |values: &[f64]| shares.iter().zip(values).map(|(s, v)| s * v).sum::<f64>();
            values.of(sample, sum) * f64::from(sample.weight)
        };
        let no_shares = || vec![0.0; self.observations.num_image_classes];
        samples.par_iter().map_init(no_shares, contribution).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::super::test_scene::segmented;
    use super::*;
    use geometry::se3;

    #[test]
    fn squares_add_up_to_the_information_of_all() {
        let observations = segmented(2);
        let pose = se3::exp(&Vector6::new(0.01, 0.0, -0.01, 0.002, -0.001, 0.003));
        let squares = information(&observations, &pose);
        let level = Level::new(Arc::clone(&observations), &[], 1, usize::MAX);
        let joint = level.joint(&level.samples(&pose, Counted::Visible), &level.projection(&pose));
        let sum: f64 = squares.values().map(|square| square.sum).sum();
        assert_eq!(squares.keys().map(|square| square[0]).max(), Some(1));
        assert!((sum / level.total(&joint) - level.information(&joint)).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn the_gain_is_that_of_the_information() {
        let observations = segmented(1);
        let [near, far] = [0.002, 0.03].map(|by| se3::exp(&Vector6::new(0.0, 0.0, 0.0, by, 0.0, 0.0)));
        let gains = information_gains(&observations, &far, &[near, far]);
        assert!(gains[0].gain > 2.0 * gains[0].sigma, "{gains:?}");
        assert_eq!(gains[1].gain, 0.0);
    }
}
