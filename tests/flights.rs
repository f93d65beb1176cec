//! The whole offline chain on recorded flights, held against their truth.
//!
//! The flights are not part of this repository: they are looked for in `$MAVOBSERVER_DATA` or `../shared/data`.

use mavobserver::pipeline::{Event, Fleet, FleetSettings, ObserverSetting};
use mavobserver::signal::Verdict;
use mavobserver::vehicle;
use mavobserver::wire::tlog::TlogReader;
use mavobserver::wire::{self, FrameRef};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn data(file: &str) -> Option<PathBuf> {
    let root = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(file);
    if !path.exists() {
        eprintln!("SKIPPED: no {} (set MAVOBSERVER_DATA)", path.display());
        return None;
    }
    Some(path)
}

/// One estimate: boot time, wind with half-widths, force and torque with half-widths.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    t: f64,
    wind: Option<[f64; 6]>,
    wrench: Option<[f64; 12]>,
}

fn replay(log: &Path, preset: &str, keep: impl Fn(FrameRef<'_>) -> bool) -> Vec<Row> {
    let model = Arc::new(vehicle::resolve(preset).expect("a preset"));
    let mut fleet = Fleet::new(FleetSettings::standard(model)).expect("designs");
    let mut reader = TlogReader::open(log).expect("a log");
    let mut rows = Vec::new();
    while let Some(record) = reader.next().expect("readable") {
        let wire::Event::Frame(frame) = record.event else { continue };
        if !keep(frame) {
            continue;
        }
        fleet.frame(frame, record.received_unix_us.unwrap_or(0), &mut |event| {
            if let Event::Snapshot(s, _) = event {
                let six = |a: nalgebra::Vector3<f64>, b: nalgebra::Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
                rows.push(Row {
                    t: s.stamp.secs(),
                    wind: s.wind.map(|w| six(w.velocity_ned_mps, w.half_width_mps)),
                    wrench: s.wrench.map(|w| {
                        let f = six(w.force_ned_n, w.force_half_width_n);
                        let q = six(w.torque_frd_nm, w.torque_half_width_nm);
                        std::array::from_fn(|i| if i < 6 { f[i] } else { q[i - 6] })
                    }),
                });
            }
        });
    }
    rows
}

/// The columns of a CSV file with a header, as numbers where they are.
fn csv(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect("readable");
    text.lines().skip(1).map(|l| l.splitn(4, ',').map(str::to_owned).collect()).collect()
}

struct Truth {
    /// Boot time, wind north, wind east.
    wind: Vec<[f64; 3]>,
    /// When the wind was changed.
    changes: Vec<f64>,
    hover: f64,
    end: f64,
}

impl Truth {
    fn of(log: &Path) -> Self {
        let wind = csv(&log.with_extension("wind_truth.csv"))
            .iter()
            .map(|r| {
                let [_, ms, from, speed] = r.as_slice() else { panic!("four columns") };
                let (s, c) = from.parse::<f64>().expect("degrees").to_radians().sin_cos();
                let speed: f64 = speed.parse().expect("a speed");
                [ms.parse::<f64>().expect("ms") / 1e3, -speed * c, -speed * s]
            })
            .collect();
        let (mut changes, mut hover, mut end) = (Vec::new(), 0.0, f64::INFINITY);
        for e in csv(&log.with_extension("events.csv")) {
            let t: f64 = e[1].parse::<f64>().expect("ms") / 1e3;
            match (e[2].as_str(), e[3].as_str()) {
                ("hover", _) => hover = t,
                ("param", d) if d.starts_with("SIM_WIND") || d.starts_with("SIH_WIND") => changes.push(t),
                ("mode", "9" | "LAND") | ("end", _) if t > hover && hover > 0.0 => end = end.min(t),
                _ => {}
            }
        }
        Self { wind, changes, hover, end }
    }

    fn at(&self, t: f64) -> Option<[f64; 2]> {
        let i = self.wind.partition_point(|w| w[0] < t);
        (i > 0).then(|| self.wind.get(i).map(|w| [w[1], w[2]])).flatten()
    }
}

struct Score {
    steady_rmse: f64,
    speed_rmse: f64,
    direction_rmse_deg: f64,
    coverage: f64,
    half_width: f64,
    share_with_wind: f64,
}

fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt()
}

/// Steady means at least 5 s after the last change of wind.
fn score(rows: &[Row], truth: &Truth) -> Score {
    let (mut vector, mut speed, mut direction, mut inside, mut width) = (vec![], vec![], vec![], vec![], vec![]);
    let mut steps = 0;
    for r in rows.iter().filter(|r| (truth.hover..truth.end).contains(&r.t)) {
        let Some([n, e]) = truth.at(r.t) else { continue };
        steps += 1;
        let Some(w) = r.wind else { continue };
        inside.push(f64::from((w[0] - n).abs() <= w[3] && (w[1] - e).abs() <= w[4]));
        width.push(0.5 * (w[3] + w[4]));
        if truth.changes.iter().any(|c| (0.0..5.0).contains(&(r.t - c))) {
            continue;
        }
        vector.push((w[0] - n).hypot(w[1] - e));
        speed.push(w[0].hypot(w[1]) - n.hypot(e));
        if n.hypot(e) > 2.0 {
            let turn = w[1].atan2(w[0]) - e.atan2(n);
            direction.push((turn.to_degrees() + 180.0).rem_euclid(360.0) - 180.0);
        }
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    Score {
        steady_rmse: rms(&vector),
        speed_rmse: rms(&speed),
        direction_rmse_deg: rms(&direction),
        coverage: mean(&inside),
        half_width: mean(&width),
        share_with_wind: inside.len() as f64 / f64::from(steps),
    }
}

#[test]
fn wind_of_a_simulated_copter() {
    let Some(log) = data("sitl/wind_dev.tlog") else { return };
    let s = score(&replay(&log, "arducopter-sitl", |_| true), &Truth::of(&log));
    assert!(s.steady_rmse <= 0.1, "steady RMSE {} m/s", s.steady_rmse);
    assert!(s.direction_rmse_deg <= 1.0, "direction RMSE {}°", s.direction_rmse_deg);
    assert!(s.coverage >= 0.999, "coverage {}", s.coverage);
    assert!(s.half_width <= 0.8, "mean half-width {} m/s", s.half_width);
    assert!(s.share_with_wind >= 0.98, "share {}", s.share_with_wind);
}

#[test]
fn wind_of_a_simulated_px4_copter_whose_heading_is_off() {
    let Some(log) = data("px4/wind_dev.tlog") else { return };
    let s = score(&replay(&log, "px4-sih", |_| true), &Truth::of(&log));
    assert!(s.speed_rmse <= 0.26, "speed RMSE {} m/s", s.speed_rmse);
    // with the autopilot's heading it is 8.4°
    assert!(s.direction_rmse_deg <= 5.0, "direction RMSE {}°", s.direction_rmse_deg);
    assert!(s.coverage >= 0.999, "coverage {}", s.coverage);
}

/// Simulators stream their truth and autopilots their own wind beside the telemetry: an observer that saw any of it
/// would be judged against itself.
#[test]
fn truth_and_the_autopilots_wind_change_nothing() {
    // SIMSTATE, SIM_STATE, HIL_STATE_QUATERNION, WIND, WIND_COV
    const HIDDEN: [u32; 5] = [164, 108, 115, 168, 231];
    for (file, preset) in [("sitl/default_streams.tlog", "arducopter-sitl"), ("px4/default_streams.tlog", "px4-sih")] {
        let Some(log) = data(file) else { return };
        let all = replay(&log, preset, |_| true);
        let blind = replay(&log, preset, |f| !HIDDEN.contains(&f.message_id()));
        assert!(!all.is_empty());
        assert!(all == blind, "{file}: estimates depend on the truth");
    }
}

/// Known pulses of force (body acceleration times 3 kg) and torque (angular acceleration times inertia), estimated over
/// their second half.
#[test]
fn known_forces_and_torques_are_found() {
    const PULSES: [(f64, f64, usize, f64); 3] =
        [(74.084, 4.0, 2, 3.0), (106.324, 0.5, 6, 0.2297), (121.484, 1.5, 8, 0.2297)];
    let Some(log) = data("sitl/force_dev.tlog") else { return };
    let rows = replay(&log, "arducopter-sitl", |_| true);
    for (begin, duration, at, size) in PULSES {
        let during: Vec<f64> = rows
            .iter()
            .filter(|r| (begin + 0.5 * duration..begin + duration).contains(&r.t))
            .filter_map(|r| r.wrench.map(|w| w[at]))
            .collect();
        let mean = during.iter().sum::<f64>() / during.len() as f64;
        assert!((mean - size).abs() <= 0.05 * size, "pulse at {begin} s: {mean} instead of {size}");
    }
}

/// Old, damaged, foreign and empty links: each replays to its end, and says nothing where there is nothing to say.
#[test]
fn every_real_log_replays() {
    let expected_silent = ["ardusub_pymavlink_bug", "eaics", "crate_mavlink_log", "marslab_mav"];
    for name in [
        "phoenix_m1",
        "ardusub_pymavlink_bug",
        "eaics",
        "magfit",
        "sitl_uavsysid_mav",
        "crate_mavlink_log",
        "marslab_mav",
    ] {
        let Some(log) = data(&format!("real/{name}.tlog")) else { return };
        let rows = replay(&log, "arducopter-sitl", |_| true);
        let finite = |x: &[f64]| x.iter().all(|v| !v.is_nan());
        assert!(
            rows.iter().all(|r| r.wind.is_none_or(|w| finite(&w)) && r.wrench.is_none_or(|w| finite(&w))),
            "{name}"
        );
        if expected_silent.contains(&name) {
            assert!(rows.is_empty(), "{name} holds no multirotor in flight");
        }
    }
}

/// Body rates without the gyro: error against `truth` (time, rate) per axis, °/s RMSE, and the share within the bound.
fn gyro_free(
    log: &Path,
    preset: &str,
    truth: impl Fn(f64, nalgebra::Vector3<f64>) -> Option<[f64; 3]>,
) -> ([f64; 3], f64) {
    let vehicle = Arc::new(vehicle::resolve(preset).expect("a preset"));
    let observers = vec![ObserverSetting::named("fuzzy_polynomial")];
    let mut fleet = Fleet::new(FleetSettings { observers, ..FleetSettings::standard(vehicle) }).expect("designs");
    let mut reader = TlogReader::open(log).expect("a log");
    let (mut squares, mut inside, mut count) = ([0.0; 3], 0_u32, 0_u32);
    while let Some(record) = reader.next().expect("readable") {
        let wire::Event::Frame(frame) = record.event else { continue };
        fleet.frame(frame, record.received_unix_us.unwrap_or(0), &mut |event| {
            let Event::Snapshot(s, m) = event else { return };
            let Some(o) = s.observers.iter().find(|o| o.name == "fuzzy_polynomial") else { return };
            if !matches!(o.estimate.verdict, Verdict::Consistent | Verdict::AssumptionViolated) {
                return;
            }
            let Some(rate) = truth(s.stamp.secs(), m.imu.rate_frd_rads) else { return };
            for i in 0..3 {
                let error = o.estimate.values[i] - rate[i];
                squares[i] += error * error;
                inside += u32::from(error.abs() <= o.estimate.half_widths[i]);
            }
            count += 1;
        });
    }
    assert!(count > 1000, "only {count} estimates");
    let rmse = squares.map(|s: f64| (s / f64::from(count)).sqrt().to_degrees());
    let share = f64::from(inside) / f64::from(3 * count);
    println!("{}: {rmse:.2?} °/s RMSE, {share:.3} inside, {count} steps", log.display());
    (rmse, share)
}

#[test]
fn rates_without_the_gyro_on_a_simulated_copter() {
    // the gyro of this simulator is nearly perfect: it is the truth, and the observer never sees it
    let Some(log) = data("sitl/wind_dev.tlog") else { return };
    let (rmse, share) = gyro_free(&log, "arducopter-sitl", |_, gyro| Some(gyro.into()));
    assert!(rmse.iter().all(|e| *e <= 6.0), "{rmse:?} °/s");
    assert!(share >= 0.9, "{share} inside the bound of 95 %");
}

#[test]
fn rates_without_the_gyro_on_a_simulated_px4_copter() {
    let Some(log) = data("px4/wind_dev.tlog") else { return };
    let text = std::fs::read_to_string(log.with_extension("truth.csv")).expect("readable");
    let rates: Vec<[f64; 4]> = text
        .lines()
        .skip(1)
        .filter_map(|l| {
            let cells: Vec<f64> = l.split(',').map_while(|c| c.parse().ok()).collect();
            Some([cells.first()? / 1e3, *cells.get(5)?, *cells.get(6)?, *cells.get(7)?])
        })
        .collect();
    let at = |t: f64, _| {
        let k = rates.partition_point(|r| r[0] < t);
        let (a, b) = (rates.get(k.checked_sub(1)?)?, rates.get(k)?);
        let share = (t - a[0]) / (b[0] - a[0]);
        (b[0] - a[0] < 0.1).then(|| std::array::from_fn(|i| a[i + 1] + share * (b[i + 1] - a[i + 1])))
    };
    let (rmse, share) = gyro_free(&log, "px4-sih", at);
    assert!(rmse.iter().all(|e| *e <= 6.0), "{rmse:?} °/s");
    assert!(share >= 0.9, "{share} inside the bound of 95 %");
}
