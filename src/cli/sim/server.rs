use crate::wire::{Event, FrameRef, Parser};
use std::io::{ErrorKind, Read, Result, Write};
use std::net::{TcpListener, TcpStream};

/// More clients than this are not served.
const CLIENTS: usize = 16;

/// A TCP port like those that ArduPilot's simulator opens: every client hears and says everything.
pub(super) struct Server {
    listener: TcpListener,
    clients: Vec<Client>,
    /// Who spoke last: system and component.
    pub station: Option<(u8, u8)>,
}

struct Client {
    stream: TcpStream,
    parser: Parser,
    /// What the socket did not take of the last frame.
    rest: Vec<u8>,
    gone: bool,
}

impl Server {
    pub fn open(host: &str, port: u16) -> Result<Self> {
        let listener = TcpListener::bind((host, port))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, clients: Vec::new(), station: None })
    }

    /// Sends one frame to every client; the number of those that could not take it.
    pub fn send(&mut self, frame: &[u8]) -> u64 {
        let dropped = self.clients.iter_mut().map(|client| u64::from(!client.send(frame))).sum();
        self.clients.retain(|client| !client.gone);
        dropped
    }

    /// Hands on every frame that has arrived, and lets new clients in.
    pub fn listen(&mut self, take: &mut impl FnMut(FrameRef<'_>)) {
        while let Ok((stream, _)) = self.listener.accept() {
            let welcome = stream.set_nonblocking(true).is_ok() && stream.set_nodelay(true).is_ok();
            if welcome && self.clients.len() < CLIENTS {
                self.clients.push(Client { stream, parser: Parser::new(), rest: Vec::new(), gone: false });
            }
        }
        for client in &mut self.clients {
            client.receive();
            while let Some(event) = client.parser.next() {
                if let Event::Frame(frame) = event {
                    self.station = Some((frame.system_id(), frame.component_id()));
                    take(frame);
                }
            }
        }
        self.clients.retain(|client| !client.gone);
    }
}

impl Client {
    /// False if the frame was not taken: a client that does not read misses whole frames.
    fn send(&mut self, frame: &[u8]) -> bool {
        let mut rest = std::mem::take(&mut self.rest);
        let sent = self.write(&rest);
        rest.drain(..sent);
        if !rest.is_empty() {
            self.rest = rest;
            return false;
        }
        let sent = self.write(frame);
        if sent > 0 {
            rest.extend_from_slice(frame.get(sent..).unwrap_or_default());
        }
        self.rest = rest;
        sent > 0
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        if bytes.is_empty() {
            return 0;
        }
        match self.stream.write(bytes) {
            Ok(sent) => sent,
            Err(e) => {
                self.gone |= e.kind() != ErrorKind::WouldBlock;
                0
            }
        }
    }

    fn receive(&mut self) {
        let mut bytes = [0; 4096];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => self.gone = true,
                Ok(count) => {
                    self.parser.push(bytes.get(..count).unwrap_or_default());
                    continue;
                }
                Err(e) => self.gone |= e.kind() != ErrorKind::WouldBlock,
            }
            break;
        }
    }
}
