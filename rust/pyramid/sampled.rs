//! The class shares around a pixel, and their derivatives as the pixel moves.

use nalgebra::Vector2;

use crate::classes::{NO_CLASS, Share};

/// The neighbourhood of a pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sampled<'a> {
    /// One class, as almost everywhere: nothing changes as the pixel moves.
    Uniform(u8),
    /// Several classes, or pixels without one.
    Mixed(Shares<'a>),
}

impl Sampled<'_> {
    pub fn total(&self) -> f64 {
        match self {
            Self::Uniform(_) => 1.0,
            Self::Mixed(shares) => shares.total,
        }
    }

    /// The class with the largest share; `None` if none is labelled.
    pub fn largest(&self) -> Option<u8> {
        match self {
            Self::Uniform(class) => Some(*class),
            Self::Mixed(shares) if shares.total > 0.0 => {
                let mut classes = [0.0; NO_CLASS as usize];
                shares.add_to(&mut classes, 1.0);
                classes
                    .iter()
                    .zip(0u8..)
                    .max_by(|a, b| a.0.total_cmp(b.0).then(b.1.cmp(&a.1)))
                    .map(|(_, class)| class)
            }
            Self::Mixed(_) => None,
        }
    }

    /// Adds `weight` to the classes, in proportion to their shares; nothing if none is labelled.
    pub fn add_to(&self, classes: &mut [f64], weight: f64) {
        match self {
            Self::Uniform(class) => classes[usize::from(*class)] += weight,
            Self::Mixed(shares) if shares.total > 0.0 => shares.add_to(classes, weight),
            Self::Mixed(_) => {}
        }
    }
}

/// The four blocks around a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Shares<'a> {
    pub(super) corners: [&'a [Share]; 4],
    pub(super) right: f64,
    pub(super) down: f64,
    pub(super) weights: [f64; 4],
    /// Labelled share of each block, in 1/255.
    pub(super) amounts: [f64; 4],
    pub(super) total: f64,
    /// Whether the shares change along each axis.
    pub(super) moves: (bool, bool),
    pub(super) per_pixel: f64,
}

impl Shares<'_> {
    pub fn total(&self) -> f64 {
        self.total
    }

    fn add_to(&self, classes: &mut [f64], weight: f64) {
        let scale = weight / (255.0 * self.total);
        for (corner, weight) in self.corners.iter().zip(self.weights) {
            for share in *corner {
                classes[usize::from(share.class)] += weight * scale * f64::from(share.amount);
            }
        }
    }

    /// Calls `with` with the shares of each of the four blocks and their factors: for the shares of the classes
    /// under the pixel, and for their slopes, per pixel, to the right and down. Some share has to be labelled.
    ///
    /// With weights `w` and labelled shares `a` of the blocks, `share_y = sum w a_y / T` and
    /// `d share_y = sum (dw - w dT / T) a_y / T`, where `T = sum w a`.
    pub fn for_blocks(&self, mut with: impl FnMut(&[Share], [f64; 3])) {
        let (r, d) = (self.right, self.down);
        let total = 1.0 / (255.0 * self.total);
        let by = |moves: bool| if moves { self.per_pixel * total } else { 0.0 };
        let (by_right, by_down) = (by(self.moves.0), by(self.moves.1));
        let right = [-(1.0 - d), 1.0 - d, -d, d].map(|slope| slope * by_right);
        let down = [-(1.0 - r), -r, 1.0 - r, r].map(|slope| slope * by_down);
        let of_total = |slopes: &[f64; 4]| (0..4).map(|i| slopes[i] * self.amounts[i]).sum::<f64>() * total;
        let (total_right, total_down) = (of_total(&right), of_total(&down));
        for i in 0..4 {
            let weight = self.weights[i];
            let slopes = [right[i] - weight * total_right, down[i] - weight * total_down];
            with(self.corners[i], [weight * total, slopes[0], slopes[1]]);
        }
    }

    /// The gradient, per pixel, of `sum_y values[y] share_y / sum_y share_y`; some share has to be labelled.
    pub fn gradient(&self, values: &[f64]) -> Vector2<f64> {
        // The sum over classes, and the labelled share, of each corner.
        let sums = self.corners.map(|corner| {
            corner.iter().fold(Vector2::zeros(), |sum, share| {
                sum + Vector2::new(values[usize::from(share.class)], 1.0) * f64::from(share.amount)
            })
        });
        let [a, b, c, d] = sums;
        let (above, below) = (a.lerp(&b, self.right), c.lerp(&d, self.right));
        let (left, right) = (a.lerp(&c, self.down), b.lerp(&d, self.down));
        let middle = above.lerp(&below, self.down);
        let along =
            |change: Vector2<f64>| (change.x - change.y * middle.x / middle.y) / middle.y * self.per_pixel;
        Vector2::new(
            if self.moves.0 { along(right - left) } else { 0.0 },
            if self.moves.1 { along(below - above) } else { 0.0 },
        )
    }
}
