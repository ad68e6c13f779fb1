//! Stanford's `.ply`: `ascii` and both binary orders, elements in any order, lists skipped; points are the element
//! `vertex`.
//!
//! Source: Greg Turk, *The PLY Polygon File Format*, 1994; the types' later names (`float32`) are those of Rply and
//! PCL.

use super::ascii::{self, TextLine, Token};
use super::column::{Column, NumberKind, Scalar};
use super::fields::{find, seconds_per_tick};
use super::limit::{ParseResult, quoted};
use super::options::Reading;
use super::own_points::OwnPoints;
use super::table::Table;

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

struct Element {
    is_vertex: bool,
    count: usize,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    layout: Layout,
}

#[derive(Clone, Copy)]
enum Layout {
    One(Scalar),
    /// The types of the list's length and of its items.
    List(Scalar, Scalar),
}

pub(super) fn parse<'a>(bytes: &'a [u8], reading: &Reading) -> ParseResult<Table<'a>> {
    let (encoding, elements, mut data) = parse_header(bytes)?;
    for element in &elements {
        if element.is_vertex {
            reading.limit.check_points(element.count)?;
            return element.vertices(encoding, data, reading.own_points.as_ref());
        }
        data = element.skip(encoding, data)?;
    }
    Err("has no element 'vertex'".into())
}

impl Element {
    fn vertices<'a>(
        &self,
        encoding: Encoding,
        data: &'a [u8],
        own: Option<&OwnPoints>,
    ) -> ParseResult<Table<'a>> {
        // A list has no name to look up.
        let names: Vec<&str> =
            self.properties.iter().map(|p| if p.scalar().is_some() { &*p.name } else { "" }).collect();
        let indices = find(&names, own)?;
        let scalar = |index: usize| self.properties[index].scalar();
        let tick = indices.time.and_then(scalar).map_or(1.0, seconds_per_tick);
        if encoding == Encoding::Ascii {
            let tokens = self.properties.iter().map(Property::token).collect();
            return ascii::parse(data, self.count, tokens, indices, tick);
        }
        let stride = self.scalar_bytes(self.properties.len());
        let columns = indices.try_map(|index| {
            let scalar = scalar(index).ok_or("has a list where a number is needed")?;
            let is_big_endian = encoding == Encoding::BigEndian;
            Ok::<_, String>(Column { offset: self.scalar_bytes(index), stride, scalar, is_big_endian })
        })?;
        if self.has_lists() {
            return Table::new(self.without_lists(encoding, data)?, self.count, columns, tick);
        }
        self.check_records(data, stride)?;
        Table::new(data, self.count, columns, tick)
    }

    /// Skips this element, and returns the data that follow it.
    fn skip<'a>(&self, encoding: Encoding, mut data: &'a [u8]) -> ParseResult<&'a [u8]> {
        if encoding == Encoding::Ascii {
            let mut lines = TextLine(data);
            return match (0..self.count).all(|_| lines.skip_line()) {
                true => Ok(lines.0),
                false => Err(self.ends_early()),
            };
        }
        if self.has_lists() {
            for _ in 0..self.count {
                data = self.walk(encoding, data, |_| ()).ok_or_else(|| self.ends_early())?;
            }
            return Ok(data);
        }
        let num_bytes = self.check_records(data, self.scalar_bytes(self.properties.len()))?;
        Ok(&data[num_bytes..])
    }

    /// The vertices' bytes without those of lists.
    fn without_lists(&self, encoding: Encoding, mut data: &[u8]) -> ParseResult<Vec<u8>> {
        let mut packed = Vec::new();
        for _ in 0..self.count {
            let walked = self.walk(encoding, data, |scalar| packed.extend_from_slice(scalar));
            data = walked.ok_or_else(|| self.ends_early())?;
        }
        Ok(packed)
    }

    /// Walks over one record, with the bytes of each of its numbers; `None` if the data end before.
    fn walk<'a>(&self, encoding: Encoding, mut data: &'a [u8], mut f: impl FnMut(&[u8])) -> Option<&'a [u8]> {
        for property in &self.properties {
            match property.layout {
                Layout::One(scalar) => {
                    let (value, rest) = data.split_at_checked(scalar.size())?;
                    f(value);
                    data = rest;
                }
                Layout::List(length, item) => {
                    let (value, rest) = data.split_at_checked(length.size())?;
                    let num_bytes = list_length(encoding, length, value)?.checked_mul(item.size())?;
                    data = rest.get(num_bytes..)?;
                }
            }
        }
        Some(data)
    }

    fn check_records(&self, data: &[u8], record_bytes: usize) -> ParseResult<usize> {
        let needed = record_bytes.checked_mul(self.count).filter(|&needed| needed <= data.len());
        needed.ok_or_else(|| {
            let promise = format!("{} elements of {record_bytes} bytes", self.count);
            format!("holds {} bytes of data, its header promises {promise}", data.len())
        })
    }

    fn ends_early(&self) -> String {
        format!("ends before the {} elements that its header promises", self.count)
    }

    fn has_lists(&self) -> bool {
        self.properties.iter().any(|property| property.scalar().is_none())
    }

    /// Number of bytes of the first properties, without lists.
    fn scalar_bytes(&self, num_properties: usize) -> usize {
        let first = self.properties.iter().take(num_properties);
        first.filter_map(Property::scalar).map(Scalar::size).sum()
    }
}

impl Property {
    fn scalar(&self) -> Option<Scalar> {
        match self.layout {
            Layout::One(scalar) => Some(scalar),
            Layout::List(..) => None,
        }
    }

    fn token(&self) -> Token {
        self.scalar().map_or(Token::List, |_| Token::Skipped(1))
    }
}

/// `None` if it is not a non-negative integer.
fn list_length(encoding: Encoding, scalar: Scalar, value: &[u8]) -> Option<usize> {
    let is_big_endian = encoding == Encoding::BigEndian;
    let column = Column { offset: 0, stride: scalar.size(), scalar, is_big_endian };
    let mut length = None;
    column.for_each(value, 1, |x| length = (x >= 0.0 && x.fract() == 0.0).then_some(x as usize));
    length
}

/// The encoding of the data, the elements in their order, and the data.
fn parse_header(bytes: &[u8]) -> ParseResult<(Encoding, Vec<Element>, &[u8])> {
    let mut rest = bytes;
    let (mut encoding, mut elements) = (None, Vec::new());
    for index in 0.. {
        let Some(end) = rest.iter().position(|&b| b == b'\n') else { break };
        let line = rest[..end].trim_ascii();
        rest = &rest[end + 1..];
        if index == 0 && line != b"ply" {
            break;
        }
        let unknown = || format!("header line '{}' is not known", quoted(line));
        let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
        match words[..] {
            [b"ply"] if index == 0 => {}
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", name, b"1.0"] => encoding = Some(parse_encoding(name).ok_or_else(unknown)?),
            [b"element", name, count] => elements.push(parse_element(name, count).ok_or_else(unknown)?),
            [b"property", ref property @ ..] => {
                let element: &mut Element = elements.last_mut().ok_or_else(unknown)?;
                element.properties.push(parse_property(property).ok_or_else(unknown)?);
            }
            [b"end_header"] => return Ok((encoding.ok_or("its header has no format")?, elements, rest)),
            _ => return Err(unknown()),
        }
    }
    Err("is not a PLY file: it has no header from 'ply' to 'end_header'".into())
}

fn parse_encoding(name: &[u8]) -> Option<Encoding> {
    match name {
        b"ascii" => Some(Encoding::Ascii),
        b"binary_little_endian" => Some(Encoding::LittleEndian),
        b"binary_big_endian" => Some(Encoding::BigEndian),
        _ => None,
    }
}

fn parse_element(name: &[u8], count: &[u8]) -> Option<Element> {
    let count = std::str::from_utf8(count).ok()?.parse().ok()?;
    Some(Element { is_vertex: name == b"vertex", count, properties: Vec::new() })
}

fn parse_property(words: &[&[u8]]) -> Option<Property> {
    let (layout, name) = match words {
        [b"list", length, item, name] => (Layout::List(parse_scalar(length)?, parse_scalar(item)?), name),
        [scalar, name] => (Layout::One(parse_scalar(scalar)?), name),
        _ => return None,
    };
    Some(Property { name: String::from_utf8_lossy(name).into_owned(), layout })
}

fn parse_scalar(name: &[u8]) -> Option<Scalar> {
    let (kind, size) = match name {
        b"char" | b"int8" => (NumberKind::Signed, 1),
        b"short" | b"int16" => (NumberKind::Signed, 2),
        b"int" | b"int32" => (NumberKind::Signed, 4),
        b"int64" => (NumberKind::Signed, 8),
        b"uchar" | b"uint8" => (NumberKind::Unsigned, 1),
        b"ushort" | b"uint16" => (NumberKind::Unsigned, 2),
        b"uint" | b"uint32" => (NumberKind::Unsigned, 4),
        b"uint64" => (NumberKind::Unsigned, 8),
        b"float" | b"float32" => (NumberKind::Float, 4),
        b"double" | b"float64" => (NumberKind::Float, 8),
        _ => return None,
    };
    Scalar::new(kind, size)
}
