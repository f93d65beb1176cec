use crate::document::nearest;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where frames come from and go to, as `--link` and the config's `url` write it.
///
/// | URL | meaning |
/// |---|---|
/// | `udpin:HOST:PORT` | binds there and answers every peer that sends something |
/// | `udpout:HOST:PORT` | sends there from a free port |
/// | `udpbcast:ADDRESS:PORT` | sends to a broadcast address or multicast group, and hears what others send there |
/// | `tcpin:HOST:PORT` | listens there and serves every client |
/// | `tcpout:HOST:PORT` | connects there, again and again |
/// | `serial:DEVICE:BAUD` | a serial port, whenever it is there; `?flow=rtscts` for hardware flow control |
/// | `tlog:FILE` | plays a recorded log at its own pace; `?speed=4` faster, `?speed=max` as fast as it goes |
///
/// An IPv6 address stands in brackets: `udpin:[::]:14550`.
#[derive(Debug, Clone, PartialEq)]
pub enum LinkUrl {
    UdpIn { host: String, port: u16 },
    UdpOut { host: String, port: u16 },
    UdpBcast { host: String, port: u16 },
    TcpIn { host: String, port: u16 },
    TcpOut { host: String, port: u16 },
    Serial { device: PathBuf, baud: u32, flow: Flow },
    Tlog { path: PathBuf, pace: Pace },
}

/// Flow control of a serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    None,
    /// Hardware flow control by the RTS and CTS lines.
    RtsCts,
}

/// How fast a log is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// This many times its own speed.
    Times(f64),
    /// As fast as the machine goes.
    Max,
}

/// What is wrong with a link URL.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkUrlError {
    #[error("`{url}` is no link: it has no scheme; write udpin:HOST:PORT, serial:DEVICE:BAUD, tlog:FILE or another")]
    NoScheme { url: String },
    #[error("`{url}` has the unknown scheme `{scheme}`; {hint}known: {}", SCHEMES.join(", "))]
    UnknownScheme { url: String, scheme: String, hint: String },
    #[error("`{url}` needs a host and a port, such as {example}")]
    NoHostPort { url: String, example: String },
    #[error("`{url}` has no valid port: `{port}` is not a number from 1 to 65535")]
    Port { url: String, port: String },
    #[error("`{url}` names no file; write tlog:FILE")]
    NoFile { url: String },
    #[error("`{url}`: {what}; a log takes ?speed=NUMBER (above 0) or ?speed=max")]
    Pace { url: String, what: String },
    #[error("`{url}`: {what}; a serial port is written serial:/dev/ttyACM0:57600, perhaps with ?flow=rtscts")]
    Serial { url: String, what: String },
}

const SCHEMES: [&str; 7] = ["udpin", "udpout", "udpbcast", "tcpin", "tcpout", "serial", "tlog"];
/// No serial port is faster or slower.
const BAUDS: std::ops::RangeInclusive<u32> = 300..=12_000_000;

impl LinkUrl {
    /// The same link with a relative file taken from `base`.
    pub fn relative_to(self, base: &Path) -> Self {
        match self {
            Self::Tlog { path, pace } => Self::Tlog { path: base.join(path), pace },
            other => other,
        }
    }

    /// What only one link can hold: a bound port or a device.
    pub fn claims(&self) -> Option<String> {
        match self {
            Self::UdpIn { port, .. } | Self::UdpBcast { port, .. } => Some(format!("UDP port {port}")),
            Self::TcpIn { port, .. } => Some(format!("TCP port {port}")),
            Self::Serial { device, .. } => Some(format!("the serial port {}", device.display())),
            Self::UdpOut { .. } | Self::TcpOut { .. } | Self::Tlog { .. } => None,
        }
    }
}

impl FromStr for LinkUrl {
    type Err = LinkUrlError;

    fn from_str(url: &str) -> Result<Self, LinkUrlError> {
        let no_scheme = || LinkUrlError::NoScheme { url: url.to_owned() };
        let (scheme, rest) = url.split_once(':').ok_or_else(no_scheme)?;
        let network = |make: fn(String, u16) -> Self| host_port(url, scheme, rest).map(|(host, port)| make(host, port));
        match scheme {
            "udpin" => network(|host, port| Self::UdpIn { host, port }),
            "udpout" => network(|host, port| Self::UdpOut { host, port }),
            "udpbcast" => network(|host, port| Self::UdpBcast { host, port }),
            "tcpin" => network(|host, port| Self::TcpIn { host, port }),
            "tcpout" => network(|host, port| Self::TcpOut { host, port }),
            "serial" => serial(url, rest),
            "tlog" => tlog(url, rest),
            _ => {
                let hint = nearest(scheme, SCHEMES).map_or_else(String::new, |n| format!("did you mean `{n}`? "));
                Err(LinkUrlError::UnknownScheme { url: url.to_owned(), scheme: scheme.to_owned(), hint })
            }
        }
    }
}

fn host_port(url: &str, scheme: &str, rest: &str) -> Result<(String, u16), LinkUrlError> {
    let example = match scheme {
        "udpin" => "udpin:0.0.0.0:14550",
        "udpbcast" => "udpbcast:192.168.1.255:14550",
        "tcpin" => "tcpin:0.0.0.0:5760",
        "tcpout" => "tcpout:192.168.1.10:5760",
        _ => "udpout:192.168.1.10:14550",
    };
    let missing = || LinkUrlError::NoHostPort { url: url.to_owned(), example: example.to_owned() };
    // `udp://host:port` is what other tools write
    let (host, port) = rest.strip_prefix("//").unwrap_or(rest).rsplit_once(':').ok_or_else(missing)?;
    let host = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
    if host.is_empty() {
        return Err(missing());
    }
    match port.parse() {
        Ok(number) if number > 0 => Ok((host.to_owned(), number)),
        _ => Err(LinkUrlError::Port { url: url.to_owned(), port: port.to_owned() }),
    }
}

fn serial(url: &str, rest: &str) -> Result<LinkUrl, LinkUrlError> {
    let wrong = |what: String| LinkUrlError::Serial { url: url.to_owned(), what };
    let (rest, query) = rest.split_once('?').map_or((rest, None), |(rest, query)| (rest, Some(query)));
    // a device's path may itself hold colons
    let (device, baud) = rest.rsplit_once(':').ok_or_else(|| wrong("it has no baud rate".to_owned()))?;
    if device.is_empty() {
        return Err(wrong("it names no device".to_owned()));
    }
    let rate = baud.parse().ok().filter(|rate| BAUDS.contains(rate));
    let baud = rate.ok_or_else(|| wrong(format!("`{baud}` is no baud rate")))?;
    let flow = match query {
        None | Some("flow=none") => Flow::None,
        Some("flow=rtscts") => Flow::RtsCts,
        Some(other) => return Err(wrong(format!("unknown option `{other}`"))),
    };
    Ok(LinkUrl::Serial { device: PathBuf::from(device), baud, flow })
}

fn tlog(url: &str, rest: &str) -> Result<LinkUrl, LinkUrlError> {
    let (path, query) = rest.split_once('?').map_or((rest, None), |(path, query)| (path, Some(query)));
    if path.is_empty() {
        return Err(LinkUrlError::NoFile { url: url.to_owned() });
    }
    let wrong = |what: String| LinkUrlError::Pace { url: url.to_owned(), what };
    let pace = match query.map(|q| q.split_once('=').unwrap_or((q, ""))) {
        None => Pace::Times(1.0),
        Some(("speed", "max")) => Pace::Max,
        Some(("speed", speed)) => match speed.parse::<f64>() {
            Ok(times) if times > 0.0 && times.is_finite() => Pace::Times(times),
            _ => return Err(wrong(format!("`{speed}` is no speed"))),
        },
        Some((option, _)) => return Err(wrong(format!("unknown option `{option}`"))),
    };
    Ok(LinkUrl::Tlog { path: PathBuf::from(path), pace })
}

impl fmt::Display for LinkUrl {
    /// The URL, such that parsing it gives this link again.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let address = |host: &str, port: u16| {
            if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
        };
        match self {
            Self::UdpIn { host, port } => write!(f, "udpin:{}", address(host, *port)),
            Self::UdpOut { host, port } => write!(f, "udpout:{}", address(host, *port)),
            Self::UdpBcast { host, port } => write!(f, "udpbcast:{}", address(host, *port)),
            Self::TcpIn { host, port } => write!(f, "tcpin:{}", address(host, *port)),
            Self::TcpOut { host, port } => write!(f, "tcpout:{}", address(host, *port)),
            Self::Serial { device, baud, flow } => {
                let flow = if *flow == Flow::RtsCts { "?flow=rtscts" } else { "" };
                write!(f, "serial:{}:{baud}{flow}", device.display())
            }
            Self::Tlog { path, pace: Pace::Max } => write!(f, "tlog:{}?speed=max", path.display()),
            Self::Tlog { path, pace: Pace::Times(times) } if *times == 1.0 => write!(f, "tlog:{}", path.display()),
            Self::Tlog { path, pace: Pace::Times(times) } => write!(f, "tlog:{}?speed={times}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn urls_read_as_they_are_written() {
        for url in [
            "udpin:0.0.0.0:14550",
            "udpout:companion.local:14551",
            "udpin:[::1]:14550",
            "udpbcast:239.255.0.1:14550",
            "tcpin:0.0.0.0:5760",
            "tcpout:[fe80::1]:5760",
            "serial:/dev/ttyACM0:57600",
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0:921600?flow=rtscts",
            "tlog:flights/a.tlog",
            "tlog:a.tlog?speed=max",
            "tlog:a.tlog?speed=2.5",
        ] {
            assert_eq!(url.parse::<LinkUrl>().unwrap().to_string(), url);
        }
        assert_eq!("udpin://0.0.0.0:1".parse::<LinkUrl>().unwrap(), "udpin:0.0.0.0:1".parse().unwrap());
    }

    #[test]
    fn every_mistake_says_what_to_write_instead() {
        for (url, hint) in [
            ("14550", "no scheme"),
            ("udpim:0.0.0.0:14550", "did you mean `udpin`?"),
            ("udpin:14550", "such as udpin:0.0.0.0:14550"),
            ("udpout::14550", "such as udpout:"),
            ("udpin:0.0.0.0:0", "1 to 65535"),
            ("udpin:0.0.0.0:99999", "1 to 65535"),
            ("tcpout:host", "such as tcpout:"),
            ("serial:/dev/ttyACM0", "no baud rate"),
            ("serial:/dev/ttyACM0:fast", "`fast` is no baud rate"),
            ("serial::57600", "names no device"),
            ("serial:/dev/ttyACM0:57600?flow=xon", "?flow=rtscts"),
            ("seriel:/dev/ttyACM0:57600", "did you mean `serial`?"),
            ("tlog:", "write tlog:FILE"),
            ("tlog:a?speed=-1", "above 0"),
            ("tlog:a?pace=1", "unknown option `pace`"),
        ] {
            let message = url.parse::<LinkUrl>().unwrap_err().to_string();
            assert!(message.contains(hint), "{url}: {message}");
        }
    }

    proptest! {
        #[test]
        fn any_text_parses_or_is_refused(url in "[a-z]{0,6}:?.{0,20}") {
            if let Ok(link) = url.parse::<LinkUrl>() {
                prop_assert_eq!(link.to_string().parse::<LinkUrl>(), Ok(link));
            }
        }
    }
}
