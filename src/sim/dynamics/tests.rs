//! Physics the simulator must obey, whatever its numbers: balances, known motions and the integrator's order.

use super::*;
use crate::sim::testing::{quad, quad_in_vacuum};
use crate::vehicle::{GRAVITY_MPS2, Ranged, Spin, Vehicle};
use nalgebra::{Matrix3, Vector3};

fn plant(vehicle: Vehicle, step_s: f64) -> Plant {
    let model = vehicle.clone();
    let config =
        PlantConfig { vehicle, model, battery: None, ground: None, home_altitude_m: 0.0, heading_rad: 0.0, step_s };
    Plant::new(config).unwrap()
}

fn fly(plant: &mut Plant, inputs: &Inputs, seconds: f64) {
    for _ in 0..(seconds / plant.step_s()).round() as usize {
        plant.step(inputs);
    }
}

/// Command at which one rotor carries its share of the weight, on the standard test quad's curve.
fn hover_command(v: &Vehicle) -> f64 {
    let share = v.mass_kg.nominal * GRAVITY_MPS2 / v.rotors.len() as f64 / v.thrust.max_n.nominal;
    let (e, b) = (v.thrust.expo, 1.0 - v.thrust.expo);
    (-b + (b * b + 4.0 * e * share).sqrt()) / (2.0 * e)
}

fn all(command: f64) -> Inputs {
    Inputs { commands: [command; crate::signal::MAX_ROTORS], ..Inputs::default() }
}

#[test]
fn free_fall_is_a_parabola() {
    let mut p = plant(quad_in_vacuum(), 1e-3);
    fly(&mut p, &all(0.0), 2.0);
    let s = p.state();
    assert!((s.velocity_ned_mps - Vector3::z() * 2.0 * GRAVITY_MPS2).norm() < 1e-9);
    assert!((s.position_ned_m - Vector3::z() * 2.0 * GRAVITY_MPS2).norm() < 1e-9);
    assert!(p.truth().specific_force_frd_mps2.norm() < 1e-12, "an accelerometer in free fall reads nothing");
}

#[test]
fn falling_through_air_ends_at_the_terminal_speed() {
    let v = quad();
    let area = v.drag.area_m2[2].nominal;
    let terminal = (2.0 * 3.0 * GRAVITY_MPS2 / (1.225 * area)).sqrt();
    let mut p = plant(v, 1e-3);
    let mut at_sea_level = *p.state();
    // falling 8 km would meet denser air: hold the height at home and integrate the speed alone
    for _ in 0..20_000 {
        p.step(&all(0.0));
        at_sea_level = *p.state();
        at_sea_level.position_ned_m = Vector3::zeros();
        p.set_state(at_sea_level);
    }
    let speed = at_sea_level.velocity_ned_mps.z;
    assert!((speed / terminal - 1.0).abs() < 1e-6, "{speed} against {terminal}");
}

#[test]
fn the_hover_command_hovers() {
    let v = quad_in_vacuum();
    let c = hover_command(&v);
    let mut p = plant(v, 1e-3);
    p.set_rotors([c; crate::signal::MAX_ROTORS]);
    fly(&mut p, &all(c), 10.0);
    let t = p.truth();
    assert!(t.velocity_ned_mps.norm() < 1e-9 && t.rate_frd_rads.norm() < 1e-9);
    assert!((t.specific_force_frd_mps2 + Vector3::z() * GRAVITY_MPS2).norm() < 1e-9);
    assert!(t.residual_force_ned_n.norm() < 1e-9 && t.residual_torque_frd_nm.norm() < 1e-9);
}

#[test]
fn a_level_vehicle_ends_up_drifting_with_the_wind() {
    let mut v = quad();
    v.thrust.voltage_ref_v = None;
    v.thrust.density_ref_kgm3 = None;
    let c = hover_command(&v);
    let wind = Vector3::new(6.0, -3.0, 0.0);
    let mut p = plant(v, 1e-3);
    p.set_rotors([c; crate::signal::MAX_ROTORS]);
    fly(&mut p, &Inputs { wind_ned_mps: wind, ..all(c) }, 60.0);
    assert!((p.state().velocity_ned_mps - wind).norm() < 1e-3, "{}", p.state().velocity_ned_mps);
}

#[test]
fn residual_force_in_flight_is_the_drag_law() {
    let mut p = plant(quad(), 1e-3);
    let mut s = *p.state();
    s.velocity_ned_mps = Vector3::new(4.0, 2.0, -1.0);
    s.attitude = nalgebra::UnitQuaternion::from_euler_angles(0.2, -0.1, 1.0).into_inner();
    p.set_state(s);
    p.set_rotors([0.5; crate::signal::MAX_ROTORS]);
    let wind = Vector3::new(-3.0, 1.0, 0.5);
    p.step(&Inputs { wind_ned_mps: wind, ..all(0.5) });
    let t = p.truth();
    let v = quad();
    let air = t.body_to_ned.inverse_transform_vector(&(t.velocity_ned_mps - wind));
    assert!((air - t.air_velocity_frd_mps).norm() < 1e-12);
    let rotor_air =
        crate::vehicle::Air { voltage_v: Some(t.voltage_v), density_kgm3: Some(t.density_kgm3), climb_mps: -air.z };
    let (_, sum_sqrt) =
        v.rotor_wrench(&crate::signal::RotorCommands { command: t.rotors, count: t.rotor_count }, rotor_air);
    let law = Vector3::from_fn(|i, _| v.drag.force(i, air[i], sum_sqrt, t.density_kgm3));
    assert!((t.residual_force_ned_n - t.body_to_ned * law).norm() < 1e-9);
}

#[test]
fn a_tumbling_body_keeps_its_energy_and_angular_momentum() {
    let mut v = quad_in_vacuum();
    v.inertia_kgm2 = Matrix3::new(0.02, 0.002, 0.001, 0.002, 0.03, -0.001, 0.001, -0.001, 0.045);
    let inertia = v.inertia_kgm2;
    let mut p = plant(v, 1e-3);
    let mut s = *p.state();
    s.rate_frd_rads = Vector3::new(3.0, -2.0, 5.0);
    s.velocity_ned_mps = Vector3::new(2.0, 1.0, -10.0);
    p.set_state(s);
    let energy = |s: &State| {
        1.5 * s.velocity_ned_mps.norm_squared() - 3.0 * GRAVITY_MPS2 * s.position_ned_m.z
            + 0.5 * s.rate_frd_rads.dot(&(inertia * s.rate_frd_rads))
    };
    let (e0, h0) = (energy(p.state()), p.angular_momentum_ned());
    fly(&mut p, &all(0.0), 10.0);
    assert!((energy(p.state()) / e0 - 1.0).abs() < 1e-10);
    assert!((p.angular_momentum_ned() - h0).norm() / h0.norm() < 1e-9);
}

#[test]
fn power_of_thrust_and_drag_is_what_the_energy_gains() {
    let mut p = plant(quad(), 1e-3);
    let inputs = Inputs { wind_ned_mps: Vector3::new(4.0, 0.0, 0.0), ..all(0.6) };
    let energy = |s: &State| 1.5 * s.velocity_ned_mps.norm_squared() - 3.0 * GRAVITY_MPS2 * s.position_ned_m.z;
    let power = |p: &Plant| {
        let t = p.truth();
        (t.body_to_ned * t.specific_force_frd_mps2 * 3.0).dot(&t.velocity_ned_mps)
    };
    p.step(&inputs);
    let e0 = energy(p.state());
    let (mut work, mut before) = (0.0, power(&p));
    for _ in 0..3000 {
        p.step(&inputs);
        let after = power(&p);
        work += 0.5 * (before + after) * 1e-3;
        before = after;
    }
    let gain = energy(p.state()) - e0;
    assert!((work / gain - 1.0).abs() < 1e-5, "work {work} J, energy {gain} J");
}

#[test]
fn spinning_up_rotors_only_moves_momentum_from_rotors_to_body() {
    let mut v = quad_in_vacuum();
    v.dynamics.inertia_kgm2 = 2e-4;
    for r in &mut v.rotors {
        // no arm and no aerodynamic reaction: what is left acts between rotor and body
        r.position_frd_m = Vector3::zeros();
        r.torque_ratio_m = 0.0;
        r.spin = Spin::Ccw;
    }
    // a fine step: what is left is the physics, not the quadrature of the spin-up
    let mut p = plant(v, 2.5e-4);
    let mut s = *p.state();
    s.rate_frd_rads = Vector3::new(0.5, 0.3, 0.0);
    p.set_state(s);
    p.set_rotors([0.2; crate::signal::MAX_ROTORS]);
    let before = p.angular_momentum_ned();
    fly(&mut p, &all(0.9), 1.0);
    let drift = (p.angular_momentum_ned() - before).norm() / before.norm();
    assert!(drift < 1e-8, "{drift:e}");
    assert!(p.state().rate_frd_rads.z > 1.0, "rotors sped up counter-clockwise, so the body turns clockwise");
}

#[test]
fn a_torque_free_top_precesses_at_the_textbook_rate() {
    // Euler: for Ixx = Iyy the rate's transverse part turns at (Izz − Ixx)/Ixx · ω_z
    let mut p = plant(quad_in_vacuum(), 1e-3);
    let mut s = *p.state();
    s.rate_frd_rads = Vector3::new(1.0, 0.0, 2.0);
    p.set_state(s);
    fly(&mut p, &all(0.0), 0.5);
    let angle = 0.5 * 2.0 * (0.04594 - 0.02297) / 0.02297;
    let expected = Vector3::new(f64::cos(angle), f64::sin(angle), 2.0);
    assert!((p.state().rate_frd_rads - expected).norm() < 1e-9, "{}", p.state().rate_frd_rads);
}

#[test]
fn spinning_rotors_turn_a_roll_torque_into_pitch() {
    // gyroscopic precession: with momentum h along the thrust axis the body nods with the period 2πI/h about a
    // slow drift of τ/h at right angles to the torque
    let mut v = quad_in_vacuum();
    v.dynamics.inertia_kgm2 = 2e-3;
    for r in &mut v.rotors {
        r.spin = Spin::Ccw;
        r.torque_ratio_m = 0.0;
    }
    let mut p = plant(v, 1e-3);
    p.set_rotors([0.4; crate::signal::MAX_ROTORS]);
    let h = p.angular_momentum_ned().norm();
    let torque = 0.02;
    let push = Push { torque_frd_nm: Vector3::x() * torque, ..Push::default() };
    let period = std::f64::consts::TAU * 0.02297 / h;
    let inputs = Inputs { push, ..all(0.4) };
    let mut mean = Vector3::zeros();
    let n = (period / 1e-3).round() as usize;
    for _ in 0..n {
        p.step(&inputs);
        mean += p.state().rate_frd_rads / n as f64;
    }
    // momentum points up (−z): τ = ω × h gives ω_y = τ/h·(−1)·(−1)
    let drift = torque / h;
    assert!(mean.x.abs() < 0.02 * drift, "{mean}");
    assert!((mean.y.abs() / drift - 1.0).abs() < 0.02, "{} against {drift}", mean.y);
}

#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let run = |step: f64| {
        let mut v = quad();
        v.dynamics.inertia_kgm2 = 2e-4;
        let mut p = plant(v, step);
        let mut s = *p.state();
        // no component of the velocity through the air changes sign: v|v| has a kink in its second derivative
        s.rate_frd_rads = Vector3::new(1.0, -0.5, 0.8);
        s.velocity_ned_mps = Vector3::new(9.0, 7.0, 12.0);
        p.set_state(s);
        p.set_rotors([0.5; crate::signal::MAX_ROTORS]);
        let mut inputs = Inputs { wind_ned_mps: Vector3::new(-3.0, -2.0, -1.0), ..Inputs::default() };
        inputs.commands[..4].copy_from_slice(&[0.72, 0.72, 0.70, 0.70]);
        fly(&mut p, &inputs, 0.512);
        *p.state()
    };
    let exact = run(2.5e-4);
    let error = |step: f64| {
        let s = run(step);
        (s.position_ned_m - exact.position_ned_m).norm()
            + (s.velocity_ned_mps - exact.velocity_ned_mps).norm()
            + (s.rate_frd_rads - exact.rate_frd_rads).norm()
            + (s.attitude - exact.attitude).norm()
    };
    let steps = [16e-3, 8e-3, 4e-3, 2e-3];
    let errors = steps.map(error);
    for (pair, h) in errors.windows(2).zip(steps) {
        let order = (pair[0] / pair[1]).log2();
        println!("step {:.0} ms: error {:.3e}, order {order:.2}", h * 1e3, pair[0]);
        assert!((3.85..4.15).contains(&order), "order {order} at {h} s");
    }
}

#[test]
fn a_payload_shows_as_its_weight_in_the_residual() {
    let v = quad_in_vacuum();
    let mut p = plant(v, 1e-3);
    let load = Payload { mass_kg: 0.5, position_frd_m: Vector3::new(0.1, 0.0, 0.05), inertia_kgm2: Matrix3::zeros() };
    assert!(p.set_payload(Some(&load)));
    // held still by a push that carries everything the rotors do not
    let weight = 3.5 * GRAVITY_MPS2;
    let push = Push {
        force_ned_n: -Vector3::z() * weight,
        torque_frd_nm: -load.position_frd_m.cross(&(Vector3::z() * 0.5 * GRAVITY_MPS2)),
        ..Push::default()
    };
    p.step(&Inputs { push, ..Inputs::default() });
    let t = p.truth();
    assert!(t.acceleration_ned_mps2.norm() < 1e-9 && t.angular_acceleration_frd_rads2.norm() < 1e-9);
    assert!((t.residual_force_ned_n + Vector3::z() * 3.0 * GRAVITY_MPS2).norm() < 1e-9);
    assert!(p.set_payload(None));
    assert_eq!(p.mass().mass_kg, 3.0);
}

#[test]
fn dropping_an_eccentric_payload_leaves_the_motion_of_the_body_as_it_was() {
    let mut p = plant(quad_in_vacuum(), 1e-3);
    let load = Payload { mass_kg: 1.0, position_frd_m: Vector3::new(0.2, 0.0, 0.0), inertia_kgm2: Matrix3::zeros() };
    p.set_payload(Some(&load));
    fly(&mut p, &all(0.5), 0.1);
    assert!(p.state().rate_frd_rads.y < -0.1, "nose-heavy: pitches down");
    let before = *p.state();
    p.set_payload(None);
    assert_eq!(*p.state(), before);
}

#[test]
fn weak_stuck_and_damaged_rotors_show_what_they_should() {
    let mut healthy = plant(quad(), 1e-3);
    let mut weak = healthy.clone();
    let mut damaged = healthy.clone();
    let mut stuck = healthy.clone();
    weak.set_health(0, RotorHealth::Weak(0.64));
    damaged.set_health(0, RotorHealth::Damaged(0.64));
    stuck.set_health(0, RotorHealth::Stuck(0.3));
    for p in [&mut healthy, &mut weak, &mut damaged, &mut stuck] {
        fly(p, &all(0.5), 0.3);
    }
    let speed = |p: &Plant| p.truth().rotor_speed_rads[0];
    assert!((speed(&weak) / speed(&healthy) - 0.8).abs() < 1e-9);
    assert_eq!(speed(&damaged), speed(&healthy));
    assert!((stuck.truth().rotors[0] - 0.3).abs() < 1e-3);
    // rotor 1 is front right: without its lift the vehicle falls to the right and the nose drops
    let torque = weak.truth().residual_torque_frd_nm;
    assert!(torque.x > 0.1 && torque.y < -0.1, "{torque}");
}

fn parked() -> Plant {
    let vehicle = quad();
    let ground = Ground::under(3.0, 0.35);
    let model = vehicle.clone();
    let battery = Some(Battery::typical(12.6, 20.0));
    let config = PlantConfig {
        vehicle,
        model,
        battery,
        ground: Some(ground),
        home_altitude_m: 584.0,
        heading_rad: 0.5,
        step_s: 2e-3,
    };
    Plant::new(config).unwrap()
}

#[test]
fn a_parked_vehicle_stays_put_even_in_wind() {
    let mut p = parked();
    fly(&mut p, &Inputs { wind_ned_mps: Vector3::new(8.0, 0.0, 0.0), ..Inputs::default() }, 30.0);
    let t = p.truth();
    assert!(t.on_ground);
    assert!(t.position_ned_m.norm() < 0.02, "{}", t.position_ned_m);
    assert!(t.velocity_ned_mps.norm() < 1e-6, "it does not creep");
    assert!(t.acceleration_ned_mps2.norm() < 1e-6);
    assert!(t.body_to_ned.euler_angles().0.abs() < 0.02);
}

#[test]
fn landing_hard_ends_at_rest_on_the_feet() {
    let mut p = parked();
    let mut s = *p.state();
    s.position_ned_m.z = -2.0;
    s.velocity_ned_mps = Vector3::new(0.5, 0.0, 0.0);
    p.set_state(s);
    fly(&mut p, &Inputs::default(), 6.0);
    let t = p.truth();
    assert!(t.on_ground && t.velocity_ned_mps.norm() < 1e-2, "{}", t.velocity_ned_mps);
    assert!(t.position_ned_m.z.abs() < 5e-3, "{}", t.position_ned_m);
}

#[test]
fn the_battery_sags_under_load_and_recovers() {
    let mut p = parked();
    let full = p.truth().voltage_v;
    fly(&mut p, &all(hover_command(&quad())), 20.0);
    let loaded = p.truth().voltage_v;
    fly(&mut p, &all(0.0), 2.0);
    let rested = p.truth().voltage_v;
    assert!(loaded < rested && rested < full, "{loaded} < {rested} < {full}");
    assert!(((full - loaded) / full - 0.015).abs() < 0.01);
}

#[test]
fn drag_ranged_by_its_declared_share_is_used_at_its_nominal_value() {
    let mut v = quad();
    v.drag.area_m2 = [Ranged::relative(0.17433, 0.2); 3];
    let (mut a, mut b) = (plant(v, 1e-3), plant(quad(), 1e-3));
    let inputs = Inputs { wind_ned_mps: Vector3::new(5.0, 0.0, 0.0), ..all(0.5) };
    fly(&mut a, &inputs, 0.1);
    fly(&mut b, &inputs, 0.1);
    assert_eq!(a.state(), b.state());
}
