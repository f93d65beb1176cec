//! A daemon on free ports, peers that speak UDP, and an estimator whose answers are known.
#![allow(dead_code)] // each test file uses its part

use mavobserver::config::{Link, LinkUrl};
use mavobserver::daemon::{Control, Daemon, Estimator, LinkId, Settings, Summary};
use mavobserver::outputs::{OutputSettings, Rate, Rates};
use mavobserver::pipeline::{
    Event, FaultDetail, FaultMask, Reports, Snapshot, VehicleId, VehicleKind, WindEstimate, WrenchEstimate,
};
use mavobserver::signal::{Guarantee, Imu, Measurement, Stamp, Verdict};
use mavobserver::wire::dialect::ardupilotmega::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot,
    MavModeFlag, MavType, SERVO_OUTPUT_RAW_DATA,
};
use mavobserver::wire::{self, Encoder, FrameBuf, FrameRef, decode};
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;
use tokio::net::UdpSocket;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};
use tokio_util::sync::CancellationToken;

/// Where the recorded flights are, if they are here.
pub fn flight(path: &str) -> Option<PathBuf> {
    let base = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let file = base.join(path);
    if !file.exists() {
        eprintln!("SKIPPED: {} is not here; set MAVOBSERVER_DATA", file.display());
        return None;
    }
    Some(file)
}

/// A link whose outputs are switched off, so that only forwarded frames arrive.
pub fn silent(url: LinkUrl) -> Link {
    let output =
        OutputSettings { heartbeat: Rate::OFF, status_text: false, rates: Rates::OFF, ..OutputSettings::default() };
    Link { output, ..talking(url) }
}

/// A link with the usual outputs.
pub fn talking(url: LinkUrl) -> Link {
    Link::new(url, OutputSettings::default())
}

pub fn any_port() -> LinkUrl {
    LinkUrl::UdpIn { host: "127.0.0.1".to_owned(), port: 0 }
}

pub fn towards(peer: &Peer) -> LinkUrl {
    LinkUrl::UdpOut { host: "127.0.0.1".to_owned(), port: peer.socket.local_addr().expect("bound").port() }
}

/// A daemon that runs in the background of a test.
pub struct Running {
    pub addresses: Vec<Option<SocketAddr>>,
    pub stop: CancellationToken,
    pub control: Control,
    task: JoinHandle<Summary>,
}

impl Running {
    pub async fn start(settings: Settings, estimator: impl Estimator) -> Self {
        let links = settings.links.len();
        let daemon = Daemon::bind(settings).await.expect("free ports");
        let addresses = (0..links).map(|i| daemon.local_addr(LinkId(i))).collect();
        let (stop, control) = (CancellationToken::new(), daemon.control());
        let task = tokio::spawn({
            let stop = stop.clone();
            async move { daemon.run(Some(estimator), stop).await.expect("threads start") }
        });
        Self { addresses, stop, control, task }
    }

    pub fn address(&self, link: usize) -> SocketAddr {
        self.addresses[link].expect("a UDP link")
    }

    pub async fn stop(self) -> Summary {
        self.stop.cancel();
        self.ended().await
    }

    /// Waits for a daemon that ends by itself.
    pub async fn ended(self) -> Summary {
        let summary = self.task.await.expect("no panic");
        assert_eq!(summary.stragglers, Vec::<String>::new());
        summary
    }
}

/// A station with one UDP socket.
pub struct Peer {
    pub socket: UdpSocket,
    pub daemon: Option<SocketAddr>,
}

impl Peer {
    pub async fn new(daemon: Option<SocketAddr>) -> Self {
        Self { socket: UdpSocket::bind("127.0.0.1:0").await.expect("a free port"), daemon }
    }

    pub async fn send(&self, bytes: &[u8]) {
        let to = self.daemon.expect("knows the daemon");
        assert_eq!(self.socket.send_to(bytes, to).await.expect("sent"), bytes.len());
    }

    /// The next datagram within two seconds.
    pub async fn receive(&self) -> Option<Vec<u8>> {
        self.receive_until(Instant::now() + Duration::from_secs(2)).await
    }

    pub async fn receive_until(&self, deadline: Instant) -> Option<Vec<u8>> {
        let mut buffer = vec![0; 2048];
        let (length, _) = timeout_at(deadline, self.socket.recv_from(&mut buffer)).await.ok()?.expect("receives");
        buffer.truncate(length);
        Some(buffer)
    }

    /// What arrives until nothing has for a while.
    pub async fn receive_all(&self) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        while let Some(datagram) = self.receive_until(Instant::now() + Duration::from_millis(300)).await {
            all.push(datagram);
        }
        all
    }
}

/// The one frame in a datagram.
pub fn frame_of(datagram: &[u8]) -> FrameBuf {
    let mut events = wire::datagram(datagram);
    match (events.next(), events.next()) {
        (Some(wire::Event::Frame(frame)), None) => frame.into(),
        other => panic!("not one frame: {other:?}"),
    }
}

/// Estimates nothing.
pub struct Idle;

impl Estimator for Idle {
    fn frame(&mut self, _: FrameRef<'_>, _: u64, _: &mut dyn FnMut(Event<'_>)) {}

    fn forget(&mut self, _: VehicleId) {}
}

/// Answers every ATTITUDE with a snapshot whose numbers are made of it. Panics at roll = NaN.
#[derive(Default)]
pub struct Echo {
    known: BTreeSet<VehicleId>,
}

impl Echo {
    pub fn snapshot(vehicle: VehicleId, attitude: &ATTITUDE_DATA, received_unix_us: u64) -> Snapshot<'static> {
        let angles = [attitude.roll, attitude.pitch, attitude.yaw].map(f64::from);
        let vector = Vector3::from(angles);
        Snapshot {
            vehicle,
            stamp: Stamp::from_millis(attitude.time_boot_ms.into()),
            received_unix_us,
            wrench: Some(WrenchEstimate {
                force_ned_n: vector * 10.0,
                force_half_width_n: Vector3::new(0.5, 0.25, 0.125),
                torque_frd_nm: vector * 0.1,
                torque_half_width_nm: Vector3::from_element(f64::INFINITY),
                guarantee: Guarantee::Guaranteed,
                verdict: Verdict::Consistent,
            }),
            wind: Some(WindEstimate {
                velocity_ned_mps: vector * 3.0,
                half_width_mps: Vector3::from_element(1.5),
                guarantee: Guarantee::Guaranteed,
                verdict: Verdict::Consistent,
            }),
            faults: FaultMask(0b101),
            fault_candidates: FaultMask(0),
            newest_fault: Some(FaultDetail {
                mask: FaultMask(0b100),
                onset: Stamp::from_millis(1_000),
                magnitude: 0.25,
                guarantee: Guarantee::Statistical(0.999),
            }),
            verdict: Verdict::Consistent,
            observers: Reports::default(),
        }
    }
}

impl Estimator for Echo {
    fn frame(&mut self, frame: FrameRef<'_>, received_unix_us: u64, sink: &mut dyn FnMut(Event<'_>)) {
        let vehicle = VehicleId { system: frame.system_id(), component: frame.component_id() };
        if let Some(heartbeat) = decode::<HEARTBEAT_DATA>(frame)
            && heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
            && self.known.insert(vehicle)
        {
            let kind = VehicleKind { autopilot: heartbeat.autopilot as u8, mav_type: heartbeat.mavtype as u8 };
            sink(Event::NewVehicle { vehicle, kind });
        }
        if let (true, Some(attitude)) = (self.known.contains(&vehicle), decode::<ATTITUDE_DATA>(frame)) {
            assert!(!attitude.roll.is_nan(), "a defect in an observer, as the test wants it");
            let imu = Imu { accel_frd_mps2: Vector3::zeros(), rate_frd_rads: Vector3::zeros() };
            let snapshot = Self::snapshot(vehicle, &attitude, received_unix_us);
            sink(Event::Snapshot(&snapshot, &Measurement::new(snapshot.stamp, imu)));
        }
    }

    fn forget(&mut self, vehicle: VehicleId) {
        self.known.remove(&vehicle);
    }
}

pub fn heartbeat() -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        ..HEARTBEAT_DATA::DEFAULT
    }
}

/// Attitude number `k` of a vehicle: 20 ms apart, every number different and exact.
pub fn attitude(k: u32) -> ATTITUDE_DATA {
    let base = k as f32;
    ATTITUDE_DATA {
        time_boot_ms: 1_000 + 20 * k,
        roll: base / 128.0,
        pitch: -base / 64.0,
        yaw: 1.0 + base / 256.0,
        ..ATTITUDE_DATA::DEFAULT
    }
}

/// A heartbeat and then `count` attitudes, as one vehicle sends them.
pub fn flight_of(encoder: &mut Encoder, count: u32) -> Vec<FrameBuf> {
    let mut frames = vec![encoder.encode(&heartbeat())];
    frames.extend((0..count).map(|k| encoder.encode(&attitude(k))));
    frames
}

/// Step `k` (20 ms) of a vehicle like the preset `arducopter-sitl` that hovers in still air.
pub fn hover_step(encoder: &mut Encoder, k: u32) -> Vec<FrameBuf> {
    let time_boot_ms = 60_000 + 20 * k;
    let time_usec = 1_000 * u64::from(time_boot_ms);
    let armed = HEARTBEAT_DATA { base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, ..heartbeat() };
    // hover needs 39 % of full thrust: 0.35 c + 0.65 c² = 0.39 at c = 0.551 of 1150..1950 µs
    let pulse = 1591;
    let servos = SERVO_OUTPUT_RAW_DATA {
        time_usec: time_usec as u32,
        servo1_raw: pulse,
        servo2_raw: pulse,
        servo3_raw: pulse,
        servo4_raw: pulse,
        ..SERVO_OUTPUT_RAW_DATA::DEFAULT
    };
    let mut frames = Vec::new();
    if k.is_multiple_of(50) {
        frames.push(encoder.encode(&armed));
    }
    frames.push(encoder.encode(&servos));
    frames.push(encoder.encode(&LOCAL_POSITION_NED_DATA {
        time_boot_ms,
        z: -20.0,
        ..LOCAL_POSITION_NED_DATA::DEFAULT
    }));
    frames.push(encoder.encode(&ATTITUDE_QUATERNION_DATA {
        time_boot_ms,
        q1: 1.0,
        ..ATTITUDE_QUATERNION_DATA::DEFAULT
    }));
    frames.push(encoder.encode(&HIGHRES_IMU_DATA { time_usec, zacc: -9.806_65, ..HIGHRES_IMU_DATA::DEFAULT }));
    frames
}
