//! LiDAR-camera extrinsic calibration by semantic mutual information: the numeric core.
#![deny(unsafe_code)]
#![warn(missing_docs)]

pub mod camera;
pub mod error;
pub mod world;
