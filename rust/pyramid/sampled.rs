//! The class shares around a pixel, and their derivatives as the pixel moves.

use nalgebra::Vector2;

use crate::classes::{NO_CLASS, Share};

/// The neighbourhood of a pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sampled<C> {
    /// One class, as almost everywhere: nothing changes as the pixel moves.
    Uniform(u8),
    /// Several classes, or pixels without one.
    Mixed(Shares<C>),
}

impl<C: Corners> Sampled<C> {
    #[inline]
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
    #[inline(always)]
    pub fn add_to(&self, classes: &mut [f64], weight: f64) {
        match self {
            Self::Uniform(class) => classes[usize::from(*class)] += weight,
            Self::Mixed(shares) if shares.total > 0.0 => shares.add_to(classes, weight),
            Self::Mixed(_) => {}
        }
    }
}

/// The shares of the classes in four blocks, in 1/255.
pub trait Corners: Copy {
    /// Adds the shares to the classes, with a weight for each block.
    fn add_to(&self, classes: &mut [f64], weights: [f64; 4]);

    /// The sum of the shares of each block, multiplied by the values of their classes.
    fn sums(&self, values: &[f64]) -> [f64; 4];
}

/// The shares of the classes that occur.
impl Corners for [&[Share]; 4] {
    #[inline(always)]
    fn add_to(&self, classes: &mut [f64], weights: [f64; 4]) {
        for (corner, weight) in self.iter().zip(weights) {
            for share in *corner {
                classes[usize::from(share.class)] += weight * f64::from(share.amount);
            }
        }
    }

    #[inline(always)]
    fn sums(&self, values: &[f64]) -> [f64; 4] {
        let sum = |corner: &[Share]| {
            corner.iter().map(|share| values[usize::from(share.class)] * f64::from(share.amount)).sum()
        };
        self.map(sum)
    }
}

/// The shares of all classes, and zeros after the last.
impl Corners for [&[u8]; 4] {
    #[inline(always)]
    fn add_to(&self, classes: &mut [f64], [of_a, of_b, of_c, of_d]: [f64; 4]) {
        let [a, b, c, d] = self;
        let corners = a.iter().zip(*b).zip(c.iter().zip(*d));
        for (sum, ((&a, &b), (&c, &d))) in classes.iter_mut().zip(corners) {
            let above = of_a * f64::from(a) + of_b * f64::from(b);
            *sum += above + (of_c * f64::from(c) + of_d * f64::from(d));
        }
    }

    #[inline(always)]
    fn sums(&self, values: &[f64]) -> [f64; 4] {
        let sum = |corner: &[u8]| {
            corner.iter().zip(values).map(|(&amount, value)| value * f64::from(amount)).sum::<f64>()
        };
        self.map(sum)
    }
}

/// The same, of a known number of shares: its loops have no branches.
impl<const N: usize> Corners for [&[u8; N]; 4] {
    #[inline(always)]
    fn add_to(&self, classes: &mut [f64], weights: [f64; 4]) {
        let ([a, b, c, d], [of_a, of_b, of_c, of_d]) = (*self, weights);
        let Some(classes) = classes.first_chunk_mut::<N>() else {
            return [&a[..], b, c, d].add_to(classes, weights);
        };
        for class in 0..N {
            let above = of_a * f64::from(a[class]) + of_b * f64::from(b[class]);
            classes[class] += above + (of_c * f64::from(c[class]) + of_d * f64::from(d[class]));
        }
    }

    #[inline(always)]
    fn sums(&self, values: &[f64]) -> [f64; 4] {
        let [a, b, c, d] = *self;
        let Some(values) = values.first_chunk::<N>() else { return [&a[..], b, c, d].sums(values) };
        let mut sums = [0.0; 4];
        for class in 0..N {
            sums[0] += values[class] * NUMBERS[usize::from(a[class])];
            sums[1] += values[class] * NUMBERS[usize::from(b[class])];
            sums[2] += values[class] * NUMBERS[usize::from(c[class])];
            sums[3] += values[class] * NUMBERS[usize::from(d[class])];
        }
        sums
    }
}

/// The number of each byte: where sums run one after the other, a look-up takes less time than a conversion.
static NUMBERS: [f64; 256] = {
    let mut numbers = [0.0; 256];
    let mut byte = 0;
    while byte < 256 {
        numbers[byte] = byte as f64;
        byte += 1;
    }
    numbers
};

/// Shares whose form is known only when they are read.
#[derive(Clone, Copy, Debug)]
pub enum AnyCorners<'a> {
    Sparse([&'a [Share]; 4]),
    Dense([&'a [u8]; 4]),
}

impl Corners for AnyCorners<'_> {
    fn add_to(&self, classes: &mut [f64], weights: [f64; 4]) {
        match self {
            Self::Sparse(corners) => corners.add_to(classes, weights),
            Self::Dense(corners) => corners.add_to(classes, weights),
        }
    }

    fn sums(&self, values: &[f64]) -> [f64; 4] {
        match self {
            Self::Sparse(corners) => corners.sums(values),
            Self::Dense(corners) => corners.sums(values),
        }
    }
}

/// The four blocks around a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Shares<C> {
    pub(super) corners: C,
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

impl<C: Corners> Shares<C> {
    pub fn total(&self) -> f64 {
        self.total
    }

    #[inline(always)]
    fn add_to(&self, classes: &mut [f64], weight: f64) {
        let scale = weight / (255.0 * self.total);
        self.corners.add_to(classes, self.weights.map(|weight| weight * scale));
    }

    /// The gradient, per pixel, of `sum_y values[y] share_y / sum_y share_y`; some share has to be labelled.
    #[inline(always)]
    pub fn gradient(&self, values: &[f64]) -> Vector2<f64> {
        let sums = self.corners.sums(values);
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
