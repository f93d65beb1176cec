use nalgebra::Matrix3;

/// What moves: a mass and its inertia about the centre of mass, body FRD.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    pub mass_kg: f64,
    pub inertia_kgm2: Matrix3<f64>,
}

/// Where the mass comes from that schedules the observer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The vehicle file: it stays.
    Nominal,
    /// The vehicle tells it.
    Message,
    /// The balance of thrust and specific force.
    Hover,
}

/// The bodies between which the vehicle changes, and where the present mass comes from. Inertia follows mass linearly,
/// as it does when parts are added or taken away at given places (Remark 1 of the paper).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    pub nominal: Body,
    /// The other end: with payload, or without.
    pub other: Body,
    pub source: Source,
}

impl Schedule {
    /// The body of this mass. Beyond the two ends the inertia stays at that of the nearer one, for which the design
    /// holds.
    pub fn body(&self, mass_kg: f64) -> Body {
        let span = self.other.mass_kg - self.nominal.mass_kg;
        let share = if span == 0.0 { 0.0 } else { ((mass_kg - self.nominal.mass_kg) / span).clamp(0.0, 1.0) };
        Body { mass_kg, inertia_kgm2: self.nominal.inertia_kgm2 * (1.0 - share) + self.other.inertia_kgm2 * share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inertia_follows_mass_between_the_ends_and_no_further() {
        let body = |mass_kg: f64, j: f64| Body { mass_kg, inertia_kgm2: Matrix3::identity() * j };
        let s = Schedule { nominal: body(2.0, 0.02), other: body(1.0, 0.01), source: Source::Nominal };
        for (mass, j) in [(2.0, 0.02), (1.5, 0.015), (1.0, 0.01), (0.5, 0.01), (3.0, 0.02)] {
            assert!((s.body(mass).inertia_kgm2[(0, 0)] - j).abs() < 1e-15, "{mass}");
            assert_eq!(s.body(mass).mass_kg, mass);
        }
        let fixed = Schedule { other: s.nominal, ..s };
        assert_eq!(fixed.body(1.0).inertia_kgm2, s.nominal.inertia_kgm2);
    }
}
