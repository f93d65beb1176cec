//! Asks one ArduPilot vehicle which output drives which rotor: its parameters SERVO1_FUNCTION … SERVO16_FUNCTION.
//!
//! Single parameters are read, because a transfer of the whole list slows ArduPilot's streams down to a quarter. One
//! request is open at a time and repeated twice; a vehicle that answers none of the first is left alone. What a ground
//! station asked for meanwhile counts too. Time is passed in as milliseconds of any steady clock; nothing is sent here.

/// The parameters that say which rotor an output drives.
pub const ROTOR_OUTPUTS: [&str; 16] = [
    "SERVO1_FUNCTION",
    "SERVO2_FUNCTION",
    "SERVO3_FUNCTION",
    "SERVO4_FUNCTION",
    "SERVO5_FUNCTION",
    "SERVO6_FUNCTION",
    "SERVO7_FUNCTION",
    "SERVO8_FUNCTION",
    "SERVO9_FUNCTION",
    "SERVO10_FUNCTION",
    "SERVO11_FUNCTION",
    "SERVO12_FUNCTION",
    "SERVO13_FUNCTION",
    "SERVO14_FUNCTION",
    "SERVO15_FUNCTION",
    "SERVO16_FUNCTION",
];

const ANSWER_MS: u64 = 500;
const ATTEMPTS: u32 = 3;

/// Reads a list of parameters, one by one. See the [module](self).
#[derive(Debug, Clone)]
pub struct ParameterReader {
    names: &'static [&'static str],
    known: Vec<bool>,
    /// Index of the next or open request.
    at: usize,
    attempt: u32,
    sent_ms: Option<u64>,
    any_answer: bool,
}

impl ParameterReader {
    pub fn new(names: &'static [&'static str]) -> Self {
        Self { names, known: vec![false; names.len()], at: 0, attempt: 0, sent_ms: None, any_answer: false }
    }

    /// A PARAM_VALUE of this name arrived. True if it is one of the list.
    pub fn heard(&mut self, name: &str) -> bool {
        let Some(index) = self.names.iter().position(|n| *n == name) else { return false };
        self.known[index] = true;
        self.any_answer = true;
        true
    }

    /// The parameter to ask for at `now_ms`, if any.
    pub fn poll(&mut self, now_ms: u64) -> Option<&'static str> {
        while *self.known.get(self.at)? {
            self.next();
        }
        if let Some(sent) = self.sent_ms {
            if now_ms.saturating_sub(sent) < ANSWER_MS {
                return None;
            }
            if self.attempt >= ATTEMPTS {
                if !self.any_answer {
                    self.at = self.names.len();
                    return None;
                }
                self.next();
                return self.poll(now_ms);
            }
        }
        self.attempt += 1;
        self.sent_ms = Some(now_ms);
        self.names.get(self.at).copied()
    }

    fn next(&mut self) {
        (self.at, self.attempt, self.sent_ms) = (self.at + 1, 0, None);
    }

    /// Is nothing left to ask?
    pub fn finished(&self) -> bool {
        self.at >= self.names.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 4] = ["A", "B", "C", "D"];

    /// Asks for twenty seconds a vehicle that answers the `n`-th request (from 0) as told; gives what it was asked.
    fn asked(mut reader: ParameterReader, answers: impl Fn(usize, &str) -> bool) -> Vec<&'static str> {
        let mut asked = Vec::new();
        for now in (0..20_000).step_by(50) {
            if let Some(name) = reader.poll(now) {
                if answers(asked.len(), name) {
                    assert!(reader.heard(name));
                }
                asked.push(name);
            }
        }
        assert!(reader.finished());
        asked
    }

    #[test]
    fn each_is_asked_once_when_answered() {
        assert_eq!(asked(ParameterReader::new(&NAMES), |_, _| true), NAMES);
    }

    #[test]
    fn losses_are_repeated_and_the_unknown_left_out() {
        let heard = |n: usize, name: &str| name != "C" && n != 0;
        assert_eq!(asked(ParameterReader::new(&NAMES), heard), ["A", "A", "B", "C", "C", "C", "D"]);
    }

    #[test]
    fn a_vehicle_that_answers_nothing_is_left_alone() {
        assert_eq!(asked(ParameterReader::new(&NAMES), |_, _| false), ["A", "A", "A"]);
    }

    #[test]
    fn what_another_station_asked_for_is_not_asked_again() {
        let mut reader = ParameterReader::new(&NAMES);
        assert!(reader.heard("A") && reader.heard("B") && !reader.heard("OTHER"));
        assert_eq!(asked(reader, |_, _| true), ["C", "D"]);
    }
}
