use nalgebra::DMatrix;

/// Why a plant cannot be used for a design.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    #[error("{name} is {}×{}, expected {}×{}", found.0, found.1, expected.0, expected.1)]
    Dimension { name: String, expected: (usize, usize), found: (usize, usize) },
    #[error("{name} holds a number that is not finite")]
    NotFinite { name: String },
    #[error("{name} must be symmetric and positive definite")]
    NotPositive { name: String },
    #[error("the plant has no {0}")]
    Missing(&'static str),
}

pub(super) fn check_shape(name: &str, m: &DMatrix<f64>, expected: (usize, usize)) -> Result<(), PlantError> {
    if m.shape() != expected {
        return Err(PlantError::Dimension { name: name.into(), expected, found: m.shape() });
    }
    if m.iter().any(|x| !x.is_finite()) {
        return Err(PlantError::NotFinite { name: name.into() });
    }
    Ok(())
}

/// Upper triangular R with q = RᵀR.
pub(super) fn factor(name: &str, q: &DMatrix<f64>) -> Result<DMatrix<f64>, PlantError> {
    let fail = || PlantError::NotPositive { name: name.into() };
    if (q - q.transpose()).amax() > 1e-9 * q.amax() {
        return Err(fail());
    }
    Ok(q.clone().cholesky().ok_or_else(fail)?.l().transpose())
}

/// m·r⁻¹ for upper triangular r with a positive diagonal.
pub(super) fn over(m: &DMatrix<f64>, r: &DMatrix<f64>) -> DMatrix<f64> {
    // x·r = m ⇔ rᵀ·xᵀ = mᵀ; a Cholesky factor has no zero on its diagonal, so the solve cannot fail
    r.transpose().solve_lower_triangular(&m.transpose()).map_or_else(|| m.clone(), |x| x.transpose())
}

/// A disturbance that enters a plant as `w·η` and is known to stay in an ellipsoid: ηᵀ·q·η ≤ 1 at every time.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseBlock {
    pub w: DMatrix<f64>,
    pub q: DMatrix<f64>,
}

impl NoiseBlock {
    /// A scalar |η| ≤ `half_width` that enters row `row` of `rows`.
    pub fn scalar(rows: usize, row: usize, half_width: f64) -> Self {
        let mut w = DMatrix::zeros(rows, 1);
        if let Some(x) = w.get_mut(row) {
            *x = half_width;
        }
        Self { w, q: DMatrix::identity(1, 1) }
    }

    /// w·q^{−1/2}: the block as `G·ζ` with |ζ| ≤ 1.
    pub(super) fn unit(&self, name: &str, rows: usize) -> Result<DMatrix<f64>, PlantError> {
        let l = self.w.ncols();
        check_shape(name, &self.w, (rows, l))?;
        check_shape(&format!("q of {name}"), &self.q, (l, l))?;
        Ok(over(&self.w, &factor(&format!("q of {name}"), &self.q)?))
    }
}

/// The plant of eq. (1) without its inputs, which cancel in the error: ẋ = A·x + W₁·η₁, y = C·x + W₂·η₂, z = E₁·x, with
/// (η₁, η₂) in the ellipsoid of Q = ½·blkdiag(Q₁, Q₂) (eqs. 2, 59).
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    pub a: DMatrix<f64>,
    pub w1: DMatrix<f64>,
    pub q1: DMatrix<f64>,
    pub c: DMatrix<f64>,
    pub w2: DMatrix<f64>,
    pub q2: DMatrix<f64>,
    pub e1: DMatrix<f64>,
}

impl Plant {
    /// # Errors
    /// Names the first matrix whose shape, entries or definiteness do not fit.
    pub fn check(&self) -> Result<(), PlantError> {
        let (n, p) = (self.a.nrows(), self.c.nrows());
        check_plant(&self.a, &self.c, &self.e1)?;
        check_shape("W1", &self.w1, (n, self.w1.ncols()))?;
        check_shape("W2", &self.w2, (p, self.w2.ncols()))?;
        check_shape("Q1", &self.q1, (self.w1.ncols(), self.w1.ncols()))?;
        check_shape("Q2", &self.q2, (self.w2.ncols(), self.w2.ncols()))?;
        factor("Q1", &self.q1)?;
        factor("Q2", &self.q2)?;
        Ok(())
    }
}

/// A plant for the sampled observer: ẋ = A·x + Σ wᵢ·ηᵢ, y = C·x + Σ vⱼ·νⱼ, z = E₁·x, every η and ν in an ellipsoid of its
/// own and free to change at any instant.
///
/// Separate ellipsoids say more than one common one when the disturbances do not know of each other: each gets its own
/// multiplier in the design.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledPlant {
    pub a: DMatrix<f64>,
    /// Enter the state equation.
    pub process: Vec<NoiseBlock>,
    pub c: DMatrix<f64>,
    /// Enter the measurement equation.
    pub output: Vec<NoiseBlock>,
    /// Selects the states whose bound the design makes small.
    pub e1: DMatrix<f64>,
}

/// Factors of process and of measurement noise.
type Factors = (Vec<DMatrix<f64>>, Vec<DMatrix<f64>>);

impl SampledPlant {
    /// The unit-ball factors of the process and of the output blocks; blocks that are zero are left out.
    ///
    /// # Errors
    /// Names the first matrix whose shape, entries or definiteness do not fit.
    pub(super) fn units(&self) -> Result<Factors, PlantError> {
        check_plant(&self.a, &self.c, &self.e1)?;
        let all = |blocks: &[NoiseBlock], kind: &str, rows| -> Result<Vec<_>, PlantError> {
            let mut out = Vec::new();
            for (i, b) in blocks.iter().enumerate() {
                out.push(b.unit(&format!("{kind} noise {i}"), rows)?);
            }
            out.retain(|w: &DMatrix<f64>| w.amax() > 0.0);
            Ok(out)
        };
        let output = all(&self.output, "output", self.c.nrows())?;
        Ok((all(&self.process, "process", self.a.nrows())?, output))
    }
}

fn check_plant(a: &DMatrix<f64>, c: &DMatrix<f64>, e1: &DMatrix<f64>) -> Result<(), PlantError> {
    let n = a.nrows();
    for (what, m) in [("state", a), ("output", c), ("estimated combination (E1)", e1)] {
        if m.nrows() == 0 || m.ncols() == 0 {
            return Err(PlantError::Missing(what));
        }
    }
    check_shape("A", a, (n, n))?;
    check_shape("C", c, (c.nrows(), n))?;
    check_shape("E1", e1, (e1.nrows(), n))?;
    // P_z exists only for independent rows
    factor("E1·E1ᵀ", &(e1 * e1.transpose())).map(|_| ())
}

/// P_z of eq. (19), as (E₁·P⁻¹·E₁ᵀ)⁻¹: the ellipsoid of z when x lies in that of P. `None` when P is not positive.
pub fn projected(p: &DMatrix<f64>, e1: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let shadow = e1 * p.clone().cholesky()?.solve(&e1.transpose());
    let inverse = shadow.cholesky()?.inverse();
    Some((&inverse + inverse.transpose()) * 0.5)
}

/// Half-widths √((P⁻¹)ᵢᵢ) of the box around the ellipsoid xᵀPx ≤ 1.
pub fn half_widths(p_inverse: &DMatrix<f64>) -> Vec<f64> {
    p_inverse.diagonal().iter().map(|x| x.max(0.0).sqrt()).collect()
}

/// Volume of the ellipsoid of `p_z` (eq. 20), and log det `p_z`. `None` when it is not positive.
pub fn volume(p_z: &DMatrix<f64>) -> Option<(f64, f64)> {
    let log_det: f64 = p_z.clone().cholesky()?.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
    Some((unit_ball(p_z.nrows()) * (-0.5 * log_det).exp(), log_det))
}

/// Volume of the unit ball in q dimensions: B_q = (2π/q)·B_{q−2}, B₀ = 1, B₁ = 2.
pub(super) fn unit_ball(q: usize) -> f64 {
    match q {
        0 => 1.0,
        1 => 2.0,
        _ => std::f64::consts::TAU / q as f64 * unit_ball(q - 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn volumes_of_known_balls() {
        use std::f64::consts::PI;
        for (q, expected) in [(1, 2.0), (2, PI), (3, 4.0 * PI / 3.0), (6, PI.powi(3) / 6.0)] {
            let (v, log_det) = volume(&DMatrix::identity(q, q)).unwrap();
            assert!((v - expected).abs() < 1e-12 && log_det == 0.0);
        }
        let (v, _) = volume(&dmatrix![4.0, 0.0; 0.0, 1.0]).unwrap();
        assert!((v - PI / 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_projection_is_the_schur_complement() {
        let p = dmatrix![4.0, 1.0, 0.5; 1.0, 3.0, 0.2; 0.5, 0.2, 2.0];
        let e1 = dmatrix![0.0, 1.0, 0.0; 0.0, 0.0, 1.0];
        let schur = p.view((1, 1), (2, 2)) - p.view((1, 0), (2, 1)) * p.view((0, 1), (1, 2)) / 4.0;
        assert!((projected(&p, &e1).unwrap() - schur).amax() < 1e-12);
    }

    #[test]
    fn a_misfit_is_named() {
        let plant = SampledPlant {
            a: DMatrix::zeros(2, 2),
            process: vec![NoiseBlock::scalar(2, 1, 1.0)],
            c: dmatrix![1.0, 0.0],
            output: vec![NoiseBlock { w: dmatrix![1.0], q: dmatrix![-1.0] }],
            e1: dmatrix![0.0, 1.0],
        };
        assert_eq!(
            plant.units().unwrap_err().to_string(),
            "q of output noise 0 must be symmetric and positive definite"
        );
        let wide = SampledPlant { c: DMatrix::zeros(1, 3), ..plant.clone() };
        assert_eq!(wide.units().unwrap_err().to_string(), "C is 1×3, expected 1×2");
        let lame = SampledPlant { e1: dmatrix![0.0, 0.0], ..plant };
        assert_eq!(lame.units().unwrap_err(), PlantError::NotPositive { name: "E1·E1ᵀ".into() });
    }
}
