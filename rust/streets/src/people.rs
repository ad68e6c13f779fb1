//! Pedestrians, and bicycles and motorcycles with their riders. Local x points forward.

use parry3d::math::Vec3;
use rand::RngExt;

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint, Place};

const SKINS: [[f32; 3]; 4] = [[0.75, 0.55, 0.45], [0.55, 0.38, 0.28], [0.35, 0.23, 0.16], [0.8, 0.62, 0.5]];
const HAIR: [f32; 3] = [0.12, 0.08, 0.05];
const LIMB_SIDES: usize = 5;

struct Clothes {
    top: Paint,
    bottom: Paint,
    skin: Paint,
    hair: Paint,
}

impl Clothes {
    fn random(b: &mut MeshBuilder, class: Class) -> Self {
        let skin = SKINS[b.rng.random_range(0..SKINS.len())];
        Self {
            top: b.paint(class),
            bottom: b.paint(class),
            skin: b.paint_as(class, skin),
            hair: b.paint_as(class, HAIR),
        }
    }
}

/// A pedestrian, standing or in mid-stride.
pub fn pedestrian(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let clothes = Clothes::random(b, Class::Pedestrian);
    let size = if b.rng.random_bool(0.15) { 0.65 } else { b.rng.random_range(0.92..1.06) };
    let stride = b.rng.random_range(0.0..0.32);
    let at = |x: f32, y: f32, z: f32| place.at(x * size, y * size, z * size);
    for (side, step) in [(-1.0, stride), (1.0, -stride)] {
        let hip = at(0.0, side * 0.1, 0.92);
        let knee = at(0.5 * step + 0.05, side * 0.1, 0.5);
        let foot = at(step, side * 0.1, 0.04);
        limb(b, clothes.bottom, [hip, knee, foot], [0.095, 0.075, 0.055].map(|r| r * size));
        b.tube(
            clothes.hair,
            [at(step - 0.08, side * 0.1, 0.04), at(step + 0.18, side * 0.1, 0.04)],
            [0.05 * size; 2],
            4,
        );
        let shoulder = at(0.0, side * 0.21, 1.42);
        let elbow = at(-0.5 * step, side * 0.27, 1.14);
        let hand = at(-0.9 * step + 0.1, side * 0.26, 0.88);
        limb(b, clothes.top, [shoulder, elbow, hand], [0.06, 0.05, 0.04].map(|r| r * size));
        b.ellipsoid(clothes.skin, hand, Vec3::splat(0.05 * size));
    }
    torso(b, &clothes, at(0.0, 0.0, 0.88), at(0.0, 0.0, 1.45), size);
    head(b, &clothes, at(0.02, 0.0, 1.64), size);
    match b.rng.random_range(0..4) {
        0 => backpack(b, place, size),
        1 => shopping_bag(b, at(0.05, -0.3, 0.6), size),
        _ => {}
    }
}

/// A person astride a two-wheeler with saddle and handlebar grips at the given height and distance.
pub fn rider(b: &mut MeshBuilder, place: &Place, saddle: f32, grips: f32) {
    b.begin_object();
    let clothes = Clothes::random(b, Class::Rider);
    let at = |x: f32, y: f32, z: f32| place.at(x, y, z);
    let hip = saddle + 0.08;
    for side in [-1.0, 1.0] {
        let leg = [
            at(-0.22, side * 0.1, hip),
            at(0.16, side * 0.15, hip - 0.22),
            at(-0.05, side * 0.14, hip - 0.64),
        ];
        limb(b, clothes.bottom, leg, [0.1, 0.08, 0.06]);
        let arm = [
            at(0.02, side * 0.2, hip + 0.5),
            at(0.1, side * 0.27, hip + 0.27),
            at(grips, side * 0.27, hip + 0.1),
        ];
        limb(b, clothes.top, arm, [0.06, 0.05, 0.04]);
    }
    torso(b, &clothes, at(-0.24, 0.0, hip - 0.04), at(0.02, 0.0, hip + 0.53), 1.0);
    head(b, &clothes, at(0.1, 0.0, hip + 0.72), 1.0);
    let helmet = b.paint(Class::Rider);
    b.ellipsoid(helmet, at(0.09, 0.0, hip + 0.77), Vec3::new(0.14, 0.14, 0.12));
}

fn limb(b: &mut MeshBuilder, paint: Paint, joints: [Vec3; 3], radii: [f32; 3]) {
    for i in 0..2 {
        b.tube(paint, [joints[i], joints[i + 1]], [radii[i], radii[i + 1]], LIMB_SIDES);
    }
}

fn torso(b: &mut MeshBuilder, clothes: &Clothes, hips: Vec3, shoulders: Vec3, size: f32) {
    let waist = hips.lerp(shoulders, 0.35);
    b.tube(clothes.bottom, [hips, waist], [0.17 * size, 0.15 * size], 7);
    b.tube(clothes.top, [waist, shoulders], [0.155 * size, 0.2 * size], 7);
}

fn head(b: &mut MeshBuilder, clothes: &Clothes, center: Vec3, size: f32) {
    b.tube(clothes.skin, [center - Vec3::Z * 0.22 * size, center], [0.055 * size; 2], LIMB_SIDES);
    b.ellipsoid(clothes.skin, center, Vec3::new(0.1, 0.09, 0.13) * size);
    b.ellipsoid(clothes.hair, center + Vec3::Z * 0.04 * size, Vec3::new(0.105, 0.1, 0.11) * size);
}

fn backpack(b: &mut MeshBuilder, place: &Place, size: f32) {
    let paint = b.paint(Class::Pedestrian);
    let [low, high] = [[-0.36, -0.15, 1.0], [-0.14, 0.15, 1.42]].map(|corner| corner.map(|x: f32| x * size));
    b.cuboid(paint, place, low, high);
}

fn shopping_bag(b: &mut MeshBuilder, center: Vec3, size: f32) {
    let paint = b.paint(Class::Pedestrian);
    b.ellipsoid(paint, center, Vec3::new(0.17, 0.1, 0.2) * size);
}

const RUBBER: [f32; 3] = [0.06, 0.06, 0.06];
const TUBE_SIDES: usize = 4;

/// A bicycle: hoops and tubes, see-through between them.
pub fn bicycle(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let frame = b.paint(Class::Bicycle);
    let dark = b.paint_as(Class::Bicycle, RUBBER);
    let radius = b.rng.random_range(0.31..0.36);
    let (rear, front) = (-0.52, 0.54);
    for x in [rear, front] {
        for y in [-0.015, 0.015] {
            b.hoop(dark, place, [x, y, radius], [radius - 0.05, radius]);
        }
    }
    let (crank, seat, head) = ([-0.08, 0.0, 0.3], [-0.24, 0.0, 0.88], [0.36, 0.0, 0.85]);
    let tubes = [
        ([rear, 0.0, radius], crank),
        ([rear, 0.0, radius], [-0.2, 0.0, 0.75]),
        (crank, seat),
        (crank, head),
        ([-0.2, 0.0, 0.75], head),
        (head, [front, 0.0, radius]),
        (head, [0.32, 0.0, 1.02]),
        ([0.3, -0.29, 1.02], [0.3, 0.29, 1.02]),
    ];
    for (from, to) in tubes {
        let ends = [from, to].map(|[x, y, z]| place.at(x, y, z));
        b.tube(frame, ends, [0.022; 2], TUBE_SIDES);
    }
    b.cuboid(dark, place, [-0.38, -0.07, 0.88], [-0.12, 0.07, 0.94]);
    b.cuboid(dark, place, [-0.12, -0.04, 0.24], [0.04, 0.04, 0.36]);
}

/// A motorcycle or a scooter.
pub fn motorcycle(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let body = b.paint(Class::Motorcycle);
    let dark = b.paint_as(Class::Motorcycle, RUBBER);
    for x in [-0.68, 0.7] {
        let ends = [-0.07, 0.07].map(|y| place.at(x, y, 0.31));
        b.tube(dark, ends, [0.31; 2], 10);
    }
    b.extrude(body, place, &[(-0.35, 0.3), (0.3, 0.28), (0.42, 0.62), (-0.4, 0.68)], -0.16, 0.16);
    b.extrude(body, place, &[(-0.05, 0.66), (0.4, 0.62), (0.34, 0.92), (0.05, 0.95)], -0.17, 0.17);
    b.extrude(dark, place, &[(-0.85, 0.76), (0.0, 0.68), (0.0, 0.8), (-0.85, 0.88)], -0.14, 0.14);
    for y in [-0.1, 0.1] {
        b.tube(dark, [place.at(0.7, y, 0.31), place.at(0.4, y, 1.0)], [0.035; 2], TUBE_SIDES);
    }
    b.tube(dark, [place.at(0.36, -0.38, 1.05), place.at(0.36, 0.38, 1.05)], [0.025; 2], TUBE_SIDES);
    b.tube(dark, [place.at(-0.9, -0.2, 0.36), place.at(0.0, -0.2, 0.3)], [0.05; 2], 6);
    if b.rng.random_bool(0.5) {
        b.cuboid(body, place, [-1.05, -0.2, 0.88], [-0.7, 0.2, 1.2]);
        b.quad(
            dark,
            [(0.45, -0.2, 0.95), (0.45, 0.2, 0.95), (0.3, 0.17, 1.35), (0.3, -0.17, 1.35)]
                .map(|(x, y, z)| place.at(x, y, z)),
        );
    }
}

/// A bicycle being ridden.
pub fn ridden_bicycle(b: &mut MeshBuilder, place: &Place) {
    bicycle(b, place);
    rider(b, place, 0.92, 0.3);
}

/// A motorcycle being ridden.
pub fn ridden_motorcycle(b: &mut MeshBuilder, place: &Place) {
    motorcycle(b, place);
    rider(b, place, 0.84, 0.36);
}
