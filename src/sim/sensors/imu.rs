use super::filter::LowPass;
use super::noise::{NoiseShape, quantise};
use super::suite::ImuError;
use crate::sim::dynamics::Truth;
use crate::sim::random::{Part, Random};
use nalgebra::Vector3;

/// One inertial sensor, as an autopilot delivers it: after its low-pass filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSpec {
    /// How far filtered readings trail the truth, s.
    pub accel_delay_s: f64,
    pub gyro_delay_s: f64,
    /// Noise of one delivered sample, standard deviation per axis.
    pub accel_noise_mps2: Vector3<f64>,
    pub gyro_noise_rads: Vector3<f64>,
    pub shape: NoiseShape,
    /// Constant errors are drawn once, uniformly within these.
    pub accel_bias_mps2: Vector3<f64>,
    pub gyro_bias_rads: Vector3<f64>,
    /// Random walk of the biases, per √s.
    pub accel_walk: f64,
    pub gyro_walk: f64,
    /// Scale errors are drawn once, uniformly within ± this share.
    pub accel_scale: f64,
    pub gyro_scale: f64,
    pub accel_range_mps2: f64,
    pub gyro_range_rads: f64,
    /// Step of the digital output; 0 for none.
    pub accel_step_mps2: f64,
    pub gyro_step_rads: f64,
    pub vibration: Option<Vibration>,
}

/// Shaking at the rotors' frequency. It grows with the square of their speed and meets the low-pass filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vibration {
    /// Amplitudes in hover.
    pub accel_mps2: f64,
    pub gyro_rads: f64,
    /// Rotor frequency in hover, Hz.
    pub hover_hz: f64,
}

/// What the sensor delivers, body FRD.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImuReading {
    /// After the low-pass filter: for the rate loop and the telemetry, and so it comes late.
    pub accel_frd_mps2: Vector3<f64>,
    pub rate_frd_rads: Vector3<f64>,
    /// Before it: what an estimator integrates.
    pub raw_accel_frd_mps2: Vector3<f64>,
    pub raw_rate_frd_rads: Vector3<f64>,
}

#[derive(Debug, Clone)]
pub(super) struct Imu {
    spec: ImuSpec,
    random: Random,
    accel_filter: Option<LowPass>,
    gyro_filter: Option<LowPass>,
    accel_bias: Vector3<f64>,
    gyro_bias: Vector3<f64>,
    accel_scale: Vector3<f64>,
    gyro_scale: Vector3<f64>,
    phase: f64,
    period_s: f64,
    last: ImuReading,
}

impl Imu {
    pub fn new(spec: ImuSpec, index: u8, seed: u64, vehicle: u8, period_s: f64) -> Self {
        let mut random = Random::new(seed, vehicle, Part::Imu(index));
        let mut within = |limit: f64| if limit > 0.0 { random.between(-limit, limit) } else { 0.0 };
        let accel_bias = spec.accel_bias_mps2.map(&mut within);
        let gyro_bias = spec.gyro_bias_rads.map(&mut within);
        let accel_scale = Vector3::repeat(1.0) + Vector3::repeat(spec.accel_scale).map(&mut within);
        let gyro_scale = Vector3::repeat(1.0) + Vector3::repeat(spec.gyro_scale).map(&mut within);
        Self {
            accel_filter: LowPass::with_delay(spec.accel_delay_s, period_s),
            gyro_filter: LowPass::with_delay(spec.gyro_delay_s, period_s),
            spec,
            random,
            accel_bias,
            gyro_bias,
            accel_scale,
            gyro_scale,
            phase: 0.0,
            period_s,
            last: ImuReading::default(),
        }
    }

    pub fn read(&mut self, truth: &Truth, fault: &ImuError) -> ImuReading {
        let mut raw_accel = truth.specific_force_frd_mps2;
        let mut raw_rate = truth.rate_frd_rads;
        if let Some(v) = self.spec.vibration {
            let (a, g) = self.shaking(&v, truth);
            raw_accel += a;
            raw_rate += g;
        }
        let accel = self.accel_filter.as_mut().map_or(raw_accel, |f| f.apply(raw_accel));
        let rate = self.gyro_filter.as_mut().map_or(raw_rate, |f| f.apply(raw_rate));
        self.walk();
        let s = &self.spec;
        let accel_sigma = s.accel_noise_mps2.add_scalar(fault.accel_noise_mps2);
        let gyro_sigma = s.gyro_noise_rads.add_scalar(fault.gyro_noise_rads);
        let accel_error = self.accel_bias + fault.accel_bias_mps2 + s.shape.draw3(&accel_sigma, &mut self.random);
        let gyro_error = self.gyro_bias + fault.gyro_bias_rads + s.shape.draw3(&gyro_sigma, &mut self.random);
        let digital_accel = |x: Vector3<f64>| {
            (x.component_mul(&self.accel_scale) + accel_error)
                .map(|x| quantise(x.clamp(-s.accel_range_mps2, s.accel_range_mps2), s.accel_step_mps2))
        };
        let digital_rate = |x: Vector3<f64>| {
            (x.component_mul(&self.gyro_scale) + gyro_error)
                .map(|x| quantise(x.clamp(-s.gyro_range_rads, s.gyro_range_rads), s.gyro_step_rads))
        };
        if !fault.accel_frozen {
            self.last.accel_frd_mps2 = digital_accel(accel);
            self.last.raw_accel_frd_mps2 = digital_accel(raw_accel);
        }
        if !fault.gyro_frozen {
            self.last.rate_frd_rads = digital_rate(rate);
            self.last.raw_rate_frd_rads = digital_rate(raw_rate);
        }
        self.last
    }

    fn walk(&mut self) {
        let root = self.period_s.sqrt();
        if self.spec.accel_walk > 0.0 {
            let sigma = Vector3::repeat(self.spec.accel_walk * root);
            self.accel_bias += NoiseShape::Gaussian.draw3(&sigma, &mut self.random);
        }
        if self.spec.gyro_walk > 0.0 {
            let sigma = Vector3::repeat(self.spec.gyro_walk * root);
            self.gyro_bias += NoiseShape::Gaussian.draw3(&sigma, &mut self.random);
        }
    }

    fn shaking(&mut self, v: &Vibration, truth: &Truth) -> (Vector3<f64>, Vector3<f64>) {
        // speed relative to hover from the rotors' commands: near enough for shaking
        let n = truth.rotor_count.max(1) as f64;
        let level = truth.rotors.iter().take(truth.rotor_count).sum::<f64>() / n * 2.0;
        self.phase = (self.phase + std::f64::consts::TAU * v.hover_hz * level.max(0.0).sqrt() * self.period_s)
            .rem_euclid(std::f64::consts::TAU);
        let (sin, cos) = self.phase.sin_cos();
        let shape = Vector3::new(cos, sin, sin * cos * 2.0) * level;
        (shape * v.accel_mps2, shape * v.gyro_rads)
    }
}
