//! Rendering of one frame of a rig: the returns of its LiDAR and the image of its camera.

use geometry::Invalid;
use nalgebra::{Point2, Point3, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use crate::image::{self, Pixel, Target, Visibility};
use crate::layout::{self, Capture};
use crate::mesh::GROUND;
use crate::scene::to_f32;
use crate::sensors::{Rig, RigMotion};

/// Number of LiDAR rays that share one random generator.
const CHUNK: usize = 1024;

/// What both sensors of a rig measure in one street.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedFrame {
    /// x, y, z and intensity in [0, 1] of each return, in the LiDAR frame of its firing time, in firing order. Lost
    /// rays are left out.
    pub points: Vec<[f32; 4]>,
    /// Seconds from the start of the sweep to each return.
    pub point_times: Vec<f32>,
    /// Labels in SemanticKITTI's form: instance << 16 | class id.
    pub point_labels: Vec<u32>,
    /// Whether the camera sees each return.
    pub point_visibility: Vec<Visibility>,
    /// Class ids, row-major; [`crate::UNLABELED`] where the lens does not reach.
    pub image_labels: Vec<u8>,
    /// The colour image, row-major; black where the lens does not reach.
    pub image_rgb: Vec<[u8; 3]>,
    /// Number of distinct objects in the image or among the returns, without the ground.
    pub num_objects: usize,
}

/// Renders the frames of one rig.
pub struct Renderer {
    rig: Rig,
    /// The ray of each pixel centre, camera frame; `None` where the lens does not reach.
    pixel_rays: Vec<Option<Vector3<f32>>>,
}

struct Return {
    point: [f32; 4],
    time: f32,
    label: u32,
    visibility: Visibility,
}

impl Renderer {
    /// Prepares a rig.
    ///
    /// # Errors
    /// The LiDAR has no rays or impossible angles, or the camera is too far from it.
    pub fn new(rig: Rig) -> Result<Self, Invalid> {
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

    /// Renders one frame of a static rig, by the seed of the world and the frame's number.
    pub fn frame(&self, seed: u64, number: u64) -> RenderedFrame {
        self.render(seed, number, RigMotion::STILL)
    }

    /// Renders one frame of a rig that moves with a constant twist, metres and radians per second in the frame of
    /// its first LiDAR.
    ///
    /// The image is stamped with the middle of the sweep. The street differs from that of [`Renderer::frame`]: the
    /// rig keeps to its lane, and its path is free.
    ///
    /// # Errors
    /// The twist is not finite, or faster than any rig.
    pub fn frame_in_motion(
        &self,
        seed: u64,
        number: u64,
        twist_per_s: Vector6<f64>,
    ) -> Result<RenderedFrame, Invalid> {
        Ok(self.render(seed, number, RigMotion::new(twist_per_s, &self.rig)?))
    }

    fn render(&self, seed: u64, number: u64, motion: RigMotion) -> RenderedFrame {
        let capture = layout::build(generator(seed, number, 0), self.rig.lidar.tilt_deg, motion);
        let pixels = image::render(&capture, &self.rig, &self.pixel_rays);
        let returns = self.scan(&capture, seed, number);
        RenderedFrame {
            num_objects: count_objects(&pixels, &returns),
            image_labels: pixels.iter().map(|pixel| pixel.label).collect(),
            image_rgb: pixels.iter().map(|pixel| pixel.rgb).collect(),
            points: returns.iter().map(|hit| hit.point).collect(),
            point_times: returns.iter().map(|hit| hit.time).collect(),
            point_labels: returns.iter().map(|hit| hit.label).collect(),
            point_visibility: returns.iter().map(|hit| hit.visibility).collect(),
        }
    }

    fn scan(&self, capture: &Capture, seed: u64, number: u64) -> Vec<Return> {
        let directions = self.rig.lidar.directions(number);
        let chunks: Vec<Vec<Return>> = directions
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(i, directions)| {
                let first_of_lidar = u64::from(self.rig.lidar_number) << u32::BITS;
                let mut rng = generator(seed, number, first_of_lidar + 1 + i as u64);
                let rays = (i * CHUNK..).zip(directions);
                rays.filter_map(|(ray, direction)| self.fire(capture, ray, direction, &mut rng)).collect()
            })
            .collect();
        chunks.into_iter().flatten().collect()
    }

    /// Fires one ray of the LiDAR, given by its number in the sweep.
    fn fire(
        &self,
        capture: &Capture,
        ray: usize,
        direction: &Vector3<f64>,
        rng: &mut ChaCha8Rng,
    ) -> Option<Return> {
        let lidar = &self.rig.lidar;
        let time = lidar.sweep_s * lidar.share_before(ray);
        let time_s = time - 0.5 * lidar.sweep_s;
        let t_rig_lidar = self.rig.t_rig_lidar;
        let t_world_lidar = capture.t_world_rig(time_s) * t_rig_lidar;
        let (lost, noise): (bool, f64) = (rng.random_bool(lidar.dropout), StandardNormal.sample(rng));
        let origin = to_f32(&t_world_lidar.translation.vector);
        let ray = to_f32(&(t_world_lidar.rotation * direction));
        let hit = capture.scene.cast(origin, ray, lidar.max_range_m as f32, None)?;
        if lost {
            return None;
        }
        let spot = capture.scene.spot(hit, origin, ray);
        let measured = direction * (f64::from(hit.range) + noise * lidar.range_noise_m);
        let in_rig = |point: Vector3<f64>| (t_rig_lidar * Point3::from(point)).coords;
        let truth = in_rig(direction * f64::from(hit.range));
        let target = Target { time_s, measured: in_rig(measured), truth };
        Some(Return {
            point: [measured.x as f32, measured.y as f32, measured.z as f32, spot.intensity()],
            label: u32::from(spot.surface.instance) << 16 | u32::from(spot.surface.class.id()),
            time: time as f32,
            visibility: image::visibility(capture, &self.rig, &target),
        })
    }
}

/// The random generator of one part of one frame.
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion};

    use super::*;
    use crate::carla_classes::Class;
    use crate::sensors::Lidar;
    use geometry::angles::from_angles;
    use geometry::camera::Camera;
    use geometry::shutter::Shutter;

    /// Half the size of the default image, which keeps the tests fast.
    const SIZE: (usize, usize) = (640, 360);

    /// A camera 0.5 m from the LiDAR that looks along an azimuth.
    fn rig(lidar: Lidar, azimuth_deg: f64) -> Rig {
        let k = [[320.0, 0.0, 319.5], [0.0, 320.0, 179.5], [0.0, 0.0, 1.0]];
        let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -azimuth_deg.to_radians());
        let rotation = UnitQuaternion::from_rotation_matrix(&(Rotation3::from_matrix_unchecked(axes) * turn));
        let camera_in_lidar = Vector3::new(0.3, 0.3, -0.27);
        Rig {
            lidar,
            lidar_number: 0,
            t_rig_lidar: Isometry3::identity(),
            camera: Camera::new("plumb_bob", SIZE, k, &[]).expect("a valid camera"),
            t_camera_rig: Isometry3::from_parts((rotation * -camera_in_lidar).into(), rotation),
            shutter: Shutter::default(),
        }
    }

    fn renderer(lidar: Lidar, azimuth_deg: f64) -> Renderer {
        Renderer::new(rig(lidar, azimuth_deg)).expect("a valid rig")
    }

    fn perfect() -> Lidar {
        Lidar { range_noise_m: 0.0, dropout: 0.0, ..Lidar::default() }
    }

    #[test]
    fn every_frame_is_rich_and_parallax_hides_points() {
        let mut hidden_shares = Vec::new();
        for (seed, azimuth) in [(1, 0.0), (2, 70.0), (3, 150.0), (4, 200.0), (5, 290.0)] {
            let renderer = renderer(Lidar::default(), azimuth);
            for number in 0..2 {
                let frame = renderer.frame(seed, number);
                let image = frame.image_labels.iter().copied();
                let points = frame.point_labels.iter().map(|&label| label as u8);
                let classes: BTreeSet<u8> = image.chain(points).collect();
                assert!(classes.len() >= 12, "seed {seed} frame {number}: {classes:?}");
                assert!(frame.num_objects >= 40, "seed {seed} frame {number}");
                let count = |what| frame.point_visibility.iter().filter(|&&v| v == what).count();
                let (hidden, visible) = (count(Visibility::Hidden), count(Visibility::Visible));
                hidden_shares.push(hidden as f64 / (hidden + visible) as f64);
            }
        }
        hidden_shares.sort_by(f64::total_cmp);
        let median = hidden_shares[hidden_shares.len() / 2];
        assert!(median >= 0.03, "{hidden_shares:?}");
    }

    #[test]
    fn the_road_lies_beneath_the_rig_at_its_mounting_height() {
        let down = Lidar { channels: 1, columns: 1, fov_up_deg: -90.0, fov_down_deg: -90.0, ..perfect() };
        let renderer = renderer(down, 0.0);
        for number in 0..10 {
            let frame = renderer.frame(1, number);
            let label = (frame.point_labels[0] & 0xffff) as u8;
            assert!([Class::Road.id(), Class::RoadLine.id()].contains(&label));
            // An inclination of 2 degrees, and roughness between the grid lines, change it by some millimetres.
            assert!((-1.92..-1.68).contains(&frame.points[0][2]), "{:?}", frame.points[0]);
        }
    }

    /// Distance of the nearest object above the ground that the LiDAR's rays hit from anywhere on its path.
    fn clearance(capture: &Capture) -> f32 {
        let [from, to] = capture.motion.ends_s;
        let mut nearest = f32::MAX;
        for step in 0..=4 {
            let t = capture.t_world_rig(from + (to - from) * f64::from(step) / 4.0);
            for i in 0..360 {
                for elevation in [-25f64, 0.0, 25.0] {
                    let ray = to_f32(&from_angles(f64::from(i).to_radians(), elevation.to_radians()));
                    let hit = capture.scene.cast(to_f32(&t.translation.vector), ray, 50.0, None);
                    nearest = hit.map_or(nearest, |hit| nearest.min(hit.range));
                }
            }
        }
        nearest
    }

    #[test]
    fn nothing_stands_in_the_way() {
        for seed in 0..24 {
            let delay_s = [0.0, 0.2, -0.2][seed as usize % 3];
            let shutter = Shutter { delay_s, readout_s: 0.1, ..Shutter::default() };
            let twist = Vector6::new(20.0, 0.0, 0.0, 0.0, 0.0, if seed % 2 == 0 { 0.4 } else { -0.4 });
            let motion = RigMotion::new(twist, &Rig { shutter, ..rig(Lidar::default(), 0.0) });
            let motion = motion.expect("a possible twist");
            let clear_m = clearance(&layout::build(ChaCha8Rng::seed_from_u64(seed), 0.0, motion));
            // The camera may be 1.5 m from the LiDAR.
            assert!(clear_m > 2.0, "seed {seed}: {clear_m} m");
        }
    }

    #[test]
    fn a_camera_beyond_the_free_zone_is_refused() {
        let mut far = rig(Lidar::default(), 0.0);
        far.t_camera_rig.translation.vector.x = 3.0;
        assert!(Renderer::new(far).is_err());
        assert!(Renderer::new(rig(Lidar { columns: 0, ..Lidar::default() }, 0.0)).is_err());
    }
}
