use super::{Fault, FaultBank, FaultSettings};
use crate::signal::{
    Actuation, Aged, Barometer, FixType, GnssFix, Guarantee, Held, Imu, MAX_ROTORS, MagField, MagSource, Measurement,
    Residual, RotorCommands, Stamp,
};
use crate::vehicle::{Air, GRAVITY_MPS2, Spin, Vehicle, resolve};
use nalgebra::{UnitQuaternion, Vector3};

/// A copter that hovers, with every sensor, 50 Hz; a fix in five steps.
struct Hover {
    vehicle: Vehicle,
    bank: FaultBank,
    step: u32,
}

impl Hover {
    fn new() -> Self {
        Self::of(resolve("arducopter-sitl").unwrap())
    }

    fn of(vehicle: Vehicle) -> Self {
        Self { bank: FaultBank::new(&vehicle, FaultSettings::default()), vehicle, step: 0 }
    }

    fn measurement(&self) -> Measurement {
        let stamp = Stamp::from_millis(20 * i64::from(self.step));
        let imu = Imu {
            accel_frd_mps2: Vector3::new(0.0, 0.0, -GRAVITY_MPS2),
            // a little life, so that no sensor seems stuck
            rate_frd_rads: Vector3::new(0.002 * f64::from(self.step % 7), 0.0, 0.0),
        };
        let mut m = Measurement::new(stamp, imu);
        m.dt_s = 0.02;
        m.attitude = Some(Aged { value: UnitQuaternion::identity(), age_s: 0.0 });
        m.velocity_ned_mps = Some(Aged { value: Vector3::zeros(), age_s: 0.0 });
        let actuation = Actuation {
            rotors: RotorCommands { command: [0.55; MAX_ROTORS], count: 4 },
            force_frd_n: Vector3::new(0.0, 0.0, -self.vehicle.mass_kg.nominal * GRAVITY_MPS2),
            torque_frd_nm: Vector3::zeros(),
            sum_sqrt_thrust: 10.8,
            inflow_n_per_mps2: 0.0,
            doubt: 0.0,
            climb_mps: 0.0,
        };
        m.actuation = Some(Aged { value: actuation, age_s: 0.0 });
        m.other_imus[0] = Some(self.held(stamp.plus_secs(self.vehicle.sensors.gyro_delay_s), imu, 5));
        let fix = GnssFix {
            fix_type: FixType::ThreeD,
            latitude_deg: 0.0,
            longitude_deg: 0.0,
            altitude_m: 0.0,
            position_ned_m: Some(Vector3::zeros()),
            ground_velocity_mps: Some([0.0; 2]),
            down_velocity_mps: None,
            hdop: None,
            vdop: None,
            horizontal_accuracy_m: None,
            vertical_accuracy_m: None,
            speed_accuracy_mps: None,
            satellites: None,
            unix_s: None,
        };
        m.gnss = Some(self.held(stamp, fix, 10));
        m.barometer = Some(self.held(stamp, Barometer { pressure_pa: 95_000.0, altitude_m: 540.0 }, 5));
        let life = 1e-3 * f64::from(self.step % 5);
        let field = MagField { field_frd_gauss: Vector3::new(0.2, life, 0.4), source: MagSource::Scaled };
        m.magnetometer = Some(self.held(stamp, field, 1));
        m
    }

    fn held<T>(&self, stamp: Stamp, value: T, every: u32) -> Held<T> {
        Held { value, stamp, age_s: 0.0, sequence: self.step / every, new: self.step.is_multiple_of(every) }
    }

    /// Flies on for this long, each measurement spoilt by `spoil`.
    fn fly(&mut self, seconds: f64, spoil: impl Fn(&mut Measurement)) {
        for _ in 0..(seconds / 0.02) as u32 {
            let mut m = self.measurement();
            spoil(&mut m);
            self.bank.step(&m);
            self.step += 1;
        }
    }

    fn told(&self) -> Vec<Fault> {
        self.bank.active().map(|a| a.fault).collect()
    }
}

/// Healthy flight, the fault, and healthy flight again.
fn told_and_cleared(fault: Fault, within_s: f64, spoil: impl Fn(&mut Measurement)) {
    let mut h = Hover::new();
    h.fly(10.0, |_| {});
    assert_eq!(h.told(), []);
    let begin = Stamp::from_millis(20 * i64::from(h.step));
    h.fly(within_s, &spoil);
    assert_eq!(h.told(), [fault]);
    let onset = h.bank.active().next().unwrap().onset;
    assert!(onset >= begin && onset - begin <= within_s, "{fault:?}: onset {} s", onset - begin);
    h.fly(6.0, |_| {});
    assert_eq!(h.told(), []);
}

#[test]
fn each_sensor_fault_is_named_and_clears() {
    told_and_cleared(Fault::Gyro, 3.0, |m| m.imu.rate_frd_rads.y += 0.05);
    told_and_cleared(Fault::Accelerometer, 5.0, |m| m.imu.accel_frd_mps2.x += 0.5);
    told_and_cleared(Fault::Barometer, 1.0, |m| m.barometer.as_mut().unwrap().value.altitude_m += 5.0);
    told_and_cleared(Fault::GnssPosition, 0.4, |m| {
        m.gnss.as_mut().unwrap().value.position_ned_m = Some(Vector3::new(0.0, 10.0, 0.0));
    });
    told_and_cleared(Fault::GnssPosition, 1.0, |m| m.gnss.as_mut().unwrap().value.fix_type = FixType::None);
    told_and_cleared(Fault::Magnetometer, 2.0, |m| m.magnetometer.as_mut().unwrap().value.field_frd_gauss *= 1.6);
    told_and_cleared(Fault::Magnetometer, 3.5, |m| m.magnetometer.as_mut().unwrap().value.field_frd_gauss.y = 0.0);
}

#[test]
fn a_receiver_whose_velocity_is_not_the_vehicles_is_named() {
    let mut h = Hover::new();
    h.fly(10.0, |_| {});
    h.fly(3.0, |m| {
        // position follows, so only the vehicle's own velocity disagrees
        let fix = &mut m.gnss.as_mut().unwrap().value;
        fix.ground_velocity_mps = Some([4.0, 0.0]);
        fix.position_ned_m = Some(Vector3::new(4.0 * (m.stamp.secs() - 10.0), 0.0, 0.0));
    });
    assert_eq!(h.told(), [Fault::GnssVelocity]);
}

/// The controller makes up for a weak rotor: the body stands still under commands that would turn it.
fn weak(h: &Hover, rotor: usize, loss: f64) -> impl Fn(&mut Measurement) + use<> {
    let r = h.vehicle.rotors[rotor];
    let lacking = r.axis_frd * (loss * h.vehicle.mass_kg.nominal * GRAVITY_MPS2 * 0.25);
    move |m: &mut Measurement| {
        let a = &mut m.actuation.as_mut().unwrap().value;
        a.torque_frd_nm += r.position_frd_m.cross(&lacking);
        a.force_frd_n += lacking;
    }
}

/// Too little to be called a fault, and enough to be seen over a flight.
#[test]
fn what_a_rotor_gives_is_known_without_a_fault() {
    let mut h = Hover::new();
    h.fly(5.0, |_| {});
    assert!(h.bank.rotor_health().is_empty(), "before it has flown for long");
    h.fly(60.0, weak(&h, 2, 0.05));
    assert_eq!(h.told(), []);
    let asked_n = h.vehicle.thrust.thrust_n(0.55, Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 });
    let expected = 1.0 - 0.05 * h.vehicle.mass_kg.nominal * GRAVITY_MPS2 * 0.25 / asked_n;
    let health = h.bank.rotor_health();
    assert_eq!(health.len(), 4);
    assert!((health[2].mean - expected).abs() < 0.005 && (health[2].least - expected).abs() < 0.005, "{health:?}");
    // the rotor across looks strong by as much, those beside it look as they are
    assert!(health[0].mean > 1.0 || health[1].mean > 1.0 || health[3].mean > 1.0, "{health:?}");
    assert!(health.iter().filter(|r| (r.mean - 1.0).abs() < 0.005).count() >= 2, "{health:?}");
}

#[test]
fn each_weak_rotor_is_named_with_its_loss() {
    for rotor in 0..4 {
        let mut h = Hover::new();
        h.fly(10.0, |_| {});
        let spoil = weak(&h, rotor, 0.3);
        h.fly(2.0, spoil);
        assert_eq!(h.told(), [Fault::Rotor(rotor as u8)]);
        h.fly(2.0, weak(&h, rotor, 0.3));
        let size = h.bank.active().next().unwrap().magnitude;
        assert!((size - 0.3).abs() < 0.02, "{size}");
        h.fly(6.0, |_| {});
        assert_eq!(h.told(), []);
    }
}

/// Two rotors on each arm, one above the other, that turn against each other.
fn coaxial() -> Vehicle {
    let mut vehicle = resolve("arducopter-sitl").unwrap();
    let lower: Vec<_> = vehicle.rotors.iter().map(|r| crate::vehicle::Rotor { spin: other(r.spin), ..*r }).collect();
    vehicle.rotors.extend(lower);
    vehicle
}

fn other(spin: Spin) -> Spin {
    if spin == Spin::Ccw { Spin::Cw } else { Spin::Ccw }
}

#[test]
fn of_two_rotors_on_one_arm_yaw_tells_which_or_both_are_named() {
    let loss = |yaw_share: f64| {
        let mut h = Hover::of(coaxial());
        h.fly(10.0, |_| {});
        let r = h.vehicle.rotors[5];
        let lost_n = 0.6 * h.vehicle.mass_kg.nominal * GRAVITY_MPS2 / 8.0;
        let lacking = r.axis_frd * lost_n;
        let reaction = -lacking * (r.spin.reaction_sign() * r.torque_ratio_m * yaw_share);
        h.fly(4.0, move |m| {
            let a = &mut m.actuation.as_mut().unwrap().value;
            a.torque_frd_nm += r.position_frd_m.cross(&lacking) + reaction;
            a.force_frd_n += lacking;
        });
        let told = *h.bank.active().next().unwrap();
        (told, h.bank.bits(), h.bank.candidates())
    };
    let (told, bits, candidates) = loss(1.0);
    assert_eq!((told.fault, told.or, bits, candidates), (Fault::Rotor(5), 0, 1 << 5, 0));
    // what the yaw torque of both could be is told of both
    let (told, bits, candidates) = loss(0.0);
    assert_eq!((bits, candidates), (0, 1 << 1 | 1 << 5), "{told:?}");
}

#[test]
fn what_no_admissible_noise_explains_is_guaranteed() {
    let level = |name: &'static str, value: f64| {
        let mut h = Hover::new();
        h.fly(10.0, |_| {});
        let residual = Residual { name, value, admissible: 0.1, guarantee: Guarantee::Guaranteed };
        for _ in 0..150 {
            let stamp = Stamp::from_millis(20 * i64::from(h.step));
            h.bank.contradicted(&residual, stamp);
            h.fly(0.0201, |m| m.imu.rate_frd_rads.y += 0.05);
        }
        h.bank.active().next().unwrap().guarantee
    };
    assert_eq!(level("rate_y", 0.2), Guarantee::Guaranteed);
    // within its bound, and of what a gyroscope does not move
    assert!(matches!(level("rate_y", 0.05), Guarantee::Statistical(p) if p > 0.999));
    assert!(matches!(level("position_d", 0.2), Guarantee::Statistical(_)));
}

#[test]
fn a_lost_rotor_is_named_before_the_vehicle_turns_over() {
    let mut h = Hover::new();
    h.fly(10.0, |_| {});
    let torque = h.vehicle.rotors[3].position_frd_m.cross(&Vector3::new(0.0, 0.0, 7.35));
    let begin = h.step;
    let gain = torque.component_div(&h.vehicle.inertia_kgm2.diagonal());
    while h.told().is_empty() {
        let elapsed = 0.02 * f64::from(h.step - begin);
        assert!(elapsed < 0.3, "nothing told");
        h.fly(0.0201, |m| m.imu.rate_frd_rads += gain * elapsed);
    }
    assert_eq!(h.told(), [Fault::Rotor(3)]);
}

#[test]
fn a_torque_of_the_air_is_no_rotor() {
    for torque in [Vector3::new(0.3, 0.0, 0.0), Vector3::new(0.0, -0.3, 0.0), Vector3::new(0.0, 0.0, 0.4)] {
        let mut h = Hover::new();
        h.fly(10.0, |_| {});
        h.fly(4.0, |m| m.actuation.as_mut().unwrap().value.torque_frd_nm -= torque);
        assert_eq!(h.told(), []);
    }
}

#[test]
fn weight_is_payload_and_not_a_rotor() {
    let lift =
        |kg: f64| move |m: &mut Measurement| m.actuation.as_mut().unwrap().value.force_frd_n.z -= kg * GRAVITY_MPS2;
    told_and_cleared(Fault::Payload, 1.0, lift(0.6));
    let mut h = Hover::new();
    h.fly(10.0, |_| {});
    h.fly(20.0, lift(0.6));
    let size = h.bank.active().next().unwrap().magnitude;
    assert!((size - 0.6).abs() < 0.03, "{size}");
    // it is told when it is put down, too
    let dropped = Stamp::from_millis(20 * i64::from(h.step));
    h.fly(1.0, |_| {});
    let told = *h.bank.active().next().unwrap();
    assert!(told.fault == Fault::Payload && told.onset - dropped < 0.5 && (told.magnitude + 0.6).abs() < 0.03);
    h.fly(4.0, |_| {});
    assert_eq!(h.told(), []);
}

/// Of a load beside the middle the torque alone would be a weak rotor.
#[test]
fn a_load_beside_the_middle_is_no_rotor() {
    let mut h = Hover::new();
    h.fly(10.0, |_| {});
    let at = h.vehicle.rotors[0].position_frd_m * 0.15;
    let load = move |m: &mut Measurement| {
        let a = &mut m.actuation.as_mut().unwrap().value;
        let carried = Vector3::new(0.0, 0.0, -0.8 * GRAVITY_MPS2);
        a.force_frd_n += carried;
        a.torque_frd_nm += at.cross(&carried);
    };
    for _ in 0..10 {
        h.fly(1.0, load);
        assert!(!h.told().iter().any(|f| matches!(f, Fault::Rotor(_))), "{:?}", h.told());
    }
    assert_eq!(h.told(), [Fault::Payload]);
}

#[test]
fn a_rotor_that_does_not_turn_as_told_is_named_by_its_speed() {
    let mut h = Hover::new();
    let turning = |slow: f64| {
        move |m: &mut Measurement| {
            let mut rpm = [6600.0; MAX_ROTORS];
            rpm[2] *= slow;
            m.rotor_rpm = Some(Aged { value: rpm, age_s: 0.0 });
        }
    };
    h.fly(10.0, turning(1.0));
    assert_eq!(h.told(), []);
    h.fly(0.3, turning(0.5));
    assert_eq!(h.told(), [Fault::Rotor(2)]);
    assert!((h.bank.active().next().unwrap().magnitude - 0.75).abs() < 0.01);
    h.fly(3.0, turning(1.0));
    assert_eq!(h.told(), []);
}

#[test]
fn a_field_from_elsewhere_is_the_magnetometers_fault_and_a_turn_is_not() {
    let mut h = Hover::new();
    let field = Vector3::new(0.2, 0.0, 0.4);
    let turned = |yaw_rad: f64, disturbed: f64| {
        move |m: &mut Measurement| {
            let q = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
            m.attitude = Some(Aged { value: q, age_s: 0.0 });
            let life = m.magnetometer.unwrap().value.field_frd_gauss.y;
            let seen = q.inverse() * field + Vector3::new(0.0, life, disturbed);
            m.magnetometer.as_mut().unwrap().value.field_frd_gauss = seen;
        }
    };
    h.fly(8.0, turned(0.0, 0.0));
    h.fly(4.0, turned(2.0, 0.0));
    assert_eq!(h.told(), []);
    h.fly(1.0, turned(2.0, 0.15));
    assert_eq!(h.told(), [Fault::Magnetometer]);
}

#[test]
fn what_meets_the_ground_drops_no_load_and_lacks_no_rotor() {
    let mut h = Hover::new();
    h.fly(10.0, |m| m.velocity_ned_mps = Some(Aged { value: Vector3::new(0.0, 0.0, 0.5), age_s: 0.0 }));
    // the ground takes ever more of the weight, on one leg first
    for part in 1..20 {
        h.fly(0.06, |m| {
            let a = &mut m.actuation.as_mut().unwrap().value;
            a.force_frd_n.z *= 1.0 - 0.05 * f64::from(part);
            a.torque_frd_nm.x += 0.4;
        });
        assert_eq!(h.told(), []);
    }
}

#[test]
fn nothing_is_judged_on_the_ground_or_without_its_sensors() {
    let mut h = Hover::new();
    h.fly(10.0, |m| {
        m.gate.in_air = Some(false);
        m.imu.rate_frd_rads.y += 1.0;
    });
    assert_eq!(h.told(), []);
    let mut h = Hover::new();
    h.fly(10.0, |m| *m = Measurement { dt_s: m.dt_s, ..Measurement::new(m.stamp, m.imu) });
    assert_eq!(h.told(), []);
}
