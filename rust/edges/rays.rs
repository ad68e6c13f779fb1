//! The rays of a sweep, by their angles.

use geometry::angles::{azimuth, elevation, wrapped};
use nalgebra::Vector3;

use crate::point_cloud::to_f64;
use crate::segmentation::is_return;

/// Rays closer than this count as one direction, radians.
pub const MIN_ANGLE: f64 = 3e-4;
/// Largest distance of a neighbour, radians.
pub const REACH: f64 = 0.02;
/// Elevation tolerance of a neighbour, radians, and the same relative to its distance: a ring is not a circle if
/// the sensor is tilted or corrects for the positions of its lasers, and a rosette has no rings.
pub const HEIGHT_TOLERANCE: f64 = 5e-4;
pub const SLOPE: f64 = 0.3;
/// Smallest cosine of an elevation: at the poles azimuths are meaningless.
const MIN_COSINE: f64 = 1e-3;

/// Ray of a return.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub azimuth: f64,
    pub elevation: f64,
    pub range: f64,
    /// Index among all points of the sweep.
    pub index: usize,
}

/// The ray of each return, in the order of the points.
pub fn returns(points: &[[f32; 3]]) -> Vec<Ray> {
    let ray = |(index, point): (usize, &[f32; 3])| {
        let point = to_f64(point);
        is_return(&point).then(|| Ray::to(&point, index))
    };
    points.iter().enumerate().filter_map(ray).collect()
}

impl Ray {
    /// The ray to a point, metres, with its index.
    pub fn to(point: &Vector3<f64>, index: usize) -> Self {
        Self { azimuth: azimuth(point), elevation: elevation(point), range: point.norm(), index }
    }

    /// Radians of arc per radian of azimuth.
    pub fn across(&self) -> f64 {
        self.elevation.cos().max(MIN_COSINE)
    }

    /// Turn to another ray, radians of azimuth, in [-pi, pi).
    pub fn turn_to(&self, other: &Self) -> f64 {
        wrapped(other.azimuth - self.azimuth)
    }

    /// Distance of another ray at about the same elevation, radians of arc.
    pub fn arc_to(&self, other: &Self) -> f64 {
        self.turn_to(other).abs() * self.across()
    }

    /// Whether another ray at about the same elevation has the same direction.
    pub fn is_in_line_with(&self, other: &Self) -> bool {
        self.arc_to(other) <= MIN_ANGLE
    }

    /// Whether another ray, radians of arc away, is at about the same elevation.
    pub fn is_level_with(&self, other: &Self, distance: f64) -> bool {
        (other.elevation - self.elevation).abs() <= HEIGHT_TOLERANCE + SLOPE * distance
    }

    /// Unit vector to the ray's point, one of the `points` of the sweep. Dividing takes less time than sines and cosines, and
    /// a vector in each ray would take three quarters more memory.
    pub fn direction(&self, points: &[[f32; 3]]) -> Vector3<f64> {
        to_f64(&points[self.index]) / self.range
    }

    /// Vector from the point, metres, to its range half-way to a neighbour's ray.
    pub fn half_way(&self, neighbour: &Self, points: &[[f32; 3]]) -> [f32; 3] {
        let own = self.direction(points);
        self.between(&own, &(own + neighbour.direction(points)).normalize())
    }

    /// Vector from the point, metres, to its range at another azimuth, radians of arc away.
    pub fn turned(&self, arc: f64, points: &[[f32; 3]]) -> [f32; 3] {
        let own = self.direction(points);
        let (sine, cosine) = (arc / self.across()).sin_cos();
        let turned = Vector3::new(cosine * own.x - sine * own.y, sine * own.x + cosine * own.y, own.z);
        self.between(&own, &turned)
    }

    /// Vector between two unit vectors at the ray's range, metres.
    fn between(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> [f32; 3] {
        let by = (to - from) * self.range;
        [by.x as f32, by.y as f32, by.z as f32]
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Neighbour {
    /// Index among the rays.
    pub at: usize,
    /// Distance, radians of arc.
    pub distance: f64,
}

/// Neighbours of a ray towards larger azimuths, and towards smaller ones.
pub type Sides = [Option<Neighbour>; 2];

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use geometry::angles::from_angles;

    use super::*;

    #[test]
    fn vectors_to_other_directions_are_those_of_the_angles() {
        const RANGE: f64 = 7.0;
        for elevation in [-1.5, -0.3, 0.0, 1.2] {
            let [near, beside] =
                [PI - 0.01, 0.01 - PI].map(|azimuth| from_angles(azimuth, elevation) * RANGE);
            let points = [near, beside].map(|point| [point.x as f32, point.y as f32, point.z as f32]);
            let [ray, other] = *returns(&points) else { panic!("two returns") };
            let arc = 0.02;
            let turned = from_angles(PI - 0.01 + arc / elevation.cos(), elevation) * RANGE - near;
            let half_way = (near + beside).normalize() * RANGE - near;
            for (found, expected) in
                [(ray.turned(arc, &points), turned), (ray.half_way(&other, &points), half_way)]
            {
                assert!((to_f64(&found) - expected).norm() < 1e-5, "{elevation}: {found:?} {expected}");
            }
        }
    }
}
