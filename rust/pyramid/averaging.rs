//! Averages over blocks of a label image, and the low weight of pixels along class borders.

use crate::classes::{ClassShares, NO_CLASS, Share};
use crate::label_image::LabelImage;

/// Weight, out of 255, of pixels in the band along class borders.
pub(super) const FAINT_AMOUNT: u8 = 26;

/// Smallest number of shares of a block where each class has one: that of the levels of edges. Blocks of this many are
/// read without branches.
pub const WORD: usize = 8;

/// Reach of a Gaussian, standard deviations.
const REACH: f64 = 3.0;

/// The shares of a pixel of each class: with full weight, or with the low weight of the band.
pub(super) static WHOLE: [Share; NO_CLASS as usize] = pixels_of(u8::MAX);
pub(super) static FAINT: [Share; NO_CLASS as usize] = pixels_of(FAINT_AMOUNT);

/// One pixel of each of the first classes, counted in a byte of its own; zero for others.
static ONE: [u64; 256] = {
    let mut ones = [0; 256];
    let mut class = 0;
    while class < WORD {
        ones[class] = 1 << (8 * class);
        class += 1;
    }
    ones
};

const fn pixels_of(amount: u8) -> [Share; NO_CLASS as usize] {
    let mut shares = [Share { class: 0, amount }; NO_CLASS as usize];
    let mut class = 0;
    while class < NO_CLASS {
        shares[class as usize].class = class;
        class += 1;
    }
    shares
}

/// Classes of whole blocks, row by row.
pub(super) struct Averaged {
    /// Class shares of blocks with several classes; none for others.
    pub shares: ClassShares,
    /// The class of blocks with a single class, else [`NO_CLASS`].
    pub only: Vec<u8>,
}

impl Averaged {
    fn of(num_blocks: usize) -> Self {
        Self { shares: ClassShares::with_capacity(num_blocks), only: Vec::with_capacity(num_blocks) }
    }

    fn push_whole(&mut self, class: u8) {
        self.only.push(class);
        self.shares.push_with(|_| {});
    }

    /// Adds a block from the tally of its pixels.
    fn push_tally(&mut self, tally: &mut Tally, num_pixels: usize) {
        self.shares.push_with(|entries| tally.drain_into(entries, num_pixels));
        self.push_only();
    }

    /// Notes the class of the block whose shares were added last.
    fn push_only(&mut self) {
        let only = match self.shares.at(self.only.len()) {
            [share] if share.amount == u8::MAX => share.class,
            _ => NO_CLASS,
        };
        self.only.push(only);
    }
}

/// Classes of whole blocks, row by row, of which most have several of a few classes.
pub(super) struct Dense {
    /// Shares of each class, in 1/255, block by block.
    pub shares: Vec<u8>,
    /// Number of shares of a block: that of its classes, and zeros up to [`WORD`].
    pub width: usize,
    /// The class of blocks with a single class, else [`NO_CLASS`].
    pub only: Vec<u8>,
}

/// Number of classes up to the last that occurs; at least one, so that blocks have a length.
fn num_classes(image: &LabelImage<u8>) -> usize {
    // The byte after that of no class is zero.
    let after = image.ids.iter().map(|class| class.wrapping_add(1));
    usize::from(after.max().unwrap_or(0).max(1))
}

/// Averages over blocks. `only` holds the class of pixels with full weight, and [`NO_CLASS`] for those with low
/// weight.
pub(super) fn averaged_classes(image: &LabelImage<u8>, only: &[u8], factor: usize) -> Averaged {
    let (ids, width) = (&image.ids, image.width);
    let mut differs = vec![0; width / factor * factor];
    let (mut blocks, mut tally) = (Averaged::of(image.height / factor * (width / factor)), Tally::default());
    for top in (0..image.height / factor).map(|row| row * factor * width) {
        let lines = (top..).step_by(width).take(factor);
        // Line by line, so that many columns are compared at once: most blocks have a single class.
        let first = &only[top..][..differs.len()];
        differs.fill(0);
        for from in lines.clone() {
            let unlike = first.iter().zip(&only[from..]).map(|(first, class)| first ^ class);
            differs.iter_mut().zip(unlike).for_each(|(differs, unlike)| *differs |= unlike);
        }
        let columns = differs.chunks_exact(factor).zip(first.chunks_exact(factor));
        for (column, (differs, first)) in columns.enumerate() {
            let class = first[0];
            let unlike =
                differs.iter().zip(first).fold(0, |any, (differs, other)| any | differs | (other ^ class));
            if unlike == 0 && class != NO_CLASS {
                blocks.push_whole(class);
                continue;
            }
            for from in lines.clone().map(|line| line + column * factor) {
                let pixels = ids[from..][..factor].iter().zip(&only[from..]);
                let amount = |only: u8| if only == NO_CLASS { FAINT_AMOUNT } else { u8::MAX };
                pixels.for_each(|(&id, &only)| tally.add(id, amount(only).into()));
            }
            blocks.push_tally(&mut tally, factor * factor);
        }
    }
    blocks
}

/// Averages classes without borders, such as levels of a gradient, over blocks: all pixels have full weight.
pub(super) fn averaged_levels(image: &LabelImage<u8>, factor: usize) -> Dense {
    let (columns, rows, num_pixels) = (image.width / factor, image.height / factor, factor * factor);
    let width = num_classes(image).max(WORD);
    let of_count = |count: usize| mean_amount(count as u64 * u64::from(u8::MAX), num_pixels);
    let amounts: Vec<u8> = (0..=num_pixels).map(of_count).collect();
    let mut shares = Vec::with_capacity(columns * rows * width);
    let lines_of_blocks = image.ids.chunks_exact(factor * image.width);
    if width == WORD && num_pixels <= u8::MAX.into() {
        // The counts of a block are the bytes of one number.
        let mut counts = vec![0_u64; columns];
        for lines in lines_of_blocks {
            counts.fill(0);
            for line in lines.chunks_exact(image.width) {
                let blocks = counts.iter_mut().zip(line.chunks_exact(factor));
                blocks.for_each(|(counts, pixels)| {
                    *counts += pixels.iter().map(|&class| ONE[usize::from(class)]).sum::<u64>();
                });
            }
            let counts = counts.iter().flat_map(|counts| counts.to_le_bytes());
            shares.extend(counts.map(|count| amounts[usize::from(count)]));
        }
    } else {
        let mut counts = vec![0_u32; columns * width];
        for lines in lines_of_blocks {
            counts.fill(0);
            for line in lines.chunks_exact(image.width) {
                for (pixels, counts) in line.chunks_exact(factor).zip(counts.chunks_exact_mut(width)) {
                    let classes = pixels.iter().filter(|&&class| class != NO_CLASS);
                    classes.for_each(|&class| counts[usize::from(class)] += 1);
                }
            }
            shares.extend(counts.iter().map(|&count| amounts[count as usize]));
        }
    }
    let only = shares.chunks_exact(width).map(only_class).collect();
    Dense { shares, width, only }
}

/// The class of a block whose other shares are zero, else [`NO_CLASS`].
fn only_class(shares: &[u8]) -> u8 {
    let mut some = shares.iter().enumerate().filter(|(_, share)| **share > 0);
    match (some.next(), some.next()) {
        (Some((class, &u8::MAX)), None) => class as u8,
        _ => NO_CLASS,
    }
}

/// Averages over a Gaussian around each pixel, cut off at three standard deviations. Pixels of no class do not count,
/// and keep none.
pub(super) fn blurred_classes(image: &LabelImage<u8>, sigma_px: f64) -> Dense {
    let (width, height, num_classes) = (image.width, image.height, num_classes(image));
    let reach = (REACH * sigma_px).ceil() as usize;
    let weight = |offset: usize| (-0.5 * (offset as f64 / sigma_px).powi(2)).exp() as f32;
    let kernel: Vec<f32> = (0..=reach).map(weight).collect();
    // Sums along the lines around the current one, each in the place of its number modulo their count.
    let mut lines = vec![vec![0.0_f32; num_classes * width]; 2 * reach + 1];
    let mut next_line = 0;
    let padded = num_classes.max(WORD);
    let (mut shares, mut only) = (vec![0; padded * width * height], vec![NO_CLASS; width * height]);
    let mut sums = vec![0.0_f32; num_classes * width];
    for row in 0..height {
        let (first, end) = (row.saturating_sub(reach), (row + reach + 1).min(height));
        for below in next_line..end {
            let line = &mut lines[below % (2 * reach + 1)];
            blur_along(&image.ids[below * width..][..width], &kernel, num_classes, line);
        }
        next_line = end;
        sums.fill(0.0);
        for near in first..end {
            let (weight, line) = (kernel[near.abs_diff(row)], &lines[near % (2 * reach + 1)]);
            sums.iter_mut().zip(line).for_each(|(sum, x)| *sum += weight * x);
        }
        for (column, &class) in image.ids[row * width..][..width].iter().enumerate() {
            if class != NO_CLASS {
                let (sums, pixel) = (&sums[column * num_classes..][..num_classes], row * width + column);
                let scale = f32::from(u8::MAX) / sums.iter().sum::<f32>();
                let shares = &mut shares[pixel * padded..][..num_classes];
                shares.iter_mut().zip(sums).for_each(|(share, sum)| *share = rounded(sum * scale));
                if shares[usize::from(class)] == u8::MAX {
                    only[pixel] = class;
                }
            }
        }
    }
    Dense { shares, width: padded, only }
}

/// Sums of each class under a kernel at the pixels of a line, a pixel's classes after one another.
fn blur_along(ids: &[u8], kernel: &[f32], num_classes: usize, sums: &mut [f32]) {
    sums.fill(0.0);
    for (column, &class) in ids.iter().enumerate().filter(|(_, class)| **class != NO_CLASS) {
        for near in column.saturating_sub(kernel.len() - 1)..(column + kernel.len()).min(ids.len()) {
            sums[near * num_classes + usize::from(class)] += kernel[near.abs_diff(column)];
        }
    }
}

/// Averages class shares of each pixel, given by a network, over blocks.
pub(super) fn averaged_shares(image: &LabelImage<u8>, shares: &ClassShares, factor: usize) -> Averaged {
    let (columns, rows) = (image.width / factor, image.height / factor);
    let (mut blocks, mut tally) = (Averaged::of(rows * columns), Tally::default());
    for index in 0..rows * columns {
        let start = index / columns * factor * image.width + index % columns * factor;
        let lines = (start..).step_by(image.width).take(factor);
        let pixels = lines.flat_map(|line| line..line + factor);
        for pixel in pixels.filter(|&pixel| image.ids[pixel] != NO_CLASS) {
            shares.at(pixel).iter().for_each(|share| tally.add(share.class, share.amount.into()));
        }
        blocks.push_tally(&mut tally, factor * factor);
    }
    blocks
}

/// Sums the shares of the pixels of a block.
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
    fn add(&mut self, class: u8, amount: u64) {
        if let Some(sum) = self.sums.get_mut(usize::from(class)) {
            if *sum == 0 {
                self.seen.push(class);
            }
            *sum += amount;
        }
    }

    /// Appends the shares of `whole`, lowest class first, and resets the tally.
    fn drain_into(&mut self, entries: &mut Vec<Share>, whole: usize) {
        self.seen.sort_unstable();
        self.seen.dedup();
        for class in self.seen.drain(..) {
            let sum = std::mem::take(&mut self.sums[usize::from(class)]);
            let amount = mean_amount(sum, whole);
            if amount > 0 {
                entries.push(Share { class, amount });
            }
        }
    }
}

/// The share of a class in a block, by the sum of its pixels' shares.
fn mean_amount(sum: u64, num_pixels: usize) -> u8 {
    rounded(sum as f32 / num_pixels as f32)
}

/// Rounds a number from 0 to 255 as `f32::round` does, which is a call where the processor has no such instruction.
fn rounded(number: f32) -> u8 {
    let whole = number as i32;
    (whole + i32::from(number - whole as f32 >= 0.5)).min(u8::MAX.into()) as u8
}

/// Weight of each pixel, in 1/255: low if it is less than `width` pixels from one of another class, along rows and
/// columns.
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
    // A border is between two neighbours of different classes, with `width` pixels to either side.
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
    fn numbers_are_rounded_as_the_standard_library_rounds_them() {
        let halves = (0..=511).map(|half| half as f32 * 0.5);
        for number in halves.flat_map(|number| [number.next_down().max(0.0), number, number.next_up()]) {
            assert_eq!(rounded(number), number.round() as u8, "{number}");
        }
    }
}
