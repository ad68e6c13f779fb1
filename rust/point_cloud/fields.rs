//! The meaning of a cloud's named fields, for all formats that name them.

use super::column::Scalar;
use super::limit::{ParseResult, quoted};

/// One item, such as a column, for each field in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fields<T> {
    /// x, y, z.
    pub xyz: [T; 3],
    pub intensity: Option<T>,
    pub ring: Option<T>,
    pub time: Option<T>,
    pub label: Option<T>,
}

/// Field names in lower case, the preferred first. Sources: Ouster's and Velodyne's ROS drivers (`t`, `time`),
/// Livox' (`line`, `offset_time`), CARLA (`I`, `ObjTag`), KITTI-360 (`semantic`), CloudCompare (`Classification`,
/// `GpsTime`).
const INTENSITY: &[&str] = &["intensity", "i", "reflectance", "reflectivity", "remission"];
const RING: &[&str] = &["ring", "channel", "laser_id", "line", "beam"];
const TIME: &[&str] = &["t", "time", "timestamp", "offset_time", "time_offset", "gps_time", "gpstime"];
/// The names of the field that holds class ids.
pub const LABEL: &[&str] =
    &["label", "labels", "class", "class_id", "classification", "semantic", "semantic_label", "objtag"];

impl<T> Fields<T> {
    pub(super) fn try_map<U, E>(self, f: impl Fn(T) -> Result<U, E>) -> Result<Fields<U>, E> {
        let [x, y, z] = self.xyz;
        Ok(Fields {
            xyz: [f(x)?, f(y)?, f(z)?],
            intensity: self.intensity.map(&f).transpose()?,
            ring: self.ring.map(&f).transpose()?,
            time: self.time.map(&f).transpose()?,
            label: self.label.map(&f).transpose()?,
        })
    }

    /// All fields that the cloud has.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        self.xyz.iter().chain(&self.intensity).chain(&self.ring).chain(&self.time).chain(&self.label)
    }
}

/// Finds the fields by name, in any case and order; CloudCompare's prefix `scalar_` is ignored.
pub(super) fn find(names: &[&str]) -> ParseResult<Fields<usize>> {
    let plain: Vec<String> = names.iter().map(|name| plain(name)).collect();
    let position = |wanted: &[&str]| wanted.iter().find_map(|w| plain.iter().position(|name| name == w));
    let axis = |name| position(&[name]).ok_or_else(|| format!("has {}, needs x, y and z", listed(names)));
    Ok(Fields {
        xyz: [axis("x")?, axis("y")?, axis("z")?],
        intensity: position(INTENSITY),
        ring: position(RING),
        time: position(TIME),
        label: position(LABEL),
    })
}

/// The unit of a time field: integers are nanoseconds (Ouster's `t`, Livox' `offset_time`), others seconds.
pub(super) fn seconds_per_tick(scalar: Scalar) -> f64 {
    if scalar.is_float() { 1.0 } else { 1e-9 }
}

fn plain(name: &str) -> String {
    let name = name.to_ascii_lowercase();
    name.strip_prefix("scalar_").map(str::to_owned).unwrap_or(name)
}

fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let quoted: Vec<String> = names.iter().take(SHOWN).map(|name| quoted(name.as_bytes())).collect();
    match names.len() {
        0 => "no field".into(),
        1..=SHOWN => format!("the fields {}", quoted.join(" ")),
        more => format!("the fields {} and {} more", quoted.join(" "), more - SHOWN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_writers() {
        let rellis = find(&["x", "y", "z", "intensity", "t", "reflectivity", "ring", "noise", "range"]);
        let expected =
            Fields { xyz: [0, 1, 2], intensity: Some(3), ring: Some(6), time: Some(4), label: None };
        assert_eq!(rellis, Ok(expected));
        let carla = find(&["x", "y", "z", "CosAngle", "ObjIdx", "ObjTag"]).expect("x y z");
        assert_eq!((carla.label, carla.intensity), (Some(5), None));
        let cloud_compare = find(&["scalar_Classification", "Z", "Y", "X", "scalar_GpsTime"]).expect("x y z");
        assert_eq!(
            (cloud_compare.label, cloud_compare.xyz, cloud_compare.time),
            (Some(0), [3, 2, 1], Some(4))
        );
        assert_eq!(find(&["x", "z"]), Err("has the fields x z, needs x, y and z".into()));
        let many = ["a"; 10];
        assert_eq!(find(&many), Err("has the fields a a a a a a a a and 2 more, needs x, y and z".into()));
    }
}
