//! A finished scene, for ray casting.

use nalgebra::Vector3;
use parry3d::bounding_volume::Aabb;
use parry3d::math::{Vec3, Vec3A};
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};

use crate::mesh::{MeshBuilder, Triangle};
use crate::surface::{Spot, Surface};

/// Triangles that share an edge overlap by this fraction of their size, so that no ray slips through between them.
const EDGE_OVERLAP: f32 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub triangle: u32,
    /// Metres from the ray's origin.
    pub range: f32,
}

/// Converts a vector of the rig's geometry for the ray caster.
pub fn to_f32(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}

/// Triangles in a bounding volume hierarchy.
pub struct Scene {
    triangles: Vec<Triangle>,
    surfaces: Vec<Surface>,
    bvh: Bvh,
}

impl Scene {
    pub fn new(builder: MeshBuilder) -> Self {
        let boxes: Vec<Aabb> = builder.triangles.iter().map(bounds).collect();
        Self {
            bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            triangles: builder.triangles,
            surfaces: builder.surfaces,
        }
    }

    /// The first triangle on a ray of unit direction, nearer than `max_range`.
    ///
    /// `guess` is a triangle that the ray is likely to hit, such as the one that its neighbour hit. It only saves
    /// time.
    pub fn cast(&self, origin: Vec3, direction: Vec3, max_range: f32, guess: Option<u32>) -> Option<Hit> {
        let meet = |id: u32| intersect(&self.triangles[id as usize], origin, direction);
        let guessed = guess
            .and_then(|triangle| meet(triangle).map(|range| Hit { triangle, range }))
            .filter(|hit| hit.range < max_range);
        let limit = guessed.map_or(max_range, |hit| hit.range);
        let slabs = Slabs::new(origin, direction);
        let found = self.bvh.find_best(limit, |node, _| slabs.enter(node), |id, _| meet(id));
        found.map(|(triangle, range)| Hit { triangle, range }).or(guessed)
    }

    /// Any triangle on a ray of unit direction, nearer than `max_range`; `guess` as in [`Scene::cast`].
    pub fn blocker(&self, origin: Vec3, direction: Vec3, max_range: f32, guess: Option<u32>) -> Option<u32> {
        let stands_in = |id: u32| {
            intersect(&self.triangles[id as usize], origin, direction).is_some_and(|range| range < max_range)
        };
        if let Some(id) = guess.filter(|&id| stands_in(id)) {
            return Some(id);
        }
        let slabs = Slabs::new(origin, direction);
        // Any hit ends the search: nothing is nearer than minus infinity.
        let meet = |id: u32, _| stands_in(id).then_some(f32::NEG_INFINITY);
        self.bvh.find_best(max_range, |node, _| slabs.enter(node), meet).map(|(id, _)| id)
    }

    /// The surface point that a ray hits, with the normal on the ray's side.
    pub fn spot(&self, hit: Hit, origin: Vec3, direction: Vec3) -> Spot<'_> {
        let triangle = &self.triangles[hit.triangle as usize];
        let normal = triangle.edge_1.cross(triangle.edge_2).normalize_or(Vec3::Z);
        Spot {
            surface: &self.surfaces[triangle.paint as usize],
            point: origin + direction * hit.range,
            normal: if normal.dot(direction) > 0.0 { -normal } else { normal },
            direction,
            range: hit.range,
        }
    }
}

/// A ray in the form that box tests need. Parry's own test is not inlined across crates, which would double the
/// time.
struct Slabs {
    origin: Vec3A,
    inverse: Vec3A,
}

impl Slabs {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin: origin.into(), inverse: Vec3A::from(direction).recip() }
    }

    /// Range at which the ray enters a node's box; `f32::MAX` if it misses.
    #[inline(always)]
    fn enter(&self, node: &BvhNode) -> f32 {
        let low = (Vec3A::from(node.mins()) - self.origin) * self.inverse;
        let high = (Vec3A::from(node.maxs()) - self.origin) * self.inverse;
        let (enter, leave) = (low.min(high).max_element(), low.max(high).min_element());
        if leave >= enter.max(0.0) { enter } else { f32::MAX }
    }
}

fn bounds(triangle: &Triangle) -> Aabb {
    let [a, b, c] = [triangle.corner, triangle.corner + triangle.edge_1, triangle.corner + triangle.edge_2];
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

/// Möller and Trumbore's test, two-sided.
fn intersect(triangle: &Triangle, origin: Vec3, direction: Vec3) -> Option<f32> {
    let p = direction.cross(triangle.edge_2);
    let determinant = triangle.edge_1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let inverse = determinant.recip();
    let offset = origin - triangle.corner;
    let u = offset.dot(p) * inverse;
    if !(-EDGE_OVERLAP..=1.0 + EDGE_OVERLAP).contains(&u) {
        return None;
    }
    let q = offset.cross(triangle.edge_1);
    let v = direction.dot(q) * inverse;
    let range = triangle.edge_2.dot(q) * inverse;
    (v >= -EDGE_OVERLAP && u + v <= 1.0 + EDGE_OVERLAP && range > 0.0).then_some(range)
}
