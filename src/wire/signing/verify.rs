use super::{Key, Signature, SignatureTime, covered};
use crate::wire::FrameRef;
use std::collections::BTreeMap;

/// RADIO_STATUS: radios insert it and cannot sign, so every policy lets it through.
const RADIO_STATUS: u32 = 109;
/// Senders that are kept apart; more than any fleet has, and little memory.
const MOST_SENDERS: usize = 1024;

/// What becomes of frames without a signature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unsigned {
    /// Only radios may send them (RADIO_STATUS).
    Refuse,
    /// Taken like signed ones: while a fleet is being moved over.
    Accept,
}

/// Why a frame is not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, thiserror::Error)]
pub enum Refusal {
    #[error("not signed")]
    NotSigned,
    #[error("signed with another key, or changed on its way")]
    WrongKey,
    #[error("sent before, or older than what its sender sent before")]
    Replayed,
    #[error("from a new sender whose clock is more than a minute behind")]
    Behind,
    #[error("from one sender too many")]
    TooManySenders,
}

/// Checks what arrives on one link.
#[derive(Debug, Clone)]
pub struct Verifier {
    key: Key,
    unsigned: Unsigned,
    /// The newest time of each (system, component, link id).
    senders: BTreeMap<(u8, u8, u8), SignatureTime>,
    newest: SignatureTime,
}

impl Verifier {
    /// `newest` is the newest time seen or signed with this key; keep it on disk, or old recordings pass for new.
    pub fn new(key: Key, unsigned: Unsigned, newest: SignatureTime) -> Self {
        Self { key, unsigned, senders: BTreeMap::new(), newest }
    }

    /// The newest time seen.
    pub fn newest(&self) -> SignatureTime {
        self.newest
    }

    /// May this frame be used? Own time counts as seen.
    ///
    /// # Errors
    /// The reason why not.
    pub fn check(&mut self, frame: FrameRef<'_>, unix_us: u64) -> Result<(), Refusal> {
        let Some(signature) = Signature::of(frame) else {
            let welcome = self.unsigned == Unsigned::Accept || frame.message_id() == RADIO_STATUS;
            return if welcome { Ok(()) } else { Err(Refusal::NotSigned) };
        };
        let digest = self.key.digest(covered(frame), signature.link_id, signature.time.bytes());
        // in constant time: how much of a forged digest is right must not show
        let differs = digest.iter().zip(signature.digest).fold(0, |all, (a, b)| all | (a ^ b));
        if differs != 0 {
            return Err(Refusal::WrongKey);
        }
        let sender = (frame.system_id(), frame.component_id(), signature.link_id);
        let newest = self.newest.max(SignatureTime::from_unix_us(unix_us));
        match self.senders.get(&sender) {
            Some(last) if signature.time <= *last => return Err(Refusal::Replayed),
            None if signature.time.ticks() + SignatureTime::MINUTE < newest.ticks() => return Err(Refusal::Behind),
            None if self.senders.len() >= MOST_SENDERS => return Err(Refusal::TooManySenders),
            _ => {}
        }
        self.senders.insert(sender, signature.time);
        self.newest = self.newest.max(signature.time);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::{HEARTBEAT_DATA, RADIO_STATUS_DATA};
    use crate::wire::signing::Signer;
    use crate::wire::{Encoder, Event, FrameBuf, Parser};
    use proptest::prelude::*;

    const NOW_US: u64 = 1_795_000_000_000_000;

    fn key() -> Key {
        Key::from_passphrase("a test of signing")
    }

    fn verifier(unsigned: Unsigned) -> Verifier {
        Verifier::new(key(), unsigned, SignatureTime::default())
    }

    fn signed(unix_us: u64) -> FrameBuf {
        let mut signer = Signer::new(key(), 3, SignatureTime::default());
        signer.sign(Encoder::new(1, 1).encode(&HEARTBEAT_DATA::default()).as_ref(), unix_us).unwrap()
    }

    #[test]
    fn a_signed_frame_is_a_frame_and_is_taken_once() {
        let frame = signed(NOW_US);
        let mut parser = Parser::new();
        parser.push(frame.bytes());
        let Some(Event::Frame(received)) = parser.next() else { panic!("no frame") };
        let mut verifier = verifier(Unsigned::Refuse);
        assert_eq!(verifier.check(received, NOW_US), Ok(()));
        assert_eq!(verifier.check(received, NOW_US), Err(Refusal::Replayed));
        assert_eq!(Signature::of(received).map(|s| s.link_id), Some(3));
    }

    /// Computed with Python's hashlib from the definition.
    #[test]
    fn the_digest_is_that_of_the_definition() {
        let key = Key::new(std::array::from_fn(|i| i as u8));
        assert_eq!(key.digest(b"frame", 7, [1, 2, 3, 4, 5, 6]), [0xcc, 0x43, 0xd8, 0x61, 0xe2, 0xfe]);
    }

    #[test]
    fn clocks_that_go_back_do_not_repeat_times() {
        let mut signer = Signer::new(key(), 0, SignatureTime::default());
        let mut verifier = verifier(Unsigned::Refuse);
        let mut encoder = Encoder::new(1, 1);
        for unix_us in [NOW_US, NOW_US, NOW_US - 5_000_000, NOW_US + 1] {
            let frame = signer.sign(encoder.encode(&HEARTBEAT_DATA::default()).as_ref(), unix_us).unwrap();
            assert_eq!(verifier.check(frame.as_ref(), NOW_US), Ok(()));
        }
        assert_eq!(signer.last(), verifier.newest());
    }

    #[test]
    fn a_new_sender_may_not_be_a_minute_behind() {
        let minutes_ago = |s: u64| signed(NOW_US - s * 1_000_000);
        assert_eq!(verifier(Unsigned::Refuse).check(minutes_ago(59).as_ref(), NOW_US), Ok(()));
        assert_eq!(verifier(Unsigned::Refuse).check(minutes_ago(61).as_ref(), NOW_US), Err(Refusal::Behind));
        // what was seen before a restart counts
        let mut after = Verifier::new(key(), Unsigned::Refuse, SignatureTime::from_unix_us(NOW_US));
        assert_eq!(after.check(minutes_ago(61).as_ref(), 0), Err(Refusal::Behind));
    }

    #[test]
    fn unsigned_frames_follow_the_policy_and_radios_pass() {
        let mut encoder = Encoder::new(1, 1);
        let plain = encoder.encode(&HEARTBEAT_DATA::default());
        let radio = encoder.encode(&RADIO_STATUS_DATA::default());
        let mut strict = verifier(Unsigned::Refuse);
        assert_eq!(strict.check(plain.as_ref(), NOW_US), Err(Refusal::NotSigned));
        assert_eq!(strict.check(radio.as_ref(), NOW_US), Ok(()));
        assert_eq!(verifier(Unsigned::Accept).check(plain.as_ref(), NOW_US), Ok(()));
    }

    #[test]
    fn what_cannot_be_signed_is_left_alone() {
        let mut signer = Signer::new(key(), 0, SignatureTime::default());
        let old = Encoder::new(1, 1).encode_v1(&HEARTBEAT_DATA::default()).unwrap();
        assert!(signer.sign(old.as_ref(), NOW_US).is_none());
        assert!(signer.sign(signed(NOW_US).as_ref(), NOW_US).is_none());
    }

    #[test]
    fn a_signature_of_another_key_is_replaced() {
        let other = Key::from_passphrase("another secret");
        let mut signer = Signer::new(other.clone(), 9, SignatureTime::default());
        let frame = signer.sign(signed(NOW_US).as_ref(), NOW_US).unwrap();
        assert_eq!(Signature::of(frame.as_ref()).map(|s| s.link_id), Some(9));
        let mut theirs = Verifier::new(other, Unsigned::Refuse, SignatureTime::default());
        assert_eq!(theirs.check(frame.as_ref(), NOW_US), Ok(()));
        assert_eq!(verifier(Unsigned::Refuse).check(frame.as_ref(), NOW_US), Err(Refusal::WrongKey));
    }

    #[test]
    fn the_checksum_of_a_signed_frame_is_right_and_so_is_that_of_an_unknown_message() {
        let mut signer = Signer::new(key(), 0, SignatureTime::default());
        let known = signer.sign(Encoder::new(1, 1).encode(&HEARTBEAT_DATA::default()).as_ref(), NOW_US).unwrap();
        assert_eq!(known.as_ref().check(), crate::wire::Check::Verified);
        // message 0xAAAAAA, whose seed here is 77
        let mut bytes = vec![0xFD, 3, 0, 0, 5, 1, 1, 0xAA, 0xAA, 0xAA, 7, 8, 9];
        let checksum = |bytes: &[u8]| mavlink_core::calculate_crc(&bytes[1..13], 77).to_le_bytes();
        bytes.extend(checksum(&bytes));
        let Some(Event::Frame(unknown)) = crate::wire::datagram(&bytes).next() else { panic!("no frame") };
        let sealed = signer.sign(unknown, NOW_US).unwrap();
        assert_eq!(sealed.bytes()[13..15], checksum(sealed.bytes()));
    }

    proptest! {
        #[test]
        fn any_changed_bit_is_noticed(bit in 0usize..(30 * 8)) {
            let frame = signed(NOW_US);
            let mut bytes = frame.bytes().to_vec();
            let at = bit % (bytes.len() * 8);
            bytes[at / 8] ^= 1 << (at % 8);
            let mut parser = Parser::new();
            parser.push(&bytes);
            if let Some(Event::Frame(changed)) = parser.next() {
                prop_assert!(verifier(Unsigned::Refuse).check(changed, NOW_US).is_err());
            }
        }
    }
}
