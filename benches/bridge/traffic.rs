//! Frames that know when they left, and who counts them.

use mavobserver::wire::dialect::ardupilotmega::{HIGHRES_IMU_DATA, HighresImuUpdatedFlags};
use mavobserver::wire::{Encoder, Event, datagram};
use socket2::SockRef;
use std::io;
use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// HIGHRES_IMU: 12 bytes around a payload of 62.
pub const FRAME_LEN: usize = 74;
const HIGHRES_IMU: u32 = 105;

static START: LazyLock<Instant> = LazyLock::new(Instant::now);

fn now_ns() -> u64 {
    START.elapsed().as_nanos() as u64
}

/// A port that is free at this moment.
pub fn free_port() -> io::Result<u16> {
    Ok(UdpSocket::bind("127.0.0.1:0")?.local_addr()?.port())
}

/// Sends frames to a port.
pub struct Source {
    socket: UdpSocket,
    encoder: Encoder,
    pub sent: u64,
}

impl Source {
    pub fn to(port: u16) -> io::Result<Self> {
        Self::of(1, port)
    }

    /// As this system.
    pub fn of(system: u8, port: u16) -> io::Result<Self> {
        let socket = UdpSocket::bind("127.0.0.1:0")?;
        socket.connect(("127.0.0.1", port))?;
        Ok(Self { socket, encoder: Encoder::new(system, 1), sent: 0 })
    }

    fn send(&mut self) {
        // the last byte that is not zero ends the frame
        let fields_updated = HighresImuUpdatedFlags::HIGHRES_IMU_UPDATED_TEMPERATURE;
        let imu = HIGHRES_IMU_DATA { time_usec: now_ns(), fields_updated, ..HIGHRES_IMU_DATA::DEFAULT };
        let frame = self.encoder.encode(&imu);
        debug_assert_eq!(frame.bytes().len(), FRAME_LEN);
        // before the bridge is up nobody listens
        self.sent += u64::from(self.socket.send(frame.bytes()).is_ok());
    }

    /// Sends now and then until something arrives.
    pub fn until_passed(&mut self, sink: &Sink, within: Duration) -> bool {
        let deadline = Instant::now() + within;
        while Instant::now() < deadline {
            self.send();
            thread::sleep(Duration::from_millis(20));
            if sink.frames.load(Ordering::Relaxed) > 0 {
                return true;
            }
        }
        false
    }

    /// Sends at this rate, evenly as far as the system's timer allows; gives how many.
    pub fn send_for(&mut self, rate: u32, time: Duration) -> u64 {
        let (begin, before) = (Instant::now(), self.sent);
        let total = (f64::from(rate) * time.as_secs_f64()) as u64;
        let mut count = 0;
        while count < total {
            let due = (begin.elapsed().as_secs_f64() * f64::from(rate)) as u64;
            while count < due.min(total) {
                self.send();
                count += 1;
            }
            thread::sleep(Duration::from_micros(20));
        }
        self.sent - before
    }
}

/// Receives on a free port and notes how long each frame took.
pub struct Sink {
    pub port: u16,
    pub frames: Arc<AtomicU64>,
    latencies_ns: Arc<Mutex<Vec<u64>>>,
    stop: Arc<AtomicBool>,
}

impl Sink {
    pub fn start() -> io::Result<Self> {
        let socket = UdpSocket::bind("127.0.0.1:0")?;
        socket.set_read_timeout(Some(Duration::from_millis(100)))?;
        SockRef::from(&socket).set_recv_buffer_size(16 << 20)?;
        let sink = Self {
            port: socket.local_addr()?.port(),
            frames: Arc::default(),
            latencies_ns: Arc::new(Mutex::new(Vec::with_capacity(1 << 20))),
            stop: Arc::default(),
        };
        let (frames, latencies, stop) =
            (Arc::clone(&sink.frames), Arc::clone(&sink.latencies_ns), Arc::clone(&sink.stop));
        thread::spawn(move || {
            let mut buffer = [0; 2048];
            while !stop.load(Ordering::Relaxed) {
                let Ok(length) = socket.recv(&mut buffer) else { continue };
                let now = now_ns();
                for event in datagram(&buffer[..length]) {
                    // bridges may say something of their own
                    if let Event::Frame(frame) = event
                        && frame.message_id() == HIGHRES_IMU
                    {
                        let took = now.saturating_sub(frame.fields().u64(0));
                        latencies.lock().unwrap_or_else(PoisonError::into_inner).push(took);
                        frames.fetch_add(1, Ordering::Relaxed);
                    }
                }
            }
        });
        Ok(sink)
    }

    /// The latencies since the last time.
    pub fn take(&self) -> Vec<u64> {
        std::mem::take(&mut *self.latencies_ns.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}
