//! Several observers on one vehicle: order, names, resets, starvation, and that none disturbs another.

mod hover;

use mavobserver::observers::REGISTRY;
use mavobserver::pipeline::{Event, Fleet, FleetSettings, ObserverSetting};
use mavobserver::signal::{Discontinuity, Estimate, Measurement, Verdict};
use mavobserver::vehicle;
use mavobserver::wire::FrameBuf;
use std::collections::BTreeMap;
use std::sync::Arc;

fn fleet(observers: Vec<ObserverSetting>) -> Fleet {
    let model = Arc::new(vehicle::resolve("arducopter-sitl").expect("a preset"));
    Fleet::new(FleetSettings { observers, ..FleetSettings::standard(model) }).expect("designs")
}

/// What each observer says at each step, and the verdict of the vehicle.
#[derive(Debug, Default, PartialEq)]
struct Course {
    estimates: BTreeMap<&'static str, Vec<Estimate>>,
    verdicts: Vec<Verdict>,
    measurements: Vec<Measurement>,
}

fn course(fleet: &mut Fleet, frames: &[(u64, FrameBuf)]) -> Course {
    let mut course = Course::default();
    for (received, frame) in frames {
        fleet.frame(frame.as_ref(), *received, &mut |event| {
            let Event::Snapshot(s, m) = event else { return };
            course.verdicts.push(s.verdict);
            course.measurements.push(*m);
            for report in s.observers.iter() {
                course.estimates.entry(report.name).or_default().push(report.estimate.clone());
            }
        });
    }
    course
}

#[test]
fn neither_order_nor_company_changes_an_estimate() {
    let frames = hover::frames(150);
    let standard = ObserverSetting::standard();
    let together = course(&mut fleet(standard.clone()), &frames);
    let reversed = course(&mut fleet(standard.iter().rev().cloned().collect()), &frames);
    // as text, since an observer may say NaN of what it does not know
    assert_eq!(format!("{together:?}"), format!("{reversed:?}"));
    assert!(together.estimates.contains_key("quadratic_bounded"));
    for (name, estimates) in &together.estimates {
        let alone = course(&mut fleet(vec![ObserverSetting::named(name)]), &frames);
        assert_eq!(format!("{:?}", alone.estimates[name]), format!("{estimates:?}"), "{name}");
    }
}

/// After a reboot or a gap nothing of before is left: every observer goes on just as one that saw nothing of it.
#[test]
fn a_break_in_time_leaves_nothing_behind() {
    let seen = course(&mut fleet(ObserverSetting::standard()), &hover::frames(150)).measurements;
    let model = vehicle::resolve("arducopter-sitl").expect("a preset");
    for registration in REGISTRY.iter().filter(|r| r.standard) {
        let Ok(mut used) = mavobserver::observers::build(registration.name, &model, Default::default()) else {
            continue;
        };
        let mut new = used.fresh();
        for m in &seen {
            used.step(m).expect("finite");
        }
        used.reset();
        for (k, m) in seen.iter().enumerate() {
            let m = Measurement { discontinuity: (k == 0).then_some(Discontinuity::Reboot).or(m.discontinuity), ..*m };
            let (a, b) = (used.step(&m).expect("finite").clone(), new.step(&m).expect("finite").clone());
            assert_eq!(format!("{a:?}"), format!("{b:?}"), "{}, step {k}", registration.name);
        }
    }
}

/// An observer whose channel does not come says so, which bit is missing included, and the others go on.
#[test]
fn one_that_is_starved_does_not_stop_the_others() {
    let frames = hover::frames(300);
    let mut fleet = fleet(ObserverSetting::standard());
    let (mut last, mut missing) = (BTreeMap::new(), BTreeMap::new());
    for (received, frame) in &frames {
        fleet.frame(frame.as_ref(), *received, &mut |event| {
            let Event::Snapshot(s, _) = event else { return };
            for r in s.observers.iter() {
                last.insert(r.name, r.estimate.verdict);
                missing.insert(r.name, r.missing);
                assert!(r.missing == 0 || r.steps > 0);
            }
            if s.observers.iter().any(|r| r.estimate.verdict == Verdict::Consistent) {
                assert_ne!(s.verdict, Verdict::Starved);
            }
        });
    }
    assert_eq!((last["quadratic_bounded"], missing["quadratic_bounded"]), (Verdict::Consistent, 0));
    for r in REGISTRY.iter().filter(|r| missing.get(r.name).is_some_and(|m| *m != 0)) {
        let needed = r.needs.iter().fold(0, |bits, c| bits | c.bit());
        assert_eq!(missing[r.name] & !needed, 0, "{} misses only what it needs", r.name);
    }
}
