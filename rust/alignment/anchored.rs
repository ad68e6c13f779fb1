//! Class shares under chosen points and their derivatives, for estimators implemented elsewhere, such as MINE's
//! network in PyTorch.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3x4, Matrix6, Vector3};

use super::level::Level;
use super::sample::{Counted, Mixed, Sample};
use super::selection::Selection;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::Sampled;

/// The points of a level, chosen at an anchor pose and weighted there.
#[derive(Clone, Debug)]
pub struct Anchored {
    level: Arc<Level>,
    samples: Vec<Sample>,
    /// Pairs of the points that are never drawn because they lie deep inside one class.
    constant: JointHistogram,
    preconditioner: Matrix6<f64>,
}

impl Anchored {
    /// Chooses about `max_points` of the points in the images, or none if numbers overflow.
    ///
    /// Points at least `constant_radius` blocks inside one class are summed up once. Zero turns this off.
    pub fn new(
        observations: Arc<Observations>,
        factor: usize,
        max_points: usize,
        anchor: &Isometry3<f64>,
        counted: Counted,
        constant_radius: usize,
    ) -> Self {
        let level = Level::new(observations, &[*anchor], factor, max_points);
        let (samples, constant) = match constant_radius {
            0 => (level.samples(anchor, counted), level.empty_joint()),
            radius => {
                let Selection { moving, constant, .. } = level.select(anchor, counted, radius);
                (moving, constant)
            }
        };
        let preconditioner = level.preconditioner(&samples, anchor);
        let samples = if preconditioner.is_some() { samples } else { Vec::new() };
        Self {
            level: Arc::new(level),
            samples,
            constant,
            preconditioner: preconditioner.unwrap_or_else(Matrix6::zeros),
        }
    }

    pub fn classes(&self) -> impl ExactSizeIterator<Item = u8> {
        self.samples.iter().map(|sample| sample.class)
    }

    /// Twists, as columns, that each move the points by one block: see [`Level::preconditioner`].
    pub fn preconditioner(&self) -> &Matrix6<f64> {
        &self.preconditioner
    }

    /// Samples the label images under points at a pose.
    ///
    /// `T_camera_lidar` need not be rigid: derivatives are taken entry by entry.
    pub fn sample(&self, indices: &[usize], t_camera_lidar: &Matrix3x4<f64>) -> MiniBatch {
        // Access to points and pixels is random: short passes let many fetches overlap.
        let samples: Vec<Sample> = indices.iter().map(|&index| self.samples[index]).collect();
        let project = |sample: &Sample| {
            let p_camera = t_camera_lidar * sample.position.push(1.0);
            (p_camera, self.level.observations.camera.project(&p_camera))
        };
        let projected: Vec<_> = samples.iter().map(project).collect();
        let mut uniform = self.constant.clone();
        // The batch represents all points that are drawn from.
        let drawn = samples.len() as f64 / self.samples.len() as f64;
        uniform.weights.iter_mut().for_each(|weight| *weight *= drawn);
        let mut mixed = Vec::new();
        for (sample, (p_camera, pixel)) in samples.into_iter().zip(projected) {
            let Some(pixel) = pixel else { continue };
            match self.level.shares_under(&sample, &pixel) {
                Sampled::Uniform(class) => uniform.add(sample.class, class, f64::from(sample.weight)),
                Sampled::Mixed(shares) if shares.total() > 0.0 => {
                    mixed.push(Mixed { sample, p_camera, pixel })
                }
                Sampled::Mixed(_) => {}
            }
        }
        MiniBatch { level: Arc::clone(&self.level), uniform, mixed }
    }
}

/// Points of a mini-batch at a pose, and the class shares of the blocks under them.
///
/// Points on blocks of a single class are pooled: the first rows of [`MiniBatch::shares`] hold one class each. A
/// row follows for each point on blocks of several classes. Points that do not project, or that have no label under
/// them, are left out.
#[derive(Clone, Debug)]
pub struct MiniBatch {
    level: Arc<Level>,
    uniform: JointHistogram,
    mixed: Vec<Mixed>,
}

impl MiniBatch {
    /// Numbers of rows, point classes and pixel classes.
    pub fn shape(&self) -> [usize; 3] {
        let Observations { num_point_classes, num_image_classes, .. } = *self.level.observations;
        [num_image_classes + self.mixed.len(), num_point_classes, num_image_classes]
    }

    /// Shares of the pixel classes, row by row. Each row sums to one.
    pub fn shares(&self) -> Vec<f64> {
        let [num_rows, _, num_y] = self.shape();
        let mut shares = vec![0.0; num_rows * num_y];
        let (of_classes, of_mixed) = shares.split_at_mut(num_y * num_y);
        of_classes.iter_mut().step_by(num_y + 1).for_each(|share| *share = 1.0);
        for (row, Mixed { sample, pixel, .. }) in of_mixed.chunks_exact_mut(num_y).zip(&self.mixed) {
            self.level.shares_under(sample, pixel).add_to(row, 1.0);
        }
        shares
    }

    /// Weights of the point classes, row by row. A point keeps its weight from the anchor.
    pub fn weights(&self) -> Vec<f64> {
        let [num_rows, num_x, num_y] = self.shape();
        let mut weights = vec![0.0; num_rows * num_x];
        for (index, weight) in self.uniform.weights.iter().enumerate() {
            weights[index % num_y * num_x + index / num_y] = *weight;
        }
        for (row, Mixed { sample, .. }) in self.mixed.iter().enumerate() {
            weights[(num_y + row) * num_x + usize::from(sample.class)] = f64::from(sample.weight);
        }
        weights
    }

    /// Gradient with respect to the entries of `T_camera_lidar`, given `gradient` with respect to
    /// [`MiniBatch::shares`].
    pub fn pull_back(&self, gradient: &[f64]) -> Matrix3x4<f64> {
        let [_, _, num_y] = self.shape();
        let mut pulled = Matrix3x4::zeros();
        for (Mixed { sample, p_camera, pixel }, values) in
            self.mixed.iter().zip(gradient[num_y * num_y..].chunks_exact(num_y))
        {
            if let Sampled::Mixed(shares) = self.level.shares_under(sample, pixel) {
                let jacobian = self.level.observations.camera.jacobian(p_camera);
                let force: Vector3<f64> = jacobian.tr_mul(&shares.gradient(values));
                pulled += force * sample.position.push(1.0).transpose();
            }
        }
        pulled
    }
}
