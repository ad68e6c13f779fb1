//! Opening of files, which refuses special files, such as a pipe without a writer, and files that are too large.

use std::cell::Cell;
use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Size of the largest pointer that Git LFS writes in place of a file, and its first bytes. Source: its specification.
const MAX_POINTER_BYTES: u64 = 1024;
const POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// A regular file, open for reading.
#[derive(Debug)]
pub struct OpenFile {
    path: PathBuf,
    file: File,
    size: u64,
}

impl OpenFile {
    /// Opens a regular file. Its kind is checked before it is opened, since opening a device may have side effects,
    /// and again afterwards, since its name may refer to another file by then.
    pub fn open(path: &Path) -> Result<Self> {
        let check = |metadata: io::Result<std::fs::Metadata>| {
            let metadata = metadata.map_err(|e| read_error(path, e))?;
            if !metadata.is_file() {
                let found = if metadata.is_dir() { "a folder" } else { "a special file" };
                return Err(Error::file(path, format!("is {found}, needs a file")));
            }
            Ok(metadata.len())
        };
        check(std::fs::metadata(path))?;
        let mut file = without_waiting().read(true).open(path).map_err(|e| read_error(path, e))?;
        let size = check(file.metadata())?;
        if size <= MAX_POINTER_BYTES && is_pointer(&mut file).map_err(|e| read_error(path, e))? {
            return Err(Error::file(
                path,
                "found a Git LFS pointer, expected the file itself: run `git lfs pull`",
            ));
        }
        Ok(Self { path: path.to_owned(), file, size })
    }

    #[must_use]
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Refuses a file of more than `limit` bytes; `needed_for` says what the limit applies to.
    pub fn at_most(self, limit: u64, needed_for: &str) -> Result<Self> {
        check_bytes(self.size, limit, needed_for).map_err(|reason| Error::file(&self.path, reason))?;
        Ok(self)
    }

    /// The content, up to the size that the file had when it was opened.
    pub fn bytes(self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let no_memory = |_| read_error(&self.path, ErrorKind::OutOfMemory.into());
        bytes.try_reserve_exact(self.size as usize).map_err(no_memory)?;
        self.file.take(self.size).read_to_end(&mut bytes).map_err(|e| read_error(&self.path, e))?;
        Ok(bytes)
    }

    /// Parses the content as a stream.
    ///
    /// # Errors
    /// Those of `parse`, unless the system failed to read the file: then that error, whatever `parse` made of it.
    pub fn parse<T>(self, parse: impl FnOnce(Stream<'_>) -> Result<T>) -> Result<T> {
        const BUFFER_BYTES: usize = 1 << 16;
        let failure = Cell::new(None);
        let file = WatchedFile { file: self.file, failure: &failure };
        let result = parse(BufReader::with_capacity(BUFFER_BYTES, file));
        match failure.get() {
            Some(number) => Err(read_error(&self.path, io::Error::from_raw_os_error(number))),
            None => result,
        }
    }
}

/// The content of a file as a stream.
pub type Stream<'a> = BufReader<WatchedFile<'a>>;

/// A file that keeps the system's last read error, since parsers replace it by messages of their own.
#[derive(Debug)]
pub struct WatchedFile<'a> {
    file: File,
    failure: &'a Cell<Option<i32>>,
}

impl Read for WatchedFile<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let is_lasting = |e: &io::Error| e.kind() != ErrorKind::Interrupted;
        let result = self.file.read(bytes);
        if let Some(error) = result.as_ref().err().filter(|e| is_lasting(e)) {
            self.failure.set(error.raw_os_error());
        }
        result
    }
}

impl Seek for WatchedFile<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Whether a file starts as a Git LFS pointer does; it is read from its start again.
fn is_pointer(file: &mut File) -> io::Result<bool> {
    let mut start = Vec::new();
    file.take(POINTER.len() as u64).read_to_end(&mut start)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(start == POINTER)
}

/// Refuses more bytes than a limit, with a message.
pub fn check_bytes(found: u64, limit: u64, needed_for: &str) -> std::result::Result<(), String> {
    if found <= limit {
        return Ok(());
    }
    Err(format!("found {} bytes, needed at most {}{needed_for}", grouped(found), grouped(limit)))
}

/// A number with commas between thousands.
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

/// Open options that do not wait for the writer of a pipe.
fn without_waiting() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    options
}

fn read_error(path: &Path, source: io::Error) -> Error {
    match source.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Error::file(path, "no such file"),
        _ => Error::System { path: path.to_owned(), source },
    }
}
