//! What the sensors measure at a hit: a colour for the camera, an intensity for the LiDAR.

use parry3d::math::{Vec2, Vec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::noise;
use super::surface::{Surface, Texture};

/// Grains per metre of the finest texture, and its contrast.
const GRAIN: f32 = 45.0;
const GRAIN_CONTRAST: f32 = 0.06;
const PATCH_CONTRAST: f32 = 0.22;
/// Metres across of stains and wear that one of the sensors sees and the other does not, and their contrast.
const STAIN_SIZE: f32 = 0.7;
const STAIN_CONTRAST: f32 = 0.2;
const COURSE_HEIGHT: f32 = 0.3;
const COURSE_LENGTH: f32 = 0.6;
const GLASS: Vec3 = Vec3::new(0.1, 0.13, 0.17);
const GLASS_REFLECTANCE: f32 = 0.25;
/// The share of a facade's pitch and floor that a window spans.
const WINDOW: [std::ops::Range<f32>; 2] = [0.28..0.72, 0.3..0.78];
/// The part of the intensity that does not fall with the angle of incidence.
const DIFFUSE_FLOOR: f32 = 0.35;
/// Intensity falls by 1/e over this range.
const ATTENUATION_RANGE: f32 = 160.0;
/// Haze takes over by 1 - 1/e at this range.
const HAZE_RANGE: f32 = 260.0;
const HORIZON: Vec3 = Vec3::new(0.76, 0.82, 0.88);
const ZENITH: Vec3 = Vec3::new(0.3, 0.5, 0.8);
/// Light from the sky on upright faces, and how much more on level ones.
const SKY_LIGHT: [f32; 2] = [0.42, 0.13];

/// The sun and the exposure of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    pub sun: Vec3,
    sun_strength: f32,
    exposure: f32,
}

impl Light {
    pub fn random(rng: &mut ChaCha8Rng) -> Self {
        let azimuth = Vec2::from_angle(rng.random_range(0.0..std::f32::consts::TAU));
        let elevation = rng.random_range(0.4..1.2f32);
        Self {
            sun: (azimuth * elevation.cos()).extend(elevation.sin()),
            sun_strength: rng.random_range(0.2..0.9),
            exposure: rng.random_range(0.7..1.1),
        }
    }

    /// Whether the sun is on the outer side of a surface.
    pub fn faces_sun(&self, normal: Vec3) -> bool {
        normal.dot(self.sun) > 0.0
    }

    /// The colour of a spot in the sun or in shadow.
    pub fn color(&self, spot: &Spot, sunlit: bool) -> [u8; 3] {
        let sky = SKY_LIGHT[0] + SKY_LIGHT[1] * spot.normal.z;
        let sun = if sunlit { self.sun_strength * spot.normal.dot(self.sun) } else { 0.0 };
        let haze = 1.0 - (-spot.range / HAZE_RANGE).exp();
        let radiance = spot.textured().0 * (sky + sun);
        self.expose(radiance.lerp(sky_color(spot.direction), haze))
    }

    /// The colour of the sky in a unit direction.
    pub fn sky(&self, direction: Vec3) -> [u8; 3] {
        self.expose(sky_color(direction))
    }

    fn expose(&self, radiance: Vec3) -> [u8; 3] {
        let bright = (radiance * self.exposure).clamp(Vec3::ZERO, Vec3::ONE);
        // A display's gamma, rounded to 2.
        bright.to_array().map(|x| (x.sqrt() * 255.0).round() as u8)
    }
}

fn sky_color(direction: Vec3) -> Vec3 {
    HORIZON.lerp(ZENITH, direction.z.clamp(0.0, 1.0).sqrt())
}

/// A point of a surface that a sensor sees, along a unit direction over a range in metres.
pub struct Spot<'a> {
    pub surface: &'a Surface,
    pub point: Vec3,
    pub normal: Vec3,
    pub direction: Vec3,
    pub range: f32,
}

impl Spot<'_> {
    /// The LiDAR's intensity in [0, 1].
    pub fn intensity(&self) -> f32 {
        let facing = DIFFUSE_FLOOR + (1.0 - DIFFUSE_FLOOR) * self.normal.dot(self.direction).abs();
        (self.textured().1 * facing * (-self.range / ATTENUATION_RANGE).exp()).clamp(0.0, 1.0)
    }

    /// Albedo and reflectance: the surface's own, under the texture that both have, and stains and grain of each alone.
    fn textured(&self) -> (Vec3, f32) {
        let &Self { surface, point, normal, .. } = self;
        let own = |sensor: u32| {
            let seed = 2 * u32::from(surface.instance) + sensor;
            let stains = STAIN_CONTRAST * noise::smooth(on_face(point, normal) / STAIN_SIZE, seed);
            (1.0 + GRAIN_CONTRAST * noise::blocky(point * GRAIN, seed)) * (1.0 + stains)
        };
        let (seen, reflected) = (own(0), own(1));
        let pattern = match surface.texture {
            Texture::Plain => 1.0,
            Texture::Patches { size } => 1.0 + PATCH_CONTRAST * noise::smooth(point.truncate() / size, 0),
            Texture::Courses => courses(point, normal),
            Texture::Facade { pitch, floor } if is_window(point, normal, pitch, floor) => {
                return (GLASS * seen, GLASS_REFLECTANCE * surface.reflectance * reflected);
            }
            Texture::Facade { .. } => 1.0,
        };
        (surface.albedo * seen * pattern, surface.reflectance * reflected * pattern)
    }
}

/// Coordinates on a face: along it and up a wall, or along both axes of level ground.
fn on_face(point: Vec3, normal: Vec3) -> Vec2 {
    if normal.z.abs() > 0.7 {
        return point.truncate();
    }
    let along = normal.truncate().normalize_or(Vec2::X).perp();
    Vec2::new(along.dot(point.truncate()), point.z)
}

/// Every stone its own shade.
fn courses(point: Vec3, normal: Vec3) -> f32 {
    let p = on_face(point, normal);
    let course = (p.y / COURSE_HEIGHT).floor();
    let stone = Vec3::new(p.x / COURSE_LENGTH + 0.5 * course, course + 0.5, 0.5);
    1.0 + 0.12 * noise::blocky(stone, 7)
}

fn is_window(point: Vec3, normal: Vec3, pitch: f32, floor: f32) -> bool {
    let p = on_face(point, normal);
    let within = |x: f32, span: &std::ops::Range<f32>| span.contains(&(x - x.floor()));
    normal.z.abs() < 0.5 && within(p.x / pitch, &WINDOW[0]) && within(p.y / floor, &WINDOW[1])
}
