//! Point clouds and their labels, as they lie on disk.

mod kitti;
mod npy;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::file::{extension, read_bytes};

/// A sweep without its "no return" entries.
#[derive(Clone, Debug, PartialEq)]
pub struct PointCloud {
    /// `x y z` in metres, LiDAR frame.
    pub points: Vec<[f32; 3]>,
    /// As recorded, where the format has it.
    pub intensity: Option<Vec<f32>>,
    /// Raw class ids, where a label file was given.
    pub labels: Option<Vec<u16>>,
    /// Entries that were not finite or all zero, and were left out.
    pub num_no_returns: usize,
}

/// What a file holds, before no-returns are dropped.
struct RawCloud {
    points: Vec<[f32; 3]>,
    intensity: Option<Vec<f32>>,
}

/// Reads many sweeps with their labels, in parallel; the first failing frame's error wins.
///
/// # Errors
/// As [`read`].
pub fn read_all(paths: &[(PathBuf, Option<PathBuf>)]) -> Result<Vec<PointCloud>> {
    let clouds: Vec<Result<PointCloud>> =
        paths.par_iter().map(|(points, labels)| read(points, labels.as_deref())).collect();
    clouds.into_iter().collect()
}

/// Reads one sweep and, if given, one label for each of its entries.
///
/// # Errors
/// A file cannot be read, its size or content is not its format's, the counts of points and labels differ, or there is
/// no return in it.
pub fn read(points: &Path, labels: Option<&Path>) -> Result<PointCloud> {
    let raw = match extension(points).as_str() {
        "bin" => kitti::read_points(points),
        "npy" => npy::read_points(points),
        other => {
            Err(Error::file(points, format!("point cloud format '{other}' is not known, needs .bin or .npy")))
        }
    }?;
    let raw_labels = labels.map(read_labels).transpose()?;
    if let (Some(path), Some(ids)) = (labels, &raw_labels)
        && ids.len() != raw.points.len()
    {
        let reason =
            format!("{} labels for the {} points of {}", ids.len(), raw.points.len(), points.display());
        return Err(Error::file(path, reason));
    }
    let cloud = drop_no_returns(raw, raw_labels);
    if cloud.points.is_empty() {
        return Err(Error::file(points, "holds no returns: every point is zero or not finite"));
    }
    Ok(cloud)
}

fn read_labels(path: &Path) -> Result<Vec<u16>> {
    match extension(path).as_str() {
        "label" => kitti::read_labels(path),
        "npy" => npy::read_labels(path),
        other => Err(Error::file(path, format!("label format '{other}' is not known, needs .label or .npy"))),
    }
}

fn drop_no_returns(raw: RawCloud, labels: Option<Vec<u16>>) -> PointCloud {
    let keep: Vec<bool> =
        raw.points.iter().map(|p| p.iter().all(|x| x.is_finite()) && *p != [0.0; 3]).collect();
    PointCloud {
        points: select(raw.points, &keep),
        intensity: raw.intensity.map(|x| select(x, &keep)),
        labels: labels.map(|x| select(x, &keep)),
        num_no_returns: keep.iter().filter(|&&k| !k).count(),
    }
}

fn select<T>(values: Vec<T>, keep: &[bool]) -> Vec<T> {
    let pairs = values.into_iter().zip(keep);
    pairs.filter_map(|(value, &k)| k.then_some(value)).collect()
}

/// A file's bytes, whose number must be a multiple of one record's.
fn read_records(path: &Path, record_bytes: usize) -> Result<Vec<u8>> {
    let bytes = read_bytes(path)?;
    if bytes.len().is_multiple_of(record_bytes) {
        Ok(bytes)
    } else {
        Err(Error::file(path, format!("{} bytes is not a multiple of {record_bytes}", bytes.len())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(name: &str, bytes: &[u8]) -> PathBuf {
        let path = std::env::temp_dir().join(format!("semcal_{}_{name}", std::process::id()));
        std::fs::write(&path, bytes).expect("a writable temporary folder");
        path
    }

    fn bytes(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn no_returns_are_dropped_with_their_labels() {
        let values = [1.0, 2.0, 3.0, 0.5, 0.0, 0.0, 0.0, 0.0, f32::NAN, 1.0, 1.0, 1.0, 4.0, 5.0, 6.0, 0.7];
        let points = file("a.bin", &bytes(&values));
        let ids = [7u32, 8, 9, 10 | (3 << 16)];
        let labels = file("a.label", &ids.map(u32::to_le_bytes).concat());
        let cloud = read(&points, Some(&labels)).expect("a valid cloud");
        assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(cloud.labels, Some(vec![7, 10]), "the instance in the high bits is dropped");
        assert_eq!(cloud.intensity, Some(vec![0.5, 0.7]));
        assert_eq!(cloud.num_no_returns, 2);
    }

    #[test]
    fn counts_that_disagree_name_both_files() {
        let points = file("b.bin", &bytes(&[1.0; 8]));
        let labels = file("b.label", &[0; 12]);
        let message = read(&points, Some(&labels)).expect_err("3 labels, 2 points").to_string();
        assert!(
            message.ends_with(&format!("3 labels for the 2 points of {}", points.display())),
            "{message}"
        );
        let message = read(&labels, None).expect_err("no cloud").to_string();
        assert!(
            message.ends_with("point cloud format 'label' is not known, needs .bin or .npy"),
            "{message}"
        );
        let odd = file("c.bin", &[0; 1921]);
        let message = read(&odd, None).expect_err("odd size").to_string();
        assert!(message.ends_with("1921 bytes is not a multiple of 16"), "{message}");
    }
}
