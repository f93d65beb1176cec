use crate::config::LinkUrl;
use std::net::{TcpListener, ToSocketAddrs, UdpSocket};
use std::path::Path;

/// What stands in the way of a link at this moment. A run waits for most of it.
pub(super) fn caution(url: &LinkUrl) -> Option<String> {
    match url {
        LinkUrl::UdpIn { host, port } => binds(UdpSocket::bind((host.as_str(), *port))),
        LinkUrl::TcpIn { host, port } => binds(TcpListener::bind((host.as_str(), *port))),
        LinkUrl::UdpOut { host, port } | LinkUrl::UdpBcast { host, port } | LinkUrl::TcpOut { host, port } => {
            let found = (host.as_str(), *port).to_socket_addrs();
            found.err().map(|e| format!("`{host}` has no address now ({e}); a run tries again"))
        }
        LinkUrl::Serial { device, .. } => missing(device, "a run waits for it"),
        LinkUrl::Tlog { path, .. } => missing(path, "a run refuses to start"),
    }
}

fn binds<S>(bound: std::io::Result<S>) -> Option<String> {
    bound.err().map(|e| format!("the port cannot be had now: {e}"))
}

fn missing(path: &Path, then: &str) -> Option<String> {
    (!path.exists()).then(|| format!("{} is not there now; {then}", path.display()))
}
