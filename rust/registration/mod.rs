//! 2-D registration of label images with spherical label images by mutual information (Alg. 2, line 4).
//!
//! The histogram is pooled over all frames before MI is taken: with one frame, a sliver of agreement is easily luck. A
//! grid over all azimuths, the elevations at which picture and sweep overlap, and in-plane rotations is searched
//! exhaustively on coarse cells; the best placements that lie well apart are then refined by Powell's method on finer
//! ones.

mod exhaustive;
mod local;

use nalgebra::{Point2, Rotation3};
use rayon::prelude::*;

use crate::error::Result;
use crate::label_image::LabelImage;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::spherical::SphericalImages;
use crate::zoom::{Placement, Zoom, Zoomed, majority};
use exhaustive::Candidate;
use local::Level;

/// Cells are small enough for so many across the picture: in the exhaustive search, and in Powell's.
const CELLS_ACROSS: (f64, f64) = (16.0, 32.0);
/// Powell's line searches reach so many cells of the exhaustive search.
const REACH: f64 = 1.5;
/// Hypotheses may lie close enough for so many across the picture.
const SEPARATIONS_ACROSS: f64 = 4.0;

/// How the registration searches. Angles in radians.
#[derive(Clone, Copy, Debug)]
pub struct RegistrationConfig {
    /// How the picture is brought to the angular grid.
    pub zoom: Zoom,
    /// Cell of the exhaustive search.
    pub coarse_cell: f64,
    /// Block of the pictures in the refinement.
    pub fine_cell: f64,
    /// In-plane rotations from minus this to plus this are searched.
    pub max_roll: f64,
    /// Step between the in-plane rotations.
    pub roll_step: f64,
    /// Where the search is narrowed to: rotations (of `T_camera_lidar`) within an angle of one.
    pub around: Option<(Rotation3<f64>, f64)>,
    /// A placement counts only if it overlaps at least this share of the cells of the best overlapping one.
    pub min_cells_of_most: f64,
    /// Hypotheses refined and returned.
    pub num_hypotheses: usize,
    /// Smallest rotation between two hypotheses.
    pub separation: f64,
}

/// A placement of the picture on the sphere, and how well labels agree there.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Where the picture lies.
    pub placement: Placement,
    /// Mutual information of the pooled histogram, nats, less its bias.
    pub mutual_information: f64,
    /// Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames.
    pub num_pairs: f64,
    /// The pooled histogram.
    pub joint: JointHistogram,
}

/// Finds the best well-separated placements, best first.
///
/// # Errors
/// No placement overlaps labelled points with labelled pixels.
pub fn register(
    observations: &Observations,
    images: &SphericalImages,
    config: &RegistrationConfig,
) -> Result<Vec<Hypothesis>> {
    let zoomed = Zoomed::new(&observations.camera, config.zoom)?;
    let around = config.around.map(|(rotation, angle)| (zoomed.onto_axis(&rotation), angle));
    let config = &RegistrationConfig { around, ..*config };
    let cell = config.coarse_cell.min(zoomed.horizontal_fov() / CELLS_ACROSS.0);
    let coarse = images.grid.coarsened(cell);
    let candidates = exhaustive::search(observations, &zoomed, images, &coarse, config)?;
    let of = |c: &Candidate| (c.placement, c.mutual_information);
    let separation = config.separation.min(zoomed.horizontal_fov() / SEPARATIONS_ACROSS);
    let starts = separate(candidates, separation, config.num_hypotheses, of);
    let cell = config.fine_cell.min(zoomed.horizontal_fov() / CELLS_ACROSS.1);
    let level = Level::new(observations, &zoomed, images, cell);
    let reach = REACH * coarse.cell_height;
    let refined: Vec<Hypothesis> =
        starts.par_iter().map(|start| level.refine(&start.placement, reach, config)).collect();
    let of = |h: &Hypothesis| (h.placement, h.mutual_information);
    Ok(separate(refined, 0.5 * separation, config.num_hypotheses, of))
}

/// The best, best first, up to `limit`, each at least `separation` away from all better ones; equals keep their order.
fn separate<T>(
    mut found: Vec<T>,
    separation: f64,
    limit: usize,
    of: impl Fn(&T) -> (Placement, f64),
) -> Vec<T> {
    found.sort_by(|a, b| of(b).1.total_cmp(&of(a).1));
    let mut rotations: Vec<Rotation3<f64>> = Vec::new();
    let is_apart = |one: &T| {
        let rotation = of(one).0.rotation();
        let apart = rotations.iter().all(|better| better.angle_to(&rotation) >= separation);
        if apart {
            rotations.push(rotation);
        }
        apart
    };
    found.into_iter().filter(is_apart).take(limit).collect()
}

/// Label images in blocks about as wide as a cell at the middle of the picture, and the block's size.
struct Downsampled {
    factor: usize,
    images: Vec<LabelImage<u8>>,
}

impl Downsampled {
    #[inline]
    fn class(&self, frame: usize, pixel: &Point2<f64>) -> u8 {
        let block = |x: f64| (x + 0.5) as usize / self.factor;
        self.images[frame].at(block(pixel.x), block(pixel.y))
    }
}

fn downsampled(observations: &Observations, zoomed: &Zoomed, cell: f64) -> Downsampled {
    let pixels_per_radian = observations.camera.width as f64 / zoomed.horizontal_fov();
    let factor = ((pixels_per_radian * cell).round() as usize).max(1);
    let images = observations.frames.par_iter().map(|f| majority(&f.image_classes, factor)).collect();
    Downsampled { factor, images }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_stay_apart_best_first() {
        let placement = |azimuth: f64| Placement { azimuth, elevation: 0.0, roll: 0.0, scale: 1.0 };
        // Azimuth in radians, and a score.
        let found = vec![(0.0, 1.0), (0.1, 3.0), (0.5, 2.0), (0.55, 2.5), (2.0, 0.5), (0.1, 3.0)];
        let of = |&(azimuth, score): &(f64, f64)| (placement(azimuth), score);
        let kept = separate(found.clone(), 0.2, 10, of);
        assert_eq!(kept, [(0.1, 3.0), (0.55, 2.5), (2.0, 0.5)]);
        assert_eq!(separate(found, 0.2, 2, of), kept[..2]);
    }
}
