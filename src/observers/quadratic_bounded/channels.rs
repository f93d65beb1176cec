use super::filter::Filter;
use super::online::WrenchObserver;
use super::{NoiseBlock, SampledDesign, SampledPlant, design_cached};
use crate::observers::{BuildError, Dial, Observer, Options, Registration};
use crate::signal::Channel;
use crate::vehicle::{GRAVITY_MPS2, Vehicle};
use nalgebra::{DMatrix, dmatrix};
use std::ops::Range;
use std::sync::Arc;

pub const REGISTRATION: Registration = Registration {
    name: "quadratic_bounded",
    id: 1,
    paper: "Cayero, Rotondo, Morcego, Puig: Optimal state observation using quadratic boundedness (2019)",
    estimates: "residual force (NED) and torque (FRD) with bounds",
    needs: &[Channel::Imu, Channel::Attitude, Channel::Velocity, Channel::Actuators],
    options: &["alpha_force", "alpha_torque", "gust_s", "gust_factor"],
    prefix: "QB",
    dials: &[
        Dial {
            suffix: "ALPHA_F",
            option: "alpha_force",
            least: ALPHA[0],
            most: ALPHA[1],
            meaning: "decay rate of the force bounds, 1/s",
        },
        Dial {
            suffix: "ALPHA_T",
            option: "alpha_torque",
            least: ALPHA[0],
            most: ALPHA[1],
            meaning: "decay rate of the torque bounds, 1/s",
        },
    ],
    standard: true,
    builder,
};

/// Sample times at which the designs are certified, s: one for fast streams, one for slow ones.
const FAST_DT_S: [f64; 8] = [0.004, 0.007, 0.01, 0.015, 0.023, 0.04, 0.07, 0.12];
const SLOW_DT_S: [f64; 6] = [0.04, 0.07, 0.12, 0.2, 0.33, 0.55];
/// Least and greatest decay rate that is designed for, 1/s.
const ALPHA: [f64; 2] = [0.5, 20.0];
/// Steepest lean at which the noise bounds of the level axes are designed, rad.
const LEAN_RAD: f64 = 0.6;
/// Share of the torque envelope by which the modelled actuator torque may be wrong at any instant.
const TORQUE_MODEL_SHARE: f64 = 0.05;

/// Which streams a design serves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pace {
    Fast,
    Slow,
}

/// The two kinds of axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Family {
    Force,
    Torque,
}

impl Family {
    pub(super) fn of(axis: usize) -> Self {
        if axis < 3 { Self::Force } else { Self::Torque }
    }

    pub(super) fn axes(self) -> Range<usize> {
        match self {
            Self::Force => 0..3,
            Self::Torque => 3..6,
        }
    }
}

/// Declared bounds of one axis: momentum m, disturbance d, `ṁ = u + d + w`, `|w| ≤ input`, `|ḋ| ≤ rate`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) input: f64,
    pub(super) rate: f64,
    pub(super) momentum: f64,
    /// Of the direct measurement of d; `None` where there is none.
    pub(super) direct: Option<f64>,
    /// Largest |d|.
    envelope: f64,
}

/// The designs of the six world axes (force N, E, D, torque N, E, D) and the bounds they were made for.
#[derive(Debug, Clone)]
pub struct Channels {
    bounds: [Bounds; 6],
    fast: [Arc<SampledDesign>; 6],
    slow: [Arc<SampledDesign>; 6],
    hold_s: f64,
    gust_factor: f64,
}

impl Channels {
    pub(super) fn filters(&self, pace: Pace) -> [Filter; 6] {
        self.designs(pace).each_ref().map(|d| Filter::new(Arc::clone(d)))
    }

    fn designs(&self, pace: Pace) -> &[Arc<SampledDesign>; 6] {
        match pace {
            Pace::Fast => &self.fast,
            Pace::Slow => &self.slow,
        }
    }

    /// Is the design of this pace certified for this step?
    pub(super) fn covers(&self, pace: Pace, dt_s: f64) -> bool {
        let d = &self.designs(pace)[0];
        dt_s > 0.0 && d.dt_s.first().is_some_and(|first| dt_s >= *first) && dt_s <= d.longest_step_s()
    }

    /// Largest error of each state (momentum, disturbance) when all that is known is the envelope and one momentum
    /// sample, with the disturbance estimated as `d`.
    pub(super) fn envelope_box(&self, axis: usize, d: f64) -> [f64; 2] {
        let b = &self.bounds[axis];
        [b.momentum, b.envelope + d.abs().min(b.envelope)]
    }

    pub(super) fn envelope(&self, axis: usize) -> f64 {
        self.bounds[axis].envelope
    }

    /// Largest rate of the disturbance.
    pub(super) fn rate(&self, axis: usize) -> f64 {
        self.bounds[axis].rate
    }

    pub(super) fn momentum_noise(&self, axis: usize) -> f64 {
        self.bounds[axis].momentum
    }

    /// How long a breach of the rate bound is declared to last after it was last seen, s.
    pub(super) fn hold_s(&self) -> f64 {
        self.hold_s
    }

    /// A breach of the rate bound is declared to be at most this many times as large as what shows of it so far.
    pub(super) fn gust_factor(&self) -> f64 {
        self.gust_factor
    }
}

fn builder(vehicle: &Vehicle, options: &mut Options) -> Result<Box<dyn Observer>, BuildError> {
    let option = |source| BuildError::Option { observer: REGISTRATION.name, source };
    let [lo, hi] = ALPHA;
    let alpha_force = options.number("alpha_force", lo, hi).map_err(option)?.unwrap_or(4.0);
    let alpha_torque = options.number("alpha_torque", lo, hi).map_err(option)?.unwrap_or(8.0);
    let hold_s = options.number("gust_s", 0.0, 10.0).map_err(option)?.unwrap_or(0.5);
    let gust_factor = options.number("gust_factor", 1.0, 100.0).map_err(option)?.unwrap_or(4.0);
    let bounds = bounds_of(vehicle);
    let design = |nodes: &[f64], ceiling: f64| -> Result<Vec<Arc<SampledDesign>>, BuildError> {
        let mut made: Vec<Arc<SampledDesign>> = Vec::with_capacity(6);
        for (axis, b) in bounds.iter().enumerate() {
            // axes with the same bounds share one design
            if let Some(same) = bounds[..axis].iter().position(|x| x == b) {
                made.push(Arc::clone(&made[same]));
                continue;
            }
            let alpha = match Family::of(axis) {
                Family::Force => alpha_force,
                Family::Torque => alpha_torque,
            };
            let plant = plant(b);
            let design = design_cached(&plant, alpha.min(ceiling), nodes).map_err(|e| BuildError::Design {
                observer: REGISTRATION.name,
                part: format!("world axis {axis}"),
                source: Box::new(e),
            })?;
            made.push(Arc::new(design));
        }
        Ok(made)
    };
    let six = |v: Vec<Arc<SampledDesign>>| std::array::from_fn(|i| Arc::clone(&v[i]));
    let channels = Channels {
        fast: six(design(&FAST_DT_S, f64::INFINITY)?),
        // slow streams cannot keep up with a fast decay
        slow: six(design(&SLOW_DT_S, 2.0)?),
        bounds,
        hold_s,
        gust_factor,
    };
    Ok(Box::new(WrenchObserver::new(vehicle, channels)))
}

/// What the vehicle's declared noise and envelope mean on each world axis. The body's boxes are turned into the world
/// at every heading and up to [`LEAN_RAD`] of lean, at the worst.
pub(super) fn bounds_of(vehicle: &Vehicle) -> [Bounds; 6] {
    let (noise, envelope) = (&vehicle.noise, &vehicle.envelope);
    let mass = vehicle.mass_kg.range.hi();
    let accel: [f64; 3] = std::array::from_fn(|i| noise.accel_mps2[i] + noise.accel_bias_mps2[i]);
    let flat = accel[0].hypot(accel[1]);
    let level = flat + LEAN_RAD.sin() * accel[2];
    let upright = accel[2] + LEAN_RAD.sin() * flat;
    let horizontal = envelope.force_n[0].hypot(envelope.force_n[1]);
    // the direction of thrust is known to the tilt error; leaning, the rotors pull harder than the weight
    let thrust = mass * GRAVITY_MPS2 / LEAN_RAD.cos();
    let force = |i: usize| {
        // a small rotation moves a force by the angle times the part of it across the axis
        let (accel, turned, input) = if i < 2 {
            let turned = noise.yaw_rad * horizontal + noise.tilt_rad * envelope.force_n[2];
            (level, turned, noise.tilt_rad + LEAN_RAD.sin() * noise.yaw_rad)
        } else {
            (upright, noise.tilt_rad * horizontal, LEAN_RAD.sin() * noise.tilt_rad)
        };
        Bounds {
            input: thrust * input,
            rate: envelope.force_rate_nps[i],
            momentum: mass * noise.velocity_mps[i],
            direct: Some(mass * accel + turned),
            envelope: envelope.force_n[i],
        }
    };
    let inertia = vehicle.inertia_kgm2.diagonal();
    let roll_pitch = inertia[0].max(inertia[1]) * noise.gyro_rads[0].hypot(noise.gyro_rads[1]);
    let yaw = inertia[2] * noise.gyro_rads[2];
    let torque = |i: usize| {
        let (momentum, k, other) = if i < 2 { (roll_pitch, 0, 1) } else { (yaw, 2, 2) };
        let largest = envelope.torque_nm[k].max(envelope.torque_nm[other]);
        Bounds {
            input: TORQUE_MODEL_SHARE * largest,
            rate: envelope.torque_rate_nmps[k].max(envelope.torque_rate_nmps[other]),
            momentum,
            direct: None,
            envelope: largest,
        }
    };
    [force(0), force(1), force(2), torque(0), torque(1), torque(2)]
}

/// One axis as a plant with states (momentum, disturbance), r = 1 in the paper's notation: gusts and rotor faults
/// have no bounded higher derivative.
fn plant(b: &Bounds) -> SampledPlant {
    let ball = |radius: f64| DMatrix::from_element(1, 1, radius.powi(-2));
    let block = |w: DMatrix<f64>, radius: f64| NoiseBlock { w, q: ball(radius) };
    // a disturbance that is declared to be nothing has no ellipsoid
    let process = [(dmatrix![1.0; 0.0], b.input), (dmatrix![0.0; 1.0], b.rate)];
    let process = process.into_iter().filter(|(_, radius)| *radius > 0.0).map(|(w, radius)| block(w, radius)).collect();
    // what momentum alone can tell of d: two samples T apart give ±(2·momentum/T + input + rate·T/2), best at T = √(4·m/r)
    let by_momentum = (4.0 * b.momentum * b.rate).sqrt() + b.input;
    let (c, output) = match b.direct {
        // an output noisier than that adds nothing to the ellipsoid but ill-conditioned gains; the observer still
        // intersects with it
        Some(direct) if direct < by_momentum => {
            (DMatrix::identity(2, 2), vec![block(dmatrix![1.0; 0.0], b.momentum), block(dmatrix![0.0; 1.0], direct)])
        }
        _ => (dmatrix![1.0, 0.0], vec![block(dmatrix![1.0], b.momentum)]),
    };
    SampledPlant { a: dmatrix![0.0, 1.0; 0.0, 0.0], process, c, output, e1: DMatrix::identity(2, 2) }
}
