//! The search for the best placements: exhaustive, then refined, and well separated.

use nalgebra::Rotation3;
use rayon::prelude::*;

use super::exhaustive::{self, Candidate};
use super::local::LocalSearch;
use super::{Hypothesis, RegistrationConfig, RotationBall};
use crate::error::Result;
use crate::observation::Observations;
use crate::spherical::SphericalImages;
use crate::zoom::{Placement, ZoomedImage};

/// Number of cells across the image in the exhaustive search and in Powell's method.
const CELLS_ACROSS: (f64, f64) = (16.0, 32.0);
/// Reach of Powell's line searches, in cells of the exhaustive search.
const REACH: f64 = 1.5;
/// Number of hypotheses that fit side by side across the image.
const SEPARATIONS_ACROSS: f64 = 4.0;

/// Finds the best well-separated placements, best first, among all or among those around a given one.
pub fn register(
    observations: &Observations,
    images: &SphericalImages,
    config: &RegistrationConfig,
    around: Option<RotationBall>,
) -> Result<Vec<Hypothesis>> {
    let zoomed = ZoomedImage::new(&observations.camera, config.zoom)?;
    let around = around.map(|(rotation, angle)| (zoomed.onto_axis(&rotation), angle));
    let cell = config.coarse_cell.min(zoomed.horizontal_fov() / CELLS_ACROSS.0);
    let coarse = images.grid.coarsened(cell);
    let candidates = exhaustive::search(observations, &zoomed, images, &coarse, config, around)?;
    let of = |c: &Candidate| (c.placement, c.mutual_information);
    let separation = config.separation.min(zoomed.horizontal_fov() / SEPARATIONS_ACROSS);
    let starts = separate(candidates, separation, config.num_hypotheses, of);
    let cell = config.fine_cell.min(zoomed.horizontal_fov() / CELLS_ACROSS.1);
    let local = LocalSearch::new(observations, &zoomed, images, cell);
    let reach = REACH * coarse.cell_height;
    let refined: Vec<Hypothesis> =
        starts.par_iter().map(|start| local.refine(&start.placement, reach, config)).collect();
    let of = |h: &Hypothesis| (h.placement, h.mutual_information);
    Ok(separate(refined, 0.5 * separation, config.num_hypotheses, of))
}

/// At most `limit` items, best first, each at least `separation` away from all better ones; ties keep their order.
fn separate<T>(
    mut items: Vec<T>,
    separation: f64,
    limit: usize,
    of: impl Fn(&T) -> (Placement, f64),
) -> Vec<T> {
    items.sort_by(|a, b| of(b).1.total_cmp(&of(a).1));
    let mut rotations: Vec<Rotation3<f64>> = Vec::new();
    let is_apart = |one: &T| {
        let rotation = of(one).0.rotation();
        let apart = rotations.iter().all(|better| better.angle_to(&rotation) >= separation);
        if apart {
            rotations.push(rotation);
        }
        apart
    };
    items.into_iter().filter(is_apart).take(limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_stay_apart_best_first() {
        let placement = |azimuth: f64| Placement { azimuth, elevation: 0.0, roll: 0.0, scale: 1.0 };
        // Azimuth in radians, and a score.
        let items = vec![(0.0, 1.0), (0.1, 3.0), (0.5, 2.0), (0.55, 2.5), (2.0, 0.5), (0.1, 3.0)];
        let of = |&(azimuth, score): &(f64, f64)| (placement(azimuth), score);
        let kept = separate(items.clone(), 0.2, 10, of);
        assert_eq!(kept, [(0.1, 3.0), (0.55, 2.5), (2.0, 0.5)]);
        assert_eq!(separate(items, 0.2, 2, of), kept[..2]);
    }
}
