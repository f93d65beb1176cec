use super::design::{Design, DesignError, Method, Options, design};
use super::plant::Plant;
use super::polynomial::analyse;
use crate::sdp::in_parallel;

/// Every strategy at every decay rate (step I of the paper's methodology), strategy by strategy, on all cores.
///
/// `done` hears of each design as it is made.
pub fn front(
    plant: &Plant,
    methods: &[Method],
    alphas: &[f64],
    options: Options,
    done: impl Fn(Method, f64) + Sync,
) -> Vec<(Method, f64, Result<Design, DesignError>)> {
    // an analysis is made with the design whose gains it takes: that is solved once
    let mut jobs: Vec<(Method, f64)> = Vec::new();
    for &alpha in alphas {
        for method in methods {
            if !jobs.contains(&(method.designed_by(), alpha)) {
                jobs.push((method.designed_by(), alpha));
            }
        }
    }
    let made = in_parallel(&jobs, |&(by, alpha)| {
        let first = design(plant, by, alpha, options);
        let judged = |method| match &first {
            Ok(first) if method != by => analyse(plant, method, first),
            other => other.clone(),
        };
        let of_it = methods.iter().filter(|m| m.designed_by() == by);
        of_it
            .map(|&method| {
                let made = judged(method);
                done(method, alpha);
                (method, alpha, made)
            })
            .collect::<Vec<_>>()
    });
    let mut made: Vec<_> = made.into_iter().flatten().collect();
    let place = |method: Method| methods.iter().position(|m| *m == method);
    made.sort_by_key(|m| place(m.0));
    made
}

/// The designs that no other beats in both decay rate and gain bound, by rising rate. Only what is judged on the same
/// model may be compared.
pub fn pareto(designs: &[Design]) -> Vec<&Design> {
    let beaten = |d: &Design| {
        designs.iter().any(|o| {
            o.alpha >= d.alpha && o.gain_bound <= d.gain_bound && (o.alpha > d.alpha || o.gain_bound < d.gain_bound)
        })
    };
    let mut best: Vec<&Design> = designs.iter().filter(|d| !beaten(d)).collect();
    best.sort_by(|a, b| a.alpha.total_cmp(&b.alpha));
    best
}
