//! Choice of a lens by the name of its model.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::model::Model;
use super::polynomial::{Polynomial, ThinPrism};
use super::radial::{Fisheye, Fov};
use super::spheres::Equirectangular;
use super::spheres::{DoubleSphere, Omnidirectional};
use crate::Invalid;

/// Any lens. An enum, so that the hot loops take the same branch every time, and inline.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Lens {
    Polynomial(Polynomial),
    ThinPrism(ThinPrism),
    Fisheye(Fisheye),
    Omnidirectional(Omnidirectional),
    Equirectangular(Equirectangular),
    Fov(Fov),
    DoubleSphere(DoubleSphere),
}

impl Lens {
    /// The lens of a `model`; `left` is the distorted coordinate of the image's left border.
    pub fn new(
        model: &str,
        distortion: &[f64],
        parameters: &[(String, f64)],
        left: f64,
    ) -> Result<Self, Invalid> {
        let lens = match (model, distortion.len()) {
            ("plumb_bob", 0 | 4 | 5) | ("rational_polynomial", 0 | 8) => {
                Self::Polynomial(Polynomial::new(padded(distortion)))
            }
            ("thin_prism", 0 | 12 | 14) => Self::ThinPrism(ThinPrism::new(padded(distortion))?),
            ("fisheye", 0 | 4) => Self::Fisheye(Fisheye::new(padded(distortion))),
            ("omnidirectional", 0 | 4) => {
                let [xi] = named(model, parameters, ["xi"])?;
                return Omnidirectional::new(xi, padded(distortion)).map(Self::Omnidirectional);
            }
            ("equirectangular", 0) => Self::Equirectangular(Equirectangular::new(left)),
            ("fov", 1) => Self::Fov(Fov::new(distortion[0])?),
            ("double_sphere", 0) => {
                let [xi, alpha] = named(model, parameters, ["xi", "alpha"])?;
                return DoubleSphere::new(xi, alpha).map(Self::DoubleSphere);
            }
            _ => {
                return Err(Invalid(format!(
                    "camera: model {model} with {} distortion coefficients is not known",
                    distortion.len()
                )));
            }
        };
        named(model, parameters, []).map(|[]| lens)
    }
}

/// The given coefficients, padded with zeros.
fn padded<const N: usize>(distortion: &[f64]) -> [f64; N] {
    let mut coefficients = [0.0; N];
    for (all, given) in coefficients.iter_mut().zip(distortion) {
        *all = *given;
    }
    coefficients
}

/// The parameters of these names, if there are no others.
fn named<const N: usize>(
    model: &str,
    given: &[(String, f64)],
    names: [&str; N],
) -> Result<[f64; N], Invalid> {
    let value = |name: &str| given.iter().find(|(key, _)| key == name).map(|(_, value)| *value);
    let values: Option<Vec<f64>> = names.into_iter().map(value).collect();
    let complete = values.filter(|_| given.len() == N).and_then(|values| values.try_into().ok());
    complete.ok_or_else(|| {
        let found: Vec<&str> = given.iter().map(|(key, _)| key.as_str()).collect();
        Invalid(format!("camera.parameters: found {found:?}, expected {names:?} for {model}"))
    })
}

macro_rules! with_model {
    ($lens:expr, $model:ident => $call:expr) => {
        match $lens {
            Lens::Polynomial($model) => $call,
            Lens::ThinPrism($model) => $call,
            Lens::Fisheye($model) => $call,
            Lens::Omnidirectional($model) => $call,
            Lens::Equirectangular($model) => $call,
            Lens::Fov($model) => $call,
            Lens::DoubleSphere($model) => $call,
        }
    };
}

impl Model for Lens {
    #[inline(always)]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        with_model!(self, model => model.project(point))
    }

    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        with_model!(self, model => model.jacobian(point))
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        with_model!(self, model => model.unproject(distorted))
    }

    fn limit(&self) -> f64 {
        with_model!(self, model => model.limit())
    }
}
