//! Clouds as text: one point per line, values separated by blanks.

use super::column::{Column, Scalar};
use super::fields::Fields;
use super::limit::{ParseResult, quoted};
use super::table::Table;

/// The part of a line that belongs to a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token {
    /// A number of values that are skipped.
    Skipped(usize),
    Taken,
    /// A count, followed by that number of values; all skipped.
    List,
}

/// Unpacks the fields in `found` of `num_records` lines that hold `tokens`.
pub(super) fn parse<'a>(
    text: &[u8],
    num_records: usize,
    mut tokens: Vec<Token>,
    indices: Fields<usize>,
    seconds_per_tick: f64,
) -> ParseResult<Table<'a>> {
    for &index in indices.iter() {
        tokens[index] = Token::Taken;
    }
    let packed = pack(text, num_records, &tokens)?;
    let stride = 8 * count_taken(&tokens);
    let column = |index| {
        Ok::<_, String>(Column::little_endian(8 * count_taken(&tokens[..index]), stride, Scalar::F64))
    };
    Table::new(packed, num_records, indices.try_map(column)?, seconds_per_tick)
}

fn count_taken(tokens: &[Token]) -> usize {
    tokens.iter().filter(|&&token| token == Token::Taken).count()
}

/// Packs the selected values of `num_records` lines as little-endian f64, line by line; blank lines do not count.
fn pack(text: &[u8], num_records: usize, tokens: &[Token]) -> ParseResult<Vec<u8>> {
    // Each value is at least a digit and a blank: a header that promises too much gets no memory.
    if num_records > text.len() / (2 * count_taken(tokens)).max(1) + 1 {
        return Err(format!("holds {} bytes of data, too few for {num_records} points", text.len()));
    }
    let mut packed = Vec::with_capacity(8 * count_taken(tokens) * num_records);
    let mut lines = TextLine(text);
    for index in 0..num_records {
        lines.skip_blank_lines();
        if lines.0.is_empty() {
            return Err(format!("holds {index} points, its header promises {num_records}"));
        }
        pack_line(&mut lines, tokens, &mut packed).map_err(|reason| format!("point {index}: {reason}"))?;
    }
    Ok(packed)
}

fn pack_line(line: &mut TextLine<'_>, tokens: &[Token], packed: &mut Vec<u8>) -> ParseResult<()> {
    for token in tokens {
        match token {
            Token::Skipped(count) => line.skip(*count)?,
            Token::Taken => packed.extend_from_slice(&line.number()?.to_le_bytes()),
            Token::List => {
                let count = line.number()?;
                if count < 0.0 || count.fract() != 0.0 {
                    return Err(format!("found a list of {count} values"));
                }
                line.skip(count as usize)?;
            }
        }
    }
    line.end()
}

/// The rest of a text, from some place in a line.
pub(super) struct TextLine<'a>(pub &'a [u8]);

impl TextLine<'_> {
    /// Goes to the first line that has a value.
    pub(super) fn skip_blank_lines(&mut self) {
        self.0 = self.0.trim_ascii_start();
    }

    /// Skips the end of a line; returns whether there was one.
    pub(super) fn skip_line(&mut self) -> bool {
        self.skip_blank_lines();
        let is_line = !self.0.is_empty();
        let end = self.0.iter().position(|&b| b == b'\n').unwrap_or(self.0.len());
        self.0 = &self.0[end..];
        is_line
    }

    fn skip_blanks(&mut self) -> ParseResult<()> {
        let blanks = self.0.iter().take_while(|&&b| matches!(b, b' ' | b'\t')).count();
        self.0 = &self.0[blanks..];
        match self.0.first() {
            None | Some(b'\n' | b'\r') => Err("found too few values".into()),
            Some(_) => Ok(()),
        }
    }

    fn value_length(&self) -> usize {
        self.0.iter().position(u8::is_ascii_whitespace).unwrap_or(self.0.len())
    }

    fn skip(&mut self, count: usize) -> ParseResult<()> {
        for _ in 0..count {
            self.skip_blanks()?;
            self.0 = &self.0[self.value_length()..];
        }
        Ok(())
    }

    fn number(&mut self) -> ParseResult<f64> {
        self.skip_blanks()?;
        if let Ok((value, length)) = fast_float2::parse_partial::<f64, _>(self.0)
            && self.0.get(length).is_none_or(u8::is_ascii_whitespace)
        {
            self.0 = &self.0[length..];
            return Ok(value);
        }
        let (value, rest) = self.0.split_at(self.value_length());
        self.0 = rest;
        odd_nan(value).ok_or_else(|| format!("found '{}', needs a number", quoted(value)))
    }

    fn end(&mut self) -> ParseResult<()> {
        match self.skip_blanks() {
            Err(_) => Ok(()),
            Ok(()) => Err(format!("found one value too many, '{}'", quoted(&self.0[..self.value_length()]))),
        }
    }
}

/// NaN as C libraries write it besides `nan`: `-nan(ind)`, `nan(0x1)`.
fn odd_nan(value: &[u8]) -> Option<f64> {
    let unsigned = value.strip_prefix(b"-").unwrap_or(value);
    (unsigned.starts_with(b"nan(") && unsigned.ends_with(b")")).then_some(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(text: &str, num_records: usize, tokens: &[Token]) -> ParseResult<Vec<f64>> {
        let packed = pack(text.as_bytes(), num_records, tokens)?;
        let (values, _) = packed.as_chunks::<8>();
        Ok(values.iter().map(|&x| f64::from_le_bytes(x)).collect())
    }

    #[test]
    fn values_between_blanks() {
        use Token::{List, Skipped, Taken};
        let text = "\n 1 x\t-2.5e1\r\n\n3 y 4 \n";
        assert_eq!(numbers(text, 2, &[Taken, Skipped(1), Taken]), Ok(vec![1.0, -25.0, 3.0, 4.0]));
        assert_eq!(numbers("2 7 8 9\n0 5", 2, &[List, Taken]), Ok(vec![9.0, 5.0]));
        assert!(numbers("-nan(ind)", 1, &[Taken]).expect("NaN")[0].is_nan());
        assert_eq!(numbers("-2 1", 1, &[List]), Err("point 0: found a list of -2 values".into()));
        assert_eq!(numbers("nan 1", 1, &[List]), Err("point 0: found a list of NaN values".into()));
        let endless = [Skipped(usize::MAX), Taken];
        assert_eq!(numbers("1 2 3", 1, &endless), Err("point 0: found too few values".into()));
        let complaints = [
            ("1\n2 3 4", "point 0: found too few values"),
            ("1 2\n3 4 5", "point 1: found one value too many, '5'"),
            ("1 2\n\n", "holds 1 points, its header promises 2"),
            ("1 2a\n1 2", "point 0: found '2a', needs a number"),
        ];
        for (text, complaint) in complaints {
            assert_eq!(numbers(text, 2, &[Taken, Taken]), Err(complaint.into()), "{text:?}");
        }
        let promise = pack(b"1 2 3", 1_000_000_000_000, &[Taken; 3]);
        assert_eq!(promise, Err("holds 5 bytes of data, too few for 1000000000000 points".into()));
    }
}
