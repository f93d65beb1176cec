use super::{Experiment, ExperimentError, Findings, Limit, Trace};
use crate::observers::quadratic_bounded::paper::hummingbird;
use crate::observers::quadratic_bounded::{ContinuousDesign, Plant, choose_rates, design_continuous};
use crate::sim::profile::Profile;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const NAME: &str = "cayero-disturbance";

pub const EXPERIMENT: Experiment = Experiment {
    name: NAME,
    paper: "Cayero, Rotondo, Morcego, Puig 2019, Figs. 3 and 7",
    about: "A force of 2 N along north as steps, triangle and parabola, found by the designs for μ = 0.2 and 0.95",
    run,
};

const END_S: f64 = 50.0;
const STEP_S: f64 = 0.01;
const PEAK_N: f64 = 2.0;
/// Fastest rate considered, 1/s.
const FASTEST: f64 = 20.0;
/// Where the disturbance or one of its derivatives jumps, s: there the third derivative leaves Q₁.
const BREAKS_S: [f64; 11] = [5.0, 7.5, 10.0, 12.5, 15.0, 20.0, 22.5, 27.5, 30.0, 35.0, 45.0];
/// Declared largest jumps of d, ḋ, d̈ (N, N/s, N/s²), with room over those of the profile.
const JUMPS: [f64; 3] = [4.2, 2.0, 0.4];
/// Order of the disturbance model, and the place of the north force and its derivatives in the state.
const R: usize = 3;
const NORTH: [usize; R] = [6, 12, 18];

/// d, ḋ, d̈ on one side of an instant: three samples fix the parabola.
fn jet(profile: &Profile, t_s: f64, side: f64) -> [f64; R] {
    let h = side * 1e-3;
    let [a, b, c] = [1.0, 2.0, 3.0].map(|k| profile.at(t_s + k * h).x);
    let second = (a - 2.0 * b + c) / (h * h);
    // forward differences at the middle sample, carried back to t
    let slope = (c - a) / (2.0 * h) - second * 2.0 * h;
    [b - slope * 2.0 * h - second * 2.0 * h * h, slope, second]
}

/// The error of the paper's continuous observer, by the exact solution of (4) under errors that are constant over each
/// step; its level V = eᵀPe and the promise about it.
struct Course {
    t_s: Vec<f64>,
    truth_n: Vec<f64>,
    error_n: Vec<f64>,
    level: Vec<f64>,
    promise: Vec<f64>,
}

fn fly(plant: &Plant, design: &ContinuousDesign, noisy: bool) -> Option<Course> {
    let (n, outputs) = (plant.a.nrows(), plant.c.nrows());
    let profile = Profile::paper(Vector3::x() * PEAK_N);
    // exp([A+LC, LW₂; 0, 0]·Δ) = [e^{(A+LC)Δ}, ∫e^{(A+LC)s}ds·LW₂; 0, I]
    let mut joint = DMatrix::zeros(n + outputs, n + outputs);
    joint.view_mut((0, 0), (n, n)).copy_from(&(&plant.a + &design.gain * &plant.c));
    joint.view_mut((0, n), (n, outputs)).copy_from(&(&design.gain * &plant.w2));
    let joint = (joint * STEP_S).exp();
    let (flow, push) = (joint.view((0, 0), (n, n)).into_owned(), joint.view((0, n), (n, outputs)).into_owned());
    // between the breaks η₁ is nothing, so η₂ has the whole of Q = ½·blkdiag(Q₁, Q₂)
    let whiten = (&plant.q2 * 0.5).cholesky()?.l().transpose();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let p = &design.p;
    let jump_level: f64 = (0..R)
        .flat_map(|i| (0..R).map(move |j| (i, j)))
        .map(|(i, j)| p[(NORTH[i], NORTH[j])].abs() * JUMPS[i] * JUMPS[j])
        .sum();
    let mut course =
        Course { t_s: Vec::new(), truth_n: Vec::new(), error_n: Vec::new(), level: Vec::new(), promise: Vec::new() };
    let (mut e, mut promise) = (DVector::zeros(n), 1.0_f64);
    for k in 0..(END_S / STEP_S) as usize {
        let t = k as f64 * STEP_S;
        if BREAKS_S.iter().any(|b| (b - t).abs() < 0.5 * STEP_S) {
            let (before, after) = (jet(&profile, t, -1.0), jet(&profile, t, 1.0));
            for (at, (a, b)) in NORTH.iter().zip(after.iter().zip(&before)) {
                e[*at] += a - b;
            }
            // reopened: the old error and a jump within the declared sizes
            promise = (promise.sqrt() + jump_level.sqrt()).powi(2);
        }
        course.t_s.push(t);
        course.truth_n.push(jet(&profile, t, 1.0)[0]);
        course.error_n.push(e[NORTH[0]]);
        course.level.push((e.transpose() * p * &e)[(0, 0)]);
        course.promise.push(promise);
        e = &flow * e;
        if noisy {
            let direction = DVector::from_fn(outputs, |_, _| rng.sample::<f64, _>(StandardNormal));
            let radius = rng.random::<f64>().powf(1.0 / outputs as f64) / direction.norm();
            e += &push * whiten.solve_upper_triangular(&(direction * radius))?;
        }
        // (18)
        promise = 1.0 + (promise - 1.0) * (-design.alpha * STEP_S).exp();
    }
    Some(course)
}

/// Time after the step of 2 N at 5 s until the error stays below a tenth of it, without noise, s.
fn settling_s(course: &Course) -> f64 {
    let span = course.t_s.iter().zip(&course.error_n).filter(|(t, _)| (5.0..7.49).contains(*t));
    span.filter(|(_, e)| e.abs() > 0.1 * PEAK_N).map(|(t, _)| t - 5.0 + STEP_S).fold(0.0, f64::max)
}

/// Share of the steps that a test holds for, %.
fn percent(course: &Course, test: impl Fn(usize) -> bool) -> f64 {
    100.0 * (0..course.t_s.len()).filter(|&k| test(k)).count() as f64 / course.t_s.len() as f64
}

fn run() -> Result<Findings, ExperimentError> {
    let plant = hummingbird(R);
    let mus = [0.95, 0.2];
    let (_, rates) = choose_rates(&plant, FASTEST, &mus).map_err(ExperimentError::in_part(NAME, "choice of α"))?;
    let mut f = Findings::default();
    let mut seen = Vec::new();
    for (mu, alpha) in mus.into_iter().zip(rates) {
        let part = format!("design for μ = {mu}");
        let design = design_continuous(&plant, alpha).map_err(ExperimentError::in_part(NAME, part.clone()))?;
        let flown = |noisy| {
            let none = std::io::Error::other("Q₂ is not positive definite");
            fly(&plant, &design, noisy).ok_or(none).map_err(ExperimentError::in_part(NAME, part.clone()))
        };
        let (clean, course) = (flown(false)?, flown(true)?);
        let rmse = {
            // two seconds after the last break everything has settled in either design
            let quiet = course
                .t_s
                .iter()
                .zip(&course.error_n)
                .filter(|(t, _)| BREAKS_S.iter().all(|b| !(*b..*b + 2.0).contains(*t)));
            let squares: Vec<f64> = quiet.map(|(_, e)| e * e).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let half_width = design.half_widths[0];
        f.tell(format!("μ = {mu}: α"), alpha, "1/s");
        f.tell(format!("μ = {mu}: half-width of the north force"), half_width, "N");
        f.tell(format!("μ = {mu}: a 2 N step found to a tenth after"), settling_s(&clean), "s");
        f.tell(format!("μ = {mu}: RMSE from 2 s after each break"), rmse, "N");
        f.tell(format!("μ = {mu}: largest V without reopening"), course.level.iter().copied().fold(0.0, f64::max), "");
        let as_published = percent(&course, |k| course.level[k] <= 1.0);
        f.tell(format!("μ = {mu}: steps inside the paper's ellipsoid, breaks or not"), as_published, "%");
        let before_any = |k: usize| course.t_s[k] >= BREAKS_S[0] || course.level[k] <= 1.0;
        let quiet = percent(&course, before_any);
        f.judge(format!("μ = {mu}: inside while η stays in Q"), quiet, "%", Limit::AtLeast(100.0));
        let reopened = percent(&course, |k| course.level[k] <= course.promise[k] * (1.0 + 1e-9));
        f.judge(
            format!("μ = {mu}: inside with the bound reopened at the breaks"),
            reopened,
            "%",
            Limit::AtLeast(100.0),
        );
        let mut trace = Trace::new(format!("North force, μ = {mu}"), "N", &["force", "found", "lower", "upper"]);
        for k in (0..course.t_s.len()).step_by(5) {
            let (d, found) = (course.truth_n[k], course.truth_n[k] - course.error_n[k]);
            let reach = course.promise[k].sqrt() * half_width;
            trace.push(course.t_s[k], &[d, found, found - reach, found + reach]);
        }
        f.traces.push(trace);
        seen.push((settling_s(&clean), half_width, rmse));
    }
    if let [(slow, tight, calm), (quick, wide, loud)] = seen[..] {
        f.judge("μ = 0.95 takes longer by", slow / quick, "×", Limit::AtLeast(1.0));
        f.judge("μ = 0.95 has a half-width of", tight / wide, "×", Limit::AtMost(1.0));
        f.judge("μ = 0.95 has a quiet error of", calm / loud, "×", Limit::AtMost(1.0));
    }
    f.remarks.push(
        "at each break the force or a derivative jumps, which no bound on the third derivative admits; the paper's own \
         ellipsoid is left there, and the reopened one is not"
            .to_owned(),
    );
    Ok(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jets_of_the_profile_are_exact() {
        let profile = Profile::paper(Vector3::x() * PEAK_N);
        let close = |a: [f64; R], b: [f64; R]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close(jet(&profile, 5.0, 1.0), [2.0, 0.0, 0.0]) && close(jet(&profile, 5.0, -1.0), [0.0; R]));
        assert!(close(jet(&profile, 22.5, 1.0), [2.0, -0.8, 0.0]), "{:?}", jet(&profile, 22.5, 1.0));
        assert!(close(jet(&profile, 35.0, 1.0), [0.0, 0.8, -0.16]), "{:?}", jet(&profile, 35.0, 1.0));
    }

    #[test]
    fn the_larger_weight_on_the_volume_is_slower_and_tighter() {
        let findings = run().unwrap();
        assert_eq!(findings.missed().count(), 0, "{:#?}", findings.figures);
    }
}
