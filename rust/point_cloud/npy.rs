//! Point clouds in `.npy`: records with the fields x y z, or N x C with x y z (intensity) in front; and N ids.

use npyz::{DType, Endianness, NpyHeader, Order, TypeChar, TypeStr};

use super::column::{Column, Kind, Scalar};
use super::fields::{Fields, find, seconds_per_tick};
use super::limit::Limit;
use super::parsed::{Parsed, shown};
use super::table::{Table, Values};
use crate::npy::split_header;

/// An array with more columns is no table of points but a picture.
const MAX_COLUMNS: u64 = 16;

pub(super) fn parse(bytes: &[u8], limit: Limit) -> Parsed<Table<'_>> {
    let (header, data) = split_header(bytes)?;
    let table = match header.dtype() {
        DType::Record(fields) => parse_records(&header, &fields, data),
        DType::Plain(dtype) => parse_columns(&header, &dtype, data),
        DType::Array(..) => Err("holds arrays of arrays, needs numbers or records".into()),
    }?;
    limit.check_points(table.num_records())?;
    Ok(table)
}

/// Of any shape: an organised cloud's rows follow one another.
fn parse_records<'a>(header: &NpyHeader, fields: &[npyz::Field], data: &'a [u8]) -> Parsed<Table<'a>> {
    let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    let found = find(&names)?;
    let bytes_of = |fields: &[npyz::Field]| fields.iter().filter_map(|f| f.dtype.num_bytes()).sum();
    let columns = found.try_map(|index| {
        let DType::Plain(dtype) = &fields[index].dtype else {
            return Err(format!("field {} is no single number", shown(names[index].as_bytes())));
        };
        column(dtype, bytes_of(&fields[..index]), bytes_of(fields))
    })?;
    let tick = columns.time.map_or(1.0, |time| seconds_per_tick(time.scalar));
    let num_records = header.shape().iter().product::<u64>() as usize;
    Table::new(data, num_records, columns, tick)
}

fn parse_columns<'a>(header: &NpyHeader, dtype: &TypeStr, data: &'a [u8]) -> Parsed<Table<'a>> {
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
    let columns = Fields {
        xyz: [column(0)?, column(1)?, column(2)?],
        intensity: (columns > 3).then(|| column(3)).transpose()?,
        ring: None,
        time: None,
        label: None,
    };
    Table::new(data, rows, columns, 1.0)
}

/// N numbers.
pub(super) fn parse_values(bytes: &[u8]) -> Parsed<Values<'_>> {
    let (header, data) = split_header(bytes)?;
    let [num_records] = *header.shape() else {
        return Err(format!("has shape {:?}, needs N numbers", header.shape()));
    };
    let DType::Plain(dtype) = header.dtype() else {
        return Err("holds records, needs an array of numbers".into());
    };
    Values::new(data, num_records as usize, column(&dtype, 0, dtype.num_bytes().unwrap_or_default())?)
}

fn column(dtype: &TypeStr, offset: usize, stride: usize) -> Parsed<Column> {
    let kind = match dtype.type_char() {
        TypeChar::Float => Some(Kind::Float),
        TypeChar::Int => Some(Kind::Signed),
        TypeChar::Uint => Some(Kind::Unsigned),
        _ => None,
    };
    let scalar = kind.and_then(|kind| Scalar::new(kind, dtype.num_bytes()?));
    let scalar = scalar.ok_or_else(|| format!("holds type {dtype}, needs integers, float32 or float64"))?;
    Ok(Column { offset, stride, scalar, is_big_endian: dtype.endianness() == Endianness::Big })
}
