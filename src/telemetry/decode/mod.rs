mod actuators;
mod gnss;
mod inertial;
mod motion;

use super::clock::{ClockEvent, VehicleClock};
use crate::signal::{ImuSource, Sample, SampleKind, Stamp};
use crate::vehicle::OutputSource;
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Fields, FrameRef};
use actuators::{OutputSourceRank, rotor_output};
use nalgebra::Vector3;

/// A better message of one kind that stays silent this long gives way to the next best, s.
const SOURCE_TIMEOUT_S: f64 = 2.0;

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
    magnetometer: Best,
    pressure: Best,
    /// Newest field of HIGHRES_IMU, which repeats it until the sensor has another.
    highres_field: Option<Vector3<f64>>,
    highres_pressure: Option<f32>,
    odometry_resets: Option<u8>,
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
            29 => self.scaled_pressure(frame, received_us, sink),
            30..=33 => self.motion(frame, received_us, sink),
            36 => self.servo_output(f, received_us, sink),
            93 => {
                if let Some(t) = self.boot_us(f.u64(0), received_us, sink) {
                    self.outputs(t, OutputSource::HilActuatorControls, |i| f.f32(16 + 4 * i).into(), sink);
                }
            }
            105 => self.highres_imu(frame, received_us, sink),
            116 => self.scaled_imu::<mav::SCALED_IMU2_DATA>(frame, received_us, ImuSource::Second, sink),
            129 => self.scaled_imu::<mav::SCALED_IMU3_DATA>(frame, received_us, ImuSource::Third, sink),
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
            251 => self.named_value(f, received_us, sink),
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

    /// NAMED_VALUE_FLOAT `MASS_KG`: a vehicle that sprays or carries says what it weighs now, for example from a script.
    fn named_value(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        const NAME: &[u8] = b"MASS_KG\0";
        let mass_kg = f64::from(f.f32(4));
        let named = NAME.iter().enumerate().all(|(i, c)| f.u8(8 + i) == *c);
        if named && mass_kg.is_finite() && mass_kg > 0.0 {
            sink(self.unstamped(received_us, SampleKind::Mass { mass_kg }));
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

#[cfg(test)]
mod tests;
