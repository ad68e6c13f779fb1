//! NumPy `.npy` arrays of plain numbers.

use std::path::Path;

use npyz::{DType, Deserialize, NpyFile, Order, TypeChar};

use crate::error::{Error, Result};
use crate::file::read_bytes;

/// A C-ordered array whose values are exact in f64 (integers up to 2^53).
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<usize>,
    /// The values, last axis fastest.
    pub values: Vec<f64>,
}

/// Reads an array of any integer or float type.
///
/// # Errors
/// The file cannot be read, is no `.npy`, holds no plain numbers, is Fortran-ordered, or its header promises another
/// number of bytes than it has.
pub fn read(path: &Path) -> Result<Array> {
    let bytes = read_bytes(path)?;
    let mut rest = bytes.as_slice();
    let header = npyz::NpyHeader::from_reader(&mut rest)
        .map_err(|e| Error::file(path, format!("is no .npy array: {e}")))?;
    let DType::Plain(dtype) = header.dtype() else {
        return Err(Error::file(path, "holds records, needs an array of numbers"));
    };
    if header.order() != Order::C {
        return Err(Error::file(path, "is Fortran-ordered, needs C order"));
    }
    let shape: Vec<usize> = header.shape().iter().map(|&n| n as usize).collect();
    let needed = shape
        .iter()
        .chain(&[dtype.size_field() as usize])
        .try_fold(1usize, |product, &n| product.checked_mul(n));
    if needed != Some(rest.len()) {
        let reason =
            format!("holds {} bytes of data, its header needs shape {shape:?} of {dtype}", rest.len());
        return Err(Error::file(path, reason));
    }
    let file = NpyFile::with_header(header, rest);
    let values = match (dtype.type_char(), dtype.size_field()) {
        (TypeChar::Float, 4) => convert::<f32>(file),
        (TypeChar::Float, 8) => convert::<f64>(file),
        (TypeChar::Uint, 1) => convert::<u8>(file),
        (TypeChar::Uint, 2) => convert::<u16>(file),
        (TypeChar::Uint, 4) => convert::<u32>(file),
        (TypeChar::Int, 1) => convert::<i8>(file),
        (TypeChar::Int, 2) => convert::<i16>(file),
        (TypeChar::Int, 4) => convert::<i32>(file),
        (TypeChar::Uint, 8) => widen(file, |x: u64| x as f64),
        (TypeChar::Int, 8) => widen(file, |x: i64| x as f64),
        _ => {
            return Err(Error::file(path, format!("holds type {dtype}, needs integers, float32 or float64")));
        }
    };
    let values = values.map_err(|e| Error::file(path, e.to_string()))?;
    Ok(Array { shape, values })
}

fn convert<T: Deserialize + Into<f64>>(file: NpyFile<&[u8]>) -> std::io::Result<Vec<f64>> {
    widen(file, T::into)
}

fn widen<T: Deserialize>(file: NpyFile<&[u8]>, to_f64: impl Fn(T) -> f64) -> std::io::Result<Vec<f64>> {
    let data = file.data::<T>().map_err(std::io::Error::other)?;
    data.map(|x| x.map(&to_f64)).collect()
}

/// Class ids from numbers: integers from 0 to 65,535.
///
/// # Errors
/// A number is not such an id.
pub fn class_ids(path: &Path, values: &[f64]) -> Result<Vec<u16>> {
    let id = |&x: &f64| {
        let id = x as u16;
        (f64::from(id) == x).then_some(id)
    };
    values
        .iter()
        .map(|x| {
            id(x).ok_or_else(|| {
                Error::file(path, format!("holds {x}, a class id is an integer from 0 to 65535"))
            })
        })
        .collect()
}
