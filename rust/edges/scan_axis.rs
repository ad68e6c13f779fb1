//! The axis about which a LiDAR turns, from a sweep whose points are in the order of the scan.
//!
//! The firings of a laser are on a cone about that axis, so that the steps from direction to direction are across it.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, UnitVector3, Vector3};

use super::rays::{MIN_ANGLE, REACH, Ray, SLOPE};
use super::scan_lines::{is_one_ring, ring_by_ring};

/// Number of times that the axis is estimated again, from the steps that are across it: where the range steps, a laser beside
/// the axis seems to change its direction.
const NUM_REFINEMENTS: usize = 5;
/// Number of sectors about an axis, and smallest number of those with rays if a LiDAR turns about it. A view of 120 degrees
/// that is scanned column by column takes fewer.
const SECTORS: usize = 36;
const MIN_SECTORS: usize = 18;

/// The axis, on the side of positive z; `None` without neighbouring rays. Rays in another order than a scan's have an axis,
/// too: whether they advance about it, `scan_lines::neighbours` tells.
///
/// For five sweeps of KITTI and KITTI-360, it is within 0.4 degrees of the z axis.
pub fn scan_axis(rays: &[Ray], rings: Option<&[u16]>, points: &[[f32; 3]]) -> Option<UnitVector3<f64>> {
    let step = |pair: &[Ray]| {
        let step = pair[1].direction(points) - pair[0].direction(points);
        let is_near = (MIN_ANGLE..REACH).contains(&step.norm()) && is_one_ring(&pair[0], &pair[1], rings);
        is_near.then(|| step.normalize())
    };
    let steps: Vec<Vector3<f64>> = ring_by_ring(rays, rings).windows(2).filter_map(step).collect();
    let mut axis = across(steps.iter())?;
    for _ in 0..NUM_REFINEMENTS {
        axis = across(steps.iter().filter(|step| step.dot(&axis).abs() < SLOPE))?;
    }
    Some(if axis.z < 0.0 { -axis } else { axis })
}

/// The direction across most of which unit vectors are.
fn across<'a>(steps: impl Iterator<Item = &'a Vector3<f64>>) -> Option<UnitVector3<f64>> {
    let products = steps.map(|step| step * step.transpose()).sum::<Matrix3<f64>>();
    let eigen = products.try_symmetric_eigen(1e-12, 100)?;
    (products != Matrix3::zeros())
        .then(|| UnitVector3::new_normalize(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()))
}

/// Whether rays are on more than half of the azimuths, as those of a LiDAR that turns about the z axis.
pub fn is_all_around(rays: &[Ray]) -> bool {
    let mut is_seen = [false; SECTORS];
    for ray in rays {
        let sector = (ray.azimuth + PI) / TAU * SECTORS as f64;
        is_seen[(sector as usize).min(SECTORS - 1)] = true;
    }
    is_seen.iter().filter(|&&seen| seen).count() >= MIN_SECTORS
}
