//! Settings.

/// Settings of the segmentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentationConfig {
    /// A point is ground if it lies no farther than this above or below the ground's surface.
    pub ground_tolerance_m: f64,
    /// Longest extent of a segment of the ground.
    pub ground_cell_m: f64,
    /// Returns with less than this between them belong together, however near the sensor.
    pub object_gap_m: f64,
    /// Factor on the distance of neighbouring rays at a return's range, which adds to `object_gap_m`.
    pub object_gap_rays: f64,
    /// Longest extent of a segment of an object.
    pub object_cell_m: f64,
    /// Least number of points of a segment in a dense sweep.
    pub min_points: usize,
}

impl SegmentationConfig {
    /// The largest gap within an object, metres, where neighbouring rays are `rays` radians apart.
    pub(super) fn gap(&self, range: f64, rays: f64) -> f64 {
        self.object_gap_m + self.object_gap_rays * range * rays
    }
}
