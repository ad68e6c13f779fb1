//! What may be estimated beside the pose: intrinsics of the camera, and the offset of its clock.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, DVectorView, Isometry3, Matrix3, Point2, Point3, Vector3, Vector6};
use rayon::prelude::*;

use super::level::{Level, Values};
use super::pose::within_baseline;
use super::preconditioner::MAX_MOTION_POINTS;
use super::sample::{ProjectedSample, Sample};
use super::sloped::Motion;
use crate::camera::{Camera, Intrinsic, IntrinsicSlopes};
use crate::error::Result;
use crate::observation::{Frame, Observations};
use crate::pyramid::Sampled;
use crate::se3;

/// Largest number of variables: no camera has more.
pub const MAX_VARIABLES: usize = 27;
pub(super) const MOST: usize = MAX_VARIABLES + 1;

/// Calls what follows with the number of entries of a cell that holds a weight and a slope for each of `n` variables.
macro_rules! with_width {
    ($n:expr, $width:ident => $call:expr) => {
        match $n + 1 {
            0..=8 => {
                const $width: usize = 8;
                $call
            }
            9..=12 => {
                const $width: usize = 12;
                $call
            }
            13..=16 => {
                const $width: usize = 16;
                $call
            }
            _ => {
                const $width: usize = crate::alignment::variables::MOST;
                $call
            }
        }
    };
}
pub(super) use with_width;

/// The variables of an estimate in their order: the pose's twist, intrinsics, and the offset of the clock.
#[derive(Clone, Debug, Default)]
pub struct Variables {
    /// The intrinsics.
    pub intrinsics: Vec<Intrinsic>,
    /// Twist of the LiDAR in each frame, metres and radians a second in its own frame; with it, the time by which pictures
    /// are later than they were taken to be is a variable, seconds.
    pub twists: Option<Vec<Vector6<f64>>>,
}

/// Values of all variables.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// `T_camera_lidar`.
    pub pose: Isometry3<f64>,
    /// The camera with the intrinsics.
    pub camera: Camera,
    /// Time by which pictures are later than they were taken to be, seconds.
    pub offset_s: f64,
}

impl Variables {
    /// Their number.
    pub fn count(&self) -> usize {
        6 + self.intrinsics.len() + usize::from(self.twists.is_some())
    }

    /// Index of the offset of the clock, if it is a variable.
    fn offset(&self) -> Option<usize> {
        self.twists.is_some().then(|| self.count() - 1)
    }

    /// Intrinsics with their values in a vector of all variables.
    fn intrinsics_in<'a>(&'a self, values: &'a DVector<f64>) -> impl Iterator<Item = (Intrinsic, f64)> + 'a {
        self.intrinsics.iter().copied().zip(values.iter().skip(6).copied())
    }
}

impl Estimate {
    /// The estimate that a change of the variables leads to.
    ///
    /// # Errors
    /// The changed camera is impossible.
    pub fn changed(&self, variables: &Variables, change: &DVector<f64>, max_baseline_m: f64) -> Result<Self> {
        let pose = se3::exp(&twist(change.rows(0, 6))) * self.pose;
        Ok(Self {
            pose: within_baseline(&pose, max_baseline_m),
            camera: self.camera.changed(variables.intrinsics_in(change))?,
            offset_s: self.offset_s + variables.offset().map_or(0.0, |index| change[index]),
        })
    }

    /// Observations with the camera of this estimate, and the points where the LiDAR would have seen them when the
    /// pictures were taken.
    pub fn observed(&self, observations: &Observations, variables: &Variables) -> Arc<Observations> {
        let mut seen = observations.clone();
        seen.camera = self.camera.clone();
        if let (Some(twists), true) = (&variables.twists, self.offset_s != 0.0) {
            let moved = |(frame, twist): (&Frame, &Vector6<f64>)| {
                let motion = later(twist, self.offset_s);
                let point =
                    |point: &[f32; 3]| (motion * Point3::from(*point).cast::<f64>()).cast::<f32>().into();
                let points: Vec<[f32; 3]> = frame.points.iter().map(point).collect();
                Frame { points: Arc::new(points.into()), ..frame.clone() }
            };
            seen.frames = observations.frames.par_iter().zip(twists).map(moved).collect();
        }
        Arc::new(seen)
    }
}

/// Where points of the LiDAR's frame are in its frame some seconds later.
fn later(twist_per_s: &Vector6<f64>, seconds: f64) -> Isometry3<f64> {
    se3::exp(&(twist_per_s * -seconds))
}

fn twist(rows: DVectorView<'_, f64>) -> Vector6<f64> {
    Vector6::from_iterator(rows.iter().copied())
}

/// Projection of points, and its derivatives, near an anchor estimate.
pub(super) struct Neighbourhood<'a> {
    variables: &'a Variables,
    anchor: &'a Estimate,
    slopes: IntrinsicSlopes,
}

/// Projection of points at a change of the variables from the anchor.
pub(super) struct Projection<'a> {
    near: &'a Neighbourhood<'a>,
    camera: Camera,
    /// Change of each intrinsic of [`Intrinsic::Radial`].
    radial: f64,
    /// Rotation and translation to the camera: of each frame, or of all.
    to_camera: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// Velocity and angular velocity of the points of each frame in the camera's frame, a second of the offset.
    drifts: Vec<(Vector3<f64>, Vector3<f64>)>,
}

impl<'a> Neighbourhood<'a> {
    /// # Errors
    /// The lens has not one of the variables.
    pub fn new(variables: &'a Variables, anchor: &'a Estimate) -> Result<Self> {
        let slopes = IntrinsicSlopes::new(&anchor.camera, &variables.intrinsics)?;
        Ok(Self { variables, anchor, slopes })
    }

    /// A change of the variables, shortened where the camera would leave the longest baseline.
    pub fn within_baseline(&self, mut change: DVector<f64>, max_baseline_m: f64) -> DVector<f64> {
        let pose = se3::exp(&twist(change.rows(0, 6))) * self.anchor.pose;
        let within = within_baseline(&pose, max_baseline_m);
        if within != pose {
            change.rows_mut(0, 6).copy_from(&se3::log(&(within * self.anchor.pose.inverse())));
        }
        change
    }

    /// The projection at a change of the variables. Points are those that the anchor observes.
    ///
    /// # Errors
    /// The changed camera is impossible.
    pub fn projection(&'a self, change: &DVector<f64>) -> Result<Projection<'a>> {
        let variables = self.variables;
        let at = self.anchor.changed(variables, change, f64::INFINITY)?;
        let radial = variables.intrinsics_in(change).filter(|(each, _)| *each == Intrinsic::Radial);
        let twists = variables.twists.as_deref().unwrap_or_default();
        let by_s = variables.offset().map_or(0.0, |index| change[index]);
        let rows =
            |pose: Isometry3<f64>| (*pose.rotation.to_rotation_matrix().matrix(), pose.translation.vector);
        let frame = |twist: &Vector6<f64>| rows(at.pose * later(twist, by_s));
        let (rotation, translation) = rows(at.pose);
        let drift = |twist: &Vector6<f64>| {
            let [v, w] = [0, 3].map(|row| -(rotation * twist.fixed_rows::<3>(row)));
            (v - w.cross(&translation), w)
        };
        Ok(Projection {
            near: self,
            camera: at.camera,
            radial: radial.map(|(_, by)| by).sum(),
            to_camera: if twists.is_empty() {
                vec![rows(at.pose)]
            } else {
                twists.iter().map(frame).collect()
            },
            drifts: twists.iter().map(drift).collect(),
        })
    }
}

impl Projection<'_> {
    /// A sample in the camera frame, and its pixel.
    #[inline]
    pub fn place(&self, sample: &Sample) -> Option<(Vector3<f64>, Point2<f64>)> {
        let frame = if self.drifts.is_empty() { 0 } else { sample.frame as usize };
        let (rotation, translation) = &self.to_camera[frame];
        let p_camera = rotation * sample.position + translation;
        let pixel = self.camera.project(&p_camera)?;
        if self.radial == 0.0 {
            return Some((p_camera, pixel));
        }
        let mut shift = nalgebra::Vector2::zeros();
        let radial = |index: usize| self.near.variables.intrinsics[index] == Intrinsic::Radial;
        self.near.slopes.for_each(&self.camera, &p_camera, &pixel, |index, slope| {
            if radial(index) {
                shift += slope * self.radial;
            }
        });
        Some((p_camera, pixel + shift))
    }

    /// How the pixel of a point of a frame moves with the variables, in the entries after the first.
    pub fn motion<const WIDTH: usize>(
        &self,
        frame: u32,
        p_camera: &Vector3<f64>,
        pixel: &Point2<f64>,
    ) -> Motion<WIDTH> {
        let jacobian = self.camera.jacobian(p_camera);
        let mut motion = [[0.0; WIDTH]; 2];
        for (row, of_pixel) in motion.iter_mut().enumerate() {
            let force = jacobian.row(row).transpose();
            of_pixel[1..4].copy_from_slice(force.as_slice());
            of_pixel[4..7].copy_from_slice(p_camera.cross(&force).as_slice());
        }
        self.near.slopes.for_each(&self.camera, p_camera, pixel, |index, slope| {
            motion[0][7 + index] = slope.x;
            motion[1][7 + index] = slope.y;
        });
        if let Some((v, w)) = self.drifts.get(frame as usize) {
            let moved = jacobian * (v + w.cross(p_camera));
            let index = self.near.variables.count();
            motion[0][index] = moved.x;
            motion[1][index] = moved.y;
        }
        motion
    }

    /// Adds the contribution of a point on several classes to the gradient, times the total weight.
    pub fn add_score(
        &self,
        level: &Level,
        projected: &ProjectedSample,
        values: &Values<'_>,
        sum: &mut DVector<f64>,
    ) {
        let ProjectedSample { frame, weight, p_camera, pixel, .. } = projected;
        let Sampled::Mixed(shares) = level.maps[*frame as usize].at(pixel) else { return };
        let per_pixel = values.of(projected, |values| shares.gradient(values)) * f64::from(*weight);
        let motion = self.motion::<MOST>(*frame, p_camera, pixel);
        for (i, sum) in sum.iter_mut().enumerate() {
            *sum += motion[0][1 + i] * per_pixel.x + motion[1][1 + i] * per_pixel.y;
        }
    }

    /// Mean products of the displacements of points by the variables, pixels.
    pub fn mean_motions(&self, samples: &[Sample]) -> DMatrix<f64> {
        with_width!(self.near.variables.count(), WIDTH => self.mean_motions_of::<WIDTH>(samples))
    }

    fn mean_motions_of<const WIDTH: usize>(&self, samples: &[Sample]) -> DMatrix<f64> {
        let (mut sums, mut count) = ([[0.0; WIDTH]; WIDTH], 0.0);
        let step = samples.len().div_ceil(MAX_MOTION_POINTS).max(1);
        for sample in samples.iter().step_by(step) {
            let Some((p_camera, pixel)) = self.place(sample) else { continue };
            let [of_u, of_v] = self.motion::<WIDTH>(sample.frame, &p_camera, &pixel);
            for (i, sums) in sums.iter_mut().enumerate() {
                sums.iter_mut()
                    .enumerate()
                    .for_each(|(j, sum)| *sum += of_u[i] * of_u[j] + of_v[i] * of_v[j]);
            }
            count += 1.0;
        }
        let n = self.near.variables.count();
        DMatrix::from_fn(n, n, |i, j| sums[1 + i][1 + j]) / f64::max(count, 1.0)
    }
}
