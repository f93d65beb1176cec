use super::barometer::Barometer;
use super::gnss::Gnss;
use super::imu::Imu;
use super::magnetometer::Magnetometer;
use super::rotor_speed::RotorSpeed;
use super::{
    BarometerSpec, GnssFix, GnssSpec, ImuReading, ImuSpec, MagnetometerSpec, NoiseShape, RotorSpeedSpec, Vibration,
};
use crate::signal::MAX_ROTORS;
use crate::sim::dynamics::Truth;
use crate::vehicle::Vehicle;
use nalgebra::Vector3;

/// All sensors of one vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorSuite {
    pub imu: [ImuSpec; 2],
    pub magnetometer: MagnetometerSpec,
    pub barometer: BarometerSpec,
    pub gnss: GnssSpec,
    pub rotor_speed: RotorSpeedSpec,
}

impl SensorSuite {
    /// Sensors that stay within the bounds the vehicle declares: noise truncated at its bound of three standard
    /// deviations, biases within theirs.
    pub fn within_bounds_of(vehicle: &Vehicle) -> Self {
        let (n, shape) = (&vehicle.noise, NoiseShape::Truncated { sigmas: 3.0 });
        let imu = ImuSpec {
            accel_delay_s: vehicle.sensors.accel_delay_s,
            gyro_delay_s: vehicle.sensors.gyro_delay_s,
            accel_noise_mps2: Vector3::from(n.accel_mps2) / 3.0,
            gyro_noise_rads: Vector3::from(n.gyro_rads) / 3.0,
            shape,
            accel_bias_mps2: Vector3::from(n.accel_bias_mps2),
            gyro_bias_rads: Vector3::zeros(),
            accel_walk: 0.0,
            gyro_walk: 0.0,
            accel_scale: 0.0,
            gyro_scale: 0.0,
            accel_range_mps2: 157.0,
            gyro_range_rads: 35.0,
            accel_step_mps2: 0.0,
            gyro_step_rads: 0.0,
            vibration: None,
        };
        Self {
            imu: [imu; 2],
            magnetometer: MagnetometerSpec {
                rate_hz: 50.0,
                field_ned_gauss: MagnetometerSpec::field(0.585, 0.22, -1.152),
                noise_gauss: 0.003,
                shape,
                hard_iron_gauss: Vector3::zeros(),
                motor_gauss: Vector3::zeros(),
                step_gauss: 0.001,
            },
            barometer: BarometerSpec { rate_hz: 50.0, noise_pa: 1.2, shape, walk_pa: 0.02, step_pa: 0.0 },
            gnss: GnssSpec {
                rate_hz: 5.0,
                latency_s: 0.12,
                horizontal_noise_m: 0.1,
                vertical_noise_m: 0.2,
                velocity_noise_mps: 0.05,
                shape,
                wander_m: 0.8,
                wander_s: 120.0,
                dropout: 0.0,
                satellites: 14,
            },
            rotor_speed: RotorSpeedSpec { rate_hz: 50.0, noise_rpm: 10.0, shape, step_rpm: 1.0 },
        }
    }

    /// Ordinary MEMS sensors on a shaking frame, with turn-on errors, drift and quantisation: what real boards give.
    pub fn mems(vehicle: &Vehicle) -> Self {
        let mut s = Self::within_bounds_of(vehicle);
        let shape = NoiseShape::Gaussian;
        let imu = ImuSpec {
            accel_noise_mps2: Vector3::repeat(0.05),
            gyro_noise_rads: Vector3::repeat(0.004),
            shape,
            accel_bias_mps2: Vector3::repeat(0.08),
            gyro_bias_rads: Vector3::repeat(0.002),
            accel_walk: 0.002,
            gyro_walk: 5e-5,
            accel_scale: 0.002,
            gyro_scale: 0.002,
            accel_step_mps2: 0.0048,
            gyro_step_rads: 0.001_06,
            vibration: Some(Vibration { accel_mps2: 4.0, gyro_rads: 0.05, hover_hz: 95.0 }),
            ..s.imu[0]
        };
        s.imu = [imu, ImuSpec { accel_noise_mps2: Vector3::repeat(0.07), ..imu }];
        s.magnetometer.shape = shape;
        s.magnetometer.hard_iron_gauss = Vector3::new(0.008, -0.005, 0.004);
        s.magnetometer.motor_gauss = Vector3::new(0.01, 0.006, 0.0);
        s.barometer.shape = shape;
        s.gnss.shape = shape;
        s.gnss.dropout = 0.01;
        s.rotor_speed.shape = shape;
        s
    }

    /// The simulator of ArduPilot: quiet inertial sensors, a compass that is half a degree off, GNSS without noise, as
    /// recorded from it in hover.
    pub fn ardupilot_sitl(vehicle: &Vehicle) -> Self {
        let mut s = Self::within_bounds_of(vehicle);
        let shape = NoiseShape::Gaussian;
        s.imu = s.imu.map(|imu| ImuSpec {
            accel_noise_mps2: Vector3::repeat(0.0108),
            gyro_noise_rads: Vector3::repeat(0.0013),
            shape,
            accel_bias_mps2: Vector3::repeat(0.015),
            gyro_bias_rads: Vector3::repeat(0.001),
            ..imu
        });
        s.magnetometer.shape = shape;
        s.magnetometer.noise_gauss = 1e-4;
        s.magnetometer.hard_iron_gauss = Vector3::new(0.0, 0.0025, 0.0);
        s.barometer.shape = shape;
        s.barometer.noise_pa = 0.6;
        s.gnss = GnssSpec {
            latency_s: 0.2,
            horizontal_noise_m: 0.0,
            vertical_noise_m: 0.0,
            velocity_noise_mps: 0.0,
            wander_m: 0.0,
            satellites: 10,
            ..s.gnss
        };
        s
    }

    /// The simulator inside PX4 (SIH): large white noise on the inertial sensors, as recorded from it at 125 Hz.
    pub fn px4_sih(vehicle: &Vehicle) -> Self {
        let mut s = Self::within_bounds_of(vehicle);
        s.imu = s.imu.map(|imu| ImuSpec {
            accel_noise_mps2: Vector3::new(0.4, 1.2, 1.0),
            gyro_noise_rads: Vector3::new(0.11, 0.06, 0.02),
            shape: NoiseShape::Gaussian,
            accel_bias_mps2: Vector3::zeros(),
            ..imu
        });
        s.gnss.rate_hz = 8.0;
        s
    }

    /// The same sensors with noise of another shape and the same standard deviation.
    #[must_use]
    pub fn with_noise(mut self, shape: NoiseShape) -> Self {
        self.imu = self.imu.map(|imu| ImuSpec { shape, ..imu });
        self.magnetometer.shape = shape;
        self.barometer.shape = shape;
        self.gnss.shape = shape;
        self.rotor_speed.shape = shape;
        self
    }

    /// No noise, no bias, no delay, and GNSS as fast as it goes: to test everything behind the sensors.
    pub fn perfect(vehicle: &Vehicle) -> Self {
        let mut s = Self::within_bounds_of(vehicle);
        s.imu = s.imu.map(|imu| ImuSpec {
            accel_delay_s: 0.0,
            gyro_delay_s: 0.0,
            accel_noise_mps2: Vector3::zeros(),
            gyro_noise_rads: Vector3::zeros(),
            accel_bias_mps2: Vector3::zeros(),
            ..imu
        });
        s.magnetometer = MagnetometerSpec { noise_gauss: 0.0, step_gauss: 0.0, ..s.magnetometer };
        s.barometer = BarometerSpec { noise_pa: 0.0, walk_pa: 0.0, ..s.barometer };
        s.gnss = GnssSpec {
            rate_hz: 20.0,
            latency_s: 0.0,
            horizontal_noise_m: 0.0,
            vertical_noise_m: 0.0,
            velocity_noise_mps: 0.0,
            wander_m: 0.0,
            ..s.gnss
        };
        s.rotor_speed = RotorSpeedSpec { noise_rpm: 0.0, step_rpm: 0.0, ..s.rotor_speed };
        s
    }
}

/// Faults of one inertial sensor, added to its ordinary errors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImuError {
    pub accel_bias_mps2: Vector3<f64>,
    pub gyro_bias_rads: Vector3<f64>,
    pub accel_noise_mps2: f64,
    pub gyro_noise_rads: f64,
    pub accel_frozen: bool,
    pub gyro_frozen: bool,
}

/// Faults of all sensors at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SensorErrors {
    pub imu: [ImuError; 2],
    pub mag_bias_gauss: Vector3<f64>,
    pub mag_noise_gauss: f64,
    pub mag_frozen: bool,
    pub baro_bias_pa: f64,
    pub baro_noise_pa: f64,
    pub baro_frozen: bool,
    pub gnss_shift_ned_m: Vector3<f64>,
    pub gnss_lost: bool,
}

/// What the sensors deliver in one loop; `None` where a slower sensor has nothing new.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readings {
    pub imu: [ImuReading; 2],
    pub mag_frd_gauss: Option<Vector3<f64>>,
    pub pressure_pa: Option<f64>,
    pub gnss: Option<GnssFix>,
    /// rev/min.
    pub rotor_rpm: Option<[f64; MAX_ROTORS]>,
    pub voltage_v: f64,
    pub current_a: f64,
}

/// The sensors of one vehicle at work.
#[derive(Debug, Clone)]
pub struct Sensors {
    imu: [Imu; 2],
    magnetometer: Magnetometer,
    barometer: Barometer,
    gnss: Gnss,
    rotor_speed: RotorSpeed,
    due: [Due; 4],
}

impl Sensors {
    /// For a loop of `period_s`.
    pub fn new(suite: &SensorSuite, seed: u64, vehicle: u8, period_s: f64) -> Self {
        let [first, second] = suite.imu;
        Self {
            imu: [Imu::new(first, 0, seed, vehicle, period_s), Imu::new(second, 1, seed, vehicle, period_s)],
            magnetometer: Magnetometer::new(suite.magnetometer, seed, vehicle),
            barometer: Barometer::new(suite.barometer, seed, vehicle),
            gnss: Gnss::new(suite.gnss, seed, vehicle),
            rotor_speed: RotorSpeed::new(suite.rotor_speed, seed, vehicle),
            due: [
                Due::every(suite.magnetometer.rate_hz),
                Due::every(suite.barometer.rate_hz),
                Due::every(suite.gnss.rate_hz),
                Due::every(suite.rotor_speed.rate_hz),
            ],
        }
    }

    /// One loop.
    pub fn read(&mut self, truth: &Truth, errors: &SensorErrors) -> Readings {
        let [mag, baro, gnss, rotor] = &mut self.due;
        let now = truth.stamp.secs();
        if gnss.now(now) {
            self.gnss.measure(truth, errors.gnss_shift_ned_m, errors.gnss_lost);
        }
        let [first, second] = &mut self.imu;
        let [first_error, second_error] = &errors.imu;
        Readings {
            imu: [first.read(truth, first_error), second.read(truth, second_error)],
            mag_frd_gauss: mag.now(now).then(|| {
                self.magnetometer.read(truth, errors.mag_bias_gauss, errors.mag_noise_gauss, errors.mag_frozen)
            }),
            pressure_pa: baro
                .now(now)
                .then(|| self.barometer.read(truth, errors.baro_bias_pa, errors.baro_noise_pa, errors.baro_frozen)),
            gnss: self.gnss.arrived(truth.stamp),
            rotor_rpm: rotor.now(now).then(|| self.rotor_speed.read(truth)),
            voltage_v: truth.voltage_v,
            current_a: truth.current_a,
        }
    }
}

/// When a sensor is read next. Instants lie on a fixed grid, so that a loop which does not divide the period makes no
/// drift.
#[derive(Debug, Clone, Copy)]
struct Due {
    period_s: f64,
    count: u64,
}

impl Due {
    fn every(rate_hz: f64) -> Self {
        Self { period_s: if rate_hz > 0.0 { 1.0 / rate_hz } else { f64::INFINITY }, count: 0 }
    }

    fn now(&mut self, t_s: f64) -> bool {
        // half a microsecond of slack: times are sums of binary fractions
        let due = self.period_s.is_finite() && t_s + 5e-7 >= self.count as f64 * self.period_s;
        if due {
            self.count += 1;
        }
        due
    }
}
