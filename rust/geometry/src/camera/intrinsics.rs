//! Intrinsics that may be estimated: their values, cameras with changed values, and the derivatives of pixels.

use nalgebra::{Point2, Vector2, Vector3};

use super::Camera;
use crate::Invalid;

/// Step of a lens coefficient for the numeric derivative of pixels.
const STEP: f64 = 1e-4;

/// A number of a camera that may be estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intrinsic {
    /// Horizontal focal length, pixels.
    Fx,
    /// Vertical focal length, pixels.
    Fy,
    /// Column of the principal point.
    Cx,
    /// Row of the principal point.
    Cy,
    /// A small radial distortion on top of the lens, to first order. No camera has this parameter; it only shows
    /// the effect of a distortion.
    Radial,
    /// A number of the lens by its index: distortion coefficients in their order, then parameters.
    Coefficient(usize),
}

impl Intrinsic {
    /// Parses an intrinsic: fx, fy, cx, cy, radial, or the index of a number of the lens.
    pub fn of(name: &str) -> Option<Self> {
        match name {
            "fx" => Some(Self::Fx),
            "fy" => Some(Self::Fy),
            "cx" => Some(Self::Cx),
            "cy" => Some(Self::Cy),
            "radial" => Some(Self::Radial),
            index => index.parse().ok().map(Self::Coefficient),
        }
    }
}

impl Camera {
    /// The value of an intrinsic; `None` if the lens has no such number.
    #[inline]
    pub fn intrinsic(&self, intrinsic: Intrinsic) -> Option<f64> {
        match intrinsic {
            Intrinsic::Fx => Some(self.focal.x),
            Intrinsic::Fy => Some(self.focal.y),
            Intrinsic::Cx => Some(self.center.x),
            Intrinsic::Cy => Some(self.center.y),
            Intrinsic::Radial => Some(0.0),
            Intrinsic::Coefficient(index) => {
                let numbers = self.distortion.iter().chain(self.parameters.iter().map(|(_, value)| value));
                numbers.copied().nth(index)
            }
        }
    }

    /// The derivative of a pixel with respect to [`Intrinsic::Radial`], pixels.
    #[inline]
    pub fn radial_slope(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let place = self.distorted(pixel);
        self.scaled(&place) * place.norm_squared()
    }

    /// The camera with some intrinsics changed; [`Intrinsic::Radial`] changes nothing.
    pub fn changed(&self, changes: impl IntoIterator<Item = (Intrinsic, f64)>) -> Result<Self, Invalid> {
        let (mut focal, mut center) = (self.focal, self.center);
        let (mut distortion, mut parameters) = (self.distortion.clone(), self.parameters.clone());
        for (intrinsic, by) in changes {
            let number = match intrinsic {
                Intrinsic::Fx => Some(&mut focal.x),
                Intrinsic::Fy => Some(&mut focal.y),
                Intrinsic::Cx => Some(&mut center.x),
                Intrinsic::Cy => Some(&mut center.y),
                Intrinsic::Radial => continue,
                Intrinsic::Coefficient(index) => {
                    distortion.iter_mut().chain(parameters.iter_mut().map(|(_, value)| value)).nth(index)
                }
            };
            *number.ok_or_else(|| Invalid(format!("camera: the lens has no {intrinsic:?}")))? += by;
        }
        // The radius up to which a lens does not fold takes long to compute, and depends on K only for this model.
        let is_same_lens = distortion == self.distortion && parameters == self.parameters;
        if is_same_lens && &*self.model != "equirectangular" && is_possible(&focal, &center) {
            return Ok(Self { focal, center, ..self.clone() });
        }
        let size = (self.width, self.height);
        let k = [[focal.x, self.skew, center.x], [0.0, focal.y, center.y], [0.0, 0.0, 1.0]];
        Self::with_parameters(&self.model, size, k, &distortion, &parameters)
    }
}

fn is_possible(focal: &Vector2<f64>, center: &Vector2<f64>) -> bool {
    focal.iter().chain(center).all(|x| x.is_finite()) && focal.min() > 0.0
}

/// Derivatives of a camera's pixels with respect to some of its intrinsics.
#[derive(Clone, Debug)]
pub struct IntrinsicSlopes {
    /// For each intrinsic that changes the lens, the cameras to both sides of its value.
    slopes: Vec<(Intrinsic, Option<[Camera; 2]>)>,
}

impl IntrinsicSlopes {
    /// Prepares the slopes.
    pub fn new(camera: &Camera, intrinsics: &[Intrinsic]) -> Result<Self, Invalid> {
        let of = |&intrinsic: &Intrinsic| {
            let Intrinsic::Coefficient(_) = intrinsic else { return Ok((intrinsic, None)) };
            if camera.intrinsic(intrinsic).is_none() {
                return Err(Invalid(format!("camera: the lens has no {intrinsic:?}")));
            }
            // At the end of its range a number has a neighbour on one side only.
            let beside = |by: f64| camera.changed([(intrinsic, by)]).unwrap_or_else(|_| camera.clone());
            Ok((intrinsic, Some([beside(-STEP), beside(STEP)])))
        };
        Ok(Self { slopes: intrinsics.iter().map(of).collect::<Result<_, Invalid>>()? })
    }

    /// Calls the closure with the derivatives of the pixel of a point (camera frame), one after another, in pixels
    /// per unit.
    pub fn for_each(
        &self,
        camera: &Camera,
        p_camera: &Vector3<f64>,
        pixel: &Point2<f64>,
        mut with: impl FnMut(usize, Vector2<f64>),
    ) {
        let place = camera.distorted(pixel);
        for (index, (intrinsic, sides)) in self.slopes.iter().enumerate() {
            let slope = match intrinsic {
                Intrinsic::Fx => Vector2::new(place.x, 0.0),
                Intrinsic::Fy => Vector2::new(0.0, place.y),
                Intrinsic::Cx => Vector2::x(),
                Intrinsic::Cy => Vector2::y(),
                Intrinsic::Radial => camera.radial_slope(pixel),
                Intrinsic::Coefficient(_) => sides
                    .as_ref()
                    .map_or_else(Vector2::zeros, |sides| difference(sides, p_camera, *intrinsic)),
            };
            with(index, slope);
        }
    }
}

/// Difference of the pixels of two cameras per unit of the intrinsic in which they differ; zero if one of them does
/// not project the point.
#[inline]
fn difference(sides: &[Camera; 2], p_camera: &Vector3<f64>, intrinsic: Intrinsic) -> Vector2<f64> {
    let [before, after] = sides;
    let apart = |camera: &Camera| camera.intrinsic(intrinsic).unwrap_or(0.0);
    match (before.project(p_camera), after.project(p_camera)) {
        (Some(a), Some(b)) => (b - a) / (apart(after) - apart(before)),
        _ => Vector2::zeros(),
    }
}
