use super::noise::NoiseShape;
use crate::signal::Stamp;
use crate::sim::dynamics::Truth;
use crate::sim::random::{Part, Random};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// A GNSS receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GnssSpec {
    pub rate_hz: f64,
    /// From the instant a fix is true to the instant the autopilot has it, s.
    pub latency_s: f64,
    /// White noise of a fix, standard deviation.
    pub horizontal_noise_m: f64,
    pub vertical_noise_m: f64,
    pub velocity_noise_mps: f64,
    pub shape: NoiseShape,
    /// Slow wander of the position (atmosphere, multipath): standard deviation (m) and correlation time (s).
    pub wander_m: f64,
    pub wander_s: f64,
    /// Chance that a fix never comes.
    pub dropout: f64,
    pub satellites: u8,
}

/// One fix, in the local frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GnssFix {
    /// The instant it is true for.
    pub stamp: Stamp,
    pub position_ned_m: Vector3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub satellites: u8,
}

#[derive(Debug, Clone)]
pub(super) struct Gnss {
    spec: GnssSpec,
    random: Random,
    wander: Vector3<f64>,
    /// Fixes on their way, oldest first. Bounded: latency over period, and one.
    pending: VecDeque<GnssFix>,
}

impl Gnss {
    pub fn new(spec: GnssSpec, seed: u64, vehicle: u8) -> Self {
        let mut random = Random::new(seed, vehicle, Part::Gnss);
        let sigma = Vector3::repeat(spec.wander_m);
        let wander = NoiseShape::Gaussian.draw3(&sigma, &mut random);
        let room = (spec.latency_s * spec.rate_hz).ceil().clamp(0.0, 1e3) as usize + 2;
        Self { spec, random, wander, pending: VecDeque::with_capacity(room) }
    }

    /// Takes a fix now; it arrives through [`Self::arrived`].
    pub fn measure(&mut self, truth: &Truth, shift_ned_m: Vector3<f64>, lost: bool) {
        let s = &self.spec;
        let decay = (-1.0 / (s.rate_hz.max(1e-3) * s.wander_s.max(1e-3))).exp();
        let fresh = Vector3::repeat(s.wander_m * (1.0 - decay * decay).sqrt());
        self.wander = self.wander * decay + NoiseShape::Gaussian.draw3(&fresh, &mut self.random);
        let position_noise = Vector3::new(s.horizontal_noise_m, s.horizontal_noise_m, s.vertical_noise_m);
        let velocity_noise = Vector3::repeat(s.velocity_noise_mps);
        let fix = GnssFix {
            stamp: truth.stamp,
            position_ned_m: truth.position_ned_m
                + self.wander
                + shift_ned_m
                + s.shape.draw3(&position_noise, &mut self.random),
            velocity_ned_mps: truth.velocity_ned_mps + s.shape.draw3(&velocity_noise, &mut self.random),
            satellites: s.satellites,
        };
        let dropped = self.random.chance(s.dropout);
        if !lost && !dropped && self.pending.len() < self.pending.capacity() {
            self.pending.push_back(fix);
        }
    }

    /// The fix that has arrived by now, if any.
    pub fn arrived(&mut self, now: Stamp) -> Option<GnssFix> {
        let ready = self.pending.front().is_some_and(|f| now - f.stamp >= self.spec.latency_s - 1e-6);
        if ready { self.pending.pop_front() } else { None }
    }
}
