//! Label images: one class id a pixel.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Transformations};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::file::{extension, read_bytes};
use crate::npy::{self, class_ids};
use crate::observation::NO_CLASS;
use crate::probabilities;

/// A row-major image of ids: raw (`u16`) as read, dense (`u8`) in the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelImage<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` ids.
    pub ids: Vec<T>,
}

impl<T: Copy> LabelImage<T> {
    /// The id of a pixel that lies in the picture.
    #[inline]
    pub fn at(&self, u: usize, v: usize) -> T {
        self.ids[v * self.width + u]
    }
}

/// Reads many label images of one size, in parallel; the first failing frame's error wins.
///
/// # Errors
/// As [`read`].
pub fn read_all(paths: &[PathBuf], size: (usize, usize)) -> Result<Vec<LabelImage<u16>>> {
    let images: Vec<Result<LabelImage<u16>>> = paths.par_iter().map(|p| read(p, size)).collect();
    images.into_iter().collect()
}

/// Reads many label images of one size, in parallel, and keeps of each `columns x rows` pixels, evenly spread; the first
/// failing frame's error wins.
///
/// # Errors
/// As [`read`].
pub fn read_thumbnails(
    paths: &[PathBuf],
    size: (usize, usize),
    (columns, rows): (usize, usize),
) -> Result<Vec<LabelImage<u16>>> {
    let place = |index: usize, count: usize, size: usize| (2 * index + 1) * size / (2 * count);
    let thumbnail = |path: &PathBuf| {
        let image = read(path, size)?;
        let pixels = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let ids = pixels.map(|(u, v)| image.at(place(u, columns, size.0), place(v, rows, size.1))).collect();
        Ok(LabelImage { width: columns, height: rows, ids })
    };
    let thumbnails: Vec<Result<LabelImage<u16>>> = paths.par_iter().map(thumbnail).collect();
    thumbnails.into_iter().collect()
}

/// Reads a single-channel PNG (palette indices as stored), an H x W `.npy` of ids, or the likeliest classes of an `.npz` of
/// probabilities.
///
/// # Errors
/// The file cannot be read, has more than one channel, or is not of the camera's `(width, height)`.
pub fn read(path: &Path, size: (usize, usize)) -> Result<LabelImage<u16>> {
    let ids = match extension(path).as_str() {
        "npy" => read_npy(path, size),
        "npz" => read_npz(path, size),
        "png" => read_png(path, size),
        other => {
            let reason = format!("label image format '{other}' is not known, needs .png, .npy or .npz");
            Err(Error::file(path, reason))
        }
    }?;
    let (width, height) = size;
    Ok(LabelImage { width, height, ids })
}

fn check_size(path: &Path, found: (usize, usize), camera: (usize, usize)) -> Result<()> {
    if found == camera {
        return Ok(());
    }
    let reason = format!("is {} x {}, the camera is {} x {}", found.0, found.1, camera.0, camera.1);
    Err(Error::file(path, reason))
}

fn read_npy(path: &Path, size: (usize, usize)) -> Result<Vec<u16>> {
    let array = npy::read(path)?;
    let [height, width] = array.shape[..] else {
        return Err(Error::file(path, format!("has shape {:?}, needs H x W ids", array.shape)));
    };
    check_size(path, (width, height), size)?;
    class_ids(path, &array.values)
}

fn read_npz(path: &Path, (width, height): (usize, usize)) -> Result<Vec<u16>> {
    let classes = probabilities::read(path, &[height, width])?.classes();
    Ok(classes.into_iter().map(|class| if class == NO_CLASS { u16::MAX } else { class.into() }).collect())
}

fn read_png(path: &Path, size: (usize, usize)) -> Result<Vec<u16>> {
    let invalid = |e: png::DecodingError| Error::file(path, format!("is no readable PNG: {e}"));
    let mut decoder = png::Decoder::new(Cursor::new(read_bytes(path)?));
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(invalid)?;
    let info = reader.info();
    let width = info.width as usize;
    let (color, depth) = (info.color_type, info.bit_depth);
    if !matches!(color, ColorType::Grayscale | ColorType::Indexed) {
        let reason = format!("has {} channels, needs one channel of class ids", color.samples());
        return Err(Error::file(path, reason));
    }
    check_size(path, (width, reader.info().height as usize), size)?;
    let num_bytes = reader.output_buffer_size().ok_or_else(|| Error::file(path, "is too large"))?;
    let mut bytes = vec![0; num_bytes];
    reader.next_frame(&mut bytes).map_err(invalid)?;
    let stride = reader.output_line_size(width as u32).ok_or_else(|| Error::file(path, "is too large"))?;
    Ok(bytes.chunks_exact(stride).flat_map(|row| unpack_row(row, depth, width)).collect())
}

/// The samples of one PNG row, most significant bits first.
fn unpack_row(row: &[u8], depth: BitDepth, width: usize) -> impl Iterator<Item = u16> + '_ {
    let bits = depth as usize;
    (0..width).map(move |u| match bits {
        16 => u16::from_be_bytes([row[2 * u], row[2 * u + 1]]),
        8 => u16::from(row[u]),
        _ => {
            let first = u * bits;
            let shift = 8 - bits - first % 8;
            u16::from(row[first / 8] >> shift) & ((1 << bits) - 1)
        }
    })
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

    #[test]
    fn ids_are_read_as_stored() {
        let gray = write("gray", ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4, 5, 255]);
        assert_eq!(read(&gray, (3, 2)).expect("gray").ids, [1, 2, 3, 4, 5, 255]);
        let wide =
            write("wide", ColorType::Grayscale, BitDepth::Sixteen, &[1, 0, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6]);
        assert_eq!(read(&wide, (3, 2)).expect("16 bit").ids, [256, 2, 3, 4, 5, 6]);
        let palette = write("palette", ColorType::Indexed, BitDepth::Two, &[0b0001_1000, 0b1110_0100]);
        assert_eq!(read(&palette, (3, 2)).expect("palette").ids, [0, 1, 2, 3, 2, 1]);
    }

    #[test]
    fn colours_and_wrong_sizes_are_refused() {
        let rgb = write("rgb", ColorType::Rgb, BitDepth::Eight, &[0; 18]);
        let message = read(&rgb, (3, 2)).expect_err("three channels").to_string();
        assert!(message.ends_with("has 3 channels, needs one channel of class ids"));
        let gray = write("small", ColorType::Grayscale, BitDepth::Eight, &[0; 6]);
        let message = read(&gray, (4, 2)).expect_err("wrong size").to_string();
        assert!(message.ends_with("is 3 x 2, the camera is 4 x 2"), "{message}");
    }
}
