use super::chain::Chain;
use super::fleet::Severity;
use super::slot::Slot;
use super::snapshot::{FaultDetail, FaultMask, Snapshot};
use crate::signal::{Discontinuity, Guarantee, Measurement, Stamp, Verdict};

/// A state must hold this long before it is told, so that a link's hiccups don't chatter, s.
const SETTLE_S: f64 = 1.0;
/// One observer that is starved while others answer is told after this time, s: its channel may be slow to come.
const STARVED_S: f64 = 5.0;
/// Broken assumptions of one observer are told again at most this often, s.
const VIOLATION_PAUSE_S: f64 = 30.0;

/// Turns the course of one vehicle's snapshots into words, on changes only.
#[derive(Debug, Default)]
pub(super) struct Notices {
    told: Option<Verdict>,
    candidate: Option<(Verdict, Stamp)>,
    /// One for each observer.
    each: Vec<Told>,
    faults: FaultMask,
    candidates: FaultMask,
    newest: Option<FaultDetail>,
}

/// What was told of one observer.
#[derive(Debug, Default, Clone, Copy)]
struct Told {
    starved: bool,
    /// Since when it is otherwise than told.
    since: Option<Stamp>,
    violation: Option<Stamp>,
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
        self.each.resize(chain.slots().len(), Told::default());
        if m.discontinuity.is_some() {
            self.candidate = None;
            for told in &mut self.each {
                *told = Told { starved: told.starved, ..Told::default() };
            }
        }
        for (slot, told) in chain.slots().iter().zip(&mut self.each) {
            told.violated(slot, t, sink);
            if self.told == Some(Verdict::Consistent) {
                told.starved(chain, slot, t, sink);
            }
        }
        self.faults(chain, snapshot, sink);
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

    /// Each fault when it appears, when it happens again while it lasts (a load put down), and when it clears.
    fn faults(&mut self, chain: &Chain, snapshot: &Snapshot<'_>, sink: &mut dyn FnMut(Severity, &str)) {
        let (now, newest) = (snapshot.faults, snapshot.newest_fault);
        let before = std::mem::replace(&mut self.faults, now);
        let earlier = std::mem::replace(&mut self.newest, newest);
        let mut risen = now.0 & !before.0;
        if let (Some(n), Some(e)) = (newest, earlier)
            && n.mask == e.mask
            && n.onset > e.onset
        {
            risen |= n.mask.0 & now.0;
        }
        for fault in chain.faults().active().filter(|a| risen & a.fault.bit() != 0 && a.or == 0) {
            for name in FaultMask(fault.fault.bit()).names() {
                let sure = if fault.guarantee == Guarantee::Guaranteed { ", guaranteed" } else { "" };
                sink(Severity::Warning, &format!("fault: {name} ({:.2}){sure}", fault.magnitude));
            }
        }
        for name in FaultMask(before.0 & !now.0).names() {
            sink(Severity::Notice, &format!("fault cleared: {name}"));
        }
        let before = std::mem::replace(&mut self.candidates, snapshot.fault_candidates);
        if before != self.candidates && self.candidates.0 != 0 {
            sink(Severity::Warning, &format!("fault: {}", self.candidates.one_of()));
        }
    }

    fn tell(&mut self, chain: &Chain, state: Verdict, sink: &mut dyn FnMut(Severity, &str)) {
        self.told = Some(state);
        self.candidate = None;
        match state {
            Verdict::Starved => {
                for (slot, told) in chain.slots().iter().zip(&mut self.each) {
                    told.starved = true;
                    sink(Severity::Warning, &starved(chain, slot));
                }
            }
            Verdict::Grounded => sink(Severity::Info, "on the ground: estimates pause"),
            Verdict::Consistent | Verdict::Settling | Verdict::AssumptionViolated => {
                // what starved with all others is told again if it stays so
                self.each.iter_mut().for_each(|told| told.starved = false);
                sink(Severity::Info, "estimating wrench and wind");
            }
        }
    }
}

impl Told {
    fn violated(&mut self, slot: &Slot, t: Stamp, sink: &mut dyn FnMut(Severity, &str)) {
        let violated = slot.observer.estimate().verdict == Verdict::AssumptionViolated;
        if violated && self.violation.is_none_or(|s| t - s > VIOLATION_PAUSE_S) {
            self.violation = Some(t);
            let text = format!("{}: data contradict what is declared, bounds reopened", slot.registration.name);
            sink(Severity::Notice, &text);
        }
    }

    /// Tells when this observer alone begins or ends to be starved.
    fn starved(&mut self, chain: &Chain, slot: &Slot, t: Stamp, sink: &mut dyn FnMut(Severity, &str)) {
        let starves = slot.observer.estimate().verdict == Verdict::Starved;
        if starves == self.starved {
            self.since = None;
            return;
        }
        if t - *self.since.get_or_insert(t) < STARVED_S {
            return;
        }
        (self.starved, self.since) = (starves, None);
        if starves {
            sink(Severity::Warning, &starved(chain, slot));
        } else {
            sink(Severity::Info, &format!("{} estimates again", slot.registration.name));
        }
    }
}

fn starved(chain: &Chain, slot: &Slot) -> String {
    let r = slot.registration;
    let missing: Vec<String> = chain.missing(r.needs).map(|c| c.to_string()).collect();
    let what = if missing.is_empty() { "samples at 2 Hz or more".to_owned() } else { missing.join(", ") };
    format!("{} is starved of {what}", r.name)
}
