//! Class shares of label images: what one-hot label maps become when they are averaged over blocks.

use std::ops::Range;

use nalgebra::{Point2, Vector2};

use crate::class_shares::{ClassShares, Share};
use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;

/// The class shares of one label image at one level, for sampling.
#[derive(Clone, Debug)]
pub struct ShareMap {
    factor: usize,
    columns: usize,
    rows: usize,
    blocks: Blocks,
}

/// The classes in each block, row by row.
#[derive(Clone, Debug)]
enum Blocks {
    /// Blocks of one pixel.
    Pixels(Vec<u8>),
    /// Blocks of one pixel, and how much each counts, in 1/255.
    Banded(Vec<u8>, Vec<u8>),
    /// Blocks of several pixels, or pixels of several classes.
    Shares(ClassShares),
}

impl Blocks {
    #[inline]
    fn at(&self, index: usize) -> &[Share] {
        match self {
            Self::Pixels(ids) => {
                let class = usize::from(ids[index]);
                &WHOLE[class..class + usize::from(class < WHOLE.len())]
            }
            Self::Banded(ids, amounts) => {
                let shares = if amounts[index] == u8::MAX { &WHOLE } else { &FAINT };
                let class = usize::from(ids[index]);
                &shares[class..class + usize::from(class < shares.len())]
            }
            Self::Shares(shares) => shares.at(index),
        }
    }

    /// The class of blocks that are all of it; `None` where that is not so, or not told by a look at pixels.
    #[inline]
    fn only_class(&self, around: [usize; 4]) -> Option<u8> {
        let (Self::Pixels(ids) | Self::Banded(ids, _)) = self else { return None };
        if let Self::Banded(_, amounts) = self
            && around.iter().any(|&index| amounts[index] != u8::MAX)
        {
            return None;
        }
        let ids = around.map(|index| ids[index]);
        (ids[0] != NO_CLASS && ids.iter().all(|&id| id == ids[0])).then_some(ids[0])
    }
}

/// Weight, of 255, of pixels in the band along the borders of classes.
const FAINT_AMOUNT: u8 = 26;

/// The shares of a pixel of each class: with full weight, or with the small weight of the band.
static WHOLE: [Share; NO_CLASS as usize] = pixels_of(u8::MAX);
static FAINT: [Share; NO_CLASS as usize] = pixels_of(FAINT_AMOUNT);

const fn pixels_of(amount: u8) -> [Share; NO_CLASS as usize] {
    let mut shares = [Share { class: 0, amount }; NO_CLASS as usize];
    let mut class = 0;
    while class < NO_CLASS {
        shares[class as usize].class = class;
        class += 1;
    }
    shares
}

impl ShareMap {
    /// Averages the classes of blocks of `factor x factor` pixels, or the shares of their classes where a network gave
    /// them.
    ///
    /// Only whole blocks count, so that block `(i, j)` is centred on pixel `factor * (i + 1/2) - 1/2` exactly; pixels
    /// without a class take their share but give it to none. Pixels less than `edge_band_px` pixels from one of another
    /// class count little; where a network gave shares there is no band, since these say themselves how sure a border is
    /// (with a band, labels blurred by 5 pixels ended at 0.06 instead of 0.03 degrees).
    pub fn new(
        image: &LabelImage<u8>,
        shares: Option<&ClassShares>,
        factor: usize,
        edge_band_px: usize,
    ) -> Self {
        let blocks = match (shares, factor, edge_band_px) {
            (None, 1, 0) => Blocks::Pixels(image.ids.clone()),
            (None, 1, _) => Blocks::Banded(image.ids.clone(), amounts(image, edge_band_px)),
            _ => Blocks::Shares(averaged(image, shares, factor, edge_band_px)),
        };
        Self { factor, columns: image.width / factor, rows: image.height / factor, blocks }
    }

    /// The shares at a pixel of the full-resolution picture, bilinear between the centres of blocks, and continued
    /// beyond the outermost ones.
    #[inline]
    pub fn at(&self, pixel: &Point2<f64>) -> Sampled<'_> {
        let (column, right) = Self::between(pixel.x, self.factor, self.columns);
        let (row, down) = Self::between(pixel.y, self.factor, self.rows);
        let (next_column, next_row) = ((column + 1).min(self.columns - 1), (row + 1).min(self.rows - 1));
        let (above, below) = (row * self.columns, next_row * self.columns);
        let around = [above + column, above + next_column, below + column, below + next_column];
        if let Some(class) = self.blocks.only_class(around) {
            return Sampled::Uniform(class);
        }
        let corners = around.map(|index| self.blocks.at(index));
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

    /// Whether a pixel lies amid blocks of one class that reach at least `radius` blocks to each side of it.
    pub fn is_amid_one_class(&self, pixel: &Point2<f64>, radius: usize) -> bool {
        let span = |pixel: f64, count: usize| {
            let first = Self::between(pixel, self.factor, count).0;
            first.saturating_sub(radius)..(first + radius + 2).min(count)
        };
        let (columns, rows) = (span(pixel.x, self.columns), span(pixel.y, self.rows));
        let [first] = self.blocks.at(rows.start * self.columns + columns.start) else { return false };
        let same = |index| matches!(self.blocks.at(index), [share] if share.class == first.class && share.amount == u8::MAX);
        rows.into_iter().all(|row| columns.clone().all(|column| same(row * self.columns + column)))
    }

    /// The block before a pixel along one axis, and the share of the way to the next; `None` beyond the outermost.
    #[inline]
    fn between(pixel: f64, factor: usize, count: usize) -> (usize, Option<f64>) {
        let place = (pixel + 0.5) / factor as f64 - 0.5;
        let last = (count - 1) as f64;
        if place > 0.0 && place < last {
            let before = place as usize;
            (before, Some(place - before as f64))
        } else {
            (if place > 0.0 { count - 1 } else { 0 }, None)
        }
    }
}

/// The surroundings of a pixel.
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
    /// The share that is labelled.
    #[inline]
    pub fn total(&self) -> f64 {
        self.total
    }

    #[inline]
    fn add_to(&self, classes: &mut [f64], weight: f64) {
        let scale = weight / (255.0 * self.total);
        for (corner, weight) in self.corners.iter().zip(self.weights) {
            for share in *corner {
                classes[usize::from(share.class)] += weight * scale * f64::from(share.amount);
            }
        }
    }

    /// The gradient, per pixel, of `sum_y values[y] share_y / sum_y share_y`; some share has to be labelled.
    #[inline]
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

/// The shares of the classes in whole blocks, row by row.
fn averaged(
    image: &LabelImage<u8>,
    shares: Option<&ClassShares>,
    factor: usize,
    edge_band_px: usize,
) -> ClassShares {
    let (columns, rows) = (image.width / factor, image.height / factor);
    let ids = &image.ids;
    let amounts = if shares.is_none() { amounts(image, edge_band_px) } else { Vec::new() };
    // Without a branch within a line.
    let is_all_of = |class: u8, line: Range<usize>| {
        let pairs = ids[line.clone()].iter().zip(&amounts[line]);
        pairs.fold(0, |differs, (id, amount)| differs | (id ^ class) | !amount) == 0
    };
    let (mut blocks, mut tally) = (ClassShares::default(), Tally::default());
    for index in 0..rows * columns {
        let start = index / columns * factor * image.width + index % columns * factor;
        let lines = (0..factor).map(|line| start + line * image.width).map(|from| from..from + factor);
        let class = ids[start];
        if shares.is_none() && class != NO_CLASS && lines.clone().all(|line| is_all_of(class, line)) {
            blocks.push_with(|entries| entries.push(WHOLE[usize::from(class)]));
            continue;
        }
        for pixel in lines.flatten().filter(|&pixel| ids[pixel] != NO_CLASS) {
            match shares {
                Some(shares) => {
                    shares.at(pixel).iter().for_each(|share| tally.add(share.class, share.amount.into()))
                }
                None => tally.add(ids[pixel], amounts[pixel].into()),
            }
        }
        blocks.push_with(|entries| tally.drain_into(entries, factor * factor));
    }
    blocks
}

/// Sums up the shares of the pixels of a block.
struct Tally {
    sums: [u64; NO_CLASS as usize],
    seen: Vec<u8>,
}

impl Default for Tally {
    fn default() -> Self {
        Self { sums: [0; NO_CLASS as usize], seen: Vec::new() }
    }
}

impl Tally {
    #[inline]
    fn add(&mut self, class: u8, amount: u64) {
        if let Some(sum) = self.sums.get_mut(usize::from(class)) {
            if *sum == 0 {
                self.seen.push(class);
            }
            *sum += amount;
        }
    }

    /// Appends the shares of `whole`, lowest class first, and starts anew.
    fn drain_into(&mut self, entries: &mut Vec<Share>, whole: usize) {
        self.seen.sort_unstable();
        self.seen.dedup();
        for class in self.seen.drain(..) {
            let sum = std::mem::take(&mut self.sums[usize::from(class)]);
            let amount = (sum as f32 / whole as f32).round() as u8;
            if amount > 0 {
                entries.push(Share { class, amount });
            }
        }
    }
}

/// How much each pixel counts, in 1/255: little if it lies less than `width` pixels from one of another class, along rows
/// and columns.
fn amounts(image: &LabelImage<u8>, width: usize) -> Vec<u8> {
    let (columns, rows) = (image.width, image.height);
    let mut amounts = vec![u8::MAX; image.ids.len()];
    if width == 0 {
        return amounts;
    }
    let most = |a: u8, b: u8| if a != b && a != NO_CLASS && b != NO_CLASS { FAINT_AMOUNT } else { u8::MAX };
    let lower = |amounts: &mut [u8], limits: &[u8]| {
        amounts.iter_mut().zip(limits).for_each(|(amount, &limit)| *amount = limit.min(*amount));
    };
    let line = |row: usize| &image.ids[row * columns..][..columns];
    let mut limits = vec![u8::MAX; columns];
    // Between two neighbours of different classes runs a border, with `width` pixels to either side.
    for row in 0..rows {
        let (left, right) = (&line(row)[..columns - 1], &line(row)[1..]);
        limits.iter_mut().zip(left.iter().zip(right)).for_each(|(limit, (&a, &b))| *limit = most(a, b));
        let amounts_here = &mut amounts[row * columns..][..columns];
        for reach in 0..width.min(columns - 1) {
            lower(&mut amounts_here[..columns - 1 - reach], &limits[reach..]);
            lower(&mut amounts_here[1 + reach..], &limits);
        }
        if row + 1 < rows {
            let below = line(row).iter().zip(line(row + 1));
            limits.iter_mut().zip(below).for_each(|(limit, (&a, &b))| *limit = most(a, b));
            for near in (row + 1).saturating_sub(width)..rows.min(row.saturating_add(width) + 1) {
                lower(&mut amounts[near * columns..][..columns], &limits);
            }
        }
    }
    amounts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_count_each_class_in_each_whole_block() {
        let ids = vec![0, 1, 1, 1, 9, 0, NO_CLASS, 1, 1, 9]; // the last column is no whole block
        let map = ShareMap::new(&LabelImage { width: 5, height: 2, ids }, None, 2, 0);
        let shares = |block| map.blocks.at(block).iter().map(|s| (s.class, s.amount)).collect::<Vec<_>>();
        assert_eq!(shares(0), [(0, 128), (1, 64)]);
        assert_eq!(shares(1), [(1, 255)]);
    }

    #[test]
    fn shares_are_bilinear_between_the_centres_of_blocks() {
        let ids = vec![0, 0, 1, 1, 0, 0, 1, 1, 0, 0, NO_CLASS, 2, 0, 0, 2, 2];
        let map = ShareMap::new(&LabelImage { width: 4, height: 4, ids }, None, 2, 0);
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
        let image = LabelImage { width: 8, height: 1, ids };
        let (all, few) = (u8::MAX, FAINT_AMOUNT);
        assert_eq!(amounts(&image, 2), [all, all, few, few, few, few, all, all]);
        let map = ShareMap::new(&image, None, 1, 2);
        let total = |u: f64| map.at(&Point2::new(u, 0.0)).total();
        assert_eq!((total(0.0), total(3.0)), (1.0, f64::from(FAINT_AMOUNT) / 255.0));
        // Little weight, and the same shares.
        let mut classes = [0.0; 2];
        map.at(&Point2::new(3.5, 0.0)).add_to(&mut classes, 1.0);
        assert_eq!(classes, [0.5, 0.5]);
    }
}
