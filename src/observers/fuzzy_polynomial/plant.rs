use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, SMatrix};
use serde::{Deserialize, Serialize};

/// A 6×6 matrix over the state (φ, φ̇, θ, θ̇, ψ, ψ̇).
pub type State6 = SMatrix<f64, 6, 6>;

/// Why a plant cannot be used for a design.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    #[error("{name} must be positive and finite, not {value}")]
    NotPositive { name: &'static str, value: f64 },
    #[error("{name} must be zero or more and finite, not {value}")]
    Negative { name: &'static str, value: f64 },
    #[error("principal moments of {0:?} kg m² belong to no body: one exceeds the sum of the others")]
    Inertia([f64; 3]),
}

/// Three rotations with rotors, sampled by Euler's method: the model (6) of the paper for any inertia.
///
/// State x = (φ, φ̇, θ, θ̇, ψ, ψ̇), rad and rad/s; y = (φ, θ, ψ). With speeds η = (x₂, x₄, x₆):
/// ```text
/// x₂⁺ = x₂ + T(−d₁·x₂ + g·u·x₄/I₁ + c₁·x₄x₆)     c₁ = (I₂ − I₃)/I₁
/// x₄⁺ = x₄ + T(−d₂·x₄ − g·u·x₂/I₂ + c₂·x₂x₆)     c₂ = (I₃ − I₁)/I₂
/// x₆⁺ = x₆ + T(−d₃·x₆ + c₃·x₂x₄)                 c₃ = (I₁ − I₂)/I₃
/// ```
/// each with its input, and −1 ≤ u ≤ 1 the rotors' angular momentum as a share of the largest, g. The damping dᵢ is ours. Equation (1) prints the
/// gyroscopic term of pitch with the sign and the inertia of roll; appendix A and the matrices of (6) have it as here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plant {
    /// T, s.
    pub dt_s: f64,
    pub inertia_kgm2: [f64; 3],
    /// g: the largest sum of the rotors' angular momenta along the thrust axis, kg m²/s.
    pub rotor_momentum: f64,
    /// dᵢ: the air's damping of each speed, 1/s.
    pub damping: [f64; 3],
    /// Q per axis: the unknown angular acceleration that counts as one unit of disturbance, rad/s².
    pub process: [f64; 3],
    /// R per axis: the measurement error that counts as one unit, rad.
    pub output: [f64; 3],
    /// D's diagonal for angles (1/rad) and speeds (1/(rad/s)).
    pub weight: [[f64; 2]; 3],
    /// R²_max of (7) and (11), (rad/s)².
    pub radius2: f64,
    /// Largest speed of the Takagi–Sugeno model's premises, rad/s.
    pub premise_speed: f64,
    /// σ of (19).
    pub mismatch: f64,
}

/// Speeds that a flying vehicle is designed for, rad/s.
const FLIGHT_SPEED_RADS: f64 = 3.0;
/// How much the autopilot's attitude moves about its own slow error, rad.
const ATTITUDE_JITTER_RAD: f64 = 2e-3;

/// R²_max as printed with (7).
pub const PRINTED_RADIUS2: f64 = 3.0 * std::f64::consts::FRAC_PI_2 * std::f64::consts::FRAC_PI_2;
/// R²_max that gives the printed Table 2 to 3e−4; the printed one gives 4e−3.
pub const FITTED_RADIUS2: f64 = 7.5;

impl Plant {
    /// The rig of the paper: Table A.3, and Q, R, D, σ of section 5.
    ///
    /// g = 4·K_v·V_max·J_r with V_max = 10 V makes the gyroscopic entry .0119446; the printed .012 is rounded.
    pub fn quanser() -> Self {
        Self {
            dt_s: 0.005,
            inertia_kgm2: [0.0552, 0.0552, 0.1104],
            rotor_momentum: 4.0 * 54.945 * 10.0 * 6e-5,
            damping: [0.0; 3],
            process: [0.02; 3],
            output: [0.01; 3],
            weight: [[0.001, 0.1]; 3],
            radius2: FITTED_RADIUS2,
            premise_speed: std::f64::consts::FRAC_PI_2,
            mismatch: 0.003,
        }
    }

    /// A vehicle in flight, sampled every `dt_s`: small rotations about the body's axes in place of angles.
    ///
    /// The rotors of each sense of rotation at full speed against the others standing bound the momentum. A unit of
    /// disturbance is a tenth of the declared torque envelope: what the rotors' model leaves open in ordinary flight.
    pub fn of_vehicle(vehicle: &Vehicle, dt_s: f64) -> Self {
        let inertia: [f64; 3] = std::array::from_fn(|i| vehicle.inertia_kgm2[(i, i)]);
        let one_way = vehicle.rotors.iter().filter(|r| r.spin.reaction_sign() > 0.0).count();
        let most = one_way.max(vehicle.rotors.len() - one_way) as f64;
        let premise_speed = FLIGHT_SPEED_RADS;
        let by_inertia = |v: [f64; 3]| std::array::from_fn(|i| v[i] / inertia[i]);
        let mut plant = Self {
            dt_s,
            inertia_kgm2: inertia,
            rotor_momentum: vehicle.dynamics.inertia_kgm2 * vehicle.dynamics.max_speed_rads * most,
            damping: by_inertia(vehicle.drag.angular),
            process: by_inertia(vehicle.envelope.torque_nm.map(|t| 0.1 * t)),
            output: [ATTITUDE_JITTER_RAD; 3],
            weight: [[0.001, 0.1]; 3],
            radius2: FLIGHT_SPEED_RADS * FLIGHT_SPEED_RADS,
            premise_speed,
            mismatch: 0.0,
        };
        // |Σ(μᵢ(z) − μᵢ(ẑ))·Aᵢx| ≤ T·max|c|·|e_s|·|x|
        plant.mismatch = dt_s * premise_speed * plant.coriolis().iter().fold(0.0, |m: f64, c| m.max(c.abs()));
        plant
    }

    /// # Errors
    /// Names the first number that makes no sense.
    pub fn check(&self) -> Result<(), PlantError> {
        let positive = |name, value: f64| {
            if value > 0.0 && value.is_finite() { Ok(()) } else { Err(PlantError::NotPositive { name, value }) }
        };
        positive("the sample time", self.dt_s)?;
        positive("the speed region's radius", self.radius2)?;
        positive("the largest premise speed", self.premise_speed)?;
        for axis in 0..3 {
            positive("a moment of inertia", self.inertia_kgm2[axis])?;
            positive("a process noise", self.process[axis])?;
            positive("an output noise", self.output[axis])?;
            positive("the weight of an angle", self.weight[axis][0])?;
            positive("the weight of a speed", self.weight[axis][1])?;
        }
        let damping = self.damping.map(|d| ("the damping", d));
        for (name, value) in
            [("the rotors' momentum", self.rotor_momentum), ("σ", self.mismatch)].into_iter().chain(damping)
        {
            if value < 0.0 || !value.is_finite() {
                return Err(PlantError::Negative { name, value });
            }
        }
        let [a, b, c] = self.inertia_kgm2;
        if a > b + c || b > c + a || c > a + b {
            return Err(PlantError::Inertia(self.inertia_kgm2));
        }
        Ok(())
    }

    /// (c₁, c₂, c₃).
    pub fn coriolis(&self) -> [f64; 3] {
        let [a, b, c] = self.inertia_kgm2;
        [(b - c) / a, (c - a) / b, (a - b) / c]
    }

    /// g/I₁ and g/I₂, 1/s.
    pub fn gyroscopic(&self) -> [f64; 2] {
        [self.rotor_momentum / self.inertia_kgm2[0], self.rotor_momentum / self.inertia_kgm2[1]]
    }

    /// The matrix of (6) at rotor momentum u, speeds that multiply speeds left out: the vertex model's linear part.
    pub fn linear(&self, u: f64) -> State6 {
        let mut a = State6::identity();
        for axis in 0..3 {
            a[(2 * axis, 2 * axis + 1)] = self.dt_s;
            a[(2 * axis + 1, 2 * axis + 1)] -= self.dt_s * self.damping[axis];
        }
        let [g1, g2] = self.gyroscopic();
        a[(1, 3)] = self.dt_s * g1 * u;
        a[(3, 1)] = -self.dt_s * g2 * u;
        a
    }

    /// A vertex of the Takagi–Sugeno model (8): speeds that multiply speeds are taken from the premises x₂, x₄.
    pub fn takagi_sugeno(&self, u: f64, x2: f64, x4: f64) -> State6 {
        let mut a = self.linear(u);
        let [c1, c2, c3] = self.coriolis();
        a[(1, 5)] = self.dt_s * c1 * x4;
        a[(3, 5)] = self.dt_s * c2 * x2;
        a[(5, 3)] = self.dt_s * c3 * x2;
        a
    }

    /// x⁺ without input and noise.
    pub fn step(&self, x: &[f64; 6], u: f64) -> [f64; 6] {
        let t = self.dt_s;
        let ([c1, c2, c3], [g1, g2]) = (self.coriolis(), self.gyroscopic());
        [
            x[0] + t * x[1],
            x[1] + t * (-self.damping[0] * x[1] + g1 * u * x[3] + c1 * x[3] * x[5]),
            x[2] + t * x[3],
            x[3] + t * (-self.damping[1] * x[3] - g2 * u * x[1] + c2 * x[1] * x[5]),
            x[4] + t * x[5],
            x[5] + t * (-self.damping[2] * x[5] + c3 * x[1] * x[3]),
        ]
    }

    /// C.
    pub fn outputs() -> DMatrix<f64> {
        DMatrix::from_fn(3, 6, |i, j| if j == 2 * i { 1.0 } else { 0.0 })
    }

    /// T·Q, 6×3.
    pub fn driven(&self) -> DMatrix<f64> {
        DMatrix::from_fn(6, 3, |i, j| if i == 2 * j + 1 { self.dt_s * self.process[j] } else { 0.0 })
    }

    /// R, 3×3.
    pub fn noise(&self) -> DMatrix<f64> {
        DMatrix::from_fn(3, 3, |i, j| if i == j { self.output[i] } else { 0.0 })
    }

    /// D, 6×6.
    pub fn weights(&self) -> DMatrix<f64> {
        DMatrix::from_fn(6, 6, |i, j| if i == j { self.weight[i / 2][i % 2] } else { 0.0 })
    }
}

/// A change of signs that turns the plant into itself, or one vertex into another.
///
/// Turning about the yaw axis by half a turn changes the signs of roll and pitch ([`HALF_TURN`]); a mirror changes those of
/// roll, of yaw and of the rotors' momentum ([`MIRROR`]). Both leave Q, R, D and the regions as they are, and every
/// inequality of the paper is convex in (P, Hᵢ, γ, …), so the mean over the changes of a design is a design as good.
/// Hence P can be taken block-diagonal over the axes, and gains related by [`Change::gain`], at no cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Sign of each axis' angle and speed.
    pub axes: [f64; 3],
}

pub const HALF_TURN: Change = Change { axes: [-1.0, -1.0, 1.0] };
pub const MIRROR: Change = Change { axes: [-1.0, 1.0, -1.0] };

impl Change {
    /// The gain (6×3) after the change: S·L·S_y.
    pub fn gain(&self, l: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(l.nrows(), l.ncols(), |i, j| self.axes[i / 2] * self.axes[j] * l[(i, j)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uneven() -> Plant {
        Plant { inertia_kgm2: [0.02, 0.03, 0.04], damping: [0.5, 0.4, 0.3], ..Plant::quanser() }
    }

    #[test]
    fn the_papers_entries() {
        let p = Plant::quanser();
        assert!((p.linear(1.0)[(1, 3)] - 0.0119446).abs() < 1e-7);
        assert_eq!(p.coriolis(), [-1.0, 1.0, 0.0]);
        let a = p.takagi_sugeno(-1.0, 0.5, 0.25);
        assert!((a[(1, 5)] + 0.005 * 0.25).abs() < 1e-15 && (a[(3, 5)] - 0.005 * 0.5).abs() < 1e-15);
        p.check().unwrap();
    }

    #[test]
    fn the_vertex_models_meet_the_plant() {
        let p = uneven();
        let x = [0.1, 0.7, -0.2, -0.9, 0.3, 0.4];
        let a = p.takagi_sugeno(0.6, x[1], x[3]);
        let linear = a * nalgebra::SVector::<f64, 6>::from(x);
        let exact = p.step(&x, 0.6);
        assert!((0..6).all(|i| (linear[i] - exact[i]).abs() < 1e-15));
    }

    /// S·A·S.
    fn changed(c: &Change, a: State6) -> State6 {
        State6::from_fn(|i, j| c.axes[i / 2] * c.axes[j / 2] * a[(i, j)])
    }

    #[test]
    fn the_changes_of_sign_are_symmetries() {
        let p = uneven();
        for (u, x2, x4) in [(1.0, 0.3, 0.8), (-0.4, -0.6, 0.2)] {
            assert_eq!(changed(&HALF_TURN, p.takagi_sugeno(u, x2, x4)), p.takagi_sugeno(u, -x2, -x4));
            assert_eq!(changed(&MIRROR, p.takagi_sugeno(u, x2, x4)), p.takagi_sugeno(-u, -x2, x4));
        }
        let x = [0.1, 0.7, -0.2, -0.9, 0.3, 0.4];
        let turned = |c: &Change, x: &[f64; 6]| -> [f64; 6] { std::array::from_fn(|i| c.axes[i / 2] * x[i]) };
        assert_eq!(p.step(&turned(&HALF_TURN, &x), 0.6), turned(&HALF_TURN, &p.step(&x, 0.6)));
        assert_eq!(p.step(&turned(&MIRROR, &x), -0.6), turned(&MIRROR, &p.step(&x, 0.6)));
    }

    #[test]
    fn nonsense_is_named() {
        let flat = Plant { inertia_kgm2: [0.1, 0.1, 0.3], ..Plant::quanser() };
        assert_eq!(flat.check(), Err(PlantError::Inertia([0.1, 0.1, 0.3])));
        let still = Plant { dt_s: 0.0, ..Plant::quanser() };
        assert!(still.check().unwrap_err().to_string().contains("the sample time must be positive"));
    }
}
