//! Text for the wire.

use crate::wire::dialect::ardupilotmega::{MavSeverity, STATUSTEXT_DATA};
use mavlink_core::types::CharArray;

const CHUNK: usize = 50;

/// A fixed-size character field: ASCII, NUL-padded, cut where it ends.
pub(super) fn char_array<const N: usize>(text: &str) -> CharArray<N> {
    let mut field = [0; N];
    for (slot, c) in field.iter_mut().zip(text.chars()) {
        *slot = ascii(c);
    }
    CharArray::new(field)
}

/// Ground stations expect ASCII; NUL would end the text.
fn ascii(c: char) -> u8 {
    match c {
        ' '..='~' => c as u8,
        '²' => b'2',
        '°' | '·' | '\n' | '\t' => b' ',
        '–' | '—' | '−' => b'-',
        _ => b'?',
    }
}

/// The STATUSTEXTs that carry `text`: one, or several chunks under an `id` other than zero.
///
/// A receiver knows the last chunk by its NUL, so a long text that fills its last chunk is followed by an empty one.
pub(super) fn status_text(severity: MavSeverity, text: &str, id: u16, mut send: impl FnMut(STATUSTEXT_DATA)) {
    let length = text.chars().count();
    if length <= CHUNK {
        return send(STATUSTEXT_DATA { severity, text: char_array(text), id: 0, chunk_seq: 0 });
    }
    let mut rest = text;
    // chunk_seq is a byte: a text ends after 12 800 characters
    for chunk_seq in 0..=u8::MAX {
        let end = rest.char_indices().nth(CHUNK).map_or(rest.len(), |(at, _)| at);
        let (chunk, after) = rest.split_at(end);
        let full = chunk.chars().count() == CHUNK;
        send(STATUSTEXT_DATA { severity, text: char_array(chunk), id: id.max(1), chunk_seq });
        if !full {
            return;
        }
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn chunks(text: &str) -> Vec<STATUSTEXT_DATA> {
        let mut chunks = Vec::new();
        status_text(MavSeverity::MAV_SEVERITY_INFO, text, 0, |c| chunks.push(c));
        chunks
    }

    #[test]
    fn short_texts_are_one_message_without_an_id() {
        for length in [0, 1, 50] {
            let sent = chunks(&"x".repeat(length));
            assert_eq!(sent.len(), 1);
            assert_eq!((sent[0].id, sent[0].chunk_seq), (0, 0));
        }
    }

    #[test]
    fn characters_outside_ascii_are_replaced() {
        assert_eq!(chunks("4 m/s² from 12°, 1 N·m ± ∞")[0].text.to_str(), Ok("4 m/s2 from 12 , 1 N m ? ?"));
    }

    proptest! {
        #[test]
        fn long_texts_are_put_together_again(text in "[ -~]{51,400}") {
            let sent = chunks(&text);
            let joined: String = sent.iter().map(|c| c.text.to_str().expect("ASCII")).collect();
            prop_assert_eq!(joined, text);
            prop_assert!(sent.iter().enumerate().all(|(i, c)| usize::from(c.chunk_seq) == i && c.id != 0));
            let (last, others) = sent.split_last().expect("at least one");
            prop_assert!(last.text.contains(&0) && others.iter().all(|c| !c.text.contains(&0)));
        }
    }
}
