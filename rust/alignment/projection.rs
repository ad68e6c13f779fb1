//! Projection of points to pixels, at a pose or near an estimate with variable intrinsics and time offset, and its
//! derivatives.

use geometry::camera::{Camera, Intrinsic, IntrinsicSlopes};
use geometry::se3;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point2, Vector3, Vector6};

use super::sample::Sample;
use super::variables::{Estimate, Variables, motion_over, moved, within_baseline};
use crate::error::Result;

/// Number of points that suffice to measure how the variables move the image.
const MAX_MOTION_POINTS: usize = 5000;

/// Calls the given function with the length of an array that has room for a slope for each of `n` variables.
macro_rules! with_width {
    ($n:expr, $width:ident => $call:expr) => {
        match $n {
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
                const $width: usize = crate::alignment::variables::MAX_VARIABLES;
                $call
            }
        }
    };
}
pub(super) use with_width;

/// Derivatives of a point's pixel with respect to the variables: a row for each coordinate.
pub(super) type Motion<const WIDTH: usize> = [[f64; WIDTH]; 2];

/// Rotation and translation from the LiDAR frame to the camera frame.
type ToCamera = (Matrix3<f64>, Vector3<f64>);

fn to_camera(pose: &Isometry3<f64>) -> ToCamera {
    (*pose.rotation.to_rotation_matrix().matrix(), pose.translation.vector)
}

/// Projections of points near an anchor estimate.
pub(super) struct Neighbourhood<'a> {
    variables: &'a Variables,
    anchor: &'a Estimate,
    slopes: IntrinsicSlopes,
}

/// Projection of points (LiDAR frame) at given values of the variables.
#[derive(Clone, Debug)]
pub(super) struct Projection<'a> {
    camera: Camera,
    num_variables: usize,
    /// Derivatives of pixels with respect to the variable intrinsics.
    slopes: Option<&'a IntrinsicSlopes>,
    /// Change of [`Intrinsic::Radial`].
    radial: f64,
    /// Transforms to the camera frame: one for each frame, or one for all.
    to_camera: Vec<ToCamera>,
    /// Velocity and angular velocity of each frame's points in the camera frame, per second of the offset.
    drifts: Vec<(Vector3<f64>, Vector3<f64>)>,
}

impl<'a> Neighbourhood<'a> {
    pub fn new(variables: &'a Variables, anchor: &'a Estimate) -> Result<Self> {
        let slopes = IntrinsicSlopes::new(&anchor.camera, &variables.intrinsics)?;
        Ok(Self { variables, anchor, slopes })
    }

    /// Adds a step to a change of the variables: a twist on the left of the pose, shortened where the camera would
    /// exceed the maximum baseline, and changes of the others.
    pub fn stepped(&self, change: &DVector<f64>, step: &DVector<f64>, max_baseline_m: f64) -> DVector<f64> {
        let pose = within_baseline(&moved(&moved(&self.anchor.pose, change), step), max_baseline_m);
        let mut next = change + step;
        next.rows_mut(0, 6).copy_from(&se3::log(&(pose * self.anchor.pose.inverse())));
        next
    }

    /// The projection at a change of the variables, of the points that the anchor observes.
    pub fn projection(&'a self, change: &DVector<f64>) -> Result<Projection<'a>> {
        let variables = self.variables;
        let at = self.anchor.changed(variables, change, f64::INFINITY)?;
        let radial = variables.intrinsics_in(change).filter(|(intrinsic, _)| *intrinsic == Intrinsic::Radial);
        let twists = variables.twists.as_deref().unwrap_or_default();
        let by_s = variables.offset().map_or(0.0, |index| change[index]);
        let of_frame = |twist: &Vector6<f64>| to_camera(&(at.pose * motion_over(twist, by_s)));
        let (rotation, translation) = to_camera(&at.pose);
        let drift = |twist: &Vector6<f64>| {
            let [v, w] = [0, 3].map(|row| -(rotation * twist.fixed_rows::<3>(row)));
            (v - w.cross(&translation), w)
        };
        Ok(Projection {
            num_variables: variables.count(),
            slopes: Some(&self.slopes),
            radial: radial.map(|(_, by)| by).sum(),
            to_camera: match twists {
                [] => vec![(rotation, translation)],
                twists => twists.iter().map(of_frame).collect(),
            },
            drifts: twists.iter().map(drift).collect(),
            camera: at.camera,
        })
    }
}

impl Projection<'static> {
    /// The projection of a camera at a pose, the only variable.
    pub fn of_pose(camera: &Camera, pose: &Isometry3<f64>) -> Self {
        let (to_camera, drifts) = (vec![to_camera(pose)], Vec::new());
        Self { camera: camera.clone(), num_variables: 6, slopes: None, radial: 0.0, to_camera, drifts }
    }
}

impl Projection<'_> {
    /// Number of variables in [`Projection::motion`].
    pub fn num_variables(&self) -> usize {
        self.num_variables
    }

    /// A sample in the camera frame, and its pixel.
    #[inline(always)]
    pub fn place(&self, sample: &Sample) -> Option<(Vector3<f64>, Point2<f64>)> {
        self.place_of(&sample.position, sample.frame)
    }

    /// Projects a point of a frame (metres, LiDAR frame): its position in the camera frame, and its pixel.
    #[inline(always)]
    pub fn place_of(&self, position: &Vector3<f64>, frame: u32) -> Option<(Vector3<f64>, Point2<f64>)> {
        let frame = if self.drifts.is_empty() { 0 } else { frame as usize };
        let (rotation, translation) = &self.to_camera[frame];
        let p_camera = rotation * position + translation;
        let pixel = self.camera.project(&p_camera)?;
        if self.radial == 0.0 {
            return Some((p_camera, pixel));
        }
        Some((p_camera, pixel + self.camera.radial_slope(&pixel) * self.radial))
    }

    /// Derivatives of a point's pixel with respect to the twist on the left of the pose, the intrinsics and the
    /// time offset.
    #[inline(always)]
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
            of_pixel[..3].copy_from_slice(force.as_slice());
            of_pixel[3..6].copy_from_slice(p_camera.cross(&force).as_slice());
        }
        if let Some(slopes) = self.slopes {
            slopes.for_each(&self.camera, p_camera, pixel, |index, slope| {
                motion[0][6 + index] = slope.x;
                motion[1][6 + index] = slope.y;
            });
        }
        if let Some((v, w)) = self.drifts.get(frame as usize) {
            let moved = jacobian * (v + w.cross(p_camera));
            motion[0][self.num_variables - 1] = moved.x;
            motion[1][self.num_variables - 1] = moved.y;
        }
        motion
    }

    /// Mean outer products of the points' displacements by the variables, pixels.
    pub fn mean_motions(&self, samples: &[Sample]) -> DMatrix<f64> {
        with_width!(self.num_variables, WIDTH => self.mean_motions_of::<WIDTH>(samples))
    }

    fn mean_motions_of<const WIDTH: usize>(&self, samples: &[Sample]) -> DMatrix<f64> {
        let (mut sums, mut count) = ([[0.0; WIDTH]; WIDTH], 0.0);
        for sample in some(samples) {
            let Some((p_camera, pixel)) = self.place(sample) else { continue };
            let [of_u, of_v] = self.motion::<WIDTH>(sample.frame, &p_camera, &pixel);
            for (i, sums) in sums.iter_mut().enumerate() {
                sums.iter_mut()
                    .enumerate()
                    .for_each(|(j, sum)| *sum += of_u[i] * of_u[j] + of_v[i] * of_v[j]);
            }
            count += 1.0;
        }
        let n = self.num_variables;
        DMatrix::from_fn(n, n, |i, j| sums[i][j]) / f64::max(count, 1.0)
    }

    /// Ranges of a representative number of points from the camera, metres.
    pub fn ranges(&self, samples: &[Sample]) -> Vec<f64> {
        some(samples).filter_map(|sample| self.place(sample)).map(|(p_camera, _)| p_camera.norm()).collect()
    }
}

/// A representative number of the samples.
fn some(samples: &[Sample]) -> impl Iterator<Item = &Sample> {
    samples.iter().step_by(samples.len().div_ceil(MAX_MOTION_POINTS).max(1))
}
