//! The bridge against others, in one run: 74-byte frames from UDP to UDP at several rates; CPU time of the bridge for
//! each, what was lost, and how long frames were on their way. Bridges that are not installed are left out.
//!
//! ```text
//! cargo bench --bench bridge                       # all bridges, 1 k, 10 k and 50 k frames a second
//! cargo bench --bench bridge -- --seconds 3 --rates 10000
//! cargo bench --bench bridge -- --soak 3600        # an hour at 20 000 a second over four links: memory, uncounted losses
//! ```

mod bridges;
mod soak;
mod traffic;

use bridges::{Bridge, Ports, Running};
use std::process::ExitCode;
use std::time::Duration;

struct Options {
    seconds: f64,
    rates: Vec<u32>,
    soak: Option<f64>,
    /// Addresses of a plain relay, which this program also is.
    relay: Option<(String, String)>,
}

fn main() -> ExitCode {
    let Some(options) = options() else {
        eprintln!("usage: bridge [--seconds S] [--rates N,N,…] [--soak S]");
        return ExitCode::from(2);
    };
    if let Some((from, to)) = options.relay {
        return bridges::relay(&from, &to).map_or(ExitCode::FAILURE, |()| ExitCode::SUCCESS);
    }
    if let Some(seconds) = options.soak {
        return soak::run(Duration::from_secs_f64(seconds));
    }
    println!("{:28} {:>8} {:>12} {:>9} {:>9} {:>9}", "bridge", "rate/s", "CPU µs/msg", "lost", "p50 µs", "p99 µs");
    for bridge in Bridge::ALL {
        for &rate in &options.rates {
            match measure(bridge, rate, options.seconds) {
                Ok(Some(line)) => println!("{:28} {rate:>8} {line}", bridge.name()),
                Ok(None) => {
                    println!("{:28} SKIPPED: not installed", bridge.name());
                    break;
                }
                Err(error) => println!("{:28} {rate:>8} failed: {error}", bridge.name()),
            }
        }
    }
    ExitCode::SUCCESS
}

/// `cargo bench` adds `--bench`, which says nothing here.
fn options() -> Option<Options> {
    let mut options = Options { seconds: 5.0, rates: vec![1_000, 10_000, 50_000], soak: None, relay: None };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let value = words.next()?;
        match word.as_str() {
            "--seconds" => options.seconds = value.parse().ok()?,
            "--soak" => options.soak = Some(value.parse().ok()?),
            "--relay" => options.relay = value.split_once(',').map(|(from, to)| (from.to_owned(), to.to_owned())),
            "--rates" => options.rates = value.split(',').map(|rate| rate.parse().ok()).collect::<Option<_>>()?,
            _ => return None,
        }
    }
    Some(options)
}

fn measure(bridge: Bridge, rate: u32, seconds: f64) -> std::io::Result<Option<String>> {
    let sink = traffic::Sink::start()?;
    let ports = Ports { vehicle: traffic::free_port()?, station: sink.port };
    let Some(running) = Running::start(bridge, ports)? else { return Ok(None) };
    let mut source = traffic::Source::to(ports.vehicle)?;
    // until it passes something, it is not up
    let up = source.until_passed(&sink, Duration::from_secs(20));
    if !up {
        return Ok(Some("passes nothing".to_owned()));
    }
    source.send_for(rate, Duration::from_millis(500));
    std::thread::sleep(Duration::from_millis(300));
    sink.take();
    let before = running.cpu_ns()?;
    let sent = source.send_for(rate, Duration::from_secs_f64(seconds));
    std::thread::sleep(Duration::from_millis(500));
    let cpu_ns = running.cpu_ns()? - before;
    let mut latencies_ns = sink.take();
    latencies_ns.sort_unstable();
    let at = |share: f64| {
        let index = (share * latencies_ns.len() as f64) as usize;
        latencies_ns.get(index.min(latencies_ns.len().saturating_sub(1))).map_or(f64::NAN, |&ns| ns as f64 * 1e-3)
    };
    let lost = sent.saturating_sub(latencies_ns.len() as u64);
    let per_message = cpu_ns as f64 * 1e-3 / sent as f64;
    Ok(Some(format!("{per_message:>12.2} {lost:>9} {:>9.0} {:>9.0}", at(0.5), at(0.99))))
}
