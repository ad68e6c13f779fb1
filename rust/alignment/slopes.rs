//! Derivatives of the information with respect to the variables: the joint histogram of points and blocks, and the
//! gradient there, over all points or in parts.
//!
//! `d MI = sum_i w_i / N sum_y pmi(x_i, y) d share_y(u_i)`, where the shares of a point sum to one: the terms from
//! the marginals cancel. Points that count by their class are summed up in one pass, in a histogram with slopes.
//! Points with partitions have too many rows for that: their contributions are summed one by one, once the
//! histogram is known.

use geometry::camera::RUN;
use nalgebra::{DVector, SVector};
use rayon::prelude::*;

use super::level::{Level, PairValues};
use super::projection::{Motion, Projection, with_width};
use super::sample::{Mixed, Sample, Weights};
use crate::mutual_information::JointHistogram;
use crate::pyramid::Sampled;

/// Number of points whose slopes one task sums up: at least two tasks for a mini-batch of the refinement.
const CHUNK: usize = 2048;

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

/// The histogram of points at a projection, and the derivatives of the information there.
pub(super) struct Slopes {
    pub joint: JointHistogram,
    /// Contributions of parts of the points to the gradient, times the weight of all points. A part may occur
    /// several times.
    pub parts: Vec<(Part, DVector<f64>)>,
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
        let Slopes { joint, parts } = self.slopes(samples, constant, at, Weights::AtAnchor, Split::Whole);
        let none = DVector::zeros(at.num_variables());
        let sum = parts.iter().fold(none, |sum, (_, gradient)| sum + gradient);
        let total = f64::max(self.total(&joint), 1.0);
        (joint, sum / total)
    }

    /// Computes the joint histogram and the gradient with given weights, and the gradient in parts.
    pub fn slopes(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        at: &Projection<'_>,
        weights: Weights,
        split: Split,
    ) -> Slopes {
        with_width!(at.num_variables(), WIDTH => if self.observations.has_partitions() {
            self.slopes_by_point::<WIDTH>(samples, constant, at, weights, split)
        } else {
            self.slopes_by_class::<WIDTH>(samples, constant, at, weights, split)
        })
    }

    fn slopes_by_class<const WIDTH: usize>(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        at: &Projection<'_>,
        weights: Weights,
        split: Split,
    ) -> Slopes {
        let groups: Vec<&[Sample]> = match split {
            Split::Whole => vec![samples],
            Split::FramesAndClasses => samples.chunk_by(|a, b| a.frame == b.frame).collect(),
        };
        let of_group = |samples: &&[Sample]| self.sloped::<WIDTH>(samples, at, weights);
        let sloped: Vec<SlopedHistogram<WIDTH>> = groups.par_iter().map(of_group).collect();
        let joint = sloped.iter().fold(constant.clone(), |joint, sloped| sloped.with(&joint));
        let values = self.values(&joint);
        let mut parts = Vec::new();
        for (samples, sloped) in groups.iter().zip(&sloped) {
            let frame = samples.first().map_or(0, |sample| sample.frame as usize);
            for (class, gradient) in sloped.gradients(values.of_classes()).enumerate() {
                let gradient = gradient.rows(1, at.num_variables()).into_owned();
                parts.push(((frame, class), gradient));
            }
        }
        Slopes { joint, parts }
    }

    /// The histogram of points without partitions.
    fn sloped<const WIDTH: usize>(
        &self,
        samples: &[Sample],
        at: &Projection<'_>,
        weights: Weights,
    ) -> SlopedHistogram<WIDTH> {
        let empty =
            || SlopedHistogram::new(self.observations.num_point_classes, self.observations.num_image_classes);
        let of_chunk = |chunk: &[Sample]| {
            let (mut sloped, mut projected) = (empty(), Vec::with_capacity(RUN));
            for run in chunk.chunks(RUN) {
                projected.clear();
                projected.extend(run.iter().map(|sample| at.place(sample)));
                for (sample, place) in run.iter().zip(&projected) {
                    let Some((p_camera, pixel)) = place else { continue };
                    let sampled = self.shares_under(sample, pixel);
                    let weight = f64::from(weights.of(sample, &sampled));
                    sloped.add(sample.class, weight, &sampled, || at.motion(sample.frame, p_camera, pixel));
                }
            }
            sloped
        };
        let chunks: Vec<SlopedHistogram<WIDTH>> = samples.par_chunks(CHUNK).map(of_chunk).collect();
        let merged = chunks.into_iter().reduce(|mut sum, chunk| {
            sum.merge(&chunk);
            sum
        });
        merged.unwrap_or_else(empty)
    }

    fn slopes_by_point<const WIDTH: usize>(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        at: &Projection<'_>,
        weights: Weights,
        split: Split,
    ) -> Slopes {
        let (mut joint, mixed) = self.joint_and_mixed(samples, at, weights);
        joint.merge(constant);
        let values = self.values(&joint);
        let of_chunk = |chunk: &Vec<Mixed>| {
            let mut parts: Vec<(Part, [f64; WIDTH])> = Vec::new();
            for mixed in chunk {
                let part = match split {
                    Split::Whole => (0, 0),
                    Split::FramesAndClasses => (mixed.sample.frame as usize, usize::from(mixed.sample.class)),
                };
                if parts.last().is_none_or(|(last, _)| *last != part) {
                    parts.push((part, [0.0; WIDTH]));
                }
                if let Some((_, sum)) = parts.last_mut() {
                    self.add_score(mixed, at, &values, sum);
                }
            }
            parts
        };
        let n = at.num_variables();
        let of_part = |(part, sum): (Part, [f64; WIDTH])| (part, DVector::from_column_slice(&sum[1..=n]));
        let parts =
            mixed.par_iter().flat_map_iter(|chunk| of_chunk(chunk).into_iter().map(of_part)).collect();
        Slopes { joint, parts }
    }

    /// Adds the contribution of a point on several classes to the gradient, times the weight of all points, in the
    /// entries after the first.
    pub fn add_score<const WIDTH: usize>(
        &self,
        Mixed { sample, p_camera, pixel }: &Mixed,
        at: &Projection<'_>,
        values: &PairValues<'_>,
        sum: &mut [f64; WIDTH],
    ) {
        let Sampled::Mixed(shares) = self.shares_under(sample, pixel) else { return };
        let per_pixel = values.of(sample, |values| shares.gradient(values)) * f64::from(sample.weight);
        let [of_u, of_v] = at.motion::<WIDTH>(sample.frame, p_camera, pixel);
        for (i, sum) in sum.iter_mut().enumerate() {
            *sum += of_u[i] * per_pixel.x + of_v[i] * per_pixel.y;
        }
    }
}

/// A joint histogram with the derivatives of its weights with respect to parameters.
///
/// A cell holds its weight and then a slope for each parameter. The gradient of a sum over pairs follows from the
/// cells, as long as the value of each pair does not depend on the parameters.
struct SlopedHistogram<const WIDTH: usize> {
    num_image_classes: usize,
    cells: Vec<[f64; WIDTH]>,
}

impl<const WIDTH: usize> SlopedHistogram<WIDTH> {
    fn new(num_point_classes: usize, num_image_classes: usize) -> Self {
        Self { num_image_classes, cells: vec![[0.0; WIDTH]; num_point_classes * num_image_classes] }
    }

    /// Adds a point of a class whose pixel moves with the parameters.
    fn add(&mut self, class: u8, weight: f64, sampled: &Sampled, motion: impl FnOnce() -> Motion<WIDTH>) {
        let row = &mut self.cells[usize::from(class) * self.num_image_classes..][..self.num_image_classes];
        match sampled {
            Sampled::Uniform(class) => row[usize::from(*class)][0] += weight,
            Sampled::Mixed(shares) if shares.total() > 0.0 => {
                let [of_u, of_v] = motion();
                shares.for_blocks(|shares, [share, to_right, to_down]| {
                    let (share, to_right, to_down) = (weight * share, weight * to_right, weight * to_down);
                    let mut by: [f64; WIDTH] =
                        std::array::from_fn(|i| to_right * of_u[i] + to_down * of_v[i]);
                    by[0] = share;
                    for share in shares {
                        let amount = f64::from(share.amount);
                        let cell = &mut row[usize::from(share.class)];
                        cell.iter_mut().zip(by).for_each(|(sum, x)| *sum += x * amount);
                    }
                });
            }
            Sampled::Mixed(_) => {}
        }
    }

    fn merge(&mut self, other: &Self) {
        for (cell, by) in self.cells.iter_mut().zip(&other.cells) {
            cell.iter_mut().zip(by).for_each(|(sum, x)| *sum += x);
        }
    }

    /// The weights alone, plus those of other pairs.
    fn with(&self, others: &JointHistogram) -> JointHistogram {
        let mut joint = others.clone();
        joint.weights.iter_mut().zip(&self.cells).for_each(|(sum, cell)| *sum += cell[0]);
        joint
    }

    /// For each class of points, the gradient of the sum of `values` over its pairs. The first entry is the sum
    /// itself.
    fn gradients(&self, values: &[f64]) -> impl Iterator<Item = SVector<f64, WIDTH>> {
        let width = self.num_image_classes;
        self.cells.chunks(width).zip(values.chunks(width)).map(|(cells, values)| {
            let mut sums = [0.0; WIDTH];
            // Values of pairs that do not occur are infinite.
            let occupied = cells.iter().zip(values).filter(|(cell, _)| **cell != [0.0; WIDTH]);
            for (cell, value) in occupied {
                sums.iter_mut().zip(cell).for_each(|(sum, x)| *sum += x * value);
            }
            SVector::from(sums)
        })
    }
}
