use super::design::{Goal, design};
use super::norm::{HinfNorm, hinf_norm, spectral_abscissa};
use super::plant::Plant;
use super::{DesignError, Extended};
use crate::observers::quadratic_bounded::stabilising;
use nalgebra::DMatrix;

/// What the gains of the navigation observer are made for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavigationGoal {
    /// Standard deviation of one fix, horizontally and vertically, m.
    pub position_noise_m: [f64; 2],
    /// Of the velocity of one fix, m/s.
    pub velocity_noise_mps: f64,
    /// Of one sample of the barometer's height, m.
    pub barometer_noise_m: f64,
    /// Time between fixes, and between samples of the barometer, s.
    pub gnss_period_s: f64,
    pub barometer_period_s: f64,
    /// How fast the error of the estimated acceleration wanders, m/s² per √s: tilt errors that come and go.
    pub acceleration_walk: f64,
    /// ‖H‖∞ < γ, as Theorem 1 asks.
    pub gamma: f64,
    /// Gains from (14) and (15) at this γ_n, with N = I, in place of those for the noise above.
    pub gamma_n: Option<f64>,
}

impl Default for NavigationGoal {
    fn default() -> Self {
        Self {
            position_noise_m: [0.3, 0.5],
            velocity_noise_mps: 0.1,
            barometer_noise_m: 0.15,
            gnss_period_s: 0.2,
            barometer_period_s: 0.05,
            acceleration_walk: 0.3,
            gamma: 50.0,
            gamma_n: None,
        }
    }
}

/// Gains of one axis of the observer (24): what an error of the measured position, or velocity, does to position,
/// velocity and acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisGains {
    pub position: [f64; 3],
    pub velocity: Option<[f64; 3]>,
}

impl AxisGains {
    fn from_matrix(k: &DMatrix<f64>) -> Self {
        let column = |j: usize| [k[(0, j)], k[(1, j)], k[(2, j)]];
        Self { position: column(0), velocity: (k.ncols() > 1).then(|| column(1)) }
    }

    /// K·ℭ's block from the measured quantities to themselves: with the model in between, the innovation of one sample
    /// decays by this rate (a matrix, 1/s).
    pub(super) fn decay(&self) -> [[f64; 2]; 2] {
        match self.velocity {
            Some(v) => [[self.position[0], v[0]], [self.position[1], v[1]]],
            None => [[self.position[0], 0.0], [0.0, 0.0]],
        }
    }
}

/// The gains of all axes, with the norms that Theorem 1 asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavigationGains {
    /// North and east, from position and velocity.
    pub level: AxisGains,
    /// Down, from the receiver's height, and from the barometer's.
    pub gnss_height: AxisGains,
    pub barometer_height: AxisGains,
    /// ‖H‖∞ of each of the three.
    pub norms: [HinfNorm; 3],
}

impl NavigationGains {
    pub fn new(goal: &NavigationGoal) -> Result<Self, DesignError> {
        let velocity = Some(goal.velocity_noise_mps);
        let level = axis(goal, goal.position_noise_m[0], velocity, goal.gnss_period_s)?;
        let gnss = axis(goal, goal.position_noise_m[1], None, goal.gnss_period_s)?;
        let barometer = axis(goal, goal.barometer_noise_m, None, goal.barometer_period_s)?;
        Ok(Self {
            level: level.0,
            gnss_height: gnss.0,
            barometer_height: barometer.0,
            norms: [level.1, gnss.1, barometer.1],
        })
    }
}

/// One axis: of the gains that satisfy Theorem 1 those with the least variance under white noise of these sizes, from
/// the filter's Riccati equation of the extended system (8), or those from the matrix inequalities. Either way
/// ‖H‖∞ < γ is checked by Hamiltonian eigenvalues.
fn axis(
    goal: &NavigationGoal,
    position_m: f64,
    velocity_mps: Option<f64>,
    period_s: f64,
) -> Result<(AxisGains, HinfNorm), DesignError> {
    let plant = Plant::axis(position_m, velocity_mps);
    let Extended { a, b_d, c } = plant.extended();
    let gain = match goal.gamma_n {
        Some(gamma_n) => design(&Plant::axis(1.0, velocity_mps.map(|_| 1.0)), &Goal::new(goal.gamma, gamma_n))?.gain,
        None => {
            // a sample of variance σ² every T is white noise of density σ²·T
            let weight = (&plant.n * &plant.n * period_s).try_inverse();
            let weighted = weight.map(|w| c.transpose() * w).ok_or_else(|| not_verified("a noise is zero"))?;
            let driven = &b_d * b_d.transpose() * goal.acceleration_walk.powi(2);
            let root = stabilising(&a, &(&weighted * &c), &driven)
                .ok_or_else(|| not_verified("the filter's Riccati equation has no stabilising solution"))?;
            &root * root.transpose() * weighted
        }
    };
    let closed = &a - &gain * &c;
    let norm = spectral_abscissa(&closed)
        .filter(|re| *re < 0.0)
        .and_then(|_| hinf_norm(&closed, &b_d))
        .ok_or_else(|| not_verified("𝔄 − Kℭ is not Hurwitz"))?;
    if norm.upper >= goal.gamma {
        return Err(not_verified(&format!("‖H‖ = {:.3} is not below {}", norm.upper, goal.gamma)));
    }
    Ok((AxisGains::from_matrix(&gain), norm))
}

fn not_verified(what: &str) -> DesignError {
    DesignError::NotVerified { what: what.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_of_three_integrators_has_the_known_gains() {
        let goal = NavigationGoal::default();
        let gains = NavigationGains::new(&goal).unwrap();
        // Butterworth: ω³ = q/√r, K = (2ω, 2ω², ω³)
        let omega = (goal.acceleration_walk / (goal.position_noise_m[1] * goal.gnss_period_s.sqrt())).cbrt();
        let expected = [2.0 * omega, 2.0 * omega * omega, omega.powi(3)];
        for (got, want) in gains.gnss_height.position.iter().zip(expected) {
            assert!((got - want).abs() < 1e-6 * want, "{got} {want}");
        }
        assert!(gains.norms.iter().all(|n| n.upper < goal.gamma), "{gains:?}");
        let refused = NavigationGains::new(&NavigationGoal { gamma: 0.01, ..goal });
        assert!(matches!(refused, Err(DesignError::NotVerified { .. })));
    }

    #[test]
    fn gains_may_come_from_the_inequalities() {
        let gains = NavigationGains::new(&NavigationGoal { gamma_n: Some(1.5), ..NavigationGoal::default() }).unwrap();
        assert!(gains.level.velocity.is_some() && gains.gnss_height.velocity.is_none());
    }
}
