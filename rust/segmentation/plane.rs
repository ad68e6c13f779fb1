//! Surfaces through heights.

use nalgebra::{Matrix3, Vector3};

/// Weight of a level plane beside one point 1 m away: slopes of what is known at one spot only are none.
const LEVEL_WEIGHT: f64 = 1.0;

/// A height above places (x, y).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    height: f64,
    slope: [f64; 2],
    at: [f64; 2],
}

impl Plane {
    pub(super) fn level(height: f64) -> Self {
        Self { height, ..Self::default() }
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.height + self.slope[0] * (x - self.at[0]) + self.slope[1] * (y - self.at[1])
    }
}

/// Least squares over weighted points, with a pull towards a given slope.
pub(super) struct PlaneFit {
    at: [f64; 2],
    prior: [f64; 2],
    matrix: Matrix3<f64>,
    vector: Vector3<f64>,
}

impl PlaneFit {
    /// A plane near a place, with the slope of `prior` where points do not tell.
    pub(super) fn near(at: [f64; 2], prior: &Plane) -> Self {
        let matrix = Matrix3::from_diagonal(&Vector3::new(0.0, LEVEL_WEIGHT, LEVEL_WEIGHT));
        Self { at, prior: prior.slope, matrix, vector: Vector3::zeros() }
    }

    pub(super) fn add(&mut self, point: &Vector3<f64>, weight: f64) {
        let (dx, dy) = (point.x - self.at[0], point.y - self.at[1]);
        let row = Vector3::new(1.0, dx, dy);
        self.matrix += weight * row * row.transpose();
        self.vector += weight * (point.z - self.prior[0] * dx - self.prior[1] * dy) * row;
    }

    /// The plane; none without points.
    pub(super) fn solve(&self) -> Option<Plane> {
        let solution = self.matrix.cholesky()?.solve(&self.vector);
        let slope = [solution[1] + self.prior[0], solution[2] + self.prior[1]];
        solution.iter().all(|x| x.is_finite()).then_some(Plane { height: solution[0], slope, at: self.at })
    }
}
