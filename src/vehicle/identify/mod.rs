//! A vehicle model from a recorded flight: the mathematics, without MAVLink.
//!
//! In: a [`Flight`] (samples in SI units) and an [`Airframe`] (where the rotors are and what commands mean). Out:
//! [`Identified`], every quantity with a standard deviation and, where the flight does not show it well, the manoeuvre
//! that would; [`text::vehicle_file`] writes it as a vehicle file, [`compare`] holds it against another flight.
//!
//! What telemetry can tell is relative to mass: thrust, drag and torque per kilogram. The mass has to be weighed and
//! one length (the arm) to be measured; both are asked for, and what stands in for them is said.
//! The wind is never needed: it is estimated beside the drag ([`drag`]).

mod bins;
mod compare;
pub mod drag;
mod flight;
mod noise;
mod regress;
mod scale;
mod series;
mod smooth;
pub mod text;
mod thrust;
mod torque;

pub use compare::{Comparison, compare};
pub use flight::Flight;
pub use noise::Noise;
pub use scale::{Arm, ArmOrigin};
pub use series::Series;
pub use thrust::ThrustFit;
pub use torque::{AxisFit, TorqueFit, levers};

use super::airframe::Airframe;
use bins::{Bin, Reference};
use drag::{DragFit, Form, Layout};

/// A number from a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// What would show it better; `None` where it is well observed.
    pub missing: Option<&'static str>,
}

impl Quantity {
    pub(crate) fn observed(value: f64, sigma: f64) -> Self {
        Self { value, sigma, missing: None }
    }

    pub(crate) fn unknown(missing: &'static str) -> Self {
        Self { value: f64::NAN, sigma: f64::INFINITY, missing: Some(missing) }
    }

    pub fn is_known(&self) -> bool {
        self.value.is_finite()
    }

    /// "well observed", or what is missing.
    pub fn verdict(&self) -> String {
        self.missing.map_or_else(|| "well observed".to_owned(), |m| format!("weak: {m}"))
    }
}

/// Drag per mass across the thrust axis.
#[derive(Debug, Clone, Copy)]
pub struct LateralDrag {
    /// Does the linear part grow with Σ√T?
    pub form: Form,
    /// On the forward and the right axis, 1/s, at the mean Σ√T.
    pub linear: [Quantity; 2],
    /// 1/m.
    pub quadratic: [Quantity; 2],
    /// Deceleration at 5 m/s through the air, m/s².
    pub at_5_mps: [Quantity; 2],
    /// The airspeed that 5 % of the flight exceeds, m/s.
    pub airspeed_mps: f64,
    /// Is one law for both axes as good?
    pub isotropic: bool,
}

/// A vehicle as its flight shows it.
#[derive(Debug, Clone)]
pub struct Identified {
    pub airframe: Airframe,
    pub flown_s: f64,
    /// Voltage and density that the thrust scale refers to.
    pub voltage_ref_v: Option<f64>,
    pub density_ref_kgm3: Option<f64>,
    pub thrust: ThrustFit,
    /// Does thrust follow the square of the voltage?
    pub follows_voltage: bool,
    /// Mean of Σ√(shape): Σ√T over √(full thrust of a rotor).
    pub mean_sqrt_shape: f64,
    pub drag: Option<LateralDrag>,
    /// `None` where the telemetry is too slow to show rotation.
    pub torque: Option<TorqueFit>,
    pub noise: Noise,
}

/// Why a flight shows nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    #[error("the log lacks {0}; ask the autopilot for it at 50 Hz (`mavobserver run` does) and fly again")]
    Missing(&'static str),
    #[error("no free flight of ten seconds or more in the log: the vehicle is never armed and in the air for long")]
    NoFlight,
    #[error(
        "the channels of the log do not overlap for long enough ({0} tenths of a second with all of them); is a stream too slow?"
    )]
    TooLittle(usize),
    #[error(
        "the thrust scale comes out of the data as {0:.3} N/kg a rotor, which no rotor has; are the outputs those of the motors?"
    )]
    Absurd(f64),
}

/// Windows in which the wind counts as constant, s: the middle one gives the answer, all three its uncertainty.
const WINDOWS_S: [f64; 3] = [6.0, 4.0, 9.0];
/// Fewer bins than this are no flight.
const FEWEST_BINS: usize = 100;
/// Drag is told from velocity changes; smaller ones than this within a window are hardly any, m/s.
const EXCURSION_MPS: f64 = 1.0;

/// What is said of drag at 5 m/s rests on flight at about that airspeed, m/s.
const FAST_MPS: f64 = 4.0;

/// Identifies the vehicle from its flight.
///
/// # Errors
/// [`IdentifyError`] where a channel is missing or nothing was flown.
pub fn identify(flight: &Flight, airframe: &Airframe) -> Result<Identified, IdentifyError> {
    let missing = [
        (flight.imu().is_empty(), "an IMU message (RAW_IMU, SCALED_IMU or HIGHRES_IMU)"),
        (flight.attitude.is_empty(), "attitude (ATTITUDE_QUATERNION or ATTITUDE)"),
        (flight.velocity.is_empty(), "velocity (LOCAL_POSITION_NED or GLOBAL_POSITION_INT)"),
        (flight.outputs.is_empty(), "motor outputs (SERVO_OUTPUT_RAW or ACTUATOR_OUTPUT_STATUS)"),
    ];
    if let Some((_, what)) = missing.iter().find(|(is_missing, _)| *is_missing) {
        return Err(IdentifyError::Missing(what));
    }
    let spans = flight.airborne();
    if spans.is_empty() {
        return Err(IdentifyError::NoFlight);
    }
    let mut reference = Reference::of(flight, &spans);
    let mut bins = bins::bins(flight, airframe, reference, &spans);
    if bins.len() < FEWEST_BINS {
        return Err(IdentifyError::TooLittle(bins.len()));
    }
    let singular = IdentifyError::Absurd(f64::NAN);
    let first = thrust::fit(&bins, reference, None).ok_or(singular.clone())?;
    let exponent = first.voltage_exponent;
    let follows_voltage = reference.voltage_v.is_some() && !(exponent.missing.is_none() && exponent.value < 1.0);
    if !follows_voltage {
        reference.voltage_v = None;
        bins = bins::bins(flight, airframe, reference, &spans);
    }
    let lateral = lateral(&bins);
    let thrust = thrust::fit(&bins, reference, lateral.as_ref().map(|(_, fit)| fit)).ok_or(singular)?;
    let thrust = ThrustFit { voltage_exponent: exponent, ..thrust };
    let max = thrust.max_npkg.value;
    if !(0.5..500.0).contains(&max) {
        return Err(IdentifyError::Absurd(max));
    }
    Ok(Identified {
        airframe: airframe.clone(),
        flown_s: spans.iter().map(|(a, b)| b - a).sum(),
        voltage_ref_v: reference.voltage_v,
        density_ref_kgm3: reference.density_kgm3,
        follows_voltage,
        mean_sqrt_shape: bins.iter().map(|b| b.sqrt_shape).sum::<f64>() / bins.len() as f64,
        drag: lateral.map(|(drag, _)| drag),
        torque: torque::fit(flight, airframe, reference, max, &spans),
        noise: noise::bounds(flight, &bins, &spans),
        thrust,
    })
}

/// The drag law and how well it is known: from the scatter within one fit, and between fits with other windows.
fn lateral(bins: &[Bin]) -> Option<(LateralDrag, DragFit)> {
    let layout = |form, isotropic, window_s| Layout { form, isotropic, window_s };
    let (rotors, scale) = drag::fit(bins, layout(Form::Rotors, true, WINDOWS_S[0]), None)?;
    let (body, _) = drag::fit(bins, layout(Form::Body, true, WINDOWS_S[0]), Some(scale))?;
    let mut chosen = if rotors.cost <= body.cost { rotors } else { body };
    let form = chosen.form;
    // two laws only where they differ by more than can be chance
    let two = drag::fit(bins, layout(form, false, WINDOWS_S[0]), None).map(|(fit, _)| fit);
    let differ = |two: &DragFit| {
        let (x, y) = (two.at(0, 5.0), two.at(1, 5.0));
        let sigma = two.sigma_at(0, 5.0).hypot(two.sigma_at(1, 5.0));
        two.airspeed_mps > FAST_MPS && (x - y).abs() > (4.0 * sigma).max(0.15 * x.max(y))
    };
    let isotropic = !two.as_ref().is_some_and(differ);
    if let (false, Some(two)) = (isotropic, two) {
        chosen = two;
    }
    let others: Vec<DragFit> = WINDOWS_S[1..]
        .iter()
        .filter_map(|w| drag::fit(bins, layout(form, isotropic, *w), None).map(|(fit, _)| fit))
        .collect();
    let spread = |f: &dyn Fn(&DragFit) -> f64| {
        let all = || others.iter().chain([&chosen]).map(f);
        0.5 * (all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min))
    };
    const LEGS: &str = "fly straight legs of 20 s at 5 m/s or more, there and back, in two directions";
    let quantity = |f: &dyn Fn(&DragFit) -> f64, sigma: f64, allowed: f64| {
        let (value, sigma) = (f(&chosen), sigma.hypot(spread(f)));
        let slow = chosen.excursion_mps < EXCURSION_MPS || chosen.airspeed_mps < FAST_MPS;
        let weak = sigma > allowed * value || slow;
        Quantity { value, sigma, missing: weak.then_some(LEGS) }
    };
    let axis = |i: usize| {
        let sigma = |j: usize| chosen.covariance[(j, j)].max(0.0).sqrt();
        (
            quantity(&|f| f.linear[i], sigma(i), 0.2),
            quantity(&|f| f.quadratic[i], sigma(2 + i), 0.3),
            quantity(&|f| f.at(i, 5.0), chosen.sigma_at(i, 5.0), 0.1),
        )
    };
    let (x, y) = (axis(0), axis(1));
    let drag = LateralDrag {
        form,
        linear: [x.0, y.0],
        quadratic: [x.1, y.1],
        at_5_mps: [x.2, y.2],
        airspeed_mps: chosen.airspeed_mps,
        isotropic,
    };
    Some((drag, chosen))
}
