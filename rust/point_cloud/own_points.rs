//! Which points of a cloud are the LiDAR's own, where a cloud holds those of several LiDARs.

use super::column::Scalar;
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
    /// The ends of the range as numbers of a type: the float32 of a decimal number is another one than its float64.
    pub(super) fn range_as(&self, scalar: Scalar) -> [f64; 2] {
        self.range.map(|end| if scalar == Scalar::F32 { f64::from(end as f32) } else { end })
    }

    /// The refusal of a file without the field.
    pub(super) fn missing_in(&self, fields: &str) -> String {
        format!("found {fields}, expected '{}' among them, which {KEY}", quoted(self.field.as_bytes()))
    }

    /// The refusal of a file without a point in the range; `span` is from the smallest number to the largest, if there
    /// is one.
    pub(super) fn none_among(&self, span: Option<[f64; 2]>, scalar: Scalar) -> String {
        let ([first, last], field) = (self.range, quoted(self.field.as_bytes()));
        let shown =
            |value: f64| if scalar == Scalar::F32 { (value as f32).to_string() } else { value.to_string() };
        let found = span.map_or_else(
            || format!("no number in '{field}'"),
            |ends| format!("'{field}' from {}", ends.map(shown).join(" to ")),
        );
        format!("found {found}, expected points from {first} to {last}, as {KEY}")
    }
}
