use super::plant::Plant;
use nalgebra::DMatrix;

/// Units in which a design's numbers are of size one: x = T·x̃, y = N·ỹ, D = d·D̃.
#[derive(Debug, Clone)]
pub(super) struct Units {
    /// T's diagonal.
    pub(super) state: [f64; 6],
    /// N's diagonal: the measurement noise.
    pub(super) output: [f64; 3],
    /// d: the largest weight. P̃ = T·P·T/d², γ̃ = γ/d².
    pub(super) weight: f64,
}

impl Units {
    /// Angles in units of their noise, speeds in `speed_factor` times what the noise gives within a time between 1/α and
    /// a sample.
    pub(super) fn of(plant: &Plant, alpha: f64, speed_factor: f64) -> Self {
        let rate = speed_factor * (alpha / plant.dt_s).sqrt();
        let state = std::array::from_fn(|i| plant.output[i / 2] * if i % 2 == 0 { 1.0 } else { rate });
        let weight = plant.weight.iter().flatten().fold(0.0, |m: f64, w| m.max(*w));
        Self { state, output: plant.output, weight }
    }

    /// T.
    pub(super) fn t(&self) -> DMatrix<f64> {
        DMatrix::from_fn(6, 6, |i, j| if i == j { self.state[i] } else { 0.0 })
    }

    /// T⁻¹·M for a matrix with a row for each state.
    pub(super) fn rows_from_state(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / self.state[i])
    }

    /// T⁻¹·A·T.
    pub(super) fn matrix(&self, a: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(6, 6, |i, j| a[(i, j)] * self.state[j] / self.state[i])
    }

    /// D·T/d.
    pub(super) fn weights(&self, plant: &Plant) -> DMatrix<f64> {
        plant.weights() * self.t() / self.weight
    }

    /// N⁻¹·C·T: with angles in units of their noise, C itself.
    pub(super) fn outputs(&self) -> DMatrix<f64> {
        let c = Plant::outputs();
        DMatrix::from_fn(3, 6, |i, j| c[(i, j)] * self.state[j] / self.output[i])
    }

    /// L from L̃: T·L̃·N⁻¹.
    pub(super) fn gain_back(&self, l: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(6, 3, |i, j| l[(i, j)] * self.state[i] / self.output[j])
    }

    /// L̃ from L.
    pub(super) fn gain(&self, l: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(6, 3, |i, j| l[(i, j)] / self.state[i] * self.output[j])
    }

    /// P from P̃.
    pub(super) fn lyapunov_back(&self, p: &DMatrix<f64>) -> DMatrix<f64> {
        let d2 = self.weight * self.weight;
        DMatrix::from_fn(6, 6, |i, j| 0.5 * (p[(i, j)] + p[(j, i)]) * d2 / (self.state[i] * self.state[j]))
    }

    /// P̃ from P.
    pub(super) fn lyapunov(&self, p: &DMatrix<f64>) -> DMatrix<f64> {
        let d2 = self.weight * self.weight;
        DMatrix::from_fn(6, 6, |i, j| p[(i, j)] / d2 * self.state[i] * self.state[j])
    }
}
