//! 2-D registration of label images with spherical label images by mutual information (Alg. 2, line 4).
//!
//! The histogram is pooled over all frames before MI is taken: with one frame, a sliver of agreement is easily luck. A
//! grid over all azimuths, the elevations at which picture and sweep overlap, and in-plane rotations is searched
//! exhaustively on coarse cells; the best placements that lie well apart are then refined by Powell's method on finer
//! ones.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::label_image::LabelImage;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, NO_CLASS, Observations};
use crate::powell::{PowellConfig, minimize};
use crate::spherical::{EMPTY, SphericalGrid, from_angles, to_f64};
use crate::zoom::{Placement, Zoom, Zoomed, majority};

/// Half-width of Powell's first bracket for the scale of the zoomed picture.
const SCALE_STEP: f64 = 0.1;
/// Powell's line searches end within this share of their bracket; finer means nothing on cells of this size.
const POWELL_TOLERANCE: f64 = 0.02;
const POWELL_ROUNDS: usize = 8;

/// How the registration searches. Angles in radians.
#[derive(Clone, Copy, Debug)]
pub struct RegistrationConfig {
    /// How the picture is brought to the angular grid.
    pub zoom: Zoom,
    /// Cell of the exhaustive search.
    pub coarse_cell: f64,
    /// Cell of the refinement.
    pub fine_cell: f64,
    /// In-plane rotations from minus this to plus this are searched.
    pub max_roll: f64,
    /// Step between the in-plane rotations.
    pub roll_step: f64,
    /// A placement counts only if it overlaps at least this share of the cells of the best overlapping one.
    pub min_overlap: f64,
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
    /// Labelled cells, over all frames, that fall on a labelled pixel.
    pub num_cells: f64,
    /// The pooled histogram.
    pub joint: JointHistogram,
}

/// Finds the best well-separated placements, best first.
///
/// # Errors
/// No placement overlaps labelled points with labelled pixels.
pub fn register(
    observations: &Observations,
    grid: &SphericalGrid,
    config: &RegistrationConfig,
) -> Result<Vec<Hypothesis>> {
    let zoomed = Zoomed::new(&observations.camera, config.zoom)?;
    let candidates = search_grid(observations, &zoomed, &grid.coarsened(config.coarse_cell), config)?;
    let starts = separate(&candidates, config);
    let level = Level::new(observations, &zoomed, grid.coarsened(config.fine_cell));
    let mut hypotheses: Vec<Hypothesis> =
        starts.par_iter().map(|start| refine(&level, start, config)).collect();
    hypotheses.sort_by(|a, b| b.mutual_information.total_cmp(&a.mutual_information));
    Ok(keep_apart(hypotheses, config))
}

/// A placement of the exhaustive search with its score.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    placement: Placement,
    mutual_information: f64,
    num_cells: f64,
}

/// Scores every azimuth for each (elevation, roll); the turn in azimuth is a shift of columns.
fn search_grid(
    observations: &Observations,
    zoomed: &Zoomed,
    grid: &SphericalGrid,
    config: &RegistrationConfig,
) -> Result<Vec<Candidate>> {
    let rings = rings(observations, grid);
    let images = downsampled(observations, zoomed, grid.cell_height);
    let candidates: Vec<Candidate> = upright_placements(zoomed, grid, config)
        .par_iter()
        .flat_map_iter(|upright| {
            let template = Template::new(observations, zoomed, grid, &images, upright);
            (0..grid.columns).map(|shift| template.score(&rings, shift)).collect::<Vec<_>>()
        })
        .collect();
    let largest = candidates.iter().map(|c| c.num_cells).fold(0.0, f64::max);
    if largest == 0.0 {
        return Err(Error::Calibration(
            "no overlap: in no direction do labelled points fall on labelled pixels".into(),
        ));
    }
    let enough = |c: &Candidate| c.num_cells >= config.min_overlap * largest;
    Ok(candidates.into_iter().filter(enough).collect())
}

/// The (elevation, roll) pairs at azimuth zero whose picture can overlap the sweep.
fn upright_placements(zoomed: &Zoomed, grid: &SphericalGrid, config: &RegistrationConfig) -> Vec<Placement> {
    let (above, below) = zoomed.above_below();
    let highest = (grid.top + below).min(FRAC_PI_2);
    let lowest = (grid.bottom() - above).max(-FRAC_PI_2);
    let elevations = ((highest - lowest) / grid.cell_height).floor() as i32;
    let rolls = (config.max_roll / config.roll_step).round() as i32;
    let placement = |(e, r): (i32, i32)| Placement {
        azimuth: 0.0,
        elevation: highest - (f64::from(e) + 0.5) * grid.cell_height,
        roll: f64::from(r) * config.roll_step,
        scale: 1.0,
    };
    (0..elevations).flat_map(|e| (-rolls..=rolls).map(move |r| (e, r))).map(placement).collect()
}

/// The classes of each frame's spherical image, each row twice in a row, so that a shift needs no modulo.
fn rings(observations: &Observations, grid: &SphericalGrid) -> Vec<Vec<u8>> {
    let ring = |frame: &Frame| {
        let index = grid.project(&frame.points);
        let class = |&i: &u32| {
            if i == EMPTY { NO_CLASS } else { frame.point_classes[i as usize] }
        };
        index.chunks_exact(grid.columns).flat_map(|row| row.iter().chain(row).map(class)).collect()
    };
    observations.frames.par_iter().map(ring).collect()
}

/// Label images in blocks about as wide as a cell at the middle of the picture, and the block's size.
struct Downsampled {
    factor: usize,
    images: Vec<LabelImage<u8>>,
}

impl Downsampled {
    #[inline]
    fn class(&self, frame: usize, pixel: &nalgebra::Point2<f64>) -> u8 {
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

/// The picture of every frame on the grid, for one (elevation, roll) at azimuth zero.
struct Template {
    upright: Placement,
    columns: usize,
    num_image_classes: usize,
    num_point_classes: usize,
    /// Where each cell lies in a ring before it is shifted.
    offsets: Vec<u32>,
    /// The image class of each cell, frame after frame.
    classes: Vec<Vec<u8>>,
}

impl Template {
    fn new(
        observations: &Observations,
        zoomed: &Zoomed,
        grid: &SphericalGrid,
        images: &Downsampled,
        upright: &Placement,
    ) -> Self {
        let pixel_of = zoomed.pixel_map(upright);
        let cells = (0..grid.rows).flat_map(|row| (0..grid.columns).map(move |column| (row, column)));
        let (offsets, pixels): (Vec<u32>, Vec<_>) = cells
            .filter_map(|(row, column)| {
                let pixel = pixel_of(&grid.direction(row, column))?;
                Some(((row * 2 * grid.columns + column) as u32, pixel))
            })
            .unzip();
        let classes = (0..observations.frames.len())
            .map(|frame| pixels.iter().map(|pixel| images.class(frame, pixel)).collect())
            .collect();
        Self {
            upright: *upright,
            columns: grid.columns,
            num_image_classes: observations.num_image_classes,
            num_point_classes: observations.num_point_classes,
            offsets,
            classes,
        }
    }

    /// The candidate that lies `shift` columns to the right of azimuth zero.
    fn score(&self, rings: &[Vec<u8>], shift: usize) -> Candidate {
        // One row and one column more than there are classes take the pairs without a class.
        let width = self.num_image_classes + 1;
        let mut counts = vec![0u32; (self.num_point_classes + 1) * width];
        for (ring, classes) in rings.iter().zip(&self.classes) {
            for (&offset, &image_class) in self.offsets.iter().zip(classes) {
                let point_class = usize::from(ring[offset as usize + shift]).min(self.num_point_classes);
                let image_class = usize::from(image_class).min(self.num_image_classes);
                counts[point_class * width + image_class] += 1;
            }
        }
        let mut joint = JointHistogram::new(self.num_point_classes, self.num_image_classes);
        joint.weights = counts
            .chunks_exact(width)
            .take(self.num_point_classes)
            .flat_map(|row| row[..self.num_image_classes].iter().map(|&n| f64::from(n)))
            .collect();
        Candidate {
            placement: Placement { azimuth: -(shift as f64) / self.columns as f64 * TAU, ..self.upright },
            mutual_information: joint.mutual_information() - joint.bias(),
            num_cells: joint.total(),
        }
    }
}

/// The best candidates, each at least `separation` away from all better ones.
fn separate(candidates: &[Candidate], config: &RegistrationConfig) -> Vec<Placement> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| {
        candidates[b].mutual_information.total_cmp(&candidates[a].mutual_information).then(a.cmp(&b))
    });
    let mut kept: Vec<Placement> = Vec::new();
    for index in order {
        let placement = candidates[index].placement;
        if kept.iter().all(|other| angle_between(other, &placement) >= config.separation) {
            kept.push(placement);
            if kept.len() == config.num_hypotheses {
                break;
            }
        }
    }
    kept
}

fn keep_apart(hypotheses: Vec<Hypothesis>, config: &RegistrationConfig) -> Vec<Hypothesis> {
    let mut kept: Vec<Hypothesis> = Vec::new();
    for hypothesis in hypotheses {
        let near = |other: &Hypothesis| {
            angle_between(&other.placement, &hypothesis.placement) < 0.5 * config.separation
        };
        if !kept.iter().any(near) {
            kept.push(hypothesis);
        }
    }
    kept
}

/// The angle of the rotation between two placements.
fn angle_between(a: &Placement, b: &Placement) -> f64 {
    let relative: Matrix3<f64> = a.rotation() * b.rotation().transpose();
    (0.5 * (relative.trace() - 1.0)).clamp(-1.0, 1.0).acos()
}

/// The unit direction (LiDAR frame) and the class of a return.
type LabelledDirection = (Vector3<f64>, u8);

/// What the refinement compares: the labelled returns that win a pixel of a grid, and label images of its resolution.
struct Level<'a> {
    observations: &'a Observations,
    zoomed: &'a Zoomed<'a>,
    images: Downsampled,
    /// Unit direction and class of each return, frame after frame.
    returns: Vec<Vec<LabelledDirection>>,
}

impl<'a> Level<'a> {
    fn new(observations: &'a Observations, zoomed: &'a Zoomed, grid: SphericalGrid) -> Self {
        let labelled = |frame: &Frame| {
            let winners = grid.project(&frame.points).into_iter().filter(|&i| i != EMPTY);
            winners
                .map(|i| (to_f64(&frame.points[i as usize]).normalize(), frame.point_classes[i as usize]))
                .filter(|&(_, class)| class != NO_CLASS)
                .collect()
        };
        let returns = observations.frames.par_iter().map(labelled).collect();
        Self { observations, zoomed, images: downsampled(observations, zoomed, grid.cell_height), returns }
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
        for (frame, returns) in returns.iter().enumerate() {
            for (direction, class) in returns {
                if let Some(pixel) = pixel_of(direction) {
                    joint.add(*class, self.images.class(frame, &pixel), 1.0);
                }
            }
        }
        joint
    }
}

/// Powell's method from one placement: three angles, and the scale of the paper's zoomed picture.
fn refine(level: &Level, start: &Placement, config: &RegistrationConfig) -> Hypothesis {
    let reach = 1.5 * config.coarse_cell;
    let returns = level.near(start, 2.0 * reach);
    let least = config.min_overlap * level.joint(start, &returns).total();
    let objective = |placement: &Placement| {
        let joint = level.joint(placement, &returns);
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
    let joint = level.joint(&placement, &returns);
    Hypothesis {
        placement,
        mutual_information: joint.mutual_information() - joint.bias(),
        num_cells: joint.total(),
        joint,
    }
}

fn powell<const N: usize>(step: [f64; N]) -> PowellConfig<N> {
    PowellConfig { step, tolerance: POWELL_TOLERANCE, max_rounds: POWELL_ROUNDS }
}
