//! KITTI's `.bin` (x y z intensity, float32) and nuScenes' `.pcd.bin` (x y z intensity ring, float32), without a header.
//!
//! Sources: the development kits of KITTI's object benchmark and of nuScenes (`LidarPointCloud.from_file`).

use super::column::{Column, Scalar};
use super::fields::Fields;
use super::limit::Limit;
use super::parsed::Parsed;
use super::table::Table;

/// 4 or 5 float32 columns.
pub(super) fn parse(bytes: &[u8], num_columns: usize, limit: Limit) -> Parsed<Table<'_>> {
    let num_records = count_records(bytes, 4 * num_columns)?;
    limit.check_points(num_records)?;
    let column = |index: usize| Column::little_endian(4 * index, 4 * num_columns, Scalar::F32);
    let columns = Fields {
        xyz: [column(0), column(1), column(2)],
        intensity: Some(column(3)),
        ring: (num_columns > 4).then(|| column(4)),
        time: None,
        label: None,
    };
    Table::new(bytes, num_records, columns, 1.0)
}

/// How many records of a size there are: a whole number of them.
pub(super) fn count_records(bytes: &[u8], record_bytes: usize) -> Parsed<usize> {
    if bytes.len().is_multiple_of(record_bytes) {
        Ok(bytes.len() / record_bytes)
    } else {
        Err(format!("{} bytes is not a multiple of {record_bytes}", bytes.len()))
    }
}
