use nalgebra::{DMatrix, dmatrix};

/// The linear system Σ₂ of eq. (1b) and how its measurement is disturbed:
/// `ẇ = Aw + B_u u + B_z z`, `y = Cw + D_u u + D_z z + Nn`, where z is the output of a nonlinear system Σ₁ for which an
/// observer is known. `u` is known and plays no part in the design.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    pub a: DMatrix<f64>,
    pub b_z: DMatrix<f64>,
    pub c: DMatrix<f64>,
    pub d_z: DMatrix<f64>,
    /// Gain of the measurement noise n; its columns give the noise's size.
    pub n: DMatrix<f64>,
}

/// A plant that states nothing that could be designed for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    #[error("{name} is {}×{}, but must be {}×{} to fit A and C", got.0, got.1, want.0, want.1)]
    Shape { name: &'static str, got: (usize, usize), want: (usize, usize) },
    #[error("{name} holds a number that is not finite")]
    NotFinite { name: &'static str },
}

/// What the receiver of the navigation example measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measures {
    Position,
    /// Position, and velocity north and east: what GPS_RAW_INT holds.
    PositionAndGroundVelocity,
    PositionAndVelocity,
}

impl Measures {
    pub const ALL: [Self; 3] = [Self::Position, Self::PositionAndGroundVelocity, Self::PositionAndVelocity];

    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::PositionAndGroundVelocity => "position-ground-velocity",
            Self::PositionAndVelocity => "position-velocity",
        }
    }
}

impl Plant {
    /// Σ₂ of the navigation example (§5.1): position and velocity (NED) driven by the proper acceleration, N = I.
    pub fn navigation(measures: Measures) -> Self {
        let mut a = DMatrix::zeros(6, 6);
        a.view_mut((0, 3), (3, 3)).fill_with_identity();
        let mut b_z = DMatrix::zeros(6, 3);
        b_z.view_mut((3, 0), (3, 3)).fill_with_identity();
        let outputs = match measures {
            Measures::Position => 3,
            Measures::PositionAndGroundVelocity => 5,
            Measures::PositionAndVelocity => 6,
        };
        let c = DMatrix::identity(outputs, 6);
        Self { a, b_z, d_z: DMatrix::zeros(outputs, 3), n: DMatrix::identity(outputs, outputs), c }
    }

    /// One axis of the navigation example: position and velocity of which the noise has these sizes. Without a velocity
    /// noise the velocity is not measured.
    pub fn axis(position_noise_m: f64, velocity_noise_mps: Option<f64>) -> Self {
        let sizes: Vec<f64> = [Some(position_noise_m), velocity_noise_mps].into_iter().flatten().collect();
        let outputs = sizes.len();
        Self {
            a: dmatrix![0.0, 1.0; 0.0, 0.0],
            b_z: dmatrix![0.0; 1.0],
            c: DMatrix::identity(outputs, 2),
            d_z: DMatrix::zeros(outputs, 1),
            n: DMatrix::from_diagonal(&sizes.into()),
        }
    }

    /// Σ₂ of Example 1 (§4.1): `y = 1/(s² + s + 1)·z`.
    pub fn example_1() -> Self {
        Self {
            a: dmatrix![0.0, 1.0; -1.0, -1.0],
            b_z: dmatrix![0.0; 1.0],
            c: dmatrix![1.0, 0.0],
            d_z: dmatrix![0.0],
            n: dmatrix![1.0],
        }
    }

    /// Number of states of w, of z, and of outputs.
    pub fn sizes(&self) -> (usize, usize, usize) {
        (self.a.nrows(), self.b_z.ncols(), self.c.nrows())
    }

    pub fn check(&self) -> Result<(), PlantError> {
        let (n_w, p_z, p_y) = self.sizes();
        let parts = [
            ("A", &self.a, (n_w, n_w)),
            ("B_z", &self.b_z, (n_w, p_z)),
            ("C", &self.c, (p_y, n_w)),
            ("D_z", &self.d_z, (p_y, p_z)),
            ("N", &self.n, (p_y, self.n.ncols())),
        ];
        for (name, m, want) in parts {
            if m.shape() != want {
                return Err(PlantError::Shape { name, got: m.shape(), want });
            }
            if m.iter().any(|x| !x.is_finite()) {
                return Err(PlantError::NotFinite { name });
            }
        }
        Ok(())
    }

    /// The system with z as a further state, eq. (8c).
    pub fn extended(&self) -> Extended {
        let (n_w, p_z, p_y) = self.sizes();
        let mut a = DMatrix::zeros(n_w + p_z, n_w + p_z);
        a.view_mut((0, 0), (n_w, n_w)).copy_from(&self.a);
        a.view_mut((0, n_w), (n_w, p_z)).copy_from(&self.b_z);
        let mut b_d = DMatrix::zeros(n_w + p_z, p_z);
        b_d.view_mut((n_w, 0), (p_z, p_z)).fill_with_identity();
        let mut c = DMatrix::zeros(p_y, n_w + p_z);
        c.view_mut((0, 0), (p_y, n_w)).copy_from(&self.c);
        c.view_mut((0, n_w), (p_y, p_z)).copy_from(&self.d_z);
        Extended { a, b_d, c }
    }
}

/// 𝔄, 𝔅_d and ℭ of eq. (8c).
#[derive(Debug, Clone, PartialEq)]
pub struct Extended {
    pub a: DMatrix<f64>,
    pub b_d: DMatrix<f64>,
    pub c: DMatrix<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_shape_is_named() {
        let mut p = Plant::example_1();
        p.d_z = DMatrix::zeros(2, 1);
        assert_eq!(p.check(), Err(PlantError::Shape { name: "D_z", got: (2, 1), want: (1, 1) }));
        p = Plant::example_1();
        p.a[(0, 0)] = f64::NAN;
        assert_eq!(p.check(), Err(PlantError::NotFinite { name: "A" }));
    }

    #[test]
    fn the_extension_puts_an_integrator_before_the_input() {
        let e = Plant::axis(1.0, None).extended();
        assert_eq!(e.a, dmatrix![0.0, 1.0, 0.0; 0.0, 0.0, 1.0; 0.0, 0.0, 0.0]);
        assert_eq!(e.b_d, dmatrix![0.0; 0.0; 1.0]);
        assert_eq!(e.c, dmatrix![1.0, 0.0, 0.0]);
    }
}
