//! Fences, railings and walls, along local x.

use rand::RngExt;

use super::classes::Class;
use super::furniture::{ROOT, post};
use super::mesh::{Builder, Place};

/// A fence along local x, see-through between its pickets or rails.
pub fn fence(b: &mut Builder, place: &Place, length: f32) {
    b.begin_object();
    let paint = b.paint(Class::Fence);
    let height = b.rng.random_range(0.9..1.6);
    let pitch = [0.16, 0.2, 0.28][b.rng.random_range(0..3)];
    let picket = pitch * b.rng.random_range(0.25..0.55);
    let mut x = 0.0;
    while x < length {
        b.cuboid(paint, place, [x, -0.05, ROOT], [x + 0.09, 0.05, height + 0.06]);
        x += 2.2;
    }
    for z in [0.22 * height, 0.82 * height] {
        b.cuboid(paint, place, [0.0, -0.025, z], [length, 0.025, z + 0.06]);
    }
    let mut x = 0.1;
    while x < length {
        let corners = [(x, 0.08), (x + picket, 0.08), (x + picket, height), (x, height)];
        b.quad(paint, corners.map(|(x, z)| place.at(x, 0.03, z)));
        x += pitch;
    }
}

/// A metal railing along local x: posts and three rails.
pub fn railing(b: &mut Builder, place: &Place, length: f32) {
    b.begin_object();
    let paint = b.paint(Class::Fence);
    let mut x = 0.0;
    while x < length {
        post(b, paint, &place.shifted(x, 0.0, 0.0, 0.0), 1.1, 0.03);
        x += 1.5;
    }
    for z in [0.35, 0.7, 1.07] {
        b.tube(paint, [place.at(0.0, 0.0, z), place.at(length, 0.0, z)], [0.025; 2], 4);
    }
}

/// A wall along local x with piers and a coping.
pub fn wall(b: &mut Builder, place: &Place, length: f32, height: f32) {
    b.begin_object();
    let paint = b.paint(Class::Wall);
    let coping = b.paint(Class::Wall);
    b.cuboid(paint, place, [0.0, -0.12, ROOT], [length, 0.12, height]);
    b.cuboid(coping, place, [0.0, -0.17, height], [length, 0.17, height + 0.08]);
    let piers = (length / 3.0).ceil();
    for i in 0..=piers as usize {
        let x = (length * i as f32 / piers).min(length - 0.2);
        b.cuboid(paint, place, [x - 0.2, -0.22, ROOT], [x + 0.2, 0.22, height + 0.18]);
    }
}
