//! The meaning of a cloud's named fields, for all formats that name them.

use super::column::Scalar;
use super::limit::{ParseResult, quoted};
use super::own_points::OwnPoints;

/// One item, such as a column, for each field in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fields<T> {
    /// x, y, z.
    pub xyz: [T; 3],
    pub intensity: Option<T>,
    pub ring: Option<T>,
    pub time: Option<T>,
    pub label: Option<T>,
    /// The field that tells the LiDAR's own points, if the user states one.
    pub own: Option<T>,
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
            own: self.own.map(&f).transpose()?,
        })
    }

    /// All fields that the cloud has.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        let others = [&self.intensity, &self.ring, &self.time, &self.label, &self.own];
        self.xyz.iter().chain(others.into_iter().flatten())
    }
}

/// Finds the fields by name, in any case and order; CloudCompare's prefix `scalar_` is ignored.
///
/// # Errors
/// There is no x, y or z, or not the field that tells the LiDAR's own points.
pub(super) fn find(names: &[&str], own: Option<&OwnPoints>) -> ParseResult<Fields<usize>> {
    let plain: Vec<String> = names.iter().map(|name| plain(name)).collect();
    let position = |wanted: &[&str]| wanted.iter().find_map(|w| plain.iter().position(|name| name == w));
    let axis = |name| {
        position(&[name]).ok_or_else(|| format!("has {}, needs x, y and z", listed("field", names, SHOWN)))
    };
    Ok(Fields {
        xyz: [axis("x")?, axis("y")?, axis("z")?],
        intensity: position(INTENSITY),
        ring: position(RING),
        time: position(TIME),
        label: position(LABEL),
        own: own.map(|own| find_own(names, own)).transpose()?,
    })
}

/// Finds the field that tells the LiDAR's own points, or lists those that there are.
pub(super) fn find_own(names: &[&str], own: &OwnPoints) -> ParseResult<usize> {
    let missing = || own.missing_in(&listed("field", names, SHOWN_OF_OWN));
    names.iter().position(|name| plain(name) == plain(&own.field)).ok_or_else(missing)
}

/// The unit of a time field: integers are nanoseconds (Ouster's `t`, Livox' `offset_time`), others seconds.
pub(super) fn seconds_per_tick(scalar: Scalar) -> f64 {
    if scalar.is_float() { 1.0 } else { 1e-9 }
}

fn plain(name: &str) -> String {
    let name = name.to_ascii_lowercase();
    name.strip_prefix("scalar_").map(str::to_owned).unwrap_or(name)
}

/// Number of fields that a message names, and where a user has to choose one of them.
const SHOWN: usize = 8;
pub(super) const SHOWN_OF_OWN: usize = 32;

/// The names of things of a kind, such as fields, in a message.
pub(super) fn listed(kind: &str, names: &[impl AsRef<str>], shown: usize) -> String {
    let quoted: Vec<String> = names.iter().take(shown).map(|name| quoted(name.as_ref().as_bytes())).collect();
    match names.len() {
        0 => format!("no {kind}"),
        all if all <= shown => format!("the {kind}s {}", quoted.join(" ")),
        all => format!("the {kind}s {} and {} more", quoted.join(" "), all - shown),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_writers() {
        let rellis = find(&["x", "y", "z", "intensity", "t", "reflectivity", "ring", "noise", "range"], None);
        let expected = Fields {
            xyz: [0, 1, 2],
            intensity: Some(3),
            ring: Some(6),
            time: Some(4),
            label: None,
            own: None,
        };
        assert_eq!(rellis, Ok(expected));
        let carla = find(&["x", "y", "z", "CosAngle", "ObjIdx", "ObjTag"], None).expect("x y z");
        assert_eq!((carla.label, carla.intensity), (Some(5), None));
        let cloud_compare =
            find(&["scalar_Classification", "Z", "Y", "X", "scalar_GpsTime"], None).expect("x y z");
        assert_eq!(
            (cloud_compare.label, cloud_compare.xyz, cloud_compare.time),
            (Some(0), [3, 2, 1], Some(4))
        );
        assert_eq!(find(&["x", "z"], None), Err("has the fields x z, needs x, y and z".into()));
        let many = ["a"; 10];
        assert_eq!(
            find(&many, None),
            Err("has the fields a a a a a a a a and 2 more, needs x, y and z".into())
        );
    }
}
