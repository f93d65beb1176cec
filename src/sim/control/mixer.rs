use crate::signal::MAX_ROTORS;
use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, Matrix4, Vector3};

/// Why a vehicle cannot be mixed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MixerError {
    #[error("{rotors} rotors; between 4 and {MAX_ROTORS} can be mixed")]
    RotorCount { rotors: usize },
    #[error("the rotors' geometry does not give lift and torque about all three axes")]
    Geometry,
}

/// Collective thrust and torque to rotor thrusts, by the pseudo-inverse of the vehicle's geometry.
#[derive(Debug, Clone)]
pub struct Mixer {
    count: usize,
    /// Thrust of each rotor per unit of lift, roll, pitch and yaw torque.
    lift: [f64; MAX_ROTORS],
    torque: [Vector3<f64>; MAX_ROTORS],
    max_n: f64,
    min_n: f64,
}

impl Mixer {
    pub fn new(vehicle: &Vehicle) -> Result<Self, MixerError> {
        let count = vehicle.rotors.len();
        if !(4..=MAX_ROTORS).contains(&count) {
            return Err(MixerError::RotorCount { rotors: count });
        }
        let mut effect = DMatrix::<f64>::zeros(4, count);
        for (i, r) in vehicle.rotors.iter().enumerate() {
            let torque = r.position_frd_m.cross(&r.axis_frd) - r.axis_frd * (r.spin.reaction_sign() * r.torque_ratio_m);
            effect.set_column(i, &nalgebra::Vector4::new(-r.axis_frd.z, torque.x, torque.y, torque.z));
        }
        let product: Matrix4<f64> = (&effect * effect.transpose()).fixed_view::<4, 4>(0, 0).into_owned();
        // scaled to a unit diagonal, so that neither newtons nor small vehicles decide what counts as singular
        let scale = Matrix4::from_diagonal(&product.diagonal().map(|d| 1.0 / d.sqrt()));
        let scaled = scale * product * scale;
        if !scaled.iter().all(|x| x.is_finite()) || scaled.symmetric_eigenvalues().min() < 1e-6 {
            return Err(MixerError::Geometry);
        }
        let inverse = product.try_inverse().ok_or(MixerError::Geometry)?;
        let mix = effect.transpose() * inverse;
        let mut mixer = Self {
            count,
            lift: [0.0; MAX_ROTORS],
            torque: [Vector3::zeros(); MAX_ROTORS],
            max_n: vehicle.thrust.max_n.nominal,
            min_n: 0.01 * vehicle.thrust.max_n.nominal,
        };
        for (i, row) in mix.row_iter().enumerate() {
            mixer.lift[i] = row[0];
            mixer.torque[i] = Vector3::new(row[1], row[2], row[3]);
        }
        Ok(mixer)
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Thrust of each rotor, N, within what a rotor can give. Where not all fits, yaw is given up first, then lift;
    /// roll and pitch keep the vehicle upright and come last.
    pub fn thrusts(&self, lift_n: f64, torque_frd_nm: Vector3<f64>) -> [f64; MAX_ROTORS] {
        let tilt = Vector3::new(torque_frd_nm.x, torque_frd_nm.y, 0.0);
        let mut out = [0.0; MAX_ROTORS];
        let mut yaw_share: f64 = 1.0;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (i, out) in out.iter_mut().enumerate().take(self.count) {
            let base = self.lift[i] * lift_n + self.torque[i].dot(&tilt);
            let yaw = self.torque[i].z * torque_frd_nm.z;
            let room = if yaw > 0.0 { self.max_n - base } else { base - self.min_n };
            if yaw != 0.0 {
                yaw_share = yaw_share.min((room / yaw.abs()).clamp(0.0, 1.0));
            }
            *out = base;
        }
        for (i, out) in out.iter_mut().enumerate().take(self.count) {
            *out += yaw_share * self.torque[i].z * torque_frd_nm.z;
            low = low.min(*out);
            high = high.max(*out);
        }
        // move the collective so that the spread fits, preferring not to exceed the top
        let shift =
            if high > self.max_n { self.max_n - high } else { (self.min_n - low).clamp(0.0, self.max_n - high) };
        for out in out.iter_mut().take(self.count) {
            *out = (*out + shift).clamp(self.min_n, self.max_n);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::RotorCommands;
    use crate::sim::testing::{hexa, quad};
    use crate::vehicle::{Air, ThrustCurve};
    use proptest::prelude::*;

    /// The wrench that thrusts really give: a linear thrust curve of 1 N makes commands and thrusts the same.
    fn wrench(vehicle: &Vehicle, thrusts: [f64; MAX_ROTORS]) -> (f64, Vector3<f64>) {
        let mut v = vehicle.clone();
        let max = v.thrust.max_n.nominal;
        v.thrust = ThrustCurve { expo: 0.0, voltage_ref_v: None, density_ref_kgm3: None, ..v.thrust };
        let commands = RotorCommands { command: thrusts.map(|t| t / max), count: v.rotors.len() };
        let air = Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 };
        let (w, _) = v.rotor_wrench(&commands, air);
        (-w.force_frd_n.z, w.torque_frd_nm)
    }

    proptest! {
        #[test]
        fn what_is_asked_is_given_while_it_fits(
            lift in 25.0..35.0_f64, roll in -1.5..1.5_f64, pitch in -1.5..1.5_f64, yaw in -0.1..0.1_f64
        ) {
            for v in [quad(), hexa()] {
                let asked = Vector3::new(roll, pitch, yaw);
                let (l, t) = wrench(&v, Mixer::new(&v).unwrap().thrusts(lift, asked));
                prop_assert!((l - lift).abs() < 1e-9 && (t - asked).norm() < 1e-9);
            }
        }

        #[test]
        fn roll_and_pitch_survive_saturation(
            lift in 0.0..76.0_f64, roll in -2.0..2.0_f64, pitch in -2.0..2.0_f64, yaw in -5.0..5.0_f64
        ) {
            let v = quad();
            let m = Mixer::new(&v).unwrap();
            let thrusts = m.thrusts(lift, Vector3::new(roll, pitch, yaw));
            prop_assert!(thrusts[..4].iter().all(|t| (0.0..=18.9).contains(t)));
            let (_, t) = wrench(&v, thrusts);
            prop_assert!((t.x - roll).abs() < 1e-6 && (t.y - pitch).abs() < 1e-6, "{t}");
        }
    }

    #[test]
    fn vehicles_without_control_are_refused() {
        let mut v = quad();
        v.rotors.truncate(3);
        assert_eq!(Mixer::new(&v).unwrap_err(), MixerError::RotorCount { rotors: 3 });
        let mut v = quad();
        v.rotors.iter_mut().for_each(|r| r.position_frd_m.x = 0.0);
        assert_eq!(Mixer::new(&v).unwrap_err(), MixerError::Geometry);
    }
}
