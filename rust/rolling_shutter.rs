//! Compensation of a rolling shutter: points are moved to where the LiDAR would have seen them when their line was
//! exposed.
//!
//! A LiDAR that moves with the twist `V` sees a point, at `p` when the middle line is exposed, at `exp(-s V) p`
//! after `s` seconds. The line that it projects to gives `s`, and `s` gives its position: a fixed point.

use geometry::camera::Camera;
use geometry::se3::exp;
use geometry::shutter::Shutter;
use nalgebra::{Isometry3, Point3, Vector6};
use rayon::prelude::*;

/// The line of a point has converged if its time changes by less than this fraction of a line's.
const SETTLED_LINES: f64 = 0.01;
/// A point whose line is not found within this many steps passes the camera about as fast as the shutter rolls.
const MAX_STEPS: usize = 10;
/// Number of points that one task moves.
const CHUNK: usize = 4096;

/// A camera with a rolling shutter that moves with a LiDAR.
pub struct RollingCamera<'a> {
    /// Lens and image size.
    pub camera: &'a Camera,
    /// Shutter of the camera; its delay is ignored.
    pub shutter: Shutter,
    /// Motion of the LiDAR, metres and radians per second in its own frame.
    pub twist_per_s: Vector6<f64>,
    pub pose: Isometry3<f64>,
}

impl RollingCamera<'_> {
    /// Moves points (LiDAR frame, metres), each from the time at which it is seen to that at which its line is
    /// exposed. Times are seconds from the exposure of the middle line.
    ///
    /// Beyond the image, the lines at its border apply. A point that does not project is seen with the middle line.
    pub fn unroll(&self, points: &[[f32; 3]], seen_s: &[f64]) -> Vec<([f32; 3], f64)> {
        let shutter = self.shutter.around_its_middle();
        let pairs = points.par_iter().zip(seen_s).with_min_len(CHUNK);
        pairs.map(|(point, &seen_s)| self.unroll_point(point, seen_s, &shutter)).collect()
    }

    fn unroll_point(&self, point: &[f32; 3], seen_s: f64, shutter: &Shutter) -> ([f32; 3], f64) {
        let size = [self.camera.width, self.camera.height];
        let settled_s = SETTLED_LINES * shutter.readout_s / shutter.num_lines(size) as f64;
        let start = Point3::from(*point).cast::<f64>();
        let moved = |time_s: f64| exp(&(self.twist_per_s * (seen_s - time_s))) * start;
        // Starts from the middle line, so that the result does not depend on earlier moves of a point.
        let mut time_s = 0.0;
        for _ in 0..MAX_STEPS {
            let Some(pixel) = self.camera.project(&(self.pose * moved(time_s)).coords) else { break };
            let exposed_s = shutter.time_at_s(pixel.into(), size);
            let is_settled = (exposed_s - time_s).abs() <= settled_s;
            time_s = exposed_s;
            if is_settled {
                break;
            }
        }
        (moved(time_s).cast::<f32>().into(), time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::shutter::Direction;

    #[test]
    fn columns_are_solved_for_where_the_motion_changes_them() {
        const SPEED_M_S: f64 = 10.0;
        let k = [[400.0, 0.0, 319.5], [0.0, 400.0, 239.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (640, 480), k, &[]).expect("a camera");
        // The camera slides to its right: u + s k = u0 and s = r ((u + 0.5) / w - 0.5), with k pixels per second,
        // have one solution.
        let u0 = 319.5 + 400.0 * 2.0 / 8.0;
        for (direction, sign) in [(Direction::Right, 1.0), (Direction::Left, -1.0)] {
            let rate = sign * 0.04 / 640.0;
            let expected_s = rate * (u0 + 0.5 - 320.0) / (1.0 + rate * 400.0 * SPEED_M_S / 8.0);
            let rolling = RollingCamera {
                camera: &camera,
                shutter: Shutter { delay_s: 7.0, readout_s: 0.04, direction },
                twist_per_s: Vector6::new(SPEED_M_S, 0.0, 0.0, 0.0, 0.0, 0.0),
                pose: Isometry3::identity(),
            };
            let (_, time_s) = rolling.unroll(&[[2.0, 0.5, 8.0]], &[0.0])[0];
            assert!((time_s - expected_s).abs() < 1e-8, "{time_s} {expected_s}");
        }
    }
}
