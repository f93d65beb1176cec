use crate::vehicle::air_density_kgm3;

/// Static pressure of the standard atmosphere at a height above mean sea level (m, below 11 km), Pa.
pub fn pressure_pa(altitude_m: f64) -> f64 {
    101_325.0 * (1.0 - 2.255_769_6e-5 * altitude_m).max(0.0).powf(5.255_88)
}

/// Air density of the standard atmosphere, linear about a reference height: over a flight's hundred metres the error
/// is below 0.01 %, and the physics asks for it four times a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct DensityProfile {
    at_home_kgm3: f64,
    per_metre: f64,
}

impl DensityProfile {
    pub fn around(home_altitude_m: f64) -> Self {
        let at = |h: f64| air_density_kgm3(pressure_pa(h));
        Self {
            at_home_kgm3: at(home_altitude_m),
            per_metre: (at(home_altitude_m + 100.0) - at(home_altitude_m - 100.0)) / 200.0,
        }
    }

    /// Density at `height_m` above home, kg/m³.
    pub fn at(&self, height_m: f64) -> f64 {
        (self.at_home_kgm3 + self.per_metre * height_m).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_atmosphere_at_1000_m() {
        assert!((pressure_pa(0.0) - 101_325.0).abs() < 1e-9);
        assert!((pressure_pa(1000.0) - 89_874.0).abs() < 5.0);
    }

    #[test]
    fn the_linear_profile_follows_the_atmosphere() {
        let profile = DensityProfile::around(584.0);
        for h in [0.0, 25.0, 120.0] {
            let exact = air_density_kgm3(pressure_pa(584.0 + h));
            assert!((profile.at(h) / exact - 1.0).abs() < 1e-4, "{h} m");
        }
    }
}
