//! The error of this crate.

/// An argument that is out of range, or arguments that disagree: what was found and what was needed.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Invalid(pub String);
