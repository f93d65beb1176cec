/// Less specific force than this along the thrust axis says too little about mass, m/s².
const LEAST_MPS2: f64 = 3.0;

/// Mass from thrust and the specific force along the thrust axis: f = m·a, in the sense of least squares over the last
/// while. It needs no hover and no attitude: gravity acts on the accelerometer no more than on a falling stone.
///
/// Air drag along that axis and the error of the thrust model go into it as they are: 2 % of thrust are 2 % of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassBalance {
    time_constant_s: f64,
    /// Low-passed f·a and a², over the same weight.
    product: f64,
    square: f64,
    /// Weight that the past has by now; 1 when it has settled.
    weight: f64,
}

impl MassBalance {
    pub fn new(time_constant_s: f64) -> Self {
        Self { time_constant_s, product: 0.0, square: 0.0, weight: 0.0 }
    }

    /// Takes in the force of the rotors and the specific force along one body axis, N and m/s², over `dt_s`.
    pub fn step(&mut self, force_n: f64, specific_mps2: f64, dt_s: f64) {
        if specific_mps2.abs() < LEAST_MPS2 {
            return;
        }
        let keep = (-dt_s / self.time_constant_s).exp();
        let fresh = 1.0 - keep;
        self.product = keep * self.product + fresh * force_n * specific_mps2;
        self.square = keep * self.square + fresh * specific_mps2 * specific_mps2;
        self.weight = keep * self.weight + fresh;
    }

    /// kg; `None` before two time constants of flight.
    pub fn mass_kg(&self) -> Option<f64> {
        (self.weight > 0.85).then(|| self.product / self.square).filter(|m| m.is_finite() && *m > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_payload_is_found_while_the_vehicle_climbs_away() {
        let mut balance = MassBalance::new(0.5);
        for k in 0..400 {
            // the thrust of the heavy vehicle for another two seconds
            let (mass, thrust) = if k < 200 { (2.5, 2.5 * 9.81) } else { (2.0, 2.5 * 9.81) };
            balance.step(-thrust, -thrust / mass, 0.01);
            if k == 50 {
                assert_eq!(balance.mass_kg(), None);
            }
            if k == 199 {
                assert!((balance.mass_kg().unwrap() - 2.5).abs() < 1e-9);
            }
        }
        assert!((balance.mass_kg().unwrap() - 2.0).abs() < 0.02);
        let before = balance;
        balance.step(-1.0, -0.5, 0.01);
        assert_eq!(balance, before, "free fall says nothing");
    }
}
