//! Byte streams of any kind: serial ports and TCP connections.

use super::outbox::{Batch, Outbox};
use crate::daemon::clock::unix_us;
use crate::daemon::inlet::Inlet;
use crate::daemon::status::Traffic;
use crate::routing::PeerId;
use crate::wire::Parser;
use std::io;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

/// Bytes read at once.
const CHUNK: usize = 16 * 1024;
/// When stopping, a stream takes what has arrived and writes what waits, but no longer than this.
const LAST_WAIT: Duration = Duration::from_millis(100);
const LAST_READ: Duration = Duration::from_millis(5);

/// How the frames of a stream go in and out.
pub(super) struct Ends<'a> {
    pub(super) inlet: &'a mut Inlet,
    /// As whom the frames come in.
    pub(super) peer: Option<PeerId>,
    pub(super) outbox: &'a Outbox,
    pub(super) traffic: &'a Traffic,
}

/// Reads frames and writes those of the outbox, until `stop` (true) or until the other side is gone (false).
///
/// # Errors
/// Reading or writing failed: the stream is of no more use.
pub(super) async fn pump<S>(stream: S, ends: Ends<'_>, stop: &CancellationToken) -> io::Result<Pumped>
where
    S: AsyncRead + AsyncWrite,
{
    let Ends { inlet, peer, outbox, traffic } = ends;
    let (mut reading, mut writing) = tokio::io::split(stream);
    let mut intake = Intake { inlet, peer, parser: Parser::new(), buffer: vec![0; CHUNK], received: false };
    let ended = {
        let write = write_all(&mut writing, outbox, traffic);
        let read = async {
            while intake.read(&mut reading).await? {
                tokio::task::consume_budget().await;
            }
            io::Result::Ok(())
        };
        tokio::select! {
            read = read => Some(read),
            written = write => Some(written),
            () = stop.cancelled() => None,
        }
    };
    let received = intake.received;
    match ended {
        Some(ended) => ended.map(|()| Pumped { stopped: false, received }),
        None => {
            let rest = async {
                while let Ok(Ok(true)) = timeout(LAST_READ, intake.read(&mut reading)).await {}
                let mut batch = Batch::default();
                if outbox.take(&mut batch) {
                    write(&mut writing, &batch, traffic).await?;
                }
                io::Result::Ok(())
            };
            // what does not go out in time stays behind
            let _ = timeout(LAST_WAIT, rest).await;
            Ok(Pumped { stopped: true, received })
        }
    }
}

/// How a stream ended.
pub(super) struct Pumped {
    /// By our will.
    pub(super) stopped: bool,
    /// Something had come in.
    pub(super) received: bool,
}

struct Intake<'a> {
    inlet: &'a mut Inlet,
    peer: Option<PeerId>,
    parser: Parser,
    buffer: Vec<u8>,
    received: bool,
}

impl Intake<'_> {
    /// Reads once; false at the end of the stream.
    async fn read(&mut self, stream: &mut (impl AsyncRead + Unpin)) -> io::Result<bool> {
        let length = stream.read(&mut self.buffer).await?;
        if length == 0 {
            return Ok(false);
        }
        let now_us = unix_us();
        self.received = true;
        self.parser.push(&self.buffer[..length]);
        while let Some(event) = self.parser.next() {
            self.inlet.take(event, self.peer, now_us);
        }
        Ok(true)
    }
}

async fn write_all(stream: &mut (impl AsyncWrite + Unpin), outbox: &Outbox, traffic: &Traffic) -> io::Result<()> {
    let mut batch = Batch::default();
    loop {
        batch.clear();
        outbox.next(&mut batch).await;
        write(stream, &batch, traffic).await?;
    }
}

async fn write(stream: &mut (impl AsyncWrite + Unpin), batch: &Batch, traffic: &Traffic) -> io::Result<()> {
    let guard = Unwritten { traffic, frames: batch.frames };
    stream.write_all(&batch.bytes).await?;
    std::mem::forget(guard);
    traffic.sent(batch.frames, batch.bytes.len());
    Ok(())
}

/// Counts the frames of a batch as dropped if its writing fails or is given up.
struct Unwritten<'a> {
    traffic: &'a Traffic,
    frames: u64,
}

impl Drop for Unwritten<'_> {
    fn drop(&mut self) {
        self.traffic.dropped(self.frames);
    }
}
