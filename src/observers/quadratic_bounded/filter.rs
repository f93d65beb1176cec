use super::sampled::SampledDesign;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// The sampled observer in filter form, for any linear plant with a nilpotent `A` (a chain of integrators, as every
/// plant of the paper is), with the certificate's bound on its error.
///
/// Predict: `x⁻ = e^{AΔ}x̂ + ∫₀^Δ e^{As}ds·u`, `u` held over the step. Update: `x̂⁺ = x⁻ + L(C x⁻ − y)` (the paper's sign).
/// The bound is `eᵀPe ≤ V`, with V carried along: `V⁺ = e^{−αΔ}V + 1 − e^{−αΔ}` when every output came, the certified
/// growth of the partly observed plant when some did not. All storage is allocated here; no step allocates.
#[derive(Debug, Clone)]
pub struct Filter {
    design: Arc<SampledDesign>,
    x: DVector<f64>,
    /// Bound on eᵀPe; infinite before [`Self::open`].
    v: f64,
    /// The same for the prediction, between [`Self::predict`] and [`Self::update`].
    v_predicted: f64,
    gain: DMatrix<f64>,
    term: DVector<f64>,
    scratch: DVector<f64>,
    innovation: DVector<f64>,
}

impl Filter {
    pub fn new(design: Arc<SampledDesign>) -> Self {
        let (n, p) = (design.a.nrows(), design.c.nrows());
        Self {
            x: DVector::zeros(n),
            v: f64::INFINITY,
            v_predicted: f64::INFINITY,
            gain: DMatrix::zeros(n, p),
            term: DVector::zeros(n),
            scratch: DVector::zeros(n),
            innovation: DVector::zeros(p),
            design,
        }
    }

    pub fn design(&self) -> &SampledDesign {
        &self.design
    }

    pub fn state(&self) -> &DVector<f64> {
        &self.x
    }

    pub fn state_mut(&mut self) -> &mut DVector<f64> {
        &mut self.x
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.innovation.len()
    }

    /// The bound on eᵀPe.
    pub fn level(&self) -> f64 {
        self.v
    }

    /// Half-width of the error of state `i`: the projection of the ellipsoid, `√(V (P⁻¹)ᵢᵢ)`.
    pub fn half_width(&self, i: usize) -> f64 {
        self.v.sqrt() * self.design.half_widths[i]
    }

    /// Opens the bound to hold every error with `|eᵢ| ≤ half_widths[i]`: `eᵀPe ≤ Σ|Pᵢⱼ| bᵢbⱼ`.
    pub fn open(&mut self, half_widths: &[f64]) {
        let p = &self.design.p;
        let mut v: f64 = 0.0;
        for (i, bi) in half_widths.iter().enumerate() {
            for (j, bj) in half_widths.iter().enumerate() {
                v += p[(i, j)].abs() * bi * bj;
            }
        }
        self.v = v.max(1.0);
    }

    /// Moves the state by `dt_s` under a constant input `u` (one value for each state).
    pub fn predict(&mut self, u: &DVector<f64>, dt_s: f64) {
        // x(Δ) = x + Σ_{k≥1} Δᵏ/k! · A^{k−1}(Ax + u): finite, as A is nilpotent
        self.term.copy_from(u);
        self.term.gemv(1.0, &self.design.a, &self.x, 1.0);
        let mut weight = dt_s;
        for k in 2..=self.x.len() + 1 {
            self.x.axpy(weight, &self.term, 1.0);
            self.scratch.gemv(1.0, &self.design.a, &self.term, 0.0);
            std::mem::swap(&mut self.term, &mut self.scratch);
            if self.term.iter().all(|t| *t == 0.0) {
                break;
            }
            weight *= dt_s / k as f64;
        }
        let (growth, offset) = self.design.prediction_growth(dt_s);
        self.v_predicted = growth * self.v + offset;
    }

    /// `C x⁻ − y` for the prediction and these outputs.
    pub fn innovation(&mut self, y: &DVector<f64>) -> &DVector<f64> {
        self.innovation.copy_from(y);
        self.innovation.gemv(1.0, &self.design.c, &self.x, -1.0);
        &self.innovation
    }

    /// Largest `|C x⁻ − y|` of output `j` that the predicted bound and output noise of half-width `noise` admit.
    pub fn admissible(&self, j: usize, noise: f64) -> f64 {
        (self.v_predicted * self.design.output_spread[j]).sqrt() + noise
    }

    /// Takes in the outputs after [`Self::predict`] over the same `dt_s`, which must not exceed the design's longest
    /// step. Bit j of `present` says that output j came.
    pub fn update(&mut self, y: &DVector<f64>, present: u32, dt_s: f64) {
        self.innovation(y);
        let all = (1_u32 << self.outputs()) - 1;
        self.design.partial_gain_at(present & all, dt_s, &mut self.gain);
        self.x.gemv(1.0, &self.gain, &self.innovation, 1.0);
        let (growth, offset) = self.design.partial_growth(present & all, dt_s);
        self.v = growth * self.v + offset;
    }
}
