//! The joint histogram of points and blocks together with its slopes: value and gradient in one pass over the points.

use nalgebra::SVector;

use crate::mutual_information::JointHistogram;
use crate::pyramid::Sampled;

/// A joint histogram, and how its weights change with parameters. A cell has its weight first and then a slope for each
/// parameter: the gradient of any sum over the pairs of points and classes is that of the cells, where what a pair adds
/// does not change with the parameters.
pub(super) struct SlopedHistogram<const WIDTH: usize> {
    num_image_classes: usize,
    cells: Vec<[f64; WIDTH]>,
}

/// How the pixel of a point moves with the parameters: a row for each of its coordinates, with nothing first.
pub(super) type Motion<const WIDTH: usize> = [[f64; WIDTH]; 2];

impl<const WIDTH: usize> SlopedHistogram<WIDTH> {
    pub fn new(num_point_classes: usize, num_image_classes: usize) -> Self {
        Self { num_image_classes, cells: vec![[0.0; WIDTH]; num_point_classes * num_image_classes] }
    }

    /// Adds a point of a class whose pixel moves with the parameters.
    #[inline]
    pub fn add(&mut self, class: u8, weight: f64, sampled: &Sampled, motion: impl FnOnce() -> Motion<WIDTH>) {
        let row = &mut self.cells[usize::from(class) * self.num_image_classes..][..self.num_image_classes];
        match sampled {
            Sampled::Uniform(class) => row[usize::from(*class)][0] += weight,
            Sampled::Mixed(shares) if shares.total() > 0.0 => {
                let [of_u, of_v] = motion();
                shares.for_blocks(|shares, [share, to_right, to_down]| {
                    let (share, to_right, to_down) = (weight * share, weight * to_right, weight * to_down);
                    let mut by: [f64; WIDTH] =
                        std::array::from_fn(|i| to_right * of_u[i] + to_down * of_v[i]);
                    by[0] = share;
                    for share in shares {
                        let amount = f64::from(share.amount);
                        let cell = &mut row[usize::from(share.class)];
                        cell.iter_mut().zip(by).for_each(|(sum, x)| *sum += x * amount);
                    }
                });
            }
            Sampled::Mixed(_) => {}
        }
    }

    pub fn merge(&mut self, other: &Self) {
        for (cell, by) in self.cells.iter_mut().zip(&other.cells) {
            cell.iter_mut().zip(by).for_each(|(sum, x)| *sum += x);
        }
    }

    /// The weights alone, with those of other pairs.
    pub fn with(&self, others: &JointHistogram) -> JointHistogram {
        let mut joint = others.clone();
        joint.weights.iter_mut().zip(&self.cells).for_each(|(sum, cell)| *sum += cell[0]);
        joint
    }

    /// The gradient of the sum over all pairs where each adds one of `values`; the first entry is the sum itself.
    pub fn gradient(&self, values: &[f64]) -> SVector<f64, WIDTH> {
        self.gradients(values).sum()
    }

    /// The same for the pairs of each class of points.
    pub fn gradients(&self, values: &[f64]) -> impl Iterator<Item = SVector<f64, WIDTH>> {
        let width = self.num_image_classes;
        self.cells.chunks(width).zip(values.chunks(width)).map(|(cells, values)| {
            let mut sums = [0.0; WIDTH];
            // Where there is no pair at all, values are infinite.
            let occupied = cells.iter().zip(values).filter(|(cell, _)| **cell != [0.0; WIDTH]);
            for (cell, value) in occupied {
                sums.iter_mut().zip(cell).for_each(|(sum, x)| *sum += x * value);
            }
            SVector::from(sums)
        })
    }
}
