//! Mutual information of the classes of points and of the pixels that they project to.

use std::ops::Range;

use rayon::prelude::*;

use crate::classes::NO_CLASS;

/// Smallest number of rows in one task.
const ROWS_A_TASK: usize = 2048;

/// Weighted counts of the pairs (row, image class). A row is a class of points, or a segment of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct JointHistogram {
    num_image_classes: usize,
    /// Row of the first weights: a part of the data may cover only some of the rows.
    first_row: usize,
    /// Row-major `num_rows x num_image_classes`.
    pub weights: Vec<f64>,
}

impl JointHistogram {
    pub fn new(num_rows: usize, num_image_classes: usize) -> Self {
        Self::of_rows(0..num_rows, num_image_classes)
    }

    /// An empty histogram of a range of rows.
    pub fn of_rows(rows: Range<usize>, num_image_classes: usize) -> Self {
        Self { num_image_classes, first_row: rows.start, weights: vec![0.0; rows.len() * num_image_classes] }
    }

    /// Counts a pair. A pair without a class on one side carries no information and is ignored.
    pub fn add(&mut self, point_class: u8, image_class: u8, weight: f64) {
        if point_class != NO_CLASS && image_class != NO_CLASS {
            let index = self.index(usize::from(point_class), image_class);
            self.weights[index] += weight;
        }
    }

    pub fn merge(&mut self, other: &Self) {
        let start = (other.first_row - self.first_row) * self.num_image_classes;
        for (sum, x) in self.weights[start..].iter_mut().zip(&other.weights) {
            *sum += x;
        }
    }

    pub fn total(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// `I(X; Y) = sum p(x,y) log p(x,y) / (p(x) p(y))` in nats, the plug-in estimate; zero for an empty histogram.
    pub fn mutual_information(&self) -> f64 {
        let total = self.total();
        if total <= 0.0 {
            return 0.0;
        }
        let pairs = self.weights.iter().zip(self.pointwise());
        pairs.map(|(w, pmi)| if *w > 0.0 { w * pmi } else { 0.0 }).sum::<f64>() / total
    }

    /// Miller and Madow's estimate of the upward bias of the plug-in estimate:
    /// `((K_xy - 1) - (K_x - 1) - (K_y - 1)) / 2N` with `K` the number of occupied cells and `N` the number of
    /// pairs.
    pub fn bias(&self) -> f64 {
        let (rows, columns) = self.marginals();
        let occupied = |weights: &[f64]| weights.iter().filter(|&&w| w > 0.0).count() as f64;
        let cells = occupied(&self.weights) - occupied(&rows) - occupied(&columns) + 1.0;
        let total = self.total();
        if total > 0.0 { cells / (2.0 * total) } else { 0.0 }
    }

    /// `log p(x,y) / (p(x) p(y))` of each pair; minus infinity for pairs that do not occur.
    pub fn pointwise(&self) -> Vec<f64> {
        self.pointwise_at_least(0.0)
    }

    /// Works like [`JointHistogram::pointwise`], with `floor` as the smallest weight of pairs, of classes and of the
    /// total: finite, for gradients, and zero in an empty histogram.
    pub fn pointwise_at_least(&self, floor: f64) -> Vec<f64> {
        let (rows, columns) = self.marginals();
        let total = self.total().max(floor);
        let cell = |(index, &weight): (usize, &f64)| {
            let row = rows[index / self.num_image_classes].max(floor);
            let column = columns[index % self.num_image_classes].max(floor);
            let weight = weight.max(floor);
            if weight > 0.0 { (weight * total / (row * column)).ln() } else { f64::NEG_INFINITY }
        };
        self.weights.iter().enumerate().map(cell).collect()
    }

    /// Returns the pointwise mutual information up to rounding, for two blocks of rows separately, and zero in empty
    /// rows. This is fast where most cells are empty.
    pub fn pointwise_in_blocks(&self, first_of_second: usize, floor: f64) -> Vec<f64> {
        let mut table = vec![0.0; self.weights.len()];
        let place = self.index(first_of_second, 0);
        let (first, second) = table.split_at_mut(place);
        self.pointwise_of_block(&self.weights[..place], floor, first);
        self.pointwise_of_block(&self.weights[place..], floor, second);
        table
    }

    fn pointwise_of_block(&self, weights: &[f64], floor: f64, table: &mut [f64]) {
        let columns = self.columns(weights);
        let total: f64 = columns.iter().sum();
        let of_columns: Vec<f64> = columns.iter().map(|column| total.ln() - column.max(floor).ln()).collect();
        let of_unseen = floor.ln();
        let rows = weights.par_chunks(self.num_image_classes);
        table.par_chunks_mut(self.num_image_classes).zip(rows).with_min_len(ROWS_A_TASK).for_each(
            |(values, row)| {
                let sum: f64 = row.iter().sum();
                if sum > 0.0 {
                    let of_row = sum.max(floor).ln();
                    for ((value, &weight), of_column) in values.iter_mut().zip(row).zip(&of_columns) {
                        let of_cell = if weight > floor { weight.ln() } else { of_unseen };
                        *value = of_cell + of_column - of_row;
                    }
                }
            },
        );
    }

    /// Total weight of each image class over some rows.
    pub fn columns(&self, weights: &[f64]) -> Vec<f64> {
        let mut columns = vec![0.0; self.num_image_classes];
        for row in weights.chunks_exact(self.num_image_classes) {
            columns.iter_mut().zip(row).for_each(|(column, weight)| *column += weight);
        }
        columns
    }

    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        let start = self.index(row, 0);
        &mut self.weights[start..start + self.num_image_classes]
    }

    pub fn rows(&self, rows: Range<usize>) -> &[f64] {
        &self.weights[self.index(rows.start, 0)..self.index(rows.end, 0)]
    }

    /// Index of a pair in `weights` and [`JointHistogram::pointwise`].
    pub fn index(&self, row: usize, image_class: u8) -> usize {
        (row - self.first_row) * self.num_image_classes + usize::from(image_class)
    }

    fn marginals(&self) -> (Vec<f64>, Vec<f64>) {
        let rows: Vec<f64> =
            self.weights.chunks_exact(self.num_image_classes).map(|row| row.iter().sum()).collect();
        (rows, self.columns(&self.weights))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn histogram(weights: [[f64; 2]; 2]) -> JointHistogram {
        JointHistogram { num_image_classes: 2, first_row: 0, weights: weights.concat() }
    }

    #[test]
    fn closed_forms() {
        let independent = histogram([[0.06, 0.14], [0.24, 0.56]]);
        assert!(independent.mutual_information().abs() < 1e-15);
        let identical = histogram([[3.0, 0.0], [0.0, 3.0]]);
        assert!((identical.mutual_information() - 2f64.ln()).abs() < 1e-15);
        // A binary symmetric channel with error e carries log 2 - H(e).
        let e: f64 = 0.1;
        let channel = histogram([[1.0 - e, e], [e, 1.0 - e]]);
        let expected = 2f64.ln() + e * e.ln() + (1.0 - e) * (1.0 - e).ln();
        assert!((channel.mutual_information() - expected).abs() < 1e-15);
        assert_eq!(histogram([[0.0; 2]; 2]).mutual_information(), 0.0);
        assert_eq!(histogram([[0.0; 2]; 2]).pointwise_at_least(0.1), [0.0; 4]);
    }

    #[test]
    fn bias_is_that_of_miller_and_madow() {
        assert_eq!(histogram([[5.0, 5.0], [5.0, 5.0]]).bias(), 1.0 / 40.0);
        assert_eq!(histogram([[5.0, 0.0], [0.0, 5.0]]).bias(), -1.0 / 20.0);
    }

    #[test]
    fn a_side_without_class_is_not_counted() {
        let mut joint = JointHistogram::new(2, 2);
        joint.add(NO_CLASS, 0, 1.0);
        joint.add(1, NO_CLASS, 1.0);
        joint.add(1, 0, 1.0);
        assert_eq!(joint.weights, [0.0, 0.0, 1.0, 0.0]);
    }
}
