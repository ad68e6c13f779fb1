//! Reading of sweeps and of their labels, in any format.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::limit::{self, Limit, ParseResult};
use super::options::Reading;
use super::record_layout::RecordLayout;
use super::table::Table;
use super::{PointCloud, delimited, npy, pcd, ply, raw};
use crate::error::{Error, Result};
use crate::file::{OpenFile, extension};
use crate::probabilities;

/// File format of a point cloud.
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
    /// Numbers in lines, with names or x y z (intensity).
    Csv,
    /// Leica's `.pts`.
    Pts,
    /// Leica's `.ptx` of one scan.
    Ptx,
}

impl Format {
    /// The format by the file's suffix. A `.bin` does not say how many columns it has. Unless the user does, the name
    /// decides: `.pcd.bin` has nuScenes' five, any other KITTI's four.
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
            "csv" => Ok(Self::Csv),
            "pts" => Ok(Self::Pts),
            "ptx" => Ok(Self::Ptx),
            other => {
                let needed = ".bin, .pcd.bin, .pcd, .ply, .npy, .npz, .csv, .pts, .ptx, .las, .laz or .e57";
                Err(Error::file(path, format!("point cloud format '{other}' is not known, needs {needed}")))
            }
        }
    }

    fn parse<'a>(self, bytes: &'a [u8], reading: &Reading) -> ParseResult<Table<'a>> {
        let mut table = match self {
            Self::Kitti | Self::NuScenes => {
                raw::parse(bytes, &RecordLayout::usual(self == Self::NuScenes), reading)
            }
            Self::Pcd => pcd::parse(bytes, reading),
            Self::Ply => ply::parse(bytes, reading),
            Self::Npy => npy::parse(bytes, reading),
            Self::Npz => npy::parse_archive(bytes, reading),
            Self::Csv => delimited::parse_csv(bytes, reading),
            Self::Pts => delimited::parse_pts(bytes, reading),
            Self::Ptx => delimited::parse_ptx(bytes, reading),
        }?;
        table.seconds_per_tick = reading.seconds_per_unit.unwrap_or(table.seconds_per_tick);
        table.own_points.clone_from(&reading.own_points);
        Ok(table)
    }
}

/// Reads many sweeps with their labels in parallel; the error of the first failing frame wins. The sizes of all
/// files are checked before the first is read, and large ones are not read all at once.
///
/// # Errors
/// Those of [`read`].
pub fn read_all(paths: &[(PathBuf, Option<PathBuf>)], reading: &Reading) -> Result<Vec<PointCloud>> {
    let sizes =
        paths.iter().map(|files| content_bytes(files, reading.limit)).collect::<Result<Vec<u64>>>()?;
    let mut clouds = Vec::with_capacity(paths.len());
    for group in limit::groups(&sizes) {
        let read = |(points, labels): &(PathBuf, Option<PathBuf>)| read(points, labels.as_deref(), reading);
        let clouds_of_group: Vec<Result<PointCloud>> = paths[group].par_iter().map(read).collect();
        for cloud in clouds_of_group {
            clouds.push(cloud?);
        }
    }
    Ok(clouds)
}

/// Checks the size of a sweep's files, and returns how many bytes its content takes. Missing files are left to
/// those who read them.
fn content_bytes((points, labels): &(PathBuf, Option<PathBuf>), limit: Limit) -> Result<u64> {
    let mut sum = 0;
    for path in [points].into_iter().chain(labels) {
        let size = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
        limit.check_bytes(size).map_err(|reason| Error::file(path, reason))?;
        sum += size;
    }
    let unpacked = match Format::of(points) {
        Ok(Format::Pcd) => pcd::unpacked_bytes(points),
        Ok(Format::Npz) => npy::unpacked_bytes(points),
        _ => None,
    };
    Ok(sum.saturating_add(unpacked.unwrap_or_default()))
}

/// Reads one sweep and one label for each of its entries, from `labels` or else from the cloud's own label field,
/// if any.
///
/// # Errors
/// A file cannot be read or is too large, its size or content does not match its format, the counts of points and
/// labels differ, a label is not a class id, or there is no return of the LiDAR.
pub fn read(points: &Path, labels: Option<&Path>, reading: &Reading) -> Result<PointCloud> {
    let file = OpenFile::open(points)?;
    reading.limit.check_bytes(file.size()).map_err(|reason| Error::file(points, reason))?;
    let bytes = file.bytes()?;
    read_as(Format::of(points)?, points, &bytes, labels, reading)
}

/// Reads a sweep from its bytes; `points` is its name in error messages.
///
/// # Errors
/// Those of [`read`].
pub fn read_as(
    format: Format,
    points: &Path,
    bytes: &[u8],
    labels: Option<&Path>,
    reading: &Reading,
) -> Result<PointCloud> {
    let complain = |reason: String| Error::file(points, reason);
    let table = format.parse(bytes, reading).map_err(complain)?;
    let Some(path) = labels else {
        return decode_table(&table).map_err(complain);
    };
    let (mut cloud, returns) = table.decode();
    table.check_points(&cloud).map_err(complain)?;
    if extension(path) == "npz" {
        let shares = probabilities::read(path, &[table.num_records()])?;
        cloud.label_shares = Some(shares.kept(returns.keep()));
        return Ok(cloud);
    }
    let file = OpenFile::open(path)?;
    raw::check_size(path, file.size(), table.num_records(), points)?;
    let label_bytes = file.bytes()?;
    let labels = raw::parse_labels(path, &label_bytes).map_err(|reason| Error::file(path, reason))?;
    raw::check_count(path, labels.num_records(), table.num_records(), points)?;
    cloud.labels = Some(labels.ids(&returns).map_err(|reason| Error::file(path, reason))?);
    Ok(cloud)
}

/// Decodes a file's bytes; labels are those of the cloud's own label field.
///
/// # Errors
/// A message without the file's name: the size or content does not match the format, a label is not a class id, or
/// there is no return.
pub fn decode(format: Format, bytes: &[u8]) -> std::result::Result<PointCloud, String> {
    decode_table(&format.parse(bytes, &Reading::default())?)
}

fn decode_table(table: &Table<'_>) -> ParseResult<PointCloud> {
    let (mut cloud, returns) = table.decode();
    table.check_points(&cloud)?;
    cloud.labels = table.labels().map(|labels| labels.ids(&returns)).transpose()?;
    Ok(cloud)
}
