use crate::sim::random::Random;
use nalgebra::Vector3;

/// How noise of a given standard deviation is distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoiseShape {
    Gaussian,
    /// Gaussian, drawn again when it lies beyond this many standard deviations: a bound that is never broken.
    Truncated {
        sigmas: f64,
    },
    /// Equally likely up to √3 standard deviations.
    Uniform,
}

impl NoiseShape {
    pub fn draw(self, sigma: f64, random: &mut Random) -> f64 {
        if sigma == 0.0 {
            return 0.0;
        }
        sigma
            * match self {
                Self::Gaussian => random.normal(),
                Self::Truncated { sigmas } => loop {
                    let n = random.normal();
                    if n.abs() <= sigmas {
                        break n;
                    }
                },
                Self::Uniform => random.between(-1.0, 1.0) * 3f64.sqrt(),
            }
    }

    pub fn draw3(self, sigma: &Vector3<f64>, random: &mut Random) -> Vector3<f64> {
        sigma.map(|s| self.draw(s, random))
    }

    /// The largest value it can take in standard deviations, if there is one.
    pub fn bound(self) -> Option<f64> {
        match self {
            Self::Gaussian => None,
            Self::Truncated { sigmas } => Some(sigmas),
            Self::Uniform => Some(3f64.sqrt()),
        }
    }
}

/// To the nearest multiple of `step`; unchanged when there is none.
pub(super) fn quantise(x: f64, step: f64) -> f64 {
    if step > 0.0 { (x / step).round() * step } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::random::Part;

    #[test]
    fn bounded_noise_keeps_its_bound_and_its_spread() {
        let mut random = Random::new(1, 1, Part::Gnss);
        for shape in [NoiseShape::Gaussian, NoiseShape::Truncated { sigmas: 3.0 }, NoiseShape::Uniform] {
            let draws: Vec<f64> = (0..100_000).map(|_| shape.draw(2.0, &mut random)).collect();
            let largest = draws.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let sigma = (draws.iter().map(|x| x * x).sum::<f64>() / draws.len() as f64).sqrt();
            assert!(shape.bound().is_none_or(|b| largest <= 2.0 * b + 1e-12));
            assert!((sigma / 2.0 - 1.0).abs() < 0.03, "{shape:?}: {sigma}");
        }
    }

    #[test]
    fn quantisation_rounds_to_the_grid() {
        assert_eq!(
            [quantise(0.26, 0.1), quantise(-0.26, 0.1), quantise(0.26, 0.0)],
            [0.30000000000000004, -0.30000000000000004, 0.26]
        );
    }
}
