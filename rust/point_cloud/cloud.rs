//! A sweep as it is handed on.

use nalgebra::Vector3;

use crate::class_shares::ClassShares;

/// A point as read, for geometry.
#[inline]
pub fn to_f64(point: &[f32; 3]) -> Vector3<f64> {
    Vector3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2]))
}

/// A sweep without its "no return" entries.
#[derive(Clone, Debug, PartialEq)]
pub struct PointCloud {
    /// `x y z` in metres, LiDAR frame.
    pub points: Vec<[f32; 3]>,
    /// As recorded, where the format has it.
    pub intensity: Option<Vec<f32>>,
    /// The beam, where the cloud has a field of whole numbers for it.
    pub ring: Option<Vec<u16>>,
    /// Seconds, from whatever moment the recorder counts.
    pub time: Option<Vec<f64>>,
    /// Raw class ids, of the label file or else of the cloud's own label field.
    pub labels: Option<Vec<u16>>,
    /// Probabilities of raw class ids instead, where a network gave them.
    pub label_shares: Option<ClassShares>,
    /// Entries that were not finite or all zero, and were left out.
    pub num_no_returns: usize,
    /// Which of the file's entries are points.
    pub is_return: Vec<bool>,
}
