//! Synthetic streets with exact ground truth: a LiDAR and a camera observe one triangle scene from two places.
//!
//! A frame is a pure function of the rig, its motion, a seed and the frame's number. Labels are exact, both sensors
//! see true parallax, and each [`RenderedFrame`] says which returns are occluded from the camera. A moving rig fires
//! every ray and exposes every line of the image from its pose at that time, while the world is static.
#![deny(unsafe_code)]
#![warn(missing_docs)]

mod buildings;
mod carla_classes;
mod furniture;
mod ground_mesh;
mod image;
mod layout;
mod mesh;
mod parcels;
mod people;
mod render;
mod scene;
mod sensors;
mod street;
mod surface;
mod vegetation;
mod vehicles;

pub use carla_classes::Class;
pub use image::Visibility;
pub use render::{RenderedFrame, Renderer};
pub use sensors::{Lidar, Pattern, Rig};

/// No object comes nearer to the LiDAR's path than this, seen from above.
const FREE_RADIUS_M: f32 = 2.5;
/// Largest distance of the camera from the LiDAR.
const MAX_LEVER_M: f64 = 1.5;
