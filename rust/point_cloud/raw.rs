//! Files without a header: KITTI's `.bin` (x y z intensity, float32) and nuScenes' `.pcd.bin` (x y z intensity
//! ring, float32), or with the columns that the user states; and files with one class id for each entry of a cloud.
//!
//! `.label`: SemanticKITTI's uint32, the low 16 bits are the class and the high ones an instance. `.bin`: nuScenes'
//! lidarseg, uint8. `.npy`: any integers. Sources: the development kits of KITTI's object benchmark and of nuScenes
//! (`LidarPointCloud.from_file`).

use std::path::Path;

use super::column::{Column, Scalar};
use super::fields::seconds_per_tick;
use super::limit::ParseResult;
use super::npy;
use super::options::Reading;
use super::record_layout::RecordLayout;
use super::table::{EntryValues, Table};
use crate::array_file::MAX_HEADER_BYTES;
use crate::error::{Error, Result};
use crate::file::{check_bytes, extension};

/// Records of one type of number, as the user states, or else as `usual` if the numbers are in these columns.
pub(super) fn parse<'a>(bytes: &'a [u8], usual: &RecordLayout, reading: &Reading) -> ParseResult<Table<'a>> {
    let stated = reading.layout.as_ref();
    let layout = stated.unwrap_or(usual);
    let num_records = count_records(bytes, layout.record_bytes()).map_err(|_| layout.misfit(bytes))?;
    reading.limit.check_points(num_records)?;
    layout.check(bytes, stated.is_some())?;
    let tick = layout.scalar_of_time().map_or(1.0, seconds_per_tick);
    let columns = layout.columns(reading.own_points.as_ref()).map_err(|reason| match stated {
        Some(_) => reason,
        None => format!("{reason}: point_columns (--point-columns) names the columns of a .bin"),
    })?;
    Table::new(bytes, num_records, columns, tick)
}

/// Number of records of a given size, which must be an integer.
pub(super) fn count_records(bytes: &[u8], record_bytes: usize) -> ParseResult<usize> {
    if bytes.len().is_multiple_of(record_bytes) {
        Ok(bytes.len() / record_bytes)
    } else {
        Err(format!("{} bytes is not a multiple of {record_bytes}", bytes.len()))
    }
}

/// Bytes of the widest number in a `.npy`.
const MAX_ITEM_BYTES: usize = 8;

/// Refuses a file whose size implies more labels than points.
pub(super) fn check_size(path: &Path, size: u64, num_points: usize, points: &Path) -> Result<()> {
    let item_bytes = match extension(path).as_str() {
        "label" => 4,
        "bin" => 1,
        _ => {
            let limit = num_points.saturating_mul(MAX_ITEM_BYTES).saturating_add(MAX_HEADER_BYTES + 12);
            let needed_for = format!(" for the {num_points} points of {}", points.display());
            return check_bytes(size, limit as u64, &needed_for).map_err(|reason| Error::file(path, reason));
        }
    };
    match size.is_multiple_of(item_bytes) {
        true => check_count(path, (size / item_bytes) as usize, num_points, points),
        false => Ok(()),
    }
}

/// Refuses a number of labels that differs from that of the points.
pub(super) fn check_count(path: &Path, found: usize, needed: usize, points: &Path) -> Result<()> {
    if found == needed {
        return Ok(());
    }
    Err(Error::file(path, format!("{found} labels for the {needed} points of {}", points.display())))
}

pub(super) fn parse_labels<'a>(path: &Path, bytes: &'a [u8]) -> ParseResult<EntryValues<'a>> {
    match extension(path).as_str() {
        "label" => {
            EntryValues::new(bytes, count_records(bytes, 4)?, Column::little_endian(0, 4, Scalar::U16))
        }
        "bin" => EntryValues::new(bytes, bytes.len(), Column::little_endian(0, 1, Scalar::U8)),
        "npy" => npy::parse_values(bytes),
        other => Err(format!("label format '{other}' is not known, needs .label, .bin, .npy or .npz")),
    }
}
