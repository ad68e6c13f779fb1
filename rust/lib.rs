//! LiDAR-camera extrinsic calibration by semantic mutual information: the numeric core.
#![deny(unsafe_code)]
#![warn(missing_docs)]

pub mod agreement;
pub mod alignment;
pub mod archive;
pub mod camera;
pub mod class_shares;
pub mod class_table;
pub mod classes;
pub mod correspondences;
pub mod edges;
pub mod error;
pub mod file;
pub mod fisher;
pub mod label_borders;
pub mod label_image;
pub mod labelling;
pub mod motion;
pub mod mutual_information;
pub mod npy;
pub mod observation;
pub mod partitions;
pub mod point_cloud;
pub mod powell;
pub mod probabilities;
pub mod pyramid;
pub mod registration;
pub mod se3;
pub mod segmentation;
pub mod semantic_distance;
pub mod shutter;
pub mod speckle;
pub mod spherical;
pub mod thinning;
pub mod unrolling;
pub mod visibility;
pub mod world;
pub mod zoom;

#[cfg(feature = "python")]
mod python;
