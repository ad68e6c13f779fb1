//! Point clouds in `.npy`: records with the fields x y z, or N x C with x y z (intensity) in front; and N ids. In
//! `.npz`: one array as in `.npy`; or several, one of which has a name listed below, and the others are its fields.

use std::io::{Cursor, Read, Seek};
use std::path::Path;

use npyz::{DType, Endianness, NpyHeader, Order, TypeChar, TypeStr};
use zip::ZipArchive;

use super::column::{Column, NumberKind, Scalar};
use super::fields::{Fields, SHOWN_OF_OWN, find, listed, seconds_per_tick};
use super::limit::{ParseResult, quoted};
use super::options::Reading;
use super::own_points::OwnPoints;
use super::table::{EntryValues, Table};
use crate::array_file::{open_archive, read_array, split_header};
use crate::file::{OpenFile, Stream};

/// An array with more columns is an image rather than a table of points.
const MAX_COLUMNS: u64 = 16;
/// Fields of a table of numbers without names.
const COLUMNS: [&str; 4] = ["x", "y", "z", "intensity"];

pub(super) fn parse<'a>(bytes: &'a [u8], reading: &Reading) -> ParseResult<Table<'a>> {
    parse_table(bytes, reading, reading.own_points.as_ref())
}

fn parse_table<'a>(bytes: &'a [u8], reading: &Reading, own: Option<&OwnPoints>) -> ParseResult<Table<'a>> {
    let (header, data) = split_header(bytes)?;
    let table = match header.dtype() {
        DType::Record(fields) => parse_records(&header, &fields, data, own),
        DType::Plain(dtype) => parse_columns(&header, &dtype, data, own),
        DType::Array(..) => Err("holds arrays of arrays, needs numbers or records".into()),
    }?;
    reading.limit.check_points(table.num_records())?;
    Ok(table)
}

/// Records of any shape: the rows of an organised cloud follow one another.
fn parse_records<'a>(
    header: &NpyHeader,
    fields: &[npyz::Field],
    data: &'a [u8],
    own: Option<&OwnPoints>,
) -> ParseResult<Table<'a>> {
    let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    let indices = find(&names, own)?;
    let bytes_of = |fields: &[npyz::Field]| fields.iter().filter_map(|f| f.dtype.num_bytes()).sum();
    let columns = indices.try_map(|index| {
        let column = match &fields[index].dtype {
            DType::Plain(dtype) => column(dtype, bytes_of(&fields[..index]), bytes_of(fields)),
            _ => Err("is not a single number".into()),
        };
        column.map_err(|reason| format!("field '{}' {reason}", quoted(names[index].as_bytes())))
    })?;
    let tick = columns.time.map_or(1.0, |time| seconds_per_tick(time.scalar));
    let num_records = header.shape().iter().product::<u64>() as usize;
    Table::new(data, num_records, columns, tick)
}

fn parse_columns<'a>(
    header: &NpyHeader,
    dtype: &TypeStr,
    data: &'a [u8],
    own: Option<&OwnPoints>,
) -> ParseResult<Table<'a>> {
    let [num_records, num_columns @ 3..=MAX_COLUMNS] = *header.shape() else {
        let needed = "N x 3, or N x 4 and more (x y z intensity ...)";
        return Err(format!("has shape {:?}, needs {needed}", header.shape()));
    };
    let (rows, columns) = (num_records as usize, num_columns as usize);
    let size = dtype.num_bytes().unwrap_or_default();
    let (between_columns, stride) = match header.order() {
        Order::C => (size, size * columns),
        Order::Fortran => (size * rows, size),
    };
    let column = |index: usize| column(dtype, index * between_columns, stride);
    let indices = find(&COLUMNS[..columns.min(COLUMNS.len())], own)?;
    Table::new(data, rows, indices.try_map(column)?, 1.0)
}

fn field_names(bytes: &[u8]) -> ParseResult<Vec<String>> {
    let (header, _) = split_header(bytes)?;
    Ok(match (header.dtype(), header.shape()) {
        (DType::Record(fields), _) => fields.into_iter().map(|field| field.name).collect(),
        (_, shape) => {
            let num_columns = shape.get(1).map_or(0, |&count| count as usize);
            COLUMNS.iter().take(num_columns).map(|&name| name.to_owned()).collect()
        }
    })
}

/// N numbers.
pub(super) fn parse_values(bytes: &[u8]) -> ParseResult<EntryValues<'_>> {
    let (header, data) = split_header(bytes)?;
    let [num_records] = *header.shape() else {
        return Err(format!("has shape {:?}, needs N numbers", header.shape()));
    };
    let DType::Plain(dtype) = header.dtype() else {
        return Err("holds records, needs an array of numbers".into());
    };
    EntryValues::new(data, num_records as usize, column(&dtype, 0, dtype.num_bytes().unwrap_or_default())?)
}

fn column(dtype: &TypeStr, offset: usize, stride: usize) -> ParseResult<Column> {
    let kind = match dtype.type_char() {
        TypeChar::Float => Some(NumberKind::Float),
        TypeChar::Int => Some(NumberKind::Signed),
        TypeChar::Uint => Some(NumberKind::Unsigned),
        _ => None,
    };
    let scalar = kind.and_then(|kind| Scalar::new(kind, dtype.num_bytes()?));
    let scalar = scalar.ok_or_else(|| format!("holds type {dtype}, needs integers, float32 or float64"))?;
    Ok(Column { offset, stride, scalar, is_big_endian: dtype.endianness() == Endianness::Big })
}

/// Names of the array that holds x y z, if there are several; the last is the default of `numpy.savez`.
const POINTS: &[&str] = &["points", "xyz", "cloud", "point_cloud", "pointcloud", "arr_0"];

/// Largest ratio of unpacked to packed size, for archives that unpack to more than the smallest limit.
const MAX_RATIO: u64 = 100;
const MIN_LIMIT: u64 = 1 << 24;

/// An archive that unpacks only what is needed.
struct Arrays<R> {
    archive: ZipArchive<R>,
    names: Vec<String>,
    /// Number of bytes that may still be unpacked.
    left: u64,
}

pub(super) fn parse_archive(bytes: &[u8], reading: &Reading) -> ParseResult<Table<'static>> {
    let most = (bytes.len() as u64).saturating_mul(MAX_RATIO).max(MIN_LIMIT);
    let mut arrays = Arrays::new(Cursor::new(bytes), most.min(reading.limit.max_bytes()))?;
    let points = arrays.points()?;
    // The points' own array provides x, y and z.
    let names: Vec<&str> =
        ["x", "y", "z"].into_iter().chain(arrays.names.iter().map(String::as_str)).collect();
    // What tells the LiDAR's own points is an array, or else a field of the points.
    let own = reading.own_points.as_ref();
    let indices = find(&names, own).or_else(|_| find(&names, None))?;
    let own_of_points = own.filter(|_| indices.own.is_none_or(|index| index < 3));
    let unpacked = arrays.unpack(points)?;
    if let Some(own) = own_of_points {
        arrays.explain(points, parse_table(&unpacked, reading, None))?;
        arrays.check_own(own, points, &unpacked)?;
    }
    let parsed = parse_table(&unpacked, reading, own_of_points);
    let mut table = arrays.explain(points, parsed)?.into_owned();
    drop(unpacked);
    // Separate arrays take precedence over the fields of the table.
    let mut join = |index: Option<usize>, field: fn(&mut Fields<Column>) -> &mut Option<Column>| {
        let Some(member) = index.and_then(|index| index.checked_sub(3)) else { return Ok(()) };
        let unpacked = arrays.unpack(member)?;
        let joined = parse_values(&unpacked).and_then(|values| table.join(&values));
        *field(&mut table.columns) = Some(arrays.explain(member, joined)?);
        Ok::<_, String>(())
    };
    join(indices.intensity, |fields| &mut fields.intensity)?;
    join(indices.ring, |fields| &mut fields.ring)?;
    join(indices.time, |fields| &mut fields.time)?;
    join(indices.label, |fields| &mut fields.label)?;
    join(indices.own, |fields| &mut fields.own)?;
    table.seconds_per_tick = table.columns.time.map_or(1.0, |time| seconds_per_tick(time.scalar));
    Ok(table)
}

/// Unpacked size of the arrays of a file, according to its table of contents.
pub(super) fn unpacked_bytes(path: &Path) -> Option<u64> {
    let sum_of = |stream: Stream<'_>| {
        let mut archive = open_archive(stream).ok()?;
        let mut sizes = (0..archive.len()).map(|index| Some(archive.by_index_raw(index).ok()?.size()));
        sizes.try_fold(0u64, |sum, size| Some(sum.saturating_add(size?)))
    };
    OpenFile::open(path).ok()?.parse(|stream| Ok(sum_of(stream))).ok()?
}

impl<R: Read + Seek> Arrays<R> {
    fn new(file: R, left: u64) -> ParseResult<Self> {
        let mut archive = open_archive(file).map_err(|e| invalid(&e))?;
        let count = archive.len();
        let name = |index| {
            let file = archive.by_index(index).map_err(|e| invalid(&e))?;
            Ok(file.name().map_err(|e| invalid(&e))?.trim_end_matches(".npy").to_owned())
        };
        let names = (0..count).map(name).collect::<ParseResult<_>>()?;
        Ok(Self { archive, names, left })
    }

    fn points(&self) -> ParseResult<usize> {
        if self.names.len() == 1 {
            return Ok(0);
        }
        let named = POINTS.iter().find_map(|wanted| self.names.iter().position(|name| name == wanted));
        named.ok_or_else(|| {
            let found: Vec<String> = self.names.iter().take(8).map(|name| quoted(name.as_bytes())).collect();
            format!("holds the arrays '{}', needs one of '{}'", found.join(" "), POINTS.join(" "))
        })
    }

    /// Checks that a field of the points, none of the arrays, tells the LiDAR's own points.
    fn check_own(&self, own: &OwnPoints, points: usize, unpacked: &[u8]) -> ParseResult<()> {
        let fields = field_names(unpacked)?;
        let names: Vec<&str> = ["x", "y", "z"].into_iter().chain(fields.iter().map(String::as_str)).collect();
        find(&names, Some(own)).map(drop).map_err(|_| {
            let fields = listed("field", &fields, SHOWN_OF_OWN);
            if self.names.len() == 1 {
                return own.missing_in(&fields);
            }
            let name = self.names.get(points).map(String::as_bytes).unwrap_or_default();
            let arrays = listed("array", &self.names, SHOWN_OF_OWN);
            own.missing_in(&format!("{arrays}, and {fields} in {}", quoted(name)))
        })
    }

    /// The bytes of an array, as many as its header promises.
    fn unpack(&mut self, index: usize) -> ParseResult<Vec<u8>> {
        let mut file = self.archive.by_index(index).map_err(|e| invalid(&e))?;
        // A table of contents that promises too little gets no more.
        let limit = file.size().min(self.left);
        let unpacked = read_array(&mut file, limit);
        drop(file);
        let bytes = self.explain(index, unpacked)?;
        self.left = self.left.saturating_sub(bytes.len() as u64);
        Ok(bytes)
    }

    fn explain<T>(&self, index: usize, result: ParseResult<T>) -> ParseResult<T> {
        let name = self.names.get(index).map(String::as_bytes).unwrap_or_default();
        result.map_err(|reason| format!("array {} {reason}", quoted(name)))
    }
}

fn invalid(error: &dyn std::fmt::Display) -> String {
    format!("is not a readable .npz: {}", quoted(error.to_string().as_bytes()))
}
