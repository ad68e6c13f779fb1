//! A street under construction: which ground is free.

use parry3d::math::Vec2;

use super::FREE_RADIUS_M;
use super::mesh::Builder;
use super::street::Street;

/// Objects are placed along this much of the street, either way.
pub const REACH: f32 = 80.0;

/// A scene under construction: the street, its triangles, and the ground that is taken.
pub struct Site {
    pub builder: Builder,
    pub street: Street,
    /// Spots along the rig's way.
    way: Vec<Vec2>,
    taken: Vec<(Vec2, f32)>,
}

impl Site {
    /// Bare ground, of which the rig has its own: spots along its way.
    pub fn new(builder: Builder, street: Street, way: Vec<Vec2>) -> Self {
        let taken = way.iter().map(|&spot| (spot, FREE_RADIUS_M)).collect();
        Self { builder, street, way, taken }
    }

    /// Takes a disc of ground, if all of it is free; `(s, d)` in street coordinates.
    pub fn claim(&mut self, s: f32, d: f32, radius: f32) -> bool {
        let spot = self.street.at(s, d);
        let free = self.taken.iter().all(|(other, size)| spot.distance(*other) > radius + size);
        if free {
            self.taken.push((spot, radius));
        }
        free
    }

    /// Takes ground for something long, lying at `yaw` to the street.
    ///
    /// `gap` is what must lie between it and the rig's way.
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
            clear && self.way.iter().all(|rig| spot.distance(*rig) > size + gap)
        };
        let all_free = spots.iter().all(free);
        if all_free {
            self.taken.extend(spots);
        }
        all_free
    }
}

/// Whether `s` lies in the mouth of the side street, or within a margin of it.
pub fn near_branch(street: &Street, side: usize, s: f32, margin: f32) -> bool {
    street.branch(side).is_some_and(|branch| (s - branch.s).abs() < branch.half_width + margin)
}
