//! Pixel-point pairs from a registration, for PnP (Alg. 2, lines 5-7).

use geometry::camera::Camera;
use nalgebra::Point2;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::classes::NO_CLASS;
use crate::error::Result;
use crate::label_image::LabelImage;
use crate::observation::Observations;
use crate::point_cloud::to_f64;
use crate::registration::Hypothesis;
use crate::spherical::{LabelledReturn, SphericalImages};
use crate::thinning::{stride, thinned};
use crate::zoom::{Zoom, ZoomedImage};

/// Number of columns and rows of image blocks over which pairs are spread, in addition to bands of range.
const BLOCKS: (usize, usize) = (12, 8);
/// Limits of the range bands, each of which halves parallax: up to 5 m, 10 m, 20 m, 40 m, and beyond.
const RANGE_BANDS: [f64; 4] = [5.0, 10.0, 20.0, 40.0];
/// A band of a block with fewer pairs than its quota leaves the rest to the others.
const SHARE_MARGIN: usize = 3;

/// Returns are thinned to at most this many, over all frames and directions. An image shows a quarter of them or
/// less, and PnP takes some thousand.
const MAX_RETURNS: usize = 50_000;

/// A LiDAR point (metres, LiDAR frame) and the raw pixel that the registration maps it to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    pub point: [f32; 3],
    /// `(u, v)`.
    pub pixel: Point2<f64>,
}

/// Samples up to `count` pairs for each hypothesis, spread over the image and over range. The classes of each pair
/// agree, that is, have positive pointwise mutual information.
pub fn sample(
    observations: &Observations,
    images: &SphericalImages,
    zoom: Zoom,
    hypotheses: &[Hypothesis],
    count: usize,
    seed: u64,
) -> Result<Vec<Vec<Correspondence>>> {
    let zoomed = ZoomedImage::new(&observations.camera, zoom)?;
    let stride = stride(images.num_returns(), MAX_RETURNS);
    let sample = |hypothesis: &Hypothesis| {
        let mut pairs = agreeing(observations, &zoomed, images, stride, hypothesis);
        pairs.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
        spread(pairs, &observations.camera, count)
    };
    Ok(hypotheses.par_iter().map(sample).collect())
}

/// The pairs of a registration whose classes agree, from one of every `stride` returns.
fn agreeing(
    observations: &Observations,
    zoomed: &ZoomedImage,
    images: &SphericalImages,
    stride: usize,
    hypothesis: &Hypothesis,
) -> Vec<Correspondence> {
    let map = zoomed.pixel_map(&hypothesis.placement);
    let pointwise = hypothesis.joint.pointwise();
    let pair = |&(point, class): &LabelledReturn, image: &LabelImage<u8>| {
        let pixel = map.at(&to_f64(&point))?;
        let image_class = image.at((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
        let agree = image_class != NO_CLASS
            && pointwise[hypothesis.joint.index(usize::from(class), image_class)] > 0.0;
        agree.then_some(Correspondence { point, pixel })
    };
    let frames = images.returns.iter().zip(&observations.frames);
    frames
        .flat_map(|(returns, frame)| {
            thinned(returns.len(), stride).filter_map(|i| pair(&returns[i], &frame.image.classes))
        })
        .collect()
}

/// The first pairs, up to `count`, such that no block of the image and no band of range exceeds its quota.
fn spread(mut pairs: Vec<Correspondence>, camera: &Camera, count: usize) -> Vec<Correspondence> {
    let block = |x: f64, size: usize, blocks: usize| ((x + 0.5) / size as f64 * blocks as f64) as usize;
    let bin = |c: &Correspondence| {
        let range = to_f64(&c.point).norm();
        let band = RANGE_BANDS.iter().filter(|&&limit| range > limit).count();
        let column = block(c.pixel.x, camera.width, BLOCKS.0);
        let row = block(c.pixel.y, camera.height, BLOCKS.1);
        (row * BLOCKS.0 + column) * (RANGE_BANDS.len() + 1) + band
    };
    let mut filled = vec![0usize; BLOCKS.0 * BLOCKS.1 * (RANGE_BANDS.len() + 1)];
    pairs.iter().for_each(|pair| filled[bin(pair)] += 1);
    let occupied = filled.iter().filter(|&&n| n > 0).count();
    let share = (SHARE_MARGIN * count).div_ceil(occupied.max(1));
    filled.fill(0);
    pairs.retain(|pair| {
        filled[bin(pair)] += 1;
        filled[bin(pair)] <= share
    });
    pairs.truncate(count);
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_part_of_the_image_and_no_band_of_range_has_more_than_its_share() {
        const COUNT: usize = 60;
        let k = [[100.0, 0.0, 59.5], [0.0, 100.0, 39.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (120, 80), k, &[]).expect("a valid camera");
        let pair =
            |u: f64, range: f32| Correspondence { point: [0.0, 0.0, range], pixel: Point2::new(u, 5.0) };
        // A crowd in one block at one range, and a few pairs elsewhere, later in the list.
        let crowd = (0..1000).map(|i| pair(f64::from(i % 10), 7.0));
        let others = (0..10).map(|i| pair(50.0, 3.0 + 10.0 * f64::from(i % 2) as f32));
        let kept = spread(crowd.chain(others).collect(), &camera, COUNT);
        let in_crowd = kept.iter().filter(|c| c.point[2] == 7.0).count();
        assert_eq!((in_crowd, kept.len()), (COUNT, COUNT), "three bins: a share is more than all");
        let many = (0..12).flat_map(|i| (0..100).map(move |_| pair(f64::from(i) * 10.0, 7.0)));
        let kept = spread(many.collect(), &camera, COUNT);
        let in_first = kept.iter().filter(|c| c.pixel.x == 0.0).count();
        assert_eq!((in_first, kept.len()), (SHARE_MARGIN * COUNT / 12, COUNT));
    }
}
