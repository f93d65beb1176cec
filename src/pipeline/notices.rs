use super::chain::Chain;
use super::fleet::Severity;
use super::snapshot::Snapshot;
use crate::signal::{Discontinuity, Measurement, Stamp, Verdict};

/// A state must hold this long before it is told, so that a link's hiccups don't chatter, s.
const SETTLE_S: f64 = 1.0;
/// Broken assumptions are told again at most this often, s.
const VIOLATION_PAUSE_S: f64 = 30.0;

/// Turns the course of one vehicle's snapshots into words, on changes only.
#[derive(Debug, Default)]
pub(super) struct Notices {
    told: Option<Verdict>,
    candidate: Option<(Verdict, Stamp)>,
    violation_told: Option<Stamp>,
}

impl Notices {
    pub fn after_step(
        &mut self,
        chain: &Chain,
        snapshot: &Snapshot<'_>,
        m: &Measurement,
        sink: &mut dyn FnMut(Severity, &str),
    ) {
        let t = snapshot.stamp;
        match m.discontinuity {
            Some(Discontinuity::Reboot) => sink(Severity::Warning, "vehicle restarted: observers start anew"),
            Some(Discontinuity::EstimatorReset) => {
                sink(Severity::Notice, "autopilot's estimate jumped: bounds reopened")
            }
            Some(Discontinuity::First | Discontinuity::Gap) | None => {}
        }
        if m.discontinuity.is_some() {
            self.candidate = None;
            self.violation_told = None;
        }
        if snapshot.verdict == Verdict::AssumptionViolated
            && self.violation_told.is_none_or(|s| t - s > VIOLATION_PAUSE_S)
        {
            self.violation_told = Some(t);
            sink(Severity::Notice, "force or torque changed faster than declared: bounds reopened");
        }
        // a broken assumption passes; it is no state to announce
        let state = match snapshot.verdict {
            Verdict::AssumptionViolated | Verdict::Settling | Verdict::Consistent => Verdict::Consistent,
            other => other,
        };
        if self.told == Some(state) {
            self.candidate = None;
            return;
        }
        match self.candidate {
            Some((s, since)) if s == state => {
                if t - since >= SETTLE_S {
                    self.tell(chain, state, sink);
                }
            }
            _ => self.candidate = Some((state, t)),
        }
    }

    fn tell(&mut self, chain: &Chain, state: Verdict, sink: &mut dyn FnMut(Severity, &str)) {
        self.told = Some(state);
        self.candidate = None;
        match state {
            Verdict::Starved => {
                for slot in chain.slots() {
                    let r = slot.registration;
                    let missing: Vec<String> = chain.missing(r.needs).map(|c| c.to_string()).collect();
                    let what =
                        if missing.is_empty() { "samples at 2 Hz or more".to_owned() } else { missing.join(", ") };
                    sink(Severity::Warning, &format!("{} is starved of {what}", r.name));
                }
            }
            Verdict::Grounded => sink(Severity::Info, "on the ground: estimates pause"),
            Verdict::Consistent | Verdict::Settling | Verdict::AssumptionViolated => {
                sink(Severity::Info, "estimating wrench and wind");
            }
        }
    }
}
