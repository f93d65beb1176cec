use super::noise::{NoiseShape, quantise};
use crate::sim::dynamics::Truth;
use crate::sim::random::{Part, Random};
use nalgebra::Vector3;

/// A magnetometer and the field around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnetometerSpec {
    pub rate_hz: f64,
    /// The Earth's field at the place of flight, NED, gauss.
    pub field_ned_gauss: Vector3<f64>,
    pub noise_gauss: f64,
    pub shape: NoiseShape,
    /// Left over after calibration, body FRD, gauss.
    pub hard_iron_gauss: Vector3<f64>,
    /// Field of the motors' currents at full thrust, body FRD, gauss.
    pub motor_gauss: Vector3<f64>,
    pub step_gauss: f64,
}

impl MagnetometerSpec {
    /// The field from strength (gauss), declination (east of north) and inclination (downwards), rad.
    pub fn field(strength_gauss: f64, declination_rad: f64, inclination_rad: f64) -> Vector3<f64> {
        let (down, level) = inclination_rad.sin_cos();
        let (east, north) = declination_rad.sin_cos();
        Vector3::new(level * north, level * east, down) * strength_gauss
    }
}

#[derive(Debug, Clone)]
pub(super) struct Magnetometer {
    spec: MagnetometerSpec,
    random: Random,
    last: Vector3<f64>,
}

impl Magnetometer {
    pub fn new(spec: MagnetometerSpec, seed: u64, vehicle: u8) -> Self {
        Self { spec, random: Random::new(seed, vehicle, Part::Magnetometer), last: Vector3::zeros() }
    }

    pub fn read(
        &mut self,
        truth: &Truth,
        bias_gauss: Vector3<f64>,
        extra_noise_gauss: f64,
        frozen: bool,
    ) -> Vector3<f64> {
        let s = &self.spec;
        let n = truth.rotor_count.max(1) as f64;
        let load = truth.rotors.iter().take(truth.rotor_count).sum::<f64>() / n;
        let sigma = Vector3::repeat(s.noise_gauss + extra_noise_gauss);
        let field = truth.body_to_ned.inverse_transform_vector(&s.field_ned_gauss)
            + s.hard_iron_gauss
            + s.motor_gauss * load
            + bias_gauss
            + s.shape.draw3(&sigma, &mut self.random);
        if !frozen {
            self.last = field.map(|x| quantise(x, s.step_gauss));
        }
        self.last
    }
}
