use super::filter::{FilterSettings, Mode};
use super::online::{Outputs, Settings, StateObserver};
use super::quadrotor::{Quadrotor, STATES};
use crate::observers::{BuildError, Observer, Options, Registration};
use crate::sets::Reduction;
use crate::signal::Channel;
use crate::vehicle::Vehicle;
use nalgebra::{SVector, Vector3};

pub const REGISTRATION: Registration = Registration {
    name: "zonotopic_ekf",
    id: 2,
    paper: "Wang, Puig: Zonotopic extended Kalman filter and fault detection of discrete-time nonlinear systems (2016)",
    estimates: "intervals of position, velocity, attitude and body rate; which output contradicts the model",
    needs: &[Channel::Imu, Channel::Attitude, Channel::Velocity, Channel::Actuators],
    options: &["mode", "order", "reduction", "outputs"],
    prefix: "ZKF",
    dials: &[],
    standard: true,
    builder,
};

/// Keeps the weights of exactly known states finite.
const LEAST_NOISE: f64 = 1e-6;

fn builder(vehicle: &Vehicle, options: &mut Options) -> Result<Box<dyn Observer>, BuildError> {
    let option = |source| BuildError::Option { observer: REGISTRATION.name, source };
    let modes = [("guaranteed", Mode::Guaranteed), ("paper", Mode::Paper)];
    let kinds = [
        ("combastel", Reduction::Combastel),
        ("girard", Reduction::Girard),
        ("pca", Reduction::Pca),
        ("scott", Reduction::Scott),
    ];
    let sets = [
        ("rates", Outputs::Rates),
        ("attitude", Outputs::Attitude),
        ("velocity", Outputs::Velocity),
        ("position", Outputs::Position),
    ];
    let mode = options.choice("mode", &modes).map_err(option)?.unwrap_or(Mode::Guaranteed);
    let order = options.number("order", 2.0, 20.0).map_err(option)?.unwrap_or(15.0) as usize;
    let reduction = options.choice("reduction", &kinds).map_err(option)?.unwrap_or(Reduction::Girard);
    let outputs = options.choice("outputs", &sets).map_err(option)?.unwrap_or(Outputs::Rates);
    let noise = &vehicle.noise;
    let groups =
        [noise.position_m, noise.velocity_mps, [noise.tilt_rad, noise.tilt_rad, noise.yaw_rad], noise.gyro_rads];
    let weights = SVector::<f64, STATES>::from_fn(|i, _| 1.0 / groups[i / 3][i % 3].max(LEAST_NOISE));
    let settings = Settings { filter: FilterSettings { mode, reduction, order, weights }, outputs };
    let model = Quadrotor::new(
        vehicle.mass_kg.nominal,
        &vehicle.inertia_kgm2,
        Vector3::from(vehicle.drag.angular),
        Vector3::from(vehicle.envelope.force_n),
        Vector3::zeros(),
        Vector3::from(vehicle.envelope.torque_nm),
    )
    .map_err(|e| BuildError::Design {
        observer: REGISTRATION.name,
        part: "model".to_owned(),
        source: Box::new(e),
    })?;
    Ok(Box::new(StateObserver::new(model, vehicle.noise, vehicle.envelope, vehicle.mass_kg.nominal, settings)))
}
