//! KITTI's `.bin` (x y z intensity, float32) and SemanticKITTI's `.label` (uint32).

use std::path::Path;

use super::{RawCloud, read_records};
use crate::error::Result;

pub(super) fn read_points(path: &Path) -> Result<RawCloud> {
    let bytes = read_records(path, 16)?;
    let (values, _) = bytes.as_chunks::<4>();
    let (records, _) = values.as_chunks::<4>();
    let f = |b: [u8; 4]| f32::from_le_bytes(b);
    Ok(RawCloud {
        points: records.iter().map(|&[x, y, z, _]| [f(x), f(y), f(z)]).collect(),
        intensity: Some(records.iter().map(|&[_, _, _, i]| f(i)).collect()),
    })
}

/// The low 16 bits are the class, the high ones an instance.
pub(super) fn read_labels(path: &Path) -> Result<Vec<u16>> {
    let bytes = read_records(path, 4)?;
    let (values, _) = bytes.as_chunks::<4>();
    Ok(values.iter().map(|&[low, high, ..]| u16::from_le_bytes([low, high])).collect())
}
