//! Pixel-point pairs from a registration, for PnP (Alg. 2, lines 5-7).

use nalgebra::Point2;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::error::Result;
use crate::observation::{NO_CLASS, Observations};
use crate::registration::Hypothesis;
use crate::spherical::{EMPTY, SphericalGrid, to_f64};
use crate::zoom::{Zoom, Zoomed};

/// The picture is divided into so many columns and rows, and range into so many bands, over which pairs are spread.
const BLOCKS: (usize, usize) = (12, 8);
/// Bands of range in which parallax falls by half each: up to 5 m, 10 m, 20 m, 40 m, and beyond.
const RANGE_BANDS: [f64; 4] = [5.0, 10.0, 20.0, 40.0];
/// A band of a block that holds fewer pairs than its share leaves the rest to the others.
const SHARE_MARGIN: usize = 3;

/// A LiDAR point (metres, LiDAR frame) and the raw pixel that the registration puts it on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// Metres, LiDAR frame.
    pub point: [f32; 3],
    /// `(u, v)`.
    pub pixel: Point2<f64>,
}

/// Samples up to `count` pairs whose classes agree, that is have positive pointwise mutual information, spread over the
/// picture and over range.
///
/// # Errors
/// The camera has no field of view.
pub fn sample(
    observations: &Observations,
    grid: &SphericalGrid,
    zoom: Zoom,
    hypothesis: &Hypothesis,
    count: usize,
    seed: u64,
) -> Result<Vec<Correspondence>> {
    let mut candidates = agreeing(observations, grid, zoom, hypothesis)?;
    candidates.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let camera = &observations.camera;
    let block = |x: f64, size: usize, blocks: usize| ((x + 0.5) / size as f64 * blocks as f64) as usize;
    let bin = |c: &Correspondence| {
        let range = to_f64(&c.point).norm();
        let band = RANGE_BANDS.iter().filter(|&&limit| range > limit).count();
        let column = block(c.pixel.x, camera.width, BLOCKS.0);
        let row = block(c.pixel.y, camera.height, BLOCKS.1);
        (row * BLOCKS.0 + column) * (RANGE_BANDS.len() + 1) + band
    };
    let mut filled = vec![0usize; BLOCKS.0 * BLOCKS.1 * (RANGE_BANDS.len() + 1)];
    let mut occupied: Vec<usize> = candidates.iter().map(bin).collect();
    occupied.sort_unstable();
    occupied.dedup();
    let share = (SHARE_MARGIN * count).div_ceil(occupied.len().max(1));
    candidates.retain(|c| {
        filled[bin(c)] += 1;
        filled[bin(c)] <= share
    });
    candidates.truncate(count);
    Ok(candidates)
}

/// Every pair of a registration whose classes agree.
fn agreeing(
    observations: &Observations,
    grid: &SphericalGrid,
    zoom: Zoom,
    hypothesis: &Hypothesis,
) -> Result<Vec<Correspondence>> {
    let zoomed = Zoomed::new(&observations.camera, zoom)?;
    let pixel_of = zoomed.pixel_map(&hypothesis.placement);
    let pointwise = hypothesis.joint.pointwise();
    let mut pairs = Vec::new();
    for frame in &observations.frames {
        for index in grid.project(&frame.points).into_iter().filter(|&i| i != EMPTY) {
            let (point, class) = (frame.points[index as usize], frame.point_classes[index as usize]);
            let Some(pixel) = pixel_of(&to_f64(&point)) else {
                continue;
            };
            let image_class = frame.image_classes.at((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
            let agree = class != NO_CLASS
                && image_class != NO_CLASS
                && pointwise[hypothesis.joint.index(class, image_class)] > 0.0;
            if agree {
                pairs.push(Correspondence { point, pixel });
            }
        }
    }
    Ok(pairs)
}
