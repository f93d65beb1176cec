use nalgebra::{Matrix3, Rotation3, UnitQuaternion, UnitVector3, Vector3};

/// Rounds of the polar decomposition's Newton iteration: it converges quadratically from near a rotation.
const POLAR_ROUNDS: usize = 5;

/// Σ₁: attitude and gyro bias, eq. (24d) with the extension of Grip, Fossen, Johansen and Saberi (2012).
///
/// The paper's injection ΓJ drives R̂ towards the rotation that takes the measured vectors to their references. Here it
/// comes in two parts, because what the two vectors know differs in worth: the accelerometer's part turns R̂ about level
/// axes, at a rate, and the magnetometer's about the vertical, by as much as [`Heading`](super::heading::Heading) says.
#[derive(Debug, Clone)]
pub(super) struct Attitude {
    /// R̂, body FRD to NED; close to a rotation, but in transients not exactly one.
    r: Matrix3<f64>,
    /// Subtracted from the gyro, rad/s, body FRD.
    bias: Vector3<f64>,
    orthogonal: UnitQuaternion<f64>,
}

impl Attitude {
    pub fn new(body_to_ned: UnitQuaternion<f64>) -> Self {
        let r = body_to_ned.to_rotation_matrix().into_inner();
        Self { r, bias: Vector3::zeros(), orthogonal: body_to_ned }
    }

    /// From two vectors known in both frames (TRIAD): the first is met exactly, the second in its plane. `None` when they
    /// are parallel.
    pub fn triad(body: [Vector3<f64>; 2], ned: [Vector3<f64>; 2]) -> Option<UnitQuaternion<f64>> {
        let frame = |[a, m]: [Vector3<f64>; 2]| {
            let first = a.try_normalize(1e-9)?;
            let second = first.cross(&m).try_normalize(1e-9)?;
            Some(Matrix3::from_columns(&[first, second, first.cross(&second)]))
        };
        let r = frame(ned)? * frame(body)?.transpose();
        Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r)))
    }

    pub fn bias(&self) -> Vector3<f64> {
        self.bias
    }

    /// The rotation nearest to R̂.
    pub fn orthogonal(&self) -> UnitQuaternion<f64> {
        self.orthogonal
    }

    pub fn to_ned(&self, v: Vector3<f64>) -> Vector3<f64> {
        self.r * v
    }

    /// Follows the gyro over `dt_s`.
    pub fn turn(&mut self, rate_frd_rads: Vector3<f64>, dt_s: f64) {
        self.r *= Rotation3::new((rate_frd_rads - self.bias) * dt_s).into_inner();
    }

    /// Turns R̂ so that the specific force comes to lie along its estimate in NED, by a share of the way, and the bias
    /// by `bias_share` (1/s) of the angle that is left. The heading stays. Returns that angle, rad.
    pub fn level(&mut self, force_frd: Vector3<f64>, force_ned: Vector3<f64>, share: f64, bias_share: f64) -> f64 {
        let (Some(body), Some(wanted)) = (force_frd.try_normalize(1e-6), force_ned.try_normalize(1e-6)) else {
            return 0.0;
        };
        // any body vector across the force; the axis that lies furthest from it gives the best
        let across = Vector3::ith(body.iamin(), 1.0);
        let Some(second) = body.cross(&across).try_normalize(1e-6) else { return 0.0 };
        let seen = self.r * second;
        let Some(kept) = (seen - wanted * wanted.dot(&seen)).try_normalize(1e-6) else { return 0.0 };
        let from = Matrix3::from_columns(&[body, second, body.cross(&second)]);
        let to = Matrix3::from_columns(&[wanted, kept, wanted.cross(&kept)]);
        let shown = self.r * body;
        let error = shown.cross(&wanted);
        self.bias -= self.r.tr_mul(&error) * bias_share;
        self.r += (to * from.transpose() - self.r) * share;
        error.norm().atan2(shown.dot(&wanted))
    }

    /// Turns R̂ about the vertical (positive from north to east), and changes the bias about it.
    pub fn turn_heading(&mut self, angle_rad: f64, bias_rads: f64) {
        self.r = Rotation3::from_axis_angle(&UnitVector3::new_unchecked(Vector3::z()), angle_rad) * self.r;
        let down_frd = self.r.tr_mul(&Vector3::z());
        self.bias += down_frd * bias_rads;
    }

    /// Takes a share of what the gyro shows while it stands still as its bias.
    pub fn rest(&mut self, rate_frd_rads: Vector3<f64>, share: f64) {
        self.bias += (rate_frd_rads - self.bias) * share;
    }

    /// Brings [`Self::orthogonal`] up to date; false when R̂ is no longer near a rotation.
    pub fn settle(&mut self) -> bool {
        let mut x = self.r;
        for _ in 0..POLAR_ROUNDS {
            let Some(inverse) = x.try_inverse() else { return false };
            x = (x + inverse.transpose()) * 0.5;
        }
        let sound = x.iter().all(|v| v.is_finite()) && x.determinant() > 0.0;
        if sound {
            self.orthogonal = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(x));
        }
        sound
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rotation() -> impl Strategy<Value = UnitQuaternion<f64>> {
        prop::array::uniform3(-3.0..3.0f64).prop_map(|v| UnitQuaternion::from_scaled_axis(Vector3::from(v)))
    }

    proptest! {
        #[test]
        fn triad_finds_the_rotation(q in rotation(), a in prop::array::uniform3(-1.0..1.0f64)) {
            let (a, m) = (Vector3::from(a) + Vector3::new(0.0, 0.0, -9.8), Vector3::new(0.2, 0.05, 0.4));
            let found = Attitude::triad([q.inverse() * a, q.inverse() * m], [a, m]).unwrap();
            prop_assert!(found.angle_to(&q) < 1e-7);
        }

        #[test]
        fn levelling_ends_at_the_reference_and_keeps_the_heading(q in rotation(), f in prop::array::uniform3(-3.0..3.0f64)) {
            let truth = UnitQuaternion::from_euler_angles(0.2, -0.1, 0.7);
            let force_ned = Vector3::from(f) + Vector3::new(0.0, 0.0, -9.8);
            let force_frd = truth.inverse() * force_ned;
            prop_assume!((q * force_frd).dot(&force_ned) > -0.9 * force_ned.norm_squared());
            let mut x = Attitude::new(q);
            for _ in 0..400 {
                x.level(force_frd, force_ned, 0.05, 0.0);
            }
            prop_assert!(x.settle());
            prop_assert!((x.orthogonal() * force_frd).angle(&force_ned) < 1e-6);
        }

        #[test]
        fn a_disturbed_matrix_is_brought_to_the_nearest_rotation(q in rotation(), e in prop::array::uniform9(-0.1..0.1f64)) {
            let mut x = Attitude::new(q);
            x.r += Matrix3::from_row_slice(&e);
            prop_assert!(x.settle());
            let r = x.orthogonal().to_rotation_matrix().into_inner();
            // the polar factor leaves a symmetric rest
            let rest = r.transpose() * x.r;
            prop_assert!((rest - rest.transpose()).amax() < 1e-9);
        }
    }
}
