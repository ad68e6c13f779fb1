//! NumPy `.npy` arrays of plain numbers, and archives of them as written by `numpy.savez`.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use npyz::{DType, Deserialize, NpyFile, NpyHeader, Order, TypeChar};
use zip::ZipArchive;
use zip::result::{ZipError, ZipResult};

use crate::error::{Error, Result};
use crate::file::{OpenFile, check_bytes};

/// NumPy's own limit, bytes.
pub const MAX_HEADER_BYTES: usize = 10_000;
/// Deepest nesting in the headers of arrays of plain numbers and of records of them.
const MAX_HEADER_DEPTH: usize = 6;

/// Splits an array into its header and its data, which has the length that the header promises.
///
/// # Errors
/// A message: the bytes are not a `.npy` array, or the header promises another number of bytes.
pub fn split_header(bytes: &[u8]) -> std::result::Result<(NpyHeader, &[u8]), String> {
    let mut data = bytes;
    let header = read_header(&mut data)?;
    check_data(&header, data.len() as u64)?;
    Ok((header, data))
}

fn check_data(header: &NpyHeader, found: u64) -> std::result::Result<(), String> {
    if data_bytes(header) == Some(found) {
        return Ok(());
    }
    let item = match header.dtype() {
        DType::Plain(dtype) => dtype.to_string(),
        _ => "records".into(),
    };
    Err(format!("holds {found} bytes of data, its header needs shape {:?} of {item}", header.shape()))
}

/// Bytes of data that a header promises; `None` if they exceed any memory.
fn data_bytes(header: &NpyHeader) -> Option<u64> {
    let item_bytes = header.dtype().num_bytes().map(|n| n as u64)?;
    header.shape().iter().try_fold(item_bytes, |product, &n| product.checked_mul(n))
}

/// Reads an array, header and data, from a stream that is no longer than the header promises.
///
/// # Errors
/// A message: the stream is not a `.npy` array, promises more than `limit` bytes, or has another number than it
/// promises.
pub fn read_array(file: &mut impl Read, limit: u64) -> std::result::Result<Vec<u8>, String> {
    let mut bytes = read_checked(file).map_err(|reason| format!("is not a .npy array: {reason}"))?;
    let (header, start) = (parse_header(&bytes)?, bytes.len());
    let promised = data_bytes(&header).unwrap_or(u64::MAX);
    check_bytes(promised.saturating_add(start as u64), limit, "")?;
    bytes.reserve_exact(promised as usize + 1);
    let unreadable = |e: std::io::Error| format!("is not a readable array: {}", e.to_string().escape_debug());
    file.take(promised + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    check_data(&header, (bytes.len() - start) as u64)?;
    Ok(bytes)
}

/// Reads the header of an array; its data follow in the file.
pub fn read_header(file: &mut impl Read) -> std::result::Result<NpyHeader, String> {
    parse_header(&read_checked(file).map_err(|reason| format!("is not a .npy array: {reason}"))?)
}

fn parse_header(header: &[u8]) -> std::result::Result<NpyHeader, String> {
    // The error may go on with a drawing of the place.
    let first_line = |e: std::io::Error| {
        let reason = e.to_string();
        let line = reason.lines().next().unwrap_or_default().escape_debug().to_string();
        format!("is not a .npy array: {line}")
    };
    NpyHeader::from_reader(header).map_err(first_line)
}

/// Reads the bytes of a header and checks what its parser takes on trust: that the length is true, and that
/// brackets are few, since it tries each pair of them twice, recursively.
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
    if length > MAX_HEADER_BYTES {
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
        if depth > MAX_HEADER_DEPTH {
            return Err("its header is nested too deeply");
        }
    }
    Ok(bytes)
}

/// Reads an H x W array of class ids: numbers of any integer or float type that are integers from 0 to 65,535.
///
/// # Errors
/// The file cannot be read, is not a `.npy` array, does not hold plain numbers, is Fortran-ordered, its header
/// promises another number of bytes or a shape that `check_shape` refuses, or a number is not a class id.
pub fn read_ids(
    path: &Path,
    file: OpenFile,
    check_shape: impl FnOnce(&[u64]) -> Result<()>,
) -> Result<Vec<u16>> {
    let size = file.size();
    file.parse(|stream| read_ids_of(path, stream, size, check_shape))
}

fn read_ids_of(
    path: &Path,
    mut stream: impl Read,
    size: u64,
    check_shape: impl FnOnce(&[u64]) -> Result<()>,
) -> Result<Vec<u16>> {
    let complain = |reason: String| Error::file(path, reason);
    let bytes =
        read_checked(&mut stream).map_err(|reason| complain(format!("is not a .npy array: {reason}")))?;
    let header = parse_header(&bytes).map_err(complain)?;
    check_data(&header, size.saturating_sub(bytes.len() as u64)).map_err(complain)?;
    let DType::Plain(dtype) = header.dtype() else {
        return Err(complain("holds records, needs an array of numbers".into()));
    };
    if header.order() != Order::C {
        return Err(complain("is Fortran-ordered, needs C order".into()));
    }
    check_shape(header.shape())?;
    let file = NpyFile::with_header(header, stream);
    match (dtype.type_char(), dtype.size_field()) {
        (TypeChar::Float, 4) => ids(path, file, |x: f32| x.into()),
        (TypeChar::Float, 8) => ids(path, file, |x: f64| x),
        (TypeChar::Uint, 1) => ids(path, file, |x: u8| x.into()),
        (TypeChar::Uint, 2) => ids(path, file, |x: u16| x.into()),
        (TypeChar::Uint, 4) => ids(path, file, |x: u32| x.into()),
        (TypeChar::Int, 1) => ids(path, file, |x: i8| x.into()),
        (TypeChar::Int, 2) => ids(path, file, |x: i16| x.into()),
        (TypeChar::Int, 4) => ids(path, file, |x: i32| x.into()),
        (TypeChar::Uint, 8) => ids(path, file, |x: u64| x as f64),
        (TypeChar::Int, 8) => ids(path, file, |x: i64| x as f64),
        _ => Err(complain(format!("holds type {dtype}, needs integers, float32 or float64"))),
    }
}

fn ids<T: Deserialize>(path: &Path, file: NpyFile<impl Read>, to_f64: impl Fn(T) -> f64) -> Result<Vec<u16>> {
    let unreadable = |e: std::io::Error| Error::file(path, e.to_string());
    let data = file.data::<T>().map_err(|e| unreadable(std::io::Error::other(e)))?;
    data.map(|value| class_id(path, to_f64(value.map_err(unreadable)?))).collect()
}

fn class_id(path: &Path, value: f64) -> Result<u16> {
    let id = value as u16;
    if f64::from(id) == value {
        return Ok(id);
    }
    Err(Error::file(path, format!("holds {value}, a class id is an integer from 0 to 65535")))
}

/// Start of the last record of an archive, and its length without its comment.
const LAST_RECORD: &[u8] = b"PK\x05\x06";
const LAST_RECORD_BYTES: usize = 22;
/// Bytes of the longest comment, which ends an archive.
const MAX_COMMENT_BYTES: usize = 65_535;

/// Opens an archive, unless it has so many files that it needs ZIP64: the table of contents is read as a whole and
/// takes up to six times its size.
pub fn open_archive<R: Read + Seek>(mut file: R) -> ZipResult<ZipArchive<R>> {
    let size = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(size.saturating_sub((MAX_COMMENT_BYTES + LAST_RECORD_BYTES) as u64)))?;
    let mut end = Vec::new();
    file.by_ref().take((MAX_COMMENT_BYTES + LAST_RECORD_BYTES) as u64).read_to_end(&mut end)?;
    // The number of files that marks ZIP64.
    let is_large = |record: &[u8]| record.starts_with(LAST_RECORD) && record[10..12] == [0xff; 2];
    if end.windows(LAST_RECORD_BYTES).any(is_large) {
        return Err(ZipError::UnsupportedArchive("too many files"));
    }
    file.seek(SeekFrom::Start(0))?;
    ZipArchive::new(file)
}
