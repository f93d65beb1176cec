use super::Stack;
use crate::signal::MAX_ROTORS;
use crate::sim::estimator::Innovations;
use crate::sim::scenario::Home;
use crate::sim::sensors::GnssFix;
use crate::sim::vehicle::Moment;
use crate::vehicle::Actuators;
use nalgebra::Vector3;

/// Everything a message is made of.
pub(super) struct View<'a> {
    pub stack: Stack,
    pub moment: &'a Moment,
    pub latest: &'a Latest,
    pub home: &'a Home,
    pub actuators: &'a Actuators,
    /// Outputs by position in the actuator message: the rotor that hangs there, if any.
    pub rotor_of_output: &'a [Option<u8>; 16],
    pub rotor_count: usize,
    /// Boot clock of the autopilot at the instant of sending, µs. ArduPilot stamps with it.
    pub sent_us: u64,
    /// Boot clock of this loop's data, µs. PX4 stamps with it.
    pub loop_us: u64,
    pub unix_us: u64,
    pub innovations: Innovations,
    pub resets: u8,
    /// Estimated gyro and accelerometer biases, which PX4 has already subtracted from what it sends.
    pub biases: (Vector3<f64>, Vector3<f64>),
}

/// The newest value of sensors that are slower than the loop.
#[derive(Debug, Clone, Copy)]
pub(super) struct Latest {
    pub mag_gauss: Vector3<f64>,
    pub pressure_pa: f64,
    pub fix: Option<GnssFix>,
    pub rpm: [f64; MAX_ROTORS],
    pub charge_as: f64,
}

/// A place on the globe.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub lat_e7: i32,
    pub lon_e7: i32,
    pub alt_mm: i32,
}

impl View<'_> {
    /// The stamp most messages carry, µs.
    pub fn stamp_us(&self) -> u64 {
        match self.stack {
            Stack::ArduPilot => self.sent_us,
            Stack::Px4 => self.loop_us,
        }
    }

    pub fn stamp_ms(&self) -> u32 {
        (self.stamp_us() / 1000) as u32
    }

    /// Position in the local frame to latitude, longitude and height, with the radii of curvature of WGS84 at home.
    pub fn place(&self, ned_m: &Vector3<f64>) -> Place {
        let (a, e2) = (6_378_137.0, 6.694_38e-3);
        let sin = self.home.latitude_deg.to_radians().sin();
        let w = 1.0 - e2 * sin * sin;
        let (meridian, normal) = (a * (1.0 - e2) / w.powf(1.5), a / w.sqrt());
        let north = (ned_m.x / meridian).to_degrees();
        let east = (ned_m.y / (normal * self.home.latitude_deg.to_radians().cos())).to_degrees();
        Place {
            lat_e7: ((self.home.latitude_deg + north) * 1e7).round() as i32,
            lon_e7: ((self.home.longitude_deg + east) * 1e7).round() as i32,
            alt_mm: ((self.home.altitude_m - ned_m.z) * 1e3).round() as i32,
        }
    }

    /// Outputs of the mixer on the scale of the actuator message: 16 values, those without a rotor at rest.
    pub fn outputs(&self) -> [f64; 16] {
        let a = self.actuators;
        let armed = self.moment.flight.armed();
        let mut out = [0.0; 16];
        for (value, rotor) in out.iter_mut().zip(self.rotor_of_output) {
            *value = match (rotor, self.stack) {
                (Some(rotor), _) if armed => {
                    let c = self.moment.commands.get(usize::from(*rotor)).copied().unwrap_or(0.0);
                    a.at_zero + c * (a.at_full - a.at_zero)
                }
                (Some(_), Stack::ArduPilot) => 1000.0,
                (None, Stack::ArduPilot) => 0.0,
                (_, Stack::Px4) => 900.0,
            };
        }
        out
    }

    /// Heading, degrees 0..360.
    pub fn heading_deg(&self) -> f64 {
        self.moment.navigation.body_to_ned.euler_angles().2.to_degrees().rem_euclid(360.0)
    }

    /// Mean thrust command, 0..1.
    pub fn throttle(&self) -> f64 {
        let n = self.rotor_count.max(1);
        self.moment.commands.iter().take(n).sum::<f64>() / n as f64
    }
}

/// C's conversion to an integer: towards zero, held at the ends of the range.
pub(super) fn cut(x: f64) -> i16 {
    x as i16
}
