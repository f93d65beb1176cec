//! Asks one vehicle for a few parameters by name.
//!
//! Single parameters are read, because a transfer of the whole list slows ArduPilot's streams down to a quarter and takes
//! minutes on a radio. One request is open at a time. What stays unanswered is asked for again when the others are
//! known, in several rounds, for links that lose much; a vehicle that answers none of the first is left alone. What a
//! ground station asked for meanwhile counts too. Time is passed in as milliseconds of any steady clock; nothing is
//! sent here.

const ANSWER_MS: u64 = 500;
/// Requests for one parameter in a row, and for the first while nothing was ever answered.
const ATTEMPTS: u32 = 3;
const FIRST_ATTEMPTS: u32 = 8;
const ROUNDS: u32 = 3;

/// Reads a list of parameters, one by one. See the [module](self).
#[derive(Debug, Clone, Default)]
pub struct ParameterReader {
    names: Vec<String>,
    known: Vec<bool>,
    /// Index of the next or open request.
    at: usize,
    attempt: u32,
    round: u32,
    sent_ms: Option<u64>,
    any_answer: bool,
}

impl ParameterReader {
    pub fn new(names: Vec<String>) -> Self {
        Self { known: vec![false; names.len()], names, ..Self::default() }
    }

    /// Reads these too, as far as they are not on the list.
    pub fn add(&mut self, names: impl IntoIterator<Item = String>) {
        for name in names {
            if !self.names.contains(&name) {
                self.names.push(name);
                self.known.push(false);
            }
        }
    }

    /// A PARAM_VALUE of this name arrived. True if it is one of the list.
    pub fn heard(&mut self, name: &str) -> bool {
        let Some(index) = self.names.iter().position(|n| n == name) else { return false };
        self.known[index] = true;
        self.any_answer = true;
        true
    }

    /// The parameter to ask for at `now_ms`, if any.
    pub fn poll(&mut self, now_ms: u64) -> Option<&str> {
        loop {
            if self.at >= self.names.len() {
                let again = self.any_answer && self.round + 1 < ROUNDS && self.known.contains(&false);
                if !again {
                    return None;
                }
                (self.at, self.round) = (0, self.round + 1);
            }
            if self.known[self.at] {
                self.next();
                continue;
            }
            match self.sent_ms {
                Some(sent) if now_ms.saturating_sub(sent) < ANSWER_MS => return None,
                Some(_) if self.attempt >= FIRST_ATTEMPTS && !self.any_answer => {
                    self.at = self.names.len();
                    return None;
                }
                Some(_) if self.attempt >= ATTEMPTS && self.any_answer => self.next(),
                _ => {
                    self.attempt += 1;
                    self.sent_ms = Some(now_ms);
                    return self.names.get(self.at).map(String::as_str);
                }
            }
        }
    }

    fn next(&mut self) {
        (self.at, self.attempt, self.sent_ms) = (self.at + 1, 0, None);
    }

    /// Is nothing left to ask?
    pub fn finished(&self) -> bool {
        let all_known = !self.known.contains(&false);
        all_known || (self.at >= self.names.len() && (!self.any_answer || self.round + 1 >= ROUNDS))
    }

    /// How many parameters are known, and of how many.
    pub fn progress(&self) -> (usize, usize) {
        (self.known.iter().filter(|known| **known).count(), self.names.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reader() -> ParameterReader {
        ParameterReader::new(["A", "B", "C", "D"].map(str::to_owned).to_vec())
    }

    /// Asks for forty seconds a vehicle that answers the `n`-th request (from 0) as told; gives what it was asked.
    fn asked(mut reader: ParameterReader, answers: impl Fn(usize, &str) -> bool) -> Vec<String> {
        let mut asked = Vec::new();
        for now in (0..40_000).step_by(50) {
            if let Some(name) = reader.poll(now).map(str::to_owned) {
                if answers(asked.len(), &name) {
                    assert!(reader.heard(&name));
                }
                asked.push(name);
            }
        }
        assert!(reader.finished());
        asked
    }

    #[test]
    fn each_is_asked_once_when_answered() {
        assert_eq!(asked(reader(), |_, _| true), ["A", "B", "C", "D"]);
    }

    #[test]
    fn losses_are_repeated_and_the_unknown_left_out_at_last() {
        let heard = |n: usize, name: &str| name != "C" && n != 0;
        let rounds = ["A", "A", "B", "C", "C", "C", "D", "C", "C", "C", "C", "C", "C"];
        assert_eq!(asked(reader(), heard), rounds);
    }

    #[test]
    fn a_vehicle_that_answers_nothing_is_left_alone() {
        assert_eq!(asked(reader(), |_, _| false), ["A"; 8]);
    }

    #[test]
    fn what_another_station_asked_for_is_not_asked_again() {
        let mut reader = reader();
        assert!(reader.heard("A") && reader.heard("B") && !reader.heard("OTHER"));
        assert_eq!(asked(reader, |_, _| true), ["C", "D"]);
    }

    #[test]
    fn what_is_added_later_is_read_too() {
        let mut reader = ParameterReader::new(vec!["A".to_owned()]);
        assert_eq!(reader.poll(0), Some("A"));
        reader.heard("A");
        assert_eq!(reader.poll(50), None);
        assert!(reader.finished());
        reader.add(["A", "B"].map(str::to_owned));
        assert!(!reader.finished());
        assert_eq!(reader.poll(100), Some("B"));
        reader.heard("B");
        assert!(reader.finished() && reader.progress() == (2, 2));
    }

    #[test]
    fn a_fifth_lost_both_ways_loses_no_parameter() {
        use rand::{RngExt, SeedableRng};
        for seed in 0..200 {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut reader = ParameterReader::new((0..23).map(|n| format!("P{n}")).collect());
            for now in (0..60_000).step_by(50) {
                if let Some(name) = reader.poll(now).map(str::to_owned)
                    && !rng.random_bool(0.2)
                    && !rng.random_bool(0.2)
                {
                    reader.heard(&name);
                }
            }
            assert_eq!(reader.progress(), (23, 23), "seed {seed}");
        }
    }
}
