//! The simulated autopilot's own estimator: from sensor readings to what it believes and reports.
//!
//! In: [`Readings`](super::sensors::Readings). Out: [`Navigation`](super::control::Navigation). Position, velocity and
//! attitude share one filter per inertial sensor, so their errors are correlated and slow, as a real autopilot's are;
//! sensor faults reach the controller and the telemetry through it. Fixed gains stand in for a Kalman filter's.

mod lane;
mod lanes;

pub use lane::Innovations;
pub use lanes::Estimator;

/// Heights from pressure, and what the filter is told of the place it flies at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Declination used for heading, east of north, rad.
    pub declination_rad: f64,
    /// Heading at start, rad.
    pub heading_rad: f64,
}

/// Height in the standard atmosphere at a static pressure, m.
pub(crate) fn pressure_altitude_m(pressure_pa: f64) -> f64 {
    (1.0 - (pressure_pa / 101_325.0).max(0.0).powf(1.0 / 5.255_88)) / 2.255_769_6e-5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::dynamics::pressure_pa;

    #[test]
    fn pressure_altitude_turns_the_atmosphere_round() {
        for h in [0.0, 584.0, 2500.0] {
            assert!((pressure_altitude_m(pressure_pa(h)) - h).abs() < 1e-6);
        }
    }
}
