//! What one vehicle tells about itself: which firmware it has, and the parameters from which its airframe follows.
//!
//! First comes AUTOPILOT_VERSION, whose capabilities say how parameters travel, then the parameters by name. Without I/O
//! and without a clock, like everything that [`super::dialogue`] is made of.

use super::dialogue::Word;
use crate::telemetry::parameters::ParameterReader;
use crate::telemetry::{Encoding, ParamValue};
use crate::vehicle::Vehicle;
use crate::vehicle::airframe::{self, Airframe, AirframeError, Autopilot};
use crate::wire::dialect::ardupilotmega::AUTOPILOT_VERSION_DATA;
use crate::wire::{FrameRef, decode};
use std::collections::BTreeMap;
use std::sync::Arc;

const AUTOPILOT_VERSION: u32 = 148;
const PARAM_VALUE: u32 = 22;
const VERSION_ANSWER_MS: u64 = 1_000;
const VERSION_ATTEMPTS: u32 = 4;

/// A question for the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ask<'a> {
    Version,
    Parameter(&'a str),
}

/// What the parameters say of the vehicle and its model.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Finding {
    /// The autopilot's parameters are of a kind that nobody here reads.
    Unread,
    /// No parameter was told.
    Untold,
    /// They describe no multirotor that can be modelled.
    Unmodelled(AirframeError),
    /// They agree with the model in all but these.
    Read { airframe: Airframe, differences: Vec<String> },
}

/// The conversation about one vehicle's nature.
#[derive(Debug)]
pub(super) struct Pairing {
    /// MAV_AUTOPILOT.
    mav_autopilot: u8,
    model: Option<Arc<Vehicle>>,
    version: Option<AUTOPILOT_VERSION_DATA>,
    version_attempts: u32,
    version_asked_ms: u64,
    reader: ParameterReader,
    values: BTreeMap<String, f64>,
    finding: Option<Finding>,
}

impl Pairing {
    pub(super) fn new(mav_autopilot: u8, model: Option<Arc<Vehicle>>) -> Self {
        let mut pairing = Self {
            mav_autopilot,
            model,
            version: None,
            version_attempts: 0,
            version_asked_ms: 0,
            reader: ParameterReader::default(),
            values: BTreeMap::new(),
            finding: None,
        };
        pairing.want();
        pairing
    }

    /// The vehicle has rebooted, perhaps with other parameters.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.mav_autopilot, self.model.take());
    }

    /// Puts all parameters on the list that the airframe needs by what is known now.
    fn want(&mut self) {
        if let Some(autopilot) = Autopilot::from_mav(self.mav_autopilot) {
            let values = &self.values;
            self.reader.add(airframe::parameter_names(autopilot, &|name| values.get(name).copied()));
        }
    }

    /// Takes in a frame. True if it is a parameter that we wanted.
    pub(super) fn heard(&mut self, frame: FrameRef<'_>) -> bool {
        match frame.message_id() {
            AUTOPILOT_VERSION => {
                self.version = decode(frame);
                false
            }
            PARAM_VALUE => {
                let capabilities = self.version.as_ref().map(|v| v.capabilities.bits());
                let encoding = Encoding::of(self.mav_autopilot, capabilities);
                let Some(parameter) = ParamValue::read(frame, encoding) else { return false };
                let wanted = self.reader.heard(parameter.name);
                if wanted {
                    self.values.insert(parameter.name.to_owned(), parameter.value);
                }
                wanted
            }
            _ => false,
        }
    }

    /// What is to be asked at `now_ms`. The finding comes once, when there is nothing more to ask.
    pub(super) fn poll(&mut self, now_ms: u64) -> (Option<Ask<'_>>, Option<&Finding>) {
        if self.version.is_none() && self.version_attempts <= VERSION_ATTEMPTS {
            if self.version_attempts > 0 && now_ms.saturating_sub(self.version_asked_ms) < VERSION_ANSWER_MS {
                return (None, None);
            }
            self.version_attempts += 1;
            self.version_asked_ms = now_ms;
            if self.version_attempts <= VERSION_ATTEMPTS {
                return (Some(Ask::Version), None);
            }
        }
        if self.finding.is_some() {
            return (None, None);
        }
        if self.reader.finished() {
            self.want();
        }
        if self.reader.finished() {
            self.finding = Some(self.find());
            return (None, self.finding.as_ref());
        }
        (self.reader.poll(now_ms).map(Ask::Parameter), None)
    }

    fn find(&self) -> Finding {
        let Some(autopilot) = Autopilot::from_mav(self.mav_autopilot) else { return Finding::Unread };
        if self.values.is_empty() {
            return Finding::Untold;
        }
        match airframe::from_parameters(autopilot, &|name| self.values.get(name).copied()) {
            Ok(airframe) => {
                let differences = self.model.iter().flat_map(|model| airframe::differences(&airframe, model)).collect();
                Finding::Read { airframe, differences }
            }
            Err(error) => Finding::Unmodelled(error),
        }
    }

    /// The finding, once there is one.
    pub(super) fn finding(&self) -> Option<&Finding> {
        self.finding.as_ref()
    }

    /// The finding as the operator is told it.
    pub(super) fn words(&self) -> Vec<Word> {
        let name = self.model.as_deref().map_or("none", |model| model.name.as_str());
        match &self.finding {
            None | Some(Finding::Unread) => Vec::new(),
            Some(Finding::Untold) => {
                vec![Word::Info("the vehicle tells no parameters: the model is not compared with it".to_owned())]
            }
            Some(Finding::Unmodelled(error)) => vec![Word::Warning(error.to_string())],
            Some(Finding::Read { .. }) if self.model.is_none() => {
                vec![Word::Info("no model is given: nothing is compared with the vehicle's parameters".to_owned())]
            }
            Some(Finding::Read { differences, .. }) if differences.is_empty() => {
                vec![Word::Info(format!("`{name}` agrees with the vehicle's parameters"))]
            }
            Some(Finding::Read { differences, .. }) => {
                let told = |d: &String| {
                    Word::Warning(format!("`{name}` is no model of this vehicle: {d}; see `mavobserver identify`"))
                };
                differences.iter().map(told).collect()
            }
        }
    }

    /// How many parameters are known, and of how many.
    pub(super) fn progress(&self) -> (usize, usize) {
        self.reader.progress()
    }

    /// Which firmware it is, as far as it is known.
    pub(super) fn firmware(&self) -> String {
        let name = Autopilot::from_mav(self.mav_autopilot).map_or("another autopilot", Autopilot::name);
        match &self.version {
            Some(version) => {
                let [_, patch, minor, major] = version.flight_sw_version.to_le_bytes();
                format!("{name} {major}.{minor}.{patch}")
            }
            None if self.version_attempts > VERSION_ATTEMPTS => format!("{name}, version not told"),
            None => name.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::resolve;
    use crate::wire::Encoder;
    use crate::wire::dialect::ardupilotmega::{MavParamType, MavProtocolCapability, PARAM_VALUE_DATA};

    /// A vehicle with these parameters; gives what it was asked for and what was found.
    fn paired(
        autopilot: u8,
        model: &str,
        tells_version: bool,
        parameters: &[(&str, f64)],
    ) -> (Vec<String>, Finding, String) {
        let mut pairing = Pairing::new(autopilot, Some(Arc::new(resolve(model).unwrap())));
        let mut encoder = Encoder::new(1, 1);
        let bytewise = autopilot == 12;
        let (mut asked, mut found) = (Vec::new(), None);
        for now_ms in (0..120_000).step_by(50) {
            let (ask, finding) = pairing.poll(now_ms);
            if let Some(finding) = finding {
                assert_eq!(found.replace(finding.clone()), None, "told once");
            }
            let answer = match ask {
                Some(Ask::Version) if tells_version => {
                    let capabilities = if bytewise {
                        MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
                    } else {
                        MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
                    };
                    let flight_sw_version = 0x0406_03FF;
                    encoder.encode(&AUTOPILOT_VERSION_DATA { capabilities, flight_sw_version, ..Default::default() })
                }
                Some(Ask::Parameter(name)) => {
                    asked.push(name.to_owned());
                    let Some(&(_, value)) = parameters.iter().find(|(n, _)| *n == name) else { continue };
                    let whole = value.fract() == 0.0;
                    let param_value =
                        if whole && bytewise { f32::from_bits(value as i32 as u32) } else { value as f32 };
                    encoder.encode(&PARAM_VALUE_DATA {
                        param_id: name.into(),
                        param_value,
                        param_type: if whole {
                            MavParamType::MAV_PARAM_TYPE_INT32
                        } else {
                            MavParamType::MAV_PARAM_TYPE_REAL32
                        },
                        ..Default::default()
                    })
                }
                _ => continue,
            };
            pairing.heard(answer.as_ref());
        }
        (asked, found.unwrap(), pairing.firmware())
    }

    #[test]
    fn ardupilots_airframe_is_read_and_compared() {
        let parameters =
            [("FRAME_CLASS", 1.0), ("FRAME_TYPE", 1.0), ("MOT_THST_EXPO", 0.65), ("SERVO1_FUNCTION", 33.0)];
        let (asked, finding, firmware) = paired(3, "arducopter-sitl", true, &parameters);
        assert!(asked.len() > 20 && asked[0] == "FRAME_CLASS");
        assert_eq!(firmware, "ArduPilot 4.6.3");
        let Finding::Read { airframe, differences } = finding else { panic!("{finding:?}") };
        assert_eq!((airframe.places.len(), differences), (4, vec![]));

        let (_, finding, _) = paired(3, "arducopter-sitl", true, &[("FRAME_CLASS", 2.0)]);
        assert!(matches!(&finding, Finding::Read { differences, .. } if differences[0].contains("6 rotors")));
        let (_, finding, _) = paired(3, "arducopter-sitl", true, &[("FRAME_CLASS", 6.0)]);
        assert_eq!(finding, Finding::Unmodelled(AirframeError::FrameClass(6)));
    }

    #[test]
    fn px4s_rotors_are_asked_for_once_their_number_is_known() {
        let mut parameters = vec![("CA_AIRFRAME", 0.0), ("CA_ROTOR_COUNT", 4.0)];
        let (d, names) = (0.1414, ["CA_ROTOR0", "CA_ROTOR1", "CA_ROTOR2", "CA_ROTOR3"]);
        let named: Vec<_> = names.iter().flat_map(|n| ["PX", "PY", "KM"].map(|f| format!("{n}_{f}"))).collect();
        let values = [d, d, 0.05, -d, -d, 0.05, d, -d, -0.05, -d, d, -0.05];
        parameters.extend(named.iter().map(String::as_str).zip(values));
        let (asked, finding, _) = paired(12, "px4-sih", true, &parameters);
        assert!(asked.contains(&"CA_ROTOR3_KM".to_owned()) && !asked.iter().any(|n| n.contains("ROTOR4")), "{asked:?}");
        assert!(matches!(&finding, Finding::Read { differences, .. } if differences.is_empty()), "{finding:?}");
    }

    #[test]
    fn silence_ends_the_asking() {
        let (asked, finding, firmware) = paired(3, "arducopter-sitl", false, &[]);
        assert_eq!((asked.len(), finding), (8, Finding::Untold));
        assert_eq!(firmware, "ArduPilot, version not told");
        let (asked, finding, _) = paired(4, "arducopter-sitl", true, &[]);
        assert_eq!((asked.len(), finding), (0, Finding::Unread));
    }
}
