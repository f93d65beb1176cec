use crate::signal::{Imu, Stamp};
use nalgebra::Vector3;

/// IMU samples being averaged into one measurement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pending {
    pub first: Stamp,
    /// Sum of offsets from `first`, s.
    offset_s: f64,
    accel: Vector3<f64>,
    rate: Vector3<f64>,
    n: f64,
}

impl Pending {
    pub fn new(stamp: Stamp, accel: Vector3<f64>, rate: Vector3<f64>) -> Self {
        Self { first: stamp, offset_s: 0.0, accel, rate, n: 1.0 }
    }

    pub fn add(&mut self, stamp: Stamp, accel: Vector3<f64>, rate: Vector3<f64>) {
        self.offset_s += stamp - self.first;
        self.accel += accel;
        self.rate += rate;
        self.n += 1.0;
    }

    pub fn mean(&self) -> (Stamp, Imu) {
        (
            self.first.plus_secs(self.offset_s / self.n),
            Imu { accel_frd_mps2: self.accel / self.n, rate_frd_rads: self.rate / self.n },
        )
    }
}
