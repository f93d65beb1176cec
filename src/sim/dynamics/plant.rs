use super::atmosphere::DensityProfile;
use super::rotors::{Lag, RotorStates};
use super::state::Rates;
use super::{Battery, Ground, MassProperties, Payload, RotorHealth, State, Truth, pressure_pa};
use crate::signal::{MAX_ROTORS, RotorCommands, Stamp};
use crate::vehicle::{Air, GRAVITY_MPS2, Spin, Vehicle, Wrench};
use nalgebra::{Matrix3, Quaternion, Vector2, Vector3};
use std::collections::VecDeque;

/// Rotor speed at full command where the vehicle file gives none: only reported, for such a rotor has no inertia.
const UNKNOWN_TOP_SPEED_RADS: f64 = 700.0;

/// What a plant is made of.
#[derive(Debug, Clone)]
pub struct PlantConfig {
    /// What really flies.
    pub vehicle: Vehicle,
    /// What the observers are told flies: the residual wrench of the truth is taken against this.
    pub model: Vehicle,
    pub battery: Option<Battery>,
    pub ground: Option<Ground>,
    /// Height of the local origin above mean sea level, m.
    pub home_altitude_m: f64,
    pub heading_rad: f64,
    /// Integration step, s.
    pub step_s: f64,
}

/// A push from outside on the body's origin, beside the air's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Push {
    pub force_ned_n: Vector3<f64>,
    pub force_frd_n: Vector3<f64>,
    pub torque_frd_nm: Vector3<f64>,
}

/// What acts over one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inputs {
    /// One command per rotor, 0..1.
    pub commands: [f64; MAX_ROTORS],
    /// Velocity of the air, NED, m/s.
    pub wind_ned_mps: Vector3<f64>,
    pub push: Push,
}

/// Six degrees of freedom of one multirotor.
#[derive(Debug, Clone)]
pub struct Plant {
    config: PlantConfig,
    empty: MassProperties,
    mass: MassProperties,
    health: [RotorHealth; MAX_ROTORS],
    density: DensityProfile,
    lag: Lag,
    model_lag: Lag,
    /// Commands that the rotors have reached.
    rotors: [f64; MAX_ROTORS],
    /// Where rotors in perfect order, as modelled, would be.
    model_rotors: [f64; MAX_ROTORS],
    /// Commands on their way to the rotors (transport delay), oldest in front.
    in_transit: VecDeque<[f64; MAX_ROTORS]>,
    /// Where each foot sticks to the ground.
    stuck_to: [Option<Vector2<f64>>; 4],
    /// Σ T^1.5 in hover, N^1.5: the load that draws the battery's hover current.
    hover_power: f64,
    state: State,
    steps: u64,
    last: Inputs,
}

/// Everything computed on the way to the accelerations at one instant.
struct Moment {
    rates: Rates,
    air_velocity_frd: Vector3<f64>,
    load: f64,
    touching: bool,
}

impl Plant {
    /// `None` when mass or inertia make no rigid body, or the step is not positive.
    pub fn new(config: PlantConfig) -> Option<Self> {
        let empty = MassProperties::empty(config.vehicle.mass_kg.nominal, config.vehicle.inertia_kgm2)?;
        let step = config.step_s;
        if step.is_nan() || step <= 0.0 {
            return None;
        }
        let dynamics = config.vehicle.dynamics;
        let n = config.vehicle.rotors.len().clamp(1, MAX_ROTORS) as f64;
        let in_transit = (dynamics.delay_s / step).round().clamp(0.0, 1e4) as usize;
        let voltage = config.battery.map_or(config.vehicle.thrust.voltage_ref_v.unwrap_or(0.0), |b| b.full_v);
        Some(Self {
            empty,
            mass: empty,
            health: [RotorHealth::Good; MAX_ROTORS],
            density: DensityProfile::around(config.home_altitude_m),
            lag: Lag::new(dynamics.time_constant_s, step),
            model_lag: Lag::new(config.model.dynamics.time_constant_s, step),
            rotors: [0.0; MAX_ROTORS],
            model_rotors: [0.0; MAX_ROTORS],
            in_transit: VecDeque::from(vec![[0.0; MAX_ROTORS]; in_transit]),
            stuck_to: [None; 4],
            hover_power: n * (empty.mass_kg * GRAVITY_MPS2 / n).powf(1.5),
            state: State::at_rest(config.heading_rad, voltage),
            steps: 0,
            last: Inputs::default(),
            config,
        })
    }

    pub fn state(&self) -> &State {
        &self.state
    }

    /// Places the vehicle.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
    }

    /// Commands that the rotors have reached, 0..1.
    pub fn rotors(&self) -> &[f64; MAX_ROTORS] {
        &self.rotors
    }

    /// Puts the rotors at a level, as if it had been commanded for long.
    pub fn set_rotors(&mut self, level: [f64; MAX_ROTORS]) {
        self.rotors = level;
        self.model_rotors = level;
        self.in_transit.iter_mut().for_each(|c| *c = level);
        self.last.commands = level;
    }

    pub fn vehicle(&self) -> &Vehicle {
        &self.config.vehicle
    }

    pub fn mass(&self) -> &MassProperties {
        &self.mass
    }

    pub fn step_s(&self) -> f64 {
        self.config.step_s
    }

    pub fn set_health(&mut self, rotor: usize, health: RotorHealth) {
        if let Some(h) = self.health.get_mut(rotor) {
            *h = health;
        }
    }

    /// Attaches this payload in place of any other, or drops what is carried. False, and no change, when the payload
    /// makes no rigid body.
    pub fn set_payload(&mut self, payload: Option<&Payload>) -> bool {
        let mass = payload.map_or(Some(self.empty), |p| self.empty.with(p));
        self.mass = mass.unwrap_or(self.mass);
        mass.is_some()
    }

    /// Boot time, exact: a count of steps.
    pub fn stamp(&self) -> Stamp {
        Stamp::from_secs(self.steps as f64 * self.config.step_s)
    }

    /// Moves by one step under inputs that are held over it.
    pub fn step(&mut self, inputs: &Inputs) {
        self.last = *inputs;
        if !self.in_transit.is_empty() {
            self.in_transit.push_back(inputs.commands);
            self.last.commands = self.in_transit.pop_front().unwrap_or(inputs.commands);
        }
        let h = self.config.step_s;
        let mut asked = self.last.commands;
        for (c, health) in asked.iter_mut().zip(&self.health) {
            if let RotorHealth::Stuck(at) = health {
                *c = *at;
            }
        }
        self.lag.begin(&mut self.rotors, &asked);
        self.model_lag.begin(&mut self.model_rotors, &self.last.commands);
        let mut spin = [RotorStates::default(); 3];
        self.lag.over_step(&self.rotors, &asked, &mut spin);
        let [start, middle, end] = &spin;

        let (s, inputs) = (&self.state, &self.last);
        let a = self.moment(s, start, inputs).rates;
        let b = self.moment(&s.moved(&a, 0.5 * h), middle, inputs).rates;
        let c = self.moment(&s.moved(&b, 0.5 * h), middle, inputs).rates;
        let d = self.moment(&s.moved(&c, h), end, inputs).rates;
        self.state = s.moved(&Rates::simpson(&a, &b, &c, &d), h);
        // the polynomial leaves the unit sphere by O(h⁵) a step
        self.state.attitude = self.state.attitude.normalize();
        self.lag.finish_step(&mut self.rotors, &asked);
        self.model_lag.finish_step(&mut self.model_rotors, &self.last.commands);
        self.stick();
        self.steps += 1;
    }

    #[inline]
    fn moment(&self, s: &State, rotors: &RotorStates, inputs: &Inputs) -> Moment {
        let vehicle = &self.config.vehicle;
        let to_ned = *s.body_to_ned().to_rotation_matrix().matrix();
        let wind_over = s.velocity_ned_mps - inputs.wind_ned_mps;
        let air = to_ned.tr_mul(&wind_over);
        let density = self.density.at(-s.position_ned_m.z);

        let spinning = self.rotor_effects(s, rotors, air, density);
        let push = &inputs.push;
        let drag = drag(vehicle, air, spinning.sum_sqrt_thrust, density);
        let damping = s.rate_frd_rads.component_mul(&Vector3::from(vehicle.drag.angular));
        let (ground, touching) = self.contact(s, &to_ned);

        // without gravity, which acts at the centre of mass and so gives no torque about it
        let force_frd = spinning.wrench.force_frd_n
            + drag
            + push.force_frd_n
            + to_ned.tr_mul(&push.force_ned_n)
            + ground.force_frd_n;
        let torque_origin = spinning.wrench.torque_frd_nm - damping + push.torque_frd_nm + ground.torque_frd_nm;

        let (w, c) = (s.rate_frd_rads, self.mass.centre_frd_m);
        let torque = torque_origin
            - c.cross(&force_frd)
            - w.cross(&(self.mass.inertia_kgm2 * w + spinning.momentum))
            - spinning.momentum_rate;
        let angular_acceleration = self.mass.inverse_inertia * torque;
        let at_origin = force_frd / self.mass.mass_kg - angular_acceleration.cross(&c) - w.cross(&w.cross(&c));

        let load = spinning.power / self.hover_power;
        let (voltage, used) =
            self.config.battery.as_ref().map_or((0.0, 0.0), |b| b.rates(s.voltage_v, s.used_as, load));
        Moment {
            rates: Rates {
                velocity: s.velocity_ned_mps,
                acceleration: to_ned * at_origin + Vector3::z() * GRAVITY_MPS2,
                attitude: s.attitude * Quaternion::from_imag(w) * 0.5,
                angular_acceleration,
                voltage,
                used,
            },
            air_velocity_frd: air,
            load,
            touching,
        }
    }

    fn rotor_effects(&self, s: &State, rotors: &RotorStates, air_frd: Vector3<f64>, density: f64) -> Spinning {
        let Vehicle { thrust: curve, dynamics, rotors: bank, .. } = &self.config.vehicle;
        let mut sum = Spinning::default();
        for (i, rotor) in bank.iter().enumerate().take(MAX_ROTORS) {
            let air = Air {
                voltage_v: Some(s.voltage_v),
                density_kgm3: Some(density),
                climb_mps: rotor.axis_frd.dot(&air_frd),
            };
            let level = rotors.level[i];
            let thrust = curve.thrust_n(level, air) * self.health[i].thrust_share();
            let sign = rotor.spin.reaction_sign();
            let force = rotor.axis_frd * thrust;
            sum.wrench.force_frd_n += force;
            sum.wrench.torque_frd_nm +=
                rotor.position_frd_m.cross(&force) - rotor.axis_frd * (sign * rotor.torque_ratio_m * thrust);
            let root = thrust.sqrt();
            sum.sum_sqrt_thrust += root;
            sum.power += thrust * root;
            if dynamics.inertia_kgm2 > 0.0 {
                let (speed, acceleration) = self.speed(i, s.voltage_v, level, rotors.rate[i]);
                // a counter-clockwise rotor's momentum points along its thrust
                let along = rotor.axis_frd * (sign * dynamics.inertia_kgm2);
                sum.momentum += along * speed;
                sum.momentum_rate += along * acceleration;
            }
        }
        sum
    }

    /// Speed (rad/s) and acceleration (rad/s²) of a rotor whose command is at `level` and moves at `rate`: static
    /// thrust goes with the square of the speed.
    fn speed(&self, i: usize, voltage_v: f64, level: f64, rate: f64) -> (f64, f64) {
        let Vehicle { thrust: curve, dynamics, .. } = &self.config.vehicle;
        let c = level.clamp(0.0, 1.0);
        let shape = (1.0 - curve.expo) * c + curve.expo * c * c;
        let slope = (1.0 - curve.expo) + 2.0 * curve.expo * c;
        let top = if dynamics.max_speed_rads > 0.0 { dynamics.max_speed_rads } else { UNKNOWN_TOP_SPEED_RADS };
        let full = top * self.health[i].speed_share() * curve.voltage_ref_v.map_or(1.0, |v_ref| voltage_v / v_ref);
        // below 1 % of full speed the square root is too steep to differentiate, and nothing turns that matters
        let root = shape.sqrt();
        let acceleration = if root > 0.01 { full * slope * rate / (2.0 * root) } else { 0.0 };
        (full * root, acceleration)
    }

    fn contact(&self, s: &State, to_ned: &Matrix3<f64>) -> (Wrench, bool) {
        let mut wrench = Wrench::default();
        let Some(ground) = self.ground_in_reach(s) else { return (wrench, false) };
        let mut touching = false;
        for (foot, stuck_to) in ground.feet().iter().zip(&self.stuck_to) {
            let (at, velocity) = foot_motion(s, to_ned, foot);
            if let Some(force_ned) = ground.force(at, velocity, stuck_to.unwrap_or(at.xy())) {
                let force = to_ned.tr_mul(&force_ned);
                wrench.force_frd_n += force;
                wrench.torque_frd_nm += foot.cross(&force);
                touching = true;
            }
        }
        (wrench, touching)
    }

    fn stick(&mut self) {
        let Some(ground) = self.ground_in_reach(&self.state).copied() else {
            self.stuck_to = [None; 4];
            return;
        };
        let to_ned = *self.state.body_to_ned().to_rotation_matrix().matrix();
        for (foot, stuck_to) in ground.feet().iter().zip(&mut self.stuck_to) {
            let (at, velocity) = foot_motion(&self.state, &to_ned, foot);
            *stuck_to = ground.stick(at, velocity, *stuck_to);
        }
    }

    fn ground_in_reach(&self, s: &State) -> Option<&Ground> {
        self.config.ground.as_ref().filter(|g| g.in_reach(s.position_ned_m.z))
    }

    /// The truth now: accelerations under the inputs of the last step, and the residual wrench against the model.
    pub fn truth(&self) -> Truth {
        let (s, model) = (&self.state, &self.config.model);
        let n = self.config.vehicle.rotors.len().min(MAX_ROTORS);
        let mut rotors = RotorStates { level: self.rotors, ..RotorStates::default() };
        for i in 0..MAX_ROTORS {
            rotors.rate[i] = match self.health[i] {
                RotorHealth::Stuck(_) => 0.0,
                _ => self.lag.rate_towards(self.last.commands[i], self.rotors[i]),
            };
        }
        let m = self.moment(s, &rotors, &self.last);
        let to_ned = s.body_to_ned();
        let down = Vector3::z() * GRAVITY_MPS2;
        let density = self.density.at(-s.position_ned_m.z);

        let commands = RotorCommands { command: self.model_rotors, count: n };
        let air = Air { voltage_v: Some(s.voltage_v), density_kgm3: Some(density), climb_mps: -m.air_velocity_frd.z };
        let (explained, _) = model.rotor_wrench(&commands, air);
        let (a, w, dw) = (m.rates.acceleration, s.rate_frd_rads, m.rates.angular_acceleration);
        let inertia = model.inertia_kgm2;
        let mut rotor_speed_rads = [0.0; MAX_ROTORS];
        for (i, speed) in rotor_speed_rads.iter_mut().enumerate().take(n) {
            *speed = self.speed(i, s.voltage_v, self.rotors[i], 0.0).0;
        }
        Truth {
            stamp: self.stamp(),
            position_ned_m: s.position_ned_m,
            velocity_ned_mps: s.velocity_ned_mps,
            acceleration_ned_mps2: a,
            body_to_ned: to_ned,
            rate_frd_rads: w,
            angular_acceleration_frd_rads2: dw,
            specific_force_frd_mps2: to_ned.inverse_transform_vector(&(a - down)),
            wind_ned_mps: self.last.wind_ned_mps,
            air_velocity_frd_mps: m.air_velocity_frd,
            residual_force_ned_n: (a - down) * model.mass_kg.nominal - to_ned * explained.force_frd_n,
            residual_torque_frd_nm: inertia * dw + w.cross(&(inertia * w)) - explained.torque_frd_nm,
            commands: self.last.commands,
            rotors: self.rotors,
            rotor_speed_rads,
            rotor_count: n,
            mass_kg: self.mass.mass_kg,
            payload_kg: self.mass.mass_kg - model.mass_kg.nominal,
            voltage_v: s.voltage_v,
            current_a: self.config.battery.map_or(0.0, |b| b.current_a(m.load)),
            battery_left: self.config.battery.map_or(1.0, |b| b.remaining(s.used_as)),
            density_kgm3: density,
            pressure_pa: pressure_pa(self.config.home_altitude_m - s.position_ned_m.z),
            on_ground: m.touching,
        }
    }

    /// Angular momentum of body and rotors about the centre of mass, NED, N m s. Conserved without outside torque.
    pub fn angular_momentum_ned(&self) -> Vector3<f64> {
        let s = &self.state;
        let mut h = self.mass.inertia_kgm2 * s.rate_frd_rads;
        let dynamics = &self.config.vehicle.dynamics;
        for (i, rotor) in self.config.vehicle.rotors.iter().enumerate().take(MAX_ROTORS) {
            let speed = self.speed(i, s.voltage_v, self.rotors[i], 0.0).0;
            let sign = if rotor.spin == Spin::Ccw { 1.0 } else { -1.0 };
            h += rotor.axis_frd * (sign * dynamics.inertia_kgm2 * speed);
        }
        s.body_to_ned() * h
    }
}

/// Place and velocity of a foot, NED.
fn foot_motion(s: &State, to_ned: &Matrix3<f64>, foot: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (s.position_ned_m + to_ned * foot, s.velocity_ned_mps + to_ned * s.rate_frd_rads.cross(foot))
}

/// What the rotors do to the body.
#[derive(Default)]
struct Spinning {
    wrench: Wrench,
    sum_sqrt_thrust: f64,
    /// Σ T^1.5.
    power: f64,
    /// Angular momentum of the rotors, body FRD, N m s, and its rate as the body sees it.
    momentum: Vector3<f64>,
    momentum_rate: Vector3<f64>,
}

fn drag(vehicle: &Vehicle, air: Vector3<f64>, sum_sqrt_thrust: f64, density: f64) -> Vector3<f64> {
    let d = &vehicle.drag;
    Vector3::new(
        d.force(0, air.x, sum_sqrt_thrust, density),
        d.force(1, air.y, sum_sqrt_thrust, density),
        d.force(2, air.z, sum_sqrt_thrust, density),
    )
}
