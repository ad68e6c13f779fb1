//! Label images: one class id per pixel.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Transformations};
use rayon::prelude::*;

use crate::array_file::read_ids;
use crate::classes::NO_CLASS;
use crate::error::{Error, Result};
use crate::file::{OpenFile, extension};
use crate::probabilities;

/// A row-major image of ids: raw (`u16`) as read, dense (`u8`) in the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelImage<T> {
    pub width: usize,
    pub height: usize,
    pub ids: Vec<T>,
}

impl<T: Copy> LabelImage<T> {
    pub fn at(&self, u: usize, v: usize) -> T {
        self.ids[v * self.width + u]
    }
}

/// The encoding of all label images of a drive.
#[derive(Clone, Debug, Default)]
pub struct Encoding {
    pub size: (usize, usize),
    /// Colours of the classes in colour-coded images; the index is the id. Colours that are not listed have the id
    /// [`NO_ID`].
    pub palette: Option<HashMap<[u8; 3], u16>>,
}

/// Largest number of bytes per pixel in a file, and of the other bytes.
const BYTES_A_PIXEL: u64 = 16;
const MORE_BYTES: u64 = 1 << 20;

/// The id of pixels with no class of the encoding.
pub const NO_ID: u16 = u16::MAX;

impl Encoding {
    /// Reads many label images in parallel; the error of the first failing frame wins.
    pub fn read_all(&self, paths: &[PathBuf]) -> Result<Vec<LabelImage<u16>>> {
        let images: Vec<Result<LabelImage<u16>>> = paths.par_iter().map(|path| self.read(path)).collect();
        images.into_iter().collect()
    }

    /// Reads many label images in parallel, and keeps `columns x rows` evenly spread pixels of each; the error of
    /// the first failing frame wins.
    pub fn read_thumbnails(
        &self,
        paths: &[PathBuf],
        (columns, rows): (usize, usize),
    ) -> Result<Vec<LabelImage<u16>>> {
        let (width, height) = self.size;
        let place = |index: usize, count: usize, size: usize| (2 * index + 1) * size / (2 * count);
        let thumbnail = |path: &PathBuf| {
            let image = self.read(path)?;
            let pixels = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
            let at = |(u, v)| image.at(place(u, columns, width), place(v, rows, height));
            Ok(LabelImage { width: columns, height: rows, ids: pixels.map(at).collect() })
        };
        let thumbnails: Vec<Result<LabelImage<u16>>> = paths.par_iter().map(thumbnail).collect();
        thumbnails.into_iter().collect()
    }

    /// Reads a single-channel PNG (palette indices as stored), a PNG of the encoding's colours, an H x W `.npy` of
    /// ids, or the most probable classes of an `.npz` of probabilities.
    pub fn read(&self, path: &Path) -> Result<LabelImage<u16>> {
        let (width, height) = self.size;
        let ids = match (extension(path).as_str(), &self.palette) {
            ("png", None) => read_png(path, self.size),
            ("png", Some(palette)) => read_colors(path, self.size, palette),
            ("npy", None) => read_npy(path, self.size),
            ("npz", None) => read_npz(path, self.size),
            (other, palette) => {
                let needed =
                    palette.as_ref().map_or(".png, .npy or .npz", |_| ".png where there is a palette");
                Err(Error::file(path, format!("label image format '{other}' is not known, needs {needed}")))
            }
        }?;
        Ok(LabelImage { width, height, ids })
    }
}

fn check_size(path: &Path, found: (usize, usize), camera: (usize, usize)) -> Result<()> {
    if found == camera {
        return Ok(());
    }
    let reason = format!("is {} x {}, the camera is {} x {}", found.0, found.1, camera.0, camera.1);
    Err(Error::file(path, reason))
}

/// Opens a file that is no larger than one of the camera's images can be.
fn open(path: &Path, (width, height): (usize, usize)) -> Result<OpenFile> {
    let limit = (width as u64 * height as u64).saturating_mul(BYTES_A_PIXEL).saturating_add(MORE_BYTES);
    OpenFile::open(path)?.at_most(limit, &format!(" for {width} x {height} pixels"))
}

fn read_npy(path: &Path, size: (usize, usize)) -> Result<Vec<u16>> {
    read_ids(path, open(path, size)?, |shape| {
        let [height, width] = *shape else {
            return Err(Error::file(path, format!("has shape {shape:?}, needs H x W ids")));
        };
        check_size(path, (width as usize, height as usize), size)
    })
}

fn read_npz(path: &Path, (width, height): (usize, usize)) -> Result<Vec<u16>> {
    let classes = probabilities::read(path, &[height, width])?.classes();
    Ok(classes.into_iter().map(|class| if class == NO_CLASS { NO_ID } else { class.into() }).collect())
}

fn read_png(path: &Path, size: (usize, usize)) -> Result<Vec<u16>> {
    let (info, lines) = decode_png(path, size, Transformations::IDENTITY)?;
    if !matches!(info.color_type, ColorType::Grayscale | ColorType::Indexed) {
        let samples = info.color_type.samples();
        let reason =
            format!("has {samples} channels, needs one of class ids, or a palette: of colours in the drive");
        return Err(Error::file(path, reason));
    }
    let mut ids = Vec::with_capacity(size.0 * size.1);
    for row in lines.chunks_exact(info.line_size) {
        unpack_row(row, info.bit_depth, size.0, &mut ids);
    }
    Ok(ids)
}

fn read_colors(path: &Path, size: (usize, usize), palette: &HashMap<[u8; 3], u16>) -> Result<Vec<u16>> {
    let (info, lines) = decode_png(path, size, Transformations::EXPAND)?;
    let channels = info.color_type.samples();
    if !matches!((info.color_type, info.bit_depth), (ColorType::Rgb | ColorType::Rgba, BitDepth::Eight)) {
        let bits = info.bit_depth as u8;
        let reason = format!("has {channels} channels of {bits} bits, needs 8-bit colours of the palette");
        return Err(Error::file(path, reason));
    }
    let rows = lines.chunks_exact(info.line_size);
    let pixels = rows.flat_map(|row| row.chunks_exact(channels).take(size.0));
    Ok(pixels.map(|pixel| palette.get(&[pixel[0], pixel[1], pixel[2]]).copied().unwrap_or(NO_ID)).collect())
}

/// Decodes the lines of a PNG of the camera's size, after `transformations`.
fn decode_png(
    path: &Path,
    size: (usize, usize),
    transformations: Transformations,
) -> Result<(png::OutputInfo, Vec<u8>)> {
    let invalid = |e: png::DecodingError| Error::file(path, format!("is not a readable PNG: {e}"));
    open(path, size)?.parse(|stream| {
        let mut decoder = png::Decoder::new(stream);
        decoder.set_transformations(transformations);
        let mut reader = decoder.read_info().map_err(invalid)?;
        check_size(path, (reader.info().width as usize, reader.info().height as usize), size)?;
        let num_bytes = reader.output_buffer_size().ok_or_else(|| Error::file(path, "is too large"))?;
        let mut lines = vec![0; num_bytes];
        let info = reader.next_frame(&mut lines).map_err(invalid)?;
        Ok((info, lines))
    })
}

/// Appends the samples of one PNG row, most significant bits first.
fn unpack_row(row: &[u8], depth: BitDepth, width: usize, ids: &mut Vec<u16>) {
    match depth as usize {
        16 => ids.extend(row.as_chunks().0.iter().map(|sample| u16::from_be_bytes(*sample))),
        8 => ids.extend(row.iter().map(|&sample| u16::from(sample))),
        bits => ids.extend((0..width).map(|u| {
            let first = u * bits;
            let shift = 8 - bits - first % 8;
            u16::from(row[first / 8] >> shift) & ((1 << bits) - 1)
        })),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(name: &str, color: ColorType, depth: BitDepth, data: &[u8]) -> PathBuf {
        let path = std::env::temp_dir().join(format!("semcal_{}_{name}.png", std::process::id()));
        let file = std::fs::File::create(&path).expect("a writable temporary folder");
        let mut encoder = png::Encoder::new(file, 3, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == ColorType::Indexed {
            encoder.set_palette([0u8; 12].to_vec());
        }
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(data).expect("the right number of bytes");
        path
    }

    fn ids(path: &Path, palette: Option<&[[u8; 3]]>) -> Result<Vec<u16>> {
        let palette = palette.map(|colors| colors.iter().copied().zip(0..).collect());
        Encoding { size: (3, 2), palette }.read(path).map(|image| image.ids)
    }

    #[test]
    fn ids_are_read_as_stored() {
        let gray = write("gray", ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4, 5, 255]);
        assert_eq!(ids(&gray, None).expect("gray"), [1, 2, 3, 4, 5, 255]);
        let wide =
            write("wide", ColorType::Grayscale, BitDepth::Sixteen, &[1, 0, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6]);
        assert_eq!(ids(&wide, None).expect("16 bit"), [256, 2, 3, 4, 5, 6]);
        let palette = write("palette", ColorType::Indexed, BitDepth::Two, &[0b0001_1000, 0b1110_0100]);
        assert_eq!(ids(&palette, None).expect("palette"), [0, 1, 2, 3, 2, 1]);
    }
}
