//! The columns that a parser finds in a file, and their conversion to a point cloud without no-returns.

use std::borrow::Cow;

use super::PointCloud;
use super::column::{Column, Scalar};
use super::fields::Fields;
use super::limit::ParseResult;
use super::own_points::OwnPoints;

/// Columns of a cloud, over the bytes of its file or bytes unpacked from it.
#[derive(Debug)]
pub(super) struct Table<'a> {
    bytes: Cow<'a, [u8]>,
    num_records: usize,
    pub columns: Fields<Column>,
    pub seconds_per_tick: f64,
    /// What `columns.own` holds at the points that are decoded.
    pub own_points: Option<OwnPoints>,
}

/// One number for each entry of a cloud, no-returns included, such as its class id.
#[derive(Debug)]
pub(super) struct EntryValues<'a> {
    bytes: Cow<'a, [u8]>,
    num_records: usize,
    column: Column,
}

/// The entries of a file that are returns.
pub(super) struct ReturnMask {
    keep: Vec<bool>,
    count: usize,
}

/// Times beyond this are nanoseconds, as Livox' driver writes them to a float64: in seconds it would be 30 million
/// years.
const MAX_TIME_S: f64 = 1e15;

impl<'a> Table<'a> {
    pub(super) fn new(
        bytes: impl Into<Cow<'a, [u8]>>,
        num_records: usize,
        columns: Fields<Column>,
        seconds_per_tick: f64,
    ) -> ParseResult<Self> {
        let bytes = bytes.into();
        columns.iter().try_for_each(|column| column.check(num_records, bytes.len()))?;
        Ok(Self { bytes, num_records, columns, seconds_per_tick, own_points: None })
    }

    pub(super) fn into_owned(self) -> Table<'static> {
        Table { bytes: Cow::Owned(self.bytes.into_owned()), ..self }
    }

    /// Appends the bytes of another column, and returns its new place.
    pub(super) fn join(&mut self, values: &EntryValues<'_>) -> ParseResult<Column> {
        if values.num_records != self.num_records {
            return Err(format!("has {} values for {} points", values.num_records, self.num_records));
        }
        let offset = self.bytes.len() + values.column.offset;
        self.bytes.to_mut().extend_from_slice(&values.bytes);
        Ok(Column { offset, ..values.column })
    }

    pub(super) fn num_records(&self) -> usize {
        self.num_records
    }

    /// The class ids stored in the cloud itself.
    pub(super) fn labels(&self) -> Option<EntryValues<'_>> {
        let (bytes, num_records) = (Cow::Borrowed(&*self.bytes), self.num_records);
        self.columns.label.map(|column| EntryValues { bytes, num_records, column })
    }

    /// Decodes everything but labels, without entries that are not finite, all zero, or of another LiDAR.
    pub(super) fn decode(&self) -> (PointCloud, ReturnMask) {
        let (points, returns) = self.returns();
        let num_no_returns = self.num_records - returns.count;
        let (points, returns) = match self.own_column() {
            Some((own, column)) => returns.narrowed(&points, &self.own_mask(own, column)),
            None => (points, returns),
        };
        let cloud = PointCloud {
            num_no_returns,
            is_kept: returns.keep.clone(),
            intensity: self.columns.intensity.map(|column| floats(&column, &self.bytes, &returns)),
            ring: self.columns.ring.and_then(|column| whole_numbers(&column, &self.bytes, &returns).ok()),
            time: self.columns.time.map(|column| self.seconds(&column, &returns)),
            labels: None,
            label_shares: None,
            points,
        };
        (cloud, returns)
    }

    fn returns(&self) -> (Vec<[f32; 3]>, ReturnMask) {
        let (bytes, n) = (&*self.bytes, self.num_records);
        let [x, y, z] = &self.columns.xyz;
        if self.columns.xyz.iter().all(|c| c.scalar == Scalar::F32 && !c.is_big_endian) {
            let f = |c: &Column| c.values(bytes, n).map(f32::from_le_bytes);
            return select_returns(f(x).zip(f(y)).zip(f(z)).map(|((x, y), z)| [x, y, z]), n);
        }
        let f = |column: &Column| {
            let mut values = Vec::with_capacity(n);
            column.for_each(bytes, n, |value| values.push(value as f32));
            values.into_iter()
        };
        select_returns(f(x).zip(f(y)).zip(f(z)).map(|((x, y), z)| [x, y, z]), n)
    }

    /// Refuses a cloud without a point, as decoded from this table.
    pub(super) fn check_points(&self, cloud: &PointCloud) -> ParseResult<()> {
        if !cloud.points.is_empty() {
            return Ok(());
        }
        match self.own_column() {
            _ if self.num_records == 0 => Err("holds no points".into()),
            Some((own, column)) if cloud.num_no_returns < self.num_records => {
                Err(own.none_among(self.span_of_returns(column), column.scalar))
            }
            _ => Err("holds no returns: every point is zero or not finite".into()),
        }
    }

    /// The smallest and the largest finite value of the returns.
    fn span_of_returns(&self, column: &Column) -> Option<[f64; 2]> {
        let (_, returns) = self.returns();
        let values = returns.gather(column, &self.bytes, |value| value).into_iter();
        let ends = values.filter(|value| value.is_finite()).map(|value| [value, value]);
        ends.reduce(|[smallest, largest], [value, _]| [smallest.min(value), largest.max(value)])
    }

    fn own_column(&self) -> Option<(&OwnPoints, &Column)> {
        self.own_points.as_ref().zip(self.columns.own.as_ref())
    }

    /// Whether each entry is the LiDAR's own.
    fn own_mask(&self, own: &OwnPoints, column: &Column) -> Vec<bool> {
        let [first, last] = own.range_as(column.scalar);
        let mut is_own = Vec::with_capacity(self.num_records);
        column.for_each(&self.bytes, self.num_records, |value| is_own.push(first <= value && value <= last));
        is_own
    }

    fn seconds(&self, column: &Column, returns: &ReturnMask) -> Vec<f64> {
        let seconds = |time: f64| {
            let time_s = time * self.seconds_per_tick;
            if time_s.abs() > MAX_TIME_S { time_s * 1e-9 } else { time_s }
        };
        returns.gather(column, &self.bytes, seconds)
    }
}

impl<'a> EntryValues<'a> {
    pub(super) fn new(
        bytes: impl Into<Cow<'a, [u8]>>,
        num_records: usize,
        column: Column,
    ) -> ParseResult<Self> {
        let bytes = bytes.into();
        column.check(num_records, bytes.len())?;
        Ok(Self { bytes, num_records, column })
    }

    pub(super) fn num_records(&self) -> usize {
        self.num_records
    }

    /// The ids of the returns.
    pub(super) fn ids(&self, returns: &ReturnMask) -> ParseResult<Vec<u16>> {
        whole_numbers(&self.column, &self.bytes, returns)
            .map_err(|value| format!("holds the label {value}, a class id is an integer from 0 to 65535"))
    }
}

impl ReturnMask {
    pub(super) fn keep(&self) -> &[bool] {
        &self.keep
    }

    /// Keeps only returns whose entry is in the mask.
    fn narrowed(self, points: &[[f32; 3]], mask: &[bool]) -> (Vec<[f32; 3]>, Self) {
        let returns = self.keep.iter().zip(mask).filter(|(is_return, _)| **is_return);
        let points = points.iter().zip(returns).filter(|(_, (_, is_kept))| **is_kept);
        let points: Vec<[f32; 3]> = points.map(|(&point, _)| point).collect();
        let keep = self.keep.iter().zip(mask).map(|(&is_return, &is_kept)| is_return & is_kept).collect();
        let count = points.len();
        (points, Self { keep, count })
    }

    /// The values of the returns, from their bytes.
    fn take<const N: usize, T>(&self, column: &Column, bytes: &[u8], decode: impl Fn([u8; N]) -> T) -> Vec<T>
    where
        T: Copy + Default,
    {
        let values = column.values(bytes, self.keep.len()).map(decode);
        compact(values.zip(self.keep.iter().copied()), self.count)
    }

    fn gather<T>(&self, column: &Column, bytes: &[u8], mut convert: impl FnMut(f64) -> T) -> Vec<T> {
        let mut values = Vec::with_capacity(self.count);
        let mut keep = self.keep.iter();
        column.for_each(bytes, self.keep.len(), |value| {
            if keep.next() == Some(&true) {
                values.push(convert(value));
            }
        });
        values
    }
}

fn select_returns(points: impl Iterator<Item = [f32; 3]>, num_records: usize) -> (Vec<[f32; 3]>, ReturnMask) {
    let mut keep = Vec::with_capacity(num_records);
    let pairs = points.map(|point| {
        let is_return = is_return(point);
        keep.push(is_return);
        (point, is_return)
    });
    let kept = compact(pairs, num_records);
    let count = kept.len();
    (kept, ReturnMask { keep, count })
}

fn is_return([x, y, z]: [f32; 3]) -> bool {
    (x.is_finite() & y.is_finite() & z.is_finite()) & ((x != 0.0) | (y != 0.0) | (z != 0.0))
}

/// The kept values, at most `capacity`. Every value is written, and unwanted ones are overwritten, because a branch
/// would be unpredictable.
fn compact<T: Copy + Default>(pairs: impl Iterator<Item = (T, bool)>, capacity: usize) -> Vec<T> {
    let (mut kept, mut count) = (vec![T::default(); capacity], 0);
    for (value, is_kept) in pairs {
        if let Some(slot) = kept.get_mut(count) {
            *slot = value;
        }
        count += usize::from(is_kept);
    }
    kept.truncate(count);
    kept
}

fn floats(column: &Column, bytes: &[u8], returns: &ReturnMask) -> Vec<f32> {
    match (column.scalar, column.is_big_endian) {
        (Scalar::F32, false) => returns.take(column, bytes, f32::from_le_bytes),
        _ => returns.gather(column, bytes, |value| value as f32),
    }
}

/// The values of the returns, or the first that is not an integer from 0 to 65535.
fn whole_numbers(column: &Column, bytes: &[u8], returns: &ReturnMask) -> Result<Vec<u16>, f64> {
    match (column.scalar, column.is_big_endian) {
        (Scalar::U8, _) => return Ok(returns.take(column, bytes, |[byte]| u16::from(byte))),
        (Scalar::U16, false) => return Ok(returns.take(column, bytes, u16::from_le_bytes)),
        _ => {}
    }
    let mut wrong = None;
    let ids = returns.gather(column, bytes, |value| {
        let id = value as u16;
        if f64::from(id) != value {
            wrong.get_or_insert(value);
        }
        id
    });
    wrong.map_or(Ok(ids), Err)
}
