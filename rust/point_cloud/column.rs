//! Columns of numbers at a constant stride in a file's bytes.

use super::limit::ParseResult;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
}

impl Scalar {
    pub(super) fn new(kind: NumberKind, size: usize) -> Option<Self> {
        Some(match (kind, size) {
            (NumberKind::Signed, 1) => Self::I8,
            (NumberKind::Signed, 2) => Self::I16,
            (NumberKind::Signed, 4) => Self::I32,
            (NumberKind::Signed, 8) => Self::I64,
            (NumberKind::Unsigned, 1) => Self::U8,
            (NumberKind::Unsigned, 2) => Self::U16,
            (NumberKind::Unsigned, 4) => Self::U32,
            (NumberKind::Unsigned, 8) => Self::U64,
            (NumberKind::Float, 4) => Self::F32,
            (NumberKind::Float, 8) => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// The meaning of a number's bits.
#[derive(Clone, Copy, Debug)]
pub(super) enum NumberKind {
    Signed,
    Unsigned,
    Float,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    /// Bytes before the first value.
    pub offset: usize,
    /// Bytes from one value to the next.
    pub stride: usize,
    pub scalar: Scalar,
    pub is_big_endian: bool,
}

impl Column {
    pub(super) fn little_endian(offset: usize, stride: usize, scalar: Scalar) -> Self {
        Self { offset, stride, scalar, is_big_endian: false }
    }

    /// Checks that `count` values are within `num_bytes`.
    pub(super) fn check(&self, count: usize, num_bytes: usize) -> ParseResult<()> {
        let last = count.saturating_sub(1).checked_mul(self.stride).and_then(|x| x.checked_add(self.offset));
        let end = last.and_then(|x| x.checked_add(self.scalar.size()));
        match end {
            Some(end) if (end <= num_bytes || count == 0) && self.stride > 0 => Ok(()),
            _ => Err(format!("holds {num_bytes} bytes of data, too few for {count} values")),
        }
    }

    /// Calls `f` with each of the first `count` values; integers beyond 2^53 are rounded.
    pub(super) fn for_each(&self, bytes: &[u8], count: usize, f: impl FnMut(f64)) {
        match self.scalar {
            Scalar::I8 => self.visit(bytes, count, |x| f64::from(i8::from_le_bytes(x)), f),
            Scalar::I16 => self.visit(bytes, count, |x| f64::from(i16::from_le_bytes(x)), f),
            Scalar::I32 => self.visit(bytes, count, |x| f64::from(i32::from_le_bytes(x)), f),
            Scalar::I64 => self.visit(bytes, count, |x| i64::from_le_bytes(x) as f64, f),
            Scalar::U8 => self.visit(bytes, count, |x| f64::from(u8::from_le_bytes(x)), f),
            Scalar::U16 => self.visit(bytes, count, |x| f64::from(u16::from_le_bytes(x)), f),
            Scalar::U32 => self.visit(bytes, count, |x| f64::from(u32::from_le_bytes(x)), f),
            Scalar::U64 => self.visit(bytes, count, |x| u64::from_le_bytes(x) as f64, f),
            Scalar::F32 => self.visit(bytes, count, |x| f64::from(f32::from_le_bytes(x)), f),
            Scalar::F64 => self.visit(bytes, count, f64::from_le_bytes, f),
        }
    }

    fn visit<const N: usize>(
        &self,
        bytes: &[u8],
        count: usize,
        decode: impl Fn([u8; N]) -> f64,
        mut f: impl FnMut(f64),
    ) {
        if self.is_big_endian {
            self.values(bytes, count).for_each(|mut x: [u8; N]| {
                x.reverse();
                f(decode(x));
            });
        } else {
            self.values(bytes, count).for_each(|x| f(decode(x)));
        }
    }

    /// The bytes of each of the first `count` values, which `check` has found to be within `bytes`.
    pub(super) fn values<'a, const N: usize>(
        &self,
        bytes: &'a [u8],
        count: usize,
    ) -> impl Iterator<Item = [u8; N]> + use<'a, N> {
        let (offset, stride) = (self.offset, self.stride);
        (0..count).map(move |index| {
            let value = bytes.get(offset + index * stride..).and_then(<[u8]>::first_chunk);
            value.copied().unwrap_or([0; N])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(column: Column, bytes: &[u8]) -> Vec<f64> {
        let mut values = Vec::new();
        column.for_each(bytes, 2, |x| values.push(x));
        values
    }

    #[test]
    fn every_type_in_both_orders() {
        macro_rules! check {
            ($($scalar:ident: $number:ty),*) => {$(
                let numbers = [<$number>::MIN, 3 as $number];
                for is_big_endian in [false, true] {
                    let to_bytes = if is_big_endian { <$number>::to_be_bytes } else { <$number>::to_le_bytes };
                    // One byte before each value: stride and offset differ from the size.
                    let bytes: Vec<u8> = numbers.iter().flat_map(|&x| [&[9], &to_bytes(x)[..]].concat()).collect();
                    let column = Column {
                        offset: 1, stride: 1 + size_of::<$number>(), scalar: Scalar::$scalar, is_big_endian,
                    };
                    assert_eq!(column.check(2, bytes.len()), Ok(()));
                    assert!(column.check(2, bytes.len() - 1).is_err());
                    assert_eq!(all(column, &bytes), numbers.map(|x| x as f64));
                }
            )*};
        }
        check!(I8: i8, I16: i16, I32: i32, I64: i64, U8: u8, U16: u16, U32: u32, U64: u64, F32: f32, F64: f64);
    }
}
