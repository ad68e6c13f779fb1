//! The cone that holds the view of a camera, by which points outside the image are left out before a lens is needed.

use geometry::camera::Camera;
use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::point_cloud::to_f64;

/// Distances that differ by less are equal, relative to the larger one.
const ROUND_OFF: f64 = 1e-9;

/// A ball (metres, LiDAR frame) around points.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    center: Vector3<f64>,
    radius: f64,
}

impl Ball {
    pub fn around(points: &[[f32; 3]]) -> Self {
        let bound = |of: fn(f32, f32) -> f32, start: f32| {
            let bounds = points
                .iter()
                .fold([start; 3], |bounds, point| std::array::from_fn(|axis| of(bounds[axis], point[axis])));
            to_f64(&bounds)
        };
        let (least, most) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        Self { center: 0.5 * (least + most), radius: 0.5 * (most - least).norm() }
    }
}

/// The cone around the optical axis of a camera at a pose, outside which nothing is in the image.
pub struct Cone {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
    /// Cosine and sine of the largest angle from the axis.
    pub cosine: f64,
    sine: f64,
}

impl Cone {
    pub fn of(camera: &Camera, t_camera_lidar: &Isometry3<f64>) -> Self {
        let cosine = camera.view_cosine();
        Self {
            rotation: *t_camera_lidar.rotation.to_rotation_matrix().matrix(),
            translation: t_camera_lidar.translation.vector,
            cosine,
            sine: (1.0 - cosine * cosine).sqrt(),
        }
    }

    pub fn to_camera(&self, p_lidar: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p_lidar + self.translation
    }

    /// Whether a point (camera frame) lies inside. Numbers are compared by their squares with the signs kept, which needs
    /// no root.
    pub fn contains(&self, p_camera: &Vector3<f64>) -> bool {
        p_camera.z * p_camera.z.abs() >= self.cosine * self.cosine.abs() * p_camera.norm_squared()
    }

    /// Whether a ball lies outside. Cones wider than a half-space exclude nothing.
    pub fn excludes(&self, ball: &Ball) -> bool {
        if self.cosine <= 0.0 {
            return false;
        }
        let center = self.to_camera(&ball.center);
        // Distance from the plane that touches the cone on the side of the centre: no point of the cone is nearer.
        let away = center.xy().norm() * self.cosine - center.z * self.sine;
        away > ball.radius + ROUND_OFF * (1.0 + center.norm())
    }
}
