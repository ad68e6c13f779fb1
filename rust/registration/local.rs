//! Powell's method around a placement, on the returns themselves and finer cells of the label images.

use std::f64::consts::PI;

use geometry::angles::from_angles;
use geometry::camera::RUN;
use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

use super::{Hypothesis, RegistrationConfig};
use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::point_cloud::to_f64;
use crate::powell::{PowellConfig, minimize};
use crate::spherical::{LabelledReturn, SphericalImages};
use crate::thinning::{stride, thinned};
use crate::zoom::{Placement, Zoom, ZoomedImage};

pub(super) struct DownsampledImages {
    blocks_per_pixel: f64,
    images: Vec<LabelImage<u8>>,
}

impl DownsampledImages {
    pub fn class(&self, frame: usize, pixel: &Point2<f64>) -> u8 {
        let image = &self.images[frame];
        // A product is faster than a division, but may land one block beyond the border.
        let block = |x: f64, count: usize| (((x + 0.5) * self.blocks_per_pixel) as usize).min(count - 1);
        image.at(block(pixel.x, image.width), block(pixel.y, image.height))
    }
}

/// Downsamples the label images to blocks about as wide as a cell at the middle of the image.
pub(super) fn downsampled(observations: &Observations, zoomed: &ZoomedImage, cell: f64) -> DownsampledImages {
    let pixels_per_radian = observations.camera.width as f64 / zoomed.horizontal_fov();
    let factor = ((pixels_per_radian * cell).round() as usize).max(1);
    let images = observations.frames.par_iter().map(|f| majority(&f.image.classes, factor)).collect();
    DownsampledImages { blocks_per_pixel: 1.0 / factor as f64, images }
}

/// A label image in blocks of `factor` pixels, each with the majority class of its pixels (ties go to the lowest
/// class). Blocks cut by the border count the pixels that they have.
pub fn majority(image: &LabelImage<u8>, factor: usize) -> LabelImage<u8> {
    let (width, height) = (image.width.div_ceil(factor), image.height.div_ceil(factor));
    let mut ids = Vec::with_capacity(width * height);
    let mut counts = vec![[0u32; 256]; width];
    for row in 0..height {
        counts.fill([0; 256]);
        for v in row * factor..((row + 1) * factor).min(image.height) {
            let line = &image.ids[v * image.width..(v + 1) * image.width];
            for (counts, ids) in counts.iter_mut().zip(line.chunks(factor)) {
                ids.iter().for_each(|&id| counts[usize::from(id)] += 1);
            }
        }
        ids.extend(
            counts
                .iter()
                .map(|c| (0..=NO_CLASS).rev().max_by_key(|&id| c[usize::from(id)]).unwrap_or(NO_CLASS)),
        );
    }
    LabelImage { width, height, ids }
}

/// Half-width of Powell's first bracket for the scale of the zoomed image.
const SCALE_STEP: f64 = 0.1;
/// Relative tolerance of the line searches: a finer one is meaningless on cells of this size.
const TOLERANCE: f64 = 0.02;
const MAX_ROUNDS: usize = 8;
/// Returns are thinned to at most this many, over all frames and directions: more do not improve the histogram.
const MAX_RETURNS: usize = 20_000;

/// Unit direction (LiDAR frame) and class of a return.
type LabelledDirection = (Vector3<f64>, u8);

/// The compared data: the labelled returns of the spherical images, and label images in cells.
pub(super) struct LocalSearch<'a> {
    observations: &'a Observations,
    zoomed: &'a ZoomedImage<'a>,
    images: DownsampledImages,
    /// Unit direction and class of each return, frame after frame.
    returns: Vec<Vec<LabelledDirection>>,
}

impl<'a> LocalSearch<'a> {
    pub fn new(
        observations: &'a Observations,
        zoomed: &'a ZoomedImage,
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

    /// The returns of each frame that may be inside an image placed within `reach` of `placement`.
    fn near(&self, placement: &Placement, reach: f64) -> Vec<Vec<LabelledDirection>> {
        let half_angle = self.zoomed.reach() + reach;
        let axis = from_angles(placement.azimuth, placement.elevation);
        let least = half_angle.min(PI).cos();
        let shown = |r: &&LabelledDirection| r.0.dot(&axis) >= least;
        self.returns.iter().map(|r| r.iter().filter(shown).copied().collect()).collect()
    }

    fn joint(&self, placement: &Placement, returns: &[Vec<LabelledDirection>]) -> JointHistogram {
        let map = self.zoomed.pixel_map(placement);
        let Observations { num_point_classes, num_image_classes, .. } = *self.observations;
        let mut joint = JointHistogram::new(num_point_classes, num_image_classes);
        let mut pixels = Vec::with_capacity(RUN);
        for (frame, returns) in returns.iter().enumerate() {
            for run in returns.chunks(RUN) {
                pixels.clear();
                pixels.extend(run.iter().map(|(direction, _)| map.at(direction)));
                for ((_, class), pixel) in run.iter().zip(&pixels) {
                    if let Some(pixel) = pixel {
                        joint.add(*class, self.images.class(frame, pixel), 1.0);
                    }
                }
            }
        }
        joint
    }

    /// Powell's method from one placement, over three angles and the scale of the paper's zoomed image. Line
    /// searches extend by `reach` to either side.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn majority_ignores_nothing_and_breaks_ties_low() {
        let image = LabelImage { width: 5, height: 2, ids: vec![1, 1, 3, 2, 9, 1, 2, 2, 3, 9] };
        assert_eq!(majority(&image, 2).ids, [1, 2, 9]);
    }
}
