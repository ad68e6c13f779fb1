//! Distance of projected points from the pixels of their own class: the cost of SOIC, and its minimum.
//!
//! Source: Wang, Nobuhara, Nakamura and Sakurada, *SOIC: Semantic Online Initialization and Calibration for LiDAR and
//! Camera*, arXiv 2003.04260.

use std::sync::Arc;

use nalgebra::{Isometry3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::point_cloud::to_f64;
use crate::powell::{Minimum, PowellConfig, minimize};
use crate::thinning::{stride, thinned};

/// Margin around the image, in its sides: points that project farther outside at the start are left out.
const MARGIN: f64 = 0.5;
/// Factor on the reach of the line searches in every other restart.
const SHORTER: f64 = 0.2;

/// The points of one class in one frame, and the distance of each block of the image from a pixel of that class.
#[derive(Clone, Debug)]
pub struct ClassInFrame {
    /// Number of the class, from zero.
    pub class: usize,
    /// Points in metres, LiDAR frame.
    pub points: Vec<[f32; 3]>,
    /// Rows of blocks, in pixels.
    pub distances: Arc<Vec<Vec<f32>>>,
}

/// Settings of the minimisation.
#[derive(Clone, Copy, Debug)]
pub struct DescentConfig {
    /// Largest rotation of the camera in a line search.
    pub step_rad: f64,
    /// Largest motion of the camera in a line search.
    pub step_m: f64,
    /// Share of its step to which a line search is exact.
    pub tolerance: f64,
    /// Largest number of rounds of Powell's method from each start.
    pub max_rounds: usize,
    /// Largest number of restarts at the last end, with the axes of the camera; they stop below the tolerance.
    pub max_restarts: usize,
    /// Largest number of points that are used.
    pub max_points: usize,
}

/// The minimum of the cost.
#[derive(Clone, Copy, Debug)]
pub struct DistanceMinimum {
    /// T_camera_lidar.
    pub pose: Isometry3<f64>,
    /// The cost at the pose.
    pub cost_px: f64,
    /// Number of evaluations of the cost.
    pub num_evaluations: usize,
    /// Whether the last restarts gained nothing.
    pub converged: bool,
}

/// The cost of a pose over all frames.
#[derive(Clone, Debug)]
pub struct SemanticDistance {
    camera: Camera,
    parts: Vec<ClassInFrame>,
    num_classes: usize,
    /// Side of a block, pixels.
    block: usize,
}

impl SemanticDistance {
    /// The cost over all classes of all frames.
    pub fn new(camera: Camera, parts: Vec<ClassInFrame>, block: usize) -> Self {
        let num_classes = parts.iter().map(|part| part.class + 1).max().unwrap_or(0);
        Self { camera, parts, num_classes, block }
    }

    /// Distance in pixels of a class's projected points from the nearest pixel of that class: the mean over the points in
    /// the image, and then over the classes. Infinite where no point projects into the image.
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

    /// Minimum of the cost, by Powell's method over a rotation vector and a motion of the camera's centre, both along the
    /// axes of the camera at the start.
    ///
    /// # Errors
    /// No point projects into the image at the start.
    pub fn minimize(&self, start: &Isometry3<f64>, config: &DescentConfig) -> Result<DistanceMinimum> {
        let near = self.near(start, config.max_points);
        let cost = near.at(start);
        if !cost.is_finite() {
            return Err(Error::Calibration("no overlap: no point of any class lands in the picture".into()));
        }
        let mut found = DistanceMinimum { pose: *start, cost_px: cost, num_evaluations: 1, converged: false };
        let mut num_idle = 0;
        for restart in 0..=config.max_restarts {
            let scale = if restart % 2 == 0 { 1.0 } else { SHORTER };
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
            // Neither far nor near is there anything better.
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

    /// The cost of the points that project into or near the image, at most about `max_points` of them.
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

    /// The sum of the distances of the points that project into the image, and their number.
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

    /// Distance, bilinear between the centres of blocks; beyond the outermost centres, that of the nearest one.
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

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 64;
    const CONFIG: DescentConfig = DescentConfig {
        step_rad: 0.05,
        step_m: 0.2,
        tolerance: 1e-4,
        max_rounds: 50,
        max_restarts: 20,
        max_points: 100,
    };

    fn camera() -> Camera {
        let c = (SIZE as f64 - 1.0) / 2.0;
        Camera::new("plumb_bob", (SIZE, SIZE), [[50.0, 0.0, c], [0.0, 50.0, c], [0.0, 0.0, 1.0]], &[])
            .unwrap()
    }

    /// The point at some depth, metres, that a pixel shows.
    fn point(u: f64, v: f64, depth: f64) -> [f32; 3] {
        let ray = camera().unproject(&Point2::new(u, v)).unwrap();
        (ray * (depth / ray.z)).map(|x| x as f32).into()
    }

    /// In blocks of `block` pixels.
    fn field(block: usize, distance: impl Fn(f64, f64) -> f64) -> Arc<Vec<Vec<f32>>> {
        let center = |i: usize| (i as f64 + 0.5) * block as f64 - 0.5;
        let row = |v| (0..SIZE / block).map(|u| distance(center(u), center(v)) as f32).collect();
        Arc::new((0..SIZE / block).map(row).collect())
    }

    #[test]
    fn classes_count_alike_however_many_points_they_have() {
        for block in [1, 2, 4] {
            let near = ClassInFrame {
                class: 0,
                points: vec![point(12.0, 9.0, 3.0), point(12.0, 20.0, 4.0), point(12.0, 33.0, 5.0)],
                distances: field(block, |u, _| u - 10.0),
            };
            let far = ClassInFrame {
                class: 1,
                points: vec![point(36.25, 40.0, 5.0)],
                distances: field(block, |u, _| u - 30.0),
            };
            let outside = ClassInFrame {
                class: 2,
                points: vec![point(99.0, 9.0, 5.0), [0.0, 0.0, -5.0]],
                distances: field(block, |_, _| 7.0),
            };
            let cost = SemanticDistance::new(camera(), vec![near, far, outside], block);
            assert!((cost.at(&Isometry3::identity()) - (2.0 + 6.25) / 2.0).abs() < 1e-4);
        }
    }

    #[test]
    fn finds_the_pose_at_which_every_point_is_where_its_class_is() {
        let places = [
            (8.0, 9.0, 3.0),
            (50.0, 12.0, 9.0),
            (30.0, 31.0, 4.0),
            (12.0, 55.0, 7.0),
            (54.0, 50.0, 3.5),
            (33.0, 15.0, 12.0),
        ];
        let part = |(class, &(u, v, depth)): (usize, &(f64, f64, f64))| ClassInFrame {
            class,
            points: vec![point(u, v, depth)],
            distances: field(1, |x, y| (x - u).hypot(y - v)),
        };
        let cost = SemanticDistance::new(camera(), places.iter().enumerate().map(part).collect(), 1);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.03, 0.01));
        let start = Isometry3::from_parts(Vector3::new(0.1, -0.05, 0.1).into(), turn);
        let found = cost.minimize(&start, &CONFIG).unwrap();
        assert!(found.converged && found.cost_px < 0.02, "{found:?}");
        assert!(
            found.pose.rotation.angle() < 0.001 && found.pose.translation.vector.norm() < 0.005,
            "{found:?}"
        );
    }

    #[test]
    fn what_is_seen_nowhere_is_an_error() {
        let behind =
            ClassInFrame { class: 0, points: vec![[0.0, 0.0, -5.0]], distances: field(1, |_, _| 0.0) };
        let cost = SemanticDistance::new(camera(), vec![behind], 1);
        assert_eq!(cost.at(&Isometry3::identity()), f64::INFINITY);
        assert!(cost.minimize(&Isometry3::identity(), &CONFIG).is_err());
    }
}
