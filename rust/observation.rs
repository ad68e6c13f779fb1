//! The input of the pipeline: labelled points and label images with dense class ids.
//!
//! The points of a sweep have partitions: one into its segments, and null partitions that are independent of the
//! image.
//!
//! The mutual information of segments and image classes grows where the image is rich, whatever the pose, and so
//! need not have its maximum at the true one. A null partition has the same segments in another place, as if the
//! sweep had been rotated (a spin test: Alexander-Bloch et al., NeuroImage 2018). Its mutual information with the
//! image is what any partition of that kind would have. See `alignment/adjusted.rs` for the score.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use geometry::camera::Camera;
use nalgebra::Vector3;

use crate::classes::{ClassShares, NO_CLASS};
use crate::error::{Error, Result};

#[cfg(test)]
use crate::label_image::LabelImage;
use crate::pyramid::LabelPyramid;
use crate::visibility::Sweep;

/// A sweep and an image taken at the same time. A clone shares all arrays. Frames that differ in one array, such as
/// in the label image for one cloud, share the others.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Points in metres, LiDAR frame.
    pub points: Arc<Sweep>,
    pub point_classes: Arc<Vec<u8>>,
    /// Classes of the pixels, with their levels.
    pub image: Arc<LabelPyramid>,
    /// Class shares of each point, if a network gave them; `classes` then holds the largest. A point of
    /// [`NO_CLASS`] carries no information, whatever its shares.
    pub point_shares: Option<Arc<ClassShares>>,
    /// Segments of the points, which replace their classes when a pose is refined.
    pub partitions: Option<Arc<Partitions>>,
    /// Weight of each point of the frame when a pose is refined.
    pub weight: f32,
    /// Number of the scene that the frame shows, if others show it, too: they are no further evidence.
    pub scene: Option<u32>,
    /// Class of points that only count when a pose is polished: see `Level::select_for_newton`.
    pub plain_class: Option<u8>,
}

impl Frame {
    /// Whether a point has a class.
    pub fn has_class(&self, point: usize) -> bool {
        self.point_classes[point] != NO_CLASS
    }

    /// A frame for tests, without class shares.
    #[cfg(test)]
    pub fn certain(points: Vec<[f32; 3]>, point_classes: Vec<u8>, image_classes: LabelImage<u8>) -> Self {
        Self {
            points: Arc::new(points.into()),
            point_classes: point_classes.into(),
            image: Arc::new(LabelPyramid::new(image_classes.into(), None, None)),
            point_shares: None,
            partitions: None,
            weight: 1.0,
            scene: None,
            plain_class: None,
        }
    }
}

/// All frames of a drive, seen by one camera.
#[derive(Clone, Debug)]
pub struct Observations {
    pub camera: Camera,
    pub frames: Vec<Frame>,
    /// Point classes are `0..num_point_classes`, or [`NO_CLASS`].
    pub num_point_classes: usize,
    /// Image classes are `0..num_image_classes`, or [`NO_CLASS`].
    pub num_image_classes: usize,
    /// Maximum distance between camera and LiDAR at which every solver holds a pose, metres.
    pub max_baseline_m: f64,
    /// Pixels closer than this to another class have low weight in every objective: see `ShareMap`.
    pub edge_band_px: usize,
    /// Where the rays start, metres, LiDAR frame.
    pub origin: Vector3<f64>,
    first_rows: Vec<usize>,
    /// Number of rows of the joint histogram: classes, and the segments of each frame in each of its partitions.
    pub num_rows: usize,
}

impl Observations {
    /// Checks that frames, classes and camera are consistent. The baseline has no limit, and there is no edge band.
    ///
    /// # Errors
    /// There is no frame, counts or sizes disagree, or a class is out of range.
    pub fn new(
        camera: Camera,
        frames: Vec<Frame>,
        num_point_classes: usize,
        num_image_classes: usize,
    ) -> Result<Self> {
        if frames.is_empty() {
            return Err(Error::Input("a calibration needs at least one frame".into()));
        }
        for (index, frame) in frames.iter().enumerate() {
            let (points, image) = (frame.points.len(), &frame.image.classes);
            let complaint = if points != frame.point_classes.len() {
                format!("{points} points have {} classes", frame.point_classes.len())
            } else if (image.width, image.height) != (camera.width, camera.height) {
                format!(
                    "the label image is {} x {}, the camera is {} x {}",
                    image.width, image.height, camera.width, camera.height
                )
            } else if !in_range(&frame.point_classes, num_point_classes) {
                format!("a point's class is not below {num_point_classes}")
            } else if !in_range(&image.ids, num_image_classes) {
                format!("a pixel's class is not below {num_image_classes}")
            } else if !fits(frame.point_shares.as_deref(), points, num_point_classes) {
                format!(
                    "{points} points need the same number of shares, of classes below {num_point_classes}"
                )
            } else if !fits(frame.image.shares.as_deref(), image.ids.len(), num_image_classes) {
                format!(
                    "{} pixels need the same number of shares, of classes below {num_image_classes}",
                    image.ids.len()
                )
            } else if frame.partitions.as_ref().is_some_and(|found| found.num_points() != points) {
                format!("{points} points need the same number of segments")
            } else {
                continue;
            };
            return Err(Error::Input(format!("frame {index}: {complaint}")));
        }
        let found = Self {
            camera,
            frames: Vec::new(),
            num_point_classes,
            num_image_classes,
            max_baseline_m: f64::INFINITY,
            edge_band_px: 0,
            origin: Vector3::zeros(),
            first_rows: Vec::new(),
            num_rows: 0,
        };
        Ok(found.with_frames(frames))
    }

    /// Observations of other frames with the same classes.
    pub fn with_frames(&self, frames: Vec<Frame>) -> Self {
        let mut num_rows = self.num_point_classes;
        let first_row = |frame: &Frame| {
            let first = num_rows;
            num_rows += frame.partitions.as_ref().map_or(0, |found| found.num_rows);
            first
        };
        let first_rows = frames.iter().map(first_row).collect();
        Self { camera: self.camera.clone(), frames, first_rows, num_rows, ..*self }
    }

    /// Calls `with` with each row of the joint histogram to which a point contributes: that of its class, or those
    /// of its segments.
    #[inline(always)]
    pub fn for_rows(&self, frame: usize, point: usize, class: u8, mut with: impl FnMut(usize)) {
        match &self.frames[frame].partitions {
            None => with(usize::from(class)),
            Some(partitions) => self.for_segments(partitions, frame, point, &mut with),
        }
    }

    /// Calls `with` with the rows of a point's segments. This is a function of its own, so that the loop over points
    /// without segments stays small.
    #[inline(never)]
    fn for_segments(&self, partitions: &Partitions, frame: usize, point: usize, with: &mut dyn FnMut(usize)) {
        partitions.rows(point).iter().for_each(|&row| with(self.first_rows[frame] + usize::from(row)));
    }

    /// The number of the scene of a frame. Standard errors sum over the frames of a scene before they are squared.
    pub fn scene_of(&self, frame: u32) -> u32 {
        self.frames[frame as usize].scene.unwrap_or(frame)
    }

    pub fn num_scenes(&self) -> usize {
        (0..self.frames.len() as u32).map(|frame| self.scene_of(frame)).collect::<BTreeSet<_>>().len()
    }

    pub fn has_partitions(&self) -> bool {
        self.num_rows > self.num_point_classes
    }

    /// The rows of a range of frames.
    pub fn rows_of(&self, frames: Range<usize>) -> Range<usize> {
        let end = self.first_rows.get(frames.end).copied().unwrap_or(self.num_rows);
        let has_partitions = |frame: &Frame| frame.partitions.is_some();
        let among = &self.frames[frames.clone()];
        if among.iter().all(has_partitions) {
            self.first_rows[frames.start]..end
        } else if among.iter().any(has_partitions) {
            0..end
        } else {
            0..self.num_point_classes
        }
    }

    pub fn partition_rows(&self) -> impl Iterator<Item = PartitionRows> {
        let of_frame = |(frame, &first): (&Frame, &usize)| {
            let partitions = frame.partitions.as_ref()?;
            let first_null = first + partitions.num_segments;
            let nulls = first_null..first + partitions.num_rows;
            Some(PartitionRows {
                segments: first..first_null,
                nulls,
                num_nulls: partitions.num_partitions() - 1,
            })
        };
        self.frames.iter().zip(&self.first_rows).filter_map(of_frame)
    }
}

/// Rows of a joint histogram that hold the partitions of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PartitionRows {
    pub segments: Range<usize>,
    pub nulls: Range<usize>,
    pub num_nulls: usize,
}

fn fits(shares: Option<&ClassShares>, count: usize, num_classes: usize) -> bool {
    shares.is_none_or(|shares| {
        let classes = shares.entries().iter().map(|share| share.class);
        let needed = classes.fold(0, |needed: u16, class| needed.max(u16::from(class) + 1));
        shares.len() == count && usize::from(needed) <= num_classes
    })
}

/// Whether all ids except [`NO_CLASS`] are below a number. Every subset of a drive is checked: without an early
/// exit this takes no longer than reading the memory.
fn in_range(ids: &[u8], num_classes: usize) -> bool {
    // One more than the class, and zero for NO_CLASS.
    let needed = ids.iter().fold(0, |needed: u8, id| needed.max(id.wrapping_sub(NO_CLASS)));
    usize::from(needed) <= num_classes
}

/// The segment of each point in each partition, as rows of a joint histogram.
#[derive(Clone, Debug)]
pub struct Partitions {
    /// For each point, the row of its segment and the rows of its segments in the null partitions.
    rows: Vec<u16>,
    num_partitions: usize,
    /// Number of rows of the segments; those of the null partitions follow.
    pub num_segments: usize,
    /// Number of rows of all partitions.
    pub num_rows: usize,
}

impl Partitions {
    /// Takes `num_partitions` segment ids for each point, the first of which is its own, out of `num_segments` in
    /// each partition.
    pub fn new(ids: &[u32], num_segments: usize, num_partitions: usize) -> Result<Self> {
        let num_rows = num_segments * num_partitions;
        if num_partitions < 2 || !ids.len().is_multiple_of(num_partitions) {
            let found = format!("found {} ids of {num_partitions} partitions", ids.len());
            return Err(Error::Input(format!(
                "{found}, expected a null partition and all ids of each point"
            )));
        }
        if num_rows > usize::from(u16::MAX) {
            let most = usize::from(u16::MAX) / num_partitions;
            return Err(Error::Input(format!(
                "found {num_segments} segments in a sweep, needed at most {most}"
            )));
        }
        let row = |(index, &id): (usize, &u32)| (index % num_partitions * num_segments) as u16 + id as u16;
        Ok(Self { rows: ids.iter().enumerate().map(row).collect(), num_partitions, num_segments, num_rows })
    }

    pub fn num_points(&self) -> usize {
        self.rows.len() / self.num_partitions
    }

    /// Number of partitions, including the one into segments.
    pub fn num_partitions(&self) -> usize {
        self.num_partitions
    }

    pub fn rows(&self, point: usize) -> &[u16] {
        &self.rows[point * self.num_partitions..][..self.num_partitions]
    }

    /// The partitions of a subset of the points, with rows for their segments only. A sweep without segments has
    /// none.
    pub fn of_points(&self, points: &[usize]) -> Self {
        let mut rows: Vec<u16> = points.iter().flat_map(|&point| self.rows(point)).copied().collect();
        let mut numbers = vec![None; self.num_rows];
        for &row in &rows {
            if let Some(number) = numbers.get_mut(usize::from(row)) {
                *number = Some(0);
            }
        }
        let (mut num_rows, mut num_segments) = (0, 0);
        for (row, number) in numbers.iter_mut().enumerate() {
            if let Some(number) = number {
                *number = num_rows as u16;
                num_rows += 1;
                num_segments += usize::from(row < self.num_segments);
            }
        }
        for row in &mut rows {
            *row = numbers.get(usize::from(*row)).copied().flatten().unwrap_or(0);
        }
        Self { rows, num_partitions: self.num_partitions, num_segments, num_rows }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_points_keep_their_segments_under_new_numbers() {
        let all = Partitions::new(&[0, 2, 3, 1, 2, 2, 0, 1], 4, 2).expect("two ids for each point");
        assert_eq!((all.num_points(), all.num_rows, all.rows(1)), (4, 8, &[3, 5][..]));
        let some = all.of_points(&[1, 3]);
        assert_eq!((some.num_segments, some.num_rows), (2, 3));
        assert_eq!((some.rows(0), some.rows(1)), (&[1, 2][..], &[0, 2][..]));
    }

    #[test]
    fn a_sweep_without_segments_has_no_rows() {
        let all = Partitions::new(&[0, 0, 0, 0], 0, 2).expect("two ids for each point");
        assert_eq!((all.num_points(), all.num_rows), (2, 0));
        let some = all.of_points(&[1]);
        assert_eq!((some.num_points(), some.num_rows, some.num_segments), (1, 0, 0));
    }
}
