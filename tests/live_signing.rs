//! Signed links, with pymavlink at the other end. Says so and passes where Python or pymavlink is absent.

mod live_support;

use live_support::*;
use mavobserver::config::Signing;
use mavobserver::daemon::Settings;
use mavobserver::wire::Encoder;
use mavobserver::wire::signing::{Key, Unsigned};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use tokio::time::sleep;

/// Told to the Python peer, which makes the same key of it.
const PASSPHRASE: &str = "a secret of both ends";

fn signing(folder: &Path, unsigned: Unsigned) -> Option<Signing> {
    let key = Key::from_passphrase(PASSPHRASE);
    Some(Signing { key, link_id: 3, unsigned, times: folder.join("key.times") })
}

/// A daemon that knows vehicle 1 on an open link, and has a signed one.
async fn daemon(folder: &Path, unsigned: Unsigned) -> (Running, Peer) {
    let mut signed = talking(any_port());
    signed.signing = signing(folder, unsigned);
    let running = Running::start(Settings::new(vec![silent(any_port()), signed]), Echo::default()).await;
    let vehicle = Peer::new(Some(running.address(0))).await;
    for frame in flight_of(&mut Encoder::new(1, 1), 5) {
        vehicle.send(frame.bytes()).await;
    }
    sleep(Duration::from_millis(100)).await;
    (running, vehicle)
}

/// Runs the peer with a passphrase while the vehicle flies on; what it found out.
async fn peer(running: &Running, vehicle: &Peer, passphrase: &str) -> Option<String> {
    let here = Command::new("python3").args(["-c", "import pymavlink"]).stderr(Stdio::null()).status();
    if !here.is_ok_and(|s| s.success()) {
        eprintln!("SKIPPED: python3 with pymavlink is not here");
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pymavlink_signing.py");
    let (url, passphrase) = (format!("udpout:{}", running.address(1)), passphrase.to_owned());
    let mut asking =
        tokio::task::spawn_blocking(move || Command::new("python3").arg(script).args([url, passphrase]).output());
    let (mut encoder, mut k) = (Encoder::new(1, 1), 5);
    loop {
        tokio::select! {
            output = &mut asking => {
                let output = output.expect("no panic").expect("python starts");
                let said = String::from_utf8_lossy(&output.stdout).trim().to_owned();
                assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
                return Some(said);
            }
            () = sleep(Duration::from_millis(20)) => {
                k += 1;
                vehicle.send(encoder.encode(&attitude(k)).bytes()).await;
            }
        }
    }
}

#[tokio::test]
async fn pymavlink_signs_and_checks_both_ways() {
    let folder = tempfile::tempdir().expect("a folder");
    let (running, vehicle) = daemon(folder.path(), Unsigned::Refuse).await;
    // the vehicle's frames and ours come signed, and a parameter is set by a signed frame
    let Some(said) = peer(&running, &vehicle, PASSPHRASE).await else { return };
    assert_eq!(said, "forwarded: True, ours: True, answered: True");
    assert_eq!(running.control.status().links[1].refused_in, 0);
    // another key: it believes nothing of ours, and we believe nothing of it
    let said = peer(&running, &vehicle, "a secret of somebody else").await.expect("it was there before");
    assert_eq!(said, "forwarded: False, ours: False, answered: False");
    assert!(running.control.status().links[1].refused_in > 0);
    running.stop().await;
    let times = std::fs::read_to_string(folder.path().join("key.times")).expect("kept");
    assert!(times.trim().parse::<u64>().expect("a number") > 0);
}

#[tokio::test]
async fn unsigned_frames_are_refused_or_taken_as_the_link_says() {
    for (unsigned, passes) in [(Unsigned::Refuse, false), (Unsigned::Accept, true)] {
        let folder = tempfile::tempdir().expect("a folder");
        let (running, vehicle) = daemon(folder.path(), unsigned).await;
        let station = Peer::new(Some(running.address(1))).await;
        let hello = Encoder::new(255, 190).encode(&heartbeat());
        station.send(hello.bytes()).await;
        let received = vehicle.receive_until(tokio::time::Instant::now() + Duration::from_millis(500)).await;
        assert_eq!(received.as_deref() == Some(hello.bytes()), passes, "{unsigned:?}");
        assert_eq!(running.control.status().links[1].refused_in, u64::from(!passes));
        running.stop().await;
    }
}

#[tokio::test]
async fn a_recording_of_a_signed_link_is_not_believed_after_a_restart() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut frames = Vec::new();
    for round in 0..2 {
        let mut signed = silent(any_port());
        signed.signing = signing(folder.path(), Unsigned::Refuse);
        let running = Running::start(Settings::new(vec![signed, silent(any_port())]), Idle).await;
        let (sender, listener) = (Peer::new(Some(running.address(0))).await, Peer::new(Some(running.address(1))).await);
        listener.send(Encoder::new(254, 190).encode(&heartbeat()).bytes()).await;
        sleep(Duration::from_millis(100)).await;
        if round == 0 {
            let mut encoder = Encoder::new(1, 1);
            let mut signer =
                mavobserver::wire::signing::Signer::new(Key::from_passphrase(PASSPHRASE), 0, Default::default());
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
            // as if recorded two minutes before the newest
            for seconds_ago in [120, 0] {
                let then = (now - Duration::from_secs(seconds_ago)).as_micros() as u64;
                frames.push(signer.sign(encoder.encode(&heartbeat()).as_ref(), then).expect("MAVLink 2"));
            }
            sender.send(frames[1].bytes()).await;
            assert_eq!(listener.receive().await.as_deref(), Some(frames[1].bytes()), "it passes as it is");
        } else {
            sender.send(frames[0].bytes()).await;
            sleep(Duration::from_millis(200)).await;
            assert_eq!(running.control.status().links[0].refused_in, 1);
        }
        running.stop().await;
    }
}
