//! Foxglove's own message types, for its map, 3D and log panels: made from the usual telemetry and from estimates.
//!
//! Frames: `map` has its z axis up, as the panels expect; `SYSTEM/ned` is the vehicle's local frame in it, `SYSTEM/here`
//! the same moved to the vehicle, and `SYSTEM/body` the vehicle (FRD).

mod schemas;

use super::error::RecordError;
use super::proto::PutProto;
use super::publisher::{ChannelSink, Publisher};
use crate::pipeline::Snapshot;
use crate::wire::FrameRef;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::collections::HashMap;

const GPS_RAW_INT: u32 = 24;
const ATTITUDE: u32 = 30;
const ATTITUDE_QUATERNION: u32 = 31;
const LOCAL_POSITION_NED: u32 = 32;
const GLOBAL_POSITION_INT: u32 = 33;
const STATUSTEXT: u32 = 253;

/// Length of an arrow for one newton, one newton metre, and one metre per second, m.
const METRES_PER_NEWTON: f64 = 0.25;
const METRES_PER_NEWTON_METRE: f64 = 1.0;
const METRES_PER_MPS: f64 = 0.25;

/// What the panels need to know from one message to the next.
#[derive(Debug, Default)]
pub(super) struct Scene {
    vehicles: HashMap<u8, Vehicle>,
}

#[derive(Debug)]
struct Vehicle {
    has_quaternion: bool,
    /// The local frame has its place in the map.
    is_placed: bool,
    topics: Topics,
}

#[derive(Debug)]
struct Topics {
    location: String,
    gnss: String,
    transform: String,
    log: String,
    scene: String,
    ned: String,
    here: String,
    body: String,
}

/// What a frame gives for the panels.
enum Given {
    Location { gnss: bool, latitude_deg: f64, longitude_deg: f64, altitude_m: f64 },
    Position(Vector3<f64>),
    Attitude(UnitQuaternion<f64>),
    Log { level: u64, text: Vec<u8> },
}

impl Vehicle {
    fn new(system: u8) -> Self {
        let topic = |name: &str| format!("/foxglove/{system}/{name}");
        let topics = Topics {
            location: topic("location"),
            gnss: topic("gnss"),
            transform: topic("tf"),
            log: topic("log"),
            scene: topic("scene"),
            ned: format!("{system}/ned"),
            here: format!("{system}/here"),
            body: format!("{system}/body"),
        };
        Self { has_quaternion: false, is_placed: false, topics }
    }

    fn take(&mut self, frame: FrameRef<'_>) -> Option<Given> {
        let f = frame.fields();
        let degrees = |at| f64::from(f.i32(at)) * 1e-7;
        match frame.message_id() {
            GLOBAL_POSITION_INT => Some(Given::Location {
                gnss: false,
                latitude_deg: degrees(4),
                longitude_deg: degrees(8),
                altitude_m: f64::from(f.i32(12)) * 1e-3,
            }),
            // without a fix there is no place
            GPS_RAW_INT if f.u8(28) >= 2 => Some(Given::Location {
                gnss: true,
                latitude_deg: degrees(8),
                longitude_deg: degrees(12),
                altitude_m: f64::from(f.i32(16)) * 1e-3,
            }),
            LOCAL_POSITION_NED => Some(Given::Position(Vector3::new(f.f32(4), f.f32(8), f.f32(12)).cast())),
            ATTITUDE_QUATERNION => {
                let q = Quaternion::new(f.f32(4), f.f32(8), f.f32(12), f.f32(16)).cast();
                self.has_quaternion = true;
                UnitQuaternion::try_new(q, 1e-6).map(Given::Attitude)
            }
            ATTITUDE if !self.has_quaternion => {
                let [roll, pitch, yaw] = [f.f32(4), f.f32(8), f.f32(12)].map(f64::from);
                Some(Given::Attitude(UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
            }
            STATUSTEXT => {
                // MAV_SEVERITY falls, Foxglove's levels rise
                let level = match f.u8(0) {
                    0..=2 => 5,
                    3 => 4,
                    4 => 3,
                    5 | 6 => 2,
                    _ => 1,
                };
                let text = f.array::<50>(1);
                let text = text.split(|&b| b == 0).next().unwrap_or_default();
                Some(Given::Log { level, text: String::from_utf8_lossy(text).into_owned().into_bytes() })
            }
            _ => None,
        }
    }
}

/// Whether a message gives something for the panels.
pub(super) fn is_wanted(message_id: u32) -> bool {
    matches!(
        message_id,
        GPS_RAW_INT | ATTITUDE | ATTITUDE_QUATERNION | LOCAL_POSITION_NED | GLOBAL_POSITION_INT | STATUSTEXT
    )
}

impl<S: ChannelSink> Publisher<S> {
    pub(super) fn panels(&mut self, log_ns: u64, publish_ns: u64, frame: FrameRef<'_>) -> Result<(), RecordError> {
        let mut scene = std::mem::take(&mut self.scene);
        let result = self.panels_of(&mut scene, log_ns, publish_ns, frame);
        self.scene = scene;
        result
    }

    fn panels_of(&mut self, scene: &mut Scene, log: u64, publish: u64, frame: FrameRef<'_>) -> Result<(), RecordError> {
        let system = frame.system_id();
        let vehicle = scene.vehicles.entry(system).or_insert_with(|| Vehicle::new(system));
        let Some(given) = vehicle.take(frame) else { return Ok(()) };
        let topics = &vehicle.topics;
        match given {
            Given::Location { gnss, latitude_deg, longitude_deg, altitude_m } => {
                let topic = if gnss { &topics.gnss } else { &topics.location };
                self.derived(topic, (log, publish), "LocationFix", schemas::PACKAGE, schemas::location_fix, |out| {
                    out.put_f64(1, latitude_deg);
                    out.put_f64(2, longitude_deg);
                    out.put_f64(3, altitude_m);
                    put_time(out, 6, publish);
                    out.put_bytes(7, topics.body.as_bytes());
                })
            }
            Given::Position(position) => {
                if !vehicle.is_placed {
                    vehicle.is_placed = true;
                    // half a turn about the axis between x and y takes NED to ENU
                    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0));
                    let up = UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
                    self.transform(topics, (log, publish), ("map", &topics.ned), &Vector3::zeros(), &up)?;
                }
                let frames = (topics.ned.as_str(), topics.here.as_str());
                self.transform(topics, (log, publish), frames, &position, &UnitQuaternion::identity())
            }
            Given::Attitude(rotation) => {
                let frames = (topics.here.as_str(), topics.body.as_str());
                self.transform(topics, (log, publish), frames, &Vector3::zeros(), &rotation)
            }
            Given::Log { level, text } => {
                self.derived(&topics.log, (log, publish), "Log", schemas::PACKAGE, schemas::log, |out| {
                    put_time(out, 1, publish);
                    out.put_u64(2, level);
                    out.put_bytes(3, &text);
                    out.put_bytes(4, format!("{}/{}", system, frame.component_id()).as_bytes());
                })
            }
        }
    }

    fn transform(
        &mut self,
        topics: &Topics,
        times: (u64, u64),
        (parent, child): (&str, &str),
        translation: &Vector3<f64>,
        rotation: &UnitQuaternion<f64>,
    ) -> Result<(), RecordError> {
        let package = schemas::PACKAGE;
        self.derived(&topics.transform, times, "FrameTransform", package, schemas::frame_transform, |out| {
            put_time(out, 1, times.1);
            out.put_bytes(2, parent.as_bytes());
            out.put_bytes(3, child.as_bytes());
            out.put_message(4, |out| put_vector(out, translation));
            out.put_message(5, |out| put_quaternion(out, rotation));
        })
    }

    /// Arrows for force, torque and wind, at the vehicle.
    pub(super) fn arrows(&mut self, s: &Snapshot<'_>, times: (u64, u64)) -> Result<(), RecordError> {
        let Some(wrench) = s.wrench else { return Ok(()) };
        let mut scene = std::mem::take(&mut self.scene);
        let system = s.vehicle.system;
        let vehicle = scene.vehicles.entry(system).or_insert_with(|| Vehicle::new(system));
        let topics = &vehicle.topics;
        let force = wrench.force_ned_n * METRES_PER_NEWTON;
        let torque = wrench.torque_frd_nm * METRES_PER_NEWTON_METRE;
        let result =
            self.derived(&topics.scene, times, "SceneUpdate", schemas::PACKAGE, schemas::scene_update, |out| {
                put_arrow(out, times.1, &topics.here, "force", &force, [1.0, 0.3, 0.1]);
                put_arrow(out, times.1, &topics.body, "torque", &torque, [0.9, 0.2, 0.9]);
                if let Some(wind) = s.wind {
                    let velocity = wind.velocity_ned_mps * METRES_PER_MPS;
                    put_arrow(out, times.1, &topics.here, "wind", &velocity, [0.1, 0.5, 1.0]);
                }
            });
        self.scene = scene;
        result
    }
}

fn put_time(out: &mut Vec<u8>, number: u32, unix_ns: u64) {
    out.put_message(number, |out| {
        out.put_u64(1, unix_ns / 1_000_000_000);
        out.put_u64(2, unix_ns % 1_000_000_000);
    });
}

fn put_vector(out: &mut Vec<u8>, v: &Vector3<f64>) {
    (1..).zip(v.iter()).for_each(|(number, &x)| out.put_f64(number, x));
}

fn put_quaternion(out: &mut Vec<u8>, q: &UnitQuaternion<f64>) {
    // nalgebra keeps them in this order too: x, y, z, w
    (1..).zip(q.coords.iter()).for_each(|(number, &x)| out.put_f64(number, x));
}

/// One entity of a SceneUpdate: an arrow from the origin of `frame` along `along`.
fn put_arrow(out: &mut Vec<u8>, unix_ns: u64, frame: &str, id: &str, along: &Vector3<f64>, color: [f64; 3]) {
    const HEAD_M: f64 = 0.15;
    let length = along.norm();
    // an arrow of no length has no direction
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    out.put_message(2, |out| {
        put_time(out, 1, unix_ns);
        out.put_bytes(2, frame.as_bytes());
        out.put_bytes(3, id.as_bytes());
        out.put_message(7, |out| {
            out.put_message(1, |out| {
                out.put_message(1, |out| put_vector(out, &Vector3::zeros()));
                out.put_message(2, |out| put_quaternion(out, &turn));
            });
            out.put_f64(2, (length - HEAD_M).max(0.0));
            out.put_f64(3, 0.05);
            out.put_f64(4, length.min(HEAD_M));
            out.put_f64(5, 0.12);
            out.put_message(6, |out| {
                (1..).zip(color.into_iter().chain([1.0])).for_each(|(number, x)| out.put_f64(number, x));
            });
        });
    });
}
