//! LiDAR-camera extrinsic calibration by semantic mutual information: the numeric core.
#![deny(unsafe_code)]
#![warn(missing_docs)]
// Without its bindings only the tests call the core.
#![cfg_attr(not(feature = "python"), allow(dead_code, unused_imports))]

mod agreement;
mod alignment;
mod array_file;
mod classes;
mod correspondences;
mod distributions;
mod edges;
mod error;
mod file;
mod label_borders;
mod label_image;
mod labelling;
mod lines_of_sight;
mod motion;
mod mutual_information;
mod observation;
pub mod point_cloud;
mod powell;
mod probabilities;
mod pyramid;
mod registration;
mod rolling_shutter;
mod scenes;
mod segmentation;
mod semantic_distance;
mod speckle;
mod spherical;
mod sweep_shift;
mod thinning;
mod view_cone;
mod visibility;
mod zoom;

#[cfg(feature = "python")]
mod python;
