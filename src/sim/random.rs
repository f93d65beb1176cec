use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A source of random numbers of its own for every part of a simulation: a run depends on the seed alone, and a sensor
/// that draws more numbers, or is left out, changes no other.
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

/// Which part draws. Each has its own stream of the same seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    Vehicle,
    Turbulence,
    Imu(u8),
    Magnetometer,
    Barometer,
    Gnss,
    RotorSpeed,
    Faults,
    Link,
    Estimator,
    Vary,
}

impl Part {
    fn stream(self) -> u64 {
        match self {
            Self::Vehicle => 1,
            Self::Turbulence => 2,
            Self::Magnetometer => 3,
            Self::Barometer => 4,
            Self::Gnss => 5,
            Self::RotorSpeed => 6,
            Self::Faults => 7,
            Self::Link => 8,
            Self::Estimator => 9,
            Self::Vary => 10,
            Self::Imu(i) => 64 + u64::from(i),
        }
    }
}

impl Random {
    /// The stream of one part of one vehicle.
    pub fn new(seed: u64, vehicle: u8, part: Part) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(vehicle) << 32 | part.stream());
        Self(rng)
    }

    /// Normally distributed, mean 0, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    /// Uniform in [lo, hi).
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.0.random::<f64>()
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// Uniform in 0..n; 0 for an empty range.
    pub fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { self.0.random_range(0..n) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_and_vehicles_draw_independently_and_repeatably() {
        let first = |v, p| Random::new(7, v, p).normal();
        assert_eq!(first(1, Part::Gnss), first(1, Part::Gnss));
        assert_ne!(first(1, Part::Gnss), first(2, Part::Gnss));
        assert_ne!(first(1, Part::Imu(0)), first(1, Part::Imu(1)));
    }
}
