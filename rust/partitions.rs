//! Partitions of a sweep's points: into its segments, and null ones that know nothing of the picture.
//!
//! The mutual information of segments and picture classes grows where the picture is rich, whatever the pose, and so has
//! no maximum at the true one. A null partition has the same pieces in another place, as if the sweep had been turned
//! (a spin test: Alexander-Bloch et al., NeuroImage 2018); what it tells of the picture is what any partition of that
//! kind would. See `alignment/adjusted.rs` for the score.

use crate::error::{Error, Result};

/// The segment of each point in each partition, as rows of a joint histogram.
#[derive(Clone, Debug)]
pub struct Partitions {
    /// Point by point: the row of its segment, and that of its segment in each null partition.
    rows: Vec<u16>,
    num_partitions: usize,
    /// Rows of the segments; those of null partitions follow.
    pub num_segments: usize,
    /// Rows of all partitions.
    pub num_rows: usize,
}

impl Partitions {
    /// Takes `num_partitions` segments for each point, the first of which is its own, of `num_segments` in each
    /// partition.
    ///
    /// # Errors
    /// There is no null partition, there are too many segments, or the number of ids is not a multiple of that of
    /// partitions.
    pub fn new(ids: &[u32], num_segments: usize, num_partitions: usize) -> Result<Self> {
        let num_rows = num_segments * num_partitions;
        if num_partitions < 2 || !ids.len().is_multiple_of(num_partitions) {
            let found = format!("found {} ids of {num_partitions} partitions", ids.len());
            return Err(Error::Input(format!("{found}, needed a null partition and all ids of each point")));
        }
        if num_rows > usize::from(u16::MAX) {
            let most = usize::from(u16::MAX) / num_partitions;
            return Err(Error::Input(format!(
                "found {num_segments} segments in a sweep, needed at most {most}"
            )));
        }
        let row = |(index, &id): (usize, &u32)| (index % num_partitions * num_segments) as u16 + id as u16;
        Ok(Self { rows: ids.iter().enumerate().map(row).collect(), num_partitions, num_segments, num_rows })
    }

    /// Number of points.
    pub fn num_points(&self) -> usize {
        self.rows.len() / self.num_partitions
    }

    /// Number of partitions, with that into segments.
    pub fn num_partitions(&self) -> usize {
        self.num_partitions
    }

    /// The rows of a point, one for each partition.
    #[inline]
    pub fn rows(&self, point: usize) -> &[u16] {
        &self.rows[point * self.num_partitions..][..self.num_partitions]
    }

    /// Those of some of the points, with rows for their segments only. A sweep without segments has none.
    pub fn of_points(&self, points: &[usize]) -> Self {
        let mut rows: Vec<u16> = points.iter().flat_map(|&point| self.rows(point)).copied().collect();
        let mut numbers = vec![None; self.num_rows];
        for &row in &rows {
            if let Some(number) = numbers.get_mut(usize::from(row)) {
                *number = Some(0);
            }
        }
        let (mut num_rows, mut num_segments) = (0, 0);
        for (row, number) in numbers.iter_mut().enumerate() {
            if let Some(number) = number {
                *number = num_rows as u16;
                num_rows += 1;
                num_segments += usize::from(row < self.num_segments);
            }
        }
        for row in &mut rows {
            *row = numbers.get(usize::from(*row)).copied().flatten().unwrap_or(0);
        }
        Self { rows, num_partitions: self.num_partitions, num_segments, num_rows }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_points_keep_their_segments_under_new_numbers() {
        let all = Partitions::new(&[0, 2, 3, 1, 2, 2, 0, 1], 4, 2).expect("two ids for each point");
        assert_eq!((all.num_points(), all.num_rows, all.rows(1)), (4, 8, &[3, 5][..]));
        let some = all.of_points(&[1, 3]);
        assert_eq!((some.num_segments, some.num_rows), (2, 3));
        assert_eq!((some.rows(0), some.rows(1)), (&[1, 2][..], &[0, 2][..]));
    }

    #[test]
    fn a_sweep_without_segments_has_no_rows() {
        let all = Partitions::new(&[0, 0, 0, 0], 0, 2).expect("two ids for each point");
        assert_eq!((all.num_points(), all.num_rows), (2, 0));
        let some = all.of_points(&[1]);
        assert_eq!((some.num_points(), some.num_rows, some.num_segments), (1, 0, 0));
    }
}
