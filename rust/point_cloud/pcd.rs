//! PCL's `.pcd`, versions 0.5 to 0.7: `ascii`, `binary` and `binary_compressed`, with fields of any order, type and
//! count.
//!
//! Sources: PCL's description of the format and `pcd_io.cpp`. Without SIZE and TYPE, as in the oldest files, every
//! field is a float32. `binary_compressed` holds one field after another, LZF-packed.

use std::io::Read;
use std::path::Path;

use super::ascii::{self, Token};
use super::column::{Column, NumberKind, Scalar};
use super::fields::{find, seconds_per_tick};
use super::limit::{ParseResult, quoted};
use super::lzf;
use super::options::Reading;
use super::table::Table;
use crate::file::OpenFile;

/// Bytes within which a header of usual length ends.
const HEADER_BYTES: u64 = 4096;

struct Header {
    fields: Vec<Field>,
    num_points: usize,
    encoding: Encoding,
}

/// `count` values of one type.
struct Field {
    name: String,
    kind: String,
    size: usize,
    count: usize,
}

enum Encoding {
    Ascii,
    Binary,
    Compressed,
}

pub(super) fn parse<'a>(bytes: &'a [u8], reading: &Reading) -> ParseResult<Table<'a>> {
    let limit = reading.limit;
    let (header, data) = parse_header(bytes)?;
    limit.check_points(header.num_points)?;
    let names: Vec<&str> = header.fields.iter().map(|field| field.name.as_str()).collect();
    let indices = find(&names, reading.own_points.as_ref())?;
    let scalars = indices.try_map(|index| header.fields[index].scalar())?;
    let tick = scalars.time.map_or(1.0, seconds_per_tick);
    match header.encoding {
        Encoding::Ascii => {
            let tokens = header.fields.iter().map(|field| Token::Skipped(field.count)).collect();
            ascii::parse(data, header.num_points, tokens, indices, tick)
        }
        Encoding::Binary => {
            let column = |index| header.column_of_records(index);
            Table::new(header.exactly(data)?, header.num_points, indices.try_map(column)?, tick)
        }
        Encoding::Compressed => {
            let column = |index| header.column_of_blocks(index);
            limit.check_bytes(header.data_bytes()? as u64)?;
            Table::new(header.unpack(data)?, header.num_points, indices.try_map(column)?, tick)
        }
    }
}

/// Unpacked size of the data, if they are compressed and the file starts with a header of usual length.
pub(super) fn unpacked_bytes(path: &Path) -> Option<u64> {
    let mut start = Vec::new();
    OpenFile::open(path)
        .ok()?
        .parse(|stream| Ok(stream.take(HEADER_BYTES).read_to_end(&mut start)))
        .ok()?
        .ok()?;
    let (header, _) = parse_header(&start).ok()?;
    matches!(header.encoding, Encoding::Compressed).then(|| header.data_bytes().ok().map(|n| n as u64))?
}

impl Field {
    fn scalar(&self) -> ParseResult<Scalar> {
        let kind = match self.kind.as_str() {
            "F" => Some(NumberKind::Float),
            "I" => Some(NumberKind::Signed),
            "U" => Some(NumberKind::Unsigned),
            _ => None,
        };
        let scalar = kind.and_then(|kind| Scalar::new(kind, self.size)).filter(|_| self.count == 1);
        scalar.ok_or_else(|| {
            let (name, kind) = (quoted(self.name.as_bytes()), quoted(self.kind.as_bytes()));
            let found = format!("TYPE {kind} SIZE {} COUNT {}", self.size, self.count);
            format!("field {name} is {found}, needs one float or integer of a usual size")
        })
    }
}

impl Header {
    /// Number of bytes of the first `num_fields` fields of a point.
    fn record_bytes(&self, num_fields: usize) -> ParseResult<usize> {
        let bytes = self.fields.iter().take(num_fields).try_fold(0usize, |sum, field| {
            field.size.checked_mul(field.count).and_then(|x| sum.checked_add(x))
        });
        bytes.ok_or_else(|| "has fields too large for any memory".into())
    }

    fn data_bytes(&self) -> ParseResult<usize> {
        let record_bytes = self.record_bytes(self.fields.len())?;
        let bytes = record_bytes.checked_mul(self.num_points);
        bytes.ok_or_else(|| format!("cannot hold {} points of {record_bytes} bytes", self.num_points))
    }

    fn column_of_records(&self, index: usize) -> ParseResult<Column> {
        let (offset, stride) = (self.record_bytes(index)?, self.record_bytes(self.fields.len())?);
        Ok(Column::little_endian(offset, stride, self.fields[index].scalar()?))
    }

    fn column_of_blocks(&self, index: usize) -> ParseResult<Column> {
        let scalar = self.fields[index].scalar()?;
        let offset = self.record_bytes(index)?.checked_mul(self.num_points);
        let offset = offset.ok_or("has fields too large for any memory")?;
        Ok(Column::little_endian(offset, scalar.size(), scalar))
    }

    /// The data, if they are those of all points with at most a few bytes more, or padding.
    fn exactly<'a>(&self, data: &'a [u8]) -> ParseResult<&'a [u8]> {
        let (needed, record_bytes) = (self.data_bytes()?, self.record_bytes(self.fields.len())?);
        let is_padded = |rest: &[u8]| rest.len() < record_bytes || rest.iter().all(|&byte| byte == 0);
        if !data.get(needed..).is_some_and(is_padded) {
            let promise = format!("{} points of {record_bytes} bytes", self.num_points);
            return Err(format!("holds {} bytes of data, its header promises {promise}", data.len()));
        }
        Ok(data)
    }

    fn unpack(&self, data: &[u8]) -> ParseResult<Vec<u8>> {
        let needed = self.data_bytes()?;
        let (sizes, stream) = data.split_first_chunk::<8>().ok_or("ends before its data")?;
        let [a, b, c, d, e, f, g, h] = *sizes;
        let (compressed, size) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
        if size as usize != needed {
            return Err(format!("unpacks to {size} bytes, its header promises {needed}"));
        }
        let stream = stream
            .get(..compressed as usize)
            .ok_or_else(|| format!("holds {} bytes of compressed data, needs {compressed}", stream.len()))?;
        match lzf::decompress(stream, needed) {
            // pypcd and older versions of pypcd4 store data as they are if LZF would not make them smaller.
            Err(_) if stream.len() == needed => Ok(stream.to_vec()),
            unpacked => unpacked,
        }
    }
}

/// The header's lines as they are found; missing ones may be implied by others.
#[derive(Default)]
struct Lines {
    fields: Vec<String>,
    kinds: Option<Vec<String>>,
    sizes: Option<Vec<usize>>,
    counts: Option<Vec<usize>>,
    width: Option<usize>,
    height: Option<usize>,
    points: Option<usize>,
}

/// The header, and the bytes that follow it.
fn parse_header(bytes: &[u8]) -> ParseResult<(Header, &[u8])> {
    let mut lines = Lines::default();
    let mut rest = bytes;
    while let Some(end) = rest.iter().position(|&b| b == b'\n') {
        let line = rest[..end].trim_ascii();
        rest = &rest[end + 1..];
        let comment = line.is_empty() || line.starts_with(b"#");
        if !comment && let Some(encoding) = lines.take(line)? {
            return Ok((lines.header(encoding)?, rest));
        }
    }
    Err("is not a PCD file: its header has no DATA line".into())
}

impl Lines {
    /// Parses one line; the last one gives the encoding of the data.
    fn take(&mut self, line: &[u8]) -> ParseResult<Option<Encoding>> {
        let unknown = || format!("header line '{}' is not known", quoted(line));
        let text = std::str::from_utf8(line).map_err(|_| unknown())?;
        let mut words = text.split_ascii_whitespace();
        let key = words.next().unwrap_or_default();
        let values: Vec<&str> = words.collect();
        match key {
            "VERSION" => check_version(&values)?,
            "FIELDS" | "COLUMNS" => self.fields = owned(&values),
            "SIZE" => self.sizes = Some(numbers(line, &values)?),
            "TYPE" => self.kinds = Some(owned(&values)),
            "COUNT" => self.counts = Some(numbers(line, &values)?),
            "WIDTH" => self.width = Some(number(line, &values)?),
            "HEIGHT" => self.height = Some(number(line, &values)?),
            "POINTS" => self.points = Some(number(line, &values)?),
            "VIEWPOINT" => {}
            "DATA" => return encoding(&values).ok_or_else(unknown).map(Some),
            _ => return Err(unknown()),
        }
        Ok(None)
    }

    fn header(self, encoding: Encoding) -> ParseResult<Header> {
        let (num_points, n) = (self.num_points()?, self.fields.len());
        let kinds = self.kinds.unwrap_or_else(|| vec!["F".into(); n]);
        let sizes = self.sizes.unwrap_or_else(|| vec![4; n]);
        let counts = self.counts.unwrap_or_else(|| vec![1; n]);
        for (key, found) in [("TYPE", kinds.len()), ("SIZE", sizes.len()), ("COUNT", counts.len())] {
            if found != n {
                return Err(format!("its {key} line has {found} values for {n} fields"));
            }
        }
        let rest = kinds.into_iter().zip(sizes).zip(counts);
        let field = |(name, ((kind, size), count))| Field { name, kind, size, count };
        let fields = self.fields.into_iter().zip(rest).map(field).collect();
        Ok(Header { fields, num_points, encoding })
    }

    fn num_points(&self) -> ParseResult<usize> {
        let area = self.width.map(|width| width.checked_mul(self.height.unwrap_or(1)));
        match (self.points, area) {
            (Some(points), None) => Ok(points),
            (None, Some(Some(area))) => Ok(area),
            (Some(points), Some(area)) if area == Some(points) => Ok(points),
            (None, _) => Err("its header does not say how many points there are".into()),
            (Some(points), _) => {
                let (width, height) = (self.width.unwrap_or_default(), self.height.unwrap_or(1));
                Err(format!("its header promises {points} points and {width} x {height} of them"))
            }
        }
    }
}

fn check_version(values: &[&str]) -> ParseResult<()> {
    match values {
        ["0.5" | ".5" | "0.6" | ".6" | "0.7" | ".7"] => Ok(()),
        _ => Err(format!("has version '{}', needs 0.5, 0.6 or 0.7", quoted(values.join(" ").as_bytes()))),
    }
}

fn encoding(values: &[&str]) -> Option<Encoding> {
    match values {
        ["ascii"] => Some(Encoding::Ascii),
        ["binary"] => Some(Encoding::Binary),
        ["binary_compressed"] => Some(Encoding::Compressed),
        _ => None,
    }
}

fn owned(values: &[&str]) -> Vec<String> {
    values.iter().map(|&value| value.to_owned()).collect()
}

fn numbers(line: &[u8], values: &[&str]) -> ParseResult<Vec<usize>> {
    let numbers: Result<Vec<usize>, _> = values.iter().map(|value| value.parse()).collect();
    numbers.map_err(|_| format!("header line '{}' needs whole numbers", quoted(line)))
}

fn number(line: &[u8], values: &[&str]) -> ParseResult<usize> {
    match numbers(line, values)?[..] {
        [number] => Ok(number),
        _ => Err(format!("header line '{}' needs one number", quoted(line))),
    }
}
