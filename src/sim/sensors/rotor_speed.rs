use super::noise::{NoiseShape, quantise};
use crate::signal::MAX_ROTORS;
use crate::sim::dynamics::Truth;
use crate::sim::random::{Part, Random};
use std::f64::consts::TAU;

/// Rotor speed as the speed controllers report it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorSpeedSpec {
    pub rate_hz: f64,
    /// Standard deviation, rev/min.
    pub noise_rpm: f64,
    pub shape: NoiseShape,
    pub step_rpm: f64,
}

#[derive(Debug, Clone)]
pub(super) struct RotorSpeed {
    spec: RotorSpeedSpec,
    random: Random,
}

impl RotorSpeed {
    pub fn new(spec: RotorSpeedSpec, seed: u64, vehicle: u8) -> Self {
        Self { spec, random: Random::new(seed, vehicle, Part::RotorSpeed) }
    }

    /// rev/min; zero beyond the last rotor.
    pub fn read(&mut self, truth: &Truth) -> [f64; MAX_ROTORS] {
        let mut rpm = [0.0; MAX_ROTORS];
        for (rpm, speed) in rpm.iter_mut().zip(truth.rotor_speed_rads).take(truth.rotor_count) {
            let noise = self.spec.shape.draw(self.spec.noise_rpm, &mut self.random);
            let turning = speed * 60.0 / TAU;
            *rpm = if turning > 0.0 { quantise((turning + noise).max(0.0), self.spec.step_rpm) } else { 0.0 };
        }
        rpm
    }
}
