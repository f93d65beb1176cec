use super::clock::{ClockEvent, VehicleClock};
use crate::signal::{ImuSource, MAX_ROTORS, Sample, SampleKind, Stamp};
use crate::vehicle::{GRAVITY_MPS2, OutputSource};
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Fields, FrameRef, decode};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// A better message of one kind that stays silent this long gives way to the next best, s.
const SOURCE_TIMEOUT_S: f64 = 2.0;
/// One milli-g, m/s².
const MILLI_G: f64 = GRAVITY_MPS2 * 1e-3;

/// What one frame meant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decoded {
    Sample(Sample),
    /// The boot clock went back.
    Reboot,
    /// The autopilot says that its estimate jumped.
    EstimatorReset,
    /// Rotor `rotor` (0-based) hangs on output `output` (0-based), by the autopilot's parameters.
    RotorOutput {
        rotor: usize,
        output: usize,
    },
}

/// Of several messages that carry the same thing, follows the best that is alive.
#[derive(Debug, Clone, Copy, Default)]
struct Best(Option<(u8, Stamp)>);

impl Best {
    /// May a message of this rank (higher is better) be used now?
    fn accept(&mut self, rank: u8, t: Stamp) -> bool {
        match self.0 {
            Some((best, seen)) if rank < best && t - seen < SOURCE_TIMEOUT_S => false,
            _ => {
                self.0 = Some((rank, t));
                true
            }
        }
    }
}

/// Turns the frames of one vehicle's autopilot into samples. Keeps the vehicle's clock; allocates nothing.
#[derive(Debug, Default)]
pub struct Decoder {
    clock: VehicleClock,
    actuators: OutputSourceRank,
    attitude: Best,
    velocity: Best,
    outputs: Best,
    odometry_resets: Option<u8>,
}

#[derive(Debug, Clone, Copy)]
struct OutputSourceRank(OutputSource);

impl Default for OutputSourceRank {
    fn default() -> Self {
        Self(OutputSource::Auto)
    }
}

impl OutputSourceRank {
    fn of(self, message: OutputSource) -> Option<u8> {
        match (self.0, message) {
            (OutputSource::Auto, OutputSource::ActuatorOutputStatus) => Some(2),
            (OutputSource::Auto, OutputSource::ServoOutputRaw) => Some(1),
            // its scale (0..1) differs from the two above: only when asked for
            (OutputSource::Auto, _) => None,
            (wanted, got) => (wanted == got).then_some(1),
        }
    }
}

impl Decoder {
    pub fn new(actuators: OutputSource) -> Self {
        Self { actuators: OutputSourceRank(actuators), ..Self::default() }
    }

    pub fn clock(&self) -> &VehicleClock {
        &self.clock
    }

    /// Decodes one frame of the vehicle, received at `received_us` (µs since 1970); calls `sink` for each thing found.
    pub fn frame(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let f = frame.fields();
        match frame.message_id() {
            0 => sink(self.unstamped(received_us, SampleKind::Armed(f.u8(6) & 0x80 != 0))),
            1 => {
                let mv = f.u16(14);
                if mv != 0 && mv != u16::MAX {
                    sink(self.unstamped(received_us, SampleKind::Battery { voltage_v: f64::from(mv) * 1e-3 }));
                }
            }
            2 => self.clock.observe_unix(f.u64(0), f.u32(8)),
            22 => {
                if let Some(d) = rotor_output(f) {
                    sink(d);
                }
            }
            24 => self.gps_raw(f, received_us, sink),
            26 => self.scaled_imu::<mav::SCALED_IMU_DATA>(frame, received_us, ImuSource::Scaled, sink),
            27 => self.raw_imu(frame, received_us, sink),
            29 => {
                if let Some(m) = decode::<mav::SCALED_PRESSURE_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && m.press_abs > 0.0
                {
                    sink(sample(t, SampleKind::Pressure { pressure_pa: f64::from(m.press_abs) * 100.0 }));
                }
            }
            30 => {
                if let Some(m) = decode::<mav::ATTITUDE_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.attitude.accept(1, t)
                {
                    let q = UnitQuaternion::from_euler_angles(m.roll.into(), m.pitch.into(), m.yaw.into());
                    self.attitude(t, q.into_inner(), sink);
                }
            }
            31 => {
                if let Some(m) = decode::<mav::ATTITUDE_QUATERNION_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.attitude.accept(2, t)
                {
                    let q = Quaternion::new(m.q1.into(), m.q2.into(), m.q3.into(), m.q4.into());
                    self.attitude(t, q, sink);
                }
            }
            32 => {
                if let Some(m) = decode::<mav::LOCAL_POSITION_NED_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.velocity.accept(3, t)
                {
                    local_position(t, vector(m.x, m.y, m.z), vector(m.vx, m.vy, m.vz), sink);
                }
            }
            33 => {
                if let Some(m) = decode::<mav::GLOBAL_POSITION_INT_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.velocity.accept(1, t)
                {
                    sink(sample(
                        t,
                        SampleKind::GlobalPosition {
                            latitude_deg: f64::from(m.lat) * 1e-7,
                            longitude_deg: f64::from(m.lon) * 1e-7,
                            altitude_m: f64::from(m.alt) * 1e-3,
                            velocity_ned_mps: integers(m.vx, m.vy, m.vz) * 1e-2,
                        },
                    ));
                }
            }
            36 => self.servo_output(f, received_us, sink),
            93 => {
                if let Some(t) = self.boot_us(f.u64(0), received_us, sink) {
                    self.outputs(t, OutputSource::HilActuatorControls, |i| f.f32(16 + 4 * i).into(), sink);
                }
            }
            105 => self.highres_imu(frame, received_us, sink),
            116 => self.scaled_imu::<mav::SCALED_IMU2_DATA>(frame, received_us, ImuSource::Second, sink),
            129 => self.scaled_imu::<mav::SCALED_IMU3_DATA>(frame, received_us, ImuSource::Second, sink),
            147 => self.battery(f, received_us, sink),
            245 => {
                // MAV_LANDED_STATE: 1 on ground, 2 in air, 3 taking off, 4 landing, 0 unknown
                let in_air = match f.u8(1) {
                    1 => Some(false),
                    2..=4 => Some(true),
                    _ => None,
                };
                sink(self.unstamped(received_us, SampleKind::InAir(in_air)));
            }
            291 => self.rpm(f.u8(56), |i| f.i32(8 + 4 * i).into(), received_us, sink),
            331 => self.odometry(f, received_us, sink),
            375 => {
                if let Some(t) = self.boot_us(f.u64(0), received_us, sink) {
                    self.outputs(t, OutputSource::ActuatorOutputStatus, |i| f.f32(12 + 4 * i).into(), sink);
                }
            }
            id @ 11030..=11032 => {
                let first = (id - 11030) as u8 * 4;
                self.rpm(first, |i| f.u16(24 + 2 * i).into(), received_us, sink);
            }
            _ => {}
        }
    }

    /// A boot stamp, seen by the clock. `None` for zero: the autopilot has no time yet.
    fn stamp(&mut self, t: Stamp, received_us: u64, sink: &mut dyn FnMut(Decoded)) -> Option<Stamp> {
        if t.nanos() <= 0 {
            return None;
        }
        if let Some(ClockEvent::Reboot) = self.clock.observe(t, received_us) {
            *self = Self { clock: self.clock.clone(), ..Self::new(self.actuators.0) };
            sink(Decoded::Reboot);
        }
        Some(t)
    }

    fn boot_ms(&mut self, ms: u32, received_us: u64, sink: &mut dyn FnMut(Decoded)) -> Option<Stamp> {
        self.stamp(Stamp::from_millis(ms.into()), received_us, sink)
    }

    fn boot_us(&mut self, us: u64, received_us: u64, sink: &mut dyn FnMut(Decoded)) -> Option<Stamp> {
        let t = self.clock.from_u64_us(us)?;
        self.stamp(t, received_us, sink)
    }

    /// A sample whose message has no stamp: placed by its receive time.
    fn unstamped(&self, received_us: u64, kind: SampleKind) -> Decoded {
        sample(self.clock.from_receive_time(received_us).unwrap_or_default(), kind)
    }

    fn attitude(&mut self, t: Stamp, q: Quaternion<f64>, sink: &mut dyn FnMut(Decoded)) {
        if let Some(body_to_ned) = UnitQuaternion::try_new(q, 0.5)
            && q.norm() < 1.5
        {
            sink(sample(t, SampleKind::Attitude { body_to_ned }));
        }
    }

    fn raw_imu(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let Some(m) = decode::<mav::RAW_IMU_DATA>(frame) else { return };
        let Some(t) = self.boot_us(m.time_usec, received_us, sink) else { return };
        imu(t, ImuSource::Scaled, [m.xacc, m.yacc, m.zacc], [m.xgyro, m.ygyro, m.zgyro], sink);
        mag(t, integers(m.xmag, m.ymag, m.zmag) * 1e-3, sink);
    }

    fn scaled_imu<T: ScaledImu>(
        &mut self,
        frame: FrameRef<'_>,
        received_us: u64,
        source: ImuSource,
        sink: &mut dyn FnMut(Decoded),
    ) {
        let Some(m) = decode::<T>(frame) else { return };
        let Some(t) = self.boot_ms(m.boot_ms(), received_us, sink) else { return };
        imu(t, source, m.accel(), m.gyro(), sink);
        if source != ImuSource::Second {
            let [x, y, z] = m.mag();
            mag(t, integers(x, y, z) * 1e-3, sink);
        }
    }

    fn highres_imu(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let Some(m) = decode::<mav::HIGHRES_IMU_DATA>(frame) else { return };
        if m.id != 0 {
            return;
        }
        let Some(t) = self.boot_us(m.time_usec, received_us, sink) else { return };
        let accel_frd_mps2 = vector(m.xacc, m.yacc, m.zacc);
        let rate_frd_rads = vector(m.xgyro, m.ygyro, m.zgyro);
        if finite(accel_frd_mps2) && finite(rate_frd_rads) {
            sink(sample(t, SampleKind::Imu { source: ImuSource::HighRes, accel_frd_mps2, rate_frd_rads }));
        }
        // ArduPilot sends this field in milligauss: the Earth's field (0.2..0.7 G) tells the scale
        let field = vector(m.xmag, m.ymag, m.zmag);
        mag(t, if field.norm() > 10.0 { field * 1e-3 } else { field }, sink);
        if m.abs_pressure > 0.0 {
            sink(sample(t, SampleKind::Pressure { pressure_pa: f64::from(m.abs_pressure) * 100.0 }));
        }
    }

    fn gps_raw(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        // fix type: 2 = 2D and better
        if f.u8(28) < 2 {
            return;
        }
        let (speed, course) = (f.u16(24), f.u16(26));
        let ground_velocity_mps = (speed != u16::MAX && course != u16::MAX).then(|| {
            let (v, c) = (f64::from(speed) * 1e-2, (f64::from(course) * 1e-2).to_radians());
            [v * c.cos(), v * c.sin()]
        });
        let t = self.clock.from_u64_us(f.u64(0)).or_else(|| self.clock.from_receive_time(received_us));
        if let Some(t) = t {
            sink(sample(
                t,
                SampleKind::Gnss {
                    latitude_deg: f64::from(f.i32(8)) * 1e-7,
                    longitude_deg: f64::from(f.i32(12)) * 1e-7,
                    altitude_m: f64::from(f.i32(16)) * 1e-3,
                    ground_velocity_mps,
                },
            ));
        }
    }

    /// SERVO_OUTPUT_RAW: u32 µs that wraps; 16 outputs, of which `port` says which bank.
    fn servo_output(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        if f.u8(20) != 0 {
            return;
        }
        let t = self.clock.from_u32_us(f.u32(0));
        let Some(t) = self.stamp(t, received_us, sink) else { return };
        // outputs 1..8 at 4, 9..16 are extension fields at 21
        let at = |i: usize| if i < 8 { 4 + 2 * i } else { 21 + 2 * (i - 8) };
        self.outputs(t, OutputSource::ServoOutputRaw, |i| f.u16(at(i)).into(), sink);
    }

    fn outputs(&mut self, t: Stamp, source: OutputSource, value: impl Fn(usize) -> f64, sink: &mut dyn FnMut(Decoded)) {
        if let Some(rank) = self.actuators.of(source)
            && self.outputs.accept(rank, t)
        {
            let outputs: [f64; MAX_ROTORS] = std::array::from_fn(|i| {
                let x = value(i);
                if x.is_finite() { x } else { 0.0 }
            });
            sink(sample(t, SampleKind::Actuators { outputs }));
        }
    }

    fn battery(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        // the first battery only; cells not fitted read 65535
        if f.u8(32) != 0 {
            return;
        }
        let mv: u32 = (0..10).map(|i| f.u16(10 + 2 * i)).filter(|&c| c != u16::MAX).map(u32::from).sum();
        if mv > 0 {
            sink(self.unstamped(received_us, SampleKind::Battery { voltage_v: f64::from(mv) * 1e-3 }));
        }
    }

    /// Four rotor speeds from rotor `first` on. ESC messages have no boot stamp that can be trusted.
    fn rpm(&mut self, first: u8, value: impl Fn(usize) -> f64, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let mut rpm = [f64::NAN; MAX_ROTORS];
        for i in 0..4 {
            if let Some(slot) = rpm.get_mut(usize::from(first) + i) {
                *slot = value(i);
            }
        }
        sink(self.unstamped(received_us, SampleKind::RotorRpm { rpm }));
    }

    fn odometry(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let resets = f.u8(230);
        if self.odometry_resets.replace(resets).is_some_and(|old| old != resets) {
            sink(Decoded::EstimatorReset);
        }
        let Some(t) = self.boot_us(f.u64(0), received_us, sink) else { return };
        let at = |o: usize| vector(f.f32(o), f.f32(o + 4), f.f32(o + 8));
        let q = Quaternion::new(f.f32(20).into(), f.f32(24).into(), f.f32(28).into(), f.f32(32).into());
        // MAV_FRAME_LOCAL_NED 1, MAV_FRAME_BODY_FRD 12
        const LOCAL_NED: u8 = 1;
        const BODY_FRD: u8 = 12;
        let velocity = match (f.u8(228), f.u8(229)) {
            (LOCAL_NED, LOCAL_NED) => at(36),
            (LOCAL_NED, BODY_FRD) => match UnitQuaternion::try_new(q, 0.5) {
                Some(q) => q * at(36),
                None => return,
            },
            // any other frame has no fixed relation to NED
            _ => return,
        };
        if self.velocity.accept(2, t) {
            local_position(t, at(8), velocity, sink);
        }
    }
}

fn sample(stamp: Stamp, kind: SampleKind) -> Decoded {
    Decoded::Sample(Sample { stamp, kind })
}

fn vector(x: f32, y: f32, z: f32) -> Vector3<f64> {
    Vector3::new(x.into(), y.into(), z.into())
}

fn integers(x: i16, y: i16, z: i16) -> Vector3<f64> {
    Vector3::new(x.into(), y.into(), z.into())
}

fn finite(v: Vector3<f64>) -> bool {
    v.iter().all(|x| x.is_finite())
}

fn imu(t: Stamp, source: ImuSource, accel: [i16; 3], gyro: [i16; 3], sink: &mut dyn FnMut(Decoded)) {
    let [x, y, z] = accel;
    let [p, q, r] = gyro;
    sink(sample(
        t,
        SampleKind::Imu {
            source,
            accel_frd_mps2: integers(x, y, z) * MILLI_G,
            rate_frd_rads: integers(p, q, r) * 1e-3,
        },
    ));
}

fn mag(t: Stamp, field_frd_gauss: Vector3<f64>, sink: &mut dyn FnMut(Decoded)) {
    if finite(field_frd_gauss) && field_frd_gauss != Vector3::zeros() {
        sink(sample(t, SampleKind::Mag { field_frd_gauss }));
    }
}

fn local_position(t: Stamp, position: Vector3<f64>, velocity: Vector3<f64>, sink: &mut dyn FnMut(Decoded)) {
    if finite(position) && finite(velocity) {
        sink(sample(t, SampleKind::LocalPosition { position_ned_m: position, velocity_ned_mps: velocity }));
    }
}

/// PARAM_VALUE of ArduPilot's SERVOn_FUNCTION: 33–40 are motors 1–8, 82–85 motors 9–12.
fn rotor_output(f: Fields<'_>) -> Option<Decoded> {
    let mut id = [0u8; 16];
    for (i, b) in id.iter_mut().enumerate() {
        *b = f.u8(8 + i);
    }
    let name = id.split(|&b| b == 0).next().and_then(|b| std::str::from_utf8(b).ok())?;
    let n: usize = name.strip_prefix("SERVO")?.strip_suffix("_FUNCTION")?.parse().ok()?;
    let rotor = match f.f32(0) as u16 {
        m @ 33..=40 => m - 33,
        m @ 82..=85 => m - 82 + 8,
        _ => return None,
    };
    Some(Decoded::RotorOutput { rotor: rotor.into(), output: n.checked_sub(1)? })
}

/// SCALED_IMU, SCALED_IMU2 and SCALED_IMU3 have the same fields under three types.
trait ScaledImu: mavlink::MessageData {
    fn boot_ms(&self) -> u32;
    fn accel(&self) -> [i16; 3];
    fn gyro(&self) -> [i16; 3];
    fn mag(&self) -> [i16; 3];
}

macro_rules! scaled_imu {
    ($($t:ty),*) => {$(
        impl ScaledImu for $t {
            fn boot_ms(&self) -> u32 { self.time_boot_ms }
            fn accel(&self) -> [i16; 3] { [self.xacc, self.yacc, self.zacc] }
            fn gyro(&self) -> [i16; 3] { [self.xgyro, self.ygyro, self.zgyro] }
            fn mag(&self) -> [i16; 3] { [self.xmag, self.ymag, self.zmag] }
        }
    )*};
}

scaled_imu!(mav::SCALED_IMU_DATA, mav::SCALED_IMU2_DATA, mav::SCALED_IMU3_DATA);
