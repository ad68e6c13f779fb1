//! Point clouds and their labels, as they lie on disk.
//!
//! Each format's parser finds out where in the file's bytes which column lies; [`table`] goes on from there.

mod ascii;
mod cloud;
mod column;
mod fields;
mod kitti;
mod labels;
pub mod lzf;
mod npy;
mod npz;
mod parsed;
mod pcd;
mod ply;
mod table;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::file::{extension, read_bytes};
use crate::probabilities;
use parsed::Parsed;
use table::Table;

pub use cloud::PointCloud;

/// How a point cloud lies in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    /// KITTI's `.bin`: x y z intensity, float32.
    Kitti,
    /// nuScenes' `.pcd.bin`: x y z intensity ring, float32.
    NuScenes,
    /// PCL's `.pcd`.
    Pcd,
    /// Stanford's `.ply`.
    Ply,
    /// NumPy's `.npy`.
    Npy,
    /// NumPy's `.npz`.
    Npz,
}

impl Format {
    /// By the file's suffix. A `.bin` does not say how many columns it has, so only the name can: `.pcd.bin` has
    /// nuScenes' five, any other KITTI's four.
    ///
    /// # Errors
    /// The suffix is not known.
    pub fn of(path: &Path) -> Result<Self> {
        let stem = path.file_stem().map(Path::new).unwrap_or(Path::new(""));
        match extension(path).as_str() {
            "bin" if extension(stem) == "pcd" => Ok(Self::NuScenes),
            "bin" => Ok(Self::Kitti),
            "pcd" => Ok(Self::Pcd),
            "ply" => Ok(Self::Ply),
            "npy" => Ok(Self::Npy),
            "npz" => Ok(Self::Npz),
            other => {
                let needed = ".bin, .pcd.bin, .pcd, .ply, .npy, .npz, .las or .laz";
                Err(Error::file(path, format!("point cloud format '{other}' is not known, needs {needed}")))
            }
        }
    }

    fn parse(self, bytes: &[u8]) -> Parsed<Table<'_>> {
        match self {
            Self::Kitti => kitti::parse(bytes, 4),
            Self::NuScenes => kitti::parse(bytes, 5),
            Self::Pcd => pcd::parse(bytes),
            Self::Ply => ply::parse(bytes),
            Self::Npy => npy::parse(bytes),
            Self::Npz => npz::parse(bytes),
        }
    }
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

/// Reads one sweep and one label for each of its entries: from `labels`, or else from the cloud's own label field if it
/// has one.
///
/// # Errors
/// A file cannot be read, its size or content is not its format's, the counts of points and labels differ, a label is
/// no class id, or there is no return in it.
pub fn read(points: &Path, labels: Option<&Path>) -> Result<PointCloud> {
    let bytes = read_bytes(points)?;
    read_as(Format::of(points)?, points, &bytes, labels)
}

/// The same from the bytes of a sweep; `points` is the name that complaints give it.
///
/// # Errors
/// As [`read`].
pub fn read_as(format: Format, points: &Path, bytes: &[u8], labels: Option<&Path>) -> Result<PointCloud> {
    let complain = |reason: String| Error::file(points, reason);
    let table = format.parse(bytes).map_err(complain)?;
    let Some(path) = labels else {
        return decode_table(&table).map_err(complain);
    };
    let (mut cloud, returns) = table.decode();
    check_returns(&cloud).map_err(complain)?;
    if extension(path) == "npz" {
        let shares = probabilities::read(path, &[table.num_records()])?;
        cloud.label_shares = Some(shares.kept(returns.keep()));
        return Ok(cloud);
    }
    let label_bytes = read_bytes(path)?;
    let labels = labels::parse(path, &label_bytes).map_err(|reason| Error::file(path, reason))?;
    if labels.num_records() != table.num_records() {
        let (found, needed) = (labels.num_records(), table.num_records());
        let reason = format!("{found} labels for the {needed} points of {}", points.display());
        return Err(Error::file(path, reason));
    }
    cloud.labels = Some(labels.ids(&returns).map_err(|reason| Error::file(path, reason))?);
    Ok(cloud)
}

/// Decodes a file's bytes; labels are those of the cloud's own label field.
///
/// # Errors
/// The size or content is not the format's, a label is no class id, or there is no return: in words, without a name.
pub fn decode(format: Format, bytes: &[u8]) -> std::result::Result<PointCloud, String> {
    decode_table(&format.parse(bytes)?)
}

fn decode_table(table: &Table<'_>) -> Parsed<PointCloud> {
    let (mut cloud, returns) = table.decode();
    check_returns(&cloud)?;
    cloud.labels = table.labels().map(|labels| labels.ids(&returns)).transpose()?;
    Ok(cloud)
}

fn check_returns(cloud: &PointCloud) -> Parsed<()> {
    match cloud.points[..] {
        [] if cloud.num_no_returns == 0 => Err("holds no points".into()),
        [] => Err("holds no returns: every point is zero or not finite".into()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod tests;
