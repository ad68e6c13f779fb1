//! LZF, as used by PCD's `binary_compressed`. Source: Marc Lehmann's liblzf, `lzf_d.c`.

/// Largest growth of a stream: three bytes make 264.
pub const MAX_RATIO: usize = 88;

/// Unpacks a stream that is known to hold `size` bytes.
///
/// # Errors
/// A message: it holds another number of bytes, or refers to bytes before its start.
pub fn decompress(stream: &[u8], size: usize) -> Result<Vec<u8>, String> {
    if size > stream.len().saturating_mul(MAX_RATIO) {
        return Err(format!("{} compressed bytes cannot hold {size}", stream.len()));
    }
    let mut out = vec![0; size];
    match unpack(stream, &mut out) {
        Some(found) if found == size => Ok(out),
        _ => Err(format!("the compressed data is damaged or does not hold {size} bytes")),
    }
}

/// Number of bytes written, or `None` if they do not fit or refer to missing bytes.
fn unpack(mut stream: &[u8], out: &mut [u8]) -> Option<usize> {
    let mut end = 0;
    while let Some((&control, rest)) = stream.split_first() {
        let control = usize::from(control);
        if control < 32 {
            let (literal, after) = rest.split_at_checked(control + 1)?;
            let room = out.get_mut(end..)?;
            match (rest.first_chunk::<32>(), room.first_chunk_mut::<32>()) {
                // A copy of fixed size is fast, and the excess beyond the literal is overwritten later.
                (Some(from), Some(to)) => *to = *from,
                _ => room.get_mut(..literal.len())?.copy_from_slice(literal),
            }
            (end, stream) = (end + literal.len(), after);
            continue;
        }
        let (length, rest) = match control >> 5 {
            7 => rest.split_first().map(|(&more, rest)| (9 + usize::from(more), rest))?,
            length => (length + 2, rest),
        };
        let (&low, rest) = rest.split_first()?;
        let distance = ((control & 31) << 8) + usize::from(low) + 1;
        repeat(out, end, length, distance)?;
        (end, stream) = (end + length, rest);
    }
    Some(end)
}

/// Repeats at `end` the bytes `distance` before it; the two may overlap.
fn repeat(out: &mut [u8], end: usize, length: usize, distance: usize) -> Option<()> {
    const STEP: usize = 16;
    let start = end.checked_sub(distance)?;
    if distance >= STEP && end + length.next_multiple_of(STEP) <= out.len() {
        for step in (0..length).step_by(STEP) {
            out.copy_within(start + step..start + step + STEP, end + step);
        }
    } else {
        let window = out.get_mut(start..end + length)?;
        for index in distance..window.len() {
            window[index] = window[index - distance];
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Repeats at every distance and length, near the end of the buffer and far from it, like a loop over bytes.
    #[test]
    fn repeats_of_every_kind() {
        for (distance, length, after) in every(1..40, 3..60, [0, 1, 15, 16, 40]) {
            let first: Vec<u8> = (0..64).map(|x| x as u8).collect();
            let mut expected = first.clone();
            (0..length).for_each(|_| expected.push(expected[expected.len() - distance]));
            expected.extend(vec![7; after]);
            let control = match length {
                3..=8 => vec![((length - 2) as u8) << 5, (distance - 1) as u8],
                _ => vec![7 << 5, (length - 9) as u8, (distance - 1) as u8],
            };
            let literals = |bytes: &[u8]| -> Vec<u8> { bytes.iter().flat_map(|&byte| [0, byte]).collect() };
            let stream = [literals(&first), control, literals(&vec![7; after])].concat();
            assert_eq!(decompress(&stream, expected.len()), Ok(expected), "{distance} {length} {after}");
        }
    }

    fn every(
        distances: std::ops::Range<usize>,
        lengths: std::ops::Range<usize>,
        afters: [usize; 5],
    ) -> impl Iterator<Item = (usize, usize, usize)> {
        distances.flat_map(move |d| lengths.clone().flat_map(move |l| afters.map(|after| (d, l, after))))
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
