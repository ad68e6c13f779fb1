//! One frame of a rig: its LiDAR's returns and its camera's picture.

use nalgebra::{Point2, Point3, Vector3};
use parry3d::math::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::classes::{Class, UNLABELED};
use super::layout::{self, Stage};
use super::mesh::GROUND;
use super::sensors::Rig;
use super::shading::Spot;
use crate::error::Result;

/// A return is hidden when something stands this much nearer on the camera's line of sight.
const HIDDEN_MARGIN_M: f64 = 0.1;
/// The camera sees no farther.
const FAR_M: f32 = 500.0;
/// Shadow rays start this far off a surface, and nothing farther casts a shadow.
const SHADOW_OFFSET_M: f32 = 0.01;
const SHADOW_REACH_M: f32 = 40.0;
/// Rays of a LiDAR that share one generator.
const CHUNK: usize = 1024;

/// Whether the camera sees a LiDAR return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// It lies outside the picture.
    Outside,
    /// Something nearer stands before it.
    Hidden,
    /// It is in the picture and seen.
    Visible,
}

/// What a rig measures at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// x, y, z, intensity in [0, 1] of each return, LiDAR frame, in firing order; lost rays are left out.
    pub points: Vec<[f32; 4]>,
    /// SemanticKITTI's form: instance << 16 | class id.
    pub point_labels: Vec<u32>,
    /// Whether the camera sees each return.
    pub point_visibility: Vec<Visibility>,
    /// Class ids, row-major; [`UNLABELED`] where the lens does not reach.
    pub image_labels: Vec<u8>,
    /// The colour picture, row-major; black where the lens does not reach.
    pub image_rgb: Vec<[u8; 3]>,
    /// Distinct objects in the picture or among the returns; the ground is none.
    pub objects_in_view: usize,
}

/// Renders the frames of one rig.
pub struct Renderer {
    rig: Rig,
    /// The ray of each pixel centre, camera frame; `None` where the lens does not reach.
    pixel_rays: Vec<Option<Vector3<f32>>>,
}

struct Pixel {
    label: u8,
    rgb: [u8; 3],
    instance: u16,
}

struct Return {
    point: [f32; 4],
    label: u32,
    visibility: Visibility,
}

impl Renderer {
    /// Prepares a rig.
    ///
    /// # Errors
    /// The LiDAR has no rays or impossible angles, or the camera is too far from it.
    pub fn new(rig: Rig) -> Result<Self> {
        rig.check()?;
        let width = rig.camera.width;
        let pixel_rays = (0..width * rig.camera.height)
            .into_par_iter()
            .map(|i| {
                let center = Point2::new((i % width) as f64, (i / width) as f64);
                rig.camera.unproject(&center).map(|ray| ray.cast())
            })
            .collect();
        Ok(Self { rig, pixel_rays })
    }

    /// The frame of a number in the world of a seed.
    pub fn frame(&self, seed: u64, number: u64) -> Frame {
        let stage = layout::build(generator(seed, number, 0), self.rig.lidar.tilt_deg);
        let pixels = self.picture(&stage);
        let returns = self.scan(&stage, seed, number);
        Frame {
            objects_in_view: count_objects(&pixels, &returns),
            image_labels: pixels.iter().map(|pixel| pixel.label).collect(),
            image_rgb: pixels.iter().map(|pixel| pixel.rgb).collect(),
            points: returns.iter().map(|hit| hit.point).collect(),
            point_labels: returns.iter().map(|hit| hit.label).collect(),
            point_visibility: returns.iter().map(|hit| hit.visibility).collect(),
        }
    }

    fn picture(&self, stage: &Stage) -> Vec<Pixel> {
        let t_world_camera = stage.t_world_lidar * self.rig.t_camera_lidar.inverse();
        let origin = to_f32(&t_world_camera.translation.vector);
        let rotation = t_world_camera.rotation.to_rotation_matrix().cast::<f32>();
        let row = |rays: &[Option<Vector3<f32>>]| -> Vec<Pixel> {
            let mut neighbour = Neighbour::default();
            let mut look = |ray: &Vector3<f32>| {
                let ray = rotation * ray;
                neighbour.look(stage, origin, Vec3::new(ray.x, ray.y, ray.z))
            };
            rays.iter().map(|ray| ray.as_ref().map_or(Pixel::UNREACHED, &mut look)).collect()
        };
        let rows: Vec<_> = self.pixel_rays.par_chunks(self.rig.camera.width.max(1)).map(row).collect();
        rows.into_iter().flatten().collect()
    }

    fn scan(&self, stage: &Stage, seed: u64, number: u64) -> Vec<Return> {
        let directions = self.rig.lidar.pattern.directions(number);
        let chunks: Vec<Vec<Return>> = directions
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(i, directions)| {
                let mut rng = generator(seed, number, 1 + i as u64);
                directions.iter().filter_map(|direction| self.fire(stage, direction, &mut rng)).collect()
            })
            .collect();
        chunks.into_iter().flatten().collect()
    }

    /// One ray of the LiDAR.
    fn fire(&self, stage: &Stage, direction: &Vector3<f64>, rng: &mut ChaCha8Rng) -> Option<Return> {
        let lidar = &self.rig.lidar;
        let (lost, noise): (bool, f64) = (rng.random_bool(lidar.dropout), StandardNormal.sample(rng));
        let origin = to_f32(&stage.t_world_lidar.translation.vector);
        let ray = to_f32(&(stage.t_world_lidar.rotation * direction));
        let hit = stage.scene.cast(origin, ray, lidar.max_range_m as f32, None)?;
        if lost {
            return None;
        }
        let spot = stage.scene.spot(hit, origin, ray);
        let measured = direction * (f64::from(hit.range) + noise * lidar.range_noise_m);
        Some(Return {
            point: [measured.x as f32, measured.y as f32, measured.z as f32, spot.intensity()],
            label: u32::from(spot.surface.instance) << 16 | u32::from(spot.surface.class.id()),
            visibility: self.visibility(stage, &measured, &(direction * f64::from(hit.range))),
        })
    }

    /// Whether the camera sees a return, measured at one point of the LiDAR frame and truly at another.
    fn visibility(&self, stage: &Stage, measured: &Vector3<f64>, truth: &Vector3<f64>) -> Visibility {
        let t = &self.rig.t_camera_lidar;
        let pixel = self.rig.camera.project(&(t * Point3::from(*measured)).coords);
        if !pixel.is_some_and(|pixel| self.rig.camera.contains(&pixel)) {
            return Visibility::Outside;
        }
        let camera_world = stage.t_world_lidar * (t.inverse() * Point3::origin());
        let sight = stage.t_world_lidar * Point3::from(*truth) - camera_world;
        let limit = (sight.norm() - HIDDEN_MARGIN_M) as f32;
        let (eye, sight) = (to_f32(&camera_world.coords), to_f32(&sight.normalize()));
        match stage.scene.blocker(eye, sight, limit, None) {
            Some(_) => Visibility::Hidden,
            None => Visibility::Visible,
        }
    }
}

impl Pixel {
    const UNREACHED: Self = Self { label: UNLABELED, rgb: [0; 3], instance: GROUND };
}

/// What the pixel before met, which its neighbour is likely to meet too.
#[derive(Default)]
struct Neighbour {
    seen: Option<u32>,
    shading: Option<u32>,
}

impl Neighbour {
    /// The pixel of a unit ray in the world.
    fn look(&mut self, stage: &Stage, origin: Vec3, direction: Vec3) -> Pixel {
        let (scene, light) = (&stage.scene, &stage.light);
        let Some(hit) = scene.cast(origin, direction, FAR_M, self.seen) else {
            return Pixel { label: Class::Sky.id(), rgb: light.sky(direction), instance: GROUND };
        };
        self.seen = Some(hit.triangle);
        let spot = scene.spot(hit, origin, direction);
        let sunlit = light.faces_sun(spot.normal) && !self.is_shaded(stage, &spot);
        Pixel {
            label: spot.surface.class.id(),
            rgb: light.color(&spot, sunlit),
            instance: spot.surface.instance,
        }
    }

    fn is_shaded(&mut self, stage: &Stage, spot: &Spot) -> bool {
        let start = spot.point + spot.normal * SHADOW_OFFSET_M;
        let blocker = stage.scene.blocker(start, stage.light.sun, SHADOW_REACH_M, self.shading);
        self.shading = blocker.or(self.shading);
        blocker.is_some()
    }
}

/// The generator of one part of one frame.
fn generator(seed: u64, number: u64, part: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    for (bytes, word) in key.chunks_exact_mut(8).zip([seed, number, part]) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    ChaCha8Rng::from_seed(key)
}

fn count_objects(pixels: &[Pixel], returns: &[Return]) -> usize {
    let mut seen = vec![false; usize::from(u16::MAX) + 1];
    for pixel in pixels {
        seen[usize::from(pixel.instance)] = true;
    }
    for hit in returns {
        seen[(hit.label >> 16) as usize] = true;
    }
    seen[usize::from(GROUND)] = false;
    seen.into_iter().filter(|&seen| seen).count()
}

fn to_f32(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}
