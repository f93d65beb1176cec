//! Several observers on one vehicle: order, names, resets, starvation, and that none disturbs another.

mod hover;

use mavobserver::observers::{OptionValue, REGISTRY};
use mavobserver::pipeline::{Event, Fleet, FleetSettings, ObserverSetting};
use mavobserver::signal::{Channel, Discontinuity, Estimate, Measurement, Signal, Verdict};
use mavobserver::vehicle;
use mavobserver::wire::FrameBuf;
use nalgebra::UnitQuaternion;
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

/// Turned in flight: what is turned begins anew, what is paused is silent, the others do not notice.
#[test]
fn observers_are_turned_while_they_fly() {
    let frames = hover::frames(150);
    let (before, after) = frames.split_at(frames.len() / 2);
    let undisturbed = course(&mut fleet(ObserverSetting::standard()), &frames);
    let mut fleet = fleet(ObserverSetting::standard());
    course(&mut fleet, before);

    let mut tuning = fleet.tuning().clone();
    for setting in &mut tuning.observers {
        match setting.name.as_str() {
            "quadratic_bounded" => setting.options.insert("alpha_force", OptionValue::Number(2.0)),
            "gnss_ins" => setting.paused = true,
            _ => {}
        }
    }
    fleet.tune(tuning.clone()).expect("a design at this rate");
    let turned = course(&mut fleet, after);
    assert!(!turned.estimates.contains_key("gnss_ins"));
    for (name, estimates) in &turned.estimates {
        let whole = &undisturbed.estimates[name];
        let same = format!("{:?}", &whole[whole.len() - estimates.len()..]) == format!("{estimates:?}");
        assert_eq!(same, *name != "quadratic_bounded", "{name}");
    }

    // what cannot be is refused, and changes nothing
    let mut wrong = tuning.clone();
    wrong.observers[0].options.insert("alpha_force", OptionValue::Number(1e6));
    fleet.tune(wrong).expect_err("no such rate");
    assert_eq!(*fleet.tuning(), tuning);
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
        for cause in [Discontinuity::Reboot, Discontinuity::Gap] {
            let mut new = used.fresh();
            for m in &seen {
                used.step(m).expect("finite");
            }
            used.reset();
            for (k, m) in seen.iter().enumerate() {
                let m = Measurement { discontinuity: (k == 0).then_some(cause).or(m.discontinuity), ..*m };
                let (a, b) = (used.step(&m).expect("finite").clone(), new.step(&m).expect("finite").clone());
                assert_eq!(format!("{a:?}"), format!("{b:?}"), "{}, {cause:?}, step {k}", registration.name);
            }
        }
    }
}

/// The autopilot's estimate jumps and says so: nothing contradicts what is declared, every bound is reopened around what
/// comes now, and what uses nothing of the autopilot's does not notice.
#[test]
fn a_jump_of_the_autopilots_estimate_breaks_no_bound() {
    let seen = course(&mut fleet(ObserverSetting::standard()), &hover::frames(900)).measurements;
    let at = seen.len() / 2;
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.4);
    let jumped = |k: usize, m: &Measurement| {
        let mut m = *m;
        if k >= at {
            m.discontinuity = (k == at).then_some(Discontinuity::EstimatorReset).or(m.discontinuity);
            m.position_ned_m.iter_mut().for_each(|p| p.value.x += 20.0);
            m.velocity_ned_mps.iter_mut().for_each(|v| v.value.y += 2.0);
            m.attitude.iter_mut().for_each(|q| q.value = turn * q.value);
        }
        m
    };
    let model = vehicle::resolve("arducopter-sitl").expect("a preset");
    for registration in REGISTRY.iter().filter(|r| r.standard) {
        let Ok(mut moved) = mavobserver::observers::build(registration.name, &model, Default::default()) else {
            continue;
        };
        let mut still = moved.fresh();
        let at_end = jumped(seen.len() - 1, &seen[seen.len() - 1]);
        for (k, m) in seen.iter().enumerate() {
            let (e, quiet) = (moved.step(&jumped(k, m)).expect("finite"), still.step(m).expect("finite"));
            assert_ne!(e.verdict, Verdict::AssumptionViolated, "{}, step {k} of {at}", registration.name);
            if !registration.needs.contains(&Channel::Attitude) {
                assert_eq!(format!("{e:?}"), format!("{quiet:?}"), "{}, step {k}", registration.name);
            }
        }
        let e = moved.estimate();
        assert_eq!(e.verdict, Verdict::Consistent, "{}", registration.name);
        let now = |name: &str| value_of(moved.signals(), e, name);
        for (name, truth) in [
            ("position_n", at_end.position_ned_m.map(|p| p.value.x)),
            ("velocity_e", at_end.velocity_ned_mps.map(|v| v.value.y)),
            ("torque_x", Some(0.0)),
        ] {
            // of what is bounded the bound must hold; a torque must not come from a turned heading
            let (Some((value, half_width)), Some(truth)) = (now(name), truth) else { continue };
            if half_width.is_finite() {
                assert!(
                    (value - truth).abs() <= half_width,
                    "{} of {}: {value} ± {half_width}",
                    name,
                    registration.name
                );
            }
            if name == "torque_x" {
                assert!(value.abs() < 0.01, "{}: {value} N m", registration.name);
            }
        }
    }
}

/// A signal's value and half-width.
fn value_of(signals: &[Signal], e: &Estimate, name: &str) -> Option<(f64, f64)> {
    let at = signals.iter().position(|s| s.name == name)?;
    Some((e.values[at], e.half_widths[at]))
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
