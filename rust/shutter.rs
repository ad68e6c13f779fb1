//! When each line of a picture is exposed.

use crate::error::{Error, Result};

/// The way in which a shutter rolls over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// From the uppermost row.
    #[default]
    Down,
    /// From the lowest row.
    Up,
    /// From the leftmost column.
    Right,
    /// From the rightmost column.
    Left,
}

/// A camera's clock and shutter. Times are seconds from a moment that the user of a shutter chooses: in a synthetic
/// world from the middle of the sweep, which is what the picture's stamp says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// When the reading of the first line begins.
    pub delay_s: f64,
    /// From the first line to the last; 0 is a global shutter.
    pub readout_s: f64,
    /// The way in which it rolls.
    pub direction: Direction,
}

impl Shutter {
    /// The number of lines that are exposed one after another; a global shutter exposes the picture as one line.
    pub fn num_lines(&self, [width, height]: [usize; 2]) -> usize {
        match self.direction {
            _ if self.readout_s == 0.0 => 1,
            Direction::Down | Direction::Up => height,
            Direction::Right | Direction::Left => width,
        }
    }

    /// The place of a pixel's line in the order of reading.
    pub fn line(&self, [u, v]: [usize; 2], [width, height]: [usize; 2]) -> usize {
        match self.direction {
            _ if self.readout_s == 0.0 => 0,
            Direction::Down => v,
            Direction::Up => height - 1 - v,
            Direction::Right => u,
            Direction::Left => width - 1 - u,
        }
    }

    /// When each line is exposed, in the order of reading.
    pub fn line_times_s(&self, size: [usize; 2]) -> Vec<f64> {
        let count = self.num_lines(size) as f64;
        (0..self.num_lines(size))
            .map(|line| self.delay_s + self.readout_s * (line as f64 + 0.5) / count)
            .collect()
    }

    /// When a place in the picture is exposed, also between the middles of two lines; beyond the picture, as at its border.
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

    /// The same shutter with times from the exposure of its middle line.
    pub fn around_its_middle(self) -> Self {
        Self { delay_s: -0.5 * self.readout_s, ..self }
    }

    /// Refuses a shutter that cannot be.
    pub(crate) fn check(&self) -> Result<()> {
        if self.delay_s.is_finite() && self.readout_s.is_finite() && self.readout_s >= 0.0 {
            return Ok(());
        }
        Err(Error::Input(format!("rig: {self:?} cannot be")))
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
