//! Directions as azimuth and elevation, radians, in the LiDAR frame (x forward, y left, z up).

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

/// Returns the angle from the x axis towards y, in (-pi, pi].
#[inline]
pub fn azimuth(direction: &Vector3<f64>) -> f64 {
    direction.y.atan2(direction.x)
}

/// Returns the angle above the x-y plane.
#[inline]
pub fn elevation(direction: &Vector3<f64>) -> f64 {
    direction.z.atan2(direction.x.hypot(direction.y))
}

/// An angle in [-pi, pi), radians.
#[inline]
pub fn wrapped(angle: f64) -> f64 {
    // Nearly all angles are in the interval, and a remainder takes many times as long.
    if (-PI..PI).contains(&angle) { angle } else { (angle + PI).rem_euclid(TAU) - PI }
}

/// Returns the unit vector of an azimuth and an elevation.
#[inline]
pub fn from_angles(azimuth: f64, elevation: f64) -> Vector3<f64> {
    Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}
