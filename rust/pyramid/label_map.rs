//! How maps of class shares are read between the centres of their blocks.

use nalgebra::Point2;

use super::sampled::{Corners, Sampled, Shares};

/// Label images, averaged over blocks, that can be read between the centres of blocks.
pub trait LabelMap: Copy + Sync {
    type Corners: Corners;

    /// The shares at a pixel of the full-resolution image, bilinear between block centres, and constant beyond the
    /// outermost ones.
    fn at(&self, pixel: &Point2<f64>) -> Sampled<Self::Corners>;

    /// Reads the first byte of the block before a pixel in both rows. Access to pixels is random: short loops of this let
    /// many fetches from memory overlap before [`LabelMap::at`]. A polish on KITTI object takes a tenth less time with it.
    fn touch(&self, pixel: &Point2<f64>) -> u8;
}

/// Where the blocks lie in the image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub blocks_per_pixel: f64,
    pub columns: usize,
    pub rows: usize,
}

/// The blocks around a pixel (above left, above right, below left and below right), and the fraction of the way to the
/// right and down; `None` beyond the outermost blocks.
pub(super) struct Around {
    pub blocks: [usize; 4],
    right: Option<f64>,
    down: Option<f64>,
}

impl Grid {
    #[inline(always)]
    pub fn around(&self, pixel: &Point2<f64>) -> Around {
        let (column, right) = self.between(pixel.x, self.columns);
        let (row, down) = self.between(pixel.y, self.rows);
        let (next_column, next_row) = ((column + 1).min(self.columns - 1), (row + 1).min(self.rows - 1));
        let (above, below) = (row * self.columns, next_row * self.columns);
        let blocks = [above + column, above + next_column, below + column, below + next_column];
        Around { blocks, right, down }
    }

    /// The block before a pixel along one axis, and the fraction of the way to the next; `None` beyond the
    /// outermost.
    #[inline(always)]
    pub fn between(&self, pixel: f64, count: usize) -> (usize, Option<f64>) {
        let place = (pixel + 0.5) * self.blocks_per_pixel - 0.5;
        // Conversions of 32 bits are faster than those of 64, and no image is that wide.
        let last = count as i32 - 1;
        if place > 0.0 && place < f64::from(last) {
            let before = place as i32;
            (before as usize, Some(place - f64::from(before)))
        } else {
            (if place > 0.0 { count - 1 } else { 0 }, None)
        }
    }

    /// The indices of the blocks before a pixel in both rows.
    #[inline(always)]
    pub fn before(&self, pixel: &Point2<f64>) -> [usize; 2] {
        let ((column, _), (row, _)) = (self.between(pixel.x, self.columns), self.between(pixel.y, self.rows));
        [row, (row + 1).min(self.rows - 1)].map(|row| row * self.columns + column)
    }

    /// Shares between four blocks, with the labelled share of each.
    #[inline(always)]
    pub fn shares<C>(&self, Around { right, down, .. }: Around, corners: C, amounts: [f64; 4]) -> Shares<C> {
        let (r, d) = (right.unwrap_or(0.0), down.unwrap_or(0.0));
        let weights = [(1.0 - r) * (1.0 - d), r * (1.0 - d), (1.0 - r) * d, r * d];
        let total = (0..4).map(|i| weights[i] * amounts[i]).sum::<f64>() * (1.0 / 255.0);
        Shares {
            corners,
            right: r,
            down: d,
            weights,
            amounts,
            total,
            moves: (right.is_some(), down.is_some()),
            per_pixel: self.blocks_per_pixel,
        }
    }
}

/// The blocks of a map, each with a known number of shares, so that loops over them have no branches.
#[derive(Clone, Copy, Debug)]
pub struct DenseMap<'a, const N: usize> {
    grid: Grid,
    blocks: &'a [[u8; N]],
}

impl<'a, const N: usize> DenseMap<'a, N> {
    pub(super) fn new(grid: Grid, shares: &'a [u8]) -> Self {
        Self { grid, blocks: shares.as_chunks().0 }
    }
}

impl<'a, const N: usize> LabelMap for DenseMap<'a, N> {
    type Corners = [&'a [u8; N]; 4];

    #[inline(always)]
    fn at(&self, pixel: &Point2<f64>) -> Sampled<Self::Corners> {
        let around = self.grid.around(pixel);
        let [a, b, c, d] = around.blocks;
        let corners = [&self.blocks[a], &self.blocks[b], &self.blocks[c], &self.blocks[d]];
        let [a, b, c, d] = corners;
        let amounts = [amount(a), amount(b), amount(c), amount(d)];
        Sampled::Mixed(self.grid.shares(around, corners, amounts))
    }

    #[inline(always)]
    fn touch(&self, pixel: &Point2<f64>) -> u8 {
        let [above, below] = self.grid.before(pixel);
        self.blocks[above][0] ^ self.blocks[below][0]
    }
}

/// The sum of shares.
#[inline(always)]
pub(super) fn amount(shares: &[u8]) -> f64 {
    let (words, rest) = shares.as_chunks();
    let of_words: u32 = words.iter().map(|word| sum_of_bytes(u64::from_le_bytes(*word))).sum();
    f64::from(of_words + rest.iter().map(|&share| u32::from(share)).sum::<u32>())
}

/// The sum of the eight bytes of a word: of each two, then of all four sums by one multiplication.
#[inline(always)]
fn sum_of_bytes(word: u64) -> u32 {
    const EVEN: u64 = 0x00ff_00ff_00ff_00ff;
    let pairs = (word & EVEN) + (word >> 8 & EVEN);
    (pairs.wrapping_mul(0x0001_0001_0001_0001) >> 48) as u32
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::share_map::ShareMap;
    use super::*;
    use crate::classes::NO_CLASS;
    use crate::label_image::LabelImage;

    #[test]
    fn maps_of_eight_levels_are_read_alike_in_both_forms() {
        // Some pixels have no level, so that blocks differ in their amounts.
        let ids =
            (0..96).map(|pixel| if pixel % 11 == 0 { NO_CLASS } else { (5 * pixel % 8) as u8 }).collect();
        let image = Arc::new(LabelImage { width: 12, height: 8, ids });
        for map in [ShareMap::of_levels(&image, 2), ShareMap::blurred(&image, 0.8)] {
            let dense = map.dense::<8>().expect("eight levels");
            assert!(map.dense::<16>().is_none());
            for (u, v) in [(-1.0, 0.0), (0.7, 7.4), (3.2, 2.9), (10.6, 5.5), (12.0, 9.0)] {
                let pixel = Point2::new(u, v);
                let (Sampled::Mixed(known), Sampled::Mixed(any)) = (dense.at(&pixel), (&map).at(&pixel))
                else {
                    panic!("dense blocks are never of one class")
                };
                assert_eq!((known.total(), dense.touch(&pixel)), (any.total(), (&map).touch(&pixel)));
                // A cue may have fewer classes than a block has shares.
                for num_classes in [5, 8, 9] {
                    let values: Vec<f64> = (0..num_classes).map(|class| (class as f64).cos()).collect();
                    assert_eq!(known.gradient(&values), any.gradient(&values));
                    let mut sums = [vec![0.25; num_classes], vec![0.25; num_classes]];
                    Sampled::Mixed(known).add_to(&mut sums[0], 0.7);
                    Sampled::Mixed(any).add_to(&mut sums[1], 0.7);
                    assert_eq!(sums[0], sums[1]);
                }
            }
        }
    }
}
