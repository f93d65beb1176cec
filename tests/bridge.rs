//! The bridge on real sockets and pseudo-terminals: what comes and goes, who is addressed, what is lost.

mod live_support;

use live_support::*;
use mavobserver::config::{Flow, Link, LinkUrl};
use mavobserver::daemon::{Settings, Summary};
use mavobserver::routing::{Filter, Ids, Limits, Rules, Selection};
use mavobserver::sim::faults::{LinkTrouble, TroubledLink};
use mavobserver::sim::random::{Part, Random};
use mavobserver::wire::dialect::ardupilotmega::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, ENCAPSULATED_DATA_DATA, HEARTBEAT_DATA,
};
use mavobserver::wire::stats::{LinkStats, Losses, Source};
use mavobserver::wire::{Encoder, Event, FrameBuf, Parser, datagram};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, sleep, timeout};

const PATIENCE: Duration = Duration::from_secs(20);

fn hello(system: u8) -> FrameBuf {
    Encoder::new(system, 190).encode(&HEARTBEAT_DATA::DEFAULT)
}

fn command(target_system: u8, target_component: u8) -> FrameBuf {
    let command = COMMAND_LONG_DATA { target_system, target_component, ..COMMAND_LONG_DATA::DEFAULT };
    Encoder::new(255, 190).encode(&command)
}

fn lost(summary: &Summary, link: usize, system: u8) -> (u64, u64) {
    let source = summary.status.links[link].sources.iter().find(|s| s.source == Source { system, component: 1 });
    source.map_or((0, 0), |s| (s.frames, s.lost))
}

/// Waits until something holds.
async fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !holds() {
        assert!(Instant::now() < deadline, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(5)).await;
    }
}

/// Three vehicles of 250 frames a second on one socket through a bad radio: counted losses against the frames that
/// really never arrived, and what came late or twice.
#[test]
fn losses_are_counted_right_whatever_the_link_does() {
    let troubles = [
        ("nothing", LinkTrouble::default()),
        ("loss", LinkTrouble { loss: 0.2, ..LinkTrouble::default() }),
        ("duplication", LinkTrouble { duplicate: 0.2, ..LinkTrouble::default() }),
        ("delay", LinkTrouble { delay_s: 0.3, ..LinkTrouble::default() }),
        ("reordering", LinkTrouble { reorder: 0.2, jitter_s: 0.3, ..LinkTrouble::default() }),
        (
            "all of it",
            LinkTrouble {
                loss: 0.2,
                duplicate: 0.1,
                reorder: 0.2,
                delay_s: 0.1,
                jitter_s: 0.3,
                ..LinkTrouble::default()
            },
        ),
    ];
    for (name, trouble) in troubles {
        let mut stats = LinkStats::new();
        for system in 1..=3u8 {
            let mut radio = TroubledLink::new(Random::new(7, system, Part::Link), 100_000);
            let mut vehicle = Encoder::new(system, 1);
            let mut arrived = vec![0u32; 20_000];
            let mut take = |bytes: Vec<u8>, now_s: f64| {
                for event in datagram(&bytes) {
                    let Event::Frame(frame) = event else { panic!("{event:?}") };
                    arrived[frame.fields().u32(0) as usize] += 1;
                    stats.event((now_s * 1e6) as u64, &event);
                }
            };
            for k in 0..20_000u32 {
                let now_s = f64::from(k) * 0.004;
                let attitude = ATTITUDE_DATA { time_boot_ms: k, roll: k as f32, ..ATTITUDE_DATA::DEFAULT };
                radio.push(vehicle.encode(&attitude).bytes(), &trouble, now_s);
                while let Some(bytes) = radio.pop(now_s) {
                    take(bytes, now_s);
                }
            }
            while let Some(bytes) = radio.pop(1e3) {
                take(bytes, 81.0);
            }
            let first = arrived.iter().position(|&n| n > 0).expect("some");
            let last = arrived.iter().rposition(|&n| n > 0).expect("some");
            let missing = arrived[first..=last].iter().filter(|&&n| n == 0).count() as f64;
            let twice = arrived.iter().map(|&n| n.saturating_sub(1)).sum::<u32>() as f64;
            let Losses { lost, duplicates, naive_lost, restarts, .. } =
                stats.source(Source { system, component: 1 }).expect("heard").losses();
            println!("{name}: lost {lost} of {missing}, twice {duplicates} of {twice}, naively {naive_lost}");
            assert!((lost as f64 - missing).abs() <= 0.01 * missing, "{name}: lost {lost}, not {missing}");
            assert!((duplicates as f64 - twice).abs() <= 0.01 * twice, "{name}: twice {duplicates}, not {twice}");
            assert_eq!(restarts, 0, "{name}");
        }
    }
}

#[tokio::test]
async fn twenty_vehicles_on_one_port_lose_nothing_and_a_command_reaches_its_own() {
    const VEHICLES: u8 = 20;
    let settings = Settings::new(vec![silent(any_port()), silent(any_port())]);
    let daemon = Running::start(settings, Idle).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(hello(255).bytes()).await;
    let mut fleet = Vec::new();
    for system in 1..=VEHICLES {
        fleet.push((Peer::new(Some(daemon.address(0))).await, Encoder::new(system, 1)));
    }
    for round in 0..40 {
        for (peer, encoder) in &mut fleet {
            let frame = if round == 0 { encoder.encode(&heartbeat()) } else { encoder.encode(&attitude(round)) };
            peer.send(frame.bytes()).await;
        }
        sleep(Duration::from_millis(5)).await;
    }
    until("all frames", || daemon.control.status().links[0].frames_in == 40 * u64::from(VEHICLES)).await;
    // what the vehicles and the station have been told of each other is not of interest here
    for (peer, _) in &fleet {
        while peer.socket.try_recv(&mut [0; 300]).is_ok() {}
    }
    while station.socket.try_recv(&mut [0; 300]).is_ok() {}

    station.send(command(7, 1).bytes()).await;
    for (index, (peer, _)) in fleet.iter().enumerate() {
        let addressed = index == 6;
        let wait = if addressed { PATIENCE } else { Duration::from_millis(20) };
        let got = peer.receive_until(Instant::now() + wait).await;
        assert_eq!(
            got.as_deref(),
            addressed.then(|| command(7, 1)).as_ref().map(FrameBuf::bytes),
            "vehicle {}",
            index + 1
        );
    }
    let summary = daemon.stop().await;
    for system in 1..=VEHICLES {
        assert_eq!(lost(&summary, 0, system), (40, 0), "system {system}");
    }
    assert_eq!(summary.status.links[0].peers, usize::from(VEHICLES));
}

#[tokio::test]
async fn two_vehicles_with_one_system_id_are_counted_and_served_apart() {
    let links = vec![silent(any_port()), silent(any_port()), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let station = Peer::new(Some(daemon.address(2))).await;
    station.send(hello(255).bytes()).await;
    let (first, second) = (Peer::new(Some(daemon.address(0))).await, Peer::new(Some(daemon.address(1))).await);
    let (mut one, mut other) = (Encoder::new(1, 1), Encoder::new(1, 1));
    other.sequence = 99;
    for k in 0..100 {
        first.send(one.encode(&attitude(k)).bytes()).await;
        // the other loses every tenth
        let frame = other.encode(&attitude(10_000 + k));
        if k % 10 != 5 {
            second.send(frame.bytes()).await;
        }
        sleep(Duration::from_millis(1)).await;
    }
    station.send(command(1, 1).bytes()).await;
    assert_eq!(first.receive_all().await.last().map(Vec::as_slice), Some(command(1, 1).bytes()));
    assert_eq!(second.receive_all().await.last().map(Vec::as_slice), Some(command(1, 1).bytes()));
    assert_eq!(station.receive_all().await.len(), 190, "the station hears both");
    let summary = daemon.stop().await;
    assert_eq!((lost(&summary, 0, 1), lost(&summary, 1, 1)), ((100, 0), (90, 10)));
}

#[tokio::test]
async fn a_frame_by_two_ways_arrives_once() {
    let links = vec![silent(any_port()), silent(any_port()), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let station = Peer::new(Some(daemon.address(2))).await;
    station.send(hello(255).bytes()).await;
    let (radio, mobile) = (Peer::new(Some(daemon.address(0))).await, Peer::new(Some(daemon.address(1))).await);
    let frames = flight_of(&mut Encoder::new(1, 1), 50);
    for (k, frame) in frames.iter().enumerate() {
        // each way loses some, never the same
        if k % 7 != 3 {
            radio.send(frame.bytes()).await;
        }
        if k % 5 != 1 || k % 7 == 3 {
            mobile.send(frame.bytes()).await;
        }
        sleep(Duration::from_millis(1)).await;
    }
    let got = station.receive_all().await;
    assert_eq!(got, frames.iter().map(|f| f.bytes().to_vec()).collect::<Vec<_>>());
    let back: Vec<_> = radio.receive_all().await.into_iter().chain(mobile.receive_all().await).collect();
    assert!(back.iter().all(|frame| frame == hello(255).bytes()), "nothing of its own comes back to the vehicle");
    let summary = daemon.stop().await;
    let duplicates: u64 = summary.status.links.iter().map(|l| l.duplicates_in).sum();
    let both = (0..51).filter(|k| k % 7 != 3 && k % 5 != 1).count() as u64;
    assert_eq!(duplicates, both);
}

#[tokio::test]
async fn rules_change_while_links_run() {
    let daemon = Running::start(Settings::new(vec![silent(any_port()), silent(any_port())]), Idle).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(hello(255).bytes()).await;
    let mut encoder = Encoder::new(1, 1);
    vehicle.send(encoder.encode(&attitude(0)).bytes()).await;
    assert!(station.receive().await.is_some());

    let block = Selection::new(vec![30], Ids::default(), Ids::default());
    let deaf = Rules { outward: Filter::new(Selection::default(), block), ..Rules::default() };
    daemon.control.set_rules(vec![Rules::default(), deaf], Duration::ZERO);
    vehicle.send(encoder.encode(&attitude(1)).bytes()).await;
    vehicle.send(encoder.encode(&heartbeat()).bytes()).await;
    assert_eq!(frame_of(&station.receive().await.expect("passes")).as_ref().message_id(), 0);

    let slow = Rules { limits: Limits::new([(30, 0.1)]), ..Rules::default() };
    daemon.control.set_rules(vec![Rules::default(), slow], Duration::ZERO);
    for k in 2..12 {
        vehicle.send(encoder.encode(&attitude(k)).bytes()).await;
    }
    assert_eq!(station.receive_all().await.len(), 1);
    let summary = daemon.stop().await;
    let link = &summary.status.links[1];
    assert_eq!((link.filtered_out, link.limited_out, link.reconnects), (1, 9, 0));
}

/// A port of a device that is plugged in at `path`: the pseudo-terminal's other end.
#[cfg(target_os = "linux")]
fn plug_in(path: &std::path::Path) -> (serial2_tokio::SerialPort, serial2_tokio::SerialPort) {
    // the one terminal that is open now and was not before
    let open = || -> std::collections::BTreeSet<_> {
        let files = std::fs::read_dir("/proc/self/fd").expect("Linux").flatten();
        files.filter_map(|f| std::fs::read_link(f.path()).ok()).filter(|f| f.starts_with("/dev/pts")).collect()
    };
    let before = open();
    let (vehicle, device) = serial2_tokio::SerialPort::pair().expect("a pseudo-terminal");
    let after = open();
    let name = after.difference(&before).find(|name| !name.ends_with("ptmx")).expect("its name");
    let _ = std::fs::remove_file(path);
    std::os::unix::fs::symlink(name, path).expect("linked");
    (vehicle, device)
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_serial_port_comes_back_a_hundred_times() {
    let directory = tempfile::tempdir().expect("a directory");
    let device = directory.path().join("ttyACM0");
    let serial = LinkUrl::Serial { device: device.clone(), baud: 57_600, flow: Flow::None };
    let links = vec![silent(serial), silent(any_port()), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(hello(255).bytes()).await;
    let other = Peer::new(Some(daemon.address(2))).await;
    let (mut vehicle, mut bystander) = (Encoder::new(1, 1), Encoder::new(2, 1));
    for round in 0..100u32 {
        let (port, device_end) = plug_in(&device);
        // until the daemon has opened it, nobody holds the other end
        let frame = vehicle.encode(&attitude(round));
        let begin = Instant::now();
        until("opened", || daemon.control.status().links[0].down.is_none()).await;
        drop(device_end);
        port.write_all(frame.bytes()).await.expect("written");
        let got = station.receive_until(begin + PATIENCE).await;
        assert_eq!(got.as_deref(), Some(frame.bytes()), "round {round}");
        // and back
        station.send(command(1, 1).bytes()).await;
        let mut buffer = vec![0; command(1, 1).bytes().len()];
        let mut filled = 0;
        while filled < buffer.len() {
            let read = timeout(PATIENCE, port.read(&mut buffer[filled..])).await.expect("in time").expect("reads");
            assert!(read > 0);
            filled += read;
        }
        assert_eq!(buffer, command(1, 1).bytes());
        // another link does not notice
        let frame = bystander.encode(&attitude(round));
        other.send(frame.bytes()).await;
        assert_eq!(station.receive().await.as_deref(), Some(frame.bytes()));
        drop(port);
        std::fs::remove_file(&device).expect("was there");
        until("noticed", || daemon.control.status().links[0].down.is_some()).await;
    }
    let summary = daemon.stop().await;
    assert_eq!(lost(&summary, 0, 1), (100, 0));
    assert_eq!(lost(&summary, 2, 2), (100, 0));
    assert!(summary.status.links[0].reconnects >= 99, "{:?}", summary.status.links[0]);
}

/// Closes a connection such that the other side gets a reset.
fn reset(stream: TcpStream) {
    socket2::SockRef::from(&stream).set_linger(Some(Duration::ZERO)).expect("a socket");
}

#[tokio::test]
async fn storms_of_tcp_resets_harm_nobody() {
    let refusing = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let port = refusing.local_addr().expect("bound").port();
    let server = LinkUrl::TcpIn { host: "127.0.0.1".to_owned(), port: 0 };
    let client = LinkUrl::TcpOut { host: "127.0.0.1".to_owned(), port };
    let links = vec![silent(server), silent(client), silent(any_port()), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let station = Peer::new(Some(daemon.address(2))).await;
    station.send(hello(255).bytes()).await;
    // the server that our client connects to resets five connections, then holds one
    let storm = tokio::spawn(async move {
        for _ in 0..5 {
            reset(refusing.accept().await.expect("connects").0);
        }
        refusing.accept().await.expect("connects").0
    });
    // and clients of our server come, say half a frame and reset
    let half = &hello(3).bytes().to_vec()[..8];
    for _ in 0..200 {
        let mut stream = TcpStream::connect(daemon.address(0)).await.expect("listens");
        stream.write_all(half).await.expect("taken");
        reset(stream);
    }
    let vehicle = Peer::new(Some(daemon.address(3))).await;
    let frames = flight_of(&mut Encoder::new(1, 1), 50);
    let mut steady = TcpStream::connect(daemon.address(0)).await.expect("listens");
    steady.write_all(hello(9).bytes()).await.expect("taken");
    assert_eq!(station.receive().await.as_deref(), Some(hello(9).bytes()));
    let mut held = timeout(PATIENCE, storm).await.expect("comes again").expect("no panic");
    held.write_all(hello(8).bytes()).await.expect("taken");
    assert_eq!(station.receive().await.as_deref(), Some(hello(8).bytes()));
    for frame in &frames {
        vehicle.send(frame.bytes()).await;
    }
    let expected: Vec<_> = frames.iter().map(|f| f.bytes().to_vec()).collect();
    assert_eq!(station.receive_all().await, expected);
    for stream in [&mut steady, &mut held] {
        let mut parser = Parser::new();
        let (mut buffer, mut got) = ([0; 4096], Vec::new());
        while got.len() < expected.len() {
            let read = timeout(PATIENCE, stream.read(&mut buffer)).await.expect("in time").expect("reads");
            assert!(read > 0);
            parser.push(&buffer[..read]);
            while let Some(event) = parser.next() {
                let Event::Frame(frame) = event else { panic!("{event:?}") };
                if frame.system_id() == 1 {
                    got.push(frame.bytes().to_vec());
                }
            }
        }
        assert_eq!(got, expected);
    }
    let summary = daemon.stop().await;
    assert_eq!(lost(&summary, 3, 1), (51, 0));
}

#[tokio::test]
async fn a_client_that_does_not_read_loses_counted_and_delays_nobody() {
    let server = LinkUrl::TcpIn { host: "127.0.0.1".to_owned(), port: 0 };
    let links = vec![silent(server), silent(any_port()), silent(any_port())];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let station = Peer::new(Some(daemon.address(1))).await;
    station.send(hello(255).bytes()).await;
    let socket = tokio::net::TcpSocket::new_v4().expect("a socket");
    // else the kernel takes megabytes on its behalf
    socket.set_recv_buffer_size(4096).expect("set");
    let mut sleeper = socket.connect(daemon.address(0)).await.expect("listens");
    until("connected", || daemon.control.status().links[0].peers == 1).await;
    let vehicle = Peer::new(Some(daemon.address(2))).await;
    let mut encoder = Encoder::new(1, 1);
    let (mut sent, mut greetings) = (0u64, 0u64);
    // until its queue and the kernel's buffers are full
    while daemon.control.status().links[0].dropped_out < 100 {
        // whoever is silent for long is forgotten
        station.send(hello(255).bytes()).await;
        greetings += 1;
        for _ in 0..20 {
            let long = ENCAPSULATED_DATA_DATA { seqnr: sent as u16, data: [7; 253] };
            vehicle.send(encoder.encode(&long).bytes()).await;
            sent += 1;
        }
        for _ in 0..20 {
            assert!(station.receive_until(Instant::now() + PATIENCE).await.is_some(), "it is held up");
        }
        assert!(sent < 500_000, "it never fills");
    }
    // once it reads again, it has all that was not dropped, whole and in order
    let mut parser = Parser::new();
    let (mut buffer, mut read, mut bad) = (vec![0; 65_536], 0, 0);
    loop {
        match timeout(Duration::from_secs(3), sleeper.read(&mut buffer)).await {
            Ok(length) => parser.push(&buffer[..length.expect("reads")]),
            Err(_) => break,
        }
        while let Some(event) = parser.next() {
            match event {
                Event::Frame(_) => read += 1,
                Event::Bad(_) => bad += 1,
            }
        }
    }
    let summary = daemon.stop().await;
    let link = &summary.status.links[0];
    assert_eq!((read + link.dropped_out, bad), (sent + greetings, 0));
    assert_eq!(lost(&summary, 2, 1), (sent, 0));
}

#[tokio::test]
async fn a_broadcast_group_hears_and_is_heard_without_echo() {
    use socket2::{Domain, Socket, Type};
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, None).expect("a socket");
    socket.set_reuse_address(true).expect("set");
    socket.set_broadcast(true).expect("set");
    socket.set_nonblocking(true).expect("set");
    socket.bind(&std::net::SocketAddr::from(([0, 0, 0, 0], 0)).into()).expect("a free port");
    let member = tokio::net::UdpSocket::from_std(socket.into()).expect("a socket");
    let port = member.local_addr().expect("bound").port();
    let group = LinkUrl::UdpBcast { host: "127.255.255.255".to_owned(), port };
    let daemon = Running::start(Settings::new(vec![silent(group), silent(any_port())]), Idle).await;
    until("open", || daemon.control.status().links[0].peers == 1).await;
    let vehicle = Peer::new(Some(daemon.address(1))).await;
    vehicle.send(hello(1).bytes()).await;
    let mut buffer = [0; 300];
    let (length, _) = timeout(PATIENCE, member.recv_from(&mut buffer)).await.expect("in time").expect("receives");
    assert_eq!(&buffer[..length], hello(1).bytes());
    member.send_to(hello(255).bytes(), ("127.255.255.255", port)).await.expect("sent");
    assert_eq!(vehicle.receive().await.as_deref(), Some(hello(255).bytes()));
    let summary = daemon.stop().await;
    assert_eq!(summary.status.links[0].frames_in, 1, "our own frame is not taken for another's");
}

#[tokio::test]
async fn metrics_are_served_and_name_every_link() {
    let probe = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = probe.local_addr().expect("bound");
    drop(probe);
    let mut settings = Settings::new(vec![silent(any_port()), silent(any_port())]);
    settings.metrics = Some(address);
    settings.links[0].name = "vehicles".to_owned();
    let daemon = Running::start(settings, Echo::default()).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    for frame in flight_of(&mut Encoder::new(7, 1), 20) {
        vehicle.send(frame.bytes()).await;
    }
    until("estimated", || daemon.control.status().vehicles.values().any(|v| v.snapshots == 20)).await;
    let mut stream = TcpStream::connect(address).await.expect("listens");
    stream.write_all(b"GET /metrics HTTP/1.1\r\nhost: here\r\nconnection: close\r\n\r\n").await.expect("taken");
    let mut page = String::new();
    stream.read_to_string(&mut page).await.expect("text");
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    for line in [
        "mavobserver_link_received_frames_total{link=\"vehicles\"} 21",
        "mavobserver_link_up{link=\"vehicles\"} 1",
        "mavobserver_source_lost_total{link=\"vehicles\",system=\"7\",component=\"1\"} 0",
        "mavobserver_vehicle_estimates_total{system=\"7\",component=\"1\"} 20",
        "# EOF",
    ] {
        assert!(page.contains(line), "{line} is missing of\n{page}");
    }
    daemon.stop().await;
}

#[tokio::test]
async fn what_is_absent_at_the_start_is_waited_for() {
    let absent = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let later = absent.local_addr().expect("bound");
    drop(absent);
    let host = |url: &str| silent(url.parse::<LinkUrl>().expect("a link"));
    let links: Vec<Link> = vec![
        host(&format!("tcpout:{later}")),
        host("serial:/dev/no-such-device:57600"),
        host("udpout:no-such-host.invalid:14550"),
        // an address of nobody here, kept for documentation
        host("udpin:192.0.2.1:14550"),
        silent(any_port()),
    ];
    let daemon = Running::start(Settings::new(links), Idle).await;
    let vehicle = Peer::new(Some(daemon.address(4))).await;
    vehicle.send(hello(1).bytes()).await;
    until("tried", || daemon.control.status().links[..4].iter().all(|l| l.down.is_some())).await;
    let server = TcpListener::bind(later).await.expect("still free");
    let (mut stream, _) = timeout(PATIENCE, server.accept()).await.expect("in time").expect("connects");
    stream.write_all(hello(255).bytes()).await.expect("taken");
    assert_eq!(vehicle.receive().await.as_deref(), Some(hello(255).bytes()));
    daemon.stop().await;
}
