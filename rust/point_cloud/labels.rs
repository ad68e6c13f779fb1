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
use crate::file::extension;

pub(super) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Parsed<Values<'a>> {
    match extension(path).as_str() {
        "label" => Values::new(bytes, count_records(bytes, 4)?, Column::little_endian(0, 4, Scalar::U16)),
        "bin" => Values::new(bytes, bytes.len(), Column::little_endian(0, 1, Scalar::U8)),
        "npy" => npy::parse_values(bytes),
        other => Err(format!("label format '{other}' is not known, needs .label, .bin, .npy or .npz")),
    }
}
