//! What the reading of a file depends on besides its contents.

use super::limit::Limit;
use super::own_points::OwnPoints;
use super::record_layout::RecordLayout;

/// How files are read: their limit, and what the user states of files that do not say it themselves.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// Largest sweep that is read.
    pub limit: Limit,
    /// Columns of `.bin` files; `None` reads the usual ones of the suffix, if the numbers are in them.
    pub layout: Option<RecordLayout>,
    /// Seconds of one unit of the points' times; `None` takes integers for nanoseconds and others for seconds.
    pub seconds_per_unit: Option<f64>,
    /// Which points of a cloud are the LiDAR's own; `None` reads all.
    pub own_points: Option<OwnPoints>,
}
