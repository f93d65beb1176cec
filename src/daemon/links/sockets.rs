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

/// Datagrams that the kernel dropped because they were not taken in time: its own count, where it keeps one that can be
/// read. A burst that is longer than the 256 sequence numbers shows nowhere else.
#[cfg(target_os = "linux")]
pub(super) fn overruns(socket: &UdpSocket) -> Option<u64> {
    use std::fs;
    use std::os::fd::AsRawFd;

    let name = fs::read_link(format!("/proc/self/fd/{}", socket.as_raw_fd())).ok()?;
    let inode = name.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned();
    ["/proc/self/net/udp", "/proc/self/net/udp6"]
        .iter()
        .find_map(|table| fs::read_to_string(table).ok()?.lines().skip(1).find_map(|line| drops_in(line, &inode)))
}

#[cfg(not(target_os = "linux"))]
pub(super) fn overruns(_: &UdpSocket) -> Option<u64> {
    None
}

/// The drops in a line of the kernel's table, if it is that of this socket: the tenth column is its inode, the
/// thirteenth its drops.
#[cfg(target_os = "linux")]
fn drops_in(line: &str, inode: &str) -> Option<u64> {
    const INODE: usize = 9;
    const DROPS: usize = 12;
    let mut columns = line.split_whitespace();
    if columns.nth(INODE)? != inode {
        return None;
    }
    columns.nth(DROPS - INODE - 1)?.parse().ok()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_the_kernel_drops_is_counted() {
        let socket = bind(SocketAddr::from(([127, 0, 0, 1], 0)), false).await.expect("a free port");
        SockRef::from(&socket).set_recv_buffer_size(4096).expect("set");
        assert_eq!(overruns(&socket), Some(0));
        let peer = std::net::UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let to = socket.local_addr().expect("bound");
        for _ in 0..200 {
            peer.send_to(&[0; 500], to).expect("sent");
        }
        let (mut came, mut buffer) = (0, [0; 600]);
        // until then the runtime does not know that anything came
        socket.readable().await.expect("something came");
        while socket.try_recv_from(&mut buffer).is_ok() {
            came += 1;
        }
        assert!(came < 200);
        assert_eq!(overruns(&socket), Some(200 - came));
    }
}
