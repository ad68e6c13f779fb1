//! Files: what opens them refuses what is no file, such as a pipe that nobody writes to, and what is too large.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// A regular file that is open for reading.
#[derive(Debug)]
pub struct Opened {
    path: PathBuf,
    file: File,
    size: u64,
}

impl Opened {
    /// Opens a regular file. Its kind is tested before it is opened, since opening a device may have effects, and again
    /// afterwards, since something else may then have its name.
    ///
    /// # Errors
    /// There is none at this path, or it cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        let check = |metadata: std::io::Result<std::fs::Metadata>| {
            let metadata = metadata.map_err(|e| complaint(path, &e))?;
            if !metadata.is_file() {
                let found = if metadata.is_dir() { "a folder" } else { "no regular file" };
                return Err(Error::file(path, format!("is {found}, needs a file")));
            }
            Ok(metadata.len())
        };
        check(std::fs::metadata(path))?;
        let file = without_waiting().read(true).open(path).map_err(|e| complaint(path, &e))?;
        let size = check(file.metadata())?;
        Ok(Self { path: path.to_owned(), file, size })
    }

    /// Size in bytes.
    #[must_use]
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Refuses a file of more bytes than `limit`; `needed_for` says what the limit applies to.
    ///
    /// # Errors
    /// The file is larger.
    pub fn at_most(self, limit: u64, needed_for: &str) -> Result<Self> {
        check_bytes(self.size, limit, needed_for).map_err(|reason| Error::file(&self.path, reason))?;
        Ok(self)
    }

    /// The content, of which nothing is read beyond the size that the file had when it was opened.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn bytes(self) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(self.size as usize);
        self.file.take(self.size).read_to_end(&mut bytes).map_err(|e| complaint(&self.path, &e))?;
        Ok(bytes)
    }

    /// The content as a stream.
    #[must_use]
    pub fn stream(self) -> BufReader<File> {
        const BUFFER_BYTES: usize = 1 << 16;
        BufReader::with_capacity(BUFFER_BYTES, self.file)
    }
}

/// Refuses more bytes than a limit: in words.
///
/// # Errors
/// There are more.
pub fn check_bytes(found: u64, limit: u64, needed_for: &str) -> std::result::Result<(), String> {
    if found <= limit {
        return Ok(());
    }
    Err(format!("found {} bytes, needed at most {}{needed_for}", grouped(found), grouped(limit)))
}

/// A number with a comma between thousands.
#[must_use]
pub fn grouped(number: u64) -> String {
    match number {
        0..1000 => number.to_string(),
        _ => format!("{},{:03}", grouped(number / 1000), number % 1000),
    }
}

/// A file's suffix in lower case, without its dot.
pub fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_lowercase()
}

/// Options with which the opening of a pipe does not wait for a writer.
fn without_waiting() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    options
}

fn complaint(path: &Path, error: &std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Error::file(path, "no such file"),
        _ => Error::file(path, error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands() {
        assert_eq!([0, 999, 1000, 3_221_225_472].map(grouped), ["0", "999", "1,000", "3,221,225,472"]);
    }
}
