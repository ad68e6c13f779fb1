//! The joint histogram of points and blocks together with its slopes: value and gradient in one pass over the points.

use nalgebra::{Point2, SVector, Vector3};
use rayon::prelude::*;

use super::level::{CHUNK, Level};
use super::sample::Sample;
use crate::camera::RUN;
use crate::mutual_information::JointHistogram;
use crate::pyramid::Sampled;

/// A joint histogram, and how its weights change with parameters. A cell has its weight first and then a slope for each
/// parameter: the gradient of any sum over the pairs of points and classes is that of the cells, where what a pair adds
/// does not change with the parameters.
pub(super) struct SlopedHistogram<const WIDTH: usize> {
    num_image_classes: usize,
    cells: Vec<[f64; WIDTH]>,
}

/// How the pixel of a point moves with the parameters: a row for each of its coordinates, with nothing first.
pub(super) type Motion<const WIDTH: usize> = [[f64; WIDTH]; 2];

impl<const WIDTH: usize> SlopedHistogram<WIDTH> {
    fn new(num_point_classes: usize, num_image_classes: usize) -> Self {
        Self { num_image_classes, cells: vec![[0.0; WIDTH]; num_point_classes * num_image_classes] }
    }

    /// Adds a point of a class whose pixel moves with the parameters.
    #[inline]
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

    /// The weights alone, with those of other pairs.
    pub fn with(&self, others: &JointHistogram) -> JointHistogram {
        let mut joint = others.clone();
        joint.weights.iter_mut().zip(&self.cells).for_each(|(sum, cell)| *sum += cell[0]);
        joint
    }

    /// The gradient of the sum over all pairs where each adds one of `values`; the first entry is the sum itself.
    pub fn gradient(&self, values: &[f64]) -> SVector<f64, WIDTH> {
        let mut sums = [0.0; WIDTH];
        for (cell, value) in self.cells.iter().zip(values) {
            sums.iter_mut().zip(cell).for_each(|(sum, x)| *sum += x * value);
        }
        SVector::from(sums)
    }
}

impl Level {
    /// The histogram of points without partitions, with weights from `weigh`.
    pub(super) fn sloped<const WIDTH: usize>(
        &self,
        samples: &[Sample],
        projection: impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync,
        weigh: impl Fn(&Sample, &Sampled) -> f32 + Sync,
        motion: impl Fn(&Vector3<f64>, &Point2<f64>) -> Motion<WIDTH> + Sync,
    ) -> SlopedHistogram<WIDTH> {
        let empty =
            || SlopedHistogram::new(self.observations.num_point_classes, self.observations.num_image_classes);
        let of_chunk = |chunk: &[Sample]| {
            let (mut sloped, mut projected) = (empty(), Vec::with_capacity(RUN));
            for run in chunk.chunks(RUN) {
                projected.clear();
                projected.extend(run.iter().map(&projection));
                for (sample, place) in run.iter().zip(&projected) {
                    let Some((p_camera, pixel)) = place else { continue };
                    let sampled = self.maps[sample.frame as usize].at(pixel);
                    let weight = f64::from(weigh(sample, &sampled));
                    sloped.add(sample.class, weight, &sampled, || motion(p_camera, pixel));
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
}
