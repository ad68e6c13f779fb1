//! Point clouds and labels in `.npy`: N x 3 (x y z) or N x 4 (x y z intensity), and N ids.

use std::path::Path;

use super::RawCloud;
use crate::error::{Error, Result};
use crate::npy::{class_ids, read};

pub(super) fn read_points(path: &Path) -> Result<RawCloud> {
    let array = read(path)?;
    let columns = match array.shape[..] {
        [_, columns @ (3 | 4)] => columns,
        _ => {
            let reason = format!("has shape {:?}, needs N x 3 or N x 4 (x y z intensity)", array.shape);
            return Err(Error::file(path, reason));
        }
    };
    let rows = || array.values.chunks_exact(columns);
    Ok(RawCloud {
        points: rows().map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]).collect(),
        intensity: (columns == 4).then(|| rows().map(|p| p[3] as f32).collect()),
    })
}

pub(super) fn read_labels(path: &Path) -> Result<Vec<u16>> {
    let array = read(path)?;
    if array.shape.len() != 1 {
        return Err(Error::file(path, format!("has shape {:?}, needs N ids", array.shape)));
    }
    class_ids(path, &array.values)
}
