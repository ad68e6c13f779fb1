//! Which points of a cloud are the LiDAR's own, where a cloud holds those of several LiDARs.

use super::limit::quoted;

/// A field of the files, and the values that it has at the LiDAR's own points.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnPoints {
    /// Name of the field, in any case.
    pub field: String,
    /// Smallest and largest value.
    pub range: [f64; 2],
}

/// The key of a drive that states them, and the option of an import.
const KEY: &str = "lidar.own_points states (--own-points at import)";

impl OwnPoints {
    pub(super) fn contains(&self, value: f64) -> bool {
        let [first, last] = self.range;
        first <= value && value <= last
    }

    /// The refusal of a file without the field.
    pub(super) fn missing_in(&self, fields: &str) -> String {
        format!("found {fields}, expected '{}' among them, which {KEY}", quoted(self.field.as_bytes()))
    }

    /// The refusal of a file whose values, from the smallest to the largest, are all others.
    pub(super) fn none_among(&self, [smallest, largest]: [f64; 2]) -> String {
        let ([first, last], field) = (self.range, quoted(self.field.as_bytes()));
        format!(
            "found no point whose '{field}' is from {first} to {last}, as {KEY}, but values from {smallest} to {largest}"
        )
    }
}
