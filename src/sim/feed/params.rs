use super::Stack;
use crate::vehicle::Vehicle;

/// Integers keep their type on the wire; what becomes of it depends on the stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Int8,
    Int16,
    Int32,
    Real,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Param {
    pub name: String,
    pub value: f64,
    pub kind: Kind,
}

/// The autopilot's parameters and how far a list has been sent.
#[derive(Debug)]
pub(super) struct Params {
    stack: Stack,
    all: Vec<Param>,
    /// The next one of a list in transfer.
    sending: Option<usize>,
    next_us: u64,
}

impl Params {
    pub fn new(stack: Stack, system: u8, vehicle: &Vehicle) -> Self {
        let mut all = match stack {
            Stack::ArduPilot => ardupilot(system, vehicle),
            Stack::Px4 => px4(system, vehicle),
        };
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Self { stack, all, sending: None, next_us: 0 }
    }

    pub fn count(&self) -> u16 {
        self.all.len() as u16
    }

    pub fn get(&self, index: usize) -> Option<&Param> {
        self.all.get(index)
    }

    pub fn find(&self, name: &str) -> Option<usize> {
        self.all.iter().position(|p| p.name == name)
    }

    /// Begins the whole list from its first.
    pub fn begin_list(&mut self) {
        self.sending = Some(0);
    }

    /// True while a list is being sent.
    pub fn in_transfer(&self) -> bool {
        self.sending.is_some()
    }

    /// The next parameter of a list, when it is time for one.
    pub fn next(&mut self, now_us: u64) -> Option<usize> {
        let index = self.sending?;
        if index >= self.all.len() {
            self.sending = None;
            return None;
        }
        if now_us < self.next_us {
            return None;
        }
        self.next_us = now_us + self.stack.parameter_interval_us();
        self.sending = Some(index + 1);
        Some(index)
    }

    /// Sets a parameter to what a PARAM_SET's float field holds.
    pub fn set(&mut self, index: usize, wire: f32) {
        let stack = self.stack;
        if let Some(p) = self.all.get_mut(index) {
            p.value = match (stack, p.kind) {
                (_, Kind::Real) => f64::from(wire),
                (Stack::ArduPilot, _) => f64::from(wire).round(),
                (Stack::Px4, _) => f64::from(wire.to_bits() as i32),
            };
        }
    }

    /// The float field of PARAM_VALUE: ArduPilot casts integers to float, PX4 puts their bytes there.
    pub fn wire_value(&self, p: &Param) -> f32 {
        match (self.stack, p.kind) {
            (_, Kind::Real) | (Stack::ArduPilot, _) => p.value as f32,
            (Stack::Px4, _) => f32::from_bits(p.value as i32 as u32),
        }
    }
}

fn int8(name: impl Into<String>, value: i32) -> Param {
    Param { name: name.into(), value: f64::from(value), kind: Kind::Int8 }
}

fn int16(name: impl Into<String>, value: i32) -> Param {
    Param { name: name.into(), value: f64::from(value), kind: Kind::Int16 }
}

fn int32(name: impl Into<String>, value: i32) -> Param {
    Param { name: name.into(), value: f64::from(value), kind: Kind::Int32 }
}

fn real(name: impl Into<String>, value: f64) -> Param {
    Param { name: name.into(), value, kind: Kind::Real }
}

fn ardupilot(system: u8, v: &Vehicle) -> Vec<Param> {
    let spin = |pulse: f64| (pulse - 1000.0) / 1000.0;
    let frame_class = match v.rotors.len() {
        6 => 2,
        8 => 3,
        12 => 12,
        _ => 1,
    };
    let voltage = v.thrust.voltage_ref_v.unwrap_or(0.0);
    let mut all = vec![
        int16("SYSID_THISMAV", system.into()),
        int16("SYSID_MYGCS", 255),
        int8("FRAME_CLASS", frame_class),
        int8("FRAME_TYPE", 1),
        int16("SCHED_LOOP_RATE", 400),
        int16("MOT_PWM_MIN", 1000),
        int16("MOT_PWM_MAX", 2000),
        int8("MOT_PWM_TYPE", 0),
        real("MOT_SPIN_ARM", 0.1),
        real("MOT_SPIN_MIN", spin(v.actuators.at_zero)),
        real("MOT_SPIN_MAX", spin(v.actuators.at_full)),
        real("MOT_THST_EXPO", v.thrust.expo),
        real("MOT_THST_HOVER", v.facts().hover_thrust_share),
        real("MOT_BAT_VOLT_MAX", voltage),
        real("MOT_BAT_VOLT_MIN", 0.75 * voltage),
        int8("MOT_OPTIONS", 0),
        int16("INS_GYRO_FILTER", 20),
        int16("INS_ACCEL_FILTER", 20),
        int8("INS_USE", 1),
        int8("INS_USE2", 1),
        int8("AHRS_EKF_TYPE", 3),
        int8("AHRS_ORIENTATION", 0),
        int8("EK3_ENABLE", 1),
        int8("EK3_IMU_MASK", 3),
        real("EK3_DRAG_BCOEF_X", 0.0),
        real("EK3_DRAG_BCOEF_Y", 0.0),
        real("EK3_DRAG_MCOEF", 0.0),
        int8("BATT_MONITOR", 4),
        int32("BATT_CAPACITY", 3300),
        int8("GPS1_TYPE", 1),
        int8("COMPASS_ENABLE", 1),
        int8("ARMING_CHECK", 1),
        int8("FENCE_ENABLE", 0),
        real("ANGLE_MAX", 3000.0),
        int16("RTL_ALT", 1500),
        real("WPNAV_SPEED", 1000.0),
        real("WPNAV_ACCEL", 250.0),
    ];
    for name in ["RAW_SENS", "EXT_STAT", "RC_CHAN", "RAW_CTRL", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3", "PARAMS"] {
        all.push(int16(format!("SR0_{name}"), 0));
    }
    for output in 0..16 {
        let rotor = v.rotors.iter().position(|r| r.output == output);
        // motors 1..8 are functions 33..40, 9..12 are 82..85
        let function = rotor.map_or(0, |r| if r < 8 { 33 + r as i32 } else { 74 + r as i32 });
        all.push(int16(format!("SERVO{}_FUNCTION", output + 1), function));
    }
    all
}

fn px4(system: u8, v: &Vehicle) -> Vec<Param> {
    let mut all = vec![
        int32("MAV_SYS_ID", system.into()),
        int32("MAV_COMP_ID", 1),
        int32("MAV_TYPE", if v.rotors.len() == 6 { 13 } else { 2 }),
        int32("MAV_PROTO_VER", 2),
        int32("SYS_AUTOSTART", 10040),
        int32("SYS_HITL", 2),
        int32("IMU_INTEG_RATE", 250),
        real("IMU_GYRO_CUTOFF", 40.0),
        int32("EKF2_EN", 1),
        int32("EKF2_MULTI_IMU", 2),
        real("EKF2_BCOEF_X", 0.0),
        real("EKF2_BCOEF_Y", 0.0),
        real("EKF2_MCOEF", 0.0),
        real("THR_MDL_FAC", v.thrust.expo),
        real("MPC_THR_HOVER", v.facts().hover_thrust_share),
        real("MPC_XY_VEL_MAX", 12.0),
        int32("CA_AIRFRAME", 0),
        int32("CA_ROTOR_COUNT", v.rotors.len() as i32),
        int32("BAT1_N_CELLS", 4),
        int32("COM_DISARM_LAND", 2),
        real("SIH_MASS", v.mass_kg.nominal),
        real("SIH_IXX", v.inertia_kgm2.m11),
        real("SIH_IYY", v.inertia_kgm2.m22),
        real("SIH_IZZ", v.inertia_kgm2.m33),
        real("SIH_T_MAX", v.thrust.max_n.nominal),
        real("SIH_KDV", v.drag.linear[0].nominal),
        real("SIH_T_TAU", v.dynamics.time_constant_s),
    ];
    for (i, r) in v.rotors.iter().enumerate() {
        all.push(real(format!("CA_ROTOR{i}_PX"), r.position_frd_m.x));
        all.push(real(format!("CA_ROTOR{i}_PY"), r.position_frd_m.y));
        all.push(real(format!("CA_ROTOR{i}_PZ"), r.position_frd_m.z));
        all.push(real(format!("CA_ROTOR{i}_KM"), r.spin.reaction_sign() * r.torque_ratio_m));
        all.push(real(format!("CA_ROTOR{i}_CT"), 6.5));
    }
    for output in 0..16 {
        let rotor = v.rotors.iter().position(|r| r.output == output);
        all.push(int32(format!("PWM_MAIN_FUNC{}", output + 1), rotor.map_or(0, |r| 101 + r as i32)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::resolve;

    #[test]
    fn integers_are_cast_by_ardupilot_and_copied_by_px4() {
        let v = resolve("arducopter-sitl").unwrap();
        let cast = Params::new(Stack::ArduPilot, 7, &v);
        let system = cast.get(cast.find("SYSID_THISMAV").unwrap()).unwrap();
        assert_eq!(cast.wire_value(system), 7.0);
        let mut copied = Params::new(Stack::Px4, 7, &v);
        let at = copied.find("MAV_SYS_ID").unwrap();
        assert_eq!(copied.wire_value(copied.get(at).unwrap()).to_bits(), 7);
        copied.set(at, f32::from_bits(9));
        assert_eq!(copied.get(at).unwrap().value, 9.0);
    }

    #[test]
    fn motors_are_named_as_the_stack_names_them() {
        let p = Params::new(Stack::ArduPilot, 1, &resolve("arducopter-sitl").unwrap());
        let value = |name: &str| p.get(p.find(name).unwrap()).unwrap().value;
        assert_eq!([1, 2, 3, 4, 5].map(|n| value(&format!("SERVO{n}_FUNCTION"))), [33.0, 34.0, 35.0, 36.0, 0.0]);
        assert!((value("MOT_SPIN_MIN") - 0.15).abs() < 1e-12 && (value("MOT_SPIN_MAX") - 0.95).abs() < 1e-12);
        assert!(p.all.iter().all(|p| p.name.len() <= 16));
    }

    #[test]
    fn a_list_is_sent_in_order_at_its_pace() {
        let mut p = Params::new(Stack::ArduPilot, 1, &resolve("arducopter-sitl").unwrap());
        p.begin_list();
        let sent: Vec<_> = (0..1000u64).filter_map(|i| p.next(i * 2_500).map(|index| (i, index))).collect();
        assert_eq!(sent.len(), usize::from(p.count()));
        assert!(sent.windows(2).all(|w| w[1].1 == w[0].1 + 1 && w[1].0 == w[0].0 + 2));
        assert!(!p.in_transfer());
    }
}
