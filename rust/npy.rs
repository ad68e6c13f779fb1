//! NumPy `.npy` arrays of plain numbers.

use std::io::Read;
use std::path::Path;

use npyz::{DType, Deserialize, NpyFile, NpyHeader, Order, TypeChar};

use crate::error::{Error, Result};
use crate::file::read_bytes;

/// A C-ordered array whose values are exact in f64 (integers up to 2^53).
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<usize>,
    /// The values, last axis fastest.
    pub values: Vec<f64>,
}

/// NumPy's own limit, and the deepest that arrays of plain numbers and of records of them go.
const LONGEST_HEADER: usize = 10_000;
const DEEPEST_HEADER: usize = 6;

/// An array's header and its data, which has the length that the header promises.
///
/// # Errors
/// It is no `.npy`, or promises another number of bytes: in words.
pub fn split_header(bytes: &[u8]) -> std::result::Result<(NpyHeader, &[u8]), String> {
    let mut data = bytes;
    let header = read_header(&mut data)?;
    let item_bytes = header.dtype().num_bytes().map(|n| n as u64);
    let needed = header.shape().iter().try_fold(item_bytes, |product, &n| Some(product?.checked_mul(n)));
    if needed.flatten() != Some(data.len() as u64) {
        let item = match header.dtype() {
            DType::Plain(dtype) => dtype.to_string(),
            _ => "records".into(),
        };
        let promise = format!("shape {:?} of {item}", header.shape());
        return Err(format!("holds {} bytes of data, its header needs {promise}", data.len()));
    }
    Ok((header, data))
}

/// An array's header; what follows in the file is its data.
///
/// # Errors
/// It is no `.npy`: in words.
pub fn read_header(file: &mut impl Read) -> std::result::Result<NpyHeader, String> {
    let header = read_checked(file).map_err(|reason| format!("is no .npy array: {reason}"))?;
    // Its complaint may go on with a picture of the place.
    let first_line = |e: std::io::Error| {
        let reason = e.to_string();
        let line = reason.lines().next().unwrap_or_default().escape_debug().to_string();
        format!("is no .npy array: {line}")
    };
    NpyHeader::from_reader(header.as_slice()).map_err(first_line)
}

/// The bytes of a header, without what its parser takes on trust: that the length is true, and that brackets are few. It
/// tries each pair of them twice, again and again inside.
fn read_checked(file: &mut impl Read) -> std::result::Result<Vec<u8>, &'static str> {
    let mut bytes = vec![0; 10];
    let mut read = |bytes: &mut [u8], complaint| file.read_exact(bytes).map_err(|_| complaint);
    const NO_START: &str = "it does not start like one";
    read(&mut bytes, NO_START)?;
    let length = match bytes[..] {
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 1, _, a, b] => u32::from_le_bytes([a, b, 0, 0]),
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b] => {
            let mut rest = [0; 2];
            read(&mut rest, NO_START)?;
            bytes.extend(rest);
            u32::from_le_bytes([a, b, rest[0], rest[1]])
        }
        _ => return Err(NO_START),
    };
    let (start, length) = (bytes.len(), length as usize);
    if length > LONGEST_HEADER {
        return Err("its header is too long");
    }
    bytes.resize(start + length, 0);
    read(&mut bytes[start..], "its header is too long")?;
    let mut depth = 0usize;
    for byte in &bytes[start..] {
        match byte {
            b'{' | b'[' | b'(' => depth += 1,
            b'}' | b']' | b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > DEEPEST_HEADER {
            return Err("its header is nested too deeply");
        }
    }
    Ok(bytes)
}

/// Reads an array of any integer or float type.
///
/// # Errors
/// The file cannot be read, is no `.npy`, holds no plain numbers, is Fortran-ordered, or its header promises another
/// number of bytes than it has.
pub fn read(path: &Path) -> Result<Array> {
    let bytes = read_bytes(path)?;
    let (header, rest) = split_header(&bytes).map_err(|reason| Error::file(path, reason))?;
    let DType::Plain(dtype) = header.dtype() else {
        return Err(Error::file(path, "holds records, needs an array of numbers"));
    };
    if header.order() != Order::C {
        return Err(Error::file(path, "is Fortran-ordered, needs C order"));
    }
    let shape: Vec<usize> = header.shape().iter().map(|&n| n as usize).collect();
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
