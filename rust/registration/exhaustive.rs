//! Exhaustive search over every azimuth, elevation and in-plane rotation, on coarse cells.
//!
//! For each elevation and in-plane rotation, the images are resampled to the grid once, as a template. Each azimuth
//! is then a shift of the template along the spherical images, which wrap around.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::local::{DownsampledImages, downsampled};
use super::{RegistrationConfig, RotationBall};
use crate::error::{Error, Result};
use crate::observation::Observations;
use crate::point_cloud::to_f64;
use crate::spherical::{LabelledReturn, SphericalGrid, SphericalImages};
use crate::zoom::{Placement, ZoomedImage};

/// A placement of the exhaustive search with its score.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub placement: Placement,
    /// Mutual information less its bias, nats.
    pub mutual_information: f64,
    /// Number of cells with a class on both sides.
    num_cells: f64,
}

/// Scores every azimuth for each (elevation, roll). A turn in azimuth is a shift of columns.
pub(super) fn search(
    observations: &Observations,
    zoomed: &ZoomedImage,
    spherical: &SphericalImages,
    coarse: &SphericalGrid,
    config: &RegistrationConfig,
    around: Option<RotationBall>,
) -> Result<Vec<Candidate>> {
    let rings = rings(observations, spherical, coarse);
    let images = downsampled(observations, zoomed, coarse.cell_height);
    let most = observations.frames.len() * coarse.rows * coarse.columns;
    let n_log_n: Vec<f64> = (0..=most).map(|n| n as f64 * (n.max(1) as f64).ln()).collect();
    let empty = Counts::new(observations, &n_log_n);
    let range = SearchRange::new(coarse, config, around);
    let candidates: Vec<Candidate> = upright_placements(zoomed, coarse, config, around)
        .par_iter()
        .flat_map_iter(|upright| {
            let shifts: Vec<usize> = (0..coarse.columns)
                .filter(|&shift| range.allows(&shifted(upright, shift, coarse.columns)))
                .collect();
            if shifts.is_empty() {
                return Vec::new();
            }
            let template = Template::new(observations, zoomed, coarse, &images, upright);
            let mut counts = empty.clone();
            shifts.into_iter().map(|shift| template.score(&rings, shift, &mut counts)).collect()
        })
        .collect();
    let largest = candidates.iter().map(|c| c.num_cells).fold(0.0, f64::max);
    if largest == 0.0 {
        return Err(Error::Calibration(
            "no overlap: labelled points meet labelled pixels in none of the searched directions".into(),
        ));
    }
    let enough = |c: &Candidate| c.num_cells >= config.min_cells_of_most * largest;
    Ok(candidates.into_iter().filter(enough).collect())
}

/// The (elevation, roll) pairs at azimuth zero whose image can overlap the sweep.
fn upright_placements(
    zoomed: &ZoomedImage,
    grid: &SphericalGrid,
    config: &RegistrationConfig,
    around: Option<RotationBall>,
) -> Vec<Placement> {
    let mut placements = Vec::new();
    for roll in rolls(config, around.is_some()) {
        let (above, below) = zoomed.above_below(roll);
        let highest = (grid.top + below).min(FRAC_PI_2);
        let lowest = (grid.bottom() - above).max(-FRAC_PI_2);
        let num_elevations = ((highest - lowest) / grid.cell_height).floor() as usize;
        placements.extend((0..num_elevations).map(|index| Placement {
            azimuth: 0.0,
            elevation: highest - (index as f64 + 0.5) * grid.cell_height,
            roll,
            scale: 1.0,
        }));
    }
    // However narrow the search, it includes the rotation at its centre.
    let given = around.map(|(rotation, _)| Placement { azimuth: 0.0, ..Placement::of_rotation(&rotation) });
    placements.extend(given);
    placements
}

/// The in-plane rotations, each once. A narrowed search tries them all: where the camera looks far up or down, a
/// turn in azimuth is nearly a roll of the image.
fn rolls(config: &RegistrationConfig, is_limited: bool) -> Vec<f64> {
    let num_around = (TAU / config.roll_step).round();
    let steps = (config.max_roll / config.roll_step).ceil();
    if is_limited || 2.0 * steps + 1.0 >= num_around {
        return (0..num_around as usize).map(|i| i as f64 / num_around * TAU).collect();
    }
    let step = config.max_roll / steps.max(1.0);
    let steps = steps as i32;
    (-steps..=steps).map(|i| f64::from(i) * step).collect()
}

/// A placement turned to the right by `shift` of the `columns` of a full turn.
fn shifted(upright: &Placement, shift: usize, columns: usize) -> Placement {
    Placement { azimuth: -(shift as f64) / columns as f64 * TAU, ..*upright }
}

/// Range of a narrowed search: rotations within an angle of a given one, plus half a step.
struct SearchRange(Option<RotationBall>);

impl SearchRange {
    fn new(grid: &SphericalGrid, config: &RegistrationConfig, around: Option<RotationBall>) -> Self {
        let steps = Vector3::new(grid.cell_height, TAU / grid.columns as f64, config.roll_step);
        Self(around.map(|(rotation, angle)| (rotation, angle + 0.5 * steps.norm())))
    }

    fn allows(&self, placement: &Placement) -> bool {
        self.0.is_none_or(|(rotation, angle)| placement.rotation().angle_to(&rotation) <= angle)
    }
}

/// The class of each cell of `coarse`, as the start of a row of [`Counts`], frame after frame: the majority class
/// of the returns of the spherical image in it. Each row of cells is repeated once, so that a shift needs no
/// modulo.
fn rings(observations: &Observations, images: &SphericalImages, coarse: &SphericalGrid) -> Vec<Vec<u32>> {
    let (num_classes, width) = (observations.num_point_classes, observations.num_image_classes as u32 + 1);
    let ring = |returns: &Vec<LabelledReturn>| {
        let mut counts = vec![0u32; coarse.rows * coarse.columns * num_classes];
        for (point, class) in returns {
            if let Some((row, column)) = coarse.cell(&to_f64(point)) {
                counts[(row * coarse.columns + column) * num_classes + usize::from(*class)] += 1;
            }
        }
        let rows: Vec<u32> =
            counts.chunks_exact(num_classes).map(|c| most_frequent(c) as u32 * width).collect();
        rows.chunks_exact(coarse.columns).flat_map(|row| row.iter().chain(row).copied()).collect()
    };
    images.returns.par_iter().map(ring).collect()
}

/// The class with the highest count, the lowest in a tie; the number of classes if all counts are zero.
fn most_frequent(counts: &[u32]) -> usize {
    let best = (0..counts.len()).rev().max_by_key(|&class| counts[class]);
    best.filter(|&class| counts[class] > 0).unwrap_or(counts.len())
}

/// The image of every frame on the grid, for one (elevation, roll) at azimuth zero.
struct Template {
    upright: Placement,
    columns: usize,
    /// Runs of adjacent cells of one grid row inside the image: the start in an unshifted ring, and the range in
    /// `classes`.
    runs: Vec<(usize, Range<usize>)>,
    /// The column of [`Counts`] of each cell, frame after frame.
    classes: Vec<Vec<u8>>,
}

impl Template {
    fn new(
        observations: &Observations,
        zoomed: &ZoomedImage,
        grid: &SphericalGrid,
        images: &DownsampledImages,
        upright: &Placement,
    ) -> Self {
        let map = zoomed.pixel_map(upright);
        let (mut runs, mut pixels) = (Vec::<(usize, Range<usize>)>::new(), Vec::new());
        for row in 0..grid.rows {
            let mut open = false;
            for column in 0..grid.columns {
                let Some(pixel) = map.at(&grid.direction(row, column)) else {
                    open = false;
                    continue;
                };
                match runs.last_mut().filter(|_| open) {
                    Some((_, cells)) => cells.end += 1,
                    None => runs.push((row * 2 * grid.columns + column, pixels.len()..pixels.len() + 1)),
                }
                open = true;
                pixels.push(pixel);
            }
        }
        let none = observations.num_image_classes as u8;
        let column = |frame, pixel| images.class(frame, pixel).min(none);
        let classes = (0..observations.frames.len())
            .map(|frame| pixels.iter().map(|pixel| column(frame, pixel)).collect())
            .collect();
        Self { upright: *upright, columns: grid.columns, runs, classes }
    }

    /// The candidate `shift` columns to the right of azimuth zero.
    fn score(&self, rings: &[Vec<u32>], shift: usize, counts: &mut Counts) -> Candidate {
        counts.clear();
        for (ring, classes) in rings.iter().zip(&self.classes) {
            for (start, cells) in &self.runs {
                counts.add(&ring[start + shift..][..cells.len()], &classes[cells.clone()]);
            }
        }
        counts.pool();
        let (mutual_information, num_cells) = counts.mutual_information();
        Candidate { placement: shifted(&self.upright, shift, self.columns), mutual_information, num_cells }
    }
}

/// A fast joint histogram of integer counts. An extra row and an extra column hold the pairs without a class.
#[derive(Clone)]
struct Counts<'a> {
    width: usize,
    pairs: Vec<u32>,
    /// Pairs of every other cell: adjacent cells mostly have the same pair, and each count waits for the one before
    /// it.
    odd_pairs: Vec<u32>,
    /// `n log n` of every count that can occur.
    n_log_n: &'a [f64],
}

impl<'a> Counts<'a> {
    fn new(observations: &Observations, n_log_n: &'a [f64]) -> Self {
        let width = observations.num_image_classes + 1;
        let pairs = vec![0; (observations.num_point_classes + 1) * width];
        Self { width, odd_pairs: pairs.clone(), pairs, n_log_n }
    }

    fn clear(&mut self) {
        self.pairs.fill(0);
        self.odd_pairs.fill(0);
    }

    /// Adds adjacent cells, given by the starts of rows and by columns.
    fn add(&mut self, rows: &[u32], columns: &[u8]) {
        let ((rows, last_row), (columns, last_column)) = (rows.as_chunks::<2>(), columns.as_chunks::<2>());
        for (row, column) in rows.iter().zip(columns) {
            self.pairs[(row[0] + u32::from(column[0])) as usize] += 1;
            self.odd_pairs[(row[1] + u32::from(column[1])) as usize] += 1;
        }
        for (&row, &column) in last_row.iter().zip(last_column) {
            self.pairs[(row + u32::from(column)) as usize] += 1;
        }
    }

    /// Pools all pairs.
    fn pool(&mut self) {
        self.pairs.iter_mut().zip(&self.odd_pairs).for_each(|(sum, count)| *sum += count);
    }

    /// Mutual information less its bias, as in [`JointHistogram`], and the number of pairs with a class on both
    /// sides.
    fn mutual_information(&self) -> (f64, f64) {
        let (mut total, mut occupied, mut sum) = (0, 0i32, 0.0);
        let mut columns = vec![0; self.width - 1];
        let rows = self.pairs.chunks_exact(self.width).rev().skip(1);
        for row in rows {
            let mut row_total = 0;
            for (&count, column) in row.iter().zip(&mut columns) {
                *column += count;
                row_total += count;
                occupied += i32::from(count > 0);
                sum += self.n_log_n[count as usize];
            }
            occupied -= i32::from(row_total > 0);
            sum -= self.n_log_n[row_total as usize];
            total += row_total;
        }
        for &column in &columns {
            occupied -= i32::from(column > 0);
            sum -= self.n_log_n[column as usize];
        }
        sum += self.n_log_n[total as usize];
        let total = f64::from(total);
        let bias = f64::from(occupied + 1) / 2.0;
        (if total > 0.0 { (sum - bias) / total } else { 0.0 }, total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutual_information::JointHistogram;
    use crate::zoom::Zoom;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    const CONFIG: RegistrationConfig = RegistrationConfig {
        zoom: Zoom::Exact,
        coarse_cell: 0.05,
        fine_cell: 0.03,
        max_roll: 0.26,
        roll_step: 0.087,
        min_cells_of_most: 0.1,
        num_hypotheses: 8,
        separation: 0.26,
    };

    proptest! {
        #[test]
        fn counts_have_the_information_of_the_joint_histogram(pairs in prop::collection::vec((0usize..5, 0usize..4), 1..300)) {
            let n_log_n: Vec<f64> = (0..=300).map(|n| f64::from(n) * f64::from(n.max(1)).ln()).collect();
            // The last row and the last column hold the pairs without a class.
            let mut counts = Counts { width: 4, pairs: vec![0; 5 * 4], odd_pairs: vec![0; 5 * 4], n_log_n: &n_log_n };
            let mut joint = JointHistogram::new(4, 3);
            for (row, column) in pairs {
                counts.pairs[row * 4 + column] += 1;
                if row < 4 && column < 3 {
                    joint.add(row as u8, column as u8, 1.0);
                }
            }
            let (information, total) = counts.mutual_information();
            prop_assert_eq!(total, joint.total());
            if total > 0.0 {
                prop_assert!((information - (joint.mutual_information() - joint.bias())).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn every_roll_is_tried_once() {
        let all = RegistrationConfig { max_roll: std::f64::consts::PI, ..CONFIG };
        assert_eq!(rolls(&CONFIG, false).len(), 7);
        let few = rolls(&RegistrationConfig { max_roll: 0.1, ..CONFIG }, false);
        assert_eq!(few, [-0.1, -0.05, 0.0, 0.05, 0.1]);
        assert_eq!(rolls(&all, false).len(), 72);
    }

    #[test]
    fn a_narrowed_search_tries_all_within_its_angle_and_nothing_far() {
        let grid = SphericalGrid::from_scan(64, 1024, 0.2, -0.5).expect("a valid scan").coarsened(0.05);
        for elevation in [0.0, 1.0, -1.3] {
            let given = Placement { azimuth: 1.0, elevation, roll: 1.5, scale: 1.0 };
            let range = SearchRange::new(&grid, &CONFIG, Some((given.rotation(), 0.3)));
            assert_eq!(rolls(&CONFIG, true).len(), 72);
            for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
                let turned = |angle| Rotation3::from_axis_angle(&axis, angle) * given.rotation();
                assert!(range.allows(&Placement::of_rotation(&turned(0.29))));
                assert!(!range.allows(&Placement::of_rotation(&turned(0.4))));
            }
        }
    }
}
