//! The daemon on real sockets: forwarding, estimates, isolation of failures, recording, stopping.
// GET_MESSAGE_INTERVAL is superseded, and what autopilots answer.
#![allow(deprecated)]

mod live_support;

use live_support::*;
use mavobserver::config::{LinkUrl, Pace, Recording};
use mavobserver::daemon::{Daemon, DaemonError, Settings};
use mavobserver::pipeline::VehicleId;
use mavobserver::record::session::Policy;
use mavobserver::wire::dialect::ardupilotmega::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavType, STATUSTEXT_DATA,
    SYSTEM_TIME_DATA, TIMESYNC_DATA,
};
use mavobserver::wire::dialect::mavobserver::{FAULT_STATUS_DATA, WIND_ESTIMATE_DATA, WRENCH_ESTIMATE_DATA};
use mavobserver::wire::tlog::{TlogReader, TlogWriter};
use mavobserver::wire::{self, Encoder, FrameBuf, decode};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const SECONDS_2: Duration = Duration::from_secs(2);

/// A signed frame: flag, link id, time stamp and signature behind the checksum. Nobody here can check it.
fn signed(encoder: &mut Encoder) -> Vec<u8> {
    let mut bytes = encoder.encode(&attitude(3)).bytes().to_vec();
    bytes[2] = 1;
    let end = bytes.len() - 2;
    let crc = mavlink_core::calculate_crc(&bytes[1..end], 39);
    bytes[end..].copy_from_slice(&crc.to_le_bytes());
    bytes.extend([7; 13]);
    bytes
}

/// A frame of a message that no dialect defines.
fn unknown() -> Vec<u8> {
    vec![0xFD, 4, 0, 0, 9, 1, 1, 0x39, 0x30, 0x00, 1, 2, 3, 4, 0xAA, 0xBB]
}

#[tokio::test]
async fn frames_pass_untouched_to_all_other_links_and_peers() {
    let ground = Peer::new(None).await;
    let settings = Settings::new(vec![silent(any_port()), silent(any_port()), silent(towards(&ground))]);
    let daemon = Running::start(settings, Idle).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let companion = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(1))).await;

    // everyone is heard once, so that everyone has an address
    let hello = |system: u8| Encoder::new(system, 190).encode(&HEARTBEAT_DATA::DEFAULT);
    companion.send(hello(2).bytes()).await;
    station.send(hello(255).bytes()).await;
    assert_eq!(companion.receive().await.as_deref(), Some(hello(255).bytes()));
    assert_eq!(ground.receive_all().await.len(), 2);

    let mut encoder = Encoder::new(1, 1);
    let mut sent: Vec<Vec<u8>> = flight_of(&mut encoder, 50).iter().map(|f| f.bytes().to_vec()).collect();
    sent.push(signed(&mut encoder));
    sent.push(unknown());
    sent.push(Encoder::new(1, 1).encode_v1(&attitude(1)).expect("fits").bytes().to_vec());
    for frame in &sent {
        vehicle.send(frame).await;
    }
    for (name, peer) in [("companion", &companion), ("station", &station), ("ground", &ground)] {
        assert_eq!(peer.receive_all().await, sent, "{name}");
    }
    assert_eq!(vehicle.receive_all().await, Vec::<Vec<u8>>::new(), "nothing comes back to its sender");

    // and the other way round, to both peers of one port
    let command = Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT);
    station.send(command.bytes()).await;
    for peer in [&vehicle, &companion, &ground] {
        assert_eq!(peer.receive().await.as_deref(), Some(command.bytes()));
    }
    // an answer to udpout's frames comes in at the port that it sends from
    let back = ("127.0.0.1", daemon.address(2).port());
    ground.socket.send_to(hello(254).bytes(), back).await.expect("sent");
    assert_eq!(station.receive().await.as_deref(), Some(hello(254).bytes()));

    let summary = daemon.stop().await;
    assert_eq!(summary.status.links[0].frames_in, sent.len() as u64 + 1);
    assert_eq!(summary.status.links[0].peers, 2);
    assert_eq!(summary.status.links.iter().map(|l| l.dropped_out).sum::<u64>(), 0);
}

#[tokio::test]
async fn damage_stops_here_and_several_frames_in_a_datagram_part() {
    let daemon = Running::start(Settings::new(vec![silent(any_port()), silent(any_port())]), Idle).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT).bytes()).await;
    vehicle.send(b"not a frame at all").await;
    assert!(vehicle.receive_all().await.is_empty(), "who sends no MAVLink is no peer");

    let mut encoder = Encoder::new(1, 1);
    let frames = flight_of(&mut encoder, 2);
    let mut damaged = frames[1].bytes().to_vec();
    damaged[12] ^= 0x40;
    let datagram = [frames[0].bytes(), &damaged, frames[2].bytes()].concat();
    vehicle.send(&datagram).await;
    assert_eq!(station.receive_all().await, [frames[0].bytes(), frames[2].bytes()]);
    let summary = daemon.stop().await;
    let link = &summary.status.links[0];
    assert_eq!((link.frames_in, link.bad_in, link.lost_in), (2, 2, 1));
}

#[tokio::test]
async fn a_link_that_cannot_send_disturbs_no_other() {
    // nobody listens at the first; the second is a network that does not exist here
    let nobody = LinkUrl::UdpOut { host: "127.0.0.1".to_owned(), port: 9 };
    let nowhere = LinkUrl::UdpOut { host: "240.0.0.1".to_owned(), port: 14550 };
    let links = vec![silent(any_port()), silent(nobody), silent(nowhere), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(3))).await;
    station.send(Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT).bytes()).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    let frames = flight_of(&mut Encoder::new(1, 1), 100);
    for frame in &frames {
        vehicle.send(frame.bytes()).await;
    }
    assert_eq!(station.receive_all().await, frames.iter().map(|f| f.bytes().to_vec()).collect::<Vec<_>>());
    daemon.stop().await;
}

/// Sends a flight at its pace, as a vehicle does, and gives what a station received meanwhile.
async fn fly(daemon: &Running, system: u8, attitudes: u32) -> Vec<FrameBuf> {
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT).bytes()).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    for frame in flight_of(&mut Encoder::new(system, 1), attitudes) {
        vehicle.send(frame.bytes()).await;
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    station.receive_all().await.iter().map(|d| frame_of(d)).collect()
}

#[tokio::test]
async fn estimates_leave_as_component_191_with_the_estimators_very_numbers() {
    let daemon = Running::start(Settings::new(vec![talking(any_port()), talking(any_port())]), Echo::default()).await;
    let begin = std::time::Instant::now();
    let received = fly(&daemon, 7, 200).await;
    let seconds = begin.elapsed().as_secs();
    daemon.stop().await;

    let ours: Vec<_> = received.iter().map(FrameBuf::as_ref).filter(|f| f.component_id() == 191).collect();
    assert!(ours.iter().all(|f| f.system_id() == 7), "in the vehicle's name");
    let mut next = ours[0].sequence();
    for frame in &ours {
        assert_eq!(frame.sequence(), next, "a receiver counts no loss");
        next = next.wrapping_add(1);
    }
    let heartbeat = ours.iter().find_map(|f| decode::<HEARTBEAT_DATA>(*f)).expect("a heartbeat");
    assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
    assert_eq!(heartbeat.autopilot, MavAutopilot::MAV_AUTOPILOT_INVALID);
    let text = ours.iter().find_map(|f| decode::<STATUSTEXT_DATA>(*f)).expect("a greeting");
    assert!(text.text.to_str().expect("ASCII").contains("observes this vehicle"));

    let vehicle = VehicleId { system: 7, component: 1 };
    let expected: BTreeMap<u64, _> = (0..200)
        .map(|k| (1_000 * u64::from(attitude(k).time_boot_ms), Echo::snapshot(vehicle, &attitude(k), 0)))
        .collect();
    let floats = |v: nalgebra::Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
    let mut counts = [0_u64; 3];
    for frame in ours {
        if let Some(wrench) = decode::<WRENCH_ESTIMATE_DATA>(frame) {
            let truth = expected[&wrench.time_boot_us].wrench.expect("always");
            assert_eq!(wrench.force_ned, floats(truth.force_ned_n));
            assert_eq!(wrench.torque_frd, floats(truth.torque_frd_nm));
            assert_eq!(wrench.torque_half_width, [f32::INFINITY; 3]);
            counts[0] += 1;
        }
        if let Some(wind) = decode::<WIND_ESTIMATE_DATA>(frame) {
            assert_eq!(wind.wind_ned, floats(expected[&wind.time_boot_us].wind.expect("always").velocity_ned_mps));
            counts[1] += 1;
        }
        if let Some(vect) = decode::<DEBUG_VECT_DATA>(frame)
            && vect.name.to_str() == Ok("WR_F")
        {
            let force = expected[&vect.time_usec].wrench.expect("always").force_ned_n;
            assert_eq!([vect.x, vect.y, vect.z], floats(force));
            counts[2] += 1;
        }
    }
    // a second of flight, or more on a busy machine, at ten a second
    let most = 12 + 10 * seconds;
    assert!(counts.iter().all(|&count| (5..=most).contains(&count)), "{counts:?} in {seconds} s");
}

#[tokio::test]
async fn a_defect_in_one_vehicle_spares_the_others() {
    let daemon = Running::start(Settings::new(vec![talking(any_port())]), Echo::default()).await;
    let link = Peer::new(Some(daemon.address(0))).await;
    let (mut broken, mut sound) = (Encoder::new(2, 1), Encoder::new(3, 1));
    for round in 0..10 {
        link.send(broken.encode(&heartbeat()).bytes()).await;
        link.send(sound.encode(&heartbeat()).bytes()).await;
        let mut bad = attitude(round);
        bad.roll = f32::NAN;
        link.send(broken.encode(&bad).bytes()).await;
        link.send(sound.encode(&attitude(round)).bytes()).await;
    }
    link.receive_all().await;
    let summary = daemon.stop().await;
    assert_eq!(summary.status.vehicles[&VehicleId { system: 3, component: 1 }].snapshots, 10);
    assert!(!summary.status.vehicles.contains_key(&VehicleId { system: 2, component: 1 }));
}

#[tokio::test]
async fn live_vehicles_are_asked_for_streams_and_time_and_logs_are_not() {
    use mavobserver::signal::Channel;
    use mavobserver::telemetry::requests::Need;

    let mut settings = Settings::new(vec![talking(any_port()), talking(any_port())]);
    settings.requests = Some(vec![Need::at_default_rate(Channel::Gnss)]);
    let daemon = Running::start(settings, Echo::default()).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT).bytes()).await;
    let mut encoder = Encoder::new(1, 1);
    let (mut command, mut time) = (None::<COMMAND_LONG_DATA>, None::<TIMESYNC_DATA>);
    for k in 0..600 {
        vehicle.send(encoder.encode(&heartbeat()).bytes()).await;
        vehicle.send(encoder.encode(&attitude(k)).bytes()).await;
        tokio::time::sleep(Duration::from_millis(10)).await;
        let mut buffer = [0; 300];
        while let Ok((length, _)) = vehicle.socket.try_recv_from(&mut buffer) {
            let frame = frame_of(&buffer[..length]);
            let about_streams =
                decode::<COMMAND_LONG_DATA>(frame.as_ref()).filter(|c| c.command != MavCmd::MAV_CMD_REQUEST_MESSAGE);
            command = command.or(about_streams);
            time = time.or_else(|| decode(frame.as_ref()));
        }
        if command.is_some() && time.is_some() {
            break;
        }
    }
    let command = command.expect("asked for a stream");
    assert_eq!((command.command, command.param1), (MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, 24.0));
    assert_eq!(time.expect("asked for the time").tc1, 0);
    let to_station = station.receive_all().await;
    let asks = |id: u32| to_station.iter().filter(|d| frame_of(d).as_ref().message_id() == id).count();
    assert_eq!(asks(76) + asks(111), 0, "questions go to the vehicle alone");
    daemon.stop().await;
}

/// Writes frames 10 ms apart.
fn write_log(path: &Path, frames: &[FrameBuf]) {
    let mut log = TlogWriter::new(File::create(path).expect("writable"));
    for (k, frame) in frames.iter().enumerate() {
        log.write(1_700_000_000_000_000 + 10_000 * k as u64, frame.as_ref()).expect("written");
    }
}

fn read_log(path: &Path) -> Vec<(u64, FrameBuf)> {
    let mut reader = TlogReader::open(path).expect("a log");
    let mut frames = Vec::new();
    while let Some(record) = reader.next().expect("readable") {
        if let wire::Event::Frame(frame) = record.event {
            frames.push((record.received_unix_us.expect("stamped"), frame.into()));
        }
    }
    frames
}

#[tokio::test]
async fn a_log_is_played_whole_recorded_whole_and_ends_the_daemon() {
    let directory = tempfile::tempdir().expect("a directory");
    let log = directory.path().join("flight.tlog");
    // more than any queue holds
    write_log(&log, &flight_of(&mut Encoder::new(1, 1), 20_000));
    let mut settings = Settings::new(vec![talking(LinkUrl::Tlog { path: log.clone(), pace: Pace::Max })]);
    let records = directory.path().join("records");
    settings.record = Some(Recording { directory: records.clone(), policy: Policy::default() });
    let daemon = Running::start(settings, Echo::default()).await;
    let summary = daemon.ended().await;
    let vehicle = summary.status.vehicles[&VehicleId { system: 1, component: 1 }];
    assert_eq!((vehicle.snapshots, summary.status.estimator_missed), (20_000, 0));

    let mut files: Vec<_> = std::fs::read_dir(&records).expect("made").map(|f| f.expect("read").path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "tlog"));
    files.sort_by_key(|f| f.to_string_lossy().contains(".sent."));
    let recording = summary.status.recording.expect("recorded");
    let received = read_log(&files[0]);
    let original = read_log(&log);
    if recording.missed == 0 {
        assert_eq!(received, original);
    }
    let sent = read_log(&files[1]);
    assert!(sent.iter().all(|(_, f)| f.as_ref().component_id() == 191));
    assert_eq!(received.len() as u64 + sent.len() as u64, recording.frames);
    // what is missed may have been received or sent, and how much was sent only the recording tells
    let gone = original.len() as u64 - received.len() as u64;
    assert!(gone <= recording.missed, "every gap is counted: {gone} of {}", recording.missed);
}

#[tokio::test]
async fn a_log_at_its_own_pace_takes_its_time_over_the_speed() {
    let directory = tempfile::tempdir().expect("a directory");
    let log = directory.path().join("flight.tlog");
    write_log(&log, &flight_of(&mut Encoder::new(1, 1), 200));
    let station = Peer::new(None).await;
    let links = vec![silent(LinkUrl::Tlog { path: log, pace: Pace::Times(4.0) }), silent(towards(&station))];
    let begin = std::time::Instant::now();
    let daemon = Running::start(Settings::new(links), Idle).await;
    let mut count = 0;
    while count < 201 && station.receive().await.is_some() {
        count += 1;
    }
    // two seconds of log at four times its speed; a busy machine may be late, never early
    let took = begin.elapsed();
    assert!(count == 201 && took > Duration::from_millis(480), "{count} frames in {took:?}");
    daemon.stop().await;
}

#[tokio::test]
async fn an_occupied_port_is_an_error_that_says_what_to_do() {
    let holder = Peer::new(None).await;
    let port = holder.socket.local_addr().expect("bound").port();
    let url = LinkUrl::UdpIn { host: "127.0.0.1".to_owned(), port };
    let error = Daemon::bind(Settings::new(vec![silent(url)])).await.expect_err("the port is taken");
    assert!(matches!(error, DaemonError::PortInUse { .. }));
    let text = error.to_string();
    assert!(text.contains(&format!("127.0.0.1:{port}")) && text.contains("in use"), "{text}");
}

#[tokio::test]
async fn a_missing_log_is_an_error_at_the_start() {
    let log = LinkUrl::Tlog { path: "no/such.tlog".into(), pace: Pace::Max };
    let error = Daemon::bind(Settings::new(vec![silent(log)])).await.expect_err("no such file");
    assert!(matches!(error, DaemonError::Log { .. }) && error.to_string().contains("no/such.tlog"), "{error}");
}

#[tokio::test]
async fn an_estimator_that_hangs_is_named_and_left_behind() {
    struct Stuck;
    impl mavobserver::daemon::Estimator for Stuck {
        fn frame(&mut self, _: wire::FrameRef<'_>, _: u64, _: &mut dyn FnMut(mavobserver::pipeline::Event<'_>)) {
            std::thread::sleep(Duration::from_secs(5));
        }
        fn forget(&mut self, _: VehicleId) {}
    }
    let mut settings = Settings::new(vec![silent(any_port())]);
    settings.stop_within = Duration::from_millis(200);
    let daemon = Daemon::bind(settings).await.expect("a free port");
    let address = daemon.local_addr(mavobserver::daemon::LinkId(0));
    let stop = tokio_util::sync::CancellationToken::new();
    let running = tokio::spawn(daemon.run(Some(Stuck), stop.clone()));
    let peer = Peer::new(address).await;
    let mut encoder = Encoder::new(1, 1);
    peer.send(encoder.encode(&SYSTEM_TIME_DATA::DEFAULT).bytes()).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    let begin = std::time::Instant::now();
    stop.cancel();
    let summary = running.await.expect("no panic").expect("ran");
    assert_eq!(summary.stragglers, ["the estimator"]);
    assert!(begin.elapsed() < SECONDS_2);
}

/// The flight of a simulated ArduCopter through the whole program, live, against the same observers offline on what the
/// daemon recorded: every number the same to the last bit that leaves.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn live_estimates_equal_those_of_the_recording() {
    use mavobserver::outputs::Rate;
    use mavobserver::pipeline::{Event, Fleet, FleetSettings};
    use std::sync::Arc;

    const FRAMES: usize = 40_000;
    /// Frames on their way at most, so that no socket overflows.
    const WINDOW: usize = 40;
    /// Flight time that may wait for the estimator, so that its queue does not overflow either.
    const LEAD_MS: u64 = 3_000;

    let Some(log) = flight("sitl/wind_dev.tlog") else { return };
    let frames: Vec<_> = read_log(&log).into_iter().take(FRAMES).map(|(_, frame)| frame).collect();
    let vehicle = Arc::new(mavobserver::vehicle::resolve("arducopter-sitl").expect("a preset"));
    let fleet = || Fleet::new(FleetSettings::standard(Arc::clone(&vehicle))).expect("a design");

    let directory = tempfile::tempdir().expect("a directory");
    let mut station_link = silent(any_port());
    station_link.output.rates.wrench_estimate = Rate::EVERY;
    station_link.output.rates.wind_estimate = Rate::EVERY;
    station_link.output.rates.fault_status = Rate::EVERY;
    let mut settings = Settings::new(vec![silent(any_port()), station_link]);
    settings.record = Some(Recording { directory: directory.path().to_owned(), policy: Policy::default() });
    settings.stop_within = Duration::from_secs(60);
    let daemon = Running::start(settings, fleet()).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(Encoder::new(255, 190).encode(&HEARTBEAT_DATA::DEFAULT).bytes()).await;
    tokio::time::sleep(Duration::from_millis(100)).await;

    let passed = Arc::new(tokio::sync::Semaphore::new(WINDOW));
    let estimated_ms = Arc::new(AtomicU64::new(0));
    let player = tokio::spawn({
        let (passed, estimated_ms) = (Arc::clone(&passed), Arc::clone(&estimated_ms));
        let (to, frames) = (daemon.address(0), frames.clone());
        async move {
            let vehicle = Peer::new(Some(to)).await;
            for frame in &frames {
                passed.acquire().await.expect("open").forget();
                if let Some(attitude) = decode::<ATTITUDE_DATA>(frame.as_ref()) {
                    let ahead = |estimated: u64| u64::from(attitude.time_boot_ms).saturating_sub(estimated) > LEAD_MS;
                    // nothing is estimated before the first measurement
                    while matches!(estimated_ms.load(Ordering::Relaxed), ms if ms > 0 && ahead(ms)) {
                        tokio::time::sleep(Duration::from_millis(2)).await;
                    }
                }
                vehicle.send(frame.bytes()).await;
            }
        }
    });
    let (mut bridged, mut wrenches, mut winds) = (0, Vec::new(), Vec::new());
    while let Some(datagram) = station.receive().await {
        let frame = frame_of(&datagram);
        if let Some(wrench) = decode::<WRENCH_ESTIMATE_DATA>(frame.as_ref()) {
            wrenches.push(wrench);
        } else if let Some(wind) = decode::<WIND_ESTIMATE_DATA>(frame.as_ref()) {
            winds.push(wind);
        } else if let Some(status) = decode::<FAULT_STATUS_DATA>(frame.as_ref()) {
            estimated_ms.store(status.time_boot_us / 1_000, Ordering::Relaxed);
        } else if frame.as_ref().component_id() == 191 {
            // the faults as a number, for stations without the dialect
        } else {
            assert_eq!(datagram, frames[bridged].bytes(), "frame {bridged} arrives in order and untouched");
            bridged += 1;
            passed.add_permits(1);
        }
    }
    player.await.expect("no panic");
    let summary = daemon.stop().await;
    assert_eq!(bridged, frames.len());
    assert_eq!((summary.status.estimator_missed, summary.status.recording.map(|r| r.missed)), (0, Some(0)));

    let recording = std::fs::read_dir(directory.path()).expect("made").map(|f| f.expect("read").path());
    let recording: Vec<_> = recording.filter(|f| f.to_string_lossy().ends_with("Z.tlog")).collect();
    let (mut forces, mut speeds) = (BTreeMap::new(), BTreeMap::new());
    let mut offline = fleet();
    for (at, frame) in read_log(&recording[0]) {
        offline.frame(frame.as_ref(), at, &mut |event| {
            if let Event::Snapshot(snapshot, _) = event {
                let boot_us = (snapshot.stamp.nanos() / 1_000) as u64;
                snapshot.wrench.map(|w| forces.insert(boot_us, w));
                snapshot.wind.map(|w| speeds.insert(boot_us, w));
            }
        });
    }
    let floats = |v: nalgebra::Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
    for live in &wrenches {
        let offline = &forces[&live.time_boot_us];
        assert_eq!(live.force_ned, floats(offline.force_ned_n));
        assert_eq!(live.torque_frd, floats(offline.torque_frd_nm));
        for (live, offline) in live.force_half_width.iter().zip(offline.force_half_width_n.iter()) {
            // rounded up, by no more than the rounding of value and width
            let excess = f64::from(*live) - offline;
            assert!(
                live.is_infinite() == offline.is_infinite() && (live.is_infinite() || (0.0..1e-5).contains(&excess))
            );
        }
    }
    for live in &winds {
        assert_eq!(live.wind_ned, floats(speeds[&live.time_boot_us].velocity_ned_mps));
    }
    eprintln!("{} wrenches and {} winds are equal", wrenches.len(), winds.len());
    assert!(wrenches.len() > 1_000 && winds.len() > 1_000, "{} and {}", wrenches.len(), winds.len());
}
