use super::design::{Design, DesignError, Method, Options, design};
use super::plant::Plant;
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
    let jobs: Vec<(Method, f64)> = methods.iter().flat_map(|&m| alphas.iter().map(move |&a| (m, a))).collect();
    let made = in_parallel(&jobs, |&(method, alpha)| {
        let made = design(plant, method, alpha, options);
        done(method, alpha);
        made
    });
    jobs.into_iter().zip(made).map(|((m, a), d)| (m, a, d)).collect()
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
