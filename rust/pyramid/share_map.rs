//! Class shares of label images: one-hot label maps averaged over blocks.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Point2;

use super::averaging::{
    Averaged, Dense, FAINT, WHOLE, amounts, averaged_classes, averaged_levels, averaged_shares,
    blurred_classes,
};
use super::label_map::{DenseMap, Grid, LabelMap, amount};
use super::sampled::{AnyCorners, Sampled};
use crate::classes::{ClassShares, NO_CLASS, Share};
use crate::label_image::LabelImage;

#[derive(Clone, Debug)]
pub struct ShareMap {
    grid: Grid,
    blocks: Blocks,
}

/// The classes in each block, row by row.
#[derive(Clone, Debug)]
enum Blocks {
    /// Blocks of one pixel.
    Pixels(Arc<LabelImage<u8>>),
    /// Blocks of one pixel, and the class of those with full weight, else [`NO_CLASS`].
    Banded { image: Arc<LabelImage<u8>>, only: Vec<u8> },
    /// Blocks of several pixels, or pixels of several classes, most of which have few: see [`Averaged`].
    Shares {
        shares: ClassShares,
        only: Vec<u8>,
        /// Sums of the shares, which are needed more often than these.
        amounts: Vec<u16>,
    },
    /// Blocks that have many of a few classes: `width` shares of each, in 1/255. They lie side by side, since access is
    /// random, and a fetch takes longer than the sums.
    Dense { shares: Vec<u8>, width: usize, only: Vec<u8> },
}

impl Blocks {
    /// The shares of the classes in four blocks, and the labelled share of each block, in 1/255.
    #[inline(always)]
    fn corners(&self, around: [usize; 4]) -> (AnyCorners<'_>, [f64; 4]) {
        let whole = |class: u8| of_class(&WHOLE, class);
        match self {
            Self::Pixels(image) => sparse(around, |index| whole(image.ids[index])),
            Self::Banded { image, only } => sparse(around, |index| {
                let table = if only[index] == NO_CLASS { &FAINT } else { &WHOLE };
                of_class(table, image.ids[index])
            }),
            Self::Shares { shares, only, amounts } => sparse(around, |index| match only[index] {
                NO_CLASS => (shares.at(index), amounts[index]),
                class => whole(class),
            }),
            Self::Dense { shares, width, .. } => {
                let corners = around.map(|index| &shares[index * width..][..*width]);
                (AnyCorners::Dense(corners), corners.map(amount))
            }
        }
    }

    /// Reads the first byte of everything that is looked up of a block.
    fn touch(&self, index: usize) -> u8 {
        match self {
            Self::Pixels(image) => image.ids[index],
            Self::Banded { image, only } => only[index] ^ image.ids[index],
            Self::Shares { shares, only, amounts } => {
                only[index] ^ shares.touch(index) ^ amounts[index] as u8
            }
            Self::Dense { shares, width, .. } => shares[index * width],
        }
    }

    /// The class of each block that has only this class and full weight; otherwise [`NO_CLASS`].
    fn only(&self) -> &[u8] {
        match self {
            Self::Pixels(image) => &image.ids,
            Self::Banded { only, .. } | Self::Shares { only, .. } | Self::Dense { only, .. } => only,
        }
    }

    /// The only class of four blocks with full weight; otherwise [`NO_CLASS`], and always for dense blocks, few of which
    /// have one.
    #[inline(always)]
    fn only_class(&self, around: [usize; 4]) -> u8 {
        if let Self::Dense { .. } = self {
            return NO_CLASS;
        }
        let only = self.only();
        let [a, b, c, d] = around.map(|index| only[index]);
        if a == b && a == c && a == d { a } else { NO_CLASS }
    }
}

/// Pixels of a class, by a table of the shares of each class, and their labelled share; nothing without a class.
fn of_class(table: &[Share; NO_CLASS as usize], class: u8) -> (&[Share], u16) {
    match table.get(usize::from(class)) {
        Some(share) => (std::slice::from_ref(share), share.amount.into()),
        None => (&[], 0),
    }
}

#[inline(always)]
fn sparse<'a>(around: [usize; 4], of: impl Fn(usize) -> (&'a [Share], u16)) -> (AnyCorners<'a>, [f64; 4]) {
    let corners = around.map(of);
    (AnyCorners::Sparse(corners.map(|(shares, _)| shares)), corners.map(|(_, amount)| amount.into()))
}

impl ShareMap {
    /// The classes of pixels. Those less than `edge_band_px` pixels from another class have low weight.
    pub fn of_pixels(image: &Arc<LabelImage<u8>>, edge_band_px: usize) -> Self {
        if edge_band_px == 0 {
            return Self::new(image, 1, Blocks::Pixels(Arc::clone(image)));
        }
        let mut only = amounts(image, edge_band_px);
        for (amount, &class) in only.iter_mut().zip(&image.ids) {
            *amount = if *amount == u8::MAX { class } else { NO_CLASS };
        }
        Self::new(image, 1, Blocks::Banded { image: Arc::clone(image), only })
    }

    /// The mean classes of pixels under a Gaussian with a standard deviation of `sigma_px`.
    pub fn blurred(image: &LabelImage<u8>, sigma_px: f64) -> Self {
        Self::of_dense(image, 1, blurred_classes(image, sigma_px))
    }

    /// The mean classes of blocks of `factor x factor` pixels, weighted as in the `finest` map.
    ///
    /// Only whole blocks count, so that block `(i, j)` is centred exactly on pixel `factor * (i + 1/2) - 1/2`.
    /// Pixels without a class reduce the labelled share of their block.
    pub fn of_blocks(image: &LabelImage<u8>, finest: &Self, factor: usize) -> Self {
        Self::averaged(image, factor, averaged_classes(image, finest.blocks.only(), factor))
    }

    /// Works like [`ShareMap::of_blocks`] for the few classes of an image without borders, such as levels of a
    /// gradient, of which most blocks have several.
    pub fn of_levels(image: &Arc<LabelImage<u8>>, factor: usize) -> Self {
        if factor == 1 {
            return Self::of_pixels(image, 0);
        }
        Self::of_dense(image, factor, averaged_levels(image, factor))
    }

    /// The mean class shares of blocks, where a network gave class shares of each pixel. There is no band, since the
    /// shares themselves express the uncertainty of a border (with a band, labels blurred by 5 pixels ended at 0.06
    /// instead of 0.03 degrees).
    pub fn of_shares(image: &LabelImage<u8>, shares: &ClassShares, factor: usize) -> Self {
        Self::averaged(image, factor, averaged_shares(image, shares, factor))
    }

    fn averaged(image: &LabelImage<u8>, factor: usize, Averaged { shares, only }: Averaged) -> Self {
        let amount = |(index, &only): (usize, &u8)| match only {
            NO_CLASS => shares.at(index).iter().map(|share| u16::from(share.amount)).sum(),
            _ => u8::MAX.into(),
        };
        let amounts = only.iter().enumerate().map(amount).collect();
        Self::new(image, factor, Blocks::Shares { shares, only, amounts })
    }

    fn of_dense(image: &LabelImage<u8>, factor: usize, Dense { shares, width, only }: Dense) -> Self {
        Self::new(image, factor, Blocks::Dense { shares, width, only })
    }

    fn new(image: &LabelImage<u8>, factor: usize, blocks: Blocks) -> Self {
        let (columns, rows) = (image.width / factor, image.height / factor);
        Self { grid: Grid { blocks_per_pixel: 1.0 / factor as f64, columns, rows }, blocks }
    }

    /// The blocks, if each has `N` shares.
    pub fn dense<const N: usize>(&self) -> Option<DenseMap<'_, N>> {
        match &self.blocks {
            Blocks::Dense { shares, width, .. } if *width == N => Some(DenseMap::new(self.grid, shares)),
            _ => None,
        }
    }

    /// The only class of the blocks around a pixel, at least `radius` of them to each side; `None` if there are several.
    pub fn only_class_around(&self, pixel: &Point2<f64>, radius: usize) -> Option<u8> {
        let span = |pixel: f64, count: usize| {
            let first = self.grid.between(pixel, count).0;
            first.saturating_sub(radius)..(first + radius + 2).min(count)
        };
        let (columns, rows) = (span(pixel.x, self.grid.columns), span(pixel.y, self.grid.rows));
        let width = self.grid.columns;
        let first = rows.start * width + columns.start;
        let only = self.blocks.only();
        let class = only[first];
        let mut lines = rows.map(|row| row * width + columns.start..row * width + columns.end);
        (class != NO_CLASS && lines.all(|line| are_all(only, line, class))).then_some(class)
    }
}

impl<'a> LabelMap for &'a ShareMap {
    type Corners = AnyCorners<'a>;

    #[inline(always)]
    fn at(&self, pixel: &Point2<f64>) -> Sampled<AnyCorners<'a>> {
        let around = self.grid.around(pixel);
        match self.blocks.only_class(around.blocks) {
            NO_CLASS => {
                let (corners, amounts) = self.blocks.corners(around.blocks);
                Sampled::Mixed(self.grid.shares(around, corners, amounts))
            }
            class => Sampled::Uniform(class),
        }
    }

    fn touch(&self, pixel: &Point2<f64>) -> u8 {
        let [above, below] = self.grid.before(pixel).map(|block| self.blocks.touch(block));
        above ^ below
    }
}

/// Whether neighbouring bytes all have a value.
fn are_all(bytes: &[u8], line: Range<usize>, value: u8) -> bool {
    match bytes[line.start..].first_chunk() {
        // Eight at most, without a branch: the first of a word is its lowest byte.
        Some(word) if (1..=8).contains(&line.len()) => {
            let differs = u64::from_le_bytes(*word) ^ u64::from_le_bytes([value; 8]);
            differs << (u64::BITS as usize - 8 * line.len()) == 0
        }
        _ => bytes[line].iter().fold(0, |differs, byte| differs | (byte ^ value)) == 0,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::super::averaging::FAINT_AMOUNT;
    use super::*;

    fn blocks_of_two(image: LabelImage<u8>) -> ShareMap {
        let image = Arc::new(image);
        ShareMap::of_blocks(&image, &ShareMap::of_pixels(&image, 0), 2)
    }

    fn shares_of(map: &ShareMap, block: usize) -> Vec<(u8, u8)> {
        let AnyCorners::Sparse([corner, ..]) = map.blocks.corners([block; 4]).0 else {
            panic!("dense blocks")
        };
        corner.iter().map(|share| (share.class, share.amount)).collect()
    }

    #[test]
    fn shares_count_each_class_in_each_whole_block() {
        let ids = vec![0, 1, 1, 1, 9, 0, NO_CLASS, 1, 1, 9]; // the last column is no whole block
        let map = &blocks_of_two(LabelImage { width: 5, height: 2, ids });
        let shares = |block| shares_of(map, block);
        assert_eq!(shares(0), [(0, 128), (1, 64)]);
        assert_eq!(shares(1), [(1, 255)]);
    }

    #[test]
    fn shares_are_bilinear_between_the_centres_of_blocks() {
        let ids = vec![0, 0, 1, 1, 0, 0, 1, 1, 0, 0, NO_CLASS, 2, 0, 0, 2, 2];
        let map = &blocks_of_two(LabelImage { width: 4, height: 4, ids });
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

    #[test]
    fn pixels_along_borders_count_little() {
        let ids = vec![0, 0, 0, 0, 1, 1, 1, 1];
        let image = Arc::new(LabelImage { width: 8, height: 1, ids });
        let (all, few) = (u8::MAX, FAINT_AMOUNT);
        assert_eq!(amounts(&image, 2), [all, all, few, few, few, few, all, all]);
        let map = &ShareMap::of_pixels(&image, 2);
        let total = |u: f64| map.at(&Point2::new(u, 0.0)).total();
        assert_eq!((total(0.0), total(3.0)), (1.0, f64::from(FAINT_AMOUNT) / 255.0));
        // Low weight, and the same shares.
        let mut classes = [0.0; 2];
        map.at(&Point2::new(3.5, 0.0)).add_to(&mut classes, 1.0);
        assert_eq!(classes, [0.5, 0.5]);
    }

    #[test]
    fn a_blur_mixes_the_classes_under_a_gaussian() {
        // Two columns of each class, and one of none, which the blur neither fills nor counts.
        let line = [0, 0, 1, 1, NO_CLASS];
        let image = LabelImage { width: 5, height: 3, ids: line.repeat(3) };
        let map = &ShareMap::blurred(&image, 1.0);
        let weight = |offset: i32| (-0.5 * f64::from(offset * offset)).exp();
        for column in 0..4 {
            let of_class = |class: u8| {
                let columns = (0..4).filter(|&near: &i32| line[near as usize] == class);
                columns.map(|near| weight(near - column)).sum::<f64>()
            };
            let mut classes = [0.0; 2];
            map.at(&Point2::new(f64::from(column), 1.0)).add_to(&mut classes, 1.0);
            let expected = of_class(0) / (of_class(0) + of_class(1));
            assert!((classes[0] - expected).abs() < 0.01, "{column}: {classes:?}, {expected}");
        }
        assert_eq!(map.at(&Point2::new(4.0, 1.0)).total(), 0.0);
    }

    #[test]
    fn levels_are_averaged_as_classes_are_and_may_be_none() {
        // Three rows of blocks, so that all four around a pixel count. Up to eight levels are counted in the bytes of a
        // number, more in a table.
        for num_levels in [8, 19] {
            let ids = (0..36)
                .map(|pixel| if pixel == 20 { NO_CLASS } else { (7 * pixel % num_levels) as u8 })
                .collect();
            let values: [f64; 19] = std::array::from_fn(|class| (class as f64).sin());
            let image = Arc::new(LabelImage { width: 6, height: 6, ids });
            let (levels, classes) = (ShareMap::of_levels(&image, 2), blocks_of_two((*image).clone()));
            for (u, v) in [-1.0, 0.9, 1.4, 2.7, 4.1, 6.0].into_iter().flat_map(|u| [(u, 1.3), (u, 3.9)]) {
                let under = |map: &ShareMap| {
                    let mut shares = [0.0; 19];
                    let sampled = map.at(&Point2::new(u, v));
                    sampled.add_to(&mut shares, 1.0);
                    (shares, sampled.total())
                };
                let (of_levels, of_classes) = (under(&levels), under(&classes));
                let pairs = of_levels.0.iter().zip(of_classes.0);
                assert!(
                    pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12),
                    "{u}: {of_levels:?} {of_classes:?}"
                );
                assert!((of_levels.1 - of_classes.1).abs() < 1e-12);
                let gradient = |map: &ShareMap| match map.at(&Point2::new(u, v)) {
                    Sampled::Mixed(shares) => shares.gradient(&values),
                    Sampled::Uniform(_) => Vector2::zeros(),
                };
                assert!((gradient(&levels) - gradient(&classes)).norm() < 1e-12);
            }
        }
        // Some blocks have one class, and the last row and column are no whole blocks.
        let ids = (0..35).map(|pixel| match (pixel % 7, pixel / 7) {
            (0..=1, 0..=1) => 4,
            (2..=3, 0..=1) => NO_CLASS,
            _ => (3 * pixel % 5) as u8,
        });
        let image = Arc::new(LabelImage { width: 7, height: 5, ids: ids.collect() });
        let maps = [ShareMap::of_levels(&image, 2), blocks_of_two((*image).clone())];
        assert_eq!(maps[0].blocks.only(), maps[1].blocks.only());
        assert_eq!(maps[0].blocks.only()[..2], [4, NO_CLASS]);
        // The most pixels that a byte counts, and more.
        for factor in [15, 16] {
            let ids = (0..factor * 2 * factor).map(|pixel| if pixel % (2 * factor) < factor { 7 } else { 3 });
            let image = Arc::new(LabelImage { width: 2 * factor, height: factor, ids: ids.collect() });
            assert_eq!(ShareMap::of_levels(&image, factor).blocks.only(), [7, 3]);
        }
        let empty = Arc::new(LabelImage { width: 4, height: 2, ids: vec![NO_CLASS; 8] });
        for map in [ShareMap::of_levels(&empty, 2), ShareMap::blurred(&empty, 1.0)] {
            let pixel = Point2::new(1.2, 0.8);
            assert_eq!(((&map).at(&pixel).total(), (&map).touch(&pixel)), (0.0, 0));
        }
    }

    #[test]
    fn pixels_along_borders_count_little_in_blocks_too() {
        // No border is known next to the unlabelled pixel.
        let ids = vec![0, 0, 0, 1, 1, NO_CLASS, 0, 0, 0, 1, 1, 1];
        let image = Arc::new(LabelImage { width: 6, height: 2, ids });
        let map = &ShareMap::of_blocks(&image, &ShareMap::of_pixels(&image, 1), 2);
        let shares = |block| shares_of(map, block);
        let quarters =
            |full: f32, few: f32| ((full * 255.0 + few * f32::from(FAINT_AMOUNT)) / 4.0).round() as u8;
        assert_eq!(shares(0), [(0, 255)]);
        assert_eq!(shares(1), [(0, quarters(0.0, 2.0)), (1, quarters(0.0, 2.0))]);
        assert_eq!(shares(2), [(1, quarters(3.0, 0.0))]);
    }
}
