//! The air: its velocity over ground, NED, at the vehicle's place and time.
//!
//! In: time, height and the vehicle's velocity. Out: one vector for each autopilot loop, the sum of a [`Profile`] (steady, steps or a
//! recorded series), gusts and Dryden turbulence. Random numbers come from the scenario's seed alone.

mod dryden;
mod gust;

pub use dryden::{Dryden, Turbulence};
pub use gust::Gust;

use super::profile::Profile;
use super::random::Random;
use nalgebra::Vector3;

/// Everything that blows.
#[derive(Debug, Clone)]
pub struct Wind {
    mean: Profile,
    gusts: Vec<Gust>,
    turbulence: Option<Dryden>,
}

impl Wind {
    pub fn new(mean: Profile, gusts: Vec<Gust>, turbulence: Option<Turbulence>, random: Random) -> Self {
        Self { mean, gusts, turbulence: turbulence.map(|t| Dryden::new(t, random)) }
    }

    pub fn calm(random: Random) -> Self {
        Self::new(Profile::default(), Vec::new(), None, random)
    }

    /// Velocity of the air at `t_s`, to be held for `hold_s`. Call in order, once for every such span.
    pub fn advance(&mut self, t_s: f64, hold_s: f64, height_m: f64, velocity_ned_mps: Vector3<f64>) -> Vector3<f64> {
        let mut wind = self.mean.at(t_s);
        for gust in &self.gusts {
            wind += gust.at(t_s);
        }
        match &mut self.turbulence {
            Some(t) => wind + t.advance(hold_s, height_m, velocity_ned_mps - wind),
            None => wind,
        }
    }
}
