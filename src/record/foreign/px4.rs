//! PX4's uORB topics as MAVLink.

use super::Row;
use super::said::{Give, Said};
use crate::wire::dialect::ardupilotmega as mav;

/// `arming_state` of vehicle_status.
const ARMED: f64 = 2.0;

#[derive(Default)]
pub(super) struct Px4 {
    said: Said,
    /// A log that holds outputs as sent to the rotors needs no guess from the normalised ones.
    has_outputs: bool,
}

impl Px4 {
    pub fn row(&mut self, row: &Row<'_>, boot_us: u64, give: &mut Give<'_>) {
        // one estimate, one sensor: the first, which is the selected one where PX4 selects
        if row.instance() == 0 {
            let _ = self.tell(row, boot_us, give);
        }
    }

    /// `None` if a field is missing, as in logs of versions that name it differently.
    fn tell(&mut self, row: &Row<'_>, boot_us: u64, give: &mut Give<'_>) -> Option<()> {
        let n = |name: &str| row.number(name);
        match row.name() {
            "sensor_combined" => {
                self.said.imu(boot_us, row.array("accelerometer_m_s2")?, row.array("gyro_rad")?, give);
            }
            "vehicle_magnetometer" => self.said.field(row.array("magnetometer_ga")?),
            "vehicle_air_data" => self.said.pressure(n("baro_pressure_pa")?),
            "vehicle_attitude" => self.said.attitude(boot_us, row.array("q")?, give),
            "vehicle_local_position" => {
                let position = [n("x")?, n("y")?, n("z")?];
                self.said.local_position(boot_us, position, [n("vx")?, n("vy")?, n("vz")?], give);
            }
            "vehicle_status" => {
                let armed = n("arming_state")? == ARMED;
                let kind = match n("system_type").unwrap_or(2.0) as u8 {
                    3 => mav::MavType::MAV_TYPE_COAXIAL,
                    13 => mav::MavType::MAV_TYPE_HEXAROTOR,
                    14 => mav::MavType::MAV_TYPE_OCTOROTOR,
                    1 => mav::MavType::MAV_TYPE_FIXED_WING,
                    _ => mav::MavType::MAV_TYPE_QUADROTOR,
                };
                self.said.heartbeat(armed, kind, mav::MavAutopilot::MAV_AUTOPILOT_PX4, give);
            }
            "vehicle_land_detected" => self.said.landed(n("landed")? != 0.0, give),
            "actuator_outputs" => {
                self.has_outputs = true;
                self.outputs(boot_us, row.array::<12>("output")?, give);
            }
            // normalised; told on the scale of the usual pulses
            "actuator_motors" if !self.has_outputs => {
                let motors = row.array::<12>("control")?;
                self.outputs(boot_us, motors.map(|u| 1_000.0 + 1_000.0 * if u.is_finite() { u } else { 0.0 }), give);
            }
            "battery_status" => self.said.battery(n("voltage_v")?, give),
            "vehicle_gps_position" => {
                // degrees since 1.15, before that 1e-7 degrees and millimetres
                let place = match (n("latitude_deg"), n("lat")) {
                    (Some(latitude), _) => [latitude, n("longitude_deg")?, n("altitude_msl_m")?],
                    (None, latitude) => [latitude? * 1e-7, n("lon")? * 1e-7, n("alt")? * 1e-3],
                };
                let (north, east) = (n("vel_n_m_s")?, n("vel_e_m_s")?);
                let course = east.atan2(north).to_degrees();
                self.said.fix(boot_us, n("fix_type")? as u8, place, north.hypot(east), course, give);
            }
            _ => {}
        }
        Some(())
    }

    fn outputs(&mut self, boot_us: u64, values: [f64; 12], give: &mut Give<'_>) {
        let mut actuator = [0.0; 32];
        actuator.iter_mut().zip(values).for_each(|(to, x)| *to = x as f32);
        let message = mav::ACTUATOR_OUTPUT_STATUS_DATA { time_usec: boot_us, active: 12, actuator };
        self.said.give(&message, give);
    }
}
