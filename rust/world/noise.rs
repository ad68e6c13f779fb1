//! Repeatable noise as a function of place: rough ground and surface texture.

use parry3d::math::{Vec2, Vec3};

/// An integer hash of good avalanche (Wellons' `lowbias32`).
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number in [-1, 1] for a cell of the integer grid.
fn cell(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let key = (x as u32).wrapping_mul(0x9e37_79b1)
        ^ (y as u32).wrapping_mul(0x85eb_ca77)
        ^ (z as u32).wrapping_mul(0xc2b2_ae3d)
        ^ seed;
    hash(key) as f32 * (2.0 / u32::MAX as f32) - 1.0
}

/// Noise in [-1, 1], constant in each unit cube.
pub fn blocky(p: Vec3, seed: u32) -> f32 {
    let p = p.floor();
    cell(p.x as i32, p.y as i32, p.z as i32, seed)
}

/// Noise in [-1, 1] with features of about one unit, continuously differentiable.
pub fn smooth(p: Vec2, seed: u32) -> f32 {
    let base = p.floor();
    let t = p - base;
    let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
    let (x, y) = (base.x as i32, base.y as i32);
    let row = |y| {
        let (left, right) = (cell(x, y, 0, seed), cell(x + 1, y, 0, seed));
        left + (right - left) * t.x
    };
    let (low, high) = (row(y), row(y + 1));
    low + (high - low) * t.y
}
