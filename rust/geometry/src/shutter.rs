//! Exposure times of the lines of an image.

use crate::Invalid;

/// The direction in which a shutter rolls over the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// From the first row to the last.
    #[default]
    Down,
    /// From the last row to the first.
    Up,
    /// From the first column to the last.
    Right,
    /// From the last column to the first.
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
    /// Order in which the lines are read.
    pub direction: Direction,
}

impl Shutter {
    /// Number of lines that are exposed one after another; a global shutter exposes the image as one line.
    #[inline]
    pub fn num_lines(&self, [width, height]: [usize; 2]) -> usize {
        match self.direction {
            _ if self.readout_s == 0.0 => 1,
            Direction::Down | Direction::Up => height,
            Direction::Right | Direction::Left => width,
        }
    }

    /// Index of a pixel's line in readout order.
    #[inline]
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
    #[inline]
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

    /// Returns the same shutter with times relative to the exposure of its middle line.
    pub fn around_its_middle(self) -> Self {
        Self { delay_s: -0.5 * self.readout_s, ..self }
    }

    /// Checks that all times are possible.
    pub fn check(&self) -> Result<(), Invalid> {
        if self.delay_s.is_finite() && self.readout_s.is_finite() && self.readout_s >= 0.0 {
            return Ok(());
        }
        Err(Invalid(format!("rig: {self:?} is impossible")))
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
}
