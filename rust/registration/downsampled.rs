//! Label images on the cells of the registration.

use nalgebra::Point2;
use rayon::prelude::*;

use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;
use crate::observation::Observations;
use crate::zoom::Zoomed;

/// Label images in blocks.
pub(super) struct Downsampled {
    blocks_per_pixel: f64,
    images: Vec<LabelImage<u8>>,
}

impl Downsampled {
    /// The class at a pixel inside the image.
    #[inline]
    pub fn class(&self, frame: usize, pixel: &Point2<f64>) -> u8 {
        let image = &self.images[frame];
        // A product is faster than a division, and may end one block too far at the border.
        let block = |x: f64, count: usize| (((x + 0.5) * self.blocks_per_pixel) as usize).min(count - 1);
        image.at(block(pixel.x, image.width), block(pixel.y, image.height))
    }
}

/// Blocks are about as wide as a cell at the middle of the picture.
pub(super) fn downsampled(observations: &Observations, zoomed: &Zoomed, cell: f64) -> Downsampled {
    let pixels_per_radian = observations.camera.width as f64 / zoomed.horizontal_fov();
    let factor = ((pixels_per_radian * cell).round() as usize).max(1);
    let images = observations.frames.par_iter().map(|f| majority(&f.image.classes, factor)).collect();
    Downsampled { blocks_per_pixel: 1.0 / factor as f64, images }
}

/// A label image in blocks of `factor` pixels, each of the class that most of its pixels have (ties go to the lowest
/// class). Blocks cut by the border count the pixels they have.
pub fn majority(image: &LabelImage<u8>, factor: usize) -> LabelImage<u8> {
    let (width, height) = (image.width.div_ceil(factor), image.height.div_ceil(factor));
    let mut ids = Vec::with_capacity(width * height);
    let mut counts = vec![[0u32; 256]; width];
    for row in 0..height {
        counts.fill([0; 256]);
        for v in row * factor..((row + 1) * factor).min(image.height) {
            let line = &image.ids[v * image.width..(v + 1) * image.width];
            for (u, &id) in line.iter().enumerate() {
                counts[u / factor][usize::from(id)] += 1;
            }
        }
        ids.extend(
            counts
                .iter()
                .map(|c| (0..=NO_CLASS).rev().max_by_key(|&id| c[usize::from(id)]).unwrap_or(NO_CLASS)),
        );
    }
    LabelImage { width, height, ids }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn majority_ignores_nothing_and_breaks_ties_low() {
        let image = LabelImage { width: 5, height: 2, ids: vec![1, 1, 3, 2, 9, 1, 2, 2, 3, 9] };
        assert_eq!(majority(&image, 2).ids, [1, 2, 9]);
    }
}
