//! Intrinsics that may be estimated: their values, cameras with other ones, and how pixels move with them.

use nalgebra::{Point2, Vector2, Vector3};

use super::Camera;
use crate::error::{Error, Result};

/// Step by which a coefficient of a lens is changed for the derivative of pixels with respect to it.
const STEP: f64 = 1e-4;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intrinsic {
    Fx,
    Fy,
    Cx,
    Cy,
    /// A small radial distortion on top of whatever the lens does, to first order. No camera has it, so that it only tells
    /// what a distortion would do.
    Radial,
    /// A number of the lens by its index: distortion coefficients in their order, and then parameters.
    Coefficient(usize),
}

impl Intrinsic {
    /// The intrinsic of a name: fx, fy, cx, cy, radial, or the index of a number of the lens.
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
    /// The value of an intrinsic; nothing if the lens has no such number.
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
    pub fn radial_slope(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let place: Vector2<f64> = (pixel.coords - self.center).component_div(&self.focal);
        self.focal.component_mul(&place) * place.norm_squared()
    }

    /// The camera with some intrinsics changed; [`Intrinsic::Radial`] changes nothing.
    pub fn changed(&self, changes: impl IntoIterator<Item = (Intrinsic, f64)>) -> Result<Self> {
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
            *number.ok_or_else(|| Error::Input(format!("camera: the lens has no {intrinsic:?}")))? += by;
        }
        // How far a lens does not fold takes long to find out, and depends on K for none but this.
        let is_same_lens = distortion == self.distortion && parameters == self.parameters;
        if is_same_lens && &*self.model != "equirectangular" && is_possible(&focal, &center) {
            return Ok(Self { focal, center, ..self.clone() });
        }
        let size = (self.width, self.height);
        let k = [[focal.x, 0.0, center.x], [0.0, focal.y, center.y], [0.0, 0.0, 1.0]];
        Self::with_parameters(&self.model, size, k, &distortion, &parameters)
    }
}

fn is_possible(focal: &Vector2<f64>, center: &Vector2<f64>) -> bool {
    focal.iter().chain(center).all(|x| x.is_finite()) && focal.min() > 0.0
}

/// How pixels of a camera move with some of its intrinsics.
#[derive(Clone, Debug)]
pub struct IntrinsicSlopes {
    /// For each intrinsic, the cameras to both sides of it, where the lens changes with it.
    slopes: Vec<(Intrinsic, Option<[Camera; 2]>)>,
}

impl IntrinsicSlopes {
    /// Prepares the slopes.
    pub fn new(camera: &Camera, intrinsics: &[Intrinsic]) -> Result<Self> {
        let of = |&intrinsic: &Intrinsic| {
            let Intrinsic::Coefficient(_) = intrinsic else { return Ok((intrinsic, None)) };
            if camera.intrinsic(intrinsic).is_none() {
                return Err(Error::Input(format!("camera: the lens has no {intrinsic:?}")));
            }
            // At the end of its range a number has a neighbour to one side only.
            let beside = |by: f64| camera.changed([(intrinsic, by)]).unwrap_or_else(|_| camera.clone());
            Ok((intrinsic, Some([beside(-STEP), beside(STEP)])))
        };
        Ok(Self { slopes: intrinsics.iter().map(of).collect::<Result<_>>()? })
    }

    /// The derivatives of the pixel of a point (camera frame), one after another, pixels for each unit.
    pub fn for_each(
        &self,
        camera: &Camera,
        p_camera: &Vector3<f64>,
        pixel: &Point2<f64>,
        mut with: impl FnMut(usize, Vector2<f64>),
    ) {
        let place: Vector2<f64> = (pixel.coords - camera.center).component_div(&camera.focal);
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

/// The difference of the pixels of two cameras for each unit of the intrinsic that they differ in; zero where one of them
/// does not project the point.
fn difference(sides: &[Camera; 2], p_camera: &Vector3<f64>, intrinsic: Intrinsic) -> Vector2<f64> {
    let [before, after] = sides;
    let apart = |camera: &Camera| camera.intrinsic(intrinsic).unwrap_or(0.0);
    match (before.project(p_camera), after.project(p_camera)) {
        (Some(a), Some(b)) => (b - a) / (apart(after) - apart(before)),
        _ => Vector2::zeros(),
    }
}
