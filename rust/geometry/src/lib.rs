//! Geometry that the calibration and the synthetic streets share: camera models, rigid motions, angles and shutters.
#![deny(unsafe_code)]
#![warn(missing_docs)]

pub mod angles;
pub mod camera;
mod invalid;
pub mod se3;
pub mod shutter;

pub use invalid::Invalid;
