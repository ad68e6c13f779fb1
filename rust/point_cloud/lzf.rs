//! LZF, as PCD's `binary_compressed` has it. Source: Marc Lehmann's liblzf, `lzf_d.c`.

/// What a stream of `n` bytes can grow to at most: three bytes make 264.
pub const LARGEST_RATIO: usize = 88;

/// Unpacks a stream that is known to hold `size` bytes.
///
/// # Errors
/// It does not, or refers to bytes before its start: in words.
pub fn decompress(stream: &[u8], size: usize) -> Result<Vec<u8>, String> {
    if size > stream.len().saturating_mul(LARGEST_RATIO) {
        return Err(format!("{} compressed bytes cannot hold {size}", stream.len()));
    }
    let mut out = vec![0; size];
    match unpack(stream, &mut out) {
        Some(found) if found == size => Ok(out),
        _ => Err(format!("the compressed data is damaged or does not hold {size} bytes")),
    }
}

/// How many bytes were written, or `None` where they do not fit or refer to what is not there.
fn unpack(mut stream: &[u8], out: &mut [u8]) -> Option<usize> {
    let mut end = 0;
    while let Some((&control, rest)) = stream.split_first() {
        let control = usize::from(control);
        if control < 32 {
            let (literal, rest) = rest.split_at_checked(control + 1)?;
            out.get_mut(end..end + literal.len())?.copy_from_slice(literal);
            (end, stream) = (end + literal.len(), rest);
            continue;
        }
        let (length, rest) = match control >> 5 {
            7 => rest.split_first().map(|(&more, rest)| (9 + usize::from(more), rest))?,
            length => (length + 2, rest),
        };
        let (&low, rest) = rest.split_first()?;
        let distance = ((control & 31) << 8) + usize::from(low) + 1;
        repeat(out.get_mut(..end + length)?, end, distance)?;
        (end, stream) = (end + length, rest);
    }
    Some(end)
}

/// Fills `out` from `end` on with what lies `distance` before; the two may overlap.
fn repeat(out: &mut [u8], end: usize, distance: usize) -> Option<()> {
    let start = end.checked_sub(distance)?;
    let length = out.len() - end;
    if distance >= length {
        out.copy_within(start..start + length, end);
    } else {
        for index in 0..length {
            out[end + index] = out[start + index];
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_repeats() {
        // "abc", then 7 bytes from 3 before, then 16 from 1 before.
        let stream = [2, b'a', b'b', b'c', 5 << 5, 2, 7 << 5, 7, 0];
        assert_eq!(decompress(&stream, 26).as_deref(), Ok(&b"abcabcabcaaaaaaaaaaaaaaaaa"[..]));
    }

    #[test]
    fn damage() {
        let damaged = "the compressed data is damaged or does not hold 10 bytes";
        for stream in
            [&[2, b'a', b'b'][..], &[0, b'a', 32, 1], &[0, b'a', 32], &[0, b'a', 224, 1], &[0, b'a']]
        {
            assert_eq!(decompress(stream, 10), Err(damaged.into()), "{stream:?}");
        }
        assert_eq!(
            decompress(&[0, 1], usize::MAX),
            Err(format!("2 compressed bytes cannot hold {}", usize::MAX))
        );
        assert!(decompress(&[1, 1, 1], 1).is_err(), "more than promised");
    }
}
