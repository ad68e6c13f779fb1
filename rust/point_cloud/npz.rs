//! Point clouds in `.npz`: one array as in `.npy`; or several, of which one is named as below and others are its fields.

use std::io::{Cursor, Read, Seek};
use std::path::Path;

use zip::ZipArchive;

use super::fields::find;
use super::limit::Limit;
use super::npy;
use super::parsed::{Parsed, shown};
use super::table::Table;
use crate::archive;
use crate::file::{Opened, Stream};
use crate::npy::read_array;

/// Names of the array that holds x y z, where there are several; the last is `numpy.savez`'s own.
const POINTS: &[&str] = &["points", "xyz", "cloud", "point_cloud", "pointcloud", "arr_0"];

/// Largest ratio of the unpacked size of an archive to its own size, once it unpacks to more than the smallest limit.
const LARGEST_RATIO: u64 = 100;
const SMALLEST_LIMIT: u64 = 1 << 24;

/// An archive, of which only what is needed is unpacked.
struct Arrays<R> {
    archive: ZipArchive<R>,
    names: Vec<String>,
    /// Bytes that may still be unpacked.
    left: u64,
}

pub(super) fn parse(bytes: &[u8], limit: Limit) -> Parsed<Table<'static>> {
    let most = (bytes.len() as u64).saturating_mul(LARGEST_RATIO).max(SMALLEST_LIMIT);
    let mut arrays = Arrays::new(Cursor::new(bytes), most.min(limit.max_bytes()))?;
    let points = arrays.points()?;
    let unpacked = arrays.unpack(points)?;
    let mut table = arrays.explain(points, npy::parse(&unpacked, limit))?.into_owned();
    drop(unpacked);
    // The points' own array stands for x, y and z.
    let names: Vec<&str> =
        ["x", "y", "z"].into_iter().chain(arrays.names.iter().map(String::as_str)).collect();
    let found = find(&names)?;
    let mut join = |index: Option<usize>| {
        let member = index.and_then(|index| index.checked_sub(3));
        member
            .map(|member| {
                let unpacked = arrays.unpack(member)?;
                let joined = npy::parse_values(&unpacked).and_then(|values| table.join(&values));
                arrays.explain(member, joined)
            })
            .transpose()
    };
    let (intensity, ring) = (join(found.intensity)?, join(found.ring)?);
    let (time, label) = (join(found.time)?, join(found.label)?);
    table.put(intensity, ring, time, label);
    Ok(table)
}

/// What the arrays of a file unpack to, as its table of contents says.
pub(super) fn unpacked_bytes(path: &Path) -> Option<u64> {
    let sum_of = |stream: Stream<'_>| {
        let mut archive = archive::open(stream).ok()?;
        let mut sizes = (0..archive.len()).map(|index| Some(archive.by_index_raw(index).ok()?.size()));
        sizes.try_fold(0u64, |sum, size| Some(sum.saturating_add(size?)))
    };
    Opened::open(path).ok()?.parse(|stream| Ok(sum_of(stream))).ok()?
}

impl<R: Read + Seek> Arrays<R> {
    fn new(file: R, left: u64) -> Parsed<Self> {
        let mut archive = archive::open(file).map_err(|e| invalid(&e))?;
        let count = archive.len();
        let name = |index| {
            let file = archive.by_index(index).map_err(|e| invalid(&e))?;
            Ok(file.name().map_err(|e| invalid(&e))?.trim_end_matches(".npy").to_owned())
        };
        let names = (0..count).map(name).collect::<Parsed<_>>()?;
        Ok(Self { archive, names, left })
    }

    /// The index of the array that holds x y z.
    fn points(&self) -> Parsed<usize> {
        if self.names.len() == 1 {
            return Ok(0);
        }
        let named = POINTS.iter().find_map(|wanted| self.names.iter().position(|name| name == wanted));
        named.ok_or_else(|| {
            let found: Vec<String> = self.names.iter().take(8).map(|name| shown(name.as_bytes())).collect();
            format!("holds the arrays '{}', needs one of '{}'", found.join(" "), POINTS.join(" "))
        })
    }

    /// The bytes of an array, as many as its header promises.
    fn unpack(&mut self, index: usize) -> Parsed<Vec<u8>> {
        let mut file = self.archive.by_index(index).map_err(|e| invalid(&e))?;
        // A table of contents that promises too little gets no more.
        let limit = file.size().min(self.left);
        let unpacked = read_array(&mut file, limit);
        drop(file);
        let bytes = self.explain(index, unpacked)?;
        self.left = self.left.saturating_sub(bytes.len() as u64);
        Ok(bytes)
    }

    fn explain<T>(&self, index: usize, result: Parsed<T>) -> Parsed<T> {
        let name = self.names.get(index).map(String::as_bytes).unwrap_or_default();
        result.map_err(|reason| format!("array {} {reason}", shown(name)))
    }
}

fn invalid(error: &dyn std::fmt::Display) -> String {
    format!("is no readable .npz: {}", shown(error.to_string().as_bytes()))
}
