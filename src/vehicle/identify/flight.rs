use super::series::Series;
use crate::signal::{Imu, ImuSource, MAX_ROTORS, Sample, SampleKind};
use crate::vehicle::air_density_kgm3;
use nalgebra::{UnitQuaternion, Vector3};

/// Take-off and landing are left out: this long after leaving the ground and before touching it, s.
const MARGIN_S: f64 = 4.0;
/// A flight shorter than this says nothing, s.
const SHORTEST_S: f64 = 10.0;

/// The samples of one vehicle's log, as they came.
#[derive(Debug, Clone, Default)]
pub struct Flight {
    scaled_imu: Series<Imu>,
    highres_imu: Series<Imu>,
    pub attitude: Series<UnitQuaternion<f64>>,
    /// NED, m/s.
    pub velocity: Series<Vector3<f64>>,
    /// On the actuator message's scale.
    pub outputs: Series<[f64; MAX_ROTORS]>,
    pub voltage_v: Series<f64>,
    pub density_kgm3: Series<f64>,
    armed: Series<bool>,
    in_air: Series<bool>,
}

impl Flight {
    pub fn push(&mut self, sample: &Sample) {
        let t = sample.stamp.nanos() as f64 * 1e-9;
        match sample.kind {
            SampleKind::Imu { source, accel_frd_mps2, rate_frd_rads } => {
                let imu = Imu { accel_frd_mps2, rate_frd_rads };
                match source {
                    ImuSource::HighRes => self.highres_imu.push(t, imu),
                    ImuSource::Scaled => self.scaled_imu.push(t, imu),
                    ImuSource::Second | ImuSource::Third => {}
                }
            }
            SampleKind::Attitude { body_to_ned } => self.attitude.push(t, body_to_ned),
            SampleKind::LocalPosition { velocity_ned_mps, .. } | SampleKind::Velocity { velocity_ned_mps } => {
                self.velocity.push(t, velocity_ned_mps);
            }
            SampleKind::Actuators { outputs } => self.outputs.push(t, outputs),
            SampleKind::Battery { voltage_v } => self.voltage_v.push(t, voltage_v),
            SampleKind::Pressure { pressure_pa } => self.density_kgm3.push(t, air_density_kgm3(pressure_pa)),
            SampleKind::Armed(armed) => self.armed.push(t, armed),
            SampleKind::InAir(Some(in_air)) => self.in_air.push(t, in_air),
            _ => {}
        }
    }

    /// The inertial sensor's samples: floats where they came about as often as integers.
    pub fn imu(&self) -> &Series<Imu> {
        if 2 * self.highres_imu.len() >= self.scaled_imu.len() { &self.highres_imu } else { &self.scaled_imu }
    }

    /// The stretches of free flight, s: armed and in the air, without take-off and landing.
    pub fn airborne(&self) -> Vec<(f64, f64)> {
        let times = self.outputs.times();
        let mut spans: Vec<(f64, f64)> = Vec::new();
        let mut open: Option<(f64, f64)> = None;
        let flies = |t: f64| match self.in_air.hold(t) {
            Some(in_air) => in_air && self.armed.hold(t) != Some(false),
            None => self.armed.hold(t) == Some(true),
        };
        for &t in times {
            if flies(t) {
                let (from, _) = *open.get_or_insert((t, t));
                open = Some((from, t));
            } else if let Some(span) = open.take() {
                spans.push(span);
            }
        }
        spans.extend(open);
        spans.into_iter().map(|(a, b)| (a + MARGIN_S, b - MARGIN_S)).filter(|(a, b)| b - a > SHORTEST_S).collect()
    }
}
