//! Steps II to V of the paper's methodology (section 4.1): one experiment, every observer of the front on it, the best by
//! its integral square error (ISE) chosen.

use super::design::{Design, Method};
use super::plant::Plant;
use nalgebra::DMatrix;

/// A recorded experiment, sample by sample.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    pub dt_s: f64,
    /// Measured angles φ, θ, ψ, rad; in flight the turn about the body's axes, summed.
    pub angles: Vec<[f64; 3]>,
    /// The known angular accelerations u₁, u₂, u₃ from each sample to the next, rad/s².
    pub inputs: Vec<[f64; 3]>,
    /// The rotors' momentum as a share of the largest, −1 to 1.
    pub momentum: Vec<f64>,
    /// The speeds to which the observers should converge, rad/s.
    pub speeds: Vec<[f64; 3]>,
}

/// Why a record cannot serve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RecordError {
    #[error("the record holds {samples} samples; at least {needed} are needed")]
    Short { samples: usize, needed: usize },
    #[error("the record's sample time must be positive and finite, not {0} s")]
    SampleTime(f64),
}

/// Fewest samples of a record that says anything.
const NEEDED: usize = 50;

impl Record {
    /// Fills in the speeds from the angles with a zero-phase filter, as the paper does from its clean encoders:
    /// .5/(1 − .5z⁻¹) forwards and backwards, then (z − z⁻¹)/2T.
    ///
    /// # Errors
    /// Too few samples.
    pub fn with_speeds_of_angles(mut self, clean: &[[f64; 3]]) -> Result<Self, RecordError> {
        self.check_size(clean.len())?;
        let n = clean.len();
        let mut smooth = clean.to_vec();
        for i in 1..n {
            (0..3).for_each(|k| smooth[i][k] = 0.5 * (smooth[i - 1][k] + smooth[i][k]));
        }
        for i in (0..n - 1).rev() {
            (0..3).for_each(|k| smooth[i][k] = 0.5 * (smooth[i + 1][k] + smooth[i][k]));
        }
        let slope = |i: usize, k: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            (smooth[b][k] - smooth[a][k]) / ((b - a) as f64 * self.dt_s)
        };
        self.speeds = (0..n).map(|i| [0, 1, 2].map(|k| slope(i, k))).collect();
        Ok(self)
    }

    fn check_size(&self, samples: usize) -> Result<(), RecordError> {
        if samples < NEEDED {
            return Err(RecordError::Short { samples, needed: NEEDED });
        }
        if !(self.dt_s > 0.0 && self.dt_s.is_finite()) {
            return Err(RecordError::SampleTime(self.dt_s));
        }
        Ok(())
    }

    /// # Errors
    /// Too few samples, or no sample time.
    pub fn check(&self) -> Result<(), RecordError> {
        let all = [self.angles.len(), self.inputs.len(), self.momentum.len(), self.speeds.len()];
        self.check_size(all.into_iter().min().unwrap_or(0))
    }
}

/// The speeds that an observer estimates on a record, one sample after the other: eq. (9), started at the first angles
/// and at rest.
pub fn estimates(plant: &Plant, design: &Design, record: &Record) -> Vec<[f64; 3]> {
    let c = Plant::outputs();
    let linear = plant.linear(0.0);
    let mut x = [0.0; 6];
    if let Some(first) = record.angles.first() {
        (0..3).for_each(|k| x[2 * k] = first[k]);
    }
    let mut out = Vec::with_capacity(record.angles.len());
    for ((y, u), &momentum) in record.angles.iter().zip(&record.inputs).zip(&record.momentum) {
        let speeds = [x[1], x[3], x[5]];
        out.push(speeds);
        let next = if design.method == Method::LinearDesign {
            std::array::from_fn(|i| (0..6).map(|j| linear[(i, j)] * x[j]).sum())
        } else {
            plant.step(&x, momentum)
        };
        let error = DMatrix::from_fn(3, 1, |k, _| y[k] - (0..6).map(|j| c[(k, j)] * x[j]).sum::<f64>());
        let correction = design.gain_at(momentum, speeds, plant.premise_speed) * error;
        x = std::array::from_fn(|i| {
            let input = if i % 2 == 1 { plant.dt_s * u[i / 2] } else { 0.0 };
            next[i] + input + correction[(i, 0)]
        });
    }
    out
}

/// ∫|η − η̂|² over a record from `from_s` on, rad²/s.
pub fn integral_square_error(estimates: &[[f64; 3]], record: &Record, from_s: f64) -> f64 {
    let first = (from_s / record.dt_s).max(0.0) as usize;
    let square = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>();
    record.dt_s * estimates.iter().zip(&record.speeds).skip(first).map(square).sum::<f64>()
}

/// Designs with their ISE on a record, the best first. An observer that diverges comes last.
///
/// # Errors
/// A record that cannot serve.
pub fn ranked<'a>(
    plant: &Plant,
    designs: impl IntoIterator<Item = &'a Design>,
    record: &Record,
    from_s: f64,
) -> Result<Vec<(&'a Design, f64)>, RecordError> {
    record.check()?;
    let ise = |d: &Design| integral_square_error(&estimates(plant, d, record), record, from_s);
    let mut all: Vec<(&Design, f64)> = designs.into_iter().map(|d| (d, ise(d))).collect();
    // total_cmp puts NaN after every number
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_zero_phase_filter_does_not_lag() {
        let dt_s = 0.005;
        let at = |i: usize| (i as f64 * dt_s * 3.0).sin();
        let clean: Vec<[f64; 3]> = (0..2000).map(|i| [at(i), 0.0, 2.0 * at(i)]).collect();
        let record = Record { dt_s, ..Record::default() }.with_speeds_of_angles(&clean).unwrap();
        for i in 100..1900 {
            let exact = 3.0 * (i as f64 * dt_s * 3.0).cos();
            assert!((record.speeds[i][0] - exact).abs() < 2e-3 && (record.speeds[i][2] - 2.0 * exact).abs() < 4e-3);
        }
    }

    #[test]
    fn a_short_record_is_refused() {
        let record = Record { dt_s: 0.01, ..Record::default() };
        assert_eq!(record.check(), Err(RecordError::Short { samples: 0, needed: NEEDED }));
        assert!(record.with_speeds_of_angles(&[[0.0; 3]; 10]).is_err());
    }
}
