//! Synthetic streets, the judge of a calibration: a LiDAR and a camera look at one triangle scene from two places.
//!
//! A frame is a pure function of the rig, its motion, a seed and the frame's number. Labels are exact, both sensors see
//! true parallax, and each [`Frame`] says which returns are hidden from the camera. A rig that moves fires every ray and
//! exposes every line of the image from where it is then, while the world stands still.

mod buildings;
mod classes;
mod furniture;
mod ground;
mod layout;
mod lots;
mod mesh;
mod people;
mod picture;
mod render;
mod scene;
mod sensors;
mod street;
mod surface;
mod vegetation;
mod vehicles;

pub use crate::shutter::Shutter;
pub use classes::Class;
pub use picture::Visibility;
pub use render::{Frame, Renderer};
pub use sensors::{Lidar, Pattern, Rig};

/// No object comes nearer to the LiDAR's way than this, seen from above.
const FREE_RADIUS_M: f32 = 2.5;
/// The camera may be this far from the LiDAR.
const MAX_LEVER_M: f64 = 1.5;
