//! Scenarios: a vehicle, a mission, the air and what goes wrong, as a TOML file; everything else follows from the seed.
//!
//! In: a file or the name of one that comes with the program. Out: a checked [`Scenario`] and from it a
//! [`FlightPlan`] for each vehicle, or every issue of the file at once.
//! Imports `document` and `vehicle`; reads files only here.

mod bundled;
mod faults;
mod load;
mod mission;
mod read;
mod sample;
mod series;
mod vary;
mod weather;

#[cfg(test)]
mod fault_tests;
#[cfg(test)]
mod tests;

pub use bundled::names;
pub use load::{ScenarioError, from_file, parse, resolve};
pub use vary::Vary;

use super::feed::Stack;
use super::{FlightPlan, random};
use std::collections::BTreeMap;

/// Where the local frame's origin lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Home {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    /// Above mean sea level, m.
    pub altitude_m: f64,
    pub heading_deg: f64,
}

/// A flight to simulate, checked.
#[derive(Debug, Clone)]
pub struct Scenario {
    pub name: String,
    pub description: String,
    /// When the run ends even if the mission has not, s.
    pub duration_s: f64,
    /// Which autopilot's messages the vehicles send.
    pub stack: Stack,
    pub home: Home,
    /// How many vehicles fly it, side by side, each with random numbers of its own.
    pub vehicles: u8,
    /// Rates asked for at start, Hz by message name, as a ground station would.
    pub streams: BTreeMap<String, f64>,
    /// Draw what really flies from the ranges that the vehicle file declares.
    pub sampled: bool,
    /// What each seed draws anew.
    pub vary: Vary,
    plan: FlightPlan,
}

impl Scenario {
    /// The flight of vehicle `index`, from 0. System ids count from 1.
    pub fn plan(&self, index: u8) -> FlightPlan {
        let mut plan = self.plan.clone();
        plan.system = index.saturating_add(1);
        if self.sampled {
            let mut random = random::Random::new(plan.seed, plan.system, random::Part::Vehicle);
            plan.vehicle = sample::within_ranges(&plan.model, &mut random);
        }
        let mut random = random::Random::new(plan.seed, plan.system, random::Part::Vary);
        self.vary.apply(&mut plan, &mut random);
        plan
    }

    pub fn seed(&self) -> u64 {
        self.plan.seed
    }

    /// The same scenario with other random numbers.
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.plan.seed = seed;
        self
    }
}
