use super::design::{DesignError, Options};
use super::plant::Plant;
use crate::observers::cache::Cache;
use crate::sdp::in_parallel;
use crate::vehicle::Vehicle;
use nalgebra::SMatrix;

/// A gain L: angles (rad) to angles and speeds.
pub(super) type Gain = SMatrix<f64, 6, 3>;

/// Sample times at which a vehicle's gains are designed, s.
const NODES_S: [f64; 5] = [0.008, 0.02, 0.04, 0.1, 0.25];
/// The most that V may be asked to fall within a sample, as α·T: beyond, gains near a deadbeat's gain nothing.
const MOST_PER_SAMPLE: f64 = 0.7;

/// One sample time.
#[derive(Debug, Clone, PartialEq)]
struct Node {
    dt_s: f64,
    /// At rotor momentum 1 and −1.
    gains: [Gain; 2],
}

/// SOS-2G designs over the sample times of a flying vehicle.
///
/// Each node is certified for its sample time. Between two nodes the gain is interpolated, which no certificate covers:
/// stamps jitter, and the observer says that its bound is statistical.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    nodes: Vec<Node>,
    /// g of [`Plant`], kg m²/s.
    pub(super) rotor_momentum: f64,
}

impl Schedule {
    /// Designs at decay rate α (1/s), less where samples come too slowly for it.
    ///
    /// A sample time without a design is left to its neighbours.
    ///
    /// # Errors
    /// That of a design, when no sample time has one.
    pub fn of_vehicle(vehicle: &Vehicle, alpha: f64, cache: &Cache) -> Result<Self, DesignError> {
        let made: Vec<Result<Node, DesignError>> = in_parallel(&NODES_S, |&dt_s| {
            let plant = Plant::of_vehicle(vehicle, dt_s);
            let design = cache.sums_of_squares(&plant, alpha.min(MOST_PER_SAMPLE / dt_s), Options::default())?;
            let at = |k: usize| Gain::from_fn(|i, j| design.gains[k].constant[(i, j)]);
            Ok(Node { dt_s, gains: [at(0), at(1)] })
        });
        let (mut nodes, mut refused) = (Vec::new(), None);
        for node in made {
            match node {
                Ok(node) => nodes.push(node),
                Err(e) => refused = Some(e),
            }
        }
        if let Some(e) = refused.filter(|_| nodes.is_empty()) {
            return Err(e);
        }
        Ok(Self { nodes, rotor_momentum: Plant::of_vehicle(vehicle, NODES_S[0]).rotor_momentum })
    }

    /// The longest time between two samples that has a gain, s.
    pub fn longest_s(&self) -> f64 {
        self.nodes.last().map_or(0.0, |n| n.dt_s)
    }

    /// L at a sample time (s) and a rotor momentum, −1 to 1.
    ///
    /// Below the first node the gain is that node's by the share of its time: corrections come more often.
    pub(super) fn gain(&self, dt_s: f64, momentum: f64) -> Gain {
        let up = 0.5 * (1.0 + momentum.clamp(-1.0, 1.0));
        let at = |n: &Node| n.gains[0] * up + n.gains[1] * (1.0 - up);
        let Some((first, last)) = self.nodes.first().zip(self.nodes.last()) else { return Gain::zeros() };
        if dt_s <= first.dt_s {
            return at(first) * (dt_s / first.dt_s).max(0.0);
        }
        if dt_s >= last.dt_s {
            return at(last);
        }
        let above = self.nodes.iter().position(|n| n.dt_s > dt_s).unwrap_or(self.nodes.len() - 1);
        let (a, b) = (&self.nodes[above.saturating_sub(1)], &self.nodes[above]);
        let share = (dt_s - a.dt_s) / (b.dt_s - a.dt_s);
        at(a) * (1.0 - share) + at(b) * share
    }
}
