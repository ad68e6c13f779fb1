//! Trees, hedges and bushes: clouds of leaf triangles that let light through in places.

use std::f32::consts::PI;

use parry3d::math::{Vec2, Vec3};
use rand::RngExt;
use rand_distr::{Distribution, UnitBall, UnitSphere};

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint, Place};

/// Colour of leaves deep within a hedge.
const SHADE: [f32; 3] = [0.07, 0.13, 0.04];
const BARK: [f32; 3] = [0.27, 0.2, 0.14];

/// Angle that a tuft of leaves spans as seen from the rig, within limits in metres.
const LEAF_ANGLE: f32 = 0.022;
const LEAF_SIZES: [f32; 2] = [0.22, 0.8];

/// Distribution of a plant's leaves over an ellipsoid.
#[derive(Clone, Copy)]
struct Foliage {
    /// Metres from a leaf's centre to its corners.
    leaf: f32,
    /// Leaf area per area of the ellipsoid.
    density: f32,
}

/// A tree of the given height, whose crown starts above people's heads.
pub fn tree(b: &mut MeshBuilder, place: &Place, height: f32) {
    b.begin_object();
    let bark = b.paint_as(Class::Vegetation, BARK);
    let leaf_paints = [b.paint(Class::Vegetation), b.paint(Class::Vegetation)];
    let girth = 0.012 * height + b.rng.random_range(0.06..0.14);
    let clear = b.rng.random_range(0.28..0.4) * height;
    let lean = Vec2::new(b.rng.random_range(-0.3..0.3), b.rng.random_range(-0.3..0.3));
    let fork = place.at(lean.x, lean.y, clear);
    b.tube(bark, [place.at(0.0, 0.0, -0.2), fork], [girth, 0.75 * girth], 7);
    let spread = b.rng.random_range(0.2..0.3) * height;
    let foliage = Foliage::seen_from_rig(b, place, 0.6);
    let clumps = b.rng.random_range(4..7);
    for i in 0..clumps {
        let around = Vec2::from_angle(2.4 * i as f32) * spread * b.rng.random_range(0.3..0.8);
        let up = clear + (height - clear) * b.rng.random_range(0.25..0.8);
        let center = fork + around.extend(up - clear);
        b.tube(bark, [fork - Vec3::Z * 0.3, center], [0.5 * girth, 0.2 * girth], 4);
        let size = spread * b.rng.random_range(0.55..0.85);
        let radii = Vec3::new(size, size, 0.8 * size);
        foliage.scatter(b, leaf_paints[i % 2], center, radii);
    }
}

/// A conifer: tiers of drooping leaves.
pub fn conifer(b: &mut MeshBuilder, place: &Place, height: f32) {
    b.begin_object();
    let bark = b.paint_as(Class::Vegetation, BARK);
    let needles = b.paint(Class::Vegetation);
    b.tube(bark, [place.at(0.0, 0.0, -0.2), place.at(0.0, 0.0, height)], [0.02 * height, 0.02], 6);
    let foliage = Foliage::seen_from_rig(b, place, 0.8);
    let tiers = 7;
    for i in 0..tiers {
        let share = i as f32 / tiers as f32;
        let radius = 0.22 * height * (1.0 - share) + 0.25;
        let center = place.at(0.0, 0.0, height * (0.16 + 0.82 * share));
        foliage.scatter(b, needles, center, Vec3::new(radius, radius, 0.08 * height));
    }
}

/// A bush about a metre across.
pub fn bush(b: &mut MeshBuilder, place: &Place, radius: f32) {
    b.begin_object();
    let paint = b.paint(Class::Vegetation);
    let foliage = Foliage { ..Foliage::seen_from_rig(b, place, 0.8) };
    for _ in 0..3 {
        let x = b.rng.random_range(-0.5..0.5) * radius;
        let y = b.rng.random_range(-0.5..0.5) * radius;
        let size = radius * b.rng.random_range(0.6..0.9);
        foliage.scatter(b, paint, place.at(x, y, 0.6 * size), Vec3::splat(size));
    }
}

/// A hedge along local x: a dense core in a ragged coat.
pub fn hedge(b: &mut MeshBuilder, place: &Place, length: f32, height: f32) {
    b.begin_object();
    let coat = b.paint(Class::Vegetation);
    let heart = b.paint_as(Class::Vegetation, SHADE);
    let half = b.rng.random_range(0.25..0.45);
    b.cuboid(heart, place, [0.1, -0.6 * half, -0.2], [length - 0.1, 0.6 * half, 0.88 * height]);
    let size = Foliage::seen_from_rig(b, place, 1.0).leaf.min(0.3);
    let leaves = (1.6 * length * (height + half) / (size * size)) as usize;
    for _ in 0..leaves {
        let x = b.rng.random_range(0.0..length);
        let z = b.rng.random_range(0.05..height);
        let y = half * b.rng.random_range(0.5..1.0) * if b.rng.random() { 1.0 } else { -1.0 };
        let top = b.rng.random_bool(0.3);
        let (y, z) = if top { (b.rng.random_range(-half..half), 0.94 * height) } else { (y, z) };
        leaf(b, coat, place.at(x, y, z), size);
    }
}

impl Foliage {
    fn seen_from_rig(b: &MeshBuilder, place: &Place, density: f32) -> Self {
        let [smallest, largest] = LEAF_SIZES;
        Self { leaf: (LEAF_ANGLE * b.distance(place)).clamp(smallest, largest), density }
    }

    /// Number of leaves that cover an ellipsoid. The area of a random leaf is about half its size squared.
    fn count(self, radii: Vec3) -> usize {
        let area = 4.0 * PI * radii.x * radii.z;
        (self.density * area / (0.5 * self.leaf * self.leaf)) as usize + 12
    }

    /// Scatters leaves near the surface of an ellipsoid, and some inside.
    fn scatter(self, b: &mut MeshBuilder, paint: Paint, center: Vec3, radii: Vec3) {
        for i in 0..self.count(radii) {
            let spot: [f32; 3] =
                if i % 3 == 0 { UnitBall.sample(&mut b.rng) } else { UnitSphere.sample(&mut b.rng) };
            let ragged = b.rng.random_range(0.75..1.1);
            leaf(b, paint, center + radii * Vec3::from(spot) * ragged, self.leaf);
        }
    }
}

/// A triangle of random size and direction, which represents a tuft of leaves.
fn leaf(b: &mut MeshBuilder, paint: Paint, center: Vec3, size: f32) {
    let mut corner = || {
        let spot: [f32; 3] = UnitSphere.sample(&mut b.rng);
        center + Vec3::from(spot) * size * b.rng.random_range(0.7..1.3)
    };
    let corners = [corner(), corner(), corner()];
    b.triangle(paint, corners[0], corners[1], corners[2]);
}
