//! Distance of projected points from the pixels of their own class: the cost of SOIC, and its minimum.
//!
//! Source: Wang, Nobuhara, Nakamura and Sakurada, *SOIC: Semantic Online Initialization and Calibration for LiDAR
//! and Camera*, arXiv 2003.04260.

use std::sync::Arc;

use geometry::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::point_cloud::to_f64;
use crate::powell::{Minimum, PowellConfig, minimize};
use crate::thinning::{stride, thinned};

/// Margin around the image, relative to its sides: points that project farther outside at the start are left out.
const MARGIN: f64 = 0.5;
/// Factor on the reach of the line searches in every other restart.
const RESTART_FACTOR: f64 = 0.2;

/// The points of one class in one frame, and the distance of each image block from the nearest pixel of that class.
#[derive(Clone, Debug)]
pub struct ClassInFrame {
    pub class: usize,
    pub points: Vec<[f32; 3]>,
    /// Distances by rows of blocks, in pixels.
    pub distances: Arc<Vec<Vec<f32>>>,
}

/// Settings: the fields of `SoicConfig` in Python, which documents them.
#[derive(Clone, Copy, Debug)]
pub struct DescentConfig {
    pub step_rad: f64,
    pub step_m: f64,
    pub tolerance: f64,
    pub max_rounds: usize,
    pub max_restarts: usize,
    pub max_points: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct DistanceMinimum {
    pub pose: Isometry3<f64>,
    pub cost_px: f64,
    pub num_evaluations: usize,
    pub converged: bool,
}

#[derive(Clone, Debug)]
pub struct SemanticDistance {
    camera: Camera,
    parts: Vec<ClassInFrame>,
    num_classes: usize,
    /// Side of a block, pixels.
    block: usize,
}

impl SemanticDistance {
    pub fn new(camera: Camera, parts: Vec<ClassInFrame>, block: usize) -> Self {
        let num_classes = parts.iter().map(|part| part.class + 1).max().unwrap_or(0);
        Self { camera, parts, num_classes, block }
    }

    /// Distance in pixels of a class's projected points from the nearest pixel of that class, averaged over the
    /// points in the image, then over the classes. Infinite if no point projects into the image.
    pub fn at(&self, pose: &Isometry3<f64>) -> f64 {
        let (rotation, translation) = (pose.rotation.to_rotation_matrix(), pose.translation.vector);
        let sum = |part: &ClassInFrame| self.sum(part, &rotation, &translation);
        let sums: Vec<(f64, usize)> = self.parts.par_iter().map(sum).collect();
        let mut of_classes = vec![(0.0, 0); self.num_classes];
        for (part, (sum, count)) in self.parts.iter().zip(sums) {
            of_classes[part.class].0 += sum;
            of_classes[part.class].1 += count;
        }
        let means = of_classes.iter().filter(|(_, count)| *count > 0).map(|(sum, count)| sum / *count as f64);
        let (total, num_seen) = means.fold((0.0, 0), |(total, count), mean| (total + mean, count + 1));
        if num_seen == 0 { f64::INFINITY } else { total / f64::from(num_seen) }
    }

    /// Minimises the cost by Powell's method over a rotation vector and a shift of the camera centre, both along
    /// the axes of the camera at the start.
    pub fn minimize(&self, start: &Isometry3<f64>, config: &DescentConfig) -> Result<DistanceMinimum> {
        let near = self.near(start, config.max_points);
        let cost = near.at(start);
        if !cost.is_finite() {
            return Err(Error::Calibration(
                "no overlap: no point of any class projects into the image".into(),
            ));
        }
        let mut found = DistanceMinimum { pose: *start, cost_px: cost, num_evaluations: 1, converged: false };
        let mut num_idle = 0;
        for restart in 0..=config.max_restarts {
            let scale = if restart % 2 == 0 { 1.0 } else { RESTART_FACTOR };
            let (pose, minimum) = near.descend(&found.pose, scale, config);
            found.num_evaluations += minimum.num_evaluations;
            num_idle = if found.cost_px - minimum.value > config.tolerance * found.cost_px {
                0
            } else {
                num_idle + 1
            };
            if minimum.value < found.cost_px {
                (found.pose, found.cost_px) = (pose, minimum.value);
            }
            // No improvement, neither far nor near.
            if num_idle == 2 {
                found.converged = true;
                break;
            }
        }
        Ok(found)
    }

    fn descend(
        &self,
        start: &Isometry3<f64>,
        scale: f64,
        config: &DescentConfig,
    ) -> (Isometry3<f64>, Minimum<6>) {
        let to_lidar = start.rotation.inverse();
        let center = -(to_lidar * start.translation.vector);
        let pose = |x: &[f64; 6]| {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(x[0], x[1], x[2]));
            let rotation = turn * start.rotation;
            let center = center + to_lidar * Vector3::new(x[3], x[4], x[5]);
            Isometry3::from_parts((-(rotation * center)).into(), rotation)
        };
        let (turn, shift) = (config.step_rad * scale, config.step_m * scale);
        let step = [turn, turn, turn, shift, shift, shift];
        let powell = PowellConfig { step, tolerance: config.tolerance, max_rounds: config.max_rounds };
        let minimum = minimize(|x| self.at(&pose(x)), [0.0; 6], &powell);
        (pose(&minimum.x), minimum)
    }

    /// The cost over the points that project into or near the image, at most about `max_points` of them.
    fn near(&self, pose: &Isometry3<f64>, max_points: usize) -> Self {
        let (width, height) = (self.camera.width as f64, self.camera.height as f64);
        let is_near = |point: &&[f32; 3]| {
            self.camera.project(&(pose * Point3::from(to_f64(point))).coords).is_some_and(|pixel| {
                (-MARGIN * width..(1.0 + MARGIN) * width).contains(&pixel.x)
                    && (-MARGIN * height..(1.0 + MARGIN) * height).contains(&pixel.y)
            })
        };
        let near: Vec<Vec<[f32; 3]>> =
            self.parts.par_iter().map(|part| part.points.iter().filter(is_near).copied().collect()).collect();
        let stride = stride(near.iter().map(Vec::len).sum(), max_points);
        let thin = |(part, points): (&ClassInFrame, Vec<[f32; 3]>)| ClassInFrame {
            points: thinned(points.len(), stride).map(|i| points[i]).collect(),
            ..part.clone()
        };
        Self { parts: self.parts.iter().zip(near).map(thin).collect(), ..self.clone() }
    }

    /// Sum of the distances of the points that project into the image, and their number.
    fn sum(
        &self,
        part: &ClassInFrame,
        rotation: &Rotation3<f64>,
        translation: &Vector3<f64>,
    ) -> (f64, usize) {
        let mut found = (0.0, 0);
        for point in &part.points {
            let pixel = self.camera.project(&(rotation * to_f64(point) + translation));
            if let Some(pixel) = pixel.filter(|pixel| self.camera.contains(pixel)) {
                found.0 += self.distance(&part.distances, &pixel);
                found.1 += 1;
            }
        }
        found
    }

    /// Distance, bilinear between block centres; beyond the outermost centres, that of the nearest one.
    fn distance(&self, distances: &[Vec<f32>], pixel: &Point2<f64>) -> f64 {
        let between = |x: f64, count: usize| {
            let place = ((x + 0.5) / self.block as f64 - 0.5).clamp(0.0, (count - 1) as f64);
            let before = place as usize;
            (before, (before + 1).min(count - 1), place.fract())
        };
        let (top, bottom, b) = between(pixel.y, distances.len());
        let (left, right, a) = between(pixel.x, distances[0].len());
        let along = |row: &[f32]| (1.0 - a) * f64::from(row[left]) + a * f64::from(row[right]);
        (1.0 - b) * along(&distances[top]) + b * along(&distances[bottom])
    }
}
