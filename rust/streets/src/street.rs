//! The plan of a street: the course of its lanes, pavements and side street, and the height of the ground.
//!
//! Street coordinates are `s`, metres along the centre line, and `d`, metres to its left. The rig is at `s = 0`.

use parry3d::math::{Vec2, Vec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Place};
use crate::{FREE_RADIUS_M, surface};

/// Width of painted lines.
pub const LINE_WIDTH: f32 = 0.14;
/// Length of dashes and of the gaps between them.
pub const DASH: f32 = 3.0;
const LANE_WIDTHS: std::ops::Range<f32> = 3.2..3.6;
const PARKING_WIDTH: f32 = 2.2;
const KERB_HEIGHTS: std::ops::Range<f32> = 0.12..0.18;
/// Largest curvature, 1/m: cross-sections must not intersect within the width of the scene.
const MAX_CURVATURE: f32 = 1.0 / 130.0;
/// Amplitude of the smooth noise on the ground.
const ROAD_ROUGHNESS: f32 = 0.014;
const TERRAIN_ROUGHNESS: std::ops::Range<f32> = 0.05..0.2;
/// Terrain reaches its full roughness at this distance from paved ground.
const TERRAIN_RAMP: f32 = 2.0;
const HILL_HEIGHT: f32 = 0.4;
const HILL_LENGTH: f32 = 40.0;

/// A street that branches off at right angles.
#[derive(Clone, Copy, Debug)]
pub struct SideStreet {
    pub s: f32,
    pub half_width: f32,
    pub sidewalk: f32,
    /// Whether it leaves to the right, and to the left.
    pub sides: [bool; 2],
}

/// A street's plan and relief.
#[derive(Clone, Debug)]
pub struct Street {
    /// Curvature, 1/m, behind the rig and ahead of it.
    curvature: [f32; 2],
    pub lanes: usize,
    pub lane_width: f32,
    /// Whether cars are parked along the right kerb, and along the left kerb.
    pub parking: [bool; 2],
    /// Width of the grass between the kerb and the sidewalk.
    pub verge: f32,
    pub sidewalk: f32,
    pub kerb: f32,
    pub side_street: Option<SideStreet>,
    terrain_roughness: f32,
    seed: u32,
}

impl Street {
    pub fn random(rng: &mut ChaCha8Rng) -> Self {
        let mut curvature = || match rng.random_range(0..3) {
            0 => 0.0,
            _ => rng.random_range(-MAX_CURVATURE..MAX_CURVATURE),
        };
        let curvature = [curvature(), curvature()];
        let side_street = rng.random_bool(0.6).then(|| SideStreet {
            s: rng.random_range(12.0..40.0f32) * if rng.random() { 1.0 } else { -1.0 },
            half_width: rng.random_range(2.8..3.6),
            sidewalk: rng.random_range(1.5..2.5),
            sides: [[true, false], [false, true], [true, true]][rng.random_range(0..3)],
        });
        Self {
            curvature,
            lanes: [2, 2, 2, 3, 4][rng.random_range(0..5)],
            lane_width: rng.random_range(LANE_WIDTHS),
            parking: [rng.random_bool(0.6), rng.random_bool(0.6)],
            verge: if rng.random_bool(0.4) { rng.random_range(0.8..2.0) } else { 0.0 },
            sidewalk: rng.random_range(1.8..4.5),
            kerb: rng.random_range(KERB_HEIGHTS),
            side_street,
            terrain_roughness: rng.random_range(TERRAIN_ROUGHNESS),
            seed: rng.random(),
        }
    }

    /// Distance from the centre line to the edge of the outermost lane.
    pub fn lanes_half_width(&self) -> f32 {
        0.5 * self.lanes as f32 * self.lane_width
    }

    /// Distance from the centre line to the kerb of one side (0 right, 1 left).
    pub fn kerb_at(&self, side: usize) -> f32 {
        self.lanes_half_width() + if self.parking[side] { PARKING_WIDTH } else { 0.4 }
    }

    /// Distance from the centre line to the far edge of the sidewalk of one side.
    pub fn frontage_at(&self, side: usize) -> f32 {
        self.kerb_at(side) + self.verge + self.sidewalk
    }

    /// The middle of a lane, counted from the right.
    pub fn lane_center(&self, lane: usize) -> f32 {
        (lane as f32 + 0.5) * self.lane_width - self.lanes_half_width()
    }

    /// Whether a lane runs towards growing `s`. Traffic keeps to the right.
    pub fn lane_runs_ahead(&self, lane: usize) -> bool {
        2 * lane < self.lanes
    }

    /// The borders of painted lines that run along the street, and whether each is dashed.
    pub fn lines(&self) -> Vec<(f32, bool)> {
        let edge = self.lanes_half_width();
        let divider = |lane: usize| (lane as f32 * self.lane_width - edge, true);
        let mut lines: Vec<_> = (1..self.lanes).map(divider).collect();
        lines.extend([(-edge, false), (edge, false)]);
        lines
    }

    pub fn at(&self, s: f32, d: f32) -> Vec2 {
        let curvature = self.curvature_at(s);
        let normal = Vec2::from_angle(self.yaw(s)).perp();
        let center = if curvature == 0.0 {
            Vec2::new(s, 0.0)
        } else {
            Vec2::new((s * curvature).sin(), 1.0 - (s * curvature).cos()) / curvature
        };
        center + normal * d
    }

    /// The direction of growing `s`.
    pub fn yaw(&self, s: f32) -> f32 {
        s * self.curvature_at(s)
    }

    fn curvature_at(&self, s: f32) -> f32 {
        self.curvature[usize::from(s >= 0.0)]
    }

    /// A place on the ground, turned by `yaw` from the street's direction.
    pub fn place(&self, s: f32, d: f32, yaw: f32) -> Place {
        let height = self.relief(s, d) + self.step(self.class_at(s, d));
        Place::new(self.at(s, d).extend(height), self.yaw(s) + yaw)
    }

    /// The class of the ground.
    pub fn class_at(&self, s: f32, d: f32) -> Class {
        let (side, out) = (usize::from(d > 0.0), d.abs());
        let kerb = self.kerb_at(side);
        if out < kerb {
            return if self.is_line(s, d) { Class::RoadLine } else { Class::Road };
        }
        if let Some(branch) = self.branch(side)
            && (s - branch.s).abs() < branch.half_width
        {
            let on_line = (s - branch.s).abs() < 0.5 * LINE_WIDTH && is_dash(out);
            return if on_line && out > kerb + DASH { Class::RoadLine } else { Class::Road };
        }
        let from_branch = self
            .branch(side)
            .map_or(f32::INFINITY, |branch| (s - branch.s).abs() - branch.half_width - branch.sidewalk);
        let sidewalk = (kerb + self.verge..self.frontage_at(side)).contains(&out);
        if sidewalk || from_branch < 0.0 { Class::Sidewalk } else { Class::Terrain }
    }

    fn is_line(&self, s: f32, d: f32) -> bool {
        let crossed = self.side_street.is_some_and(|branch| (s - branch.s).abs() < branch.half_width);
        let painted =
            |&(line, dashed): &(f32, bool)| (d - line).abs() < 0.5 * LINE_WIDTH && (!dashed || is_dash(s));
        !crossed && self.lines().iter().any(painted)
    }

    /// The side street, if it leaves to this side.
    pub fn branch(&self, side: usize) -> Option<&SideStreet> {
        self.side_street.as_ref().filter(|branch| branch.sides[side])
    }

    /// Height of a class of ground above the carriageway.
    pub fn step(&self, class: Class) -> f32 {
        match class {
            Class::Road | Class::RoadLine => 0.0,
            _ => self.kerb,
        }
    }

    pub fn relief(&self, s: f32, d: f32) -> f32 {
        let p = self.at(s, d);
        let wild = (self.beyond_pavement(s, d) / TERRAIN_RAMP).clamp(0.0, 1.0);
        let roughness = ROAD_ROUGHNESS + (self.terrain_roughness - ROAD_ROUGHNESS) * wild;
        let bumps = 0.7 * surface::smooth_noise(p / 2.5, self.seed)
            + 0.3 * surface::smooth_noise(p / 0.9, self.seed ^ 1);
        HILL_HEIGHT * surface::smooth_noise(p / HILL_LENGTH, self.seed ^ 2) + roughness * bumps
    }

    pub fn beyond_pavement(&self, s: f32, d: f32) -> f32 {
        let side = usize::from(d > 0.0);
        let from_street = d.abs() - self.frontage_at(side);
        let from_branch = self
            .branch(side)
            .map_or(f32::INFINITY, |branch| (s - branch.s).abs() - branch.half_width - branch.sidewalk);
        from_street.min(from_branch)
    }

    /// The position of the rig's vehicle, for a rig at `d`.
    pub fn rig_spot(&self, d: f32) -> Vec3 {
        self.place(0.0, d, 0.0).origin
    }
}

fn is_dash(along: f32) -> bool {
    (along / DASH).floor() as i32 % 2 == 0
}

/// Objects are placed along this much of the street in either direction.
pub const REACH: f32 = 80.0;

/// A scene under construction: the street, its triangles, and the occupied ground.
pub struct Site {
    pub builder: MeshBuilder,
    pub street: Street,
    /// Positions along the rig's path.
    path: Vec<Vec2>,
    taken: Vec<(Vec2, f32)>,
}

impl Site {
    /// Creates bare ground, of which only the rig's path is taken.
    pub fn new(builder: MeshBuilder, street: Street, path: Vec<Vec2>) -> Self {
        let taken = path.iter().map(|&spot| (spot, FREE_RADIUS_M)).collect();
        Self { builder, street, path, taken }
    }

    /// Claims a disc of ground, if all of it is free; `(s, d)` in street coordinates.
    pub fn claim(&mut self, s: f32, d: f32, radius: f32) -> bool {
        let spot = self.street.at(s, d);
        let free = self.taken.iter().all(|(other, size)| spot.distance(*other) > radius + size);
        if free {
            self.taken.push((spot, radius));
        }
        free
    }

    /// Claims ground for a long object, at `yaw` to the street.
    ///
    /// `gap` is its smallest distance from the rig's path.
    pub fn claim_long(
        &mut self,
        s: f32,
        d: f32,
        yaw: f32,
        [half_length, half_width]: [f32; 2],
        gap: f32,
    ) -> bool {
        let steps = (half_length / half_width).ceil() as i32;
        let spots: Vec<_> = (-steps..=steps)
            .map(|i| (half_length - half_width).max(0.0) * i as f32 / steps as f32)
            .map(|along| (self.street.at(s + along * yaw.cos(), d + along * yaw.sin()), half_width))
            .collect();
        let free = |(spot, size): &(Vec2, f32)| {
            let clear = self.taken.iter().all(|(other, radius)| spot.distance(*other) > size + radius);
            clear && self.path.iter().all(|rig| spot.distance(*rig) > size + gap)
        };
        let all_free = spots.iter().all(free);
        if all_free {
            self.taken.extend(spots);
        }
        all_free
    }
}

/// Whether `s` is in the mouth of the side street, or within a margin of it.
pub fn is_near_branch(street: &Street, side: usize, s: f32, margin: f32) -> bool {
    street.branch(side).is_some_and(|branch| (s - branch.s).abs() < branch.half_width + margin)
}
