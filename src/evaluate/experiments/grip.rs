use super::{Experiment, ExperimentError, Findings, Limit, Trace};
use crate::observers::Observer;
use crate::observers::cascade_gnss_ins::{NavigationGains, NavigationObserver, NavigationSettings};
use crate::signal::{Barometer, Discontinuity, FixType, GnssFix, Held, Imu, MagField, MagSource, Measurement, Stamp};
use crate::sim::control::Leg;
use crate::sim::sensors::SensorSuite;
use crate::sim::{FlightPlan, Moment, SimVehicle};
use crate::vehicle;
use nalgebra::{UnitQuaternion, Vector3};

const NAME: &str = "grip-circuit";

pub const EXPERIMENT: Experiment = Experiment {
    name: NAME,
    paper: "Grip, Saberi, Johansen 2012, section 5.2",
    about: "Attitude, velocity and position around a circuit from take-off to landing, inertial sensors at 100 Hz and \
            GNSS at 5 Hz: from a start by TRIAD, from one 90 degrees wrong, and with ordinary MEMS sensors",
    run,
};

/// Autopilot loops (400 Hz) to an IMU sample of 100 Hz.
const LOOPS: u32 = 4;
/// What happens before this is the start, s after the first estimate.
const START_S: f64 = 30.0;
/// Canberra, where the simulated field's declination is given to the observer.
const PLACE: (f64, f64) = (-35.363_262, 149.165_237);

/// How a flight begins and what it measures with.
#[derive(Clone, Copy)]
struct Setting {
    mems: bool,
    /// Turn of the start away from the truth about the body's axes, rad.
    wrong_start: Option<[f64; 3]>,
}

/// Root mean squares after the start.
#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    attitude_deg: f64,
    yaw_deg: f64,
    /// Of the worst axis.
    velocity_mps: f64,
    position_m: f64,
    /// When the attitude was last more than 5° off, s after the first estimate.
    recovered_s: f64,
}

fn plan(setting: Setting) -> Result<FlightPlan, ExperimentError> {
    let model = vehicle::resolve("arducopter-sitl").map_err(ExperimentError::in_part(NAME, "vehicle"))?;
    let mut plan = FlightPlan::calm(model, 11);
    if setting.mems {
        plan.sensors = SensorSuite::mems(&plan.vehicle);
    }
    // the paper's sensors have no delay
    for imu in &mut plan.sensors.imu {
        (imu.accel_delay_s, imu.gyro_delay_s) = (0.0, 0.0);
    }
    plan.sensors.gnss.rate_hz = 5.0;
    let corner = |n: f64, e: f64| Leg::Goto { position_ned_m: Vector3::new(n, e, -30.0), speed_mps: 8.0 };
    plan.mission = vec![
        Leg::Wait { seconds: 5.0 },
        Leg::Takeoff { height_m: 30.0 },
        corner(120.0, 0.0),
        Leg::Turn { heading_rad: 1.5 },
        corner(120.0, 80.0),
        Leg::Turn { heading_rad: 3.0 },
        corner(0.0, 80.0),
        Leg::Circle { radius_m: 20.0, speed_mps: 6.0, seconds: 30.0, nose_ahead: true },
        corner(0.0, 0.0),
        Leg::Land,
    ];
    Ok(plan)
}

/// Turns what the simulated sensors deliver into measurements, without MAVLink.
#[derive(Default)]
struct Sensors {
    gnss: Option<Held<GnssFix>>,
    magnetometer: Option<Held<MagField>>,
    barometer: Option<Held<Barometer>>,
    last: Option<Stamp>,
}

impl Sensors {
    /// Takes in one loop.
    fn collect(&mut self, moment: &Moment) {
        let r = &moment.readings;
        let now = moment.truth.stamp;
        if let Some(fix) = r.gnss {
            let [n, e] = [fix.velocity_ned_mps.x, fix.velocity_ned_mps.y];
            let value = GnssFix {
                fix_type: FixType::ThreeD,
                latitude_deg: PLACE.0,
                longitude_deg: PLACE.1,
                altitude_m: 584.0,
                position_ned_m: Some(fix.position_ned_m),
                ground_velocity_mps: Some([n, e]),
                down_velocity_mps: None,
                hdop: None,
                vdop: None,
                horizontal_accuracy_m: None,
                vertical_accuracy_m: None,
                speed_accuracy_mps: None,
                satellites: Some(fix.satellites),
                unix_s: None,
            };
            hold(&mut self.gnss, fix.stamp, value);
        }
        if let Some(field_frd_gauss) = r.mag_frd_gauss {
            hold(&mut self.magnetometer, now, MagField { field_frd_gauss, source: MagSource::HighRes });
        }
        if let Some(pressure_pa) = r.pressure_pa {
            hold(&mut self.barometer, now, Barometer::from_pressure(pressure_pa));
        }
    }

    fn measurement(&mut self, moment: &Moment) -> Measurement {
        let reading = &moment.readings.imu[0];
        let now = moment.truth.stamp;
        let imu = Imu { accel_frd_mps2: reading.accel_frd_mps2, rate_frd_rads: reading.rate_frd_rads };
        let mut m = Measurement::new(now, imu);
        m.dt_s = self.last.map_or(0.0, |last| now - last);
        m.discontinuity = self.last.is_none().then_some(Discontinuity::First);
        m.gate.armed = Some(moment.flight.armed());
        m.gnss = take(&mut self.gnss, now);
        m.magnetometer = take(&mut self.magnetometer, now);
        m.barometer = take(&mut self.barometer, now);
        self.last = Some(now);
        m
    }
}

fn hold<T: Copy>(slot: &mut Option<Held<T>>, stamp: Stamp, value: T) {
    let sequence = slot.map_or(1, |h| h.sequence + 1);
    *slot = Some(Held { value, stamp, age_s: 0.0, sequence, new: true });
}

fn take<T: Copy>(slot: &mut Option<Held<T>>, now: Stamp) -> Option<Held<T>> {
    let held = slot.as_mut()?;
    let out = Held { age_s: now - held.stamp, ..*held };
    held.new = false;
    Some(out)
}

fn fly(setting: Setting, trace: &mut Option<Trace>) -> Result<Errors, ExperimentError> {
    let plan = plan(setting)?;
    let field = plan.sensors.magnetometer.field_ned_gauss;
    let settings =
        NavigationSettings { declination_rad: Some(field.y.atan2(field.x)), ..NavigationSettings::default() };
    let gains = NavigationGains::new(&settings.goal).map_err(ExperimentError::in_part(NAME, "gains"))?;
    let mut observer = NavigationObserver::new(settings, gains);
    let mut vehicle = SimVehicle::new(&plan).map_err(ExperimentError::in_part(NAME, "vehicle"))?;
    if let Some(turn) = setting.wrong_start {
        let truth = vehicle.now().truth.body_to_ned;
        observer.start_from(truth * UnitQuaternion::from_scaled_axis(Vector3::from(turn)));
    }
    let mut sensors = Sensors::default();
    let (mut sums, mut n, mut began, mut errors) = ([0.0; 6], 0.0, None, Errors::default());
    let mut steps: u32 = 0;
    while !vehicle.mission_done() && steps < 400 * 300 {
        let moment = *vehicle.advance();
        sensors.collect(&moment);
        steps += 1;
        if !steps.is_multiple_of(LOOPS) {
            continue;
        }
        let m = sensors.measurement(&moment);
        observer.step(&m).map_err(ExperimentError::in_part(NAME, "step"))?;
        let Some(attitude) = observer.attitude() else { continue };
        let truth = &moment.truth;
        let since = m.stamp - *began.get_or_insert(m.stamp);
        let off = (attitude * truth.body_to_ned.inverse()).scaled_axis().map(f64::to_degrees);
        let values = &observer.estimate().values;
        let by = Vector3::from_row_slice(&values[3..6]) - truth.velocity_ned_mps;
        let at = Vector3::from_row_slice(&values[6..9]) - truth.position_ned_m;
        if off.norm() > 5.0 {
            errors.recovered_s = since;
        }
        if let Some(trace) = trace.as_mut().filter(|_| steps.is_multiple_of(10 * LOOPS)) {
            trace.push(since, &[off.x, off.y, off.z]);
        }
        if since > START_S {
            let squares = [off.norm_squared(), off.z * off.z, by.x * by.x, by.y * by.y, by.z * by.z, at.norm_squared()];
            sums.iter_mut().zip(squares).for_each(|(s, x)| *s += x);
            n += 1.0;
        }
    }
    let [attitude, yaw, vn, ve, vd, position] = sums.map(|s| (s / n).sqrt());
    Ok(Errors {
        attitude_deg: attitude,
        yaw_deg: yaw,
        velocity_mps: vn.max(ve).max(vd),
        position_m: position,
        ..errors
    })
}

fn run() -> Result<Findings, ExperimentError> {
    let mut f = Findings::default();
    let quarter = std::f64::consts::FRAC_PI_2;
    let flights = [
        ("start by TRIAD", Setting { mems: false, wrong_start: None }, true),
        ("heading 90° wrong", Setting { mems: false, wrong_start: Some([0.0, 0.0, quarter]) }, true),
        ("roll 90° wrong", Setting { mems: false, wrong_start: Some([quarter, 0.0, 0.0]) }, true),
        ("MEMS sensors", Setting { mems: true, wrong_start: None }, false),
    ];
    for (name, setting, judged) in flights {
        let lines = ["about north", "about east", "about down"];
        let mut trace = Some(Trace::new(format!("Attitude error, {name}"), "deg", &lines));
        let e = fly(setting, &mut trace)?;
        f.traces.extend(trace);
        let (attitude, velocity) =
            (format!("attitude RMSE, {name}"), format!("velocity RMSE of the worst axis, {name}"));
        if judged {
            f.judge(attitude, e.attitude_deg, "deg", Limit::AtMost(1.5));
            f.judge(velocity, e.velocity_mps, "m/s", Limit::AtMost(0.15));
        } else {
            f.tell(attitude, e.attitude_deg, "deg");
            f.tell(velocity, e.velocity_mps, "m/s");
        }
        f.tell(format!("heading RMSE, {name}"), e.yaw_deg, "deg");
        f.tell(format!("position RMSE, {name}"), e.position_m, "m");
        if setting.wrong_start.is_some() {
            f.judge(format!("within 5° for good after, {name}"), e.recovered_s, "s", Limit::AtMost(START_S));
        }
    }
    f.remarks.push(
        "The paper flies a Cessna in a flight simulator; here a 3 kg quadrotor flies the circuit. Errors are taken from \
         30 s after the first estimate on. MEMS sensors have a gyro bias of 0.1°/s, accelerometer biases, vibration and \
         8 mG of hard iron, which no observer of this kind can tell from heading"
            .to_owned(),
    );
    Ok(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_start_is_put_right() {
        let e = fly(Setting { mems: false, wrong_start: Some([0.0, 0.0, 1.57]) }, &mut None).unwrap();
        assert!(e.attitude_deg <= 1.5 && e.velocity_mps <= 0.15 && e.recovered_s <= 30.0, "{e:?}");
    }
}
