//! Synthetic streets, the judge of a calibration: a LiDAR and a camera look at one triangle scene from two places.
//!
//! A frame is a pure function of the rig, its motion, a seed and the frame's number. Labels are exact, both sensors see
//! true parallax, and each [`Frame`] says which returns are hidden from the camera. A rig that moves fires every ray and
//! exposes every line of the picture from where it is then, while the world stands still.
//!
//! ```
//! use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
//! use semcal::{camera::Camera, world::{Lidar, Renderer, Rig, Shutter}};
//!
//! let k = [[80.0, 0.0, 79.5], [0.0, 80.0, 44.5], [0.0, 0.0, 1.0]];
//! // The camera looks along the LiDAR's x axis, half a metre below it.
//! let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
//! let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
//! let rig = Rig {
//!     lidar: Lidar::default(),
//!     camera: Camera::new("plumb_bob", (160, 90), k, &[])?,
//!     t_camera_lidar: Isometry3::from_parts(Translation3::new(0.0, -0.5, 0.0), rotation),
//!     shutter: Shutter::default(),
//! };
//! let frame = Renderer::new(rig)?.frame(7, 0);
//! assert_eq!(frame.points.len(), frame.point_labels.len());
//! # Ok::<(), semcal::error::Error>(())
//! ```

mod barriers;
mod buildings;
mod classes;
mod cycles;
mod furniture;
mod ground;
mod layout;
mod lots;
mod mesh;
mod noise;
mod passage;
mod people;
mod picture;
mod render;
mod scene;
mod sensors;
mod shading;
mod sight;
mod site;
mod street;
mod surface;
mod traffic;
mod vegetation;
mod vehicles;

pub use crate::shutter::{Direction, Shutter};
pub use classes::{Class, UNLABELED};
pub use render::{Frame, Renderer};
pub use sensors::{Lidar, Rig, ScanPattern};
pub use sight::Visibility;

/// No object comes nearer to the LiDAR's way than this, seen from above.
const FREE_RADIUS_M: f32 = 2.5;
/// The camera may be this far from the LiDAR.
const MAX_LEVER_M: f64 = 1.5;
