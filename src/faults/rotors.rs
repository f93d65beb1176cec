use super::health::Account;
use super::monitor::Monitor;
use super::weight::LEVER;
use crate::signal::{Guarantee, MAX_ROTORS, Measurement, Residual};
use crate::vehicle::{Air, GRAVITY_MPS2, ThrustCurve, Vehicle};
use nalgebra::{Matrix3, Vector2, Vector3};

/// A torque that lies off every rotor's direction by more than this share of itself is no rotor's.
const OFF: f64 = 0.4;
/// Share of thrust whose loss is told, by the slow and by the quick test.
const SLOW_LOSS: f64 = 0.08;
const QUICK_LOSS: f64 = 0.5;
/// Rotors whose torques about roll and pitch differ by less than this share are one above the other.
const TWIN: f64 = 0.1;
/// Yaw torque within this share of the difference of two twins tells which it is.
const YAW_TELLS: f64 = 0.3;
/// A vehicle that turns slower than this is under control, rad/s.
const CONTROLLED_RADS: f64 = 1.0;

/// The torque that the rotors' model leaves unexplained, without differentiating rates:
/// `d = (h − LP h)/τ − LP(u − ω×h)` with h = Jω and u the rotors' torque.
#[derive(Debug, Clone)]
struct Torque {
    tau_s: f64,
    momentum: Vector3<f64>,
    input: Vector3<f64>,
    residual: Vector3<f64>,
    since_s: f64,
}

impl Torque {
    fn new(tau_s: f64) -> Self {
        let zero = Vector3::zeros();
        Self { tau_s, momentum: zero, input: zero, residual: zero, since_s: 0.0 }
    }

    fn step(&mut self, momentum: Vector3<f64>, input: Vector3<f64>, dt_s: f64) {
        if self.since_s == 0.0 {
            (self.momentum, self.input) = (momentum, input);
        }
        self.since_s += dt_s;
        let keep = (-dt_s / self.tau_s).exp();
        self.momentum = momentum * (1.0 - keep) + self.momentum * keep;
        self.input = input * (1.0 - keep) + self.input * keep;
        // the discrete filter's own gain in place of 1/τ
        self.residual = (momentum - self.momentum) * ((1.0 - keep) / (keep * dt_s).max(1e-9)) - self.input;
    }

    fn settled(&self) -> bool {
        self.since_s > 4.0 * self.tau_s
    }
}

/// Loss of thrust of a rotor, from the torque that it leaves about roll and pitch.
#[derive(Debug, Clone)]
pub(super) struct Rotors {
    inertia: Matrix3<f64>,
    damping: Vector3<f64>,
    /// Torque about roll and pitch for each newton that a rotor lacks.
    lacking: [Vector2<f64>; MAX_ROTORS],
    /// The same about yaw, N m per N.
    yaw_lacking: [f64; MAX_ROTORS],
    count: usize,
    hover_n: f64,
    thrust: ThrustCurve,
    /// Thrust asked of each rotor, smoothed as `slow` is, N.
    asked_n: [f64; MAX_ROTORS],
    /// Torque about roll and pitch that a load beside the middle makes, N m.
    load_nm: Vector2<f64>,
    slow: Torque,
    quick: Torque,
    monitors: [Monitor; MAX_ROTORS],
    quick_monitors: [Monitor; MAX_ROTORS],
    loss: [f64; MAX_ROTORS],
    accounts: [Account; MAX_ROTORS],
}

impl Rotors {
    pub fn new(vehicle: &Vehicle) -> Self {
        let mut lacking = [Vector2::zeros(); MAX_ROTORS];
        let mut yaw_lacking = [0.0; MAX_ROTORS];
        for ((l, yaw), rotor) in lacking.iter_mut().zip(&mut yaw_lacking).zip(&vehicle.rotors) {
            let reaction = rotor.axis_frd * (rotor.spin.reaction_sign() * rotor.torque_ratio_m);
            let torque = reaction - rotor.position_frd_m.cross(&rotor.axis_frd);
            (*l, *yaw) = (torque.xy(), torque.z);
        }
        let count = vehicle.rotors.len().min(MAX_ROTORS);
        Self {
            inertia: vehicle.inertia_kgm2,
            damping: Vector3::from(vehicle.drag.angular),
            lacking,
            yaw_lacking,
            count,
            hover_n: vehicle.mass_kg.nominal * GRAVITY_MPS2 / count.max(1) as f64,
            thrust: vehicle.thrust,
            asked_n: [0.0; MAX_ROTORS],
            load_nm: Vector2::zeros(),
            slow: Torque::new(0.7),
            quick: Torque::new(0.06),
            monitors: [Monitor::new(0.8, 1.5); MAX_ROTORS],
            quick_monitors: [Monitor::new(0.06, 3.0); MAX_ROTORS],
            loss: [0.0; MAX_ROTORS],
            accounts: [Account::new(); MAX_ROTORS],
        }
    }

    /// Takes in one measurement. `lift_lacks_n` is the lift that is lacking beyond doubt.
    pub fn step(&mut self, m: &Measurement, lift_lacks_n: f64) {
        let Some(actuation) = m.actuation.filter(|a| a.age_s.abs() < 0.3).map(|a| a.value) else { return };
        if !(1e-4..0.2).contains(&m.dt_s) {
            self.restart();
            return;
        }
        let rate = m.imu.rate_frd_rads;
        let momentum = self.inertia * rate;
        let input = actuation.torque_frd_nm - rate.cross(&momentum) - self.damping.component_mul(&rate);
        self.slow.step(momentum, input, m.dt_s);
        self.quick.step(momentum, input, m.dt_s);
        let (slow, quick) = (self.slow.residual.xy() - self.load_nm, self.quick.residual.xy() - self.load_nm);
        let air = Air { voltage_v: m.voltage_v.map(|v| v.value), density_kgm3: None, climb_mps: 0.0 };
        let share = (m.dt_s / self.slow.tau_s).min(1.0);
        for i in 0..self.count {
            let asked = self.thrust.thrust_n(actuation.rotors.command[i], air);
            self.asked_n[i] += (asked - self.asked_n[i]) * if self.asked_n[i] == 0.0 { 1.0 } else { share };
        }
        if let Some(i) = (0..self.count).find(|i| self.quick_monitors[*i].active()) {
            // what turns over has torques of every direction: only calm ends this, and nothing else is read from it
            let controlled = rate.norm() < CONTROLLED_RADS;
            let calm = controlled && quick.norm() < 0.3 * QUICK_LOSS * self.hover_n * self.lacking[i].norm();
            if controlled {
                self.loss[i] = slow.dot(&self.lacking[i]) / self.lacking[i].norm_squared() / self.hover_n;
            }
            self.quick_monitors[i].see(if calm { 0.0 } else { 2.0 }, m.stamp, m.dt_s);
            if !self.quick_monitors[i].active() {
                self.restart();
            }
            return;
        }
        for i in 0..self.count {
            let s = self.lacking[i] * self.hover_n;
            let share = |w: Vector2<f64>| -> (f64, bool) {
                let loss = w.dot(&s) / s.norm_squared();
                (loss, (w - s * loss).norm() <= OFF * w.norm())
            };
            let (loss, fits) = share(slow);
            self.loss[i] = loss;
            if self.slow.settled() {
                let is_load = lift_lacks_n > LEVER * loss * self.hover_n;
                let ratio = loss.max(0.0) / SLOW_LOSS;
                let ratio = if fits && !is_load { ratio } else { ratio.min(0.9) };
                self.monitors[i].see(ratio, m.stamp, m.dt_s);
                self.accounts[i].see(1.0 - self.share_lost(i), m.dt_s);
            }
            let (loss, fits) = share(quick);
            if self.quick.settled() {
                let ratio = if fits || loss < QUICK_LOSS { loss.max(0.0) / QUICK_LOSS } else { 0.9 };
                self.quick_monitors[i].see(ratio, m.stamp, m.dt_s);
            }
        }
    }

    /// Forgets the past of the filters, after a gap or on the ground.
    pub fn restart(&mut self) {
        self.slow = Torque::new(self.slow.tau_s);
        self.quick = Torque::new(self.quick.tau_s);
        self.monitors.iter_mut().chain(&mut self.quick_monitors).for_each(Monitor::forget);
    }

    /// Takes the torque of now for that of the load.
    pub fn load(&mut self) {
        self.load_nm = self.slow.residual.xy();
    }

    pub fn unload(&mut self) {
        self.load_nm = Vector2::zeros();
    }

    /// Thrust that a rotor under suspicion lacks, N.
    pub fn lacks_n(&self) -> f64 {
        let worst = self.loss[..self.count].iter().copied().fold(0.0, f64::max);
        if self.slow.since_s > 0.0 && worst > 0.5 * SLOW_LOSS { worst * self.hover_n } else { 0.0 }
    }

    /// The rotor that is at fault, if one is, the bits of those that explain the torque as well, and the monitor that
    /// says so.
    pub fn told(&self) -> Option<(u8, u32, &Monitor, Residual)> {
        let active = |i: &usize| self.quick_monitors[*i].active() || self.monitors[*i].active();
        let best = (0..self.count).filter(active).max_by(|a, b| self.loss[*a].total_cmp(&self.loss[*b]))?;
        let (i, or) = self.likeliest(best);
        let quick = self.quick_monitors[i].active();
        let (monitor, admissible) =
            if quick { (&self.quick_monitors[i], QUICK_LOSS) } else { (&self.monitors[i], SLOW_LOSS) };
        let guarantee = Guarantee::Statistical(0.999);
        let value = self.share_lost(i).min(1.0);
        Some((i as u8, or, monitor, Residual { name: "rotor_loss", value, admissible, guarantee }))
    }

    /// Share that a rotor lacks of what is asked of it now, which a controller has raised.
    fn share_lost(&self, i: usize) -> f64 {
        self.loss[i] * self.hover_n / self.asked_n[i].max(0.3 * self.hover_n)
    }

    /// What each rotor gave so far.
    pub fn accounts(&self) -> &[Account] {
        &self.accounts[..self.count]
    }

    /// Rotors one above the other leave the same torque about roll and pitch. They turn against each other, so the yaw
    /// torque tells which it is, where it comes near to that of one of them; the bits are of those that remain.
    fn likeliest(&self, best: usize) -> (usize, u32) {
        let twin =
            |j: &usize| *j != best && (self.lacking[*j] - self.lacking[best]).norm() < TWIN * self.lacking[best].norm();
        let Some(other) = (0..self.count).find(twin) else { return (best, 0) };
        let lost_n = (self.slow.residual.xy() - self.load_nm).norm() / self.lacking[best].norm();
        let off = |j: usize| (self.slow.residual.z - lost_n * self.yaw_lacking[j]).abs();
        let apart = lost_n * (self.yaw_lacking[best] - self.yaw_lacking[other]).abs();
        match () {
            () if off(best) < YAW_TELLS * apart => (best, 0),
            () if off(other) < YAW_TELLS * apart => (other, 0),
            () => (best, 1 << other),
        }
    }

    /// The loss of every rotor that the slow torque would be, each taken for the only one.
    pub fn residuals(&self, told: &mut dyn FnMut(Residual)) {
        for loss in &self.loss[..self.count] {
            let guarantee = Guarantee::Statistical(0.999);
            told(Residual { name: "rotor_loss", value: *loss, admissible: SLOW_LOSS, guarantee });
        }
    }

    /// Is the vehicle out of control for the loss of a rotor?
    pub fn lost(&self) -> bool {
        self.quick_monitors[..self.count].iter().any(Monitor::active)
    }
}
