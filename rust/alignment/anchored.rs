//! Class shares under chosen points and their derivatives, for estimators that live elsewhere: MINE's network in torch.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3x4, Matrix6, Vector3};

use super::level::Level;
use super::sample::{Counted, Sample};
use crate::observation::Observations;
use crate::pyramid::Sampled;

/// The points of a level, chosen at an anchor pose with the weights that they have there.
#[derive(Clone, Debug)]
pub struct Anchored {
    level: Level,
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
        match level.preconditioner(&samples, anchor) {
            Some(preconditioner) => Self { level, samples, preconditioner },
            None => Self { level, samples: Vec::new(), preconditioner: Matrix6::zeros() },
        }
    }

    /// The points' classes.
    pub fn classes(&self) -> impl ExactSizeIterator<Item = u8> {
        self.samples.iter().map(|sample| sample.class)
    }

    /// The points' weights.
    pub fn weights(&self) -> impl ExactSizeIterator<Item = f32> {
        self.samples.iter().map(|sample| sample.weight)
    }

    /// Columns of [`Anchored::shares`].
    pub fn num_image_classes(&self) -> usize {
        self.level.observations.num_image_classes
    }

    /// Twists, as columns, that each move the points by one block: see [`Level::preconditioner`].
    pub fn preconditioner(&self) -> &Matrix6<f64> {
        &self.preconditioner
    }

    /// Shares of each class under the points, `indices.len() x num_image_classes`, each row adding up to one; a row of
    /// zeros where the lens does not project the point or nothing is labelled.
    ///
    /// `T_camera_lidar` needs not be rigid: derivatives are taken entry by entry.
    pub fn shares(&self, indices: &[usize], t_camera_lidar: &Matrix3x4<f64>) -> Vec<f64> {
        let num_classes = self.num_image_classes();
        let mut shares = vec![0.0; indices.len() * num_classes];
        for (&index, row) in indices.iter().zip(shares.chunks_exact_mut(num_classes)) {
            if let Some(sampled) = self.sampled(&self.samples[index], t_camera_lidar).1 {
                sampled.add_to(row, 1.0);
            }
        }
        shares
    }

    /// The gradient with respect to the entries of `T_camera_lidar` of a value that has `gradient` with respect to what
    /// [`Anchored::shares`] returns.
    pub fn pull_back(
        &self,
        indices: &[usize],
        t_camera_lidar: &Matrix3x4<f64>,
        gradient: &[f64],
    ) -> Matrix3x4<f64> {
        let num_classes = self.num_image_classes();
        let mut pulled = Matrix3x4::zeros();
        for (&index, values) in indices.iter().zip(gradient.chunks_exact(num_classes)) {
            let sample = &self.samples[index];
            if let (p_camera, Some(Sampled::Mixed(shares))) = self.sampled(sample, t_camera_lidar)
                && shares.total() > 0.0
            {
                let jacobian = self.level.observations.camera.jacobian(&p_camera);
                let force: Vector3<f64> = jacobian.tr_mul(&shares.gradient(values));
                pulled += force * sample.position.push(1.0).transpose();
            }
        }
        pulled
    }

    fn sampled(
        &self,
        sample: &Sample,
        t_camera_lidar: &Matrix3x4<f64>,
    ) -> (Vector3<f64>, Option<Sampled<'_>>) {
        let p_camera = t_camera_lidar * sample.position.push(1.0);
        (p_camera, self.level.sampled(sample, &p_camera))
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
            points.shares(&indices, matrix).iter().zip(&weights).map(|(a, b)| a * b).sum::<f64>()
        };
        let pulled = points.pull_back(&indices, &matrix, &weights);
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
