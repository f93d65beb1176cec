//! Bridges as processes, and the CPU time that they use.

use socket2::SockRef;
use std::fs;
use std::io;
use std::process::{Child, Command, Stdio};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bridge {
    /// Receives and sends, and looks at nothing: what the kernel alone costs.
    Relay,
    Ours,
    OursRecording,
    Router,
    P2p,
    Proxy,
}

/// Where a bridge listens for the vehicle, and where the station is.
#[derive(Debug, Clone, Copy)]
pub struct Ports {
    pub vehicle: u16,
    pub station: u16,
}

pub struct Running {
    child: Child,
    /// Recordings go when the bridge does.
    _records: Option<tempfile::TempDir>,
}

impl Bridge {
    pub const ALL: [Self; 6] = [Self::Relay, Self::Ours, Self::OursRecording, Self::Router, Self::P2p, Self::Proxy];

    pub fn name(self) -> &'static str {
        match self {
            Self::Relay => "relay without a look",
            Self::Ours => "mavobserver",
            Self::OursRecording => "mavobserver, recording",
            Self::Router => "mavlink-router",
            Self::P2p => "mavp2p",
            Self::Proxy => "MAVProxy",
        }
    }

    fn command(self, Ports { vehicle, station }: Ports) -> io::Result<Command> {
        let (from, to) = (format!("127.0.0.1:{vehicle}"), format!("127.0.0.1:{station}"));
        let this = std::env::current_exe()?;
        let (program, arguments) = match self {
            Self::Relay => (this.to_str().unwrap_or_default(), vec!["--relay".to_owned(), format!("{from},{to}")]),
            Self::Ours | Self::OursRecording => (env!("CARGO_BIN_EXE_mavobserver"), {
                let links = ["--link".to_owned(), format!("udpin:{from}"), "--link".to_owned(), format!("udpout:{to}")];
                ["run", "--quiet", "--no-observers"].map(str::to_owned).into_iter().chain(links).collect()
            }),
            Self::Router => ("mavlink-routerd", vec!["-e".to_owned(), to, from]),
            Self::P2p => ("mavp2p", vec![format!("udps:{from}"), format!("udpc:{to}")]),
            Self::Proxy => ("mavproxy.py", {
                let ends = [format!("--master=udpin:{from}"), format!("--out=udpout:{to}")];
                ends.into_iter().chain(["--non-interactive".to_owned(), "--daemon".to_owned()]).collect()
            }),
        };
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        Ok(command)
    }
}

/// Passes datagrams from one address to another.
pub fn relay(from: &str, to: &str) -> io::Result<()> {
    let socket = std::net::UdpSocket::bind(from)?;
    let out = std::net::UdpSocket::bind("127.0.0.1:0")?;
    out.connect(to)?;
    SockRef::from(&socket).set_recv_buffer_size(4 << 20)?;
    let mut buffer = [0; 2048];
    loop {
        let length = socket.recv(&mut buffer)?;
        // nobody may listen yet
        let _ = out.send(&buffer[..length]);
    }
}

impl Running {
    /// `None` if the bridge is not installed.
    pub fn start(bridge: Bridge, ports: Ports) -> io::Result<Option<Self>> {
        let mut command = bridge.command(ports)?;
        let records = if bridge == Bridge::OursRecording { Some(tempfile::tempdir()?) } else { None };
        if let Some(directory) = &records {
            command.arg("--record").arg(directory.path());
        }
        match command.spawn() {
            Ok(child) => Ok(Some(Self { child, _records: records })),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    pub fn cpu_ns(&self) -> io::Result<u64> {
        cpu_ns(self.child.id())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Time on a CPU of all threads of a process so far, from the scheduler's own account.
pub fn cpu_ns(process: u32) -> io::Result<u64> {
    let mut total = 0;
    for thread in fs::read_dir(format!("/proc/{process}/task"))? {
        let account = fs::read_to_string(thread?.path().join("schedstat"))?;
        total += account.split_whitespace().next().and_then(|ns| ns.parse::<u64>().ok()).unwrap_or(0);
    }
    Ok(total)
}

/// Memory of a process that is in RAM, bytes.
pub fn resident_bytes(process: u32) -> io::Result<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status"))?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    Ok(kib.unwrap_or(0) * 1024)
}
