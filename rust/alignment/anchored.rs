//! Class shares under chosen points and their derivatives, for estimators that live elsewhere: MINE's network in torch.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3x4, Matrix6, Point2, Vector3};

use super::level::Level;
use super::sample::{Counted, Sample};
use crate::observation::Observations;
use crate::pyramid::Sampled;

/// The points of a level, chosen at an anchor pose with the weights that they have there.
#[derive(Clone, Debug)]
pub struct Anchored {
    level: Arc<Level>,
    samples: Vec<Sample>,
    preconditioner: Matrix6<f64>,
}

impl Anchored {
    /// Chooses the points; there are none where numbers overflow.
    pub fn new(
        observations: Arc<Observations>,
        factor: usize,
        edge_band_px: usize,
        anchor: &Isometry3<f64>,
        counted: Counted,
    ) -> Self {
        let level = Level::new(observations, factor, edge_band_px, usize::MAX);
        let samples = level.samples(anchor, counted);
        let preconditioner = level.preconditioner(&samples, anchor);
        let samples = if preconditioner.is_some() { samples } else { Vec::new() };
        Self {
            level: Arc::new(level),
            samples,
            preconditioner: preconditioner.unwrap_or_else(Matrix6::zeros),
        }
    }

    /// The points' classes.
    pub fn classes(&self) -> impl ExactSizeIterator<Item = u8> {
        self.samples.iter().map(|sample| sample.class)
    }

    /// Twists, as columns, that each move the points by one block: see [`Level::preconditioner`].
    pub fn preconditioner(&self) -> &Matrix6<f64> {
        &self.preconditioner
    }

    /// Samples the label images under points at a pose.
    ///
    /// `T_camera_lidar` needs not be rigid: derivatives are taken entry by entry.
    pub fn sample(&self, indices: &[usize], t_camera_lidar: &Matrix3x4<f64>) -> MiniBatch {
        // Points and pixels lie anywhere in memory: each pass does little beside, so that many are fetched at once.
        let samples: Vec<Sample> = indices.iter().map(|&index| self.samples[index]).collect();
        let project = |sample: &Sample| {
            let p_camera = t_camera_lidar * sample.position.push(1.0);
            (p_camera, self.level.observations.camera.project(&p_camera))
        };
        let projected: Vec<_> = samples.iter().map(project).collect();
        let num_classes = self.level.observations.num_image_classes;
        let mut batch = MiniBatch {
            level: Arc::clone(&self.level),
            classes: samples.iter().map(|sample| sample.class).collect(),
            weights: vec![0.0; samples.len()],
            shares: vec![0.0; samples.len() * num_classes],
            mixed: Vec::new(),
        };
        for (row, (sample, (p_camera, pixel))) in samples.iter().zip(projected).enumerate() {
            let Some(pixel) = pixel else { continue };
            let sampled = self.level.maps[sample.frame as usize].at(&pixel);
            if sampled.total() > 0.0 {
                batch.weights[row] = sample.weight;
                sampled.add_to(&mut batch.shares[row * num_classes..][..num_classes], 1.0);
                if matches!(sampled, Sampled::Mixed(_)) {
                    batch.mixed.push(Mixed {
                        row,
                        frame: sample.frame,
                        position: sample.position,
                        p_camera,
                        pixel,
                    });
                }
            }
        }
        batch
    }
}

/// Points of a mini-batch at a pose, and the class shares of the blocks under them.
#[derive(Clone, Debug)]
pub struct MiniBatch {
    level: Arc<Level>,
    classes: Vec<u8>,
    weights: Vec<f32>,
    shares: Vec<f64>,
    mixed: Vec<Mixed>,
}

/// A point on blocks of several classes, whose shares change with the pose.
#[derive(Clone, Copy, Debug)]
struct Mixed {
    row: usize,
    frame: u32,
    position: Vector3<f64>,
    p_camera: Vector3<f64>,
    pixel: Point2<f64>,
}

impl MiniBatch {
    /// The points' classes.
    pub fn classes(&self) -> &[u8] {
        &self.classes
    }

    /// The points' weights at the anchor; zero where the lens does not project the point now or nothing is labelled.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Columns of [`MiniBatch::shares`].
    pub fn num_image_classes(&self) -> usize {
        self.level.observations.num_image_classes
    }

    /// Shares of each class under the points, `num_points x num_image_classes`, each row adding up to one; a row of zeros
    /// where the weight is zero.
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// The gradient with respect to the entries of `T_camera_lidar` of a value that has `gradient` with respect to
    /// [`MiniBatch::shares`].
    pub fn pull_back(&self, gradient: &[f64]) -> Matrix3x4<f64> {
        let num_classes = self.num_image_classes();
        let mut pulled = Matrix3x4::zeros();
        for Mixed { row, frame, position, p_camera, pixel } in &self.mixed {
            if let Sampled::Mixed(shares) = self.level.maps[*frame as usize].at(pixel) {
                let values = &gradient[row * num_classes..][..num_classes];
                let jacobian = self.level.observations.camera.jacobian(p_camera);
                let force: Vector3<f64> = jacobian.tr_mul(&shares.gradient(values));
                pulled += force * position.push(1.0).transpose();
            }
        }
        pulled
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::super::scene::scene;
    use super::*;
    use crate::se3;

    const FACTOR: usize = 4;

    #[test]
    fn derivatives_of_shares_are_those_of_finite_differences() {
        const STEP: f64 = 1e-7;
        let observations = scene(0.3);
        let pose = se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006));
        let points = Anchored::new(Arc::clone(&observations), FACTOR, 0, &pose, Counted::All);
        let indices: Vec<usize> = (0..points.classes().len()).step_by(37).collect();
        let weights: Vec<f64> = (0..indices.len() * 3).map(|i| (i as f64).sin()).collect();
        let matrix = pose.to_homogeneous().fixed_rows::<3>(0).into_owned();
        let value = |matrix: &Matrix3x4<f64>| {
            points.sample(&indices, matrix).shares().iter().zip(&weights).map(|(a, b)| a * b).sum::<f64>()
        };
        let pulled = points.sample(&indices, &matrix).pull_back(&weights);
        for entry in 0..12 {
            let mut step = Matrix3x4::zeros();
            step[entry] = STEP;
            let slope = (value(&(matrix + step)) - value(&(matrix - step))) / (2.0 * STEP);
            assert!(
                (slope - pulled[entry]).abs() < 1e-4 * (1.0 + pulled.norm()),
                "{entry}: {slope} {pulled}"
            );
        }
    }
}
