//! Averages over blocks of a label image, and the little that pixels along the borders of classes count.

use std::ops::Range;

use crate::class_shares::{ClassShares, Share};
use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;

/// Weight, of 255, of pixels in the band along the borders of classes.
pub(super) const FAINT_AMOUNT: u8 = 26;

/// The shares of a pixel of each class: with full weight, or with the small weight of the band.
pub(super) static WHOLE: [Share; NO_CLASS as usize] = pixels_of(u8::MAX);
pub(super) static FAINT: [Share; NO_CLASS as usize] = pixels_of(FAINT_AMOUNT);

const fn pixels_of(amount: u8) -> [Share; NO_CLASS as usize] {
    let mut shares = [Share { class: 0, amount }; NO_CLASS as usize];
    let mut class = 0;
    while class < NO_CLASS {
        shares[class as usize].class = class;
        class += 1;
    }
    shares
}

/// The shares of the classes in whole blocks, row by row.
pub(super) fn averaged(
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
pub(super) fn amounts(image: &LabelImage<u8>, width: usize) -> Vec<u8> {
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
