//! Size limits of a sweep. What a file or its header promises is checked before memory is allocated for it.

use std::ops::Range;

use crate::file::{check_bytes, grouped};

/// The result of a parser; its error says what was found and what is needed, and leaves the file's name to its
/// caller.
pub(super) type ParseResult<T> = std::result::Result<T, String>;

/// A quotation from a file for an error message: on one line, and short.
pub(super) fn quoted(bytes: &[u8]) -> String {
    const MAX_BYTES_SHOWN: usize = 40;
    let text = String::from_utf8_lossy(bytes.get(..MAX_BYTES_SHOWN).unwrap_or(bytes));
    let more = if bytes.len() > MAX_BYTES_SHOWN { "..." } else { "" };
    format!("{}{more}", text.escape_debug())
}

/// Largest number of points of a sweep, unless another limit is given.
pub const MAX_POINTS: usize = 10_000_000;
/// Bytes that a point may take in a file, or unpacked from it: 16 numbers of four bytes.
const BYTES_A_POINT: u64 = 64;
/// Bytes allowed for any file: headers are small compared with many points.
const MIN_BYTES: u64 = 1 << 20;
/// Bytes of the files that are read at a time.
const GROUP_BYTES: u64 = 1 << 29;

/// The largest sweep that is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Entries, no-returns included.
    pub max_points: usize,
}

impl Default for Limit {
    fn default() -> Self {
        Self { max_points: MAX_POINTS }
    }
}

impl Limit {
    /// Bytes of the largest file of a sweep, and of what it may unpack to.
    #[must_use]
    pub fn max_bytes(self) -> u64 {
        (self.max_points as u64).saturating_mul(BYTES_A_POINT).max(MIN_BYTES)
    }

    pub(super) fn check_points(self, found: usize) -> ParseResult<()> {
        if found <= self.max_points {
            return Ok(());
        }
        let (found, limit) = (grouped(found as u64), grouped(self.max_points as u64));
        Err(format!("found {found} points, needed at most {limit}: see --max-points"))
    }

    pub(super) fn check_bytes(self, found: u64) -> ParseResult<()> {
        let needed_for = format!(", {BYTES_A_POINT} a point: see --max-points");
        check_bytes(found, self.max_bytes(), &needed_for)
    }
}

/// Groups of consecutive files that take some hundred megabytes together, or are single.
pub(super) fn groups(sizes: &[u64]) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    let mut sum = 0u64;
    for (index, &size) in sizes.iter().enumerate() {
        sum = sum.saturating_add(size);
        match groups.last_mut() {
            Some(group) if sum <= GROUP_BYTES => group.end = index + 1,
            _ => {
                groups.push(index..index + 1);
                sum = size;
            }
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_hold_all_and_not_too_much() {
        let sizes = [1, 2, GROUP_BYTES, 3, GROUP_BYTES - 3, 1, u64::MAX, u64::MAX, 5];
        assert_eq!(groups(&sizes), [0..2, 2..3, 3..5, 5..6, 6..7, 7..8, 8..9]);
        assert_eq!(groups(&[]), []);
    }
}
