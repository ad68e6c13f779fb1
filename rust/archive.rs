//! Archives as `numpy.savez` writes them.

use std::io::{Read, Seek, SeekFrom};

use zip::ZipArchive;
use zip::result::{ZipError, ZipResult};

/// The start of the last record of an archive, and its length without its comment.
const LAST_RECORD: &[u8] = b"PK\x05\x06";
const LAST_RECORD_BYTES: usize = 22;
/// Bytes of the longest comment, after which an archive ends.
const LONGEST_COMMENT: usize = 65_535;

/// Opens an archive, if it has fewer files than ZIP64 is for: the table of contents, which is read as a whole, takes up
/// to six times its size.
///
/// # Errors
/// It is no archive, or has too many files.
pub fn open<R: Read + Seek>(mut file: R) -> ZipResult<ZipArchive<R>> {
    let size = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(size.saturating_sub((LONGEST_COMMENT + LAST_RECORD_BYTES) as u64)))?;
    let mut end = Vec::new();
    file.by_ref().take((LONGEST_COMMENT + LAST_RECORD_BYTES) as u64).read_to_end(&mut end)?;
    // The number of files, where it is one of ZIP64.
    let is_large = |record: &[u8]| record.starts_with(LAST_RECORD) && record[10..12] == [0xff; 2];
    if end.windows(LAST_RECORD_BYTES).any(is_large) {
        return Err(ZipError::UnsupportedArchive("too many files"));
    }
    file.seek(SeekFrom::Start(0))?;
    ZipArchive::new(file)
}
