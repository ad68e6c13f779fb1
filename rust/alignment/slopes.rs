//! Derivatives of the information with respect to the variables: the joint histogram of points and blocks, and the
//! gradient there, over all points or in parts.
//!
//! `d MI = sum_i w_i / N sum_y pmi(x_i, y) d share_y(u_i)`, where the shares of a point sum to one: the terms from
//! the marginals cancel. The contributions of the points are summed once the histogram is known.

use geometry::camera::RUN;
use nalgebra::DVector;
use rayon::prelude::*;

use super::level::{Level, PairValues, touch, with_maps};
use super::projection::{Projection, with_width};
use super::sample::{Mixed, Sample, Weights};
use crate::mutual_information::JointHistogram;
use crate::pyramid::{LabelMap, Sampled};

/// How the gradient is split into parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Split {
    /// All points form one part.
    Whole,
    /// The points of each class in each frame form one part.
    FramesAndClasses,
}

/// Frame and class of points; both are 0 if all points form one part.
pub(super) type Part = (usize, usize);

/// Where points land at a projection.
pub(super) struct Placed<'a> {
    pub at: Projection<'a>,
    /// Joint histogram of the points, and of the pairs that do not change.
    pub joint: JointHistogram,
    /// In chunks, the points on several classes, by which the histogram changes.
    pub mixed: Vec<Vec<Mixed>>,
}

impl Level {
    /// Joint histogram of the `constant` pairs and the points, and the gradient of [`Level::information`], nats per
    /// metre, per radian, and per unit of the other variables.
    pub fn joint_and_gradient(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        at: &Projection<'_>,
    ) -> (JointHistogram, DVector<f64>) {
        let placed = self.placed(samples, constant, at.clone(), Weights::AtAnchor);
        let gradient = self.gradient(&placed);
        (placed.joint, gradient)
    }

    /// Places points at a projection, beside the `constant` pairs.
    pub fn placed<'a>(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        at: Projection<'a>,
        weights: Weights,
    ) -> Placed<'a> {
        let (mut joint, mixed) = self.joint_and_mixed(samples, &at, weights);
        joint.merge(constant);
        Placed { at, joint, mixed }
    }

    /// Gradient of [`Level::information`], nats per metre, per radian, and per unit of the other variables.
    pub fn gradient(&self, placed: &Placed) -> DVector<f64> {
        let none = DVector::zeros(placed.at.num_variables());
        let sum = self.slopes(placed, Split::Whole).iter().fold(none, |sum, (_, gradient)| sum + gradient);
        sum / f64::max(self.total(&placed.joint), 1.0)
    }

    /// Contributions of parts of the points to the gradient, times the weight of all points. A part may occur several
    /// times.
    pub fn slopes(&self, placed: &Placed, split: Split) -> Vec<(Part, DVector<f64>)> {
        with_maps!(&self.maps, maps => {
            with_width!(placed.at.num_variables(), WIDTH => self.slopes_of::<WIDTH>(&maps, placed, split))
        })
    }

    fn slopes_of<const WIDTH: usize>(
        &self,
        maps: &[impl LabelMap],
        Placed { at, joint, mixed }: &Placed,
        split: Split,
    ) -> Vec<(Part, DVector<f64>)> {
        let values = self.values(joint);
        let of_chunk = |chunk: &Vec<Mixed>| {
            let mut parts: Vec<(Part, [f64; WIDTH])> = Vec::new();
            for (index, mixed) in chunk.iter().enumerate() {
                if index % RUN == 0 {
                    let run = &chunk[index..(index + RUN).min(chunk.len())];
                    touch(maps, run.iter().map(|mixed| (mixed.sample.frame as usize, &mixed.pixel)));
                }
                let part = match split {
                    Split::Whole => (0, 0),
                    Split::FramesAndClasses => (mixed.sample.frame as usize, usize::from(mixed.sample.class)),
                };
                // A chunk has points of few frames and classes, and the latest are the likeliest.
                let place = parts.iter().rposition(|(other, _)| *other == part).unwrap_or_else(|| {
                    parts.push((part, [0.0; WIDTH]));
                    parts.len() - 1
                });
                add_score(&maps[mixed.sample.frame as usize], mixed, at, &values, &mut parts[place].1);
            }
            parts
        };
        let n = at.num_variables();
        let of_part = |(part, sum): (Part, [f64; WIDTH])| (part, DVector::from_column_slice(&sum[..n]));
        mixed.par_iter().flat_map_iter(|chunk| of_chunk(chunk).into_iter().map(of_part)).collect()
    }
}

/// Adds the contribution of a point on several classes of a map to the gradient, times the weight of all points.
#[inline(always)]
pub(super) fn add_score<const WIDTH: usize>(
    map: &impl LabelMap,
    Mixed { sample, p_camera, pixel }: &Mixed,
    at: &Projection<'_>,
    values: &PairValues<'_>,
    sum: &mut [f64; WIDTH],
) {
    let Sampled::Mixed(shares) = map.at(pixel) else { return };
    let per_pixel = values.of(sample, |values| shares.gradient(values)) * f64::from(sample.weight);
    let [of_u, of_v] = at.motion::<WIDTH>(sample.frame, p_camera, pixel);
    for (i, sum) in sum.iter_mut().enumerate() {
        *sum += of_u[i] * per_pixel.x + of_v[i] * per_pixel.y;
    }
}
