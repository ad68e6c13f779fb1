//! The columns of a file that has no header, such as KITTI's `.bin`, and whether its numbers are in them.
//!
//! Numbers of one column are alike, and those of different columns differ. If records are read with a wrong length,
//! each column holds numbers of several, and tells less about them. The mutual information of a number's column and
//! its magnitude is therefore largest at the right length and its multiples, and zero at a length without a common
//! divisor.

use super::column::{Column, NumberKind, Scalar};
use super::fields::{Fields, find};
use super::limit::ParseResult;
use super::own_points::OwnPoints;

/// The columns of a file's records, all of one type.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordLayout {
    names: Vec<String>,
    fields: Fields<usize>,
    scalar: Scalar,
}

/// Largest number of columns that is proposed.
const MAX_COLUMNS: usize = 16;
/// Words of four bytes that are examined, in blocks that are spread over the file, and the fewest for which the
/// information is known to about 0.02 nats.
const SAMPLED_WORDS: usize = 1 << 15;
const BLOCK_WORDS: usize = 1 << 10;
const MIN_WORDS: usize = 512;
/// Information, in nats, by which another number of columns has to exceed the one that is read. On 61 sweeps of KITTI,
/// KITTI-360, DDAD, RELLIS-3D, nuScenes and Livox none comes nearer than 0.33 below; the same with 3, 5, 6, 7 or 9
/// columns, read as 4, exceed it by 0.25 or more (`tests/benchmarks/bin_layouts.py`).
const EXCESS: f64 = 0.1;
/// The same for a multiple of the columns that are read: 0.51 or more for points padded as PCL's. Scanners that fire
/// their beams up and down in turn give even records other heights than odd ones: 0.24 for a VLP-16 (the same script).
const EXCESS_OF_MULTIPLE: f64 = 0.3;
/// Information below which columns are alike, and the fewest words for which chance does not reach it.
const INFORMED: f64 = 0.02;
const MIN_ALIKE_WORDS: usize = 1 << 12;
/// Share of the largest information that the right number of columns has at least: that of its multiples differs by
/// chance.
const ALIKE: f64 = 0.9;
/// Largest share of coordinates outside the limits below.
const MAX_ODD: f64 = 0.05;
/// Magnitudes of coordinates, metres. Outside the first ones are numbers of another type, such as halves of float64;
/// within the second ones are those of a sweep.
const POSSIBLE_M: (f64, f64) = (1e-30, 1e7);
const USUAL_M: (f64, f64) = (1e-6, 1e5);

impl RecordLayout {
    /// A layout of columns with these names; those that no field has are not read.
    ///
    /// # Errors
    /// There is no x, y or z, or no float of this size.
    pub fn new(names: Vec<String>, item_bytes: usize) -> std::result::Result<Self, String> {
        let fields = find(&names.iter().map(String::as_str).collect::<Vec<_>>(), None)?;
        let scalar = Scalar::new(NumberKind::Float, item_bytes);
        let scalar = scalar.ok_or_else(|| format!("has floats of {item_bytes} bytes, needs 4 or 8"))?;
        Ok(Self { names, fields, scalar })
    }

    /// KITTI's x y z intensity, or nuScenes' with ring, float32.
    pub(super) fn usual(has_ring: bool) -> Self {
        let fields = Fields {
            xyz: [0, 1, 2],
            intensity: Some(3),
            ring: has_ring.then_some(4),
            time: None,
            label: None,
            own: None,
        };
        let names = ["x", "y", "z", "intensity", "ring"].iter().take(4 + usize::from(has_ring));
        Self { names: names.map(|&name| name.to_owned()).collect(), fields, scalar: Scalar::F32 }
    }

    /// x y z and columns whose meaning is not known.
    fn of_columns(num_columns: usize, scalar: Scalar) -> Self {
        let names = (0..num_columns).map(|index| ["x", "y", "z"].get(index).unwrap_or(&"_").to_string());
        let fields =
            Fields { xyz: [0, 1, 2], intensity: None, ring: None, time: None, label: None, own: None };
        Self { names: names.collect(), fields, scalar }
    }

    pub(super) fn record_bytes(&self) -> usize {
        self.scalar.size() * self.names.len()
    }

    pub(super) fn columns(&self, own: Option<&OwnPoints>) -> ParseResult<Fields<Column>> {
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let fields = Fields { own: find(&names, own)?.own, ..self.fields };
        let column =
            |index| Column::little_endian(self.scalar.size() * index, self.record_bytes(), self.scalar);
        fields.try_map(|index| Ok(column(index)))
    }

    pub(super) fn scalar_of_time(&self) -> Option<Scalar> {
        self.fields.time.map(|_| self.scalar)
    }

    /// Refuses a file whose numbers are not in these columns, or do not tell how many columns there are.
    ///
    /// What a user has stated is refused only if coordinates have impossible magnitudes, and else taken as it is.
    pub(super) fn check(&self, bytes: &[u8], is_stated: bool) -> ParseResult<()> {
        let Some(words) = Words::sampled(bytes) else { return Ok(()) };
        let is_possible = self.is_plausible(bytes, POSSIBLE_M);
        if is_possible && (is_stated || self.scalar != Scalar::F32) {
            return Ok(());
        }
        if is_possible && !words.exceed(self.names.len()) {
            return if words.are_alike() {
                Err(format!("found {ALIKE_IN_ALL} {self}, {STATE_THEM}"))
            } else {
                Ok(())
            };
        }
        let proposed = proposal(bytes, &words).unwrap_or_else(|| NONE_FITS.into());
        Err(format!("found other columns than {self}, {proposed}"))
    }

    /// The refusal of a file that has no whole number of records.
    pub(super) fn misfit(&self, bytes: &[u8]) -> String {
        let found = format!("{} bytes is not a multiple of {}", bytes.len(), self.record_bytes());
        let proposed = Words::sampled(bytes).and_then(|words| proposal(bytes, &words));
        match proposed {
            Some(proposed) => format!("{found}, the size of {self}, {proposed}"),
            None => found,
        }
    }

    /// Whether coordinates have magnitudes between two limits, zeros and no-returns apart.
    fn is_plausible(&self, bytes: &[u8], (smallest_m, largest_m): (f64, f64)) -> bool {
        let num_records = bytes.len() / self.record_bytes();
        let step = num_records.div_ceil(SAMPLED_WORDS / 4).max(1);
        let column = |axis: usize| {
            let mut values = Vec::new();
            let offset = self.scalar.size() * self.fields.xyz[axis];
            let column = Column::little_endian(offset, step * self.record_bytes(), self.scalar);
            column.for_each(bytes, num_records.div_ceil(step), |value| values.push(value));
            values
        };
        let [x, y, z] = [0, 1, 2].map(column);
        let is_odd = |value: f64| {
            !value.is_finite() || (value != 0.0 && !(smallest_m..=largest_m).contains(&value.abs()))
        };
        let mut num_odd = 0;
        for ((&x, &y), &z) in x.iter().zip(&y).zip(&z) {
            let point = [x, y, z];
            if point.iter().any(|value| value.is_finite()) {
                num_odd += point.into_iter().filter(|&value| is_odd(value)).count();
            }
        }
        num_odd as f64 <= MAX_ODD * 3.0 * x.len() as f64
    }
}

impl std::fmt::Display for RecordLayout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bits = 8 * self.scalar.size();
        write!(f, "{} of float{bits}", self.names.join(","))
    }
}

const NONE_FITS: &str =
    "and none of float32 or float64 alone fit; expected a .npy, .pcd or .ply file, which says what it holds";
const ALIKE_IN_ALL: &str = "numbers that are alike in all columns of";
const STATE_THEM: &str =
    "expected the columns, such as point_columns: [x, y, z] in drive.yaml (--point-columns x,y,z at import)";

/// What to state instead, by the layouts whose columns tell most about their numbers, and hold coordinates.
fn proposal(bytes: &[u8], words: &Words) -> Option<String> {
    let is_whole = |layout: &RecordLayout| bytes.len().is_multiple_of(layout.record_bytes());
    let fits = |layout: &RecordLayout| is_whole(layout) && layout.is_plausible(bytes, USUAL_M);
    let layouts = |scalar: Scalar| {
        let counts = 3..=4 * MAX_COLUMNS / scalar.size();
        counts.map(move |count| RecordLayout::of_columns(count, scalar)).filter(fits).collect::<Vec<_>>()
    };
    let known = |layout: &RecordLayout| words.information(layout.record_bytes() / 4);
    let candidates = [layouts(Scalar::F32), layouts(Scalar::F64)];
    let most = (3..=MAX_COLUMNS).map(|count| words.information(count)).fold(EXCESS, f64::max);
    let first = candidates.iter().filter_map(|of_type| of_type.iter().find(|x| known(x) >= ALIKE * most));
    let stated: Vec<String> = first.map(RecordLayout::statement).collect();
    let has_others = stated.iter().any(|text| text.contains(", _"));
    let meaning = if has_others { ", with intensity, ring, time or label for a _ that holds it" } else { "" };
    (!stated.is_empty()).then(|| format!("expected {}{meaning}", stated.join(", or ")))
}

impl RecordLayout {
    /// How a user states these columns.
    fn statement(&self) -> String {
        let (key, option) = match self.scalar {
            Scalar::F64 => (", point_type: f8", " --point-type f8"),
            _ => ("", ""),
        };
        let names = |separator| self.names.join(separator);
        let options = format!("--point-columns {}{option}", names(","));
        format!("point_columns: [{}]{key} in drive.yaml ({options} at import)", names(", "))
    }
}

/// Words of four bytes from all parts of a file, with their places.
struct Words(Vec<(usize, u32)>);

impl Words {
    /// None of a file with too few.
    fn sampled(bytes: &[u8]) -> Option<Self> {
        let (words, _) = bytes.as_chunks::<4>();
        let num_blocks = words.len().div_ceil(BLOCK_WORDS);
        let step = num_blocks.div_ceil(SAMPLED_WORDS / BLOCK_WORDS).max(1);
        let blocks = words.chunks(BLOCK_WORDS).enumerate().step_by(step);
        let placed = blocks.flat_map(|(block, words)| {
            words.iter().zip(block * BLOCK_WORDS..).map(|(&word, place)| (place, u32::from_le_bytes(word)))
        });
        (words.len() >= MIN_WORDS).then(|| Self(placed.collect()))
    }

    /// Mutual information of a word's column and its sign and exponent, in nats, without its bias by chance (Miller and
    /// Madow).
    fn information(&self, num_columns: usize) -> f64 {
        const NUM_BINS: usize = 1 << 9;
        let mut counts = vec![0u32; num_columns * NUM_BINS];
        for &(place, word) in &self.0 {
            counts[place % num_columns * NUM_BINS + (word >> 23) as usize] += 1;
        }
        let columns: Vec<&[u32]> = counts.chunks_exact(NUM_BINS).collect();
        let of_bin: Vec<u32> =
            (0..NUM_BINS).map(|bin| columns.iter().map(|column| column[bin]).sum()).collect();
        let entropy = |counts: &mut dyn Iterator<Item = u32>| {
            let n = self.0.len() as f64;
            let (mut sum, mut num_occupied) = (0.0, 0.0);
            for count in counts.map(f64::from).filter(|&count| count > 0.0) {
                sum -= count / n * (count / n).ln();
                num_occupied += 1.0;
            }
            sum + (num_occupied - 1.0) / (2.0 * n)
        };
        let of_columns = entropy(&mut columns.iter().map(|column| column.iter().sum()));
        of_columns + entropy(&mut of_bin.into_iter()) - entropy(&mut counts.iter().copied())
    }

    /// Whether no number of columns tells anything about the numbers, of which there are enough to say so. Zeros, NaN and
    /// infinity, as of points without a return, tell nothing.
    fn are_alike(&self) -> bool {
        let is_filled = |word: u32| word != 0 && f32::from_bits(word).is_finite();
        let num_filled = self.0.iter().filter(|&&(_, word)| is_filled(word)).count();
        let informed = INFORMED * num_filled as f64 / self.0.len() as f64;
        self.0.len() >= MIN_ALIKE_WORDS && (2..=MAX_COLUMNS).all(|count| self.information(count) < informed)
    }

    /// Whether another number of columns tells clearly more about the numbers.
    fn exceed(&self, num_columns: usize) -> bool {
        let known = self.information(num_columns);
        (3..=MAX_COLUMNS).filter(|&count| count != num_columns).any(|count| {
            let is_multiple = count.is_multiple_of(num_columns);
            let excess = if is_multiple { EXCESS_OF_MULTIPLE } else { EXCESS };
            self.information(count) > known + excess
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number from 0 to 1, by the generator SplitMix64.
    fn random(index: usize) -> f64 {
        let mut x = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Points on a street, with further columns.
    fn records(num_columns: usize) -> Vec<f64> {
        let value = |index: usize| match (index % num_columns, random(index)) {
            (0, share) => 80.0 * (share - 0.5),
            (1, share) => 40.0 * (share - 0.5),
            (2, share) => 3.0 * share - 2.0,
            (_, share) => share,
        };
        (0..2000 * num_columns).map(value).collect()
    }

    fn float32(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect()
    }

    fn float64(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn other_columns_are_refused_with_those_that_fit() {
        let usual = RecordLayout::usual(false);
        assert_eq!(usual.check(&float32(&records(4)), false), Ok(()));
        assert_eq!(RecordLayout::usual(true).check(&float32(&records(5)), false), Ok(()));
        for (bytes, fitting) in [
            (float32(&records(3)), "--point-columns x,y,z at import"),
            (float32(&records(5)), "--point-columns x,y,z,_,_ at import"),
            (float32(&records(6)), "--point-columns x,y,z,_,_,_ at import"),
            (float32(&records(8)), "--point-columns x,y,z,_,_,_,_,_ at import"),
            (float64(&records(4)), "--point-columns x,y,z,_ --point-type f8 at import"),
            (float64(&records(3)), "--point-columns x,y,z --point-type f8 at import"),
        ] {
            let refusal = usual.check(&bytes, false).expect_err(fitting);
            assert!(refusal.starts_with("found other columns than x,y,z,intensity of float32, expected "));
            assert!(refusal.contains(fitting), "{refusal}");
        }
        let odd = usual.misfit(&float32(&records(5))[..39_980]);
        assert!(odd.starts_with("39980 bytes is not a multiple of 16, the size of x,y,z,intensity"), "{odd}");
        assert!(odd.contains("x,y,z,_,_ at import"), "{odd}");
        // A sweep of four columns that is cut off does not become one of six.
        assert_eq!(usual.misfit(&float32(&records(4))[..31_992]), "31992 bytes is not a multiple of 16");
    }

    #[test]
    fn numbers_without_columns_are_refused() {
        let alike: Vec<f64> = (0..6000).map(|index| random(index) - 0.5).collect();
        let refusal = RecordLayout::usual(false).check(&float32(&alike), false).expect_err("alike");
        assert!(
            refusal
                .starts_with("found numbers that are alike in all columns of x,y,z,intensity of float32, ")
        );
    }

    #[test]
    fn a_statement_is_refused_only_for_impossible_numbers() {
        let six = float32(&records(6));
        assert_eq!(RecordLayout::usual(false).check(&six, true), Ok(()));
        let as_float64 = RecordLayout::of_columns(3, Scalar::F64);
        let refusal = as_float64.check(&six, true).expect_err("float32");
        assert!(refusal.contains("than x,y,z of float64, expected point_columns: [x, y, z, _"), "{refusal}");
    }
}
