//! The pixels of the camera's label image in LiDAR directions (Alg. 2, lines 2-3).
//!
//! A [`Placement`] is the place of the image on the sphere, and maps LiDAR directions to raw pixels. The paper
//! zooms the image to the LiDAR's angular resolution, as if columns were azimuths and rows elevations. Exact
//! resampling transforms the direction to the camera frame and projects it through K and the distortion model. The
//! two agree on the axis of the image, and differ by several degrees at the border of a 90-degree lens.

use std::f64::consts::{PI, TAU};

use geometry::angles::{azimuth, elevation};
use geometry::camera::Camera;
use nalgebra::{Matrix3, Point2, Rotation3, Vector2, Vector3};

use crate::error::{Error, Result};

/// Number of steps from the border to the middle of the image, in the search for the limit of the lens.
const BORDER_STEPS: usize = 64;

/// Mapping of the label image to the angular grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Zoom {
    /// Mapping through K and the distortion model.
    Exact,
    /// The paper's mapping: proportional to azimuth and elevation.
    Paper,
}

/// Direction of the optical axis in the LiDAR frame, with the rotation and scale of the image about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub azimuth: f64,
    pub elevation: f64,
    /// Rotation of the image about the optical axis, radians; zero keeps its rows level.
    pub roll: f64,
    /// Magnification of the zoomed image; always one in exact resampling, which does not use it.
    pub scale: f64,
}

impl Placement {
    pub fn of_rotation(rotation: &Rotation3<f64>) -> Self {
        let forward: Vector3<f64> = rotation.matrix().row(2).transpose();
        let level =
            Self { azimuth: azimuth(&forward), elevation: elevation(&forward), roll: 0.0, scale: 1.0 };
        // The remaining rotation is about the optical axis.
        let turn = rotation * level.rotation().inverse();
        Self { roll: turn[(0, 1)].atan2(turn[(0, 0)]), ..level }
    }

    pub fn rotation(&self) -> Rotation3<f64> {
        let ((sin_a, cos_a), (sin_e, cos_e)) = (self.azimuth.sin_cos(), self.elevation.sin_cos());
        let right = Vector3::new(sin_a, -cos_a, 0.0);
        let forward = Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
        let down = forward.cross(&right);
        let (sin_r, cos_r) = self.roll.sin_cos();
        let x = right * cos_r + down * sin_r;
        let y = down * cos_r - right * sin_r;
        let rows = [x.transpose(), y.transpose(), forward.transpose()];
        Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows))
    }
}

/// A camera's image under one kind of zoom, which maps LiDAR directions to raw pixels.
#[derive(Clone, Debug)]
pub struct ZoomedImage<'a> {
    camera: &'a Camera,
    zoom: Zoom,
    /// Horizontal and vertical field of view, radians.
    fov: Vector2<f64>,
    /// Rays towards the corners and the middles of the sides, camera frame, as far as the lens reaches.
    border: Vec<Vector3<f64>>,
    /// Direction in the camera frame of a placement's azimuth and elevation.
    axis: Vector3<f64>,
}

impl<'a> ZoomedImage<'a> {
    pub fn new(camera: &'a Camera, zoom: Zoom) -> Result<Self> {
        let (center, _) = border_ray(camera, 0.0, 0.0)?;
        let sides = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)];
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        let mut border = Vec::with_capacity(sides.len() + corners.len());
        let mut angles = Vec::with_capacity(border.capacity());
        for (right, down) in sides.into_iter().chain(corners) {
            let (ray, reached) = border_ray(camera, right, down)?;
            border.push(ray);
            // Extrapolates the lens evenly beyond its limit.
            angles.push(ray.angle(&center) / reached);
        }
        let fov = Vector2::new(angles[0] + angles[1], angles[2] + angles[3]);
        // A placement's axis is the optical axis, except for the paper's zoom, where it is the middle of the image.
        let axis = if zoom == Zoom::Exact { Vector3::z() } else { center };
        Ok(Self { camera, zoom, fov, border, axis })
    }

    /// `R_camera_lidar`, with the camera rotated so that the axis of placements becomes the optical axis.
    pub fn onto_axis(&self, rotation: &Rotation3<f64>) -> Rotation3<f64> {
        Rotation3::rotation_between(&self.axis, &Vector3::z()).unwrap_or_default() * rotation
    }

    pub fn horizontal_fov(&self) -> f64 {
        self.fov.x
    }

    /// Angles by which an image with a level axis extends above and below it, radians. They are the largest
    /// possible if the lens sees to its sides or behind itself, since it then sees the horizon in any direction.
    pub fn above_below(&self, roll: f64) -> (f64, f64) {
        let (sin, cos) = roll.sin_cos();
        if self.zoom == Zoom::Paper {
            let half = 0.5 * (self.fov.x * sin.abs() + self.fov.y * cos.abs());
            return (half, half);
        }
        if self.border.iter().any(|ray| ray.z <= 0.0) {
            return (PI, PI);
        }
        let down = Vector3::new(sin, cos, 0.0);
        let below = self.border.iter().map(|ray| ray.dot(&down).atan2(ray.z));
        below.fold((0.0, 0.0), |(above, most), angle| (f64::max(above, -angle), f64::max(most, angle)))
    }

    /// Largest angle between the axis and a ray of the image, radians.
    pub fn reach(&self) -> f64 {
        self.border.iter().map(|ray| ray.angle(&self.axis)).fold(0.0, f64::max)
    }

    /// Maps LiDAR directions to raw pixels, with the image at a placement.
    pub fn pixel_map(&self, placement: &Placement) -> PixelMap<'_> {
        PixelMap {
            image: self,
            placement: *placement,
            rotation: placement.rotation(),
            roll: placement.roll.sin_cos(),
            size: Vector2::new(self.camera.width as f64, self.camera.height as f64),
        }
    }
}

/// A map of LiDAR directions to raw pixels.
pub struct PixelMap<'a> {
    image: &'a ZoomedImage<'a>,
    placement: Placement,
    rotation: Rotation3<f64>,
    /// Sine and cosine of the roll.
    roll: (f64, f64),
    /// Columns and rows of the image.
    size: Vector2<f64>,
}

impl PixelMap<'_> {
    /// The pixel of a direction; `None` outside the image.
    #[inline(always)]
    pub fn at(&self, direction: &Vector3<f64>) -> Option<Point2<f64>> {
        let Self { image: ZoomedImage { camera, zoom, fov, .. }, placement, roll: (sin, cos), .. } = self;
        let pixel = match zoom {
            Zoom::Exact => camera.project(&(self.rotation * direction))?,
            Zoom::Paper => {
                let right = wrap(placement.azimuth - azimuth(direction));
                let down = placement.elevation - elevation(direction);
                let turned = Vector2::new(cos * right + sin * down, cos * down - sin * right);
                let share = turned.component_div(fov) * placement.scale;
                Point2::from((share.add_scalar(0.5)).component_mul(&self.size).add_scalar(-0.5))
            }
        };
        camera.contains(&pixel).then_some(pixel)
    }
}

/// The ray at a place of the image, given from -1 (left, top) to 1 (right, bottom), and the fraction of the way
/// from the middle that the lens reaches: a circular fisheye leaves the border dark.
fn border_ray(camera: &Camera, right: f64, down: f64) -> Result<(Vector3<f64>, f64)> {
    let half = Vector2::new(camera.width as f64 - 1.0, camera.height as f64 - 1.0) * 0.5;
    let pixel = |share: f64| Point2::from(half + half.component_mul(&Vector2::new(right, down)) * share);
    let shares = (1..=BORDER_STEPS).rev().map(|step| step as f64 / BORDER_STEPS as f64);
    let reached = |share| camera.unproject(&pixel(share)).map(|ray| (ray, share));
    shares.into_iter().find_map(reached).ok_or_else(|| {
        let middle = pixel(0.0);
        Error::Input(format!(
            "camera: the lens model does not reach pixel ({:.0}, {:.0}) at the middle of the image",
            middle.x, middle.y
        ))
    })
}

/// An angle in (-pi, pi].
fn wrap(angle: f64) -> f64 {
    PI - (PI - angle).rem_euclid(TAU)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::angles::from_angles;
    use proptest::prelude::*;

    fn camera(focal: f64) -> Camera {
        let k = [[focal, 0.0, 639.5], [0.0, focal, 359.5], [0.0, 0.0, 1.0]];
        Camera::new("plumb_bob", (1280, 720), k, &[]).expect("a valid camera")
    }

    #[test]
    fn zooms_agree_on_the_axis_and_part_at_the_border() {
        let camera = camera(640.0);
        let placement = Placement { azimuth: 0.3, elevation: 0.0, roll: 0.0, scale: 1.0 };
        let pixel = |zoom, right_deg: f64| {
            let direction = from_angles(0.3 - right_deg.to_radians(), 0.0);
            let zoomed = ZoomedImage::new(&camera, zoom).expect("an image");
            zoomed.pixel_map(&placement).at(&direction).expect("inside").x
        };
        assert!((pixel(Zoom::Exact, 0.0) - pixel(Zoom::Paper, 0.0)).abs() < 1e-9);
        // At 25 degrees of a 90-degree lens: 640 tan(25) = 298 pixels against 25/90 * 1280 = 356.
        assert!((pixel(Zoom::Exact, 25.0) - 639.5 - 298.4).abs() < 1.0);
        assert!((pixel(Zoom::Paper, 25.0) - 639.5 - 355.6).abs() < 1.0);
    }

    #[test]
    fn a_circular_fisheye_is_seen_as_far_as_it_reaches() {
        let k = [[300.0, 0.0, 639.5], [0.0, 300.0, 359.5], [0.0, 0.0, 1.0]];
        // The image radius grows up to where the derivative 1 - 0.3 angle^2 is zero, and ends there.
        let camera = Camera::new("fisheye", (1280, 720), k, &[-0.1, 0.0, 0.0, 0.0]).expect("a valid camera");
        let zoomed = ZoomedImage::new(&camera, Zoom::Exact).expect("an image");
        let limit = (1.0f64 / 0.3).sqrt();
        assert!(zoomed.reach() < limit && zoomed.reach() > 0.85 * limit, "{} of {limit}", zoomed.reach());
    }

    proptest! {
        #[test]
        fn the_axis_looks_where_azimuth_and_elevation_say(a in -3.1..3.1f64, e in -1.5..1.5f64, r in -3.1..3.1f64) {
            let rotation = Placement { azimuth: a, elevation: e, roll: r, scale: 1.0 }.rotation();
            let forward: Vector3<f64> = rotation.matrix().row(2).transpose();
            let again = Placement::of_rotation(&rotation);
            prop_assert!((again.azimuth - a).abs() < 1e-6 && (again.elevation - e).abs() < 1e-6);
            prop_assert!((again.roll - r).abs() < 1e-6);
            prop_assert!((forward - from_angles(a, e)).norm() < 1e-9);
            prop_assert!((rotation.matrix() * rotation.matrix().transpose() - Matrix3::identity()).norm() < 1e-9);
            prop_assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_cropped_image_reaches_farther_on_one_side() {
        let k = [[640.0, 0.0, 200.0], [0.0, 640.0, 100.0], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (1280, 720), k, &[]).expect("a valid camera");
        let zoomed = ZoomedImage::new(&camera, Zoom::Exact).expect("an image");
        let (above, below) = zoomed.above_below(0.0);
        assert!(
            (above - (100.0f64 / 640.0).atan()).abs() < 0.01
                && (below - (619.0f64 / 640.0).atan()).abs() < 0.01
        );
        assert!((zoomed.reach() - (1079.0f64.hypot(619.0) / 640.0).atan()).abs() < 1e-9);
    }
}
