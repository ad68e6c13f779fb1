//! Errors of the core; `semcal_cli.errors` holds their Python counterparts.

use std::path::{Path, PathBuf};

use geometry::Invalid;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read, or does not hold what its format promises.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file, as the caller named it.
        path: PathBuf,
        /// What was found and what was needed.
        reason: String,
    },
    /// The system failed to read a file, whatever its content.
    #[error("{}: {source}", path.display())]
    System {
        /// The file, as the caller named it.
        path: PathBuf,
        /// The system's own error, with its number.
        source: std::io::Error,
    },
    /// An argument is out of range, or arguments disagree.
    #[error("{0}")]
    Input(String),
    /// The input is well formed, but the data do not determine an answer.
    #[error("{0}")]
    Calibration(String),
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub fn file(path: &Path, reason: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), reason: reason.into() }
    }
}

impl From<Invalid> for Error {
    fn from(Invalid(message): Invalid) -> Self {
        Self::Input(message)
    }
}
