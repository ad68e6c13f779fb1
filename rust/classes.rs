//! The dense class ids that points and pixels carry.

/// The id of points and pixels that carry no information.
pub const NO_CLASS: u8 = u8::MAX;
