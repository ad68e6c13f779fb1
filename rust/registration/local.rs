//! Powell's method around a placement, with the returns themselves on finer cells of the label images.

use std::f64::consts::PI;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::config::RegistrationConfig;
use super::downsampled::{Downsampled, downsampled};
use super::hypothesis::Hypothesis;
use crate::camera::RUN;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::point_cloud::to_f64;
use crate::powell::{PowellConfig, minimize};
use crate::spherical::{LabelledReturn, SphericalImages, from_angles};
use crate::thinning::{stride, thinned};
use crate::zoom::{Placement, Zoom, Zoomed};

/// Half-width of Powell's first bracket for the scale of the zoomed image.
const SCALE_STEP: f64 = 0.1;
/// Line searches end within this share of their bracket; a finer end has no meaning on cells of this size.
const TOLERANCE: f64 = 0.02;
const MAX_ROUNDS: usize = 8;
/// Returns are thinned to at most this number, over all frames and directions: more make the histogram no better.
const MAX_RETURNS: usize = 20_000;

/// The unit direction (LiDAR frame) and the class of a return.
type LabelledDirection = (Vector3<f64>, u8);

/// The compared data: the labelled returns of the spherical images, and label images in cells.
pub(super) struct Compared<'a> {
    observations: &'a Observations,
    zoomed: &'a Zoomed<'a>,
    images: Downsampled,
    /// Unit direction and class of each return, frame after frame.
    returns: Vec<Vec<LabelledDirection>>,
}

impl<'a> Compared<'a> {
    pub fn new(
        observations: &'a Observations,
        zoomed: &'a Zoomed,
        images: &SphericalImages,
        cell: f64,
    ) -> Self {
        let stride = stride(images.num_returns(), MAX_RETURNS);
        let directed = |(point, class): LabelledReturn| (to_f64(&point).normalize(), class);
        let thin = |returns: &Vec<LabelledReturn>| {
            thinned(returns.len(), stride).map(|i| directed(returns[i])).collect()
        };
        let returns = images.returns.par_iter().map(thin).collect();
        Self { observations, zoomed, images: downsampled(observations, zoomed, cell), returns }
    }

    /// The returns of each frame that a picture placed within `reach` of `placement` may show.
    fn near(&self, placement: &Placement, reach: f64) -> Vec<Vec<LabelledDirection>> {
        let half_angle = self.zoomed.reach() + reach;
        let axis = from_angles(placement.azimuth, placement.elevation);
        let least = half_angle.min(PI).cos();
        let shown = |r: &&LabelledDirection| r.0.dot(&axis) >= least;
        self.returns.iter().map(|r| r.iter().filter(shown).copied().collect()).collect()
    }

    fn joint(&self, placement: &Placement, returns: &[Vec<LabelledDirection>]) -> JointHistogram {
        let pixel_of = self.zoomed.pixel_map(placement);
        let Observations { num_point_classes, num_image_classes, .. } = *self.observations;
        let mut joint = JointHistogram::new(num_point_classes, num_image_classes);
        let mut pixels = Vec::with_capacity(RUN);
        for (frame, returns) in returns.iter().enumerate() {
            for run in returns.chunks(RUN) {
                pixels.clear();
                pixels.extend(run.iter().map(|(direction, _)| pixel_of(direction)));
                for ((_, class), pixel) in run.iter().zip(&pixels) {
                    if let Some(pixel) = pixel {
                        joint.add(*class, self.images.class(frame, pixel), 1.0);
                    }
                }
            }
        }
        joint
    }

    /// Powell's method from one placement: three angles, and the scale of the paper's zoomed picture.
    /// Line searches reach `reach` to either side.
    pub fn refine(&self, start: &Placement, reach: f64, config: &RegistrationConfig) -> Hypothesis {
        let returns = self.near(start, 2.0 * reach);
        let least = config.min_cells_of_most * self.joint(start, &returns).total();
        let objective = |placement: &Placement| {
            let joint = self.joint(placement, &returns);
            if joint.total() < least { f64::INFINITY } else { joint.bias() - joint.mutual_information() }
        };
        let [a, e, r] = [start.azimuth, start.elevation, start.roll];
        let place = |x: &[f64; 4]| Placement { azimuth: x[0], elevation: x[1], roll: x[2], scale: x[3] };
        let placement = match config.zoom {
            Zoom::Exact => {
                let powell = powell([reach, reach, config.roll_step]);
                let angles = |x: &[f64; 3]| place(&[x[0], x[1], x[2], 1.0]);
                angles(&minimize(|x| objective(&angles(x)), [a, e, r], &powell).x)
            }
            Zoom::Paper => {
                let powell = powell([reach, reach, config.roll_step, SCALE_STEP]);
                place(&minimize(|x| objective(&place(x)), [a, e, r, start.scale], &powell).x)
            }
        };
        let joint = self.joint(&placement, &returns);
        let mutual_information = joint.mutual_information() - joint.bias();
        Hypothesis { placement, mutual_information, num_pairs: joint.total(), joint }
    }
}

fn powell<const N: usize>(step: [f64; N]) -> PowellConfig<N> {
    PowellConfig { step, tolerance: TOLERANCE, max_rounds: MAX_ROUNDS }
}
