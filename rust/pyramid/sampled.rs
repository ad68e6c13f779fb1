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

/// The shares of the classes in four blocks.
#[derive(Clone, Copy, Debug)]
pub(super) enum Corners<'a> {
    /// Of the classes that occur.
    Sparse([&'a [Share]; 4]),
    /// Of all classes, in 1/255.
    Dense([&'a [u8]; 4]),
}

/// The four blocks around a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Shares<'a> {
    pub(super) corners: Corners<'a>,
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
        let weights = self.weights.map(|weight| weight * scale);
        match self.corners {
            Corners::Sparse(corners) => {
                for (corner, weight) in corners.iter().zip(weights) {
                    for share in *corner {
                        classes[usize::from(share.class)] += weight * f64::from(share.amount);
                    }
                }
            }
            Corners::Dense([a, b, c, d]) => {
                let [of_a, of_b, of_c, of_d] = weights;
                let corners = a.iter().zip(b).zip(c.iter().zip(d));
                for (sum, ((&a, &b), (&c, &d))) in classes.iter_mut().zip(corners) {
                    let above = of_a * f64::from(a) + of_b * f64::from(b);
                    *sum += above + (of_c * f64::from(c) + of_d * f64::from(d));
                }
            }
        }
    }

    /// The gradient, per pixel, of `sum_y values[y] share_y / sum_y share_y`; some share has to be labelled.
    pub fn gradient(&self, values: &[f64]) -> Vector2<f64> {
        let sums = match self.corners {
            Corners::Sparse(corners) => corners.map(|corner| {
                corner.iter().map(|share| values[usize::from(share.class)] * f64::from(share.amount)).sum()
            }),
            Corners::Dense(corners) => corners.map(|corner| {
                corner.iter().zip(values).map(|(&amount, value)| value * f64::from(amount)).sum::<f64>()
            }),
        };
        // The sum over classes, and the labelled share, of each corner.
        let sums: [Vector2<f64>; 4] = std::array::from_fn(|i| Vector2::new(sums[i], self.amounts[i]));
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
