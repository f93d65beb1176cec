//! Long load over four links: does memory stay, is everything that is lost counted?

use super::bridges::resident_bytes;
use super::traffic::{Source, free_port};
use mavobserver::wire::stats::LinkStats;
use mavobserver::wire::{Event, Parser, datagram};
use serde_json::Value;
use socket2::SockRef;
use std::io::{self, Read};
use std::net::{TcpStream, UdpSocket};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Frames a second of each of the two vehicles' links.
const RATE: u32 = 10_000;
const VEHICLES: u8 = 2;
/// Memory may grow by this much after the first ten seconds: what is left of the allocator's room.
const GROWTH: u64 = 2 << 20;
const SETTLED: Duration = Duration::from_secs(10);

pub fn run(time: Duration) -> ExitCode {
    match soak(time) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("soak: {error}");
            ExitCode::FAILURE
        }
    }
}

fn soak(time: Duration) -> io::Result<bool> {
    let udp_sink = UdpSocket::bind("127.0.0.1:0")?;
    udp_sink.set_read_timeout(Some(Duration::from_millis(100)))?;
    SockRef::from(&udp_sink).set_recv_buffer_size(16 << 20)?;
    let ports: Vec<u16> = (0..VEHICLES).map(|_| free_port()).collect::<Result<_, _>>()?;
    let tcp_port = std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mavobserver"));
    command.args(["run", "--quiet", "--no-observers", "--json"]);
    for port in &ports {
        command.args(["--link", &format!("udpin:127.0.0.1:{port}")]);
    }
    command.args(["--link", &format!("udpout:{}", udp_sink.local_addr()?)]);
    command.args(["--link", &format!("tcpin:127.0.0.1:{tcp_port}")]);
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn()?;
    let outcome = load(&mut child, udp_sink, tcp_port, &ports, time);
    if outcome.is_err() {
        // it may have ended by itself
        let _ = child.kill();
    }
    child.wait()?;
    outcome
}

fn load(child: &mut Child, udp: UdpSocket, tcp_port: u16, ports: &[u16], time: Duration) -> io::Result<bool> {
    let tcp = connect(tcp_port)?;
    tcp.set_read_timeout(Some(Duration::from_millis(100)))?;
    let stop = Arc::new(AtomicBool::new(false));
    let sinks = [count_datagrams(udp, Arc::clone(&stop)), count_stream(tcp, Arc::clone(&stop))];
    let sources: Vec<JoinHandle<io::Result<u64>>> = (1..=VEHICLES)
        .zip(ports)
        .map(|(system, &port)| {
            thread::spawn(move || {
                let mut source = Source::of(system, port)?;
                Ok(source.send_for(RATE, time))
            })
        })
        .collect();

    let begin = Instant::now();
    let (mut settled, mut highest) = (None, 0);
    while sources.iter().any(|s| !s.is_finished()) {
        thread::sleep(Duration::from_secs(1));
        let bytes = resident_bytes(child.id())?;
        if begin.elapsed() >= SETTLED.min(time / 2) {
            settled.get_or_insert(bytes);
            highest = highest.max(bytes);
        }
        if begin.elapsed().as_secs().is_multiple_of(60) {
            println!("{:6} s  {:.1} MiB", begin.elapsed().as_secs(), bytes as f64 / f64::from(1 << 20));
        }
    }
    let defect = || io::Error::other("a thread was stopped by a defect");
    let sent: Vec<u64> = sources.into_iter().map(|s| s.join().map_err(|_| defect())?).collect::<Result<_, _>>()?;
    thread::sleep(Duration::from_secs(1));
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status()?;
    let mut text = String::new();
    child.stdout.take().ok_or_else(defect)?.read_to_string(&mut text)?;
    stop.store(true, Ordering::Relaxed);
    let report: Value = serde_json::from_str(&text).map_err(io::Error::other)?;

    let mut fine = true;
    let mut check = |what: &str, holds: bool| {
        println!("{} {what}", if holds { "ok    " } else { "FAILED" });
        fine &= holds;
    };
    let number = |link: usize, key: &str| report["links"][link][key].as_u64().unwrap_or(u64::MAX);
    for (link, sent) in sent.iter().enumerate() {
        let (came, overrun, lost) = (number(link, "frames_in"), number(link, "overrun_in"), number(link, "lost_in"));
        let text =
            format!("link {link}: {sent} sent, {came} came, {overrun} not taken in time, {lost} missed by number");
        check(&text, came + overrun == *sent && lost <= overrun);
    }
    let came: u64 = (0..sent.len()).map(|link| number(link, "frames_in")).sum();
    for (sink, name) in sinks.into_iter().zip(["UDP", "TCP"]) {
        let link = sent.len() + usize::from(name == "TCP");
        let stats = sink.join().map_err(|_| defect())?;
        let (out, dropped) = (number(link, "frames_out"), number(link, "dropped_out"));
        let (got, lost) = (stats.totals().frames, stats.losses().lost);
        let text = format!("{name}: {out} of {came} sent, {dropped} dropped, {got} came, {lost} lost behind it");
        check(&text, out + dropped == came && got + lost >= out && got <= out);
    }
    let settled = settled.unwrap_or(highest);
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    check(&format!("memory {:.1} MiB, at most {:.1}", mib(settled), mib(highest)), highest <= settled + GROWTH);
    Ok(fine)
}

/// Connects as soon as somebody listens.
fn connect(port: u16) -> io::Result<TcpStream> {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        match TcpStream::connect(("127.0.0.1", port)) {
            Ok(stream) => return Ok(stream),
            Err(error) if Instant::now() > deadline => return Err(error),
            Err(_) => thread::sleep(Duration::from_millis(50)),
        }
    }
}

fn count_datagrams(socket: UdpSocket, stop: Arc<AtomicBool>) -> JoinHandle<LinkStats> {
    thread::spawn(move || {
        let (mut stats, mut buffer) = (LinkStats::new(), [0; 2048]);
        while !stop.load(Ordering::Relaxed) {
            if let Ok(length) = socket.recv(&mut buffer) {
                datagram(&buffer[..length]).for_each(|event| stats.event(0, &event));
            }
        }
        stats
    })
}

fn count_stream(mut stream: TcpStream, stop: Arc<AtomicBool>) -> JoinHandle<LinkStats> {
    thread::spawn(move || {
        let (mut stats, mut parser, mut buffer) = (LinkStats::new(), Parser::new(), vec![0; 65_536]);
        while !stop.load(Ordering::Relaxed) {
            match stream.read(&mut buffer) {
                Ok(0) => break,
                Ok(length) => parser.push(&buffer[..length]),
                Err(_) => continue,
            }
            while let Some(event) = parser.next() {
                if let Event::Frame(_) = event {
                    stats.event(0, &event);
                }
            }
        }
        stats
    })
}
