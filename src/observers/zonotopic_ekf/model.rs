use crate::sets::{Interval, Strip};
use nalgebra::{SMatrix, SVector};

/// A system `x⁺ = f(x, u) + E·w` of N states with bounded disturbance, eq. (4a) of Wang and Puig.
pub trait Model<const N: usize> {
    /// What drives one step: u, and its length where steps differ.
    type Input;

    /// f about `base`, for every state in the box `hull`, which holds `base`. `None` where f cannot be bounded, as at
    /// a singularity of the coordinates.
    fn linearise(&self, base: &SVector<f64, N>, hull: &[Interval; N], input: &Self::Input) -> Option<Linearised<N>>;
}

/// For every x of the box and every admissible disturbance,
/// `x⁺ ∈ value + jacobian·(x − base) ± (disturbance + remainder)`, component by component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearised<const N: usize> {
    pub value: SVector<f64, N>,
    pub jacobian: SMatrix<f64, N, N>,
    /// What acts on the system: the box of E·w.
    pub disturbance: SVector<f64, N>,
    /// What the linear form leaves out: curvature over the box, time discretisation, rounding. The paper has none.
    pub remainder: SVector<f64, N>,
}

/// One measured output `y = h(x) + v`, |v| ≤ noise, as a strip around the states that explain it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output<const N: usize> {
    pub name: &'static str,
    pub(super) strip: Strip<N>,
    /// The state that it measures directly, if it is one.
    pub(super) state: Option<usize>,
}

impl<const N: usize> Output<N> {
    /// A state measured directly: |x_state − y| ≤ noise. `None` for a state that is not there.
    pub fn of_state(name: &'static str, state: usize, y: f64, noise: f64) -> Option<Self> {
        let mut normal = SVector::<f64, N>::zeros();
        *normal.get_mut(state)? = 1.0;
        Some(Self { name, strip: Strip { normal, offset: y, half_width: noise }, state: Some(state) })
    }

    /// An output that says nothing: a place to be filled in.
    pub(super) fn nothing() -> Self {
        let strip = Strip { normal: SVector::zeros(), offset: 0.0, half_width: f64::INFINITY };
        Self { name: "", strip, state: None }
    }

    /// A nonlinear output about `base`: `h(x) ∈ value + row·(x − base) ± remainder` over the current hull.
    pub fn about(
        name: &'static str,
        base: &SVector<f64, N>,
        value: f64,
        row: SVector<f64, N>,
        remainder: f64,
        y: f64,
        noise: f64,
    ) -> Self {
        let inner = row.dot(base);
        let offset = y - value + inner;
        // three roundings and those of the product
        let size = y.abs() + value.abs() + row.abs().dot(&base.abs()) + inner.abs();
        let rounding = (N + 4) as f64 * f64::EPSILON * size;
        Self { name, strip: Strip { normal: row, offset, half_width: noise + remainder + rounding }, state: None }
    }
}
