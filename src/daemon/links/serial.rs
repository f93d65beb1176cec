//! Serial ports, whenever they are there.

use super::backoff::Backoff;
use super::health::Health;
use super::outbox::Outboxes;
use super::stream::{Ends, Pumped, pump};
use crate::config::Flow;
use crate::daemon::inlet::Inlet;
use crate::wire::MAX_FRAME_LEN;
use serial2_tokio::{FlowControl, SerialPort, Settings};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

/// Frames wait for a port no longer than this, s: later ones are lost rather than all of them late.
const OUTBOX_S: f64 = 0.25;
/// Ten bits on the line for each byte.
const BITS_PER_BYTE: f64 = 10.0;

/// A port that may come and go.
#[derive(Debug)]
pub(in crate::daemon) struct SerialLink {
    device: PathBuf,
    baud: u32,
    flow: Flow,
    pub(super) outboxes: Outboxes,
    pub(super) health: Health,
}

impl SerialLink {
    pub(super) fn new(name: String, device: PathBuf, baud: u32, flow: Flow) -> Self {
        let bytes = (OUTBOX_S * f64::from(baud) / BITS_PER_BYTE) as usize;
        let outboxes = Outboxes::new(bytes.max(8 * MAX_FRAME_LEN));
        Self { device, baud, flow, outboxes, health: Health::new(name) }
    }

    fn open(&self) -> io::Result<SerialPort> {
        let (baud, flow) = (self.baud, self.flow);
        SerialPort::open(&self.device, move |mut settings: Settings| {
            settings.set_raw();
            settings.set_baud_rate(baud)?;
            settings.set_flow_control(match flow {
                Flow::None => FlowControl::None,
                Flow::RtsCts => FlowControl::RtsCts,
            });
            Ok(settings)
        })
    }

    /// Opens the port whenever it is there, until `stop`.
    pub(super) async fn run(self: Arc<Self>, mut inlet: Inlet, stop: CancellationToken) {
        let mut backoff = Backoff::new();
        loop {
            match self.open() {
                Ok(port) => match self.serve(port, &mut inlet, &stop).await {
                    Ok(Pumped { stopped: true, .. }) => return,
                    Ok(Pumped { received, .. }) => {
                        if received {
                            backoff.reset();
                        }
                        self.health.down(&"the device is gone");
                    }
                    Err(error) => {
                        backoff.reset();
                        self.health.down(&error);
                    }
                },
                Err(error) => self.health.down(&advice(&error)),
            }
            if !backoff.wait(&stop).await {
                return;
            }
        }
    }

    async fn serve(&self, port: SerialPort, inlet: &mut Inlet, stop: &CancellationToken) -> io::Result<Pumped> {
        // there is one port, so there is always a place
        let Some((peer, outbox)) = self.outboxes.open() else { return Err(io::ErrorKind::Other.into()) };
        self.health.up();
        inlet.open(None);
        let ends = Ends { inlet, peer: None, outbox: &outbox, traffic: &self.outboxes.traffic };
        let ended = pump(port, ends, stop).await;
        inlet.close(None);
        self.outboxes.close(peer);
        ended
    }
}

fn advice(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::PermissionDenied => {
            format!("{error}; the user needs the right to open it, often by the group `dialout`")
        }
        _ => error.to_string(),
    }
}
