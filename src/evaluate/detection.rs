//! Faults that were told against those that happened: delay, wrong names, false alarms.

use crate::pipeline::FaultMask;
use crate::sim::faults::Fault;
use std::collections::BTreeMap;

/// How long after a fault has cleared its name may still stand without being wrong, s.
const GRACE_S: f64 = 5.0;
/// A fault that is not told within this time of its onset is missed, s: the slowest test that is worth running.
const PATIENCE_S: f64 = 15.0;

/// What is not a fault but worth telling: neither counted as an alarm nor as a wrong name.
const NEUTRAL: &str = "gust";

/// One fault of a flight, as the mask should show it.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueFault {
    /// What happened, such as `rotor_lost`: the kind by which delays are counted.
    pub kind: &'static str,
    /// What it should be called: a name of [`FaultMask::NAMES`].
    pub name: String,
    pub from_s: f64,
    /// Infinite when it never clears.
    pub until_s: f64,
}

impl From<&Fault> for TrueFault {
    fn from(fault: &Fault) -> Self {
        Self { kind: fault.kind.kind(), name: fault.kind.to_string(), from_s: fault.from_s, until_s: fault.until_s }
    }
}

/// How all faults of one kind were told, over any number of flights.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Told {
    /// Faults that happened while the vehicle flew.
    pub happened: u32,
    /// From onset until the right name stood, s; one for each that was told in time.
    pub delays_s: Vec<f64>,
    /// From the end of a fault until its name was gone, s.
    pub clears_s: Vec<f64>,
    /// Those whose first name was a wrong one.
    pub misnamed: u32,
}

/// How the faults of any number of flights were told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Detection {
    /// By kind.
    pub faults: BTreeMap<&'static str, Told>,
    /// Names that rose while nothing was wrong, by name.
    pub false_alarms: BTreeMap<&'static str, u32>,
    /// Names that rose while something else was wrong.
    pub wrong: BTreeMap<&'static str, u32>,
    /// Flight without any fault, s.
    pub healthy_s: f64,
    /// Gusts told.
    pub gusts: u32,
}

/// Watches one flight.
#[derive(Debug, Clone, Default)]
pub struct FaultWatch {
    faults: Vec<Seen>,
    before: FaultMask,
    last_s: Option<f64>,
    out: Detection,
}

#[derive(Debug, Clone)]
struct Seen {
    truth: TrueFault,
    /// The mask was looked at while the fault lasted.
    flown: bool,
    told_s: Option<f64>,
    cleared_s: Option<f64>,
    /// The first name since its onset was a wrong one.
    misnamed: bool,
}

impl Seen {
    fn lasts(&self, t_s: f64) -> bool {
        self.truth.from_s <= t_s && t_s < self.truth.until_s
    }

    /// It, or what it leaves behind.
    fn excuses(&self, t_s: f64) -> bool {
        self.truth.from_s <= t_s && t_s < self.truth.until_s + GRACE_S
    }
}

impl FaultWatch {
    /// For a flight with these faults, on the clock of the masks' stamps.
    pub fn new(faults: impl IntoIterator<Item = TrueFault>) -> Self {
        let seen = |truth| Seen { truth, flown: false, told_s: None, cleared_s: None, misnamed: false };
        Self { faults: faults.into_iter().map(seen).collect(), ..Self::default() }
    }

    /// The mask at an instant of the flight, s. Call in order of time, in the air only.
    pub fn see(&mut self, t_s: f64, mask: FaultMask) {
        let step_s = self.last_s.map_or(0.0, |last| (t_s - last).clamp(0.0, 1.0));
        self.last_s = Some(t_s);
        if !self.faults.iter().any(|f| f.excuses(t_s)) {
            self.out.healthy_s += step_s;
        }
        let risen = FaultMask(mask.0 & !self.before.0);
        self.before = mask;
        for fault in &mut self.faults {
            fault.flown |= fault.lasts(t_s);
            let named = mask.names().any(|name| name == fault.truth.name);
            if named && fault.lasts(t_s) {
                fault.told_s.get_or_insert(t_s);
            }
            if fault.told_s.is_some() && t_s >= fault.truth.until_s && !named {
                fault.cleared_s.get_or_insert(t_s);
            }
        }
        for name in risen.names() {
            self.rise(t_s, name);
        }
    }

    fn rise(&mut self, t_s: f64, name: &'static str) {
        if name == NEUTRAL {
            self.out.gusts += 1;
            return;
        }
        if self.faults.iter().any(|f| f.excuses(t_s) && f.truth.name == name) {
            return;
        }
        let mut excused = false;
        for fault in self.faults.iter_mut().filter(|f| f.excuses(t_s)) {
            excused = true;
            fault.misnamed |= fault.told_s.is_none() && fault.lasts(t_s);
        }
        let count = if excused { &mut self.out.wrong } else { &mut self.out.false_alarms };
        *count.entry(name).or_default() += 1;
    }

    /// What the flight came to.
    pub fn finish(mut self) -> Detection {
        for seen in self.faults.into_iter().filter(|f| f.flown) {
            let told = self.out.faults.entry(seen.truth.kind).or_default();
            told.happened += 1;
            told.misnamed += u32::from(seen.misnamed);
            let delay = seen.told_s.map(|t| t - seen.truth.from_s).filter(|d| *d <= PATIENCE_S);
            told.delays_s.extend(delay);
            told.clears_s.extend(seen.cleared_s.map(|t| t - seen.truth.until_s));
        }
        self.out
    }
}

impl Detection {
    pub fn merge(&mut self, other: &Self) {
        for (name, theirs) in &other.faults {
            let mine = self.faults.entry(name).or_default();
            mine.happened += theirs.happened;
            mine.misnamed += theirs.misnamed;
            mine.delays_s.extend_from_slice(&theirs.delays_s);
            mine.clears_s.extend_from_slice(&theirs.clears_s);
        }
        for (mine, theirs) in [(&mut self.false_alarms, &other.false_alarms), (&mut self.wrong, &other.wrong)] {
            for (name, n) in theirs {
                *mine.entry(name).or_default() += n;
            }
        }
        self.healthy_s += other.healthy_s;
        self.gusts += other.gusts;
    }

    pub fn false_alarm_count(&self) -> u32 {
        self.false_alarms.values().sum()
    }

    /// Per hour of healthy flight; `None` without any.
    pub fn false_alarms_per_hour(&self) -> Option<f64> {
        (self.healthy_s > 0.0).then(|| f64::from(self.false_alarm_count()) * 3600.0 / self.healthy_s)
    }
}

impl Told {
    /// Share of the faults that were told in time.
    pub fn share(&self) -> f64 {
        self.delays_s.len() as f64 / f64::from(self.happened.max(1))
    }

    /// The delay that this share (0..1) of those told kept; `None` when none was.
    pub fn delay_s(&self, share: f64) -> Option<f64> {
        quantile(&self.delays_s, share)
    }

    pub fn median_clear_s(&self) -> Option<f64> {
        quantile(&self.clears_s, 0.5)
    }
}

/// The smallest value that this share of all does not exceed.
fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(names: &[&str]) -> FaultMask {
        let bit = |name: &&str| 1 << FaultMask::NAMES.iter().position(|n| n == name).unwrap();
        FaultMask(names.iter().map(bit).sum())
    }

    fn fault(kind: &'static str, name: &str, from_s: f64, until_s: f64) -> TrueFault {
        TrueFault { kind, name: name.to_owned(), from_s, until_s }
    }

    /// Masks that change at the given times, looked at every 20 ms until 100 s.
    fn flight(faults: &[TrueFault], changes: &[(f64, &[&str])]) -> Detection {
        let mut watch = FaultWatch::new(faults.iter().cloned());
        for i in 0..5000 {
            let t = f64::from(i) * 0.02;
            let now = changes.iter().rev().find(|(at, _)| *at <= t).map_or(FaultMask(0), |(_, names)| mask(names));
            watch.see(t, now);
        }
        watch.finish()
    }

    #[test]
    fn a_fault_that_is_told_has_a_delay_and_clears() {
        let d = flight(&[fault("gyro_bias", "gyro", 20.0, 40.0)], &[(20.5, &["gyro"]), (41.0, &[])]);
        let told = &d.faults["gyro_bias"];
        assert_eq!((told.happened, told.misnamed, told.share()), (1, 0, 1.0));
        assert!((told.delay_s(0.5).unwrap() - 0.5).abs() < 0.03);
        assert!((told.median_clear_s().unwrap() - 1.0).abs() < 0.03);
        assert_eq!((d.false_alarm_count(), d.wrong.len()), (0, 0));
        // a hundred seconds less the fault and what it is excused for
        assert!((d.healthy_s - 75.0).abs() < 0.1, "{}", d.healthy_s);
    }

    #[test]
    fn a_wrong_name_is_neither_a_detection_nor_a_false_alarm() {
        let d = flight(
            &[fault("rotor_lost", "rotor_2", 30.0, f64::INFINITY)],
            &[(30.1, &["rotor_4"]), (30.3, &["rotor_2"])],
        );
        assert_eq!((d.faults["rotor_lost"].misnamed, d.wrong["rotor_4"], d.false_alarm_count()), (1, 1, 0));
        assert!((d.faults["rotor_lost"].delay_s(0.5).unwrap() - 0.3).abs() < 0.03);
        let late =
            flight(&[fault("baro_bias", "baro", 30.0, f64::INFINITY)], &[(30.1, &["baro"]), (33.0, &["baro", "mag"])]);
        assert_eq!((late.faults["baro_bias"].misnamed, late.wrong["mag"]), (0, 1));
    }

    #[test]
    fn names_without_a_fault_are_false_alarms_and_gusts_are_none() {
        let d = flight(&[], &[(10.0, &["accel"]), (11.0, &[]), (50.0, &["accel", "gust"]), (52.0, &[])]);
        assert_eq!((d.false_alarms["accel"], d.gusts), (2, 1));
        assert!((d.false_alarms_per_hour().unwrap() - 72.0).abs() < 0.1);
    }

    #[test]
    fn faults_on_the_ground_or_told_too_late_do_not_count_as_told() {
        let d =
            flight(&[fault("mag_bias", "mag", 10.0, 60.0), fault("link", "link", 200.0, 300.0)], &[(30.0, &["mag"])]);
        assert_eq!((d.faults["mag_bias"].happened, d.faults["mag_bias"].share()), (1, 0.0));
        assert!(!d.faults.contains_key("link"));
        // the name stands longer than the fault and its grace: no second alarm, it never rose again
        assert_eq!(d.false_alarm_count(), 0);
    }

    #[test]
    fn flights_add_up() {
        let mut all = flight(&[fault("gyro_bias", "gyro", 20.0, 40.0)], &[(20.5, &["gyro"])]);
        all.merge(&flight(&[fault("gyro_bias", "gyro", 20.0, 40.0)], &[(22.5, &["gyro"])]));
        all.merge(&flight(&[fault("gyro_bias", "gyro", 20.0, 40.0)], &[]));
        let told = &all.faults["gyro_bias"];
        assert_eq!((told.happened, told.delays_s.len()), (3, 2));
        assert!((told.delay_s(1.0).unwrap() - 2.5).abs() < 0.03 && (told.share() - 2.0 / 3.0).abs() < 1e-12);
    }
}
