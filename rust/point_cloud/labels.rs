//! Files of one class id for each entry of a cloud.
//!
//! `.label`: SemanticKITTI's uint32, the low 16 bits are the class and the high ones an instance. `.bin`: nuScenes' lidarseg,
//! uint8. `.npy`: any integers.

use std::path::Path;

use super::column::{Column, Scalar};
use super::kitti::count_records;
use super::npy;
use super::parsed::Parsed;
use super::table::Values;
use crate::error::{Error, Result};
use crate::file::{check_bytes, extension};
use crate::npy::LONGEST_HEADER;

/// Bytes of the widest number in a `.npy`.
const MAX_ITEM_BYTES: usize = 8;

/// Refuses a file whose size says that it has more labels than there are points.
///
/// # Errors
/// It has.
pub(super) fn check_size(path: &Path, size: u64, num_points: usize, points: &Path) -> Result<()> {
    let item_bytes = match extension(path).as_str() {
        "label" => 4,
        "bin" => 1,
        _ => {
            let limit = num_points.saturating_mul(MAX_ITEM_BYTES).saturating_add(LONGEST_HEADER + 12);
            let needed_for = format!(" for the {num_points} points of {}", points.display());
            return check_bytes(size, limit as u64, &needed_for).map_err(|reason| Error::file(path, reason));
        }
    };
    match size.is_multiple_of(item_bytes) {
        true => check_count(path, (size / item_bytes) as usize, num_points, points),
        false => Ok(()),
    }
}

/// Refuses another number of labels than of points.
///
/// # Errors
/// They differ.
pub(super) fn check_count(path: &Path, found: usize, needed: usize, points: &Path) -> Result<()> {
    if found == needed {
        return Ok(());
    }
    Err(Error::file(path, format!("{found} labels for the {needed} points of {}", points.display())))
}

pub(super) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Parsed<Values<'a>> {
    match extension(path).as_str() {
        "label" => Values::new(bytes, count_records(bytes, 4)?, Column::little_endian(0, 4, Scalar::U16)),
        "bin" => Values::new(bytes, bytes.len(), Column::little_endian(0, 1, Scalar::U8)),
        "npy" => npy::parse_values(bytes),
        other => Err(format!("label format '{other}' is not known, needs .label, .bin, .npy or .npz")),
    }
}
