use super::control::{Controller, Flight, Leg, Limits, MixerError, Navigation, Pilot};
use super::dynamics::{Battery, Ground, Inputs, Plant, PlantConfig, Push, Truth};
use super::estimator::{Estimator, Place};
use super::faults::{Fault, FaultSchedule};
use super::profile::Profile;
use super::random::{Part, Random};
use super::sensors::{Readings, SensorSuite, Sensors};
use super::wind::{Gust, Turbulence, Wind};
use crate::vehicle::Vehicle;
use nalgebra::Vector3;

/// Why a vehicle cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    #[error("{vehicle}: {source}")]
    Mixer { vehicle: String, source: MixerError },
    #[error("{vehicle}: its mass and inertia make no rigid body, or the step of {step_s} s is not positive")]
    Body { vehicle: String, step_s: f64 },
    #[error("{vehicle} cannot lift itself: its rotors give {thrust_n:.1} N and it weighs {weight_n:.1} N")]
    TooHeavy { vehicle: String, thrust_n: f64, weight_n: f64 },
}

/// A push from outside that changes over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Disturbance {
    pub acts: Acts,
    pub profile: Profile,
}

/// What a [`Disturbance`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// Force, NED, N.
    ForceNed,
    /// Force, body FRD, N.
    ForceFrd,
    /// Torque, body FRD, N m.
    TorqueFrd,
}

/// Whom the controller believes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NavigationSource {
    /// The onboard estimator, as on a real vehicle.
    Estimator,
    /// The truth: to see the physics alone.
    Truth,
}

/// One vehicle's whole flight.
#[derive(Debug, Clone)]
pub struct FlightPlan {
    /// What really flies.
    pub vehicle: Vehicle,
    /// What autopilot and observers take it for.
    pub model: Vehicle,
    pub seed: u64,
    /// MAVLink system id; also separates the random streams of several vehicles.
    pub system: u8,
    /// Physics step, s, and steps per autopilot loop.
    pub step_s: f64,
    pub steps_per_loop: u32,
    pub home_altitude_m: f64,
    pub heading_rad: f64,
    pub battery: Option<Battery>,
    pub sensors: SensorSuite,
    pub navigation: NavigationSource,
    pub limits: Limits,
    pub acceleration_mps2: f64,
    pub mission: Vec<Leg>,
    pub wind: Profile,
    pub gusts: Vec<Gust>,
    pub turbulence: Option<Turbulence>,
    pub disturbances: Vec<Disturbance>,
    pub faults: Vec<Fault>,
}

impl FlightPlan {
    /// A calm flight of this vehicle with sensors inside its declared bounds, and no mission.
    pub fn calm(vehicle: Vehicle, seed: u64) -> Self {
        let sensors = SensorSuite::within_bounds_of(&vehicle);
        let full_v = vehicle.thrust.voltage_ref_v.unwrap_or(12.6);
        Self {
            model: vehicle.clone(),
            battery: Some(Battery::typical(full_v, 8.0 * vehicle.mass_kg.nominal)),
            vehicle,
            seed,
            system: 1,
            step_s: 0.001_25,
            steps_per_loop: 2,
            home_altitude_m: 584.0,
            heading_rad: 0.0,
            sensors,
            navigation: NavigationSource::Estimator,
            limits: Limits::default(),
            acceleration_mps2: 2.5,
            mission: Vec::new(),
            wind: Profile::default(),
            gusts: Vec::new(),
            turbulence: None,
            disturbances: Vec::new(),
            faults: Vec::new(),
        }
    }

    /// When wind, pushes or faults change, s, in order: what an estimate has to follow.
    pub fn changes(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.wind.changes().collect();
        for gust in &self.gusts {
            times.extend([gust.start_s, gust.start_s + gust.rise_s + gust.hold_s]);
        }
        times.extend(self.disturbances.iter().flat_map(|d| d.profile.changes()));
        times.extend(self.faults.iter().flat_map(|f| [f.from_s, f.until_s]));
        times.retain(|t| t.is_finite());
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    pub fn loop_s(&self) -> f64 {
        self.step_s * f64::from(self.steps_per_loop.max(1))
    }
}

/// A vehicle, its air, its sensors and its autopilot, one autopilot loop at a time.
#[derive(Debug, Clone)]
pub struct SimVehicle {
    plant: Plant,
    wind: Wind,
    disturbances: Vec<Disturbance>,
    faults: FaultSchedule,
    sensors: Sensors,
    estimator: Estimator,
    pilot: Pilot,
    controller: Controller,
    source: NavigationSource,
    steps_per_loop: u32,
    loop_s: f64,
    inputs: Inputs,
    now: Moment,
}

/// Everything there is to know after one loop.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    pub truth: Truth,
    pub readings: Readings,
    /// What the estimator believes, even when the controller flies on the truth.
    pub navigation: Navigation,
    /// Commands decided in this loop, 0..1.
    pub commands: [f64; crate::signal::MAX_ROTORS],
    pub flight: Flight,
}

impl SimVehicle {
    pub fn new(plan: &FlightPlan) -> Result<Self, SimError> {
        let name = || plan.vehicle.name.clone();
        let facts = plan.vehicle.facts();
        if facts.hover_command.is_none() {
            return Err(SimError::TooHeavy { vehicle: name(), thrust_n: facts.max_thrust_n, weight_n: facts.weight_n });
        }
        let arm_m = plan.vehicle.rotors.iter().map(|r| r.position_frd_m.xy().norm()).fold(0.1, f64::max);
        let config = PlantConfig {
            vehicle: plan.vehicle.clone(),
            model: plan.model.clone(),
            battery: plan.battery,
            ground: Some(Ground::under(plan.vehicle.mass_kg.nominal, arm_m)),
            home_altitude_m: plan.home_altitude_m,
            heading_rad: plan.heading_rad,
            step_s: plan.step_s,
        };
        let mut plant = Plant::new(config).ok_or_else(|| SimError::Body { vehicle: name(), step_s: plan.step_s })?;
        let loop_s = plan.loop_s();
        let controller = Controller::new(&plan.model, plan.limits, loop_s)
            .map_err(|source| SimError::Mixer { vehicle: name(), source })?;
        let field = plan.sensors.magnetometer.field_ned_gauss;
        let place = Place { declination_rad: field.y.atan2(field.x), heading_rad: plan.heading_rad };
        let mut faults = FaultSchedule::new(plan.faults.clone());
        faults.apply(0.0, &mut plant);
        let mut sensors = Sensors::new(&plan.sensors, plan.seed, plan.system, loop_s);
        let mut estimator = Estimator::new(place, loop_s);
        let truth = plant.truth();
        let readings = sensors.read(&truth, faults.sensor_errors());
        let navigation = estimator.update(&readings, true, truth.stamp);
        let turbulence = Random::new(plan.seed, plan.system, Part::Turbulence);
        Ok(Self {
            plant,
            wind: Wind::new(plan.wind.clone(), plan.gusts.clone(), plan.turbulence, turbulence),
            disturbances: plan.disturbances.clone(),
            faults,
            sensors,
            estimator,
            pilot: Pilot::new(plan.mission.iter().copied(), plan.acceleration_mps2),
            controller,
            source: plan.navigation,
            steps_per_loop: plan.steps_per_loop.max(1),
            loop_s,
            inputs: Inputs::default(),
            now: Moment {
                truth,
                readings,
                navigation,
                commands: [0.0; crate::signal::MAX_ROTORS],
                flight: Flight::Disarmed,
            },
        })
    }

    /// The state after the last loop.
    pub fn now(&self) -> &Moment {
        &self.now
    }

    pub fn loop_s(&self) -> f64 {
        self.loop_s
    }

    pub fn pilot(&mut self) -> &mut Pilot {
        &mut self.pilot
    }

    /// Arms on the ground, where the vehicle believes itself to be.
    pub fn arm(&mut self) {
        let believed = self.now.navigation;
        self.pilot.arm(&believed);
    }

    pub fn mission_done(&self) -> bool {
        self.pilot.done()
    }

    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    pub fn faults(&self) -> &FaultSchedule {
        &self.faults
    }

    /// One autopilot loop: the air and the rotors act for its length, then sensors, estimator and controller run.
    pub fn advance(&mut self) -> &Moment {
        let t = self.plant.stamp().secs();
        let state = self.plant.state();
        // eddies smaller than what passes in one loop are smaller than the vehicle
        self.inputs.wind_ned_mps = self.wind.advance(t, self.loop_s, -state.position_ned_m.z, state.velocity_ned_mps);
        self.inputs.push = self.push(t);
        for _ in 0..self.steps_per_loop {
            self.plant.step(&self.inputs);
        }
        let t = self.plant.stamp().secs();
        self.faults.apply(t, &mut self.plant);
        let truth = self.plant.truth();
        let readings = self.sensors.read(&truth, self.faults.sensor_errors());
        let standing = !self.pilot.flight().armed();
        let navigation = self.estimator.update(&readings, standing, truth.stamp);
        let believed = match self.source {
            NavigationSource::Estimator => navigation,
            NavigationSource::Truth => true_navigation(&truth),
        };
        self.inputs.commands = self.decide(&believed, &truth);
        self.now = Moment { truth, readings, navigation, commands: self.inputs.commands, flight: self.pilot.flight() };
        &self.now
    }

    fn decide(&mut self, believed: &Navigation, truth: &Truth) -> [f64; crate::signal::MAX_ROTORS] {
        let was_armed = self.pilot.flight().armed();
        let wish = self.pilot.update(believed, self.controller.lift_share(), self.loop_s);
        let Some(wish) = wish else { return [0.0; crate::signal::MAX_ROTORS] };
        if !was_armed {
            self.controller.reset();
        }
        let learn = !self.pilot.near_ground(believed);
        // the autopilot measures both well enough that their errors do not matter here
        self.controller.update(believed, &wish, truth.voltage_v, truth.density_kgm3, learn, self.loop_s)
    }

    fn push(&self, t_s: f64) -> Push {
        let mut push = Push::default();
        for d in &self.disturbances {
            let now = d.profile.at(t_s);
            match d.acts {
                Acts::ForceNed => push.force_ned_n += now,
                Acts::ForceFrd => push.force_frd_n += now,
                Acts::TorqueFrd => push.torque_frd_nm += now,
            }
        }
        push
    }
}

fn true_navigation(t: &Truth) -> Navigation {
    Navigation {
        position_ned_m: t.position_ned_m,
        velocity_ned_mps: t.velocity_ned_mps,
        body_to_ned: t.body_to_ned,
        rate_frd_rads: t.rate_frd_rads,
        accel_frd_mps2: t.specific_force_frd_mps2,
    }
}

/// A wind from a compass direction as the velocity of the air, NED.
pub fn wind_from(direction_from_rad: f64, speed_mps: f64) -> Vector3<f64> {
    -Vector3::new(direction_from_rad.cos(), direction_from_rad.sin(), 0.0) * speed_mps
}

#[cfg(test)]
#[path = "vehicle_tests.rs"]
mod tests;
