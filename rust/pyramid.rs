//! Class shares of label images: what one-hot label maps become when they are averaged over blocks.

use crate::label_image::LabelImage;
use crate::observation::NO_CLASS;

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
}
