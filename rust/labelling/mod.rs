//! Network outputs, transferred to the pixels of images and to the points of sweeps.

mod range_view;
mod scores;

pub use range_view::{EMPTY, Neighbors, RangeProjection, RangeView};
pub use scores::{NO_VIEW, Places, Scores};
