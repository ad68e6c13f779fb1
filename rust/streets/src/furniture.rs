//! Street furniture: posts, lights, signs, benches, bins, fences and walls. Local x points along the street unless
//! stated otherwise, local y to the left.

use parry3d::math::Vec3;
use rand::RngExt;

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint, Place};

const DARK: [f32; 3] = [0.08, 0.08, 0.08];
const GLASS: [f32; 3] = [0.35, 0.42, 0.44];
const RED: [f32; 3] = [0.8, 0.1, 0.08];
const AMBER: [f32; 3] = [0.75, 0.5, 0.1];
const GREEN: [f32; 3] = [0.1, 0.6, 0.25];
/// Depth of posts below ground level, which covers the roughness of the ground.
pub const ROOT: f32 = -0.3;

pub fn post(b: &mut MeshBuilder, paint: Paint, place: &Place, height: f32, radius: f32) {
    b.tube(paint, [place.at(0.0, 0.0, ROOT), place.at(0.0, 0.0, height)], [radius, 0.8 * radius], 7);
}

/// A lamp post whose arm reaches along local y.
pub fn lamp_post(b: &mut MeshBuilder, place: &Place, reach: f32) {
    b.begin_object();
    let steel = b.paint(Class::Pole);
    let height = b.rng.random_range(5.5..8.0);
    b.tube(steel, [place.at(0.0, 0.0, ROOT), place.at(0.0, 0.0, 1.0)], [0.13, 0.12], 8);
    post(b, steel, place, height, 0.085);
    let tip = place.at(0.0, reach, height + 0.4);
    b.tube(steel, [place.at(0.0, 0.0, height - 0.1), tip], [0.06, 0.045], 6);
    let inwards = reach.signum();
    let head = [0.0, reach, height + 0.35];
    b.cuboid(
        steel,
        place,
        [-0.16, head[1].min(head[1] + 0.7 * inwards), head[2]],
        [0.16, head[1].max(head[1] + 0.7 * inwards), head[2] + 0.14],
    );
}

pub fn mast(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let wood = b.paint_as(Class::Pole, [0.33, 0.25, 0.18]);
    post(b, wood, place, 8.5, 0.15);
    for z in [7.4, 8.1] {
        b.cuboid(wood, place, [-0.06, -0.9, z], [0.06, 0.9, z + 0.12]);
    }
}

/// A row of bollards along local x.
pub fn bollards(b: &mut MeshBuilder, place: &Place, count: usize) {
    for i in 0..count {
        b.begin_object();
        let paint = b.paint(Class::Pole);
        post(b, paint, &place.shifted(1.5 * i as f32, 0.0, 0.0, 0.0), 0.95, 0.075);
    }
}

/// A traffic light that faces local -x, with a second head on an arm along local y if `reach` is not 0.
pub fn traffic_light(b: &mut MeshBuilder, place: &Place, reach: f32) {
    b.begin_object();
    let steel = b.paint(Class::Pole);
    let height = if reach == 0.0 { 3.4 } else { 5.8 };
    post(b, steel, place, height, 0.08);
    light_head(b, &place.shifted(-0.2, 0.0, 2.4, 0.0));
    if reach != 0.0 {
        b.tube(steel, [place.at(0.0, 0.0, 5.6), place.at(0.0, reach, 5.8)], [0.07, 0.05], 6);
        light_head(b, &place.shifted(-0.2, reach, 5.0, 0.0));
    }
}

fn light_head(b: &mut MeshBuilder, place: &Place) {
    let case = b.paint(Class::TrafficLight);
    b.cuboid(case, place, [-0.12, -0.17, 0.0], [0.12, 0.17, 0.98]);
    b.cuboid(case, place, [-0.02, -0.27, -0.1], [0.02, 0.27, 1.08]);
    for (i, colour) in [GREEN, AMBER, RED].into_iter().enumerate() {
        let lamp = b.paint_as(Class::TrafficLight, colour);
        b.ellipsoid(lamp, place.at(-0.12, 0.0, 0.19 + 0.3 * i as f32), Vec3::new(0.06, 0.1, 0.1));
    }
}

/// A sign that faces local -x: one or two plates of various shapes on a post.
pub fn traffic_sign(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let steel = b.paint(Class::Pole);
    let height = b.rng.random_range(2.3..3.0);
    post(b, steel, place, height, 0.04);
    let plates = b.rng.random_range(1..3);
    for i in 0..plates {
        sign_plate(b, place, height - 0.32 - 0.72 * i as f32);
    }
}

fn sign_plate(b: &mut MeshBuilder, place: &Place, z: f32) {
    let (sides, size): (usize, f32) = [(3, 0.46), (4, 0.4), (8, 0.4), (12, 0.34)][b.rng.random_range(0..4)];
    let rim = b.paint(Class::TrafficSign);
    let face = b.paint(Class::TrafficSign);
    let half_turn = std::f32::consts::PI;
    let plate = |radius: f32, x: f32| -> Vec<Vec3> {
        (0..sides)
            .map(|i| {
                half_turn
                    * (0.5
                        + if sides == 3 { 0.0 } else { 1.0 / sides as f32 }
                        + 2.0 * i as f32 / sides as f32)
            })
            .map(|angle| place.at(x, radius * angle.cos(), z + radius * angle.sin()))
            .collect()
    };
    b.loft(rim, &plate(size, -0.05), &plate(size, -0.09));
    b.polygon(rim, &plate(size, -0.05));
    b.polygon(rim, &plate(size, -0.09));
    b.polygon(face, &plate(0.75 * size, -0.095));
}

/// A large blue panel over the edge of the road, on two posts.
pub fn direction_panel(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let steel = b.paint(Class::Pole);
    let panel = b.paint_as(Class::TrafficSign, [0.08, 0.2, 0.5]);
    let stripe = b.paint_as(Class::TrafficSign, [0.85, 0.85, 0.85]);
    for y in [-0.8, 0.8] {
        post(b, steel, &place.shifted(0.0, y, 0.0, 0.0), 3.6, 0.06);
    }
    b.cuboid(panel, place, [-0.12, -1.2, 2.3], [-0.07, 1.2, 3.7]);
    for z in [2.55, 3.0, 3.4] {
        b.cuboid(stripe, place, [-0.13, -0.9, z], [-0.12, 0.7, z + 0.12]);
    }
}

/// A bench of slats that faces local y.
pub fn bench(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let slat = b.paint(Class::Static);
    let iron = b.paint_as(Class::Static, DARK);
    for x in [-0.75, 0.69] {
        b.cuboid(iron, place, [x, -0.25, ROOT], [x + 0.06, 0.22, 0.42]);
        b.cuboid(iron, place, [x, -0.3, 0.4], [x + 0.06, -0.24, 0.88]);
    }
    for i in 0..4 {
        let y = -0.24 + 0.12 * i as f32;
        b.cuboid(slat, place, [-0.9, y, 0.43], [0.9, y + 0.08, 0.46]);
    }
    for z in [0.55, 0.68, 0.81] {
        b.cuboid(slat, place, [-0.9, -0.24, z], [0.9, -0.21, z + 0.08]);
    }
}

/// A small object on the pavement: a bin, a hydrant, a cabinet, a planter or a letter box.
pub fn small_object(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let paint = b.paint(Class::Static);
    let dark = b.paint_as(Class::Static, DARK);
    match b.rng.random_range(0..5) {
        0 => {
            b.tube(paint, [place.at(0.0, 0.0, ROOT), place.at(0.0, 0.0, 0.85)], [0.2, 0.26], 9);
            b.tube(dark, [place.at(0.0, 0.0, 0.85), place.at(0.0, 0.0, 0.95)], [0.28, 0.2], 9);
        }
        1 => {
            post(b, paint, place, 0.7, 0.13);
            b.ellipsoid(paint, place.at(0.0, 0.0, 0.7), Vec3::new(0.15, 0.15, 0.12));
            b.tube(paint, [place.at(0.0, -0.22, 0.48), place.at(0.0, 0.22, 0.48)], [0.07; 2], 6);
        }
        2 => b.cuboid(paint, place, [-0.5, -0.2, ROOT], [0.5, 0.2, 1.3]),
        3 => b.extrude(paint, place, &[(-0.45, ROOT), (0.45, ROOT), (0.6, 0.55), (-0.6, 0.55)], -0.4, 0.4),
        _ => {
            post(b, dark, place, 0.9, 0.06);
            b.cuboid(paint, place, [-0.22, -0.18, 0.8], [0.22, 0.18, 1.4]);
        }
    }
}

/// Two wheeled bins side by side.
pub fn wheeled_bins(b: &mut MeshBuilder, place: &Place) {
    for x in [-0.35, 0.35] {
        b.begin_object();
        let paint = b.paint(Class::Static);
        let outline = [(x - 0.24, 0.04), (x + 0.24, 0.04), (x + 0.29, 1.0), (x - 0.29, 1.0)];
        b.extrude(paint, place, &outline, -0.3, 0.3);
        b.cuboid(paint, place, [x - 0.31, -0.34, 1.0], [x + 0.31, 0.34, 1.07]);
    }
}

/// A bus shelter, open along local y: a roof on posts, glass behind, a seat.
pub fn shelter(b: &mut MeshBuilder, place: &Place) {
    b.begin_object();
    let frame = b.paint(Class::Static);
    let glass = b.paint_as(Class::Static, GLASS);
    for (x, y) in [(-1.8, -0.7), (1.8, -0.7), (-1.8, 0.6), (1.8, 0.6)] {
        b.cuboid(frame, place, [x - 0.04, y - 0.04, ROOT], [x + 0.04, y + 0.04, 2.4]);
    }
    b.cuboid(frame, place, [-2.0, -0.85, 2.4], [2.0, 0.9, 2.52]);
    b.cuboid(glass, place, [-1.76, -0.71, 0.3], [1.76, -0.69, 2.1]);
    b.cuboid(glass, place, [-1.81, -0.66, 0.3], [-1.79, 0.1, 2.1]);
    b.cuboid(frame, place, [-1.2, -0.5, 0.45], [1.2, -0.15, 0.5]);
    for x in [-1.0, 1.0] {
        b.cuboid(frame, place, [x - 0.04, -0.4, ROOT], [x + 0.04, -0.3, 0.45]);
    }
}

/// A fence along local x, see-through between its pickets or rails.
pub fn fence(b: &mut MeshBuilder, place: &Place, length: f32) {
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
pub fn railing(b: &mut MeshBuilder, place: &Place, length: f32) {
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
pub fn wall(b: &mut MeshBuilder, place: &Place, length: f32, height: f32) {
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
