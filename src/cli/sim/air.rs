use super::server::Server;
use crate::cli::Failure;
use crate::config::LinkUrl;
use crate::wire::{Event, FrameRef, Parser};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

/// The ground stations on the other end: plain sockets that never block the simulation.
pub(in crate::cli) struct Air {
    links: Vec<Link>,
    servers: Vec<Server>,
    dropped: u64,
}

struct Link {
    socket: UdpSocket,
    /// Those that are sent to: one for `udpout`, whoever has spoken for `udpin`.
    peers: Vec<SocketAddr>,
    fixed: bool,
    parser: Parser,
    /// Who spoke last: system and component.
    station: Option<(u8, u8)>,
}

/// More ground stations than this on one port are not answered.
const PEERS: usize = 16;

impl Air {
    pub fn open(urls: &[LinkUrl]) -> Result<Self, Failure> {
        let (mut links, mut servers) = (Vec::new(), Vec::new());
        for url in urls {
            match url {
                LinkUrl::TcpIn { host, port } => servers.push(Server::open(host, *port).map_err(|e| failed(url, &e))?),
                _ => links.push(Link::open(url)?),
            }
        }
        Ok(Self { links, servers, dropped: 0 })
    }

    /// Frames that no socket would take.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// A ground station that has spoken: system and component.
    pub fn station(&self) -> Option<(u8, u8)> {
        let spoken = self.links.iter().filter_map(|link| link.station);
        spoken.chain(self.servers.iter().filter_map(|server| server.station)).next()
    }

    /// Sends one frame to every peer as a datagram. What does not fit is dropped and counted.
    pub fn send(&mut self, frame: &[u8]) {
        for link in &self.links {
            for peer in &link.peers {
                if link.socket.send_to(frame, peer).is_err() {
                    self.dropped += 1;
                }
            }
        }
        for server in &mut self.servers {
            self.dropped += server.send(frame);
        }
    }

    /// Hands on every frame that has arrived.
    pub fn listen(&mut self, mut take: impl FnMut(FrameRef<'_>)) {
        let mut datagram = [0; 2048];
        for link in &mut self.links {
            // a peer that is not there yet answers with an error: the next datagram may be good
            loop {
                match link.socket.recv_from(&mut datagram) {
                    Ok((len, from)) => link.datagram(datagram.get(..len).unwrap_or_default(), from, &mut take),
                    Err(e) if e.kind() == ErrorKind::WouldBlock => break,
                    Err(e) if e.kind() == ErrorKind::ConnectionRefused => {}
                    Err(_) => break,
                }
            }
        }
        for server in &mut self.servers {
            server.listen(&mut take);
        }
    }
}

fn failed(url: &LinkUrl, e: &std::io::Error) -> Failure {
    Failure::Failed(format!("{url}: {e}"))
}

impl Link {
    fn open(url: &LinkUrl) -> Result<Self, Failure> {
        let failed = |e: std::io::Error| failed(url, &e);
        let (socket, peers, fixed) = match url {
            LinkUrl::UdpIn { host, port } => {
                (UdpSocket::bind((host.as_str(), *port)).map_err(failed)?, Vec::new(), false)
            }
            LinkUrl::UdpOut { host, port } => {
                use std::net::ToSocketAddrs;
                let peer = (host.as_str(), *port).to_socket_addrs().map_err(failed)?.next();
                let peer = peer.ok_or_else(|| Failure::Failed(format!("{url}: no such address")))?;
                let any = if peer.is_ipv6() { "[::]:0" } else { "0.0.0.0:0" };
                (UdpSocket::bind(any).map_err(failed)?, vec![peer], true)
            }
            _ => {
                return Err(Failure::Usage(format!(
                    "{url}: sim sends to udpin:, udpout: and tcpin: links; for files, --tlog"
                )));
            }
        };
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, peers, fixed, parser: Parser::new(), station: None })
    }

    fn datagram(&mut self, bytes: &[u8], from: SocketAddr, take: &mut impl FnMut(FrameRef<'_>)) {
        if !self.fixed && !self.peers.contains(&from) && self.peers.len() < PEERS {
            self.peers.push(from);
        }
        self.parser.push(bytes);
        while let Some(event) = self.parser.next() {
            if let Event::Frame(frame) = event {
                self.station = Some((frame.system_id(), frame.component_id()));
                take(frame);
            }
        }
    }
}
