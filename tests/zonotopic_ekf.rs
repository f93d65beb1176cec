//! The zonotopic filter against truth that is integrated finer, driven and measured at the ends of the declared bounds.

mod bounded;

use bounded::{DT_S, INDOORS, MEASURED, OUTDOORS, advance, fly, model, slope};
use mavobserver::observers::zonotopic_ekf::paper::{HoverSettings, hover};
use mavobserver::observers::zonotopic_ekf::{
    ATTITUDE, Drive, FilterSettings, Mode, Model, Quadrotor, RATE, STATES, Smooth, ZonotopicFilter, output,
};
use mavobserver::observers::{Observer, OptionValue, Options, build};
use mavobserver::sets::{Interval, Overlap, Reduction};
use mavobserver::signal::{
    Actuation, Aged, Discontinuity, Guarantee, Imu, MAX_ROTORS, Measurement, RotorCommands, Stamp, Verdict,
};
use mavobserver::vehicle;
use nalgebra::{Matrix3, SVector, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

type State = SVector<f64, STATES>;

/// Any state of the box, pushed by any admissible disturbance at any time, ends inside the linear form.
#[test]
fn the_linear_form_holds_the_flow() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let model = model(&OUTDOORS);
    let mut largest = State::zeros();
    for round in 0..300 {
        let dt = [0.004, 0.02, 0.1][round % 3];
        let base = State::from_fn(|i, _| match i {
            0..6 => rng.random_range(-20.0..20.0),
            6..9 => rng.random_range(-0.6..0.6),
            _ => rng.random_range(-1.5..1.5),
        });
        let radius = State::from_fn(|i, _| rng.random_range(0.0..[1.0, 1.0, 0.3, 0.5][i / 3]));
        let hull = std::array::from_fn(|i| Interval::centred(base[i], radius[i]));
        let drive = Drive {
            dt_s: dt,
            force_frd_n: Vector3::new(0.0, 0.0, rng.random_range(-50.0..-10.0)),
            torque_frd_nm: Vector3::from_fn(|_, _| rng.random_range(-0.3..0.3)),
            doubt: 0.0,
        };
        let form = model.linearise(&base, &hull, &drive).expect("far from the vertical");
        for _ in 0..20 {
            let x0 = base + radius.map(|r| r * rng.random_range(-1.0..=1.0_f64).signum());
            let mut x = x0;
            let (mut f, mut t, mut air) = (drive.force_frd_n, drive.torque_frd_nm, Vector3::zeros());
            for s in 0..40 {
                if s % 10 == 0 {
                    let mut end = |r: f64| if rng.random_bool(0.5) { r } else { -r };
                    air = Vector3::from_fn(|_, _| end(OUTDOORS.air_n));
                    f = drive.force_frd_n + Vector3::new(0.0, 0.0, end(1.0));
                    t = drive.torque_frd_nm + Vector3::new(end(0.3), end(0.3), end(0.06));
                }
                x = advance(&x, dt / 40.0, |x| slope(x, &f, &t, &air));
            }
            let linear = form.value + form.jacobian * (x0 - base);
            for i in 0..STATES {
                let allowed = form.disturbance[i] + form.remainder[i];
                assert!((x[i] - linear[i]).abs() <= allowed, "state {i}, {dt} s: {} of {allowed}", x[i] - linear[i]);
                largest[i] = largest[i].max((x[i] - linear[i]).abs() / allowed);
            }
        }
    }
    // and the bound is not idle: samples come near it
    assert!(largest.iter().all(|l| *l > 0.2), "{largest}");
}

#[test]
fn the_jacobian_is_that_of_the_value() {
    let model = Quadrotor::new(
        2.0,
        &Matrix3::new(0.02, 0.001, 0.0, 0.001, 0.03, -0.002, 0.0, -0.002, 0.04),
        Vector3::new(0.01, 0.02, 0.03),
        Vector3::zeros(),
        Vector3::zeros(),
        Vector3::zeros(),
    )
    .unwrap();
    let base = State::from_fn(|i, _| 0.1 * (i as f64 + 1.0) * if i % 2 == 0 { 1.0 } else { -0.7 });
    let force_frd_n = Vector3::new(0.5, -0.3, -21.0);
    // the terms of second order in time, which the value holds and the Jacobian leaves to the remainder, are small
    let drive = Drive { dt_s: 1e-4, force_frd_n, torque_frd_nm: Vector3::new(0.1, -0.2, 0.05), doubt: 0.0 };
    let at = |x: &State| {
        let hull = std::array::from_fn(|i| Interval::point(x[i]));
        model.linearise(x, &hull, &drive).unwrap()
    };
    let form = at(&base);
    for k in 0..STATES {
        let mut step = State::zeros();
        step[k] = 1e-5;
        let difference = (at(&(base + step)).value - at(&(base - step)).value) / 2e-5;
        let error = (difference - form.jacobian.column(k)).amax();
        assert!(error < 1e-6, "column {k}: {error}");
    }
}

#[test]
fn the_vertical_has_no_linear_form() {
    let mut hull = [Interval::ZERO; STATES];
    hull[ATTITUDE + 1] = Interval::new(1.0, 1.6);
    let base = State::from_fn(|i, _| hull[i].mid());
    let drive = Drive { dt_s: DT_S, force_frd_n: Vector3::zeros(), torque_frd_nm: Vector3::zeros(), doubt: 0.0 };
    assert_eq!(model(&OUTDOORS).linearise(&base, &hull, &drive), None);
}

/// The guarantee in a shorter form than `examples/zonotopic_bounds.rs` gives it.
#[test]
fn the_truth_never_leaves_and_the_intervals_are_useful() {
    for measured in &MEASURED[3..] {
        let s = fly(&OUTDOORS, Mode::Guaranteed, measured, 0.3, 6, 350);
        assert_eq!((s.inside, s.contradicted, s.lost), (s.steps, 0, 0), "{}: {s:?}", measured.name);
        for group in 0..4 {
            assert!(s.tightness(group) <= 4.0, "{}, group {group}: {}", measured.name, s.tightness(group));
        }
    }
}

#[test]
fn the_papers_intervals_lose_the_truth_where_the_guaranteed_ones_do_not() {
    let attitude = &MEASURED[2];
    let paper = fly(&INDOORS, Mode::Paper, attitude, 0.3, 8, 60);
    let ours = fly(&INDOORS, Mode::Guaranteed, attitude, 0.3, 8, 60);
    assert!(paper.coverage() < 0.99, "{}", paper.coverage());
    assert_eq!((ours.inside, ours.contradicted), (ours.steps, 0));
}

/// Position alone leaves the attitude to the disturbances: its interval grows until nothing is claimed. It must not
/// claim anything false on the way.
#[test]
fn with_position_alone_nothing_false_is_claimed() {
    let s = fly(&OUTDOORS, Mode::Guaranteed, &MEASURED[0], 0.1, 3, 60);
    assert_eq!((s.inside, s.contradicted), (s.steps, 0));
    assert!(s.lost > 0);
}

/// With position alone a lost rotor shows late, with the angles at once. The guaranteed intervals of position alone are
/// too wide to show it at all, and say nothing false.
#[test]
fn the_papers_hover_finds_the_rotor_fault() {
    for (mode, angles_measured, within_s) in [
        (Mode::Paper, false, Some(2.5)),
        (Mode::Paper, true, Some(0.15)),
        (Mode::Guaranteed, true, Some(0.15)),
        (Mode::Guaranteed, false, None),
    ] {
        let settings =
            HoverSettings { mode, angles_measured, fault_s: 5.0, duration_s: 8.0, ..HoverSettings::published() };
        let run = hover(&settings);
        assert_eq!(run.false_alarms, 0, "{mode:?} {angles_measured}: {run:?}");
        if let Some(within_s) = within_s {
            let (delay, _) = run.detected.expect("a fault that is found");
            assert!(delay <= within_s, "{mode:?} {angles_measured}: {run:?}");
        }
        if mode == Mode::Guaranteed {
            assert!((run.coverage - 1.0).abs() < 1e-9, "{run:?}");
        }
    }
}

/// The distance from a beacon, measured while the body stands still within a box.
#[test]
fn nonlinear_outputs_cut_without_losing_the_truth() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let truth = [rng.random_range(1.0..3.0), rng.random_range(-1.0..1.0)];
        let hull = truth.map(|t: f64| Interval::centred(t + rng.random_range(-0.3..0.3), 0.3));
        let settings = FilterSettings {
            mode: Mode::Guaranteed,
            reduction: Reduction::Girard,
            order: 5,
            weights: SVector::repeat(1.0),
        };
        let mut filter: ZonotopicFilter<2, 16> = ZonotopicFilter::new(&hull, settings);
        let before = filter.set().frobenius_radius();
        let y = truth[0].hypot(truth[1]) + 0.01 * rng.random_range(-1.0..1.0);
        let base = *filter.set().centre();
        let range = output("range", |x| (x[0] * x[0] + x[1] * x[1]).sqrt(), &base, &hull, y, 0.01).expect("bounded");
        let mut told = [Overlap::default()];
        filter.correct(&[range], &mut told);
        assert!(told[0].touches() && filter.set().frobenius_radius() < before);
        assert!(filter.hull().iter().zip(truth).all(|(i, t)| i.contains(t)));
    }
}

fn hovering(step: i64) -> Measurement {
    let mut m = Measurement::new(
        Stamp::from_millis(20 * step),
        Imu { accel_frd_mps2: Vector3::new(0.0, 0.0, -9.80665), rate_frd_rads: Vector3::zeros() },
    );
    m.dt_s = if step > 0 { 0.02 } else { 0.0 };
    m.discontinuity = (step == 0).then_some(Discontinuity::First);
    m.attitude = Some(Aged { value: UnitQuaternion::from_euler_angles(0.0, 0.0, 3.1), age_s: 0.0 });
    m.velocity_ned_mps = Some(Aged { value: Vector3::zeros(), age_s: 0.0 });
    m.position_ned_m = Some(Aged { value: Vector3::new(5.0, 0.0, -10.0), age_s: 0.0 });
    let actuation = Actuation {
        rotors: RotorCommands { command: [0.55; MAX_ROTORS], count: 4 },
        force_frd_n: Vector3::new(0.0, 0.0, -3.0 * 9.80665),
        torque_frd_nm: Vector3::zeros(),
        sum_sqrt_thrust: 10.8,
        inflow_n_per_mps2: 0.0,
        doubt: 0.0,
        climb_mps: 0.0,
    };
    m.actuation = Some(Aged { value: actuation, age_s: 0.0 });
    m
}

fn observer(options: &[(&str, &str)]) -> Box<dyn Observer> {
    let mut o = Options::default();
    options.iter().for_each(|(k, v)| o.insert(*k, OptionValue::Text((*v).to_owned())));
    build("zonotopic_ekf", &vehicle::resolve("arducopter-sitl").unwrap(), o).unwrap()
}

#[test]
fn hover_settles_within_the_sensors_own_bounds() {
    let mut o = observer(&[]);
    for k in 0..100 {
        o.step(&hovering(k)).unwrap();
    }
    let e = o.estimate();
    assert_eq!((e.verdict, e.guarantee), (Verdict::Consistent, Guarantee::Guaranteed));
    assert!((e.values[0] - 5.0).abs() < 0.1 && (e.values[8] - 3.1).abs() < 0.01, "{e:?}");
    let noise = vehicle::resolve("arducopter-sitl").unwrap().noise;
    assert!((0..3).all(|i| e.half_widths[3 + i] <= noise.velocity_mps[i] * 1.001), "{e:?}");
    assert!((0..3).all(|i| e.half_widths[RATE + i] <= noise.gyro_rads[i] * 1.001), "{e:?}");
    assert_eq!(o.residuals().len(), STATES);
    assert!(o.residuals().iter().all(|r| r.ratio() < 1.0));
}

#[test]
fn a_contradiction_names_its_output_and_opens_its_interval() {
    let mut o = observer(&[]);
    (0..100).for_each(|k| assert!(o.step(&hovering(k)).is_ok()));
    let mut m = hovering(100);
    m.position_ned_m.as_mut().unwrap().value.x += 30.0;
    let e = o.step(&m).unwrap().clone();
    assert_eq!(e.verdict, Verdict::AssumptionViolated);
    assert!(e.residual > 1.0);
    let offending: Vec<&str> = o.residuals().iter().filter(|r| r.ratio() > 1.0).map(|r| r.name).collect();
    assert_eq!(offending, ["position_n"]);
    let (lo, hi) = (e.values[0] - e.half_widths[0], e.values[0] + e.half_widths[0]);
    assert!(lo <= 5.0 && hi >= 35.0, "{lo} to {hi}");
    // back where it was: both are still possible, and the interval shrinks again
    (101..150).for_each(|k| assert!(o.step(&hovering(k)).is_ok()));
    assert_eq!(o.estimate().verdict, Verdict::Consistent);
    assert!((o.estimate().values[0] - 5.0).abs() <= o.estimate().half_widths[0]);
    assert!(o.estimate().half_widths[0] < 3.0);
}

#[test]
fn what_is_missing_starves_and_what_is_on_the_ground_is_silent() {
    let mut o = observer(&[]);
    o.step(&hovering(0)).unwrap();
    assert_eq!(o.step(&hovering(1)).unwrap().verdict, Verdict::Settling);
    let mut blind = hovering(2);
    blind.attitude = None;
    let e = o.step(&blind).unwrap();
    assert_eq!((e.verdict, e.guarantee), (Verdict::Starved, Guarantee::None));
    assert!(e.half_widths.iter().all(|h| h.is_infinite()));
    let mut slow = hovering(3);
    slow.dt_s = 1.0;
    assert_eq!(o.step(&slow).unwrap().verdict, Verdict::Starved);
    let mut grounded = hovering(4);
    grounded.gate.in_air = Some(false);
    assert_eq!(o.step(&grounded).unwrap().verdict, Verdict::Grounded);
    assert_eq!(o.step(&hovering(5)).unwrap().verdict, Verdict::Settling);
    // without any position, position is not claimed and the rest is
    let mut o = observer(&[]);
    for k in 0..50 {
        let mut m = hovering(k);
        m.position_ned_m = None;
        o.step(&m).unwrap();
    }
    let e = o.estimate();
    assert!(e.half_widths[..3].iter().all(|h| h.is_infinite()));
    assert!(e.half_widths[3..].iter().all(|h| *h < 0.5), "{e:?}");
}

#[test]
fn options_choose_and_are_checked() {
    let mut o = observer(&[("mode", "paper"), ("outputs", "position"), ("reduction", "girard")]);
    (0..3).for_each(|k| assert!(o.step(&hovering(k)).is_ok()));
    assert_eq!(o.estimate().guarantee, Guarantee::None);
    assert_eq!(o.residuals().len(), 3);
    let mut wrong = Options::default();
    wrong.insert("mode", OptionValue::Text("published".to_owned()));
    let vehicle = vehicle::resolve("arducopter-sitl").unwrap();
    let Err(e) = build("zonotopic_ekf", &vehicle, wrong) else { panic!("no such mode") };
    let cause = std::iter::successors(Some(&e as &dyn std::error::Error), |e| e.source()).map(|e| e.to_string());
    assert!(cause.collect::<String>().contains("guaranteed, paper"));
}
