//! Mutual information of the classes of points and of the pixels that they project onto.

use crate::classes::NO_CLASS;

/// Weighted counts of the pairs (point class, image class).
#[derive(Clone, Debug, PartialEq)]
pub struct JointHistogram {
    num_image_classes: usize,
    /// Row-major `num_point_classes x num_image_classes`.
    pub weights: Vec<f64>,
}

impl JointHistogram {
    /// An empty histogram.
    pub fn new(num_point_classes: usize, num_image_classes: usize) -> Self {
        Self { num_image_classes, weights: vec![0.0; num_point_classes * num_image_classes] }
    }

    /// Counts a pair; one side without a class carries no information.
    #[inline]
    pub fn add(&mut self, point_class: u8, image_class: u8, weight: f64) {
        if point_class != NO_CLASS && image_class != NO_CLASS {
            let index = self.index(point_class, image_class);
            self.weights[index] += weight;
        }
    }

    /// Adds another histogram of the same classes.
    pub fn merge(&mut self, other: &Self) {
        for (sum, x) in self.weights.iter_mut().zip(&other.weights) {
            *sum += x;
        }
    }

    /// The sum of all weights.
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

    /// Miller and Madow's estimate of how far the plug-in estimate lies above the truth:
    /// `((K_xy - 1) - (K_x - 1) - (K_y - 1)) / 2N` with `K` the occupied cells and `N` the number of pairs.
    pub fn bias(&self) -> f64 {
        let (rows, columns) = self.marginals();
        let occupied = |weights: &[f64]| weights.iter().filter(|&&w| w > 0.0).count() as f64;
        let cells = occupied(&self.weights) - occupied(&rows) - occupied(&columns) + 1.0;
        let total = self.total();
        if total > 0.0 { cells / (2.0 * total) } else { 0.0 }
    }

    /// `log p(x,y) / (p(x) p(y))` of each pair; minus infinity where a pair was never seen.
    pub fn pointwise(&self) -> Vec<f64> {
        self.pointwise_at_least(0.0)
    }

    /// The same, with `floor` for the weight of pairs and of classes that were seen less: finite, for gradients.
    pub fn pointwise_at_least(&self, floor: f64) -> Vec<f64> {
        let (rows, columns) = self.marginals();
        let total = self.total();
        let cell = |(index, &weight): (usize, &f64)| {
            let row = rows[index / self.num_image_classes].max(floor);
            let column = columns[index % self.num_image_classes].max(floor);
            let weight = weight.max(floor);
            if weight > 0.0 { (weight * total / (row * column)).ln() } else { f64::NEG_INFINITY }
        };
        self.weights.iter().enumerate().map(cell).collect()
    }

    /// The weights of a point class.
    #[inline]
    pub fn row_mut(&mut self, point_class: u8) -> &mut [f64] {
        let start = self.index(point_class, 0);
        &mut self.weights[start..start + self.num_image_classes]
    }

    /// Index of a pair in `weights` and [`JointHistogram::pointwise`].
    #[inline]
    pub fn index(&self, point_class: u8, image_class: u8) -> usize {
        usize::from(point_class) * self.num_image_classes + usize::from(image_class)
    }

    fn marginals(&self) -> (Vec<f64>, Vec<f64>) {
        let rows: Vec<f64> =
            self.weights.chunks_exact(self.num_image_classes).map(|row| row.iter().sum()).collect();
        let mut columns = vec![0.0; self.num_image_classes];
        for (index, weight) in self.weights.iter().enumerate() {
            columns[index % self.num_image_classes] += weight;
        }
        (rows, columns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn histogram(weights: [[f64; 2]; 2]) -> JointHistogram {
        JointHistogram { num_image_classes: 2, weights: weights.concat() }
    }

    #[test]
    fn closed_forms() {
        let independent = histogram([[0.06, 0.14], [0.24, 0.56]]);
        assert!(independent.mutual_information().abs() < 1e-15);
        let identical = histogram([[3.0, 0.0], [0.0, 3.0]]);
        assert!((identical.mutual_information() - 2f64.ln()).abs() < 1e-15);
        // A binary symmetric channel of error e carries log 2 - H(e).
        let e: f64 = 0.1;
        let channel = histogram([[1.0 - e, e], [e, 1.0 - e]]);
        let expected = 2f64.ln() + e * e.ln() + (1.0 - e) * (1.0 - e).ln();
        assert!((channel.mutual_information() - expected).abs() < 1e-15);
        assert_eq!(histogram([[0.0; 2]; 2]).mutual_information(), 0.0);
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
