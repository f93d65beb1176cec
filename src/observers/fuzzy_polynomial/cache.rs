//! SOS-2G designs in the cache of gains: the gains, P, γ and the certificates that prove them.

use super::design::{Design, DesignError, Options};
use super::plant::Plant;
use super::polynomial::{self, Numbers};
use crate::observers::cache::{Cache, Rows};
use crate::sos::{Blocks, Certificate, Monomial};
use serde::{Deserialize, Serialize};

impl Cache {
    /// An SOS-2G design, from the cache or made and then kept.
    ///
    /// # Errors
    /// Those of [`design`](super::design()).
    pub fn sums_of_squares(&self, plant: &Plant, alpha: f64, options: Options) -> Result<Design, DesignError> {
        plant.check()?;
        let inputs = Inputs { plant: plant.clone(), alpha, polynomial_gains: options.polynomial_gains };
        self.fetch(
            "sos",
            &inputs,
            |record: &Record| {
                let numbers = record.numbers().ok_or("its numbers do not fit the plant")?;
                polynomial::prove(plant, alpha, options, &numbers).map_err(|e| e.to_string())
            },
            || polynomial::design(plant, alpha, options).map(|made| (Record::of(&made.numbers), made.design)),
        )
    }
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Inputs {
    plant: Plant,
    alpha: f64,
    polynomial_gains: bool,
}

/// A Gram matrix with its basis, monomials as (variable, power).
type BlockRecord = (Vec<Vec<(usize, u32)>>, Rows);

#[derive(Debug, Serialize, Deserialize)]
struct CertificateRecord {
    rest: Vec<BlockRecord>,
    multipliers: Vec<Vec<BlockRecord>>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Record {
    gain: Rows,
    by_speed: Vec<Rows>,
    gamma: f64,
    speed_factor: f64,
    p: Rows,
    certificates: Vec<CertificateRecord>,
}

impl Record {
    fn of(numbers: &Numbers) -> Self {
        let blocks = |b: &Blocks| -> Vec<BlockRecord> {
            b.iter().map(|(m, g)| (m.iter().map(|m| m.factors().to_vec()).collect(), Rows::of(g))).collect()
        };
        let certificate = |c: &Certificate| CertificateRecord {
            rest: blocks(&c.rest),
            multipliers: c.multipliers.iter().map(blocks).collect(),
        };
        Self {
            gain: Rows::of(&numbers.constant),
            by_speed: numbers.by_speed.iter().map(Rows::of).collect(),
            gamma: numbers.gamma,
            speed_factor: numbers.speed_factor,
            p: Rows::of(&numbers.p),
            certificates: numbers.certificates.iter().map(certificate).collect(),
        }
    }

    fn numbers(&self) -> Option<Numbers> {
        let blocks = |b: &Vec<BlockRecord>| -> Option<Blocks> {
            b.iter()
                .map(|(m, g)| {
                    let basis: Vec<Monomial> = m.iter().map(|f| Monomial::of(f)).collect();
                    let g = g.matrix(basis.len(), basis.len())?;
                    // a matrix that is not symmetric is read as its symmetric part by some, by others not
                    (g == g.transpose()).then_some((basis, g))
                })
                .collect()
        };
        let certificate = |c: &CertificateRecord| {
            let multipliers = c.multipliers.iter().map(blocks).collect::<Option<_>>()?;
            Some(Certificate { rest: blocks(&c.rest)?, multipliers })
        };
        let positive = |x: f64| x > 0.0 && x.is_finite();
        if !positive(self.gamma) || !positive(self.speed_factor) || self.by_speed.len() > 3 {
            return None;
        }
        Some(Numbers {
            constant: self.gain.matrix(6, 3)?,
            by_speed: self.by_speed.iter().map(|l| l.matrix(6, 3)).collect::<Option<_>>()?,
            gamma: self.gamma,
            speed_factor: self.speed_factor,
            p: self.p.matrix(6, 6)?,
            certificates: self.certificates.iter().map(certificate).collect::<Option<_>>()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_design_is_proven_anew_and_a_doctored_one_redone() {
        let home = tempfile::tempdir().unwrap();
        let cache = Cache::Directory(home.path().to_owned());
        let fetch = || cache.sums_of_squares(&Plant::quanser(), 14.0, Options::default()).unwrap();
        let (made, kept) = (fetch(), fetch());
        assert!(made.solve_s > 0.0 && kept.solve_s == 0.0);
        assert_eq!(Design { solve_s: made.solve_s, ..kept }, made);
        // a better bound than the certificate proves
        let file = std::fs::read_dir(home.path()).unwrap().next().unwrap().unwrap().path();
        let mut value: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        value["numbers"]["gamma"] = serde_json::json!(0.9 * made.gain_bound.powi(2));
        std::fs::write(&file, value.to_string()).unwrap();
        assert!(fetch().solve_s > 0.0);
    }
}
