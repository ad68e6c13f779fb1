//! Point clouds in `.npz`: one array as in `.npy`; or several, of which one is named as below and others are its fields.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use super::fields::find;
use super::npy;
use super::parsed::{Parsed, shown};
use super::table::Table;

/// Names of the array that holds x y z, where there are several; the last is `numpy.savez`'s own.
const POINTS: &[&str] = &["points", "xyz", "cloud", "point_cloud", "pointcloud", "arr_0"];

/// Largest ratio of the unpacked size of an archive to its own size, once it unpacks to more than the smallest limit.
const LARGEST_RATIO: u64 = 100;
const SMALLEST_LIMIT: u64 = 1 << 24;

struct Member {
    name: String,
    bytes: Vec<u8>,
}

pub(super) fn parse(bytes: &[u8]) -> Parsed<Table<'static>> {
    let members = unpack(bytes)?;
    let points = points_of(&members)?;
    let mut table = points.explain(npy::parse(&points.bytes))?.into_owned();
    // The points' own array stands for x, y and z.
    let names: Vec<&str> =
        ["x", "y", "z"].into_iter().chain(members.iter().map(|m| m.name.as_str())).collect();
    let found = find(&names)?;
    let mut join = |index: Option<usize>| {
        let member = index.and_then(|index| members.get(index - 3));
        member
            .map(|member| member.explain(npy::parse_values(&member.bytes).and_then(|x| table.join(&x))))
            .transpose()
    };
    let (intensity, ring) = (join(found.intensity)?, join(found.ring)?);
    let (time, label) = (join(found.time)?, join(found.label)?);
    table.put(intensity, ring, time, label);
    Ok(table)
}

fn points_of(members: &[Member]) -> Parsed<&Member> {
    if let [only] = members {
        return Ok(only);
    }
    let named = POINTS.iter().find_map(|name| members.iter().find(|member| member.name == *name));
    named.ok_or_else(|| {
        let found: Vec<String> = members.iter().take(8).map(|member| shown(member.name.as_bytes())).collect();
        format!("holds the arrays '{}', needs one of '{}'", found.join(" "), POINTS.join(" "))
    })
}

impl Member {
    fn explain<T>(&self, result: Parsed<T>) -> Parsed<T> {
        result.map_err(|reason| format!("array {} {reason}", shown(self.name.as_bytes())))
    }
}

fn unpack(bytes: &[u8]) -> Parsed<Vec<Member>> {
    let invalid =
        |e: &dyn std::fmt::Display| format!("is no readable .npz: {}", shown(e.to_string().as_bytes()));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| invalid(&e))?;
    let limit = (bytes.len() as u64).saturating_mul(LARGEST_RATIO).max(SMALLEST_LIMIT);
    let (mut members, mut left) = (Vec::new(), limit);
    for index in 0..archive.len() {
        let file = archive.by_index(index).map_err(|e| invalid(&e))?;
        let name = file.name().map_err(|e| invalid(&e))?.trim_end_matches(".npy").to_owned();
        let mut bytes = Vec::new();
        file.take(left + 1).read_to_end(&mut bytes).map_err(|e| invalid(&e))?;
        left = left
            .checked_sub(bytes.len() as u64)
            .ok_or_else(|| format!("unpacks to more than {limit} bytes"))?;
        members.push(Member { name, bytes });
    }
    Ok(members)
}
