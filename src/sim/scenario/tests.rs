use super::*;
use crate::document::Document;
use crate::sim::control::Leg;
use crate::sim::{Run, RunOptions};
use std::path::Path;

fn issues(text: &str) -> String {
    let text = format!("name = 'x'\nvehicle = 'arducopter-sitl'\nduration_s = 10\n{text}");
    parse(&Document::new("x.toml", text), Path::new("")).unwrap_err().to_string()
}

#[test]
fn every_bundled_scenario_is_valid_and_says_what_it_is() {
    for name in names() {
        let s = resolve(name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(s.name, name);
        // the demo's streams are asked for by the daemon
        assert!(!s.description.is_empty() && (name == "demo") == s.streams.is_empty());
    }
}

#[test]
fn every_bundled_scenario_flies_as_long_as_it_should() {
    for name in names() {
        let mut run = Run::new(&resolve(name).unwrap(), &RunOptions::default()).unwrap();
        let mut frames = 0;
        let mut airborne_s: f64 = 0.0;
        while !run.done() {
            run.advance(&mut |_| frames += 1);
            if run.moment(0).is_some_and(|m| m.flight.armed()) {
                airborne_s += run.loop_s();
            }
        }
        println!("{name}: {:.1} s, {airborne_s:.1} s armed, {frames} frames", run.now_s());
        assert!(airborne_s > 0.6 * run.duration_s(), "{name}: armed for {airborne_s} s only");
        assert!(frames > 5_000 || name == "demo", "{name}: {frames} frames");
    }
}

#[test]
fn a_scenario_is_read_as_written() {
    let text = "
        name = 'x'
        vehicle = 'px4-sih'
        autopilot = 'px4'
        duration_s = 10
        seed = 42
        vehicles = 3
        model = 'sampled'
        mission = [{ leg = 'takeoff', height_m = 4 }, { leg = 'turn', heading_deg = 90 }]
        [[fault]]
        kind = 'rotor_lost'
        rotor = 2
        from_s = 5
    ";
    let s = parse(&Document::new("x.toml", text), Path::new("")).unwrap();
    let (first, second) = (s.plan(0), s.plan(1));
    assert_eq!((s.stack, s.vehicles, s.seed(), second.system), (Stack::Px4, 3, 42, 2));
    assert_eq!(first.mission[0], Leg::Takeoff { height_m: 4.0 });
    assert_eq!(first.faults[0].kind.to_string(), "rotor_2");
    assert!(first.faults[0].until_s.is_infinite());
    assert_ne!(first.vehicle.mass_kg.nominal, second.vehicle.mass_kg.nominal, "each draws a vehicle of its own");
    assert_eq!(first.model.mass_kg.nominal, 1.0);
}

#[test]
fn every_mistake_is_named_at_once() {
    let found = issues(
        "sesnors = 'mems'\n[wind]\nsteady = { speed_mps = 3 }\nseries = 'none.csv'\n[[fault]]\nkind = 'rotor_weak'\nrotor = 5\nshare = 2\n\
         [streams]\nATITUDE = 50\n",
    );
    for part in [
        "did you mean `sensors`?",
        "exclude each other",
        "must lie between 1 and 4, not 5",
        "must lie between 0 and 1",
        "is no message the simulator sends",
    ] {
        assert!(found.contains(part), "`{part}` is missing in:\n{found}");
    }
    assert!(issues("[wind]\nseries = 'none.csv'").contains("cannot be read"));
    assert!(issues("[[fault]]\nkind = 'gnss_lost'\nfrom_s = 5\nuntil_s = 4").contains("not after `from_s`"));
    assert!(issues("mission = [{ leg = 'landd' }]").contains("did you mean \"land\"?"));
}

#[test]
fn a_vehicle_that_cannot_fly_is_refused() {
    let text = "name = 'x'\nvehicle = 'quanser-3dof'\nduration_s = 1";
    let found = parse(&Document::new("x.toml", text), Path::new("")).unwrap_err().to_string();
    assert!(found.contains("cannot lift itself"), "{found}");
    let unknown = resolve("wind-step").unwrap_err().to_string();
    assert!(unknown.contains("did you mean `wind-steps`?"), "{unknown}");
}
