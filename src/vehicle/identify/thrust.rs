//! Thrust per mass, and what it depends on, from the specific force along the thrust axis.

use super::Quantity;
use super::bins::{Bin, Reference};
use super::drag::{DragFit, airspeed};
use super::regress::{Fit, Rows};
use nalgebra::{DMatrix, DVector};

/// Rows closer together than this may err together, s.
const CLUSTER_S: f64 = 5.0;
/// What a thrust scale may be off beside its scatter: a constant accelerometer error of 0.02 m/s² in 9.8.
const BIAS_SHARE: f64 = 0.002;
/// The exponent of voltage is told from the data when it is known this well.
const EXPONENT_KNOWN: f64 = 0.7;

/// Thrust of one rotor, and what it depends on.
#[derive(Debug, Clone, Copy)]
pub struct ThrustFit {
    /// Of one rotor at full command and reference voltage and density, N/kg.
    pub max_npkg: Quantity,
    /// Thrust goes with voltage to this power.
    pub voltage_exponent: Quantity,
    /// By how much the expo would have to change for the data to fit best.
    pub expo_change: Quantity,
    /// Drag along the thrust axis, 1/s.
    pub vertical_drag: Quantity,
    /// Mean command in level flight without climbing, 0..1.
    pub hover_command: Quantity,
}

/// Fits the thrust law. `drag` supplies the air's velocity once it is known.
pub fn fit(bins: &[Bin], reference: Reference, drag: Option<&DragFit>) -> Option<ThrustFit> {
    let sum = |f: &dyn Fn(usize, &Bin) -> f64| {
        DVector::from_iterator(bins.len(), bins.iter().enumerate().map(|(i, b)| f(i, b)))
    };
    let cluster = clusters(bins);
    let lift = sum(&|_, b| -b.accel_frd_mps2.z);
    let shape = sum(&|_, b| b.shape);
    let regress = |y: &DVector<f64>, columns: &[&DVector<f64>]| -> Option<Fit> {
        let x = DMatrix::from_fn(bins.len(), columns.len(), |i, k| columns[k][i]);
        Rows { x, y: y.clone(), cluster: cluster.clone() }.fit()
    };
    // velocity through the air along body z, times the swell of the rotors' drag
    let fall = drag.map(|d| {
        let mean = bins.iter().map(|b| b.sqrt_shape).sum::<f64>() / bins.len() as f64;
        sum(&|i, b| airspeed(b, &d.wind[i]).z * b.sqrt_shape / mean)
    });

    // lift = K·Σshape + vertical·fall
    // of the quadratic part along the axis no more is known than that it is about that across
    let lift = match drag {
        Some(d) => {
            let quadratic = 0.5 * (d.quadratic[0] + d.quadratic[1]);
            let fallen = |i: usize, b: &Bin| airspeed(b, &d.wind[i]).z;
            lift - sum(&|i, b| quadratic * fallen(i, b) * fallen(i, b).abs())
        }
        None => lift,
    };
    let (vertical_drag, lift) = match (&fall, drag) {
        (Some(fall), Some(drag)) => {
            let lateral = 0.5 * (drag.linear[0] + drag.linear[1]);
            let vertical = regress(&lift, &[&shape, fall]).map(|f| (f.beta[1], f.sigma(1)));
            let vertical = match vertical {
                Some((l, sigma)) if sigma < 0.3 * lateral && l > 0.0 => Quantity::observed(l, sigma),
                other => Quantity {
                    value: lateral,
                    sigma: other.map_or(0.5 * lateral, |(_, s)| s.min(0.5 * lateral)),
                    missing: Some("climb and descend at 2 m/s or more (until then: as across)"),
                },
            };
            let lift = lift - fall * vertical.value;
            (vertical, lift)
        }
        _ => (Quantity::unknown("drag across the thrust axis"), lift),
    };
    let scale = regress(&lift, &[&shape])?;
    let max = scale.beta[0];
    let sigma = scale.sigma(0).hypot(BIAS_SHARE * max);

    let voltage_exponent = match reference.voltage_v {
        Some(at) => {
            let log = |b: &Bin| (b.voltage_v.unwrap_or(at) / at).ln();
            let bare = sum(&|_, b| b.shape * (-2.0 * log(b)).exp());
            let bent = sum(&|_, b| b.shape * (-2.0 * log(b)).exp() * log(b));
            match regress(&lift, &[&bare, &bent]) {
                Some(f) if f.sigma(1) < EXPONENT_KNOWN * f.beta[0] => {
                    Quantity::observed(f.beta[1] / f.beta[0], f.sigma(1) / f.beta[0])
                }
                _ => Quantity { value: 2.0, sigma: 2.0, missing: Some("fly until the battery has sagged by a tenth") },
            }
        }
        None => Quantity::unknown("battery voltage (BATTERY_STATUS or SYS_STATUS)"),
    };
    let bend = sum(&|_, b| b.bend);
    let expo_change = match regress(&lift, &[&shape, &bend]) {
        Some(f) if f.sigma(1) < 0.15 * f.beta[0] => {
            let (change, sigma) = (f.beta[1] / f.beta[0], f.sigma(1) / f.beta[0]);
            // wind through the rotors moves thrust too: a large change is no proof
            let doubtful = change.abs() > (3.0 * sigma).max(0.15);
            let missing = doubtful.then_some("the curve or strong wind through the rotors: climb in calm air");
            Quantity { value: change, sigma, missing }
        }
        _ => {
            Quantity { value: 0.0, sigma: 1.0, missing: Some("climb and descend briskly, so that the throttle moves") }
        }
    };
    Some(ThrustFit {
        max_npkg: Quantity { value: max, sigma, missing: (sigma > 0.03 * max).then_some("hover for half a minute") },
        voltage_exponent,
        expo_change,
        vertical_drag,
        hover_command: hover(bins),
    })
}

/// The mean command where the vehicle neither leans much nor climbs.
fn hover(bins: &[Bin]) -> Quantity {
    let level = |b: &&Bin| {
        b.rotation[(2, 2)] > 0.97 && b.velocity_ned_mps.z.abs() < 0.3 && b.velocity_ned_mps.xy().norm() < 1.5
    };
    let commands: Vec<f64> = bins.iter().filter(level).map(|b| b.command).collect();
    let n = commands.len() as f64;
    if n < 50.0 {
        return Quantity::unknown("hover for ten seconds");
    }
    let mean = commands.iter().sum::<f64>() / n;
    let variance = commands.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / n;
    Quantity::observed(mean, variance.sqrt())
}

fn clusters(bins: &[Bin]) -> Vec<usize> {
    let mut cluster = Vec::with_capacity(bins.len());
    let (mut index, mut newest) = (0, None);
    for b in bins {
        let key = (b.span, (b.t_s / CLUSTER_S) as i64);
        if newest.is_some_and(|n| n != key) {
            index += 1;
        }
        newest = Some(key);
        cluster.push(index);
    }
    cluster
}
