//! The simulator against the real thing: ArduCopter's own simulator, recorded in flight.
//!
//! The recording is not part of this repository: it is looked for in `$MAVOBSERVER_DATA` or `../shared/data`.

use mavobserver::sim::control::Leg;
use mavobserver::sim::feed::MavlinkGeneration;
use mavobserver::sim::profile::Profile;
use mavobserver::sim::scenario;
use mavobserver::sim::sensors::SensorSuite;
use mavobserver::sim::{FlightPlan, Run, RunOptions, SimVehicle, wind_from};
use mavobserver::vehicle::resolve;
use mavobserver::wire::dialect::ardupilotmega::{ATTITUDE_DATA, RAW_IMU_DATA};
use mavobserver::wire::tlog::TlogReader;
use mavobserver::wire::{Event, FrameRef, Parser, decode, message_info};
use nalgebra::{Vector2, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn recorded(name: &str) -> Option<PathBuf> {
    let base = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let file = base.join("sitl").join(name);
    if !file.is_file() {
        eprintln!("SKIPPED: {} is not here; set MAVOBSERVER_DATA", file.display());
        return None;
    }
    Some(file)
}

fn frames(log: &Path, mut see: impl FnMut(u64, FrameRef<'_>)) {
    let mut reader = TlogReader::open(log).unwrap();
    while let Some(record) = reader.next().unwrap() {
        if let Event::Frame(frame) = record.event
            && frame.component_id() == 1
        {
            see(record.received_unix_us.unwrap_or(0), frame);
        }
    }
}

/// Specific force in level axes turned to north and east by the heading alone, m/s².
fn levelled(accel: Vector3<f64>, heading_rad: f64) -> Vector3<f64> {
    let ahead = Vector2::new(heading_rad.cos(), heading_rad.sin());
    let right = Vector2::new(-ahead.y, ahead.x);
    let level = ahead * accel.x + right * accel.y;
    Vector3::new(level.x, level.y, accel.z)
}

/// Mean of what falls into a span of boot time.
#[derive(Default)]
struct Mean {
    sum: Vector3<f64>,
    n: f64,
}

impl Mean {
    fn add(&mut self, x: Vector3<f64>) {
        self.sum += x;
        self.n += 1.0;
    }

    fn get(&self) -> Vector3<f64> {
        self.sum / self.n
    }
}

/// Settled spans of the recording, boot s: three winds in hover, then 5 m/s east in the last of them.
const SPANS: [(&str, f64, f64); 4] = [
    ("hover, 3 m/s from 45°", 88.0, 99.0),
    ("hover, 8 m/s from 270°", 110.0, 121.0),
    ("hover, 5 m/s from 120°", 132.0, 143.0),
    ("5 m/s east, wind 5 m/s from 120°", 163.0, 166.4),
];

#[test]
fn flown_through_the_same_wind_it_feels_the_same_accelerations() {
    let Some(log) = recorded("wind_dev.tlog") else { return };
    let mut measured: [Mean; 4] = Default::default();
    let mut heading = 0.0;
    frames(&log, |_, frame| {
        if let Some(a) = decode::<ATTITUDE_DATA>(frame) {
            heading = f64::from(a.yaw);
        } else if let Some(m) = decode::<RAW_IMU_DATA>(frame) {
            let t = m.time_usec as f64 * 1e-6;
            let accel = Vector3::new(m.xacc, m.yacc, m.zacc).map(|x| f64::from(x) * 9.80665e-3);
            for (mean, (_, from, to)) in measured.iter_mut().zip(SPANS) {
                if from < t && t < to {
                    mean.add(levelled(accel, heading));
                }
            }
        }
    });

    let vehicle = resolve("arducopter-sitl").unwrap();
    let wind = |t, from: f64, speed| (t, wind_from(from.to_radians(), speed));
    let steps = [wind(77.4, 45.0, 3.0), wind(99.4, 270.0, 8.0), wind(121.5, 120.0, 5.0)];
    let plan = FlightPlan {
        sensors: SensorSuite::perfect(&vehicle),
        battery: None,
        wind: Profile::steps(&steps, 1.5),
        mission: vec![
            Leg::Wait { seconds: 42.7 },
            Leg::Takeoff { height_m: 25.0 },
            Leg::Hover { seconds: 90.0 },
            Leg::Turn { heading_rad: 1.556 },
            Leg::Velocity { velocity_ned_mps: Vector3::new(0.0, 5.14, 0.0), seconds: 15.0 },
        ],
        ..FlightPlan::calm(vehicle, 1)
    };
    let mut sim = SimVehicle::new(&plan).unwrap();
    let mut flown: [Mean; 4] = Default::default();
    let mut last: Vec<Vector3<f64>> = Vec::new();
    while !sim.mission_done() {
        let truth = sim.advance().truth;
        let t = truth.stamp.secs();
        let accel = levelled(truth.specific_force_frd_mps2, truth.body_to_ned.euler_angles().2);
        for (mean, (_, from, to)) in flown.iter_mut().zip(SPANS).take(3) {
            if from < t && t < to {
                mean.add(accel);
            }
        }
        last.push(accel);
    }
    // the leg east: its last three seconds
    last.iter().rev().take(1200).for_each(|a| flown[3].add(*a));

    for ((name, ..), (recorded, simulated)) in SPANS.iter().zip(measured.iter().zip(&flown)) {
        let (r, s) = (recorded.get(), simulated.get());
        let error = (s - r).norm() / r.xy().norm();
        println!(
            "{name:34} recorded {:6.3} {:6.3} {:7.3}   simulated {:6.3} {:6.3} {:7.3} m/s²   off by {:.1} %",
            r.x,
            r.y,
            r.z,
            s.x,
            s.y,
            s.z,
            error * 100.0
        );
        assert!(error < 0.05, "{name}: {r} against {s}");
    }
}

/// What can be said of one stream from its frames.
#[derive(Default)]
struct Stream {
    count: u32,
    first_us: u64,
    last_us: u64,
    stamps: Vec<f64>,
    /// RAW_IMU: accelerometer (mG) and gyro (mrad/s) along x.
    noise: [Vec<f64>; 2],
}

impl Stream {
    fn see(&mut self, at_us: u64, frame: FrameRef<'_>) {
        if self.count == 0 {
            self.first_us = at_us;
        }
        self.count += 1;
        self.last_us = at_us;
        let f = frame.fields();
        // boot stamps as the message carries them, ms
        let stamp = match frame.message_id() {
            30 | 31 | 32 | 33 | 116 | 29 => Some(f64::from(f.u32(0))),
            27 | 105 => Some(f.u64(0) as f64 * 1e-3),
            36 => Some(f64::from(f.u32(0)) * 1e-3),
            _ => None,
        };
        self.stamps.extend(stamp);
        if let Some(m) = decode::<RAW_IMU_DATA>(frame) {
            for (series, value) in self.noise.iter_mut().zip([m.xacc, m.xgyro]) {
                series.push(value.into());
            }
        }
    }

    fn hz(&self) -> f64 {
        f64::from(self.count - 1) / ((self.last_us - self.first_us) as f64 * 1e-6)
    }

    /// Median step between stamps, ms.
    fn stamp_step(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.stamps.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    }
}

#[test]
fn streams_have_the_recorded_rates_stamps_and_quantisation() {
    let Some(log) = recorded("wind_dev.tlog") else { return };
    let mut theirs: BTreeMap<u32, Stream> = BTreeMap::new();
    // the calm hover, eleven seconds of it
    let mut start = None;
    frames(&log, |at, frame| {
        let start = *start.get_or_insert(at);
        if (64e6..75e6).contains(&((at - start) as f64)) {
            theirs.entry(frame.message_id()).or_default().see(at, frame);
        }
    });

    let mut scenario = scenario::resolve("wind-steps").unwrap();
    scenario.streams = [
        ("ATTITUDE", 50.0),
        ("ATTITUDE_QUATERNION", 50.0),
        ("LOCAL_POSITION_NED", 50.0),
        ("RAW_IMU", 50.0),
        ("HIGHRES_IMU", 50.0),
        ("SERVO_OUTPUT_RAW", 50.0),
        ("SIMSTATE", 50.0),
        ("SIM_STATE", 50.0),
        ("SCALED_IMU2", 10.0),
        ("SCALED_PRESSURE", 10.0),
        ("GLOBAL_POSITION_INT", 10.0),
        ("ESC_TELEMETRY_1_TO_4", 10.0),
        ("RPM", 10.0),
        ("VFR_HUD", 10.0),
        ("GPS_RAW_INT", 5.0),
        ("WIND", 5.0),
        ("EKF_STATUS_REPORT", 5.0),
        ("BATTERY_STATUS", 5.0),
        ("SYS_STATUS", 2.0),
        ("SYSTEM_TIME", 2.0),
        ("EXTENDED_SYS_STATE", 2.0),
    ]
    .map(|(name, hz)| (name.to_owned(), hz))
    .into();
    let options = RunOptions { generation: MavlinkGeneration::V2, ..RunOptions::default() };
    let mut run = Run::new(&scenario, &options).unwrap();
    let mut ours: BTreeMap<u32, Stream> = BTreeMap::new();
    let mut parser = Parser::new();
    while run.now_s() < 33.0 {
        let hovering = (22.0..33.0).contains(&run.now_s());
        run.advance(&mut |received| {
            parser.push(received.bytes);
            while let Some(event) = parser.next() {
                if let (Event::Frame(frame), true) = (event, hovering) {
                    ours.entry(frame.message_id()).or_default().see(received.unix_us, frame);
                }
            }
        });
    }

    println!("{:22} {:>9} {:>9} {:>22}", "", "recorded", "simulated", "stamp step, ms");
    for (id, our) in &ours {
        let name = message_info(*id).map_or("?", |i| i.name);
        let Some(their) = theirs.get(id).filter(|s| s.count > 2) else { continue };
        let steps = their.stamp_step().zip(our.stamp_step());
        let text = steps.map_or(String::new(), |(a, b)| format!("{a:10.3} {b:10.3}"));
        println!("{name:22} {:6.2} Hz {:6.2} Hz  {text}", their.hz(), our.hz());
        // what was received with up to 76 ms of jitter gives its rate to about 1 %
        assert!((our.hz() / their.hz() - 1.0).abs() < 0.015, "{name}");
        if let Some((a, b)) = steps {
            assert!((a - b).abs() < 0.0005 * b + 0.01, "{name}: {a} against {b} ms");
        }
    }
    assert!(ours.len() >= 20, "{} streams", ours.len());

    // whole milli-g and mrad/s, with as much noise
    let (their, our) = (&theirs[&27], &ours[&27]);
    for (what, (a, b)) in ["accelerometer x, mG", "gyro x, mrad/s"].iter().zip(their.noise.iter().zip(&our.noise)) {
        let (a, b) = (sigma(a), sigma(b));
        println!("{what:22} σ recorded {a:.2}, simulated {b:.2}");
        assert!((0.5..2.0).contains(&(b / a)), "{what}: σ {a} against {b}");
    }
}

fn sigma(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}
