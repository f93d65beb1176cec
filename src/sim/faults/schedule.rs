use super::{Fault, FaultKind, LinkTrouble};
use crate::sim::dynamics::{Plant, RotorHealth};
use crate::sim::sensors::SensorErrors;

/// All faults of one flight. Turned into effects once an autopilot loop.
#[derive(Debug, Clone, Default)]
pub struct FaultSchedule {
    faults: Vec<Fault>,
    active: Vec<bool>,
    errors: SensorErrors,
    link: Option<LinkTrouble>,
}

impl FaultSchedule {
    pub fn new(faults: Vec<Fault>) -> Self {
        let active = vec![false; faults.len()];
        Self { faults, active, errors: SensorErrors::default(), link: None }
    }

    /// Brings plant and sensors to the state of time `t_s`. The plant is touched only when something begins or ends.
    pub fn apply(&mut self, t_s: f64, plant: &mut Plant) {
        let mut changed = false;
        for (fault, active) in self.faults.iter().zip(&mut self.active) {
            let now = fault.from_s <= t_s && t_s < fault.until_s;
            changed |= now != *active;
            *active = now;
        }
        let ramping = self.active_faults().any(|f| matches!(f.kind, FaultKind::GnssRamp { .. }));
        if changed || ramping {
            self.gather(t_s);
        }
        if changed {
            self.apply_to(plant);
        }
    }

    pub fn sensor_errors(&self) -> &SensorErrors {
        &self.errors
    }

    /// Trouble on the link now.
    pub fn link(&self) -> Option<LinkTrouble> {
        self.link
    }

    pub fn active_faults(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter().zip(&self.active).filter(|(_, active)| **active).map(|(fault, _)| fault)
    }

    fn gather(&mut self, t_s: f64) {
        let mut e = SensorErrors::default();
        let mut link = None;
        for fault in self.active_faults() {
            match fault.kind {
                FaultKind::AccelBias { imu, bias_mps2 } => imu_error(&mut e, imu).accel_bias_mps2 += bias_mps2,
                FaultKind::AccelNoise { imu, sigma_mps2 } => imu_error(&mut e, imu).accel_noise_mps2 += sigma_mps2,
                FaultKind::AccelFrozen { imu } => imu_error(&mut e, imu).accel_frozen = true,
                FaultKind::GyroBias { imu, bias_rads } => imu_error(&mut e, imu).gyro_bias_rads += bias_rads,
                FaultKind::GyroNoise { imu, sigma_rads } => imu_error(&mut e, imu).gyro_noise_rads += sigma_rads,
                FaultKind::GyroFrozen { imu } => imu_error(&mut e, imu).gyro_frozen = true,
                FaultKind::MagBias { bias_gauss } => e.mag_bias_gauss += bias_gauss,
                FaultKind::MagNoise { sigma_gauss } => e.mag_noise_gauss += sigma_gauss,
                FaultKind::MagFrozen => e.mag_frozen = true,
                FaultKind::BaroBias { bias_pa } => e.baro_bias_pa += bias_pa,
                FaultKind::BaroNoise { sigma_pa } => e.baro_noise_pa += sigma_pa,
                FaultKind::BaroFrozen => e.baro_frozen = true,
                FaultKind::GnssStep { shift_ned_m } => e.gnss_shift_ned_m += shift_ned_m,
                FaultKind::GnssRamp { speed_ned_mps } => e.gnss_shift_ned_m += speed_ned_mps * (t_s - fault.from_s),
                FaultKind::GnssLost => e.gnss_lost = true,
                FaultKind::Link(trouble) => link = Some(trouble),
                FaultKind::RotorWeak { .. }
                | FaultKind::RotorDamaged { .. }
                | FaultKind::RotorStuck { .. }
                | FaultKind::PayloadAttached(_) => {}
            }
        }
        self.errors = e;
        self.link = link;
    }

    fn apply_to(&self, plant: &mut Plant) {
        for i in 0..plant.vehicle().rotors.len() {
            plant.set_health(i, RotorHealth::Good);
        }
        let mut payload = None;
        for fault in self.active_faults() {
            match &fault.kind {
                FaultKind::RotorWeak { rotor, share } => plant.set_health(*rotor, RotorHealth::Weak(*share)),
                FaultKind::RotorDamaged { rotor, share } => plant.set_health(*rotor, RotorHealth::Damaged(*share)),
                FaultKind::RotorStuck { rotor, command } => plant.set_health(*rotor, RotorHealth::Stuck(*command)),
                FaultKind::PayloadAttached(p) => payload = Some(p),
                _ => {}
            }
        }
        // a payload that makes no rigid body is refused when the scenario is read
        plant.set_payload(payload);
    }
}

/// The second sensor for any index but 0: there are two.
fn imu_error(e: &mut SensorErrors, imu: usize) -> &mut crate::sim::sensors::ImuError {
    let [first, second] = &mut e.imu;
    if imu == 0 { first } else { second }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::dynamics::{Payload, PlantConfig};
    use crate::sim::testing::quad;
    use nalgebra::{Matrix3, Vector3};

    fn plant() -> Plant {
        let config = PlantConfig {
            vehicle: quad(),
            model: quad(),
            battery: None,
            ground: None,
            home_altitude_m: 0.0,
            heading_rad: 0.0,
            step_s: 1e-3,
        };
        Plant::new(config).unwrap()
    }

    fn during(from_s: f64, until_s: f64, kind: FaultKind) -> Fault {
        Fault { kind, from_s, until_s }
    }

    #[test]
    fn faults_begin_overlap_and_clear() {
        let load = Payload { mass_kg: 0.5, position_frd_m: Vector3::zeros(), inertia_kgm2: Matrix3::zeros() };
        let mut s = FaultSchedule::new(vec![
            during(1.0, 3.0, FaultKind::AccelBias { imu: 0, bias_mps2: Vector3::x() }),
            during(2.0, 4.0, FaultKind::AccelBias { imu: 0, bias_mps2: Vector3::x() }),
            during(1.0, f64::INFINITY, FaultKind::GnssRamp { speed_ned_mps: Vector3::y() * 2.0 }),
            during(1.0, 2.0, FaultKind::PayloadAttached(load)),
            during(1.0, 2.0, FaultKind::RotorWeak { rotor: 3, share: 0.5 }),
        ]);
        let mut p = plant();
        let mut bias = |t: f64, s: &mut FaultSchedule| {
            s.apply(t, &mut p);
            (s.sensor_errors().imu[0].accel_bias_mps2.x, s.sensor_errors().gnss_shift_ned_m.y, p.mass().mass_kg)
        };
        assert_eq!(bias(0.5, &mut s), (0.0, 0.0, 3.0));
        assert_eq!(bias(1.5, &mut s), (1.0, 1.0, 3.5));
        assert_eq!(
            s.active_faults().map(|f| f.kind.to_string()).collect::<Vec<_>>().join(";"),
            "accel;gnss_position;payload;rotor_4"
        );
        assert_eq!(bias(2.5, &mut s), (2.0, 3.0, 3.0));
        assert_eq!(bias(3.5, &mut s), (1.0, 5.0, 3.0));
        assert_eq!(s.sensor_errors().imu[1], Default::default());
    }
}
