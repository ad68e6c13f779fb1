//! Point clouds and their labels, as stored on disk.
//!
//! Each format's parser finds the columns in the file's bytes; [`table`] decodes them.

mod ascii;
mod column;
mod delimited;
mod fields;
mod limit;
pub mod lzf;
mod npy;
mod options;
mod own_points;
mod pcd;
mod ply;
mod raw;
mod reading;
mod record_layout;
mod table;

use nalgebra::Vector3;

use crate::classes::ClassShares;

pub use limit::{Limit, MAX_POINTS};
pub use options::Reading;
pub use own_points::OwnPoints;
pub use reading::{Format, decode, read, read_all, read_as};
pub use record_layout::RecordLayout;

/// Converts a point as read to double precision.
pub fn to_f64(point: &[f32; 3]) -> Vector3<f64> {
    Vector3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2]))
}

/// A sweep without its "no return" entries, and without points of other LiDARs.
#[derive(Clone, Debug, PartialEq)]
pub struct PointCloud {
    /// `x y z` in metres, LiDAR frame.
    pub points: Vec<[f32; 3]>,
    /// Intensity as recorded, if the format has it.
    pub intensity: Option<Vec<f32>>,
    /// Ring (beam), if the cloud has an integer field for it.
    pub ring: Option<Vec<u16>>,
    /// Time in seconds, from an epoch that the recorder chose.
    pub time: Option<Vec<f64>>,
    /// Raw class ids, from the label file or else from the cloud's own label field.
    pub labels: Option<Vec<u16>>,
    /// Probabilities of raw class ids instead, if a network gave them.
    pub label_shares: Option<ClassShares>,
    /// Number of entries that were not finite or all zero, which are left out.
    pub num_no_returns: usize,
    /// Which of the file's entries are the points.
    pub is_kept: Vec<bool>,
}

#[cfg(test)]
mod hostile_tests;
