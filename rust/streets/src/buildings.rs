//! Houses. The local origin is the middle of the front at ground level, local x runs along the front, and local -y
//! points to the street.

use rand::RngExt;

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint, Place};
use crate::surface::Texture;

/// Depth of walls below ground level, which covers the roughness of the ground.
const FOUNDATION: f32 = -0.6;
const DOOR: [f32; 3] = [0.25, 0.14, 0.08];
const ROOF: [f32; 3] = [0.4, 0.2, 0.15];

#[derive(Clone, Copy, Debug)]
pub struct Size {
    pub width: f32,
    pub depth: f32,
    pub height: f32,
}

struct Paints {
    wall: Paint,
    trim: Paint,
    roof: Paint,
    door: Paint,
}

/// A house with bays and recesses in its front, steps, balconies and a roof.
pub fn house(b: &mut MeshBuilder, place: &Place, size: Size) {
    b.begin_object();
    let floor = b.rng.random_range(2.8..3.4f32);
    let texture = Texture::Facade { pitch: b.rng.random_range(2.0..3.4), floor };
    // Only whole floors, or the roof would cut through windows.
    let size = Size { height: (size.height / floor).round().max(1.0) * floor, ..size };
    let paints = Paints {
        wall: b.paint_textured(Class::Building, texture),
        trim: b.paint(Class::Building),
        roof: b.paint_as(Class::Building, ROOF),
        door: b.paint_as(Class::Building, DOOR),
    };
    let half = 0.5 * size.width;
    let back = [half, size.depth, size.height];
    b.cuboid(paints.wall, place, [-half, 0.9, FOUNDATION], back);
    front(b, place, size, &paints);
    if size.height < 10.0 && b.rng.random_bool(0.6) {
        gable(b, place, size, &paints);
    } else {
        flat_roof(b, place, size, &paints);
    }
}

/// Bays of different depth before the main block, one of them with the door.
fn front(b: &mut MeshBuilder, place: &Place, size: Size, paints: &Paints) {
    let bays = (size.width / b.rng.random_range(2.6..4.2)).round().max(2.0) as usize;
    let width = size.width / bays as f32;
    let door = b.rng.random_range(0..bays);
    for i in 0..bays {
        let x = -0.5 * size.width + width * i as f32;
        let y = b.rng.random_range(0.0..0.8f32);
        let height = size.height * if b.rng.random_bool(0.25) { b.rng.random_range(0.4..0.9) } else { 1.0 };
        b.cuboid(paints.wall, place, [x, y, FOUNDATION], [x + width, 1.0, height]);
        let middle = x + 0.5 * width;
        if i == door {
            entrance(b, place, middle, y, paints);
        } else if b.rng.random_bool(0.35) {
            balconies(b, place, [x + 0.3, x + width - 0.3], y, height, paints.trim);
        } else if b.rng.random_bool(0.4) {
            b.cuboid(paints.trim, place, [x + 0.1, y - 0.25, 2.7], [x + width - 0.1, y, 2.9]);
        }
    }
}

/// A door under a canopy at the top of two steps.
fn entrance(b: &mut MeshBuilder, place: &Place, x: f32, y: f32, paints: &Paints) {
    b.cuboid(paints.door, place, [x - 0.55, y - 0.04, 0.3], [x + 0.55, y, 2.4]);
    b.cuboid(paints.trim, place, [x - 0.9, y - 0.8, 2.55], [x + 0.9, y, 2.7]);
    for (out, up) in [(0.75, 0.17), (0.4, 0.34)] {
        b.cuboid(paints.trim, place, [x - 0.8, y - out, FOUNDATION], [x + 0.8, y, up]);
    }
}

/// A slab and a parapet of bars on each upper floor.
fn balconies(b: &mut MeshBuilder, place: &Place, [x0, x1]: [f32; 2], y: f32, height: f32, paint: Paint) {
    const FLOOR: f32 = 3.0;
    const REACH: f32 = 1.0;
    let floors = ((height / FLOOR) as usize).min(4);
    for floor in 1..floors {
        let z = FLOOR * floor as f32;
        b.cuboid(paint, place, [x0, y - REACH, z - 0.12], [x1, y, z]);
        b.cuboid(paint, place, [x0, y - REACH, z + 0.95], [x1, y - REACH + 0.05, z + 1.0]);
        let bars = ((x1 - x0) / 0.25) as usize;
        for i in 0..=bars {
            let x = x0 + (x1 - x0 - 0.04) * i as f32 / bars as f32;
            let bar = [(x, z), (x + 0.04, z), (x + 0.04, z + 0.95), (x, z + 0.95)];
            b.quad(paint, bar.map(|(x, z)| place.at(x, y - REACH + 0.02, z)));
        }
    }
}

/// A pitched roof with its ridge along the front, eaves and a chimney.
fn gable(b: &mut MeshBuilder, place: &Place, size: Size, paints: &Paints) {
    const EAVES: f32 = 0.4;
    let rise = size.depth * b.rng.random_range(0.25..0.4);
    let half = 0.5 * size.width + EAVES;
    let ridge_y = 0.5 * size.depth;
    for y in [-EAVES, size.depth + EAVES] {
        let z = size.height - 0.1;
        b.quad(
            paints.roof,
            [
                place.at(-half, y, z),
                place.at(half, y, z),
                place.at(half, ridge_y, z + rise),
                place.at(-half, ridge_y, z + rise),
            ],
        );
    }
    for x in [-0.5 * size.width, 0.5 * size.width] {
        let z = size.height - 0.05;
        b.triangle(
            paints.wall,
            place.at(x, 0.0, z),
            place.at(x, size.depth, z),
            place.at(x, ridge_y, z + rise),
        );
    }
    let x = b.rng.random_range(-0.3..0.3) * size.width;
    let top = size.height + rise + 0.8;
    b.cuboid(paints.trim, place, [x - 0.35, ridge_y + 0.5, size.height], [x + 0.35, ridge_y + 1.1, top]);
}

/// A parapet and boxes of machinery.
fn flat_roof(b: &mut MeshBuilder, place: &Place, size: Size, paints: &Paints) {
    let half = 0.5 * size.width;
    b.cuboid(
        paints.trim,
        place,
        [-half - 0.15, 0.75, size.height],
        [half + 0.15, size.depth, size.height + 0.35],
    );
    for _ in 0..2 {
        let x = b.rng.random_range(-0.7..0.5) * half;
        let y = b.rng.random_range(0.4..0.6) * size.depth;
        let tall = b.rng.random_range(0.8..2.6);
        b.cuboid(paints.trim, place, [x, y, size.height], [x + 2.0, y + 1.6, size.height + tall]);
    }
}
