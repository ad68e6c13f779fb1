//! The camera's side of a frame: one ray through the centre of each pixel, and the visibility of LiDAR returns.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use parry3d::math::Vec3;
use rayon::prelude::*;

use crate::carla_classes::{Class, UNLABELED};
use crate::layout::Capture;
use crate::mesh::GROUND;
use crate::scene::to_f32;
use crate::sensors::Rig;
use crate::surface::Spot;

/// Maximum range of the camera.
const FAR_M: f32 = 500.0;
/// Offset of shadow rays from the surface, and largest distance at which something casts a shadow.
const SHADOW_OFFSET_M: f32 = 0.01;
const SHADOW_REACH_M: f32 = 40.0;

pub struct Pixel {
    pub label: u8,
    pub rgb: [u8; 3],
    pub instance: u16,
}

/// Renders the image of a rig's camera, whose pixels look along `pixel_rays`, row by row.
pub fn render(capture: &Capture, rig: &Rig, pixel_rays: &[Option<Vector3<f32>>]) -> Vec<Pixel> {
    let size = [rig.camera.width, rig.camera.height];
    let t_rig_camera = rig.t_camera_rig.inverse();
    let at = |time_s| View::new(&(capture.t_world_rig(time_s) * t_rig_camera));
    let views: Vec<View> = rig.shutter.line_times_s(size).into_iter().map(at).collect();
    let row = |(v, rays): (usize, &[Option<Vector3<f32>>])| -> Vec<Pixel> {
        let mut cache = HitCache::default();
        let mut look = |u: usize, ray: &Vector3<f32>| {
            let view = &views[rig.shutter.line([u, v], size)];
            let ray = view.rotation * ray;
            cache.look(capture, view.origin, Vec3::new(ray.x, ray.y, ray.z))
        };
        let pixel = |(u, ray): (usize, &Option<_>)| ray.as_ref().map_or(Pixel::UNREACHED, |ray| look(u, ray));
        rays.iter().enumerate().map(pixel).collect()
    };
    let rows: Vec<_> = pixel_rays.par_chunks(size[0].max(1)).enumerate().map(row).collect();
    rows.into_iter().flatten().collect()
}

/// Position and orientation from which a line of the image is exposed.
struct View {
    origin: Vec3,
    rotation: Matrix3<f32>,
}

impl View {
    fn new(t_world_camera: &Isometry3<f64>) -> Self {
        Self {
            origin: to_f32(&t_world_camera.translation.vector),
            rotation: t_world_camera.rotation.to_rotation_matrix().cast::<f32>().into_inner(),
        }
    }
}

impl Pixel {
    const UNREACHED: Self = Self { label: UNLABELED, rgb: [0; 3], instance: GROUND };
}

/// The hits of the previous pixel, which its neighbour is likely to share.
#[derive(Default)]
struct HitCache {
    seen: Option<u32>,
    shading: Option<u32>,
}

impl HitCache {
    /// The pixel seen along a unit ray in the world.
    fn look(&mut self, capture: &Capture, origin: Vec3, direction: Vec3) -> Pixel {
        let (scene, light) = (&capture.scene, &capture.light);
        let Some(hit) = scene.cast(origin, direction, FAR_M, self.seen) else {
            return Pixel { label: Class::Sky.id(), rgb: light.sky(direction), instance: GROUND };
        };
        self.seen = Some(hit.triangle);
        let spot = scene.spot(hit, origin, direction);
        let sunlit = light.faces_sun(spot.normal) && !self.is_shaded(capture, &spot);
        Pixel {
            label: spot.surface.class.id(),
            rgb: light.color(&spot, sunlit),
            instance: spot.surface.instance,
        }
    }

    fn is_shaded(&mut self, capture: &Capture, spot: &Spot) -> bool {
        let start = spot.point + spot.normal * SHADOW_OFFSET_M;
        let blocker = capture.scene.blocker(start, capture.light.sun, SHADOW_REACH_M, self.shading);
        self.shading = blocker.or(self.shading);
        blocker.is_some()
    }
}

/// A return is occluded when something is nearer by this much on the camera's line of sight.
const HIDDEN_MARGIN_M: f64 = 0.1;
/// The exposure time of a point has converged if it changes by less than this fraction of a line's time.
const SETTLED_LINES: f64 = 0.1;
/// A point whose line is not found within this many steps passes the camera faster than the shutter rolls.
const MAX_STEPS: usize = 30;

/// Whether the camera sees a return of the LiDAR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// It is outside the image.
    Outside,
    /// Something nearer to the camera occludes it.
    Hidden,
    /// The camera sees it.
    Visible,
}

/// The target of a LiDAR ray.
pub struct Target {
    /// Firing time, seconds from the middle of the sweep.
    pub time_s: f64,
    /// Measured position, frame of the rig at that time.
    pub measured: Vector3<f64>,
    /// True position, frame of the rig at that time.
    pub truth: Vector3<f64>,
}

/// Whether a rig's camera sees a return at the time when its line of the image is exposed.
pub fn visibility(capture: &Capture, rig: &Rig, target: &Target) -> Visibility {
    let Some(time_s) = exposure_time_s(capture, rig, target) else { return Visibility::Outside };
    let camera_world = capture.t_world_rig(time_s) * (rig.t_camera_rig.inverse() * Point3::origin());
    let sight = capture.t_world_rig(target.time_s) * Point3::from(target.truth) - camera_world;
    let limit = (sight.norm() - HIDDEN_MARGIN_M) as f32;
    let (eye, sight) = (to_f32(&camera_world.coords), to_f32(&sight.normalize()));
    match capture.scene.blocker(eye, sight, limit, None) {
        Some(_) => Visibility::Hidden,
        None => Visibility::Visible,
    }
}

/// The time at which the camera exposes the line that a return projects to; `None` if it is outside the image.
fn exposure_time_s(capture: &Capture, rig: &Rig, target: &Target) -> Option<f64> {
    let (camera, shutter) = (&rig.camera, &rig.shutter);
    let size = [camera.width, camera.height];
    let settled_s = SETTLED_LINES * shutter.readout_s / shutter.num_lines(size) as f64;
    let mut time_s = shutter.delay_s + 0.5 * shutter.readout_s;
    for _ in 0..MAX_STEPS {
        let seen = capture.motion.seen_at(target.measured.into(), target.time_s, time_s);
        let pixel = camera.project(&(rig.t_camera_rig * seen).coords)?;
        let exposed_s = shutter.time_at_s(pixel.into(), size);
        if (exposed_s - time_s).abs() <= settled_s {
            return camera.contains(&pixel).then_some(time_s);
        }
        time_s = exposed_s;
    }
    None
}
