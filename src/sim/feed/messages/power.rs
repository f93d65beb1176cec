//! What goes to the rotors and comes back from them, and the battery.

use crate::sim::feed::Stack;
use crate::sim::feed::view::View;
use crate::sim::feed::writer::Writer;
use crate::wire::FrameBuf;
use crate::wire::dialect::ardupilotmega as mav;

type Out = Option<FrameBuf>;

/// The command before any fault of the rotor. The stamp is 32 bits of microseconds and wraps after 71.6 minutes.
pub(in crate::sim::feed) fn servo_output_raw(v: &View<'_>, w: &mut Writer) -> Out {
    let [s1, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13, s14, s15, s16] = v.outputs().map(|x| x as u16);
    w.put(&mav::SERVO_OUTPUT_RAW_DATA {
        time_usec: v.stamp_us() as u32,
        port: 0,
        servo1_raw: s1,
        servo2_raw: s2,
        servo3_raw: s3,
        servo4_raw: s4,
        servo5_raw: s5,
        servo6_raw: s6,
        servo7_raw: s7,
        servo8_raw: s8,
        servo9_raw: s9,
        servo10_raw: s10,
        servo11_raw: s11,
        servo12_raw: s12,
        servo13_raw: s13,
        servo14_raw: s14,
        servo15_raw: s15,
        servo16_raw: s16,
    })
}

/// `active` holds the number of outputs, not a mask, as PX4 has it.
pub(in crate::sim::feed) fn actuator_output_status(v: &View<'_>, w: &mut Writer) -> Out {
    let mut actuator = [0.0; 32];
    for (to, from) in actuator.iter_mut().zip(v.outputs()) {
        *to = from as f32;
    }
    w.put(&mav::ACTUATOR_OUTPUT_STATUS_DATA { time_usec: v.stamp_us(), active: 16, actuator })
}

pub(in crate::sim::feed) fn hil_actuator_controls(v: &View<'_>, w: &mut Writer) -> Out {
    let mut controls = [0.0; 16];
    for (to, rotor) in controls.iter_mut().zip(v.rotor_of_output) {
        let command = rotor.and_then(|r| v.moment.commands.get(usize::from(r)));
        *to = command.copied().unwrap_or(0.0) as f32;
    }
    let armed = if v.moment.flight.armed() { 0x80 } else { 0 };
    w.put(&mav::HIL_ACTUATOR_CONTROLS_DATA {
        time_usec: v.stamp_us(),
        controls,
        mode: mav::MavModeFlag::from_bits_retain(0x15 | armed),
        flags: mav::HilActuatorControlsFlags::from_bits_retain(0),
    })
}

/// What the speed controllers measure: a faulty rotor shows.
pub(in crate::sim::feed) fn esc_telemetry_1_to_4(v: &View<'_>, w: &mut Writer) -> Out {
    let (voltage, current, rpm) = esc(v, 0);
    w.put(&mav::ESC_TELEMETRY_1_TO_4_DATA { voltage, current, rpm, temperature: [32; 4], ..Default::default() })
}

pub(in crate::sim::feed) fn esc_telemetry_5_to_8(v: &View<'_>, w: &mut Writer) -> Out {
    if v.rotor_count <= 4 {
        return None;
    }
    let (voltage, current, rpm) = esc(v, 4);
    w.put(&mav::ESC_TELEMETRY_5_TO_8_DATA { voltage, current, rpm, temperature: [32; 4], ..Default::default() })
}

/// Centivolt, centiampere and rev/min of four rotors.
fn esc(v: &View<'_>, first: usize) -> ([u16; 4], [u16; 4], [u16; 4]) {
    let each = v.moment.readings.current_a / v.rotor_count.max(1) as f64 * 100.0;
    let mut rpm = [0; 4];
    for (to, from) in rpm.iter_mut().zip(v.latest.rpm.iter().skip(first)) {
        *to = *from as u16;
    }
    ([(v.moment.readings.voltage_v * 100.0) as u16; 4], [each as u16; 4], rpm)
}

pub(in crate::sim::feed) fn rpm(v: &View<'_>, w: &mut Writer) -> Out {
    let [first, ..] = v.latest.rpm;
    w.put(&mav::RPM_DATA { rpm1: first as f32, rpm2: -1.0 })
}

pub(in crate::sim::feed) fn battery_status(v: &View<'_>, w: &mut Writer) -> Out {
    let r = &v.moment.readings;
    let mut voltages = [u16::MAX; 10];
    voltages[0] = (r.voltage_v * 1e3) as u16;
    let current = match v.stack {
        Stack::ArduPilot => r.current_a * 100.0,
        Stack::Px4 => -100.0,
    };
    w.put(&mav::BATTERY_STATUS_DATA {
        id: 0,
        temperature: i16::MAX,
        voltages,
        current_battery: current as i16,
        current_consumed: (v.latest.charge_as / 3.6) as i32,
        energy_consumed: -1,
        battery_remaining: (v.moment.truth.battery_left * 100.0) as i8,
        charge_state: mav::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK,
        ..Default::default()
    })
}
