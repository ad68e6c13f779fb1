//! Borders between labels, and the steps in range or colour next to them: the two coincide where labels match their
//! points or pixels.

use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;

/// Largest difference of the logarithms of two ranges. Larger ones are clipped, so that no step outweighs many.
const MAX_LOG_STEP: f32 = 0.3;
/// Fraction of the steps between pixels that are not clipped, for the same reason.
const SHARE_UNCUT: f64 = 0.95;
/// Pixels of one class on either side of a border; thinner objects and isolated wrong labels have none.
const RUN: usize = 3;

/// Tiles of a label image, and largest displacement from its borders.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    /// Largest displacement, in pixels, along rows and columns.
    pub reach: usize,
    /// Rows and columns of tiles, which together cover the image.
    pub tiles: (usize, usize),
}

/// Sums the range steps over the borders in each block of consecutive entries of a sweep, at every displacement.
///
/// A border is between two consecutive points of different classes; a step is the logarithm of the ratio of their
/// ranges.
///
/// Returns `num_blocks` rows of `2 * reach + 1` sums; in column `reach + s` the steps are `s` entries after the
/// borders. Points without a class have no borders, and neither have the first and last `reach` entries.
pub fn steps_at_point_borders(
    points: &[[f32; 3]],
    classes: &[u8],
    reach: usize,
    num_blocks: usize,
) -> Vec<f32> {
    let ranges: Vec<f32> = points.iter().map(|[x, y, z]| (x * x + y * y + z * z).sqrt()).collect();
    let step = |pair: &[f32]| (pair[1] / pair[0]).ln().abs().min(MAX_LOG_STEP);
    let steps: Vec<f32> = ranges.windows(2).map(step).collect();
    let width = 2 * reach + 1;
    let mut sums = vec![0.0; num_blocks * width];
    for (start, window) in steps.windows(width).enumerate() {
        let (before, after) = (classes[start + reach], classes[start + reach + 1]);
        if before != after && before != NO_CLASS && after != NO_CLASS {
            let block = (start + reach) * num_blocks / steps.len();
            add(&mut sums[block * width..][..width], window);
        }
    }
    sums
}

/// Sums the image steps over the borders in each tile of a label image, at every displacement.
///
/// A border is between two neighbouring pixels, each the end of a run of equal labels. A step is the largest
/// difference of a colour channel, and at most one.
///
/// The image has three channels per pixel, row by row.
///
/// Returns a table of `(2 * reach + 1)^2` sums for each tile, row by row; in row `reach + y` and column `reach + x`
/// of a table the steps are `x` pixels right of the borders and `y` below.
pub fn steps_at_pixel_borders(image: &[[u8; 3]], classes: &LabelImage<u8>, tiling: Tiling) -> Vec<f32> {
    let side = 2 * tiling.reach + 1;
    let mut sums = vec![0.0; tiling.tiles.0 * tiling.tiles.1 * side * side];
    for direction in [1, classes.width] {
        add_steps_along(image, classes, tiling, direction, &mut sums);
    }
    sums
}

/// Adds the steps between pixels `stride` apart in memory.
fn add_steps_along(
    image: &[[u8; 3]],
    classes: &LabelImage<u8>,
    tiling: Tiling,
    stride: usize,
    sums: &mut [f32],
) {
    let (width, height, reach) = (classes.width, classes.height, tiling.reach);
    let margin = reach.max(RUN);
    let side = 2 * reach + 1;
    let (steps, limit) = cut_steps(image, stride);
    let mut counts = vec![0u32; sums.len()];
    for v in margin..height.saturating_sub(margin) {
        for u in margin..width.saturating_sub(margin) {
            if !is_border(&classes.ids, v * width + u, stride) {
                continue;
            }
            let tile = v * tiling.tiles.0 / height * tiling.tiles.1 + u * tiling.tiles.1 / width;
            let table = &mut counts[tile * side * side..][..side * side];
            for (row, v) in table.chunks_exact_mut(side).zip(v - reach..) {
                add(row, &steps[v * width + u - reach..][..side]);
            }
        }
    }
    for (sum, count) in sums.iter_mut().zip(counts) {
        *sum += count as f32 / f32::from(limit);
    }
}

/// Differences of pixels `stride` apart, clipped to the limit that is returned with them.
fn cut_steps(image: &[[u8; 3]], stride: usize) -> (Vec<u8>, u8) {
    let channels = image.as_flattened();
    // Byte against byte, which compilers vectorise.
    let later = channels.get(3 * stride..).unwrap_or_default();
    let differences: Vec<u8> = channels.iter().zip(later).map(|(a, b)| a.abs_diff(*b)).collect();
    let (differences, _) = differences.as_chunks::<3>();
    let mut steps: Vec<u8> = differences.iter().map(|[a, b, c]| *a.max(b).max(c)).collect();
    steps.resize(image.len(), 0);
    let mut histogram = [0usize; 256];
    for &step in &steps {
        histogram[usize::from(step)] += 1;
    }
    let mut num_below = 0;
    let mut is_below = |count: &usize| {
        num_below += count;
        (num_below as f64) < SHARE_UNCUT * image.len() as f64
    };
    let limit = histogram.iter().take_while(|count| is_below(count)).count().clamp(1, 255) as u8;
    for step in &mut steps {
        *step = (*step).min(limit);
    }
    (steps, limit)
}

/// Whether a border is between a pixel and the one `stride` after it.
fn is_border(ids: &[u8], index: usize, stride: usize) -> bool {
    let (before, after) = (ids[index], ids[index + stride]);
    before != after
        && before != NO_CLASS
        && after != NO_CLASS
        && (1..RUN).all(|n| ids[index - n * stride] == before && ids[index + (n + 1) * stride] == after)
}

fn add<S: std::ops::AddAssign + From<T>, T: Copy>(sums: &mut [S], summands: &[T]) {
    for (sum, &summand) in sums.iter_mut().zip(summands) {
        *sum += summand.into();
    }
}
