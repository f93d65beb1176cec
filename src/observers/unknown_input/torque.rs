use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

/// What one step of the filter is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueStep {
    pub dt_s: f64,
    pub body_to_ned: UnitQuaternion<f64>,
    /// Measured at the end of the step, rad/s.
    pub rate_frd_rads: Vector3<f64>,
    /// Known torque, the mean over the step, N m.
    pub torque_frd_nm: Vector3<f64>,
    /// Angular momentum of the rotors relative to the body, N m s.
    pub rotors_frd_nms: Vector3<f64>,
    /// During the step.
    pub inertia_kgm2: Matrix3<f64>,
}

/// The unknown torque without the derivative of any measurement (DESIGN §6.6), exact for a rate that moves linearly and
/// a known torque that is constant between two samples.
///
/// In continuous time ξ = x̂ − Q·y with ξ̇ = (A − QM)x̂ + L(y − x̂) and d̂ = ρ⁻¹[(y_ω − LPF y_ω)/τ − LPF(known)]. With
/// A − QM = [0 I; 0 0] and e = y − x̂ the first is ė = ([0 I; 0 0] − L)e, moved by what attitude turned more than the
/// rate says; the second is the low pass of `J·ω̇ + ω × (Jω + h) − known`, which over a step Δ with ω̇ = δω/Δ is
/// ```text
/// d̂⁺ = e^{−Δ/τ}·d̂ + (1 − e^{−Δ/τ})·(J·δω/Δ + ω̂ × (Jω̂ + h) − known)
/// ```
/// The inertia stands inside: when it changes, d̂ does not jump.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueFilter {
    /// [0 I; 0 0] − L, 1/s.
    drift: Matrix6<f64>,
    time_constants_s: Vector3<f64>,
    /// Attitude (rotation vector in body axes, rad) and rate (rad/s): measured less estimated.
    error: Vector6<f64>,
    torque: Vector3<f64>,
    previous: Option<(UnitQuaternion<f64>, Vector3<f64>)>,
}

impl TorqueFilter {
    /// `gain` is L of a design for angles and rates measured; `time_constants_s` are τ of each axis.
    pub fn new(gain: &Matrix6<f64>, time_constants_s: Vector3<f64>) -> Self {
        let mut drift = -gain;
        for i in 0..3 {
            drift[(i, 3 + i)] += 1.0;
        }
        Self { drift, time_constants_s, error: Vector6::zeros(), torque: Vector3::zeros(), previous: None }
    }

    pub fn torque_frd_nm(&self) -> Vector3<f64> {
        self.torque
    }

    /// Attitude measured less estimated, as a rotation vector in body axes, rad.
    pub fn attitude_error_rad(&self) -> Vector3<f64> {
        self.error.fixed_rows::<3>(0).into()
    }

    /// The estimated rate at the last step, rad/s.
    pub fn rate_frd_rads(&self) -> Option<Vector3<f64>> {
        self.previous.map(|(_, rate)| rate - self.rate_error())
    }

    /// Takes the next step as the first: no interval lies before it. The torque found so far stays.
    pub fn interrupt(&mut self) {
        self.previous = None;
        self.error = Vector6::zeros();
    }

    pub fn step(&mut self, s: &TorqueStep) {
        let Some((attitude, rate)) = self.previous.replace((s.body_to_ned, s.rate_frd_rads)) else { return };
        if s.dt_s <= 0.0 {
            return;
        }
        let old = rate - self.rate_error();
        let turned = (attitude.inverse() * s.body_to_ned).scaled_axis();
        let unexplained = turned - (rate + s.rate_frd_rads) * (0.5 * s.dt_s);
        self.advance_error(unexplained, s.dt_s);
        // the mean estimated rate over the step
        let rate_mean = (old + s.rate_frd_rads - self.rate_error()) * 0.5;
        let accelerated = s.inertia_kgm2 * (s.rate_frd_rads - rate) / s.dt_s;
        let gyroscopic = rate_mean.cross(&(s.inertia_kgm2 * rate_mean + s.rotors_frd_nms));
        let seen = accelerated + gyroscopic - s.torque_frd_nm;
        for i in 0..3 {
            let keep = (-s.dt_s / self.time_constants_s[i]).exp();
            self.torque[i] = keep * self.torque[i] + (1.0 - keep) * seen[i];
        }
    }

    fn rate_error(&self) -> Vector3<f64> {
        self.error.fixed_rows::<3>(3).into()
    }

    /// e⁺ = (I − MΔ/2)⁻¹((I + MΔ/2)e + unexplained): stable at every step length, as M is.
    fn advance_error(&mut self, unexplained: Vector3<f64>, dt_s: f64) {
        let half = self.drift * (0.5 * dt_s);
        let mut moved = self.error + half * self.error;
        for i in 0..3 {
            moved[i] += unexplained[i];
        }
        // M has its eigenvalues on the left, so I − MΔ/2 is regular
        if (Matrix6::identity() - half).lu().solve_mut(&mut moved) {
            self.error = moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filter(tau: f64) -> TorqueFilter {
        TorqueFilter::new(&(Matrix6::identity() * 5.0), Vector3::repeat(tau))
    }

    /// A constant torque on a body at rest, known torque held: the answer is the exact first-order step response, at
    /// any step length.
    #[test]
    fn a_step_of_torque_is_followed_exactly() {
        let j = Matrix3::from_diagonal(&Vector3::new(0.01, 0.02, 0.03));
        let d = Vector3::new(0.05, -0.02, 0.01);
        for dt in [0.001, 0.02, 0.3] {
            let mut f = filter(0.1);
            let (mut rate, mut attitude) = (Vector3::zeros(), UnitQuaternion::identity());
            let step = |dt_s, body_to_ned, rate_frd_rads| TorqueStep {
                dt_s,
                body_to_ned,
                rate_frd_rads,
                torque_frd_nm: Vector3::zeros(),
                rotors_frd_nms: Vector3::zeros(),
                inertia_kgm2: j,
            };
            f.step(&step(0.0, attitude, rate));
            // about x alone, so that nothing couples
            let d = Vector3::new(d.x, 0.0, 0.0);
            for k in 1..=20 {
                let before: Vector3<f64> = rate;
                rate += j.try_inverse().unwrap() * d * dt;
                attitude *= UnitQuaternion::from_scaled_axis((before + rate) * 0.5 * dt);
                f.step(&step(dt, attitude, rate));
                let expected = d * (1.0 - (-dt * f64::from(k) / 0.1).exp());
                assert!((f.torque_frd_nm() - expected).norm() < 1e-12, "{dt} {k}");
                assert!((f.rate_frd_rads().unwrap() - rate).norm() < 1e-9);
            }
        }
    }

    /// Known torque alone, with a change of inertia in between: nothing unknown is found.
    #[test]
    fn a_change_of_inertia_is_no_torque() {
        let mut f = filter(0.05);
        let (mut rate, mut attitude) = (Vector3::zeros(), UnitQuaternion::identity());
        let mut worst: f64 = 0.0;
        for k in 0..2000 {
            let dt_s = 0.002;
            let j = Matrix3::from_diagonal(&Vector3::repeat(if k < 1000 { 0.0142 } else { 0.0119 }));
            let known = Vector3::x() * 0.1 * (f64::from(k) * 0.01).sin();
            let before: Vector3<f64> = rate;
            rate += known / j[(0, 0)] * if k == 0 { 0.0 } else { dt_s };
            attitude *= UnitQuaternion::from_scaled_axis((before + rate) * 0.5 * dt_s);
            f.step(&TorqueStep {
                dt_s: if k == 0 { 0.0 } else { dt_s },
                body_to_ned: attitude,
                rate_frd_rads: rate,
                torque_frd_nm: known,
                rotors_frd_nms: Vector3::zeros(),
                inertia_kgm2: j,
            });
            worst = worst.max(f.torque_frd_nm().norm());
        }
        assert!(worst < 1e-12, "{worst}");
    }

    #[test]
    fn a_biased_gyro_shows_in_the_attitude_error() {
        let mut f = filter(0.05);
        for _ in 0..1000 {
            f.step(&TorqueStep {
                dt_s: 0.01,
                body_to_ned: UnitQuaternion::identity(),
                rate_frd_rads: Vector3::new(0.1, 0.0, 0.0),
                torque_frd_nm: Vector3::zeros(),
                rotors_frd_nms: Vector3::zeros(),
                inertia_kgm2: Matrix3::identity() * 0.01,
            });
        }
        // ė = e_ω − 5·e − 0.1 with e_ω → 0
        assert!((f.attitude_error_rad().x + 0.02).abs() < 1e-6, "{}", f.attitude_error_rad());
        f.interrupt();
        assert_eq!(f.attitude_error_rad(), Vector3::zeros());
    }
}
