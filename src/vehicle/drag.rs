use super::Drag;
use crate::sets::Interval;

/// Air density in the standard atmosphere at a static pressure (Pa), kg/m³.
///
/// The sensor's temperature is that of a warm circuit board, so the standard atmosphere's is used: of the barometric
/// formula p = p₀(T/T₀)^5.2559, ρ = ρ₀(T/T₀)^4.2559 follows ρ = ρ₀(p/p₀)^0.80974.
pub fn air_density_kgm3(pressure_pa: f64) -> f64 {
    1.225 * (pressure_pa / 101_325.0).max(0.0).powf(4.2559 / 5.2559)
}

/// Air density when the vehicle sends no pressure, kg/m³: sea level, standard atmosphere.
pub const SEA_LEVEL_KGM3: f64 = 1.225;

impl Drag {
    /// Drag force (N) on body axis `i` at velocity `v` through the air (m/s), with `sum_sqrt_thrust` = Σ√Tᵢ (√N).
    pub fn force(&self, i: usize, v: f64, sum_sqrt_thrust: f64, density: f64) -> f64 {
        let linear = self.linear[i].nominal + self.rotor[i].nominal * sum_sqrt_thrust;
        -linear * v - 0.5 * density * self.area_m2[i].nominal * v * v.abs()
    }

    /// Velocity through the air (m/s) at which axis `i` feels `force` (N): the inverse of [`Self::force`]. `None`
    /// where the axis has no drag.
    ///
    /// `backward` (N per m²/s²) adds to the quadratic coefficient where the velocity is negative: on body z, the thrust
    /// that rotors lose to the air that flows in as they climb acts like drag of that direction only.
    pub fn airspeed(&self, i: usize, force: f64, sum_sqrt_thrust: f64, density: f64, backward: f64) -> Option<f64> {
        let linear = self.linear[i].nominal + self.rotor[i].nominal * sum_sqrt_thrust;
        let quadratic = 0.5 * density * self.area_m2[i].nominal;
        solve(force, linear, quadratic + if force > 0.0 { backward } else { 0.0 })
    }

    /// The interval of velocities through the air that fit a force, for every drag coefficient and density in its
    /// declared range. The law is monotone, falling in `v` and, for given force, shrinking in both coefficients: so
    /// the interval's ends are found at ends of the ranges.
    pub fn airspeed_interval(
        &self,
        i: usize,
        force: Interval,
        sum_sqrt_thrust: Interval,
        density: Interval,
        backward: Interval,
    ) -> Option<Interval> {
        let linear = self.linear[i].range + self.rotor[i].range * sum_sqrt_thrust;
        let quadratic = self.area_m2[i].range * density * 0.5;
        // v falls with force; for v > 0 (force < 0) weak drag gives the larger |v|
        let end = |f: f64, widen: bool| {
            let q = if f > 0.0 { quadratic + backward } else { quadratic };
            if widen { solve(f, linear.lo().max(0.0), q.lo().max(0.0)) } else { solve(f, linear.hi(), q.hi()) }
        };
        let hi = end(force.lo(), force.lo() < 0.0)?;
        let lo = end(force.hi(), force.hi() > 0.0)?;
        // the root's relative rounding error is a few ulp; 1e-12 covers it
        let slack = 1e-12 * (1.0 + lo.abs().max(hi.abs()));
        Some(Interval::new(lo - slack, hi + slack))
    }
}

/// v with −a·v − b·v|v| = force, for a, b ≥ 0.
fn solve(force: f64, a: f64, b: f64) -> Option<f64> {
    let f = force.abs();
    // 2f/(a + √(a² + 4bf)) is the positive root without cancellation, and f/a when b = 0
    let denominator = a + (a * a + 4.0 * b * f).sqrt();
    if f == 0.0 && a + b > 0.0 {
        return Some(0.0);
    }
    (denominator > 0.0).then(|| -force.signum() * 2.0 * f / denominator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::Ranged;
    use proptest::prelude::*;

    fn drag(linear: f64, rotor: f64, area: f64) -> Drag {
        Drag {
            linear: [Ranged::relative(linear, 0.1); 3],
            rotor: [Ranged::relative(rotor, 0.1); 3],
            area_m2: [Ranged::relative(area, 0.1); 3],
            angular: [0.0; 3],
        }
    }

    proptest! {
        #[test]
        fn airspeed_inverts_force(v in -30.0..30.0_f64, a in 0.0..2.0_f64, k in 0.001..0.2_f64, cda in 0.0..0.5_f64) {
            let d = drag(a, k, cda);
            let f = d.force(0, v, 10.0, 1.2);
            prop_assert!((d.airspeed(0, f, 10.0, 1.2, 0.0).unwrap() - v).abs() < 1e-9 * (1.0 + v.abs()));
        }

        #[test]
        fn every_admissible_vehicle_lies_in_the_interval(
            v in -30.0..30.0_f64, a in 0.0..2.0_f64, k in 0.001..0.2_f64, cda in 0.0..0.5_f64,
            back in 0.0..0.1_f64, s in prop::array::uniform6(-1.0..=1.0_f64),
        ) {
            let d = drag(a, k, cda);
            let linear = a * (1.0 + 0.1 * s[0]) + k * (1.0 + 0.1 * s[1]) * (10.0 + 0.5 * s[2]);
            let backward = if v < 0.0 { back * (1.0 + 0.1 * s[5]) } else { 0.0 };
            let quadratic = 0.5 * (1.2 + 0.05 * s[3]) * cda * (1.0 + 0.1 * s[4]) + backward;
            let f = Interval::centred(-linear * v - quadratic * v * v.abs(), 0.1);
            let (sum, density) = (Interval::centred(10.0, 0.5), Interval::centred(1.2, 0.05));
            let i = d.airspeed_interval(0, f, sum, density, Interval::centred(back, 0.1 * back)).unwrap();
            prop_assert!(i.contains(v), "{v} not in {i:?}");
        }
    }

    #[test]
    fn an_axis_without_drag_has_no_inverse() {
        let d = drag(0.0, 0.0, 0.0);
        assert_eq!(d.airspeed(0, 1.0, 10.0, 1.2, 0.0), None);
    }

    #[test]
    fn standard_atmosphere() {
        assert!((air_density_kgm3(101_325.0) - 1.225).abs() < 1e-12);
        // 1000 m: 89 874 Pa, 1.1116 kg/m³ (ICAO standard atmosphere)
        assert!((air_density_kgm3(89_874.0) - 1.1116).abs() < 2e-4);
    }
}
