//! Bicycles and motorcycles, with and without riders. Local x points forward.

use rand::RngExt;

use super::classes::Class;
use super::mesh::{Builder, Place};
use super::people;

const RUBBER: [f32; 3] = [0.06, 0.06, 0.06];
const TUBE_SIDES: usize = 4;

/// A bicycle: hoops and tubes, see-through between them.
pub fn bicycle(b: &mut Builder, place: &Place) {
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
pub fn motorcycle(b: &mut Builder, place: &Place) {
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
pub fn ridden_bicycle(b: &mut Builder, place: &Place) {
    bicycle(b, place);
    people::rider(b, place, 0.92, 0.3);
}

/// A motorcycle being ridden.
pub fn ridden_motorcycle(b: &mut Builder, place: &Place) {
    motorcycle(b, place);
    people::rider(b, place, 0.84, 0.36);
}
