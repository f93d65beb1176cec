use super::{Experiment, ExperimentError, Findings, Limit, Trace};
use crate::observers::zonotopic_ekf::Mode;
use crate::observers::zonotopic_ekf::paper::{HoverRun, HoverSettings, hover};

pub const EXPERIMENT: Experiment = Experiment {
    name: "wang-hover",
    paper: "Wang, Puig 2016, section VI",
    about: "A hovering quadrotor whose position alone is measured loses a rotor at 40 s; the same with the intervals that \
            hold the truth, and with the angles measured too",
    run,
};

/// A mode, whether the angles are measured too, their name, and within how many seconds the fault must show.
type Variant = (Mode, bool, &'static str, Option<f64>);

const VARIANTS: [Variant; 4] = [
    (Mode::Paper, false, "as published, position", Some(0.5)),
    (Mode::Guaranteed, false, "guaranteed, position", None),
    (Mode::Paper, true, "as published, position and angles", Some(0.15)),
    (Mode::Guaranteed, true, "guaranteed, position and angles", Some(0.15)),
];

fn run() -> Result<Findings, ExperimentError> {
    let mut f = Findings::default();
    for (mode, angles_measured, name, within_s) in VARIANTS {
        let settings = HoverSettings { mode, angles_measured, ..HoverSettings::published() };
        let found = hover(&settings);
        let held = format!("steps before the fault that held the truth, {name}");
        match mode {
            Mode::Paper => f.tell(held, 100.0 * found.coverage, "%"),
            // a running mean of ones is one but for rounding
            Mode::Guaranteed => f.judge(held, 100.0 * found.coverage, "%", Limit::AtLeast(100.0 - 1e-6)),
        }
        f.judge(format!("false alarms, {name}"), found.false_alarms as f64, "steps", Limit::AtMost(0.0));
        for (what, state, unit) in [("altitude", 6, "m"), ("roll", 0, "rad"), ("roll rate", 1, "rad/s")] {
            f.tell(format!("mean half-width of {what}, {name}"), found.half_widths[state], unit);
        }
        // a fault that is not found takes longer than any limit
        let delay_s = found.detected.map_or(f64::INFINITY, |(delay_s, _)| delay_s);
        let what = format!("rotor loss found after, {name}");
        match (within_s, found.detected) {
            (Some(most), _) => f.judge(what, delay_s, "s", Limit::AtMost(most)),
            (None, Some(_)) => f.tell(what, delay_s, "s"),
            (None, None) => f.remarks.push(format!(
                "{name}: the rotor loss does not show{}. Position alone leaves the attitude to the disturbances, so \
                 intervals that are sure to hold the truth grow until they hold anything",
                found.lost_s.map(|t| format!(", nothing is claimed from {t:.1} s on")).unwrap_or_default()
            )),
        }
        f.traces.push(trace(&found, name, settings.fault_s));
    }
    f.remarks.push(
        "vehicle, noise and disturbance are not printed; those here are rounded from the paper's source. The fault is the \
         loss of rotor 1. Columns are reduced by Girard's rule with weights: by their length alone the intervals of the \
         angles, which position shows only at its second derivative, grow without end"
            .to_owned(),
    );
    Ok(f)
}

/// The residual of the altitude (their residual 1) from two seconds before the fault.
fn trace(run: &HoverRun, name: &str, fault_s: f64) -> Trace {
    let mut trace = Trace::new(
        format!("Altitude and its residual, {name}"),
        "m",
        &["residual, lower end", "residual, upper end", "altitude, lower end", "altitude, upper end", "altitude"],
    );
    for k in run.altitude.iter().filter(|k| k.t_s > fault_s - 2.0) {
        trace.push(k.t_s, &[k.residual_m.lo(), k.residual_m.hi(), k.interval_m.lo(), k.interval_m.hi(), k.truth_m]);
    }
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_begin_before_the_fault() {
        let settings =
            HoverSettings { fault_s: 3.0, duration_s: 4.0, angles_measured: true, ..HoverSettings::published() };
        let trace = trace(&hover(&settings), "short", settings.fault_s);
        assert!(trace.t_s.first().is_some_and(|t| (1.0..1.1).contains(t)) && trace.t_s.len() > 190);
        assert!(trace.lines.iter().all(|(_, line)| line.len() == trace.t_s.len()));
    }
}
