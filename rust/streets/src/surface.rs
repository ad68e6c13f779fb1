//! Surface materials and what the sensors measure of them: a colour for the camera, an intensity for the LiDAR.

use parry3d::math::{Vec2, Vec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::carla_classes::Class;

/// An integer hash with good avalanche (Wellons' `lowbias32`).
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number in [-1, 1] for a cell of the integer grid.
fn lattice_value(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let key = (x as u32).wrapping_mul(0x9e37_79b1)
        ^ (y as u32).wrapping_mul(0x85eb_ca77)
        ^ (z as u32).wrapping_mul(0xc2b2_ae3d)
        ^ seed;
    hash(key) as f32 * (2.0 / u32::MAX as f32) - 1.0
}

/// Noise in [-1, 1], constant in each unit cube.
pub fn cell_noise(p: Vec3, seed: u32) -> f32 {
    let p = p.floor();
    lattice_value(p.x as i32, p.y as i32, p.z as i32, seed)
}

/// Noise in [-1, 1] with features of about one unit, continuously differentiable.
pub fn smooth_noise(p: Vec2, seed: u32) -> f32 {
    let base = p.floor();
    let t = p - base;
    let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
    let (x, y) = (base.x as i32, base.y as i32);
    let row = |y| {
        let (left, right) = (lattice_value(x, y, 0, seed), lattice_value(x + 1, y, 0, seed));
        left + (right - left) * t.x
    };
    let (low, high) = (row(y), row(y + 1));
    low + (high - low) * t.y
}

/// Largest deviation of an object's reflectance from the mean of its class, which is about the spread between
/// classes.
const REFLECTANCE_SPREAD: f32 = 0.25;
/// Spread of brightness among objects of one class, as a factor up or down.
const BRIGHTNESS_SPREAD: f32 = 0.3;
/// Additional spread of each colour channel, as a factor.
const HUE_SPREAD: f32 = 0.06;

/// A pattern on a surface, in addition to grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// Grain alone.
    Plain,
    /// Rows of windows: metres from window to window and from floor to floor.
    Facade { pitch: f32, floor: f32 },
    /// Horizontal courses of stone or brick.
    Courses,
    /// Patches of growth or wear, metres across.
    Patches { size: f32 },
}

/// The material of a part of one object.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    pub class: Class,
    pub instance: u16,
    pub albedo: Vec3,
    /// Mean infrared reflectance of the surface.
    pub reflectance: f32,
    pub texture: Texture,
}

impl Surface {
    /// Draws a material of a class.
    pub fn random(class: Class, instance: u16, rng: &mut ChaCha8Rng) -> Self {
        let (albedo, reflectance, texture) = typical(class, rng);
        let brightness = 1.0 + rng.random_range(-BRIGHTNESS_SPREAD..BRIGHTNESS_SPREAD);
        let mut channel = || brightness * (1.0 + rng.random_range(-HUE_SPREAD..HUE_SPREAD));
        let spread = Vec3::new(channel(), channel(), channel());
        let offset = rng.random_range(-REFLECTANCE_SPREAD..REFLECTANCE_SPREAD);
        Self {
            class,
            instance,
            albedo: (Vec3::from(albedo) * spread).min(Vec3::splat(0.95)),
            reflectance: (reflectance + offset).clamp(0.03, 1.0),
            texture,
        }
    }
}

/// Colour, infrared reflectance and texture of a class.
fn typical(class: Class, rng: &mut ChaCha8Rng) -> ([f32; 3], f32, Texture) {
    match class {
        Class::Road => ([0.24, 0.24, 0.25], 0.25, Texture::Patches { size: 1.5 }),
        Class::RoadLine => ([0.85, 0.85, 0.8], 0.6, Texture::Plain),
        Class::Sidewalk => ([0.5, 0.48, 0.46], 0.4, Texture::Courses),
        Class::Terrain => ([0.3, 0.38, 0.16], 0.5, Texture::Patches { size: 0.8 }),
        Class::Vegetation => ([0.16, 0.32, 0.09], 0.5, Texture::Plain),
        Class::Building => (pick(&FACADES, rng), 0.4, Texture::Plain),
        Class::Wall => ([0.5, 0.42, 0.36], 0.4, Texture::Courses),
        Class::Fence => (pick(&FENCES, rng), 0.35, Texture::Plain),
        Class::Pole => ([0.38, 0.4, 0.41], 0.4, Texture::Plain),
        Class::TrafficLight => ([0.12, 0.13, 0.1], 0.3, Texture::Plain),
        Class::TrafficSign => (pick(&SIGNS, rng), 0.65, Texture::Plain),
        Class::Pedestrian | Class::Rider => (pick(&CLOTHES, rng), 0.4, Texture::Plain),
        Class::Car | Class::Truck | Class::Bus => (pick(&LACQUERS, rng), 0.4, Texture::Plain),
        Class::Motorcycle | Class::Bicycle => (pick(&LACQUERS, rng), 0.35, Texture::Plain),
        Class::Static => (pick(&FURNITURE, rng), 0.4, Texture::Plain),
        Class::Sky => ([0.55, 0.7, 0.9], 0.0, Texture::Plain),
    }
}

fn pick(colours: &[[f32; 3]], rng: &mut ChaCha8Rng) -> [f32; 3] {
    colours[rng.random_range(0..colours.len())]
}

const FACADES: [[f32; 3]; 6] = [
    [0.72, 0.66, 0.55],
    [0.55, 0.28, 0.2],
    [0.75, 0.74, 0.72],
    [0.6, 0.5, 0.38],
    [0.48, 0.5, 0.54],
    [0.78, 0.6, 0.42],
];
const FENCES: [[f32; 3]; 3] = [[0.15, 0.17, 0.16], [0.7, 0.68, 0.62], [0.42, 0.28, 0.16]];
const SIGNS: [[f32; 3]; 4] = [[0.75, 0.1, 0.1], [0.1, 0.25, 0.65], [0.85, 0.85, 0.85], [0.85, 0.7, 0.1]];
const CLOTHES: [[f32; 3]; 7] = [
    [0.15, 0.17, 0.3],
    [0.6, 0.12, 0.12],
    [0.12, 0.12, 0.12],
    [0.75, 0.72, 0.66],
    [0.2, 0.4, 0.28],
    [0.75, 0.55, 0.15],
    [0.35, 0.3, 0.25],
];
const LACQUERS: [[f32; 3]; 7] = [
    [0.75, 0.75, 0.76],
    [0.08, 0.08, 0.09],
    [0.4, 0.41, 0.43],
    [0.5, 0.07, 0.07],
    [0.1, 0.18, 0.42],
    [0.14, 0.28, 0.2],
    [0.7, 0.62, 0.4],
];
const FURNITURE: [[f32; 3]; 5] =
    [[0.4, 0.26, 0.14], [0.2, 0.3, 0.24], [0.55, 0.55, 0.53], [0.65, 0.13, 0.1], [0.3, 0.32, 0.36]];

/// Grains per metre of the finest texture, and its contrast.
const GRAIN: f32 = 45.0;
const GRAIN_CONTRAST: f32 = 0.06;
const PATCH_CONTRAST: f32 = 0.22;
/// Size in metres of stains and wear that only one of the sensors sees, and their contrast.
const STAIN_SIZE: f32 = 0.7;
const STAIN_CONTRAST: f32 = 0.2;
const COURSE_HEIGHT: f32 = 0.3;
const COURSE_LENGTH: f32 = 0.6;
const GLASS: Vec3 = Vec3::new(0.1, 0.13, 0.17);
const GLASS_REFLECTANCE: f32 = 0.25;
/// Fraction of a facade's pitch and floor that a window spans.
const WINDOW: [std::ops::Range<f32>; 2] = [0.28..0.72, 0.3..0.78];
/// The part of the intensity that is independent of the angle of incidence.
const DIFFUSE_FLOOR: f32 = 0.35;
/// Range over which intensity falls by a factor of e.
const ATTENUATION_RANGE: f32 = 160.0;
/// Range at which haze contributes 1 - 1/e of the colour.
const HAZE_RANGE: f32 = 260.0;
const HORIZON: Vec3 = Vec3::new(0.76, 0.82, 0.88);
const ZENITH: Vec3 = Vec3::new(0.3, 0.5, 0.8);
/// Skylight on vertical faces, and the additional skylight on horizontal ones.
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

    /// The colour of a spot in sun or shadow.
    pub fn color(&self, spot: &Spot, sunlit: bool) -> [u8; 3] {
        let sky = SKY_LIGHT[0] + SKY_LIGHT[1] * spot.normal.z;
        let sun = if sunlit { self.sun_strength * spot.normal.dot(self.sun) } else { 0.0 };
        let haze = 1.0 - (-spot.range / HAZE_RANGE).exp();
        let radiance = spot.textured().0 * (sky + sun);
        self.expose(radiance.lerp(sky_color(spot.direction), haze))
    }

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

/// A surface point that a sensor sees, along a unit direction, at a range in metres.
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

    /// Albedo and reflectance: those of the surface, with the texture common to both, and the stains and grain of
    /// each.
    fn textured(&self) -> (Vec3, f32) {
        let &Self { surface, point, normal, .. } = self;
        let own = |sensor: u32| {
            let seed = 2 * u32::from(surface.instance) + sensor;
            let stains = STAIN_CONTRAST * smooth_noise(on_face(point, normal) / STAIN_SIZE, seed);
            (1.0 + GRAIN_CONTRAST * cell_noise(point * GRAIN, seed)) * (1.0 + stains)
        };
        let (seen, reflected) = (own(0), own(1));
        let pattern = match surface.texture {
            Texture::Plain => 1.0,
            Texture::Patches { size } => 1.0 + PATCH_CONTRAST * smooth_noise(point.truncate() / size, 0),
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

/// A shade for each stone.
fn courses(point: Vec3, normal: Vec3) -> f32 {
    let p = on_face(point, normal);
    let course = (p.y / COURSE_HEIGHT).floor();
    let stone = Vec3::new(p.x / COURSE_LENGTH + 0.5 * course, course + 0.5, 0.5);
    1.0 + 0.12 * cell_noise(stone, 7)
}

fn is_window(point: Vec3, normal: Vec3, pitch: f32, floor: f32) -> bool {
    let p = on_face(point, normal);
    let within = |x: f32, span: &std::ops::Range<f32>| span.contains(&(x - x.floor()));
    normal.z.abs() < 0.5 && within(p.x / pitch, &WINDOW[0]) && within(p.y / floor, &WINDOW[1])
}
