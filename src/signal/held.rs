use super::Stamp;
use nalgebra::Vector3;

/// The newest sample of a sensor that keeps its own pace, held until the next one comes.
///
/// A sample is `new` in exactly one measurement: the first that stands at or after the sample's instant. Where several
/// fall between two measurements the newest is given, and `sequence` tells how many there were.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held<T> {
    pub value: T,
    /// When the message says that the sample was true, on the boot clock.
    pub stamp: Stamp,
    /// Since then, at the measurement's instant, s.
    pub age_s: f64,
    /// How many samples of this sensor there have been since the vehicle (re)started, this one included.
    pub sequence: u32,
    /// First seen in this measurement.
    pub new: bool,
}

impl<T: Copy> Held<T> {
    /// The sample, when it is new.
    pub fn fresh(self) -> Option<T> {
        self.new.then_some(self.value)
    }
}

/// Quality of a fix, as GPS_FIX_TYPE counts it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum FixType {
    #[default]
    None,
    TwoD,
    ThreeD,
    Differential,
    RtkFloat,
    RtkFixed,
}

/// One solution of a GNSS receiver, unfiltered by the autopilot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GnssFix {
    pub fix_type: FixType,
    /// Geodetic, WGS 84; altitude above mean sea level.
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    pub altitude_m: f64,
    /// Relative to the vehicle's first three-dimensional fix; `None` until there is one.
    pub position_ned_m: Option<Vector3<f64>>,
    /// North and east, m/s.
    pub ground_velocity_mps: Option<[f64; 2]>,
    /// Down, m/s. GPS_RAW_INT has none.
    pub down_velocity_mps: Option<f64>,
    /// Dilution of precision (GPS_RAW_INT eph and epv), without unit.
    pub hdop: Option<f64>,
    pub vdop: Option<f64>,
    /// The receiver's own word on its error, m and m/s.
    pub horizontal_accuracy_m: Option<f64>,
    pub vertical_accuracy_m: Option<f64>,
    pub speed_accuracy_mps: Option<f64>,
    pub satellites: Option<u8>,
    /// Seconds since 1970, when the vehicle has told its date.
    pub unix_s: Option<f64>,
}

impl GnssFix {
    /// Velocity in all three axes.
    pub fn velocity_ned_mps(&self) -> Option<Vector3<f64>> {
        let [n, e] = self.ground_velocity_mps?;
        Some(Vector3::new(n, e, self.down_velocity_mps?))
    }
}

/// One sample of static pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Barometer {
    pub pressure_pa: f64,
    /// Height in the standard atmosphere at this pressure, m.
    pub altitude_m: f64,
}

impl Barometer {
    /// From static pressure, by the standard atmosphere's troposphere.
    pub fn from_pressure(pressure_pa: f64) -> Self {
        // T₀/L = 288.15 K / 6.5 K/km; exponent R·L/(g·M)
        let altitude_m = 44_330.769 * (1.0 - (pressure_pa / 101_325.0).powf(0.190_263));
        Self { pressure_pa, altitude_m }
    }
}

/// Which message brought a magnetic field. One sensor often arrives through several: exactly one source is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MagSource {
    /// RAW_IMU or SCALED_IMU: whole milligauss.
    Scaled,
    /// HIGHRES_IMU: floats.
    HighRes,
}

/// One sample of the magnetometer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagField {
    /// Gauss, body FRD.
    pub field_frd_gauss: Vector3<f64>,
    pub source: MagSource,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_atmosphere() {
        assert!(Barometer::from_pressure(101_325.0).altitude_m.abs() < 1e-9);
        // tables: 89 874.6 Pa at 1000 m, 79 495.2 Pa at 2000 m
        assert!((Barometer::from_pressure(89_874.6).altitude_m - 1000.0).abs() < 0.5);
        assert!((Barometer::from_pressure(79_495.2).altitude_m - 2000.0).abs() < 0.5);
    }
}
