use super::flight::Flight;
use crate::signal::MAX_ROTORS;
use crate::vehicle::airframe::Airframe;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Length of a bin, s: longer than the telemetry's jitter, shorter than what a multirotor does.
const BIN_S: f64 = 0.1;

/// Battery voltage and air density that the thrust scale refers to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// `None` where the log has none, or thrust does not follow it.
    pub voltage_v: Option<f64>,
    pub density_kgm3: Option<f64>,
}

impl Reference {
    /// The means over the flight.
    pub fn of(flight: &Flight, spans: &[(f64, f64)]) -> Self {
        let mean = |series: &super::series::Series<f64>| {
            let inside = |t: f64| spans.iter().any(|(a, b)| (*a..=*b).contains(&t));
            let (n, sum) =
                series.iter().filter(|(t, _)| inside(*t)).fold((0.0, 0.0), |(n, sum), (_, x)| (n + 1.0, sum + x));
            (n > 0.0 && sum > 0.0).then(|| sum / n)
        };
        Self { voltage_v: mean(&flight.voltage_v), density_kgm3: mean(&flight.density_kgm3) }
    }
}

/// What the rotors are told at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Drive {
    /// Of each rotor, by the thrust curve: 1 is full thrust at the reference.
    pub shape: [f64; MAX_ROTORS],
    /// Σ(c² − c), times the same factors: how Σshape moves with the curve's expo.
    pub bend: f64,
    /// Mean command, 0..1.
    pub command: f64,
}

impl Drive {
    /// The rotors' drive where the outputs are these.
    pub fn new(
        flight: &Flight,
        airframe: &Airframe,
        reference: Reference,
        t_s: f64,
        outputs: &[f64; MAX_ROTORS],
    ) -> Self {
        let curve = airframe.curve;
        let (voltage, density) = (flight.voltage_v.hold(t_s), flight.density_kgm3.hold(t_s));
        let ratio = |now: Option<f64>, at: Option<f64>| now.zip(at).map_or(1.0, |(now, at)| now / at);
        let factor = ratio(voltage, reference.voltage_v).powi(2) * ratio(density, reference.density_kgm3);
        let mut drive = Self { shape: [0.0; MAX_ROTORS], bend: 0.0, command: 0.0 };
        for (shape, place) in drive.shape.iter_mut().zip(&airframe.places) {
            let output = outputs.get(place.output).copied().unwrap_or(curve.at_zero);
            let c = ((output - curve.at_zero) / (curve.at_full - curve.at_zero)).clamp(0.0, 1.0);
            *shape = factor * ((1.0 - curve.expo) * c + curve.expo * c * c);
            drive.bend += factor * (c * c - c);
            drive.command += c / airframe.places.len() as f64;
        }
        drive
    }
}

/// A tenth of a second of free flight.
#[derive(Debug, Clone, Copy)]
pub struct Bin {
    pub t_s: f64,
    /// Which stretch of free flight it belongs to.
    pub span: usize,
    /// Specific force, body FRD, m/s².
    pub accel_frd_mps2: Vector3<f64>,
    /// Body FRD to NED.
    pub rotation: Matrix3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    /// Σ shape over the rotors.
    pub shape: f64,
    /// Σ √shape.
    pub sqrt_shape: f64,
    pub bend: f64,
    pub command: f64,
    pub voltage_v: Option<f64>,
}

/// The free flight of a log in bins; those that miss a channel are left out.
pub fn bins(flight: &Flight, airframe: &Airframe, reference: Reference, spans: &[(f64, f64)]) -> Vec<Bin> {
    let mut bins = Vec::new();
    for (span, (from, to)) in spans.iter().enumerate() {
        let accel = means(flight.imu().iter().map(|(t, imu)| (t, imu.accel_frd_mps2)), *from, *to);
        let drives = flight.outputs.iter().map(|(t, o)| (t, drive_sums(flight, airframe, reference, t, &o)));
        let drives = means(drives, *from, *to);
        for (i, (accel, drive)) in accel.into_iter().zip(drives).enumerate() {
            let t_s = from + (i as f64 + 0.5) * BIN_S;
            let slerp =
                |a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64| a.try_slerp(b, s, 1e-9).unwrap_or(*b);
            let attitude = flight.attitude.interpolate(t_s, slerp);
            let velocity = flight.velocity.interpolate(t_s, |a, b, s| a.lerp(b, s));
            if let (Some(accel), Some(drive), Some(q), Some(velocity_ned_mps)) = (accel, drive, attitude, velocity) {
                let rotation = *q.to_rotation_matrix().matrix();
                let [shape, sqrt_shape, bend, command] = drive.into();
                bins.push(Bin {
                    t_s,
                    span,
                    accel_frd_mps2: accel,
                    rotation,
                    velocity_ned_mps,
                    shape,
                    sqrt_shape,
                    bend,
                    command,
                    voltage_v: flight.voltage_v.hold(t_s),
                });
            }
        }
    }
    bins
}

fn drive_sums(
    flight: &Flight,
    airframe: &Airframe,
    reference: Reference,
    t_s: f64,
    outputs: &[f64; MAX_ROTORS],
) -> nalgebra::Vector4<f64> {
    let drive = Drive::new(flight, airframe, reference, t_s, outputs);
    let rotors = drive.shape.iter().take(airframe.places.len());
    let roots = rotors.clone().map(|s| s.sqrt()).sum();
    nalgebra::Vector4::new(rotors.sum(), roots, drive.bend, drive.command)
}

/// The mean of the samples in each bin from `from` to `to`.
fn means<const N: usize>(
    samples: impl Iterator<Item = (f64, nalgebra::SVector<f64, N>)>,
    from: f64,
    to: f64,
) -> Vec<Option<nalgebra::SVector<f64, N>>> {
    let mut bins = vec![(0.0, nalgebra::SVector::zeros()); ((to - from) / BIN_S) as usize];
    for (t, x) in samples {
        if t >= from
            && let Some((n, sum)) = bins.get_mut(((t - from) / BIN_S) as usize)
        {
            *n += 1.0;
            *sum += x;
        }
    }
    bins.into_iter().map(|(n, sum)| (n > 0.0).then(|| sum / n)).collect()
}
