//! Triangles with one surface each, and the solids that objects are made of.

use std::f32::consts::TAU;

use parry3d::math::{Vec2, Vec3};
use rand_chacha::ChaCha8Rng;

use crate::carla_classes::Class;
use crate::surface::{Surface, Texture};

/// The instance of all ground, which is not an object.
pub const GROUND: u16 = 0;

/// An index into the surfaces of a scene.
pub type Paint = u32;

/// One triangle, stored for ray casting.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    pub corner: Vec3,
    pub edge_1: Vec3,
    pub edge_2: Vec3,
    pub paint: Paint,
}

/// A spot on the ground and a heading: the frame in which an object is modelled (x forward, y left, z up).
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub origin: Vec3,
    pub heading: Vec2,
}

impl Place {
    pub fn new(origin: Vec3, yaw: f32) -> Self {
        Self { origin, heading: Vec2::from_angle(yaw) }
    }

    /// Converts local coordinates to world coordinates.
    pub fn at(&self, x: f32, y: f32, z: f32) -> Vec3 {
        let turned = self.heading.rotate(Vec2::new(x, y));
        self.origin + turned.extend(z)
    }

    /// The place at a local offset, turned further by `yaw`.
    pub fn shifted(&self, x: f32, y: f32, z: f32, yaw: f32) -> Self {
        Self { origin: self.at(x, y, z), heading: self.heading.rotate(Vec2::from_angle(yaw)) }
    }
}

/// Collects the triangles and surfaces of one scene.
pub struct MeshBuilder {
    pub rng: ChaCha8Rng,
    pub triangles: Vec<Triangle>,
    pub surfaces: Vec<Surface>,
    /// Positions along the rig's path.
    viewpoints: Vec<Vec2>,
    instance: u16,
    objects: u16,
}

impl MeshBuilder {
    pub fn new(rng: ChaCha8Rng, viewpoints: Vec<Vec2>) -> Self {
        Self { rng, triangles: Vec::new(), surfaces: Vec::new(), viewpoints, instance: GROUND, objects: 0 }
    }

    /// Distance to the rig's path in metres, seen from above: near objects are modelled in more detail.
    pub fn distance(&self, place: &Place) -> f32 {
        let spot = place.origin.truncate();
        self.viewpoints.iter().map(|rig| spot.distance(*rig)).fold(f32::INFINITY, f32::min)
    }

    /// Starts a new object, to which the paints made from here on belong.
    pub fn begin_object(&mut self) {
        self.objects += 1;
        self.instance = self.objects;
    }

    /// A surface of the current object, with colour and reflectance drawn for its class.
    pub fn paint(&mut self, class: Class) -> Paint {
        let surface = Surface::random(class, self.instance, &mut self.rng);
        self.add_surface(surface)
    }

    /// A surface of the current object in a given colour.
    pub fn paint_as(&mut self, class: Class, colour: [f32; 3]) -> Paint {
        let surface =
            Surface { albedo: Vec3::from(colour), ..Surface::random(class, self.instance, &mut self.rng) };
        self.add_surface(surface)
    }

    /// A surface of the current object with a pattern.
    pub fn paint_textured(&mut self, class: Class, texture: Texture) -> Paint {
        let surface = Surface { texture, ..Surface::random(class, self.instance, &mut self.rng) };
        self.add_surface(surface)
    }

    fn add_surface(&mut self, surface: Surface) -> Paint {
        self.surfaces.push(surface);
        self.surfaces.len() as Paint - 1
    }

    pub fn triangle(&mut self, paint: Paint, a: Vec3, b: Vec3, c: Vec3) {
        self.triangles.push(Triangle { corner: a, edge_1: b - a, edge_2: c - a, paint });
    }

    /// A quadrilateral, its corners in order.
    pub fn quad(&mut self, paint: Paint, [a, b, c, d]: [Vec3; 4]) {
        self.triangle(paint, a, b, c);
        self.triangle(paint, a, c, d);
    }

    /// A convex polygon, its corners in order.
    pub fn polygon(&mut self, paint: Paint, corners: &[Vec3]) {
        for pair in corners.windows(2).skip(1) {
            self.triangle(paint, corners[0], pair[0], pair[1]);
        }
    }

    /// A box between two local corners.
    pub fn cuboid(&mut self, paint: Paint, place: &Place, low: [f32; 3], high: [f32; 3]) {
        let ([x0, y0, z0], [x1, y1, z1]) = (low, high);
        self.extrude(paint, place, &[(x0, z0), (x1, z0), (x1, z1), (x0, z1)], y0, y1);
    }

    /// A convex outline in the local x-z plane, swept from `y0` to `y1`.
    pub fn extrude(&mut self, paint: Paint, place: &Place, outline: &[(f32, f32)], y0: f32, y1: f32) {
        let side = |y| outline.iter().map(move |&(x, z)| place.at(x, y, z)).collect();
        let (right, left): (Vec<_>, Vec<_>) = (side(y0), side(y1));
        self.loft(paint, &right, &left);
        self.polygon(paint, &right);
        self.polygon(paint, &left);
    }

    /// The band between two closed outlines with the same number of corners.
    pub fn loft(&mut self, paint: Paint, from: &[Vec3], to: &[Vec3]) {
        for i in 0..from.len() {
            let j = (i + 1) % from.len();
            self.quad(paint, [from[i], from[j], to[j], to[i]]);
        }
    }

    /// A tapered tube, closed at both ends.
    pub fn tube(&mut self, paint: Paint, ends: [Vec3; 2], radii: [f32; 2], sides: usize) {
        let (u, v) = (ends[1] - ends[0]).normalize_or(Vec3::Z).any_orthonormal_pair();
        let circle = |end: usize| -> Vec<Vec3> {
            (0..sides)
                .map(|i| Vec2::from_angle(TAU * i as f32 / sides as f32) * radii[end])
                .map(|p| ends[end] + u * p.x + v * p.y)
                .collect()
        };
        let (from, to) = (circle(0), circle(1));
        self.loft(paint, &from, &to);
        self.polygon(paint, &from);
        self.polygon(paint, &to);
    }

    /// An upright ellipsoid with few faces.
    pub fn ellipsoid(&mut self, paint: Paint, center: Vec3, radii: Vec3) {
        const SIDES: usize = 8;
        const LATITUDES: [f32; 4] = [-1.2, -0.45, 0.45, 1.2];
        let ring = |latitude: f32| -> Vec<Vec3> {
            (0..SIDES)
                .map(|i| Vec2::from_angle(TAU * i as f32 / SIDES as f32) * latitude.cos())
                .map(|p| center + radii * p.extend(latitude.sin()))
                .collect()
        };
        let rings = LATITUDES.map(ring);
        for pair in rings.windows(2) {
            self.loft(paint, &pair[0], &pair[1]);
        }
        self.polygon(paint, &rings[0]);
        self.polygon(paint, &rings[LATITUDES.len() - 1]);
    }

    /// A flat ring in the local x-z plane about a local centre: see-through inside.
    pub fn hoop(&mut self, paint: Paint, place: &Place, center: [f32; 3], radii: [f32; 2]) {
        const SIDES: usize = 12;
        let circle = |radius: f32| -> Vec<Vec3> {
            (0..SIDES)
                .map(|i| Vec2::from_angle(TAU * i as f32 / SIDES as f32) * radius)
                .map(|p| place.at(center[0] + p.x, center[1], center[2] + p.y))
                .collect()
        };
        self.loft(paint, &circle(radii[0]), &circle(radii[1]));
    }
}
