use nalgebra::{Matrix3, Vector3};

/// Something carried, rigidly fixed to the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    pub mass_kg: f64,
    /// Its centre, from the vehicle's own centre of mass, body FRD, m.
    pub position_frd_m: Vector3<f64>,
    /// About its own centre, kg m².
    pub inertia_kgm2: Matrix3<f64>,
}

/// Mass, centre of mass and inertia of all that flies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassProperties {
    pub mass_kg: f64,
    /// From the body's origin, which is the empty vehicle's centre of mass, body FRD, m.
    pub centre_frd_m: Vector3<f64>,
    /// About the centre of mass, kg m².
    pub inertia_kgm2: Matrix3<f64>,
    pub(super) inverse_inertia: Matrix3<f64>,
}

impl MassProperties {
    /// Of the empty vehicle; `None` when the inertia is not positive definite or the mass not positive.
    pub fn empty(mass_kg: f64, inertia_kgm2: Matrix3<f64>) -> Option<Self> {
        Self::new(mass_kg, Vector3::zeros(), inertia_kgm2)
    }

    fn new(mass_kg: f64, centre_frd_m: Vector3<f64>, inertia_kgm2: Matrix3<f64>) -> Option<Self> {
        let inverse_inertia = inertia_kgm2.cholesky()?.inverse();
        (mass_kg > 0.0).then_some(Self { mass_kg, centre_frd_m, inertia_kgm2, inverse_inertia })
    }

    /// With a payload fixed to it: masses add, and inertias by the parallel-axis theorem.
    pub fn with(&self, load: &Payload) -> Option<Self> {
        let mass = self.mass_kg + load.mass_kg;
        let centre = (self.centre_frd_m * self.mass_kg + load.position_frd_m * load.mass_kg) / mass;
        let inertia = self.inertia_kgm2
            + steiner(self.mass_kg, self.centre_frd_m - centre)
            + load.inertia_kgm2
            + steiner(load.mass_kg, load.position_frd_m - centre);
        Self::new(mass, centre, inertia)
    }
}

/// m(|r|²I − rrᵀ): what a point mass at `r` adds to the inertia.
fn steiner(mass: f64, r: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_equal_masses_balance_in_the_middle() {
        let body = MassProperties::empty(1.0, Matrix3::identity() * 0.01).unwrap();
        let load =
            Payload { mass_kg: 1.0, position_frd_m: Vector3::new(0.0, 0.0, 0.2), inertia_kgm2: Matrix3::zeros() };
        let both = body.with(&load).unwrap();
        assert_eq!(both.centre_frd_m, Vector3::new(0.0, 0.0, 0.1));
        // a dumbbell of two kilograms, each .1 m from the middle, adds 2·1·.1² about x and y and nothing about z
        assert!((both.inertia_kgm2 - Matrix3::from_diagonal(&Vector3::new(0.03, 0.03, 0.01))).norm() < 1e-12);
    }

    #[test]
    fn impossible_bodies_are_refused() {
        assert!(MassProperties::empty(0.0, Matrix3::identity()).is_none());
        assert!(MassProperties::empty(1.0, -Matrix3::identity()).is_none());
    }
}
