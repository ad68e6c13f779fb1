//! The label pyramid: class shares of label images in blocks of pixels, and what they are under a pixel.

mod averaging;
mod sampled;
mod share_map;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::class_shares::ClassShares;
use crate::label_image::LabelImage;

pub use sampled::{Sampled, Shares};
pub use share_map::ShareMap;

/// A label image, and its levels, each made once: the stages of a calibration look at the same ones again and again.
#[derive(Debug)]
pub struct LabelPyramid {
    /// One class for each pixel.
    pub classes: Arc<LabelImage<u8>>,
    /// Shares of classes of each pixel, where a network gave them; the classes are then the largest. A pixel without a
    /// class carries no information, whatever its shares are.
    pub shares: Option<Arc<ClassShares>>,
    /// By the side of a block and the width of the band along borders.
    levels: Mutex<HashMap<(usize, usize), Level>>,
}

/// A level that is made when it is first looked at, and by one thread.
type Level = Arc<OnceLock<Arc<ShareMap>>>;

impl LabelPyramid {
    /// A pyramid without levels as yet.
    pub fn new(classes: Arc<LabelImage<u8>>, shares: Option<Arc<ClassShares>>) -> Self {
        Self { classes, shares, levels: Mutex::default() }
    }

    /// The level of blocks of `factor` pixels, in which pixels along borders count little: see [`ShareMap::new`].
    pub fn level(&self, factor: usize, edge_band_px: usize) -> Arc<ShareMap> {
        let level = {
            let mut levels = self.levels.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(levels.entry((factor, edge_band_px)).or_default())
        };
        let make = || Arc::new(ShareMap::new(&self.classes, self.shares.as_deref(), factor, edge_band_px));
        Arc::clone(level.get_or_init(make))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_level_is_made_once() {
        let image = LabelImage { width: 4, height: 2, ids: vec![0, 0, 1, 1, 0, 0, 1, 1] };
        let pyramid = LabelPyramid::new(Arc::new(image), None);
        assert!(Arc::ptr_eq(&pyramid.level(2, 0), &pyramid.level(2, 0)));
        assert!(!Arc::ptr_eq(&pyramid.level(2, 0), &pyramid.level(2, 1)));
    }
}
