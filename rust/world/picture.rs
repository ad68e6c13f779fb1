//! The camera's side of a frame: one ray through the centre of each pixel.

use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d::math::Vec3;
use rayon::prelude::*;

use super::classes::{Class, UNLABELED};
use super::layout::Stage;
use super::mesh::GROUND;
use super::scene::to_f32;
use super::sensors::Rig;
use super::shading::Spot;

/// The camera sees no farther.
const FAR_M: f32 = 500.0;
/// Shadow rays start this far off a surface, and nothing farther casts a shadow.
const SHADOW_OFFSET_M: f32 = 0.01;
const SHADOW_REACH_M: f32 = 40.0;

/// What a camera sees in one pixel.
pub struct Pixel {
    pub label: u8,
    pub rgb: [u8; 3],
    pub instance: u16,
}

/// The picture of a rig's camera, whose pixels look along `pixel_rays`, row by row.
pub fn take(stage: &Stage, rig: &Rig, pixel_rays: &[Option<Vector3<f32>>]) -> Vec<Pixel> {
    let size = [rig.camera.width, rig.camera.height];
    let t_lidar_camera = rig.t_camera_lidar.inverse();
    let at = |time_s| View::new(&(stage.t_world_lidar(time_s) * t_lidar_camera));
    let views: Vec<View> = rig.shutter.line_times_s(size).into_iter().map(at).collect();
    let row = |(v, rays): (usize, &[Option<Vector3<f32>>])| -> Vec<Pixel> {
        let mut neighbour = Neighbour::default();
        let mut look = |u: usize, ray: &Vector3<f32>| {
            let view = &views[rig.shutter.line([u, v], size)];
            let ray = view.rotation * ray;
            neighbour.look(stage, view.origin, Vec3::new(ray.x, ray.y, ray.z))
        };
        let pixel = |(u, ray): (usize, &Option<_>)| ray.as_ref().map_or(Pixel::UNREACHED, |ray| look(u, ray));
        rays.iter().enumerate().map(pixel).collect()
    };
    let rows: Vec<_> = pixel_rays.par_chunks(size[0].max(1)).enumerate().map(row).collect();
    rows.into_iter().flatten().collect()
}

/// From where, and which way round, a line of the picture is exposed.
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

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, UnitQuaternion, Vector6};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::mesh::{Builder, Place};
    use super::super::passage::Passage;
    use super::super::scene::Scene;
    use super::super::sensors::Lidar;
    use super::super::shading::Light;
    use super::*;
    use crate::camera::Camera;
    use crate::shutter::{Direction, Shutter};

    const FOCAL: f64 = 100.0;
    const SIZE: [usize; 2] = [160, 120];
    /// Metres to the rear of a post, which is its left edge, and speed to the left.
    const RANGE_M: f32 = 10.0;
    const SPEED_M_S: f64 = 15.0;

    /// The picture of a post that ends at the optical axis, from a rig that slides to its left.
    fn slide_past_a_post(shutter: Shutter) -> Vec<Pixel> {
        let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let k = [[FOCAL, 0.0, 79.5], [0.0, FOCAL, 59.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (SIZE[0], SIZE[1]), k, &[]).expect("a valid camera");
        let t_camera_lidar = Isometry3::from_parts(Vector3::zeros().into(), rotation);
        let rig = Rig { lidar: Lidar::default(), camera, t_camera_lidar, shutter };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let light = Light::random(&mut rng);
        let mut builder = Builder::new(rng, vec![]);
        let paint = builder.paint(Class::Pole);
        let place = Place::new(Vec3::ZERO, 0.0);
        builder.cuboid(paint, &place, [RANGE_M - 1.0, -50.0, -50.0], [RANGE_M, 0.0, 50.0]);
        let twist = Vector6::new(0.0, SPEED_M_S, 0.0, 0.0, 0.0, 0.0);
        let passage = Passage::new(twist, &rig).expect("a possible twist");
        let stage = Stage::new(Scene::new(builder), light, Isometry3::identity(), passage);
        let pixels: Vec<_> = (0..SIZE[0] * SIZE[1])
            .map(|i| nalgebra::Point2::new((i % SIZE[0]) as f64, (i / SIZE[0]) as f64))
            .map(|pixel| rig.camera.unproject(&pixel).map(|ray| ray.cast()))
            .collect();
        take(&stage, &rig, &pixels)
    }

    #[test]
    fn a_post_leans_in_a_rolling_picture() {
        let shutter = |direction| Shutter { delay_s: 0.02, readout_s: 0.1, direction };
        for (direction, first, step) in [(Direction::Down, 0.5, 1.0), (Direction::Up, 119.5, -1.0)] {
            let picture = slide_past_a_post(shutter(direction));
            for v in 0..SIZE[1] {
                let row = &picture[v * SIZE[0]..(v + 1) * SIZE[0]];
                let sky = row.iter().filter(|pixel| pixel.label == Class::Sky.id()).count();
                // The edge moves to the right by f v t / z until its line is exposed.
                let time_s = 0.02 + 0.1 * (first + step * v as f64) / SIZE[1] as f64;
                let edge = 80.0 + FOCAL * SPEED_M_S * time_s / f64::from(RANGE_M);
                assert!((sky as f64 - edge).abs() <= 0.501, "row {v}: {sky} pixels, edge at {edge}");
            }
        }
    }

    #[test]
    fn the_edge_of_a_post_is_met_where_its_column_is_exposed() {
        // To the right, column u is exposed at 0.1 (u + 0.5) / 160 s, when the edge is at 80 + 150 t of 160 columns.
        let shutter = Shutter { delay_s: 0.0, readout_s: 0.1, direction: Direction::Right };
        let picture = slide_past_a_post(shutter);
        let edge = 80.0 / (1.0 - FOCAL * SPEED_M_S * 0.1 / f64::from(RANGE_M) / SIZE[0] as f64);
        for row in picture.chunks(SIZE[0]) {
            let sky = row.iter().filter(|pixel| pixel.label == Class::Sky.id()).count();
            assert!((sky as f64 - edge).abs() <= 0.501, "{sky} pixels, edge at {edge}");
        }
    }
}
