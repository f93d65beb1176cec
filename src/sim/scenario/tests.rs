use super::*;
use crate::document::Document;
use crate::sim::control::Leg;
use crate::sim::faults::FaultKind;
use crate::sim::sensors::NoiseShape;
use crate::sim::{FlightPlan, Run, RunOptions};
use nalgebra::Vector3;
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
    assert!(issues("[vary]\nwind_share = [2, 1]").contains("wrong way round"));
    assert!(issues("mission = [{ leg = 'landd' }]").contains("did you mean \"land\"?"));
}

#[test]
fn noise_has_the_shape_asked_for() {
    let shape = |noise: &str| {
        let text = format!("name = 'x'\nvehicle = 'px4-sih'\nduration_s = 10\n{noise}");
        parse(&Document::new("x.toml", text), Path::new("")).unwrap().plan(0).sensors.gnss.shape
    };
    assert_eq!(shape(""), NoiseShape::Truncated { sigmas: 3.0 });
    assert_eq!(shape("noise = 'gaussian'"), NoiseShape::Gaussian);
    assert_eq!(shape("sensors = 'mems'\nnoise = 'bounded'"), NoiseShape::Truncated { sigmas: 3.0 });
}

#[test]
fn without_a_mission_it_waits_for_orders_until_its_time_is_up() {
    let text = "name = 'x'\nvehicle = 'px4-sih'\nduration_s = 2";
    let scenario = parse(&Document::new("x.toml", text), Path::new("")).unwrap();
    let mut run = Run::new(&scenario, &RunOptions::default()).unwrap();
    while !run.done() {
        run.advance(&mut |_| {});
    }
    assert!((run.now_s() - 2.0).abs() < 0.01);
}

#[test]
fn a_recorded_wind_blows_as_recorded() {
    let folder = tempfile::tempdir().unwrap();
    // on the autopilot's clock, as the truth files of flights have it
    std::fs::write(folder.path().join("w.csv"), "boot_ms,wind_from_deg,speed_mps\n2000,90,0\n6000,90,8\n").unwrap();
    let text = "name = 'x'\nvehicle = 'px4-sih'\nduration_s = 10\n[wind]\nseries = 'w.csv'";
    let scenario = parse(&Document::new("x.toml", text), folder.path()).unwrap();
    let mut run = Run::new(&scenario, &RunOptions::default()).unwrap();
    while run.now_s() < 5.0 {
        run.advance(&mut |_| {});
    }
    let wind = run.moment(0).unwrap().truth.wind_ned_mps;
    assert!((wind - Vector3::new(0.0, -6.0, 0.0)).norm() < 0.02, "{wind}");
}

#[test]
fn every_seed_draws_another_flight_of_the_same_kind() {
    let base = resolve("faults-hexa-50").unwrap();
    let draw = |seed| base.clone().with_seed(seed).plan(0);
    let plans: Vec<_> = (0..90).map(draw).collect();
    let mut kinds = std::collections::BTreeMap::<String, u32>::new();
    let mut rotors = std::collections::BTreeSet::new();
    for plan in &plans {
        let [fault] = &plan.faults[..] else { panic!("one fault a flight") };
        assert!((22.0..25.0).contains(&fault.from_s));
        let name = fault.kind.to_string();
        if name.starts_with("rotor") {
            rotors.insert(name.clone());
        }
        *kinds.entry(if name.starts_with("rotor") { "rotor".to_owned() } else { name }).or_default() += 1;
        if let FaultKind::GyroBias { bias_rads, .. } = fault.kind {
            assert!((bias_rads.norm() - 0.05).abs() < 1e-12);
        }
        assert!(plan.wind.at(10.0).norm() <= 7.0 + 1e-9);
    }
    // nine faults in turn: two of them of rotors, two of GNSS
    assert_eq!(kinds.values().sum::<u32>(), 90);
    assert_eq!((kinds["rotor"], kinds["gnss_position"], kinds["payload"]), (20, 20, 10));
    assert!(rotors.len() >= 5, "{rotors:?}");
    let wind = |plan: &FlightPlan| plan.wind.at(10.0);
    assert!(plans.windows(2).all(|w| wind(&w[0]) != wind(&w[1]) && w[0].heading_rad != w[1].heading_rad));
    assert_eq!(wind(&draw(7)), wind(&draw(7)));
}

#[test]
fn a_vehicle_that_cannot_fly_is_refused() {
    let text = "name = 'x'\nvehicle = 'quanser-3dof'\nduration_s = 1";
    let found = parse(&Document::new("x.toml", text), Path::new("")).unwrap_err().to_string();
    assert!(found.contains("cannot lift itself"), "{found}");
    let unknown = resolve("wind-step").unwrap_err().to_string();
    assert!(unknown.contains("did you mean `wind-steps`?"), "{unknown}");
}
