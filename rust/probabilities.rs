//! Class probabilities as written by networks: the only array of an `.npz`, with the classes along the last axis;
//! float16, float32, float64 or uint8, on any scale.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use npyz::{DType, Order, TypeChar};
use rayon::prelude::*;

use crate::array_file::{MAX_HEADER_BYTES, open_archive, read_header};
use crate::classes::ClassShares;
use crate::error::{Error, Result};
use crate::file::OpenFile;

/// Largest number of classes; raw ids are the indices along the last axis.
const MAX_CLASSES: usize = 255;
/// Largest number of bytes of one item's probabilities, and of the other bytes of an archive.
const MAX_ITEM_BYTES: u64 = 8 * MAX_CLASSES as u64;
const MORE_BYTES: u64 = 4 * MAX_HEADER_BYTES as u64;
/// Largest mean number of classes per item: a wider spread carries no information, and a small file could fill the
/// memory with it.
const MAX_SPREAD: usize = 32;

/// Reads many files of one shape in parallel; the error of the first failing one wins.
pub fn read_all(paths: &[PathBuf], shape: &[usize]) -> Result<Vec<ClassShares>> {
    let shares: Vec<Result<ClassShares>> = paths.par_iter().map(|path| read(path, shape)).collect();
    shares.into_iter().collect()
}

/// Reads the class shares of `shape` items: `[height, width]` pixels or `[n]` points.
///
/// An array is read line by line, so that an unpacked file is never held as a whole.
pub fn read(path: &Path, shape: &[usize]) -> Result<ClassShares> {
    let invalid = |e: zip::result::ZipError| Error::file(path, format!("is not a readable .npz: {e}"));
    let num_items: u64 = shape.iter().map(|&n| n as u64).product();
    let limit = num_items.saturating_mul(MAX_ITEM_BYTES).saturating_add(MORE_BYTES);
    let file = OpenFile::open(path)?.at_most(limit, &format!(" for {num_items} items"))?;
    file.parse(|stream| {
        let mut archive = open_archive(stream).map_err(invalid)?;
        if archive.len() != 1 {
            return Err(Error::file(path, format!("holds {} arrays, needs one", archive.len())));
        }
        let array = archive.by_index(0).map_err(invalid)?;
        read_array(path, BufReader::new(array), shape)
    })
}

fn read_array(path: &Path, mut file: impl Read, shape: &[usize]) -> Result<ClassShares> {
    let header = read_header(&mut file).map_err(|reason| Error::file(path, reason))?;
    let found: Vec<usize> = header.shape().iter().map(|&n| n as usize).collect();
    let num_classes = match found.split_last() {
        Some((&num_classes, items)) if items == shape && (1..=MAX_CLASSES).contains(&num_classes) => {
            num_classes
        }
        _ => {
            let needed: String = shape.iter().map(|n| format!("{n} x ")).collect();
            let reason =
                format!("has shape {found:?}, needs {needed}C probabilities, C at most {MAX_CLASSES}");
            return Err(Error::file(path, reason));
        }
    };
    if header.order() != Order::C {
        return Err(Error::file(path, "is Fortran-ordered, needs C order"));
    }
    let (size, decode) = decoder(path, &header.dtype())?;
    let mut record = vec![0; num_classes * size];
    let mut values = vec![0.0; num_classes];
    let mut shares = ClassShares::default();
    let num_items = shape.iter().product::<usize>();
    let max_shares = num_items.saturating_mul(MAX_SPREAD).min(u32::MAX as usize);
    for index in 0..num_items {
        file.read_exact(&mut record).map_err(|e| Error::file(path, format!("ends early: {e}")))?;
        values.iter_mut().zip(record.chunks_exact(size)).for_each(|(value, bytes)| *value = decode(bytes));
        shares.push_proportional(&values).map_err(|wrong| {
            Error::file(
                path,
                format!("item {index}: holds {wrong}, a probability is finite and not negative"),
            )
        })?;
        if shares.entries().len() > max_shares {
            let reason = format!("spreads its items over more than {MAX_SPREAD} classes each, on average");
            return Err(Error::file(path, reason));
        }
    }
    Ok(shares)
}

type Decode = fn(&[u8]) -> f32;

/// Number of bytes of a number of the array's type, and its decoder.
fn decoder(path: &Path, dtype: &DType) -> Result<(usize, Decode)> {
    let found = if let DType::Plain(plain) = dtype { plain.to_string() } else { "records".into() };
    let unknown = || {
        Error::file(
            path,
            format!("holds type {found}, needs little-endian float16, float32, float64, or uint8"),
        )
    };
    let DType::Plain(plain) = dtype else { return Err(unknown()) };
    let is_little = plain.endianness() != npyz::Endianness::Big;
    let size = plain.size_field() as usize;
    let decode: Decode = match (plain.type_char(), size, is_little) {
        (TypeChar::Uint, 1, _) => |b| f32::from(b[0]),
        (TypeChar::Float, 2, true) => |b| half::f16::from_le_bytes([b[0], b[1]]).to_f32(),
        (TypeChar::Float, 4, true) => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        (TypeChar::Float, 8, true) => {
            |b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32
        }
        _ => return Err(unknown()),
    };
    Ok((size, decode))
}
