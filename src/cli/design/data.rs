//! Recorded experiments for the methodology of Pitarch and Sala: a CSV file, or a flight.

use crate::cli::Failure;
use crate::observers::fuzzy_polynomial::Record;
use crate::pipeline::{Event, Fleet, FleetSettings};
use crate::signal::Measurement;
use crate::vehicle::{self, Vehicle};
use crate::wire;
use crate::wire::tlog::TlogReader;
use nalgebra::{UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Attitudes further apart than this begin a new piece, s.
const LONGEST_GAP_S: f64 = 0.2;

/// One sample of an experiment at its own time.
#[derive(Debug, Clone, Copy)]
struct Point {
    t_s: f64,
    angles: [f64; 3],
    inputs: [f64; 3],
    momentum: f64,
    speeds: Option<[f64; 3]>,
}

/// Reads an experiment and brings it to the design's sample time. `vehicle` is for flights.
pub fn read(path: &Path, vehicle: Option<&str>, dt_s: f64) -> Result<Record, Failure> {
    let name = path.display();
    let points = match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => csv(path)?,
        Some("tlog") => {
            let needs = || Failure::Usage(format!("{name} is a flight: say whose with --plant"));
            flight(path, &Arc::new(vehicle::resolve(vehicle.ok_or_else(needs)?)?))?
        }
        _ => return Err(Failure::Usage(format!("--data {name}: expected a .tlog or .csv file"))),
    };
    resampled(&points, dt_s).map_err(|e| Failure::Failed(format!("{name}: {e}")))
}

fn csv(path: &Path) -> Result<Vec<Point>, Failure> {
    let failed = |why: String| Failure::Failed(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?;
    let mut points = Vec::new();
    for (k, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<Option<f64>> = line.split(',').map(|c| c.trim().parse().ok()).collect();
        match cells.iter().copied().collect::<Option<Vec<f64>>>().as_deref() {
            Some([t_s, a, b, c, u, v, w, momentum, rest @ ..]) if rest.len() == 3 || rest.is_empty() => {
                let speeds = <[f64; 3]>::try_from(rest).ok();
                points.push(Point {
                    t_s: *t_s,
                    angles: [*a, *b, *c],
                    inputs: [*u, *v, *w],
                    momentum: *momentum,
                    speeds,
                });
            }
            // the first line may name the columns
            None if k == 0 => {}
            _ => return Err(failed(format!("line {}: expected 8 or 11 numbers between commas", k + 1))),
        }
    }
    Ok(points)
}

/// The longest unbroken piece of a flight, in the air.
fn flight(path: &Path, vehicle: &Arc<Vehicle>) -> Result<Vec<Point>, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Failed(format!("{}: {e}", path.display()));
    let settings = FleetSettings { observers: Vec::new(), ..FleetSettings::standard(Arc::clone(vehicle)) };
    let mut fleet = Fleet::new(settings).map_err(|e| failed(&e))?;
    let mut reader = TlogReader::open(path).map_err(|e| failed(&e))?;
    let (mut piece, mut longest) = (Piece::default(), Vec::new());
    while let Some(record) = reader.next().map_err(|e| failed(&e))? {
        let wire::Event::Frame(frame) = record.event else { continue };
        fleet.frame(frame, record.received_unix_us.unwrap_or(0), &mut |event| {
            if let Event::Snapshot(_, m) = event
                && let Some(done) = piece.take(m, vehicle)
                && done.len() > longest.len()
            {
                longest = done;
            }
        });
    }
    Ok(if piece.points.len() > longest.len() { piece.points } else { longest })
}

/// A piece of a flight while it is read.
#[derive(Default)]
struct Piece {
    points: Vec<Point>,
    last: Option<UnitQuaternion<f64>>,
    angles: Vector3<f64>,
}

impl Piece {
    /// Takes in a measurement; gives the piece before it when it begins a new one.
    fn take(&mut self, m: &Measurement, vehicle: &Vehicle) -> Option<Vec<Point>> {
        let t_s = m.stamp.secs();
        // an attitude of positive age was carried here by the gyro
        let seen = m.attitude.filter(|q| q.age_s <= 0.0).zip(m.actuation).filter(|_| m.gate.may_fly());
        let gap = self.points.last().is_some_and(|p| t_s - p.t_s > LONGEST_GAP_S);
        let done = (gap || m.discontinuity.is_some()).then(|| std::mem::take(self).points);
        if let Some((q, actuation)) = seen {
            // the turn about the body's axes, summed: its derivative is the body rate
            self.angles += self.last.map_or(Vector3::zeros(), |l| (l.inverse() * q.value).scaled_axis());
            self.last = Some(q.value);
            let torque = actuation.value.torque_frd_nm;
            let inputs = std::array::from_fn(|i| torque[i] / vehicle.inertia_kgm2[(i, i)]);
            self.points.push(Point { t_s, angles: self.angles.into(), inputs, momentum: 0.0, speeds: None });
        }
        done
    }
}

/// The points at even times, what lies between two of them interpolated; true speeds from the angles where none are
/// given.
fn resampled(points: &[Point], dt_s: f64) -> Result<Record, String> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Err("no sample".into()) };
    if let Some(w) = points.windows(2).find(|w| w[1].t_s <= w[0].t_s) {
        return Err(format!("time does not rise after {} s", w[0].t_s));
    }
    let mut record = Record { dt_s, ..Record::default() };
    let mut k = 0;
    for n in 0..((last.t_s - first.t_s) / dt_s) as usize {
        let t = first.t_s + n as f64 * dt_s;
        while k + 2 < points.len() && points[k + 1].t_s <= t {
            k += 1;
        }
        let (a, b) = (&points[k], &points[(k + 1).min(points.len() - 1)]);
        let share = if b.t_s > a.t_s { (t - a.t_s) / (b.t_s - a.t_s) } else { 0.0 };
        let between = |x: &[f64; 3], y: &[f64; 3]| std::array::from_fn(|i| x[i] + share * (y[i] - x[i]));
        record.angles.push(between(&a.angles, &b.angles));
        // what acts until the next sample is written beside the sample that follows
        record.inputs.push(b.inputs);
        record.momentum.push(b.momentum);
        if let (Some(x), Some(y)) = (&a.speeds, &b.speeds) {
            record.speeds.push(between(x, y));
        }
    }
    if record.speeds.len() < record.angles.len() {
        let clean = record.angles.clone();
        record = record.with_speeds_of_angles(&clean).map_err(|e| e.to_string())?;
    }
    record.check().map_err(|e| e.to_string())?;
    Ok(record)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_becomes_a_record_at_even_times() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rig.csv");
        let row = |k: u32| {
            // stamps jitter; the angle rises at 0.5 rad/s
            let t = f64::from(k) * 0.01 + if k.is_multiple_of(2) { 0.002 } else { 0.0 };
            format!("{t},{},0,0,1,2,3,0.25,0.5,0,0\n", 0.5 * t)
        };
        std::fs::write(
            &path,
            format!("t,phi,theta,psi,u1,u2,u3,momentum,p,q,r\n{}", (0..200).map(row).collect::<String>()),
        )
        .unwrap();
        let record = read(&path, None, 0.005).unwrap();
        assert!(record.angles.len() > 390);
        assert!(record.angles.windows(2).all(|w| (w[1][0] - w[0][0] - 0.0025).abs() < 1e-9));
        assert!(record.speeds.iter().all(|s| (s[0] - 0.5).abs() < 1e-12) && record.momentum[7] == 0.25);
        std::fs::write(&path, "t,phi\n1,2\n").unwrap();
        assert!(matches!(read(&path, None, 0.005), Err(Failure::Failed(e)) if e.contains("line 2")));
        assert!(matches!(read(Path::new("x.tlog"), None, 0.005), Err(Failure::Usage(_))));
    }
}
