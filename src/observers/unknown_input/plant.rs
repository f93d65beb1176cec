use super::schedule::Body;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// One corner of the scheduling parameters: ẋ = A·x + B·u + E·d. B plays no part in the design.
#[derive(Debug, Clone, PartialEq)]
pub struct Vertex {
    pub a: DMatrix<f64>,
    pub e: DMatrix<f64>,
}

/// A plant whose matrices move within the hull of their corners (eqs. 1, 15), y = C·x.
#[derive(Debug, Clone, PartialEq)]
pub struct Polytope {
    pub vertices: Vec<Vertex>,
    pub c: DMatrix<f64>,
}

/// Angles and rates of one body: x = (angles, ω), linearised at a rate, whose gyroscopic couplings are `coupling`
/// (ω̇ = coupling·ω + J⁻¹(u + d)).
fn attitude(coupling: &Matrix3<f64>, inertia: &Matrix3<f64>) -> Option<Vertex> {
    let mut a = DMatrix::zeros(6, 6);
    a.view_mut((0, 3), (3, 3)).fill_with_identity();
    a.view_mut((3, 3), (3, 3)).copy_from(coupling);
    let mut e = DMatrix::zeros(6, 3);
    e.view_mut((3, 0), (3, 3)).copy_from(&inertia.try_inverse()?);
    Some(Vertex { a, e })
}

/// The attitude of a vehicle between two bodies (light and heavy), at yaw rates up to `yaw_rads` (rad/s) and rotors'
/// angular momenta up to `rotors_nms` (N m s) of either sign; angles and rates measured, products of inertia included.
/// `None` when an inertia is singular.
pub fn attitude_of(light: &Body, heavy: &Body, yaw_rads: f64, rotors_nms: f64) -> Option<Polytope> {
    let mut vertices = Vec::new();
    for body in [light, heavy] {
        for sign in [-1.0, 1.0] {
            // ω × (Jω + h) at ω = (0, 0, r), derived by ω: the paper's ρ₁₂ and its mirror image
            let omega = Vector3::z() * (sign * yaw_rads);
            let h = Vector3::z() * (sign * rotors_nms);
            let j = &body.inertia_kgm2;
            let torque = (j * omega + h).cross_matrix() - omega.cross_matrix() * j;
            vertices.push(attitude(&(j.try_inverse()? * torque), j)?);
        }
    }
    Some(Polytope { vertices, c: DMatrix::identity(6, 6) })
}

/// The paper's roll and pitch: x = (φ, θ, φ̇, θ̇), eqs. (32) and (33), at the corners of table II with its rows put
/// right: ρ₁₁ = 1/I_x in [1/.0142, 1/.0119], ρ₁₂ in ±74.1176 (printed under ρ₂₁).
pub fn paper_roll_pitch() -> Polytope {
    let mut vertices = Vec::new();
    for rho_11 in [1.0 / 0.0142, 1.0 / 0.0119] {
        for rho_12 in [-74.1176, 74.1176] {
            let mut a = DMatrix::zeros(4, 4);
            a[(0, 2)] = 1.0;
            a[(1, 3)] = 1.0;
            a[(2, 3)] = rho_12;
            a[(3, 2)] = -rho_12;
            let mut e = DMatrix::zeros(4, 2);
            e[(2, 0)] = rho_11;
            e[(3, 1)] = rho_11;
            vertices.push(Vertex { a, e });
        }
    }
    Polytope { vertices, c: DMatrix::identity(4, 4) }
}

/// The paper's yaw: x = (ψ, ψ̇), eqs. (42) and (43), ρ₂₁ = 1/I_z between the two inertias.
pub fn paper_yaw() -> Polytope {
    let vertex = |rho: f64| Vertex { a: nalgebra::dmatrix![0.0, 1.0; 0.0, 0.0], e: nalgebra::dmatrix![0.0; rho] };
    Polytope { vertices: [1.0 / 0.0267, 1.0 / 0.0223].map(vertex).to_vec(), c: DMatrix::identity(2, 2) }
}
