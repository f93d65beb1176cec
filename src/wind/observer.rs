use super::drift::Drift;
use super::follow::Follower;
use super::front::Front;
use super::instant::{Flow, Instant};
use crate::vehicle::Vehicle;
use nalgebra::Vector3;

/// Velocity of the air over ground, world NED, m/s, with half-widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wind {
    pub velocity_ned_mps: Vector3<f64>,
    pub half_width_mps: Vector3<f64>,
    /// The wind is turning: the bound is open to what it was before.
    pub turning: bool,
}

/// Wind over time: instants followed through their noise, within the interval of each, opened while the wind turns.
///
/// The half-width holds the whole interval of the newest instant, so it never relies on noise averaging out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WindObserver {
    followers: [Follower; 3],
    front: Front,
    drift: Drift,
    running: bool,
}

impl WindObserver {
    /// Forgets the past.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Takes in one instant, `dt_s` after the last one. `None`, and the past forgotten, where it says nothing.
    pub fn step(&mut self, vehicle: &Vehicle, flow: &Flow, dt_s: f64) -> Option<Wind> {
        let shift = self.drift.step(vehicle, flow, dt_s);
        let Some(instant) = Instant::of(vehicle, flow, shift) else {
            self.reset();
            return None;
        };
        if !self.running || dt_s <= 0.0 {
            for (follower, value) in self.followers.iter_mut().zip(&instant.value) {
                follower.start(*value);
            }
            (self.front, self.running) = (Front::default(), true);
        }
        let before = self.value();
        for (i, follower) in self.followers.iter_mut().enumerate() {
            follower.step(instant.value[i], instant.noise_mps[i], dt_s);
            follower.clamp(instant.range[i].lo(), instant.range[i].hi());
        }
        let value = self.value();
        let reach = self.front.step(value - before, dt_s);
        let half_width_mps = Vector3::from_fn(|i, _| {
            let range = instant.range[i];
            let (below, above) = (value[i] - range.lo() + reach.below[i], range.hi() - value[i] + reach.above[i]);
            below.max(above).next_up()
        });
        Some(Wind { velocity_ned_mps: value, half_width_mps, turning: self.front.is_open() })
    }

    fn value(&self) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.followers[i].value())
    }
}
