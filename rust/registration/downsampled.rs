//! Label images on the cells of the registration.

use nalgebra::Point2;
use rayon::prelude::*;

use crate::label_image::LabelImage;
use crate::observation::Observations;
use crate::zoom::{Zoomed, majority};

/// Label images in blocks, and the block's size in pixels.
pub(super) struct Downsampled {
    pub factor: usize,
    pub images: Vec<LabelImage<u8>>,
}

impl Downsampled {
    #[inline]
    pub fn class(&self, frame: usize, pixel: &Point2<f64>) -> u8 {
        let block = |x: f64| (x + 0.5) as usize / self.factor;
        self.images[frame].at(block(pixel.x), block(pixel.y))
    }
}

/// Blocks are about as wide as a cell at the middle of the picture.
pub(super) fn downsampled(observations: &Observations, zoomed: &Zoomed, cell: f64) -> Downsampled {
    let pixels_per_radian = observations.camera.width as f64 / zoomed.horizontal_fov();
    let factor = ((pixels_per_radian * cell).round() as usize).max(1);
    let images = observations.frames.par_iter().map(|f| majority(&f.image_classes, factor)).collect();
    Downsampled { factor, images }
}
