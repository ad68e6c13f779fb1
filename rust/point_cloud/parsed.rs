//! The result of parsers of files, and quotations of wrong files.

/// The result of a parser; its error says what was found and what is needed, and leaves the file's name to its caller.
pub(super) type Parsed<T> = std::result::Result<T, String>;

/// A quotation of a file for an error message: on one line, and short.
pub(super) fn shown(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(bytes.get(..LONGEST).unwrap_or(bytes));
    let more = if bytes.len() > LONGEST { "..." } else { "" };
    format!("{}{more}", text.escape_debug())
}
