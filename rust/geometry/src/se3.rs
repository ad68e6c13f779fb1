//! Rigid motions by the exponential map (eq. 3).

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, Vector6};

/// Rotation, radians, below which the series of the left Jacobian replaces its closed form.
const SMALL_ANGLE: f64 = 1e-6;

/// The rigid motion of a twist `(rho, phi)`, metres and radians: rotation `exp(phi)`, translation `V(phi) rho`.
#[inline]
pub fn exp(twist: &Vector6<f64>) -> Isometry3<f64> {
    let rho: Vector3<f64> = twist.fixed_rows::<3>(0).into();
    let phi: Vector3<f64> = twist.fixed_rows::<3>(3).into();
    let angle = phi.norm();
    let (a, b) = if angle < SMALL_ANGLE {
        (0.5, 1.0 / 6.0)
    } else {
        let angle2 = angle * angle;
        ((1.0 - angle.cos()) / angle2, (angle - angle.sin()) / (angle2 * angle))
    };
    let translation = rho + phi.cross(&rho) * a + phi.cross(&phi.cross(&rho)) * b;
    Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_scaled_axis(phi))
}

/// The twist of a rigid motion, the inverse of [`exp`]: `phi` is at most half a turn, `rho = V(phi)^-1 t`.
#[inline]
pub fn log(motion: &Isometry3<f64>) -> Vector6<f64> {
    let phi = motion.rotation.scaled_axis();
    let t = motion.translation.vector;
    let angle = phi.norm();
    let b = if angle < SMALL_ANGLE {
        1.0 / 12.0
    } else {
        (1.0 - 0.5 * angle * (0.5 * angle).cos() / (0.5 * angle).sin()) / (angle * angle)
    };
    let rho = t - phi.cross(&t) * 0.5 + phi.cross(&phi.cross(&t)) * b;
    Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;
    use proptest::prelude::*;

    /// The matrix exponential of the twist's generator.
    fn by_series(twist: &Vector6<f64>) -> Matrix4<f64> {
        let [x, y, z, a, b, c]: [f64; 6] = (*twist).into();
        let generator = Matrix4::new(0.0, -c, b, x, c, 0.0, -a, y, -b, a, 0.0, z, 0.0, 0.0, 0.0, 0.0);
        generator.exp()
    }

    proptest! {
        #[test]
        fn exp_is_the_matrix_exponential(twist in prop::array::uniform6(-2.0..2.0f64), scale in -9..1) {
            let mut twist = Vector6::from(twist);
            for i in 3..6 {
                twist[i] *= 10f64.powi(scale);
            }
            prop_assert!((exp(&twist).to_homogeneous() - by_series(&twist)).norm() < 1e-9);
        }

        #[test]
        fn log_is_the_inverse_of_exp(twist in prop::array::uniform6(-1.7..1.7f64), scale in -9..1) {
            let mut twist = Vector6::from(twist);
            for i in 3..6 {
                twist[i] *= 10f64.powi(scale);
            }
            prop_assert!((log(&exp(&twist)) - twist).norm() < 1e-9);
        }
    }
}
