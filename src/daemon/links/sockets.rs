//! What all UDP links do with their sockets.

use socket2::{Domain, Protocol, SockRef, Socket, Type};
use std::io;
use std::net::SocketAddr;
use tokio::net::{UdpSocket, lookup_host};
use tracing::debug;

/// The longest datagram that UDP carries.
pub(super) const DATAGRAM: usize = 65_536;
/// Datagrams taken in one go before other tasks of the runtime have their turn.
const BATCH: usize = 64;
/// Kernel buffers: at 50 000 frames a second, some 30 ms of a busy machine. The kernel gives at most its own limit.
const KERNEL_BUFFER: usize = 4 << 20;

/// How a drained socket is.
pub(super) enum Drained {
    /// Nothing is left, or other tasks have their turn.
    Fine,
    Broken(io::Error),
}

/// A socket bound to `address`. With `shared`, other programs may bind there too.
pub(super) async fn bind(address: SocketAddr, shared: bool) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(address), Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    // without this the kernel refuses broadcast targets; it changes nothing for others
    socket.set_broadcast(true)?;
    if shared {
        socket.set_reuse_address(true)?;
    }
    socket.bind(&address.into())?;
    let socket = UdpSocket::from_std(socket.into())?;
    let buffers = SockRef::from(&socket);
    if let Err(error) = buffers.set_recv_buffer_size(KERNEL_BUFFER).and(buffers.set_send_buffer_size(KERNEL_BUFFER)) {
        debug!("the kernel's buffers stay as they are: {error}");
    }
    // `try_send_to` needs to have seen the socket writable once
    socket.writable().await?;
    Ok(socket)
}

/// The first address of a host.
pub(super) async fn resolve(host: &str, port: u16) -> io::Result<SocketAddr> {
    let unknown = || io::Error::new(io::ErrorKind::NotFound, "the host name has no address");
    lookup_host((host, port)).await?.next().ok_or_else(unknown)
}

/// Takes at most a batch of the datagrams that are there.
pub(super) fn drain(socket: &UdpSocket, buffer: &mut [u8], mut take: impl FnMut(&[u8], SocketAddr)) -> Drained {
    for _ in 0..BATCH {
        match socket.try_recv_from(buffer) {
            Ok((length, peer)) => take(&buffer[..length], peer),
            Err(error) => match error.kind() {
                io::ErrorKind::WouldBlock => break,
                // a peer's host said that nobody listens there: its affair
                io::ErrorKind::ConnectionRefused | io::ErrorKind::ConnectionReset => {}
                io::ErrorKind::Interrupted => {}
                _ => return Drained::Broken(error),
            },
        }
    }
    Drained::Fine
}
