use super::monitor::Monitor;
use crate::signal::{Guarantee, Measurement, Residual, Stamp};
use crate::vehicle::{Flying, GRAVITY_MPS2, Vehicle};

/// Share of the model's mass that may be missing; more than that is the ground's doing.
const MOST_DROPPED: f64 = 0.3;
/// Smoothing of force and acceleration, s.
const SMOOTH_S: f64 = 0.25;
/// The size that it begins with counts as much as this time, s.
const BEGIN_S: f64 = 5.0;
/// The vertical wind that would explain what departs from the mean of this time, s, is learnt at this pace, s, while
/// nothing changes. It begins at this size, m/s, one departure counts as at most so many standard deviations, and so
/// many are lawful.
const MEAN_S: f64 = 8.0;
const LEARN_S: f64 = 40.0;
const GUST_MPS: f64 = 0.3;
const CLIP: f64 = 3.0;
const GUSTS: f64 = 4.5;
/// What has sunk at this speed, m/s, within this time, s, may have met the ground: that is no load put down.
const SINKING_MPS: f64 = 0.3;
const SUNK_S: f64 = 3.0;
/// A change is measured from so long after it was told, and over this time, s; till then it is spoken of.
const SETTLE_S: f64 = 1.0;
const MEASURE_S: f64 = 2.0;
/// A load that is carried counts as put down when so much of the admissible is lacking and the model's mass fits better.
const PUT_DOWN: f64 = 0.6;
/// What is carried is followed at this pace, s.
const FOLLOW_S: f64 = 30.0;

/// A rotor that lacks thrust looks like at most this many times as much weight while both are being smoothed; what
/// weighs more for the torque that comes with it is a load beside the middle.
pub(super) const LEVER: f64 = 2.5;

/// The mass that force and acceleration along the thrust axis show, `M·s = f + drag`, against the model's and what is
/// known to be carried: told when it changes, up or down.
#[derive(Debug, Clone)]
pub(super) struct Weight {
    vehicle: Vehicle,
    force_n: f64,
    acceleration_mps2: f64,
    seen_s: f64,
    mean_kg: f64,
    /// What a vertical wind weighs.
    kg_per_mps: f64,
    /// Mean square of the vertical wind, m²/s².
    gust_mps2: f64,
    /// What that has been learnt from, s.
    learnt_s: f64,
    admissible_kg: f64,
    /// Smoothed speed downwards, and for how long it has been slow.
    sinking_mps: f64,
    sunk_s: f64,
    /// What is carried beyond the model's mass, as far as it has been told.
    carried_kg: f64,
    change: Option<Change>,
    monitor: Monitor,
}

/// The last change of mass.
#[derive(Debug, Clone, Copy)]
struct Change {
    onset: Stamp,
    before_kg: f64,
    measured_kg: f64,
    /// As it is told.
    size_kg: f64,
    since_s: f64,
}

impl Weight {
    pub fn new(vehicle: &Vehicle) -> Self {
        Self {
            vehicle: vehicle.clone(),
            force_n: 0.0,
            acceleration_mps2: 0.0,
            seen_s: 0.0,
            mean_kg: 0.0,
            kg_per_mps: 0.0,
            gust_mps2: GUST_MPS * GUST_MPS,
            learnt_s: BEGIN_S,
            admissible_kg: f64::INFINITY,
            sinking_mps: 0.0,
            sunk_s: SUNK_S,
            carried_kg: 0.0,
            change: None,
            monitor: Monitor::new(0.3, 0.3),
        }
    }

    /// Takes in one measurement. `rotor_lacks_n` is the thrust that a rotor under suspicion lacks: weight that this
    /// explains is none.
    pub fn step(&mut self, m: &Measurement, rotor_lacks_n: f64) {
        let (Some(q), Some(v), Some(a)) = (m.attitude, m.velocity_ned_mps, m.actuation) else { return };
        let density = m.air_density_kgm3.map(|d| d.value).or(self.vehicle.thrust.density_ref_kgm3).unwrap_or(1.225);
        let drag = |v: f64| self.vehicle.drag.force(2, v, a.value.sum_sqrt_thrust, density);
        let lateral = m.imu.accel_frd_mps2.xy() * self.mass_kg();
        let climb = self.vehicle.climb_through_air(&Flying {
            rotation: q.value.to_rotation_matrix().into_inner(),
            velocity_ned_mps: v.value,
            lateral_n: lateral.into(),
            lateral_half_width_n: [0.0; 2],
            sum_sqrt_thrust: a.value.sum_sqrt_thrust,
            density_kgm3: density,
        });
        let (through_air, reckoned) = (climb.likely_mps.max(0.0), a.value.climb_mps.max(0.0));
        let inflow = a.value.inflow_n_per_mps2 * (through_air.powi(2) - reckoned.powi(2));
        let force = a.value.force_frd_n.z + inflow + drag(-climb.likely_mps);
        let acceleration = m.imu.accel_frd_mps2.z;
        if self.seen_s == 0.0 {
            (self.force_n, self.acceleration_mps2) = (force, acceleration);
        }
        self.seen_s += m.dt_s;
        let share = 1.0 - (-m.dt_s / SMOOTH_S).exp();
        self.force_n += (force - self.force_n) * share;
        self.acceleration_mps2 += (acceleration - self.acceleration_mps2) * share;
        // what thrust law, accelerometer and vertical wind leave open
        let mass = &self.vehicle.mass_kg;
        let thrust = &self.vehicle.thrust.max_n;
        let law = thrust.range.radius() / thrust.nominal + a.value.doubt;
        let bias = self.vehicle.noise.accel_bias_mps2[2] / GRAVITY_MPS2;
        let still = mass.nominal * (law + bias + 0.02) + mass.range.radius();
        // the faster the flow along the thrust axis, the more a gust changes of drag and inflow
        let upward = |v: f64| drag(-v) + a.value.inflow_n_per_mps2 * v.max(0.0).powi(2);
        let slope = 0.5 * (upward(climb.likely_mps + 1.0) - upward(climb.likely_mps - 1.0)).abs();
        self.kg_per_mps += (slope / GRAVITY_MPS2 - self.kg_per_mps) * share;
        let gusts = (GUSTS * self.gust_mps2.sqrt()).max(self.vehicle.envelope.vertical_wind_mps);
        self.admissible_kg = still + self.kg_per_mps * gusts;
        let value = self.residual().value;
        if self.residual().ratio() < 1.0 && self.settled() {
            let most = CLIP * self.gust_mps2.sqrt();
            let gust = ((value - self.mean_kg) / self.kg_per_mps.max(1e-3 * mass.nominal)).clamp(-most, most);
            self.mean_kg += (value - self.mean_kg) * (m.dt_s / MEAN_S).min(1.0);
            self.learnt_s = (self.learnt_s + m.dt_s).min(LEARN_S);
            self.gust_mps2 += (gust * gust - self.gust_mps2) * (m.dt_s / self.learnt_s).min(1.0);
        }
        if self.seen_s > 4.0 * SMOOTH_S {
            let by_rotor = (0.0..=LEVER * rotor_lacks_n).contains(&(value * GRAVITY_MPS2));
            let put_down = self.carried_kg != 0.0 && (value + self.carried_kg).abs() < 0.5 * value.abs();
            let ratio = self.residual().ratio() / if put_down { PUT_DOWN } else { 1.0 };
            let landing = value < 0.0 && self.sunk_s < SUNK_S;
            let ratio = match () {
                () if self.held() => 0.0,
                () if by_rotor || landing => ratio.min(0.9),
                () => ratio,
            };
            self.monitor.see(ratio, m.stamp, m.dt_s);
        }
        self.sinking_mps += (v.value.z - self.sinking_mps) * m.dt_s.min(1.0);
        self.sunk_s = if self.sinking_mps > SINKING_MPS { 0.0 } else { self.sunk_s + m.dt_s };
        self.follow(m.dt_s);
    }

    /// Does something else carry the vehicle? Nobody drops this much.
    pub fn held(&self) -> bool {
        let nominal = self.vehicle.mass_kg.nominal;
        self.seen_s > 4.0 * SMOOTH_S && self.residual().value + self.carried_kg < -MOST_DROPPED * nominal
    }

    /// Is no change being measured?
    pub fn settled(&self) -> bool {
        self.change.is_none_or(|c| c.since_s >= SETTLE_S + MEASURE_S)
    }

    /// From a change that is told to the mass that is carried.
    fn follow(&mut self, dt_s: f64) {
        let value = self.residual().value;
        let was_settled = self.settled();
        if let Some(change) = &mut self.change {
            change.since_s += dt_s;
            let measured_s = change.since_s - SETTLE_S;
            if measured_s <= 0.0 {
                change.measured_kg = value;
            } else if !was_settled {
                change.measured_kg += (value - change.measured_kg) * (dt_s / measured_s).min(1.0);
            }
            let now_kg = change.before_kg + change.measured_kg;
            // what was put down is what was carried
            let put_down = change.before_kg != 0.0 && now_kg.abs() < PUT_DOWN * self.admissible_kg;
            change.size_kg = if put_down { -change.before_kg } else { change.measured_kg };
        }
        if let (false, true, Some(change)) = (was_settled, self.settled(), self.change) {
            let carried = change.before_kg + change.measured_kg;
            self.carried_kg = if carried.abs() > PUT_DOWN * self.admissible_kg { carried } else { 0.0 };
            self.mean_kg = 0.0;
            self.monitor.forget();
            if self.carried_kg == 0.0 {
                self.change = None;
            }
        }
        if let (true, Some(onset)) = (self.settled(), self.monitor.onset()) {
            self.change =
                Some(Change { onset, before_kg: self.carried_kg, measured_kg: value, size_kg: value, since_s: 0.0 });
        } else if let (true, Some(change)) = (self.settled(), &mut self.change) {
            // a true mean at first, which then forgets
            self.carried_kg += value * (dt_s / change.since_s.min(FOLLOW_S)).min(1.0);
            change.size_kg = self.carried_kg - change.before_kg;
        }
    }

    /// Forgets the past of the filters: what is carried stays.
    pub fn restart(&mut self) {
        (self.seen_s, self.mean_kg) = (0.0, 0.0);
        self.monitor.forget();
    }

    /// On the ground loads change unseen.
    pub fn land(&mut self) {
        self.restart();
        (self.carried_kg, self.change) = (0.0, None);
    }

    /// What force and acceleration make of the mass.
    fn mass_kg(&self) -> f64 {
        if self.seen_s == 0.0 {
            return self.vehicle.mass_kg.nominal + self.carried_kg;
        }
        self.force_n / self.acceleration_mps2.min(-1.0)
    }

    /// The mass beyond what is known to be carried.
    pub fn residual(&self) -> Residual {
        let guarantee = Guarantee::Statistical(0.999);
        let value = self.mass_kg() - self.vehicle.mass_kg.nominal - self.carried_kg;
        Residual { name: "payload_kg", value, admissible: self.admissible_kg, guarantee }
    }

    /// The last change of what is carried: when, and by how much, kg.
    pub fn told(&self) -> Option<(Stamp, f64)> {
        self.change.map(|c| (c.onset, c.size_kg))
    }

    /// Lift that is lacking beyond doubt, N; without bound while a change is being measured.
    pub fn lacks_n(&self) -> f64 {
        if !self.settled() {
            return f64::INFINITY;
        }
        let residual = self.residual();
        if self.seen_s > 4.0 * SMOOTH_S && residual.ratio() > 1.0 { residual.value.abs() * GRAVITY_MPS2 } else { 0.0 }
    }
}
