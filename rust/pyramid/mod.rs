//! The label pyramid: class shares of label images in blocks of pixels, and their values under a pixel.

mod averaging;
mod label_map;
mod sampled;
mod share_map;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use crate::classes::ClassShares;
use crate::label_image::LabelImage;

pub use averaging::WORD;
pub use label_map::{DenseMap, LabelMap};
pub use sampled::{AnyCorners, Corners, Sampled};
pub use share_map::ShareMap;

/// A label image and its levels, which the stages of a calibration use repeatedly.
#[derive(Debug)]
pub struct LabelPyramid {
    pub classes: Arc<LabelImage<u8>>,
    /// Class shares of each pixel, if a network gave them; `classes` then holds the largest. A pixel without a
    /// class carries no information, whatever its shares.
    pub shares: Option<Arc<ClassShares>>,
    /// Standard deviation, pixels, of the Gaussian by which classes without borders, such as levels of a gradient, are
    /// blurred at full resolution. There is no band along the borders of such classes.
    blur_px: Option<f64>,
    levels: Mutex<Levels>,
}

/// Levels by the side of a block and the width of the band along borders.
type Levels = HashMap<(usize, usize), Arc<Mutex<Level>>>;

/// A level of the pyramid, or a place for one.
#[derive(Debug, Default)]
struct Level {
    map: Weak<ShareMap>,
    /// Keeps the finest level, with which most stages end. Others take memory only while they are in use.
    _kept: Option<Arc<ShareMap>>,
}

impl LabelPyramid {
    pub fn new(classes: Arc<LabelImage<u8>>, shares: Option<Arc<ClassShares>>, blur_px: Option<f64>) -> Self {
        Self { classes, shares, blur_px, levels: Mutex::default() }
    }

    /// The level with blocks of `factor` pixels, in which pixels along borders count little: see [`ShareMap`]. It
    /// is shared for as long as it is in use.
    pub fn level(&self, factor: usize, edge_band_px: usize) -> Arc<ShareMap> {
        let level = Arc::clone(locked(&self.levels).entry((factor, edge_band_px)).or_default());
        let mut level = locked(&level);
        if let Some(map) = level.map.upgrade() {
            return map;
        }
        let map = Arc::new(match (&self.shares, self.blur_px) {
            (Some(shares), _) => ShareMap::of_shares(&self.classes, shares, factor),
            (None, Some(blur_px)) if factor == 1 && blur_px > 0.0 => {
                ShareMap::blurred(&self.classes, blur_px)
            }
            (None, Some(_)) => ShareMap::of_levels(&self.classes, factor),
            (None, None) if factor == 1 => ShareMap::of_pixels(&self.classes, edge_band_px),
            (None, None) => ShareMap::of_blocks(&self.classes, &self.level(1, edge_band_px), factor),
        });
        *level = Level { map: Arc::downgrade(&map), _kept: (factor == 1).then(|| Arc::clone(&map)) };
        map
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_made_once_while_it_is_used_and_the_finest_one_is_kept() {
        let image = LabelImage { width: 4, height: 2, ids: vec![0, 0, 1, 1, 0, 0, 1, 1] };
        let pyramid = LabelPyramid::new(Arc::new(image), None, None);
        let level = pyramid.level(2, 0);
        assert!(Arc::ptr_eq(&level, &pyramid.level(2, 0)));
        assert!(!Arc::ptr_eq(&level, &pyramid.level(2, 1)));
        let (coarse, finest) = (Arc::downgrade(&level), Arc::downgrade(&pyramid.level(1, 1)));
        drop(level);
        assert!(coarse.upgrade().is_none() && finest.upgrade().is_some());
    }
}
