//! Label images on the cells of the registration.

use nalgebra::Point2;
use rayon::prelude::*;

use crate::label_image::LabelImage;
use crate::observation::Observations;
use crate::zoom::{Zoomed, majority};

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
