//! What a surface looks like to a camera and to a laser.

use parry3d::math::Vec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::classes::Class;

/// Reflectances of objects of one class differ by up to this much from the class's mean: as much as classes differ.
const REFLECTANCE_SPREAD: f32 = 0.25;
/// Brightness of objects of one class differs by up to this factor, up or down.
const BRIGHTNESS_SPREAD: f32 = 0.3;
/// Each colour channel differs by up to this factor on top.
const HUE_SPREAD: f32 = 0.06;

/// A pattern on a surface, on top of grain.
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
    /// Of the laser's infrared, on average over the surface.
    pub reflectance: f32,
    pub texture: Texture,
}

impl Surface {
    /// A material as the class may have it.
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
