//! Exposure times of image lines, and compensation of a rolling shutter: points are moved to where the LiDAR would
//! have seen them when their line was exposed.
//!
//! A LiDAR that moves with the twist `V` sees a point, at `p` when the middle line is exposed, at `exp(-s V) p`
//! after `s` seconds. The line that it projects to gives `s`, and `s` gives its position: a fixed point.

use nalgebra::{Isometry3, Point3, Vector6};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::se3::exp;

/// The direction in which a shutter rolls over the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    #[default]
    Down,
    Up,
    Right,
    Left,
}

/// Shutter timing of a camera. Times are seconds from a moment that the user of a shutter chooses: in a synthetic
/// world the middle of the sweep, which is the stamp of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// Start of the readout of the first line.
    pub delay_s: f64,
    /// Time from the first line to the last; 0 is a global shutter.
    pub readout_s: f64,
    pub direction: Direction,
}

impl Shutter {
    /// Number of lines that are exposed one after another; a global shutter exposes the image as one line.
    pub fn num_lines(&self, [width, height]: [usize; 2]) -> usize {
        match self.direction {
            _ if self.readout_s == 0.0 => 1,
            Direction::Down | Direction::Up => height,
            Direction::Right | Direction::Left => width,
        }
    }

    /// Index of a pixel's line in readout order.
    pub fn line(&self, [u, v]: [usize; 2], [width, height]: [usize; 2]) -> usize {
        match self.direction {
            _ if self.readout_s == 0.0 => 0,
            Direction::Down => v,
            Direction::Up => height - 1 - v,
            Direction::Right => u,
            Direction::Left => width - 1 - u,
        }
    }

    /// Exposure time of each line, in readout order.
    pub fn line_times_s(&self, size: [usize; 2]) -> Vec<f64> {
        let count = self.num_lines(size) as f64;
        (0..self.num_lines(size))
            .map(|line| self.delay_s + self.readout_s * (line as f64 + 0.5) / count)
            .collect()
    }

    /// Exposure time of a place in the image, interpolated between the middles of two lines and constant beyond the
    /// image.
    pub fn time_at_s(&self, [u, v]: [f64; 2], [width, height]: [usize; 2]) -> f64 {
        let (width, height) = (width as f64, height as f64);
        let share = match self.direction {
            Direction::Down => (v + 0.5) / height,
            Direction::Up => (height - 0.5 - v) / height,
            Direction::Right => (u + 0.5) / width,
            Direction::Left => (width - 0.5 - u) / width,
        };
        self.delay_s + self.readout_s * share.clamp(0.0, 1.0)
    }

    /// The same shutter with times relative to the exposure of its middle line.
    pub fn around_its_middle(self) -> Self {
        Self { delay_s: -0.5 * self.readout_s, ..self }
    }

    pub(crate) fn check(&self) -> Result<()> {
        if self.delay_s.is_finite() && self.readout_s.is_finite() && self.readout_s >= 0.0 {
            return Ok(());
        }
        Err(Error::Input(format!("rig: {self:?} is impossible")))
    }
}

/// The line of a point has converged if its time changes by less than this fraction of a line's.
const SETTLED_LINES: f64 = 0.01;
/// A point whose line is not found within this many steps passes the camera about as fast as the shutter rolls.
const MAX_STEPS: usize = 10;
/// Number of points that one task moves.
const CHUNK: usize = 4096;

/// A camera with a rolling shutter that moves with a LiDAR.
pub struct Rolling<'a> {
    /// Lens and image size.
    pub camera: &'a Camera,
    /// Shutter of the camera; its delay is ignored.
    pub shutter: Shutter,
    /// Motion of the LiDAR, metres and radians per second in its own frame.
    pub twist_per_s: Vector6<f64>,
    pub pose: Isometry3<f64>,
}

impl Rolling<'_> {
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

    const SIZE: [usize; 2] = [4, 3];

    #[test]
    fn lines_are_read_one_after_another() {
        let of = |direction| Shutter { delay_s: 0.1, readout_s: 0.6, direction };
        for (direction, pixels) in [
            (Direction::Down, [[2, 0], [2, 1], [2, 2]]),
            (Direction::Up, [[2, 2], [2, 1], [2, 0]]),
            (Direction::Right, [[0, 1], [1, 1], [2, 1]]),
            (Direction::Left, [[3, 1], [2, 1], [1, 1]]),
        ] {
            let times = of(direction).line_times_s(SIZE);
            let step = 0.6 / of(direction).num_lines(SIZE) as f64;
            for (place, pixel) in pixels.into_iter().enumerate() {
                assert_eq!(of(direction).line(pixel, SIZE), place);
                let expected = 0.1 + step * (place as f64 + 0.5);
                assert!((times[place] - expected).abs() < 1e-12);
                assert!((of(direction).time_at_s(pixel.map(|x| x as f64), SIZE) - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_global_shutter_exposes_everything_at_once() {
        let shutter = Shutter { delay_s: -0.02, ..Shutter::default() };
        assert_eq!(shutter.line_times_s(SIZE), [-0.02]);
        assert_eq!(shutter.line([3, 2], SIZE), 0);
        assert_eq!(shutter.time_at_s([3.0, 2.0], SIZE), -0.02);
    }

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
            let rolling = Rolling {
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
