//! Flights in closed loop: every preset that can fly flies, holds its place, and shows what was done to it.

use super::*;
use crate::sim::faults::FaultKind;
use crate::vehicle::{GRAVITY_MPS2, resolve};

fn flight(vehicle: &str, mission: Vec<Leg>) -> FlightPlan {
    FlightPlan { mission, ..FlightPlan::calm(resolve(vehicle).unwrap(), 1) }
}

fn hover(seconds: f64) -> Vec<Leg> {
    vec![Leg::Wait { seconds: 1.0 }, Leg::Takeoff { height_m: 10.0 }, Leg::Hover { seconds }]
}

/// Runs to a time and calls `see` after every loop.
fn run(plan: &FlightPlan, until_s: f64, mut see: impl FnMut(&Moment)) -> SimVehicle {
    let mut v = SimVehicle::new(plan).unwrap();
    while v.now().truth.stamp.secs() < until_s {
        see(v.advance());
    }
    v
}

#[test]
fn every_flying_preset_takes_off_hovers_and_lands() {
    for name in ["arducopter-sitl", "arducopter-hexa", "px4-sih", "px4-x500", "cayero-hummingbird"] {
        let mut plan = flight(name, hover(20.0));
        plan.mission.push(Leg::Land);
        if name == "cayero-hummingbird" {
            // the paper's noise (3 rad/s on the gyro) is for its observer; no loop can be closed on it
            plan.navigation = NavigationSource::Truth;
        }
        let (mut highest, mut worst): (f64, f64) = (0.0, 0.0);
        let v = run(&plan, 90.0, |m| {
            let height = -m.truth.position_ned_m.z;
            highest = highest.max(height);
            if m.flight == Flight::Flying {
                worst = worst.max(m.truth.position_ned_m.xy().norm());
            }
        });
        let end = v.now();
        println!(
            "{name}: up to {highest:.2} m, off by {worst:.2} m, landed at {}",
            end.truth.position_ned_m.transpose()
        );
        assert!((9.0..12.5).contains(&highest), "{name}: {highest} m");
        assert!(worst < 3.0, "{name}: wandered {worst} m");
        assert!(end.flight == Flight::Disarmed && end.truth.on_ground, "{name} has not landed");
        assert!(end.truth.velocity_ned_mps.norm() < 0.01, "{name}");
    }
}

#[test]
fn hover_on_perfect_sensors_settles_to_rest() {
    let mut plan = flight("arducopter-sitl", hover(60.0));
    plan.sensors = SensorSuite::perfect(&plan.vehicle);
    let v = run(&plan, 60.0, |_| {});
    let t = v.now().truth;
    assert!((t.position_ned_m + Vector3::z() * 10.0).norm() < 0.1, "{}", t.position_ned_m.transpose());
    assert!(t.velocity_ned_mps.norm() < 0.02 && t.rate_frd_rads.norm() < 0.01, "{}", t.velocity_ned_mps);
    assert!((t.specific_force_frd_mps2 + Vector3::z() * GRAVITY_MPS2).norm() < 0.05);
}

#[test]
fn in_steady_wind_the_residual_force_is_the_drag_of_that_wind() {
    let mut plan = flight("arducopter-sitl", hover(60.0));
    plan.wind = Profile::series(&[(15.0, Vector3::zeros()), (17.0, wind_from(0.0, 6.0))]);
    let mut mean = Vector3::zeros();
    let mut n = 0.0;
    run(&plan, 60.0, |m| {
        if m.truth.stamp.secs() > 35.0 {
            mean += m.truth.residual_force_ned_n;
            n += 1.0;
        }
    });
    let force = mean / n;
    let wind = wind_from(0.0, 6.0);
    assert!(force.xy().normalize().dot(&wind.xy().normalize()) > 0.999, "{force}");
    // .72 N per m/s of rotor drag at first order, and ½·1.15·.174·v²
    let expected = 0.72 * 6.0 + 0.5 * 1.15 * 0.17433 * 36.0;
    assert!((force.xy().norm() / expected - 1.0).abs() < 0.08, "{} against {expected}", force.xy().norm());
}

#[test]
fn the_estimator_errs_as_autopilots_do() {
    let mut plan = flight("arducopter-sitl", hover(60.0));
    plan.mission.push(Leg::Velocity { velocity_ned_mps: Vector3::new(5.0, 0.0, 0.0), seconds: 10.0 });
    plan.mission.push(Leg::Circle { radius_m: 10.0, speed_mps: 4.0, seconds: 30.0, nose_ahead: true });
    plan.sensors = SensorSuite::mems(&plan.vehicle);
    plan.turbulence = Some(Turbulence { wind_at_20ft_mps: 5.0, heading_rad: 0.0 });
    let (mut tilt, mut yaw, mut velocity, mut n): (f64, f64, f64, f64) = (0.0, 0.0, 0.0, 0.0);
    run(&plan, 115.0, |m| {
        if m.truth.stamp.secs() > 15.0 {
            let error = m.navigation.body_to_ned * m.truth.body_to_ned.inverse();
            let a = error.scaled_axis();
            tilt += a.xy().norm_squared();
            yaw += a.z * a.z;
            velocity += (m.navigation.velocity_ned_mps - m.truth.velocity_ned_mps).norm_squared();
            n += 1.0;
        }
    });
    let (tilt, yaw, velocity) = ((tilt / n).sqrt().to_degrees(), (yaw / n).sqrt().to_degrees(), (velocity / n).sqrt());
    println!("rms: tilt {tilt:.2}°, yaw {yaw:.2}°, velocity {velocity:.3} m/s");
    assert!((0.05..1.5).contains(&tilt) && (0.1..4.0).contains(&yaw) && (0.02..0.3).contains(&velocity));
}

#[test]
fn the_same_seed_gives_the_same_flight_and_another_does_not() {
    let plan = flight("arducopter-sitl", hover(5.0));
    let end = |plan: &FlightPlan| run(plan, 10.0, |_| {}).now().truth;
    assert_eq!(end(&plan), end(&plan));
    assert_ne!(end(&plan), end(&FlightPlan { seed: 2, ..plan.clone() }));
}

#[test]
fn losing_a_rotor_brings_a_quad_down_and_a_weak_one_does_not() {
    let mut plan = flight("arducopter-sitl", hover(60.0));
    let fault = |share| Fault { kind: FaultKind::RotorWeak { rotor: 1, share }, from_s: 20.0, until_s: f64::INFINITY };
    plan.faults = vec![fault(0.0)];
    let crashed = run(&plan, 40.0, |_| {});
    assert_eq!(crashed.now().flight, Flight::Disarmed);
    assert!(crashed.now().truth.on_ground);
    plan.faults = vec![fault(0.8)];
    let limped = run(&plan, 40.0, |_| {});
    assert_eq!(limped.now().flight, Flight::Flying);
    assert!(limped.now().truth.residual_force_ned_n.z > 1.0, "a fifth of one rotor's lift is missing");
}

#[test]
fn a_hexarotor_flies_on_without_one_rotor() {
    let mut plan = FlightPlan { mission: hover(60.0), ..FlightPlan::calm(crate::sim::testing::hexa(), 1) };
    plan.faults =
        vec![Fault { kind: FaultKind::RotorWeak { rotor: 2, share: 0.5 }, from_s: 20.0, until_s: f64::INFINITY }];
    let v = run(&plan, 40.0, |_| {});
    assert_eq!(v.now().flight, Flight::Flying);
    assert!((v.now().truth.position_ned_m.z + 10.0).abs() < 1.0);
}

#[test]
fn a_biased_gyro_is_left_for_the_other_sensor() {
    let mut plan = flight("arducopter-sitl", hover(60.0));
    let bias = FaultKind::GyroBias { imu: 0, bias_rads: Vector3::new(0.3, 0.0, 0.0) };
    plan.faults = vec![Fault { kind: bias, from_s: 20.0, until_s: f64::INFINITY }];
    let v = run(&plan, 40.0, |_| {});
    assert_eq!(v.estimator().active_lane(), 1);
    assert_eq!(v.now().flight, Flight::Flying);
}

#[test]
fn what_cannot_fly_is_refused_with_the_reason() {
    let plan = FlightPlan::calm(resolve("quanser-3dof").unwrap(), 1);
    assert!(matches!(SimVehicle::new(&plan), Err(SimError::TooHeavy { .. })));
}
