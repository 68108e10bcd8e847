//! The same tick as one writes it without this project: nalgebra's isometries and SVD, libm's sine and cosine.
//!
//! Here only to be counted beside the core's.

use nalgebra::{Isometry3, SMatrix, SVector, Translation3, Unit, UnitQuaternion, Vector3};

/// A 7-DoF human arm as nalgebra has it.
#[derive(Clone, Debug)]
pub struct PlainArm {
    offsets: [Translation3<f32>; 7],
    axes: [Unit<Vector3<f32>>; 7],
    hand: Translation3<f32>,
}

/// The five steppers' formulas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Jᵀ.
    Transpose,
    /// NJᵀ.
    NormalisedTranspose,
    /// J⁺.
    PseudoInverse,
    /// Damped least squares.
    Damped,
}

impl PlainArm {
    /// Segment lengths in metres.
    pub fn new([upper_arm, forearm, hand]: [f32; 3]) -> Self {
        let down = |by: f32| Translation3::new(0.0, 0.0, -by);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        PlainArm {
            offsets: [0.0, 0.0, 0.0, upper_arm, 0.0, forearm, 0.0].map(down),
            axes: [x, y, z, x, z, x, y],
            hand: down(hand),
        }
    }

    /// One tick of S_C on a position task.
    pub fn tick(
        &self,
        method: Method,
        q: &mut SVector<f32, 7>,
        target: &Vector3<f32>,
        gains: &SVector<f32, 7>,
        [gain, time]: [f32; 2],
    ) {
        let mut at = Isometry3::identity();
        let mut origins = [Vector3::zeros(); 7];
        let mut axes = [Vector3::zeros(); 7];
        for i in 0..7 {
            at *= self.offsets[i];
            at *= UnitQuaternion::from_axis_angle(&self.axes[i], q[i]);
            origins[i] = at.translation.vector;
            axes[i] = at.rotation * self.axes[i].into_inner();
        }
        let tip = (at * self.hand).translation.vector;
        let mut jacobian = SMatrix::<f32, 3, 7>::zeros();
        for i in 0..7 {
            jacobian.set_column(i, &axes[i].cross(&(tip - origins[i])));
        }
        let error = target - tip;
        let step = match method {
            Method::Transpose => jacobian.transpose() * error,
            Method::NormalisedTranspose => {
                let step = jacobian.transpose() * error;
                let moved = jacobian * step;
                let most = step.norm_squared() / moved.norm_squared();
                step * (1.0 / step.norm()).min(most / gain)
            }
            Method::PseudoInverse => match jacobian.pseudo_inverse(1e-4) {
                Ok(inverse) => inverse * error,
                Err(_) => SVector::zeros(),
            },
            Method::Damped => {
                let square =
                    jacobian * jacobian.transpose() + SMatrix::<f32, 3, 3>::identity() * 0.0025;
                match square.try_inverse() {
                    Some(inverse) => jacobian.transpose() * (inverse * error),
                    None => SVector::zeros(),
                }
            }
        };
        let phi = 1.0 / (1.0 + libm::expf(4.0 - 8.0 * time));
        *q += step.component_mul(gains) * (phi * gain);
        for x in q.iter_mut() {
            *x = x.clamp(-3.2, 3.2);
        }
    }
}
