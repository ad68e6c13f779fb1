//! Compensation of a rolling shutter: points where the LiDAR would have seen them when their line was exposed.
//!
//! A LiDAR that moves with the twist `V` sees a point, which lies at `p` when the middle line is exposed, `s` seconds
//! later at `exp(-s V) p`. The line on which it then lies tells `s`, and `s` where it lies: a fixed point.

use nalgebra::{Isometry3, Point3, Vector6};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::se3::exp;
use crate::shutter::Shutter;

/// The line of a point is known if its time changes by less than this share of a line's.
const SETTLED_LINES: f64 = 0.01;
/// A point whose line is not found in so many steps passes the camera about as fast as the shutter rolls.
const MAX_STEPS: usize = 10;
/// Points that one task moves.
const CHUNK: usize = 4096;

/// A camera that moves with a LiDAR while its shutter rolls.
pub struct Rolling<'a> {
    /// Its lens and the size of its picture.
    pub camera: &'a Camera,
    /// Its shutter; when the first line is read does not count.
    pub shutter: Shutter,
    /// The motion of the LiDAR, metres and radians a second in its own frame.
    pub twist_per_s: Vector6<f64>,
    /// `T_camera_lidar`.
    pub pose: Isometry3<f64>,
}

impl Rolling<'_> {
    /// Moves points (LiDAR frame, metres), each from the moment at which it is seen to that at which its line is
    /// exposed. Times are seconds from the exposure of the middle line.
    ///
    /// Beyond the picture, lines are those at its border. A point that the lens does not show is seen with the middle
    /// line.
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
        // From the middle line, so that nothing depends on where a point has been moved before.
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
    use crate::shutter::Direction;

    const SIZE: [usize; 2] = [640, 480];
    const SPEED_M_S: f64 = 10.0;

    fn camera() -> Camera {
        let k = [[400.0, 0.0, 319.5], [0.0, 400.0, 239.5], [0.0, 0.0, 1.0]];
        Camera::new("plumb_bob", (SIZE[0], SIZE[1]), k, &[]).expect("a camera")
    }

    /// A camera in the LiDAR's place that slides to its right.
    fn sliding(camera: &Camera, direction: Direction) -> Rolling<'_> {
        Rolling {
            camera,
            shutter: Shutter { delay_s: 7.0, readout_s: 0.04, direction },
            twist_per_s: Vector6::new(SPEED_M_S, 0.0, 0.0, 0.0, 0.0, 0.0),
            pose: Isometry3::identity(),
        }
    }

    #[test]
    fn a_pole_that_is_passed_leans_by_speed_times_time() {
        let (camera, depth_m) = (camera(), 8.0);
        let pole: Vec<[f32; 3]> = (0..9).map(|i| [1.0, i as f32 - 4.0, depth_m as f32]).collect();
        for (direction, sign) in [(Direction::Down, 1.0), (Direction::Up, -1.0)] {
            for (point, (moved, time_s)) in
                pole.iter().zip(sliding(&camera, direction).unroll(&pole, &[0.0; 9]))
            {
                // Rows do not change while it slides: 400 pixels times y over the depth from the middle row.
                let row = 239.5 + 400.0 * f64::from(point[1]) / depth_m;
                let expected_s = sign * 0.04 * ((row + 0.5) / 480.0 - 0.5);
                assert!((time_s - expected_s).abs() < 1e-12, "{time_s} {expected_s}");
                assert!((f64::from(moved[0]) - (1.0 - SPEED_M_S * expected_s)).abs() < 1e-6);
                assert_eq!([moved[1], moved[2]], [point[1], point[2]]);
            }
        }
    }

    #[test]
    fn columns_are_solved_for_where_the_motion_changes_them() {
        // u + s k = u0 and s = r ((u + 0.5) / w - 0.5), with k pixels a second, have one solution.
        let (camera, point) = (camera(), [2.0f32, 0.5, 8.0]);
        let u0 = 319.5 + 400.0 * 2.0 / 8.0;
        for (direction, sign) in [(Direction::Right, 1.0), (Direction::Left, -1.0)] {
            let rate = sign * 0.04 / 640.0;
            let expected_s = rate * (u0 + 0.5 - 320.0) / (1.0 + rate * 400.0 * SPEED_M_S / 8.0);
            let (_, time_s) = sliding(&camera, direction).unroll(&[point], &[0.0])[0];
            assert!((time_s - expected_s).abs() < 1e-8, "{time_s} {expected_s}");
        }
    }

    #[test]
    fn points_are_moved_from_their_own_moment_and_not_twice() {
        let camera = camera();
        let mut rolling = sliding(&camera, Direction::Right);
        rolling.twist_per_s = Vector6::new(8.0, 0.5, 12.0, 0.1, 0.4, -0.2);
        let points = [[2.0, 0.5, 8.0], [-3.0, 1.0, 20.0], [0.0, 0.0, -5.0], [90.0, 0.0, 8.0]];
        let once = rolling.unroll(&points, &[0.0; 4]);
        let (moved, times_s): (Vec<_>, Vec<_>) = once.iter().copied().unzip();
        for ((again, again_s), (first, first_s)) in rolling.unroll(&moved, &times_s).iter().zip(&once) {
            assert!((again_s - first_s).abs() < 1e-6);
            assert!((Point3::from(*again) - Point3::from(*first)).norm() < 2e-5);
        }
        assert_eq!(once[2], (points[2], 0.0), "behind the camera");
        assert_eq!(once[3].1, 0.02, "beyond the picture, as at its border");
    }
}
