use super::attitude::Attitude;
use super::field::earth_field_ned_gauss;
use super::gains::{NavigationGains, NavigationGoal};
use super::heading::{Heading, HeadingNoise, wrap};
use super::translation::Translation;
use crate::observers::{BuildError, Observer, Options, Registration, StepError};
use crate::signal::{
    Channel, Discontinuity, Estimate, FixType, GnssFix, Guarantee, Held, Measurement, Signal, Stamp, Verdict,
};
use crate::vehicle::{GRAVITY_MPS2, Vehicle};
use nalgebra::{UnitQuaternion, Vector3};

pub const REGISTRATION: Registration = Registration {
    name: "gnss_ins",
    id: 3,
    paper: "Grip, Saberi, Johansen: Observers for interconnected nonlinear and linear systems (2012)",
    estimates: "attitude, velocity, position and gyro bias from raw inertial sensors, magnetometer and GNSS",
    needs: &[Channel::Imu, Channel::Magnetometer, Channel::Gnss],
    options: &[
        "gamma",
        "gamma_n",
        "position_noise_m",
        "velocity_noise_mps",
        "attitude_gain",
        "bias_gain",
        "heading_bend_deg",
        "declination_deg",
        "gnss_delay_s",
        "barometer",
    ],
    prefix: "INS",
    dials: &[],
    standard: true,
    builder,
};

const SIGNALS: [Signal; 12] = [
    Signal { name: "roll", unit: "rad", frame: "NED" },
    Signal { name: "pitch", unit: "rad", frame: "NED" },
    Signal { name: "yaw", unit: "rad", frame: "NED" },
    Signal { name: "velocity_n", unit: "m/s", frame: "NED" },
    Signal { name: "velocity_e", unit: "m/s", frame: "NED" },
    Signal { name: "velocity_d", unit: "m/s", frame: "NED" },
    Signal { name: "position_n", unit: "m", frame: "NED" },
    Signal { name: "position_e", unit: "m", frame: "NED" },
    Signal { name: "position_d", unit: "m", frame: "NED" },
    Signal { name: "gyro_bias_x", unit: "rad/s", frame: "FRD" },
    Signal { name: "gyro_bias_y", unit: "rad/s", frame: "FRD" },
    Signal { name: "gyro_bias_z", unit: "rad/s", frame: "FRD" },
];

/// GNSS older than this is lost: position and velocity coast, and so does the tilt, s.
const GNSS_LOST_S: f64 = 1.0;
/// After this long without GNSS nothing more is said of velocity, s.
const COAST_S: f64 = 10.0;
/// The barometer is silent after this, s.
const BAROMETER_LOST_S: f64 = 0.5;
/// Steps longer than this cannot be followed by the gyro, s.
const LONGEST_STEP_S: f64 = 0.5;
/// c_obs: least sine of the angle between field and specific force at which a magnetometer sample tells a heading.
const OBSERVABLE: f64 = 0.1;
/// Share by which the field's strength may differ from the model's before a sample is left out.
const STRENGTH: f64 = 0.35;
/// Least time between two uses of the magnetometer, s: samples closer than this share their error.
const MAG_INTERVAL_S: f64 = 0.045;
/// A gyro that stays below this, with the vehicle on the ground, stands still, rad/s.
const RESTING_RADS: f64 = 0.05;
/// A tilt that is off by more than this, and for this many time constants after, is not settled, rad.
const TILT_LOST_RAD: f64 = 0.2;
const TILT_SETTLES: f64 = 4.0;
/// Time from the start until the estimate is called settled, s.
const SETTLING_S: f64 = 15.0;
/// An innovation of this many standard deviations is at the edge of what noise explains.
const GATE: f64 = 6.0;

/// What the observer is told beside the measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavigationSettings {
    pub goal: NavigationGoal,
    pub heading: HeadingNoise,
    /// Γ of eq. (24d) for the tilt, 1/s, and that of the gyro bias, 1/s².
    pub attitude_gain: f64,
    pub bias_gain: f64,
    /// By how much a fix's stamp trails the instant it was true, s.
    pub gnss_delay_s: f64,
    /// In place of the magnetic model's.
    pub declination_rad: Option<f64>,
    /// Noise of the gyro about the vertical while it stands still, rad/s.
    pub resting_noise_rads: f64,
    pub barometer: bool,
}

impl Default for NavigationSettings {
    fn default() -> Self {
        Self {
            goal: NavigationGoal::default(),
            heading: HeadingNoise::default(),
            attitude_gain: 0.5,
            bias_gain: 0.02,
            gnss_delay_s: 0.0,
            declination_rad: None,
            resting_noise_rads: 0.01,
            barometer: true,
        }
    }
}

fn builder(vehicle: &Vehicle, options: &mut Options) -> Result<Box<dyn Observer>, BuildError> {
    let observer = REGISTRATION.name;
    let mut number =
        |key, lo, hi| options.number(key, lo, hi).map_err(|source| BuildError::Option { observer, source });
    let mut s = NavigationSettings { gnss_delay_s: vehicle.sensors.gnss_delay_s, ..NavigationSettings::default() };
    s.goal.gamma = number("gamma", 1e-3, 1e9)?.unwrap_or(s.goal.gamma);
    s.goal.gamma_n = number("gamma_n", 1e-3, 1e9)?;
    if let Some(sigma) = number("position_noise_m", 1e-3, 100.0)? {
        s.goal.position_noise_m = [sigma, 1.5 * sigma];
    }
    s.goal.velocity_noise_mps = number("velocity_noise_mps", 1e-3, 10.0)?.unwrap_or(s.goal.velocity_noise_mps);
    s.attitude_gain = number("attitude_gain", 1e-3, 10.0)?.unwrap_or(s.attitude_gain);
    s.bias_gain = number("bias_gain", 0.0, 1.0)?.unwrap_or(s.bias_gain);
    if let Some(bend) = number("heading_bend_deg", 0.1, 90.0)? {
        s.heading.bend_rad = bend.to_radians();
    }
    s.declination_rad = number("declination_deg", -180.0, 180.0)?.map(f64::to_radians);
    s.gnss_delay_s = number("gnss_delay_s", 0.0, 1.0)?.unwrap_or(s.gnss_delay_s);
    // the declared bound is three standard deviations of a sample; measurements come 10 ms apart or more
    let sigma = vehicle.noise.gyro_rads[2] / 3.0;
    s.heading.gyro_walk = s.heading.gyro_walk.max(0.1 * sigma);
    s.resting_noise_rads = s.resting_noise_rads.max(sigma);
    let flag = options.flag("barometer").map_err(|source| BuildError::Option { observer, source })?;
    s.barometer = flag.unwrap_or(s.barometer);
    let gains = NavigationGains::new(&s.goal).map_err(|source| BuildError::Design {
        observer,
        part: "gains".to_owned(),
        source: Box::new(source),
    })?;
    Ok(Box::new(NavigationObserver::new(s, gains)))
}

/// The navigation observer (24) of Grip, Saberi and Johansen (2012) on raw sensors, each at its own rate.
///
/// It uses nothing that the autopilot has estimated: IMU, magnetometer, GNSS fixes and, for the height, the barometer.
/// Attitude, velocity and position are therefore evidence of their own against the autopilot's.
///
/// # What it takes
/// Starts with TRIAD at the first three-dimensional fix, where it takes the vehicle not to accelerate. Coasts on the
/// gyro alone where field and specific force are parallel (‖m×a‖ < c_obs), and in tilt while GNSS is lost. The gyro's
/// bias is learnt from tilt and heading, and at once while the vehicle stands on the ground. The autopilot may subtract
/// its own, wrong, biases from what it sends (PX4 does): see `Heading` for what that does to the heading.
pub struct NavigationObserver {
    settings: NavigationSettings,
    gains: NavigationGains,
    state: Option<State>,
    /// Attitude to start from in place of TRIAD's.
    start: Option<UnitQuaternion<f64>>,
    estimate: Estimate,
}

#[derive(Debug, Clone)]
struct State {
    started: Stamp,
    stamp: Stamp,
    attitude: Attitude,
    heading: Heading,
    translation: Translation,
    field_ned_gauss: Vector3<f64>,
    /// When the tilt was last seen not to be settled.
    tilt_lost: Stamp,
    last_fix: Stamp,
    last_mag: Stamp,
    last_barometer: Option<Stamp>,
    /// Height of the last fix above the origin, m.
    receiver_height_m: f64,
    /// Largest innovation over its gate: of the last fix, and of the last heading.
    fix_residual: f64,
    heading_residual: f64,
}

impl NavigationObserver {
    pub fn new(settings: NavigationSettings, gains: NavigationGains) -> Self {
        Self { settings, gains, state: None, start: None, estimate: Estimate::unknown(SIGNALS.len()) }
    }

    /// Starts from this attitude, right or wrong, in place of the one that the first measurements show.
    pub fn start_from(&mut self, body_to_ned: UnitQuaternion<f64>) {
        self.start = Some(body_to_ned);
        self.state = None;
    }

    /// Body FRD to NED, once started.
    pub fn attitude(&self) -> Option<UnitQuaternion<f64>> {
        self.state.as_ref().map(|s| s.attitude.orthogonal())
    }

    pub fn gains(&self) -> &NavigationGains {
        &self.gains
    }

    /// Starts at a new three-dimensional fix, with a magnetometer sample at hand.
    fn begin(&self, m: &Measurement) -> Option<State> {
        let fix = m.gnss.filter(|g| g.new && g.value.fix_type >= FixType::ThreeD)?;
        let position = fix.value.position_ned_m?;
        let mag = m.magnetometer?.value.field_frd_gauss;
        let field = self.field(&fix.value, mag)?;
        let at_rest = Vector3::new(0.0, 0.0, -GRAVITY_MPS2);
        let seen = Attitude::triad([m.imu.accel_frd_mps2, mag], [at_rest, field])?;
        let attitude = self.start.unwrap_or(seen);
        let velocity = fix
            .value
            .ground_velocity_mps
            .map_or(Vector3::zeros(), |[n, e]| Vector3::new(n, e, fix.value.down_velocity_mps.unwrap_or(0.0)));
        Some(State {
            started: m.stamp,
            stamp: m.stamp,
            attitude: Attitude::new(attitude),
            heading: Heading::new(self.settings.heading),
            translation: Translation::new(self.gains, m.stamp, position, velocity),
            field_ned_gauss: field,
            tilt_lost: m.stamp,
            last_fix: fix.stamp,
            last_mag: m.stamp.plus_secs(-MAG_INTERVAL_S),
            last_barometer: None,
            receiver_height_m: -position.z,
            fix_residual: 0.0,
            heading_residual: 0.0,
        })
    }

    /// The Earth's field at a fix. With a declination given the field is taken as strong as it is measured; its
    /// inclination does not matter.
    fn field(&self, fix: &GnssFix, mag: Vector3<f64>) -> Option<Vector3<f64>> {
        match self.settings.declination_rad {
            None => earth_field_ned_gauss(fix.latitude_deg, fix.longitude_deg, fix.altitude_m, fix.unix_s),
            Some(declination) => {
                let (east, north) = declination.sin_cos();
                Some(Vector3::new(north, east, 1.0) * (mag.norm() / std::f64::consts::SQRT_2))
            }
        }
    }

    fn publish(&mut self, stamp: Stamp) {
        self.estimate.stamp = stamp;
        self.estimate.guarantee = Guarantee::None;
        let Some(s) = &self.state else {
            self.estimate.verdict = Verdict::Starved;
            return;
        };
        let (roll, pitch, yaw) = s.attitude.orthogonal().euler_angles();
        let groups =
            [Vector3::new(roll, pitch, yaw), s.translation.velocity(), s.translation.position(), s.attitude.bias()];
        for (value, x) in self.estimate.values.iter_mut().zip(groups.iter().flat_map(|v| v.iter())) {
            *value = *x;
        }
        let without_gnss = stamp - s.last_fix;
        self.estimate.residual = s.fix_residual.max(s.heading_residual);
        self.estimate.verdict = if without_gnss > COAST_S {
            Verdict::Starved
        } else if self.estimate.residual > 1.0 {
            Verdict::AssumptionViolated
        } else if stamp - s.started < SETTLING_S {
            Verdict::Settling
        } else {
            Verdict::Consistent
        };
    }
}

impl State {
    fn step(&mut self, m: &Measurement, settings: &NavigationSettings) {
        let dt_s = m.stamp - self.stamp;
        self.stamp = m.stamp;
        let accel = m.imu.accel_frd_mps2;
        self.attitude.turn(m.imu.rate_frd_rads, dt_s);
        self.heading.advance(dt_s);
        if (m.stamp - self.tilt_lost) * settings.attitude_gain < TILT_SETTLES {
            self.heading.doubt(dt_s);
        }
        self.rest(m, settings);
        if let Some(mag) = m.magnetometer.filter(|b| b.new) {
            self.magnetometer(m.stamp, mag.value.field_frd_gauss, accel);
        }
        let turned = self.attitude.to_ned(accel);
        if m.stamp - self.last_fix < GNSS_LOST_S {
            let force = self.translation.force(turned);
            let share = (settings.attitude_gain * dt_s).min(0.5);
            if self.attitude.level(accel, force, share, settings.bias_gain * dt_s) > TILT_LOST_RAD {
                self.tilt_lost = m.stamp;
            }
            self.translation.attitude_changed(self.attitude.to_ned(accel) - turned);
        } else {
            self.translation.forget_force((dt_s / GNSS_LOST_S).min(1.0));
        }
        self.translation.advance(m.stamp, self.attitude.to_ned(accel), dt_s);
        if settings.barometer {
            self.barometer(m);
        }
        if let Some(fix) = m.gnss.filter(|g| g.new && g.value.fix_type >= FixType::ThreeD) {
            self.fix(&fix, settings);
        }
    }

    /// On the ground the gyro shows its bias.
    fn rest(&mut self, m: &Measurement, settings: &NavigationSettings) {
        let rate = m.imu.rate_frd_rads;
        let lying = (m.imu.accel_frd_mps2.norm() - GRAVITY_MPS2).abs() < 0.5;
        if m.gate.armed == Some(false) && lying && rate.norm() < RESTING_RADS {
            let share = self.heading.rest(settings.resting_noise_rads);
            self.attitude.rest(rate, share);
        }
    }

    fn magnetometer(&mut self, stamp: Stamp, mag: Vector3<f64>, accel: Vector3<f64>) {
        let interval_s = stamp - self.last_mag;
        if interval_s < MAG_INTERVAL_S {
            return;
        }
        let (expected, strength) = (self.field_ned_gauss.norm(), mag.norm());
        let sine = mag.cross(&accel).norm() / (strength * accel.norm()).max(1e-9);
        if (strength - expected).abs() > STRENGTH * expected || sine < OBSERVABLE {
            return;
        }
        // compared in the level plane alone: a wrong inclination of the model, or of the sensor, does no harm
        let seen = self.attitude.to_ned(mag);
        if seen.xy().norm() < OBSERVABLE * strength {
            return;
        }
        self.last_mag = stamp;
        let before = self.attitude.to_ned(accel);
        let wanted = self.field_ned_gauss.y.atan2(self.field_ned_gauss.x) - seen.y.atan2(seen.x);
        let step = self.heading.correct(wrap(wanted), interval_s);
        self.attitude.turn_heading(step.turn_rad, step.bias_rads);
        self.translation.attitude_changed(self.attitude.to_ned(accel) - before);
        self.heading_residual = step.residual / GATE;
    }

    fn barometer(&mut self, m: &Measurement) {
        let silent = self.last_barometer.is_none_or(|last| m.stamp - last > BAROMETER_LOST_S);
        match m.barometer.filter(|b| b.new) {
            Some(b) => {
                let interval_s = self.last_barometer.map_or(0.02, |last| m.stamp - last).clamp(1e-3, 1.0);
                self.last_barometer = Some(m.stamp);
                let tied = (m.stamp - self.last_fix < GNSS_LOST_S).then_some(self.receiver_height_m);
                self.translation.height(b.value.altitude_m, tied, interval_s);
            }
            None if silent => self.translation.without_barometer(),
            None => {}
        }
    }

    fn fix(&mut self, fix: &Held<GnssFix>, settings: &NavigationSettings) {
        let Some(position) = fix.value.position_ned_m else { return };
        self.last_fix = fix.stamp;
        self.receiver_height_m = -position.z;
        let true_at = fix.stamp.plus_secs(-settings.gnss_delay_s);
        let velocity = (fix.value.ground_velocity_mps, fix.value.down_velocity_mps);
        let [p, v] = self.translation.fix(true_at, position, velocity.0, velocity.1);
        let goal = &settings.goal;
        // the receiver's own word, where it is larger than what was declared
        let declared = |said: Option<f64>, least: f64| GATE * said.unwrap_or(0.0).max(least);
        let level = declared(fix.value.horizontal_accuracy_m, goal.position_noise_m[0]);
        let speed = declared(fix.value.speed_accuracy_mps, goal.velocity_noise_mps);
        self.fix_residual = (p.xy().norm() / level).max(v.xy().norm() / speed);
    }
}

impl Observer for NavigationObserver {
    fn signals(&self) -> &[Signal] {
        &SIGNALS
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError> {
        let rebooted = matches!(m.discontinuity, Some(Discontinuity::First | Discontinuity::Reboot));
        let lost = self.state.as_ref().is_some_and(|s| !(0.0..=LONGEST_STEP_S).contains(&(m.stamp - s.stamp)));
        if rebooted || lost {
            self.state = None;
        }
        match &mut self.state {
            Some(state) => {
                state.step(m, &self.settings);
                if !state.attitude.settle() || !state.translation.is_finite() {
                    self.state = None;
                    self.publish(m.stamp);
                    return Err(StepError::NotFinite { signal: SIGNALS[0].name });
                }
            }
            None => self.state = self.begin(m),
        }
        self.publish(m.stamp);
        Ok(&self.estimate)
    }

    fn reset(&mut self) {
        self.state = None;
        self.estimate = Estimate::unknown(SIGNALS.len());
    }

    fn fresh(&self) -> Box<dyn Observer> {
        Box::new(Self::new(self.settings, self.gains))
    }
}
