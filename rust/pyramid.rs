//! Class shares of label images: what one-hot label maps become when they are averaged over blocks.

use nalgebra::{Point2, Vector2};

use crate::label_image::LabelImage;
use crate::observation::NO_CLASS;

/// The shares of one picture at one level, to be sampled: for each block, the classes that it holds.
#[derive(Clone, Debug)]
pub struct ShareMap {
    factor: usize,
    columns: usize,
    rows: usize,
    /// Where the entries of each block begin, row by row; one more for the end.
    starts: Vec<u32>,
    entries: Vec<Share>,
}

/// A class of a block, and how much of the block it has, in 1/255.
#[derive(Clone, Copy, Debug)]
struct Share {
    class: u8,
    amount: u8,
}

impl ShareMap {
    /// Averages the classes of blocks of `factor x factor` pixels.
    pub fn new(image: &LabelImage<u8>, num_classes: usize, factor: usize) -> Self {
        let (columns, rows) = (image.width / factor, image.height / factor);
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for block in class_shares(image, num_classes, factor).chunks_exact(num_classes) {
            let shares = block.iter().enumerate().filter(|&(_, &amount)| amount > 0);
            entries.extend(shares.map(|(class, &amount)| Share { class: class as u8, amount }));
            starts.push(entries.len() as u32);
        }
        Self { factor, columns, rows, starts, entries }
    }

    /// The shares at a pixel of the full-resolution picture, bilinear between the centres of blocks, and continued
    /// beyond the outermost ones.
    #[inline]
    pub fn at(&self, pixel: &Point2<f64>) -> Sampled<'_> {
        let (column, right) = Self::between(pixel.x, self.factor, self.columns);
        let (row, down) = Self::between(pixel.y, self.factor, self.rows);
        let (next_column, next_row) = ((column + 1).min(self.columns - 1), (row + 1).min(self.rows - 1));
        let block = |row: usize, column: usize| {
            let index = row * self.columns + column;
            &self.entries[self.starts[index] as usize..self.starts[index + 1] as usize]
        };
        let corners = [
            block(row, column),
            block(row, next_column),
            block(next_row, column),
            block(next_row, next_column),
        ];
        if let [[a], [b], [c], [d]] = corners
            && [b, c, d].iter().all(|share| share.class == a.class)
            && [a, b, c, d].iter().all(|share| share.amount == u8::MAX)
        {
            return Sampled::Uniform(a.class);
        }
        let (r, d) = (right.unwrap_or(0.0), down.unwrap_or(0.0));
        let weights = [(1.0 - r) * (1.0 - d), r * (1.0 - d), (1.0 - r) * d, r * d];
        let amount = |corner: &[Share]| corner.iter().map(|share| u32::from(share.amount)).sum::<u32>();
        let total = (0..4).map(|i| weights[i] * f64::from(amount(corners[i]))).sum::<f64>() / 255.0;
        Sampled::Mixed(Shares {
            corners,
            right: r,
            down: d,
            weights,
            total,
            moves: (right.is_some(), down.is_some()),
            per_pixel: 1.0 / self.factor as f64,
        })
    }

    /// The block before a pixel along one axis, and the share of the way to the next; `None` beyond the outermost.
    #[inline]
    fn between(pixel: f64, factor: usize, count: usize) -> (usize, Option<f64>) {
        let place = (pixel + 0.5) / factor as f64 - 0.5;
        let last = (count - 1) as f64;
        if place > 0.0 && place < last {
            (place as usize, Some(place.fract()))
        } else {
            (if place > 0.0 { count - 1 } else { 0 }, None)
        }
    }
}

/// What lies around a pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sampled<'a> {
    /// One class, as nearly everywhere: nothing changes when the pixel moves.
    Uniform(u8),
    /// Several classes, or pixels without one.
    Mixed(Shares<'a>),
}

impl Sampled<'_> {
    /// The share that is labelled.
    #[inline]
    pub fn total(&self) -> f64 {
        match self {
            Self::Uniform(_) => 1.0,
            Self::Mixed(shares) => shares.total,
        }
    }

    /// Adds `weight` to the classes, in proportion to their shares; nothing if none is labelled.
    #[inline]
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
    corners: [&'a [Share]; 4],
    right: f64,
    down: f64,
    weights: [f64; 4],
    total: f64,
    /// Whether the shares change along each axis.
    moves: (bool, bool),
    per_pixel: f64,
}

impl Shares<'_> {
    #[inline]
    fn add_to(&self, classes: &mut [f64], weight: f64) {
        let scale = weight / (255.0 * self.total);
        for (corner, weight) in self.corners.iter().zip(self.weights) {
            for share in *corner {
                classes[usize::from(share.class)] += weight * scale * f64::from(share.amount);
            }
        }
    }

    /// The slope, per pixel, of `sum_y values[y] share_y / sum_y share_y`; some share has to be labelled.
    #[inline]
    pub fn slope(&self, values: &[f64]) -> Vector2<f64> {
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

/// Shares of each class in blocks of `factor x factor` pixels, `rows x columns x num_classes`, as bytes of 1/255.
///
/// Only whole blocks count, so that block `(i, j)` is centred on pixel `factor * (i + 1/2) - 1/2` exactly; pixels
/// without a class take their share but give it to none.
pub fn class_shares(image: &LabelImage<u8>, num_classes: usize, factor: usize) -> Vec<u8> {
    let (columns, rows) = (image.width / factor, image.height / factor);
    let scale = 255.0 / (factor * factor) as f32;
    let mut shares = Vec::with_capacity(rows * columns * num_classes);
    let mut counts = vec![0u32; columns * num_classes];
    for row in 0..rows {
        counts.fill(0);
        for v in row * factor..(row + 1) * factor {
            let line = &image.ids[v * image.width..][..columns * factor];
            for (block, counts) in line.chunks_exact(factor).zip(counts.chunks_exact_mut(num_classes)) {
                for &id in block.iter().filter(|&&id| id != NO_CLASS) {
                    counts[usize::from(id)] += 1;
                }
            }
        }
        shares.extend(counts.iter().map(|&n| (n as f32 * scale).round() as u8));
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_count_each_class_in_each_whole_block() {
        let ids = vec![0, 1, 1, 1, 9, 0, NO_CLASS, 1, 1, 9];
        let image = LabelImage { width: 5, height: 2, ids };
        assert_eq!(class_shares(&image, 2, 2), [128, 64, 0, 255]);
    }

    #[test]
    fn shares_are_bilinear_between_the_centres_of_blocks() {
        let ids = vec![0, 0, 1, 1, 0, 0, 1, 1, 0, 0, NO_CLASS, 2, 0, 0, 2, 2];
        let map = ShareMap::new(&LabelImage { width: 4, height: 4, ids }, 3, 2);
        let shares = |u: f64, v: f64| {
            let mut classes = [0.0; 3];
            let sampled = map.at(&Point2::new(u, v));
            sampled.add_to(&mut classes, 1.0);
            (classes, sampled.total())
        };
        assert_eq!(shares(0.5, 0.5), ([1.0, 0.0, 0.0], 1.0));
        assert_eq!(shares(-3.0, 9.0), ([1.0, 0.0, 0.0], 1.0));
        let (classes, total) = shares(1.5, 1.5);
        // A quarter of one of the four blocks has no class.
        let three_quarters = 191.0 / 255.0;
        assert!((total - (3.0 + three_quarters) / 4.0).abs() < 1e-12);
        assert!((classes[0] - 2.0 / (3.0 + three_quarters)).abs() < 1e-12);
        assert!((classes.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
