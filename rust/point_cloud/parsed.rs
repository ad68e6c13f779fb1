//! What parsers of files give, and how they quote a file that is wrong.

/// What a parser gives; its error says what was found and what is needed, and leaves the file's name to its caller.
pub(super) type Parsed<T> = std::result::Result<T, String>;

/// What a file says, for a complaint: on one line, and not for ever.
pub(super) fn shown(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(bytes.get(..LONGEST).unwrap_or(bytes));
    let more = if bytes.len() > LONGEST { "..." } else { "" };
    format!("{}{more}", text.escape_debug())
}
