use super::{Aligner, STALE_S};
use crate::signal::{Actuation, Aged, MAX_ROTORS, Measurement, RotorCommands, Stamp};
use crate::vehicle::Air;

impl Aligner {
    /// The modelled force and torque of the rotors over the measurement's interval.
    pub(super) fn actuation(&mut self, m: &Measurement) -> Option<Aged<Actuation>> {
        let Aged { value: target, age_s } = self.rotors_over(m.stamp, m.dt_s)?;
        let rotors = self.rotor_bank.advance(&self.vehicle, &target, m.dt_s);
        // climbing through the air along the thrust axis (body −z); the wind's vertical part is taken as nothing
        let climb_mps =
            m.attitude.zip(m.velocity_ned_mps).map_or(0.0, |(q, v)| -q.value.inverse_transform_vector(&v.value).z);
        let air = Air {
            voltage_v: m.voltage_v.map(|v| v.value),
            density_kgm3: m.air_density_kgm3.map(|d| d.value),
            climb_mps,
        };
        let (w, sum_sqrt_thrust) = self.vehicle.rotor_wrench(&rotors, air);
        let value = Actuation {
            rotors,
            force_frd_n: w.force_frd_n,
            torque_frd_nm: w.torque_frd_nm,
            sum_sqrt_thrust,
            inflow_n_per_mps2: self.vehicle.thrust.inflow_n_per_mps2(air) * self.vehicle.rotors.len() as f64,
            doubt: self.vehicle.thrust.doubt(air),
            climb_mps,
        };
        Some(Aged { value, age_s })
    }

    /// Mean normalised command over `[t − dt, t]`, each output held until the next, shifted by the rotor's delay.
    fn rotors_over(&self, t: Stamp, dt_s: f64) -> Option<Aged<RotorCommands>> {
        let end = t.plus_secs(-self.vehicle.dynamics.delay_s);
        let begin = end.plus_secs(-dt_s);
        let newest = self.outputs.newest()?.0;
        if end - newest > STALE_S {
            return None;
        }
        let mut sum = [0.0; MAX_ROTORS];
        let mut covered = 0.0;
        let mut until = end;
        let mut reference = None;
        for (s, o) in self.outputs.iter().rev() {
            if s >= end {
                reference.get_or_insert(o);
                continue;
            }
            let from = s.max(begin);
            let w = until - from;
            for (acc, v) in sum.iter_mut().zip(o) {
                *acc += w * v;
            }
            covered += w;
            until = from;
            reference = Some(o);
            if s <= begin {
                break;
            }
        }
        let held = reference?;
        let mut command = [0.0; MAX_ROTORS];
        let map = &self.vehicle.actuators;
        let count = self.vehicle.rotors.len().min(MAX_ROTORS);
        for (c, &o) in command.iter_mut().zip(&self.outputs_of_rotors).take(count) {
            let mean = if covered > 0.0 { sum.get(o).map(|x| x / covered) } else { held.get(o).copied() };
            *c = mean.map_or(0.0, |x| ((x - map.at_zero) / (map.at_full - map.at_zero)).clamp(0.0, 1.0));
        }
        let value = RotorCommands { command, count };
        Some(Aged { value, age_s: (end - newest).max(0.0) })
    }
}
