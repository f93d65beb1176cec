use super::{Experiment, ExperimentError, Findings, Limit, Trace};
use crate::observers::fuzzy_polynomial::rig::Experiment as Rig;
use crate::observers::fuzzy_polynomial::{
    Design, Method, Options, Plant, Record, design, estimates, integral_square_error,
};

const NAME: &str = "pitarch-rig";

pub const EXPERIMENT: Experiment = Experiment {
    name: NAME,
    paper: "Pitarch, Sala 2014, section 5.2",
    about: "The Quanser rig with noise and a chirp on its encoders: integral square error (ISE) of the speeds by three \
            designs of decay rate 18 1/s, as printed and with fast manoeuvres",
    run,
};

/// The decay rate that the paper chose, 1/s.
const ALPHA: f64 = 18.0;
const METHODS: [Method; 3] = [Method::LinearAnalysis, Method::OneGainAnalysis, Method::SumsOfSquares];
/// Runs with noise of their own.
const SEEDS: u64 = 8;
/// The observers start at rest; what they need to catch up is not scored, s.
const FROM_S: f64 = 2.0;
/// What the paper reports of ISE(SOS-2G) over ISE(LM-A).
const PUBLISHED_TO_LINEAR: f64 = 0.875;

/// ISE of each method, the mean of all runs, rad²/s.
fn errors(plant: &Plant, designs: &[Design], rig: &Rig) -> Vec<f64> {
    let mut sums = vec![0.0; designs.len()];
    for seed in 1..=SEEDS {
        let record = Rig { seed, ..*rig }.record(plant);
        for (sum, design) in sums.iter_mut().zip(designs) {
            *sum += integral_square_error(&estimates(plant, design, &record), &record, FROM_S) / SEEDS as f64;
        }
    }
    sums
}

fn run() -> Result<Findings, ExperimentError> {
    let plant = Plant::quanser();
    let designs: Vec<Design> = METHODS
        .iter()
        .map(|m| design(&plant, *m, ALPHA, Options::default()).map_err(ExperimentError::in_part(NAME, m.name())))
        .collect::<Result<_, _>>()?;
    let mut f = Findings::default();
    for (name, rig) in [("as printed", Rig::printed()), ("fast", Rig::fast())] {
        let ise = errors(&plant, &designs, &rig);
        for (method, ise) in METHODS.iter().zip(&ise) {
            f.tell(format!("ISE of {}, {name}", method.name()), *ise, "rad²/s");
        }
        let [linear, takagi_sugeno, sos] = ise[..] else { continue };
        let to_linear = format!("ISE of SOS-2G over LM-A, {name}");
        if name == "fast" {
            f.judge(to_linear, sos / linear, "", Limit::AtMost(0.9));
        } else {
            f.tell(format!("{to_linear} (paper {PUBLISHED_TO_LINEAR})"), sos / linear, "");
        }
        f.judge(format!("ISE of SOS-2G over TS-1GA, {name}"), sos / takagi_sugeno, "", Limit::AtMost(0.5));
    }
    for axis in [0, 2] {
        f.traces.push(trace(&plant, &designs, &Rig::fast().record(&plant), axis));
    }
    f.remarks.push(
        "in the slow experiment, as printed, there is little to follow: noise and chirp make the error, and the gain that \
         lets the least of them through wins. That is LM-A's, so the paper's 12.5 % in favour of SOS-2G do not show \
         there; they do once the axes couple"
            .to_owned(),
    );
    Ok(f)
}

/// One axis for ten seconds.
fn trace(plant: &Plant, designs: &[Design], record: &Record, axis: usize) -> Trace {
    let names: Vec<&str> = std::iter::once("true").chain(METHODS.iter().map(|m| m.name())).collect();
    let title = format!("Speed in {}, fast manoeuvres", ["roll", "pitch", "yaw"][axis]);
    let mut trace = Trace::new(title, "rad/s", &names);
    let found: Vec<Vec<[f64; 3]>> = designs.iter().map(|d| estimates(plant, d, record)).collect();
    let window = (20.0 / record.dt_s) as usize..(30.0 / record.dt_s) as usize;
    for k in window.filter(|k| *k < record.speeds.len()) {
        let values: Vec<f64> =
            std::iter::once(record.speeds[k][axis]).chain(found.iter().map(|speeds| speeds[k][axis])).collect();
        trace.push(k as f64 * record.dt_s, &values);
    }
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise alone decides how much of it each gain lets through: the run is the same for the same seed.
    #[test]
    fn runs_repeat_themselves_and_seeds_differ() {
        let plant = Plant::quanser();
        let short = Rig { duration_s: 2.0, ..Rig::fast() };
        assert_eq!(short.record(&plant), short.record(&plant));
        assert_ne!(short.record(&plant).angles, Rig { seed: 2, ..short }.record(&plant).angles);
    }
}
