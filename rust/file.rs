//! Files, as bytes: what opens them refuses what is no file, such as a pipe that nobody writes to.

use std::io::ErrorKind;
use std::path::Path;

use crate::error::{Error, Result};

/// The content of a regular file.
///
/// # Errors
/// There is none at this path, or it cannot be read.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(|e| complaint(path, &e))?;
    if !metadata.is_file() {
        let found = if metadata.is_dir() { "a folder" } else { "no regular file" };
        return Err(Error::file(path, format!("is {found}, needs a file")));
    }
    std::fs::read(path).map_err(|e| complaint(path, &e))
}

/// A file's suffix in lower case, without its dot.
pub fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_lowercase()
}

fn complaint(path: &Path, error: &std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Error::file(path, "no such file"),
        _ => Error::file(path, error.to_string()),
    }
}
