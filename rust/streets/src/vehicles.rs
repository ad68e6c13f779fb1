//! Cars, lorries and buses. Local x points forward; the origin is the middle of the footprint.

use parry3d::math::Vec3;
use rand::RngExt;

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint, Place};

const GLASS: [f32; 3] = [0.06, 0.08, 0.1];
const RUBBER: [f32; 3] = [0.05, 0.05, 0.05];
const HEADLIGHT: [f32; 3] = [0.85, 0.85, 0.8];
const TAILLIGHT: [f32; 3] = [0.55, 0.05, 0.05];
const WHEEL_SIDES: usize = 10;

/// Proportions of a passenger car: (x, z) outlines as fractions of its length and height, from rear to front.
struct Shape {
    length: f32,
    width: f32,
    height: f32,
    /// The top edge of the lower body.
    waist: f32,
    /// Rear and front end of the foot of the glass, then rear and front end of the roof.
    cabin: [f32; 4],
}

/// Index of the van in [`SHAPES`].
const VAN: usize = 4;
const SHAPES: [Shape; 5] = [
    // Hatchback, saloon, estate, off-roader, van.
    Shape { length: 4.0, width: 1.74, height: 1.48, waist: 0.6, cabin: [0.02, 0.74, 0.1, 0.56] },
    Shape { length: 4.7, width: 1.8, height: 1.45, waist: 0.6, cabin: [0.14, 0.74, 0.27, 0.57] },
    Shape { length: 4.7, width: 1.82, height: 1.5, waist: 0.6, cabin: [0.01, 0.74, 0.07, 0.57] },
    Shape { length: 4.6, width: 1.9, height: 1.75, waist: 0.58, cabin: [0.01, 0.78, 0.05, 0.62] },
    Shape { length: 5.3, width: 1.98, height: 2.1, waist: 0.5, cabin: [0.0, 0.93, 0.01, 0.78] },
];

/// A parked or moving passenger car, lower than the rig's sensors.
pub fn car(b: &mut MeshBuilder, place: &Place) {
    let shape = b.rng.random_range(0..VAN);
    car_of_shape(b, place, &SHAPES[shape]);
}

pub fn van(b: &mut MeshBuilder, place: &Place) {
    car_of_shape(b, place, &SHAPES[VAN]);
}

fn car_of_shape(b: &mut MeshBuilder, place: &Place, shape: &Shape) {
    b.begin_object();
    let scale = b.rng.random_range(0.95..1.06);
    let [length, width, height] = [shape.length * scale, shape.width * scale, shape.height * scale];
    let half = 0.5 * width;
    let body = b.paint(Class::Car);
    let glass = b.paint_as(Class::Car, GLASS);
    let x = |share: f32| (share - 0.5) * length;
    let (sill, waist) = (0.2, shape.waist * height);
    let hull = [
        (x(0.01), sill),
        (x(0.98), sill),
        (x(1.0), 0.55 * waist),
        (x(0.97), 0.82 * waist),
        (x(shape.cabin[1]), waist),
        (x(0.0), waist),
        (x(0.0), 0.5 * waist),
    ];
    b.extrude(body, place, &hull, -half, half);
    cabin(b, place, [body, glass], &shape.cabin.map(x), [waist, height], half);
    lights(b, place, Class::Car, [x(0.0), x(0.985)], half, 0.72 * waist);
    let wheel = b.paint_as(Class::Car, RUBBER);
    for along in [x(0.19), x(0.81)] {
        wheel_pair(b, wheel, place, along, half, 0.32 * scale);
    }
    for side in [-1.0, 1.0] {
        let mirror = [x(shape.cabin[1]) - 0.35, side * (half + 0.08), waist + 0.05];
        small_box(b, body, place, mirror, [0.06, 0.09, 0.07]);
    }
}

/// The glass cabin of a car: its sides lean in towards the roof, which is painted.
fn cabin(
    b: &mut MeshBuilder,
    place: &Place,
    [body, glass]: [Paint; 2],
    x: &[f32; 4],
    z: [f32; 2],
    half: f32,
) {
    const LEAN: f32 = 0.16;
    let foot = half - 0.03;
    let roof = half - LEAN;
    let lower = [(x[0], -foot), (x[1], -foot), (x[1], foot), (x[0], foot)].map(|(x, y)| place.at(x, y, z[0]));
    let upper = [(x[2], -roof), (x[3], -roof), (x[3], roof), (x[2], roof)].map(|(x, y)| place.at(x, y, z[1]));
    b.loft(glass, &lower, &upper);
    b.polygon(body, &upper);
    let pillar = 0.05;
    let middle = 0.5 * (x[2] + x[3]);
    for (foot_x, roof_x) in [(x[0], x[2]), (middle, middle), (x[1], x[3])] {
        for side in [-1.0, 1.0] {
            let (y0, y1) = (side * (foot + 0.01), side * (roof + 0.01));
            b.quad(
                body,
                [
                    place.at(foot_x - pillar, y0, z[0]),
                    place.at(foot_x + pillar, y0, z[0]),
                    place.at(roof_x + pillar, y1, z[1]),
                    place.at(roof_x - pillar, y1, z[1]),
                ],
            );
        }
    }
}

fn lights(b: &mut MeshBuilder, place: &Place, class: Class, [rear, front]: [f32; 2], half: f32, z: f32) {
    let white = b.paint_as(class, HEADLIGHT);
    let red = b.paint_as(class, TAILLIGHT);
    for side in [-0.75, 0.75] {
        small_box(b, white, place, [front, side * half, z], [0.03, 0.15, 0.07]);
        small_box(b, red, place, [rear, side * half, z], [0.02, 0.15, 0.08]);
    }
}

fn small_box(b: &mut MeshBuilder, paint: Paint, place: &Place, center: [f32; 3], half: [f32; 3]) {
    let low = [0, 1, 2].map(|i| center[i] - half[i]);
    let high = [0, 1, 2].map(|i| center[i] + half[i]);
    b.cuboid(paint, place, low, high);
}

fn wheel_pair(b: &mut MeshBuilder, paint: Paint, place: &Place, x: f32, half: f32, radius: f32) {
    for side in [-1.0, 1.0] {
        let ends = [half - 0.2, half + 0.02].map(|y| place.at(x, side * y, radius));
        b.tube(paint, ends, [radius; 2], WHEEL_SIDES);
    }
}

/// A lorry: a cab and a box or an open bed of stakes.
pub fn truck(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let length: f32 = b.rng.random_range(6.5..9.5);
    let (half, top) = (1.2, b.rng.random_range(2.9..3.6));
    let (rear, front) = (-0.5 * length, 0.5 * length);
    let cab = b.paint(Class::Truck);
    let load = b.paint(Class::Truck);
    let glass = b.paint_as(Class::Truck, GLASS);
    let dark = b.paint_as(Class::Truck, RUBBER);
    b.cuboid(dark, place, [rear, -0.45, 0.55], [front - 0.3, 0.45, 0.9]);
    truck_cab(b, place, [cab, glass], front, half);
    if b.rng.random_bool(0.7) {
        b.cuboid(load, place, [rear, -half, 1.0], [front - 2.0, half, top]);
    } else {
        stakes(b, [cab, load], place, [rear, front - 2.0], half);
    }
    lights(b, place, Class::Truck, [rear - 0.02, front], half, 0.8);
    for x in [rear + 0.9, rear + 2.0, front - 1.0] {
        wheel_pair(b, dark, place, x, half - 0.02, 0.48);
    }
}

/// The cab at the front end of a lorry.
fn truck_cab(b: &mut MeshBuilder, place: &Place, [cab, glass]: [Paint; 2], front: f32, half: f32) {
    b.extrude(
        cab,
        place,
        &[(front - 1.8, 0.5), (front, 0.5), (front, 1.5), (front - 0.25, 2.5), (front - 1.8, 2.6)],
        -half + 0.05,
        half - 0.05,
    );
    let screen = [
        (front + 0.01, -1.0, 1.52),
        (front + 0.01, 1.0, 1.52),
        (front - 0.22, 1.0, 2.4),
        (front - 0.22, -1.0, 2.4),
    ];
    b.quad(glass, screen.map(|(x, y, z)| place.at(x + 0.02, y, z)));
    small_box(b, glass, place, [front - 1.0, 0.0, 1.95], [0.45, half - 0.03, 0.35]);
}

/// An open bed with stakes around it and crates on it.
fn stakes(
    b: &mut MeshBuilder,
    [bed, crate_paint]: [Paint; 2],
    place: &Place,
    [rear, front]: [f32; 2],
    half: f32,
) {
    b.cuboid(bed, place, [rear, -half, 0.95], [front, half, 1.15]);
    for i in 0..8 {
        let x = rear + 0.05 + (front - rear - 0.1) * i as f32 / 7.0;
        for side in [-half, half] {
            small_box(b, bed, place, [x, side, 1.6], [0.04, 0.03, 0.5]);
        }
    }
    for z in [1.5, 1.9] {
        for side in [-half, half] {
            small_box(b, bed, place, [0.5 * (rear + front), side, z], [0.5 * (front - rear), 0.02, 0.06]);
        }
    }
    for _ in 0..3 {
        let x = b.rng.random_range(rear + 0.6..front - 0.6);
        let y = b.rng.random_range(-0.5..0.5);
        let tall = b.rng.random_range(0.3..0.7);
        small_box(b, crate_paint, place, [x, y, 1.15 + tall], [0.5, 0.45, tall]);
    }
}

pub fn bus(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let length: f32 = b.rng.random_range(9.5..12.0);
    let (half, top, waist) = (1.25, 3.05, 1.35);
    let (rear, front) = (-0.5 * length, 0.5 * length);
    let body = b.paint(Class::Bus);
    let glass = b.paint_as(Class::Bus, GLASS);
    let dark = b.paint_as(Class::Bus, RUBBER);
    b.cuboid(body, place, [rear, -half, 0.32], [front, half, waist]);
    b.cuboid(glass, place, [rear + 0.05, -half + 0.03, waist], [front - 0.05, half - 0.03, 2.4]);
    b.cuboid(body, place, [rear, -half, 2.4], [front, half, top]);
    b.cuboid(body, place, [rear + 1.0, -0.8, top], [rear + 3.5, 0.8, top + 0.25]);
    let windows = (length / 1.5) as usize;
    for i in 0..=windows {
        let x = rear + 0.06 + (length - 0.12) * i as f32 / windows as f32;
        small_box(b, body, place, [x, 0.0, 0.5 * (waist + 2.4)], [0.06, half, 0.5 * (2.4 - waist)]);
    }
    lights(b, place, Class::Bus, [rear, front], half, 0.7);
    for x in [rear + 2.6, front - 2.4] {
        wheel_pair(b, dark, place, x, half, 0.48);
    }
    for side in [-1.0, 1.0] {
        let arm =
            [(front - 0.1, 1.2, 2.6), (front + 0.3, 1.45, 2.3)].map(|(x, y, z)| place.at(x, side * y, z));
        b.tube(dark, arm, [0.03; 2], 4);
        b.ellipsoid(dark, arm[1], Vec3::new(0.08, 0.12, 0.2));
    }
}
