//! Every kind of fault, written in a scenario, shows in the telemetry while it lasts.

use super::*;
use crate::document::Document;
use crate::sim::{Run, RunOptions};
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Event, FrameRef, Parser, decode};
use std::path::Path;

/// Finds a number in the frames of one message.
type Read = fn(FrameRef<'_>) -> Option<f64>;

const FROM_S: f64 = 16.0;
const UNTIL_S: f64 = 19.0;

/// A hover on sensors without noise, with one fault from 16 to 19 s, as (time, what `read` finds in a frame).
fn hover(fault: &str, read: Read) -> Vec<(f64, f64)> {
    hover_until(UNTIL_S, fault, read)
}

/// The same with a fault that lasts until `until_s`, and three seconds more.
fn hover_until(until_s: f64, fault: &str, read: Read) -> Vec<(f64, f64)> {
    let text = format!(
        "name = 'x'\nvehicle = 'arducopter-sitl'\nduration_s = {}\nsensors = 'perfect'\n\
         mission = [{{ leg = 'takeoff', height_m = 6 }}, {{ leg = 'hover', seconds = 60 }}]\n\
         [streams]\nRAW_IMU = 50\nSCALED_IMU2 = 50\nSCALED_PRESSURE = 50\nGPS_RAW_INT = 20\nSERVO_OUTPUT_RAW = 50\n\
         ESC_TELEMETRY_1_TO_4 = 50\n[[fault]]\nfrom_s = {FROM_S}\nuntil_s = {until_s}\n{fault}",
        until_s + 3.0
    );
    let scenario = parse(&Document::new("x.toml", text), Path::new("")).unwrap();
    let mut run = Run::new(&scenario, &RunOptions::default()).unwrap();
    let (mut parser, mut series) = (Parser::new(), Vec::new());
    while !run.done() {
        let now = run.now_s();
        run.advance(&mut |received| {
            parser.push(received.bytes);
            while let Some(event) = parser.next() {
                if let Event::Frame(frame) = event {
                    series.extend(read(frame).map(|value| (now, value)));
                }
            }
        });
    }
    series
}

/// Mean and standard deviation of what lies between two times, and how many that are.
fn figures(series: &[(f64, f64)], from_s: f64, until_s: f64) -> (f64, f64, f64) {
    let within: Vec<f64> = series.iter().filter(|(t, _)| (from_s..until_s).contains(t)).map(|(_, v)| *v).collect();
    let n = within.len() as f64;
    let mean = within.iter().sum::<f64>() / n;
    (mean, (within.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt(), n)
}

/// What changes soon after the onset, against what was before: difference of the means, both deviations, both counts.
fn change(fault: &str, read: Read) -> (f64, [f64; 2], [f64; 2]) {
    let series = hover(fault, read);
    let (before, after) = (figures(&series, 13.0, 16.0), figures(&series, 16.3, 17.0));
    (after.0 - before.0, [before.1, after.1], [before.2 / 3.0, after.2 / 0.7])
}

fn second_accel(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::SCALED_IMU2_DATA>(frame).map(|m| m.xacc.into())
}

fn second_gyro(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::SCALED_IMU2_DATA>(frame).map(|m| m.xgyro.into())
}

fn mag_down(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::RAW_IMU_DATA>(frame).map(|m| m.zmag.into())
}

fn pressure_hpa(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::SCALED_PRESSURE_DATA>(frame).map(|m| m.press_abs.into())
}

fn north_e7(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::GPS_RAW_INT_DATA>(frame).map(|m| m.lat.into())
}

fn rpm_2(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::ESC_TELEMETRY_1_TO_4_DATA>(frame).map(|m| m.rpm[1].into())
}

fn pulse_2(frame: FrameRef<'_>) -> Option<f64> {
    decode::<mav::SERVO_OUTPUT_RAW_DATA>(frame).map(|m| m.servo2_raw.into())
}

fn pulse(frame: FrameRef<'_>) -> Option<f64> {
    let m = decode::<mav::SERVO_OUTPUT_RAW_DATA>(frame)?;
    Some([m.servo1_raw, m.servo2_raw, m.servo3_raw, m.servo4_raw].map(f64::from).iter().sum::<f64>() / 4.0)
}

#[test]
fn biases_and_shifts_have_the_size_that_was_written() {
    // 0.5 m/s² are 51 mG; 60 Pa 0.6 hPa; 10 m north 898 units of 1e-7°
    let cases: [(&str, Read, f64, f64); 5] = [
        ("kind = 'accel_bias'\nimu = 2\nbias_mps2 = [0.5, 0, 0]", second_accel, 51.0, 2.0),
        ("kind = 'gyro_bias'\nimu = 2\nbias_rads = [0.05, 0, 0]", second_gyro, 50.0, 2.0),
        ("kind = 'mag_bias'\nbias_gauss = [0, 0, 0.15]", mag_down, 150.0, 2.0),
        ("kind = 'baro_bias'\nbias_pa = 60", pressure_hpa, 0.6, 0.1),
        ("kind = 'gnss_step'\nshift_ned_m = [10, 0, 0]", north_e7, 898.0, 60.0),
    ];
    for (fault, read, size, room) in cases {
        let (shift, ..) = change(fault, read);
        println!("{fault}: {shift:.2}");
        assert!((shift - size).abs() < room, "{fault}: {shift} against {size}");
    }
    // .5 m/s for half a second, in the middle of the stretch that is looked at
    let (shift, ..) = change("kind = 'gnss_ramp'\nspeed_ned_mps = [0.5, 0, 0]", north_e7);
    assert!((10.0..60.0).contains(&shift), "{shift}");
}

#[test]
fn noise_and_standstill_show_in_the_spread() {
    for (fault, read, sigma) in [
        ("kind = 'accel_noise'\nimu = 2\nsigma_mps2 = 0.5", second_accel as Read, 51.0),
        ("kind = 'gyro_noise'\nimu = 2\nsigma_rads = 0.1", second_gyro, 100.0),
        ("kind = 'mag_noise'\nsigma_gauss = 0.05", mag_down, 50.0),
        ("kind = 'baro_noise'\nsigma_pa = 50", pressure_hpa, 0.5),
    ] {
        let (_, [before, during], _) = change(fault, read);
        println!("{fault}: {before:.2} to {during:.2}");
        // filtered by the sensor's own delay, so less than the number written
        assert!(during > 4.0 * before && (0.3..1.4).contains(&(during / sigma)), "{fault}: {before} to {during}");
    }
    for (fault, read) in [
        ("kind = 'accel_frozen'\nimu = 2", second_accel as Read),
        ("kind = 'gyro_frozen'\nimu = 2", second_gyro),
        ("kind = 'mag_frozen'", mag_down),
        ("kind = 'baro_frozen'", pressure_hpa),
    ] {
        let (_, [_, during], _) = change(fault, read);
        assert_eq!(during, 0.0, "{fault}");
    }
}

#[test]
fn rotors_and_payload_show_in_speeds_and_commands() {
    // half the command is .5125 of full speed, squared at .35·.5 + .65·.25 = .3375
    let stuck = hover("kind = 'rotor_stuck'\nrotor = 2\ncommand = 0.5", rpm_2);
    let (mean, spread, _) = figures(&stuck, 16.3, 16.6);
    let full = 1109.0 * 60.0 / std::f64::consts::TAU;
    assert!((mean / (full * 0.3375_f64.sqrt()) - 1.0).abs() < 0.03 && spread < 60.0, "{mean} ± {spread}");
    // the autopilot makes up for either: a weak motor takes a higher command to the same speed, a damaged propeller turns
    // faster
    let (weak, damaged) =
        ("kind = 'rotor_weak'\nrotor = 2\nshare = 0.7", "kind = 'rotor_damaged'\nrotor = 2\nshare = 0.7");
    assert!(change(weak, pulse_2).0 > 50.0 && change(weak, rpm_2).0.abs() < 200.0);
    assert!(change(damaged, pulse_2).0 > 50.0 && change(damaged, rpm_2).0 > 1000.0);
    // 3.5 kg in place of 3.0: .455 of full thrust in place of .39, once the height has been regained
    let lifted = hover_until(28.0, "kind = 'payload'\nmass_kg = 0.5\nposition_frd_m = [0.0, 0.0, 0.1]", pulse);
    let [before, with] = [(13.0, 16.0), (24.0, 28.0)].map(|(a, b)| figures(&lifted, a, b).0);
    let command = |share: f64| (-0.35 + (0.35_f64.powi(2) + 2.6 * share).sqrt()) / 1.3;
    let expected = 800.0 * (command(0.455) - command(0.39));
    assert!(((with - before) / expected - 1.0).abs() < 0.15, "{before} to {with} µs, expected {expected} more");
    let dropped = figures(&lifted, 28.2, 29.0).0;
    assert!(
        dropped < with - 0.5 * expected,
        "relieved of its load it rises, and the autopilot takes back thrust: {dropped}"
    );
}

#[test]
fn a_lost_link_and_lost_satellites_leave_gaps() {
    let (_, _, [before, during]) = change("kind = 'link'\nloss = 0.5", pulse);
    assert!((before - 50.0).abs() < 1.0 && (12.0..38.0).contains(&during), "{before} to {during} Hz");
    let (_, _, [_, dead]) = change("kind = 'link'\nloss = 1", pulse);
    assert_eq!(dead, 0.0);
    let satellites = |frame: FrameRef<'_>| decode::<mav::GPS_RAW_INT_DATA>(frame).map(|m| m.fix_type as u8 as f64);
    let lost = hover("kind = 'gnss_lost'", satellites);
    // a receiver that hears nothing says so two seconds later
    assert!(figures(&lost, 18.5, 19.0).0 < 2.0 && figures(&lost, 20.0, 22.0).0 >= 3.0);
}
