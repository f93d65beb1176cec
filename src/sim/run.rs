use super::faults::TroubledLink;
use super::feed::{Feed, FeedConfig, MavlinkGeneration};
use super::random::{Part, Random};
use super::scenario::Scenario;
use super::{Moment, SimError, SimVehicle};
use crate::wire::FrameRef;

/// How a scenario is put on the air, beside what its file says.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    pub generation: MavlinkGeneration,
    /// Wall clock at the start, µs since 1970.
    pub unix_start_us: u64,
    /// Time since the autopilots booted, s.
    pub boot_offset_s: f64,
    pub refuse_intervals: bool,
}

impl Default for RunOptions {
    /// MAVLink 2, booted at the start, on 1 January 2026.
    fn default() -> Self {
        Self {
            generation: MavlinkGeneration::V2,
            unix_start_us: 1_767_225_600_000_000,
            boot_offset_s: 0.0,
            refuse_intervals: false,
        }
    }
}

/// Bytes as a ground station receives them: one frame, perhaps damaged.
#[derive(Debug, Clone, Copy)]
pub struct Received<'a> {
    /// Which vehicle, from 0.
    pub vehicle: u8,
    pub unix_us: u64,
    pub bytes: &'a [u8],
}

/// A scenario under way: its vehicles, what they send, and the radio between them and the ground.
#[derive(Debug)]
pub struct Run {
    units: Vec<Unit>,
    duration_s: f64,
}

#[derive(Debug)]
struct Unit {
    vehicle: SimVehicle,
    feed: Feed,
    /// Its motors have run.
    flown: bool,
    /// Frames on their way, once there has been trouble on the link.
    link: TroubledLink,
}

/// Frames that a troubled link holds at most.
const IN_FLIGHT: usize = 4096;

impl Run {
    pub fn new(scenario: &Scenario, options: &RunOptions) -> Result<Self, SimError> {
        let unit = |index| {
            let plan = scenario.plan(index);
            let config = FeedConfig {
                stack: scenario.stack,
                system: plan.system,
                home: scenario.home,
                streams: scenario.streams.clone(),
                generation: options.generation,
                boot_offset_s: options.boot_offset_s,
                unix_start_us: options.unix_start_us,
                refuse_intervals: options.refuse_intervals,
                seed: plan.seed,
            };
            let vehicle = SimVehicle::new(&plan)?;
            Ok(Unit {
                feed: Feed::new(config, &plan.model, &vehicle.now().readings),
                flown: false,
                link: TroubledLink::new(Random::new(plan.seed, plan.system, Part::Faults), IN_FLIGHT),
                vehicle,
            })
        };
        Ok(Self { units: (0..scenario.vehicles).map(unit).collect::<Result<_, _>>()?, duration_s: scenario.duration_s })
    }

    /// One autopilot loop of every vehicle. `ground` gets what arrives at the ground in that time.
    pub fn advance(&mut self, ground: &mut dyn FnMut(Received<'_>)) {
        for (index, unit) in self.units.iter_mut().enumerate() {
            unit.advance(index as u8, ground);
        }
    }

    /// A frame from the ground; each vehicle takes what is meant for it.
    pub fn receive(&mut self, frame: FrameRef<'_>) {
        for unit in &mut self.units {
            unit.feed.receive(frame, &mut unit.vehicle);
        }
    }

    /// Has the first vehicle ask one ground station (system, component) for its time. Its answer, which repeats the
    /// number that this gives, tells that it has received everything before. A troubled link does not touch it.
    pub fn probe(&mut self, station: (u8, u8), ground: &mut dyn FnMut(Received<'_>)) -> Option<i64> {
        let feed = &mut self.units.first_mut()?.feed;
        Some(feed.probe(station, &mut |unix_us, frame| ground(Received { vehicle: 0, unix_us, bytes: frame.bytes() })))
    }

    /// True when a ground station has answered this probe.
    pub fn answered(&self, probe: i64) -> bool {
        self.units.first().is_some_and(|u| u.feed.answered() == Some(probe))
    }

    /// Has every autopilot restart in this instant, wherever its vehicle is: its clock begins anew, and what was asked
    /// of it is forgotten. The vehicles fly on.
    pub fn reboot(&mut self) {
        self.units.iter_mut().for_each(|unit| unit.feed.reboot());
    }

    /// Simulated time, s.
    pub fn now_s(&self) -> f64 {
        self.units.first().map_or(0.0, |u| u.vehicle.now().truth.stamp.secs())
    }

    /// Time of one loop, s.
    pub fn loop_s(&self) -> f64 {
        self.units.first().map_or(0.01, |u| u.vehicle.loop_s())
    }

    /// True when the time is up, or every vehicle has flown and stands on the ground again with nothing left to fly. One
    /// without a mission waits for a ground station's commands.
    pub fn done(&self) -> bool {
        let landed = |u: &Unit| u.flown && u.vehicle.mission_done() && !u.vehicle.now().flight.armed();
        self.now_s() >= self.duration_s || self.units.iter().all(landed)
    }

    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    pub fn vehicle_count(&self) -> u8 {
        self.units.len() as u8
    }

    /// State of a vehicle after its last loop.
    pub fn moment(&self, vehicle: u8) -> Option<&Moment> {
        self.units.get(usize::from(vehicle)).map(|u| u.vehicle.now())
    }

    /// The vehicle itself, for its faults and estimator.
    pub fn vehicle(&self, vehicle: u8) -> Option<&SimVehicle> {
        self.units.get(usize::from(vehicle)).map(|u| &u.vehicle)
    }

    /// Boot time of a vehicle's autopilot, s: what its stamps count.
    pub fn boot_s(&self, vehicle: u8) -> f64 {
        self.units.get(usize::from(vehicle)).map_or(0.0, |u| u.feed.boot_s())
    }
}

impl Unit {
    fn advance(&mut self, index: u8, ground: &mut dyn FnMut(Received<'_>)) {
        self.flown |= self.vehicle.advance().flight.armed();
        let now_s = self.vehicle.now().truth.stamp.secs();
        let trouble = self.vehicle.faults().link();
        let link = &mut self.link;
        self.feed.after_loop(&self.vehicle, &mut |unix_us, frame| match &trouble {
            Some(t) => link.push(frame.bytes(), t, now_s),
            None => ground(Received { vehicle: index, unix_us, bytes: frame.bytes() }),
        });
        while let Some(bytes) = self.link.pop(now_s) {
            ground(Received { vehicle: index, unix_us: self.feed.unix_us(), bytes: &bytes });
        }
    }
}
