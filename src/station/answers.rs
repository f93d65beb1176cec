// Superseded by newer messages, and what stations still send and ask for.
#![allow(deprecated)]

use super::parameters::{self, Parameter, StationSettings};
use crate::outputs::{OutputSettings, Rate, Rates};
use crate::pipeline::Tuning;
use crate::wire::dialect::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, COMPONENT_INFORMATION_BASIC_DATA, MESSAGE_INTERVAL_DATA, MavCmd,
    MavProtocolCapability, MavResult, PARAM_VALUE_DATA, PING_DATA,
};
use crate::wire::{Check, FrameRef};
use mavlink_core::types::CharArray;

const PING: u32 = 4;
const PARAM_REQUEST_READ: u32 = 20;
const PARAM_REQUEST_LIST: u32 = 21;
const PARAM_SET: u32 = 23;
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;

const GET_MESSAGE_INTERVAL: u16 = 510;
const SET_MESSAGE_INTERVAL: u16 = 511;
const REQUEST_MESSAGE: u16 = 512;

const AUTOPILOT_VERSION: u32 = 148;
const MESSAGE_INTERVAL: u32 = 244;
const COMPONENT_INFORMATION_BASIC: u32 = 396;

/// A message for whoever asked.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    Parameter(PARAM_VALUE_DATA),
    Ack(COMMAND_ACK_DATA),
    Interval(MESSAGE_INTERVAL_DATA),
    Information(COMPONENT_INFORMATION_BASIC_DATA),
    Version(AUTOPILOT_VERSION_DATA),
    Ping(PING_DATA),
}

/// What the question changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// A parameter: for every link, and to be kept on disk.
    Parameter(&'static str),
    /// The interval of one message, on this link, until it ends.
    Interval(u32),
}

/// Answers a frame that is addressed to us: to `component` of `system`, or to every component.
///
/// `settings` are those of the link by which it came. `tune` makes the observers run in another way, or refuses and
/// leaves them as they are. Frames that ask for nothing of ours give no answer.
pub fn answer(
    frame: FrameRef<'_>,
    (system, component): (u8, u8),
    settings: &mut StationSettings,
    boot_ms: u32,
    tune: &mut dyn FnMut(&Tuning) -> bool,
    say: &mut dyn FnMut(Answer),
) -> Option<Change> {
    if frame.check() != Check::Verified {
        return None;
    }
    let (to_system, to_component) = frame.target()?;
    let ours = (to_system == system || to_system == 0) && (to_component == component || to_component == 0);
    if !ours {
        return None;
    }
    let f = frame.fields();
    match frame.message_id() {
        // a ping to nobody in particular is a question, one with a target an answer
        PING if to_system == 0 && to_component == 0 => {
            say(Answer::Ping(PING_DATA {
                time_usec: f.u64(0),
                seq: f.u32(8),
                target_system: frame.system_id(),
                target_component: frame.component_id(),
            }));
            None
        }
        PARAM_REQUEST_LIST => {
            for (index, parameter) in parameters::all().iter().enumerate() {
                say(value(index, parameter, settings));
            }
            None
        }
        PARAM_REQUEST_READ => {
            let found = match f.i16(0) {
                index if index >= 0 => {
                    let index = usize::from(index.unsigned_abs());
                    parameters::all().get(index).map(|p| (index, p))
                }
                _ => f.text(4, 16).and_then(parameters::find),
            };
            if let Some((index, parameter)) = found {
                say(value(index, parameter, settings));
            }
            None
        }
        PARAM_SET => {
            let (index, parameter) = f.text(6, 16).and_then(parameters::find)?;
            let changed = set(parameter, settings, f.f32(0), tune);
            say(value(index, parameter, settings));
            changed.then_some(Change::Parameter(&parameter.name))
        }
        // both have the first two parameters and the command at the same place
        COMMAND_LONG | COMMAND_INT => command(
            frame,
            f.u16(28),
            [f.f32(0), f.f32(4)],
            to_component == component,
            &mut settings.outputs,
            boot_ms,
            say,
        ),
        _ => None,
    }
}

/// Sets a parameter; false if that changed nothing, or the observers cannot run so.
fn set(
    parameter: &Parameter,
    settings: &mut StationSettings,
    wanted: f32,
    tune: &mut dyn FnMut(&Tuning) -> bool,
) -> bool {
    // as the wire tells it: a station that writes back what it read changes nothing
    let told = |settings: &StationSettings| parameter.get(settings) as f32;
    if told(settings) == wanted {
        return false;
    }
    let before = settings.clone();
    parameter.set(settings, wanted.into());
    if settings.tuning != before.tuning && !tune(&settings.tuning) {
        *settings = before;
        return false;
    }
    *settings != before
}

fn value(index: usize, parameter: &Parameter, settings: &StationSettings) -> Answer {
    Answer::Parameter(PARAM_VALUE_DATA {
        param_value: parameter.get(settings) as f32,
        param_count: parameters::all().len() as u16,
        param_index: index as u16,
        param_id: characters(&parameter.name),
        param_type: parameter.kind,
    })
}

fn characters<const N: usize>(text: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    bytes.iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from);
    CharArray::new(bytes)
}

/// Commands. Only those for us alone are refused aloud: what is said to all components is mostly meant for another.
fn command(
    frame: FrameRef<'_>,
    command: u16,
    [first, second]: [f32; 2],
    for_us_alone: bool,
    settings: &mut OutputSettings,
    boot_ms: u32,
    say: &mut dyn FnMut(Answer),
) -> Option<Change> {
    let known = match command {
        GET_MESSAGE_INTERVAL => MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL,
        SET_MESSAGE_INTERVAL => MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        REQUEST_MESSAGE => MavCmd::MAV_CMD_REQUEST_MESSAGE,
        other => {
            if for_us_alone && let Some(command) = num_traits::FromPrimitive::from_u16(other) {
                say(ack(frame, command, MavResult::MAV_RESULT_UNSUPPORTED));
            }
            return None;
        }
    };
    let id = if first >= 0.0 { first as u32 } else { u32::MAX };
    let mut change = None;
    let result = match command {
        SET_MESSAGE_INTERVAL => match rate_of(&mut settings.rates, id) {
            Some(rate) => {
                *rate = wanted(second, id);
                change = Some(Change::Interval(id));
                MavResult::MAV_RESULT_ACCEPTED
            }
            None => MavResult::MAV_RESULT_DENIED,
        },
        _ => {
            let answer = match (command, id) {
                (GET_MESSAGE_INTERVAL, id) => interval(settings, id),
                (_, MESSAGE_INTERVAL) => interval(settings, second.max(0.0) as u32),
                (_, COMPONENT_INFORMATION_BASIC) => Some(information(boot_ms)),
                (_, AUTOPILOT_VERSION) => Some(version()),
                _ => None,
            };
            match answer {
                Some(answer) => {
                    say(answer);
                    MavResult::MAV_RESULT_ACCEPTED
                }
                None => MavResult::MAV_RESULT_DENIED,
            }
        }
    };
    if for_us_alone || result == MavResult::MAV_RESULT_ACCEPTED {
        say(ack(frame, known, result));
    }
    change
}

fn ack(frame: FrameRef<'_>, command: MavCmd, result: MavResult) -> Answer {
    Answer::Ack(COMMAND_ACK_DATA {
        command,
        result,
        target_system: frame.system_id(),
        target_component: frame.component_id(),
        ..COMMAND_ACK_DATA::DEFAULT
    })
}

/// The rate of one of our messages.
fn rate_of(rates: &mut Rates, id: u32) -> Option<&mut Rate> {
    Some(match id {
        168 => &mut rates.wind,
        231 => &mut rates.wind_cov,
        250 => &mut rates.debug_vect,
        251 => &mut rates.named_values,
        350 => &mut rates.wrench_array,
        44100 => &mut rates.wrench_estimate,
        44101 => &mut rates.wind_estimate,
        44102 => &mut rates.state_bounds,
        44103 => &mut rates.fault_status,
        44104 => &mut rates.observer_status,
        _ => return None,
    })
}

/// The rate that an interval in µs stands for: −1 is off, 0 the default.
fn wanted(interval_us: f32, id: u32) -> Rate {
    if interval_us < 0.0 || !interval_us.is_finite() {
        Rate::OFF
    } else if interval_us == 0.0 {
        rate_of(&mut Rates::default(), id).map_or(Rate::OFF, |rate| *rate)
    } else {
        Rate::hz(1e6 / f64::from(interval_us))
    }
}

/// The interval of one of our messages: −1 is off; 0, as the standard has it, that there is no such message.
fn interval(settings: &OutputSettings, id: u32) -> Option<Answer> {
    let mut rates = settings.rates;
    let interval_us = rate_of(&mut rates, id).map_or(0, |rate| match rate.as_hz() {
        hz if hz > 0.0 => (1e6 / hz).round().clamp(1.0, f64::from(i32::MAX)) as i32,
        _ => -1,
    });
    Some(Answer::Interval(MESSAGE_INTERVAL_DATA { interval_us, message_id: u16::try_from(id).ok()? }))
}

fn capabilities() -> MavProtocolCapability {
    MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
}

fn information(boot_ms: u32) -> Answer {
    Answer::Information(COMPONENT_INFORMATION_BASIC_DATA {
        capabilities: capabilities(),
        time_boot_ms: boot_ms,
        vendor_name: characters("mavobserver"),
        model_name: characters("wrench, wind and fault observer"),
        software_version: characters(env!("CARGO_PKG_VERSION")),
        ..COMPONENT_INFORMATION_BASIC_DATA::DEFAULT
    })
}

fn version() -> Answer {
    let part = |text: &str| text.parse::<u32>().unwrap_or_default() & 0xFF;
    let parts = [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")];
    let flight_sw_version = parts.iter().fold(0, |version, p| version << 8 | part(p)) << 8;
    Answer::Version(AUTOPILOT_VERSION_DATA {
        capabilities: capabilities(),
        flight_sw_version,
        ..AUTOPILOT_VERSION_DATA::DEFAULT
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::{
        COMMAND_LONG_DATA, MavParamType, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA,
    };
    use crate::wire::{Encoder, FrameBuf};

    const US: (u8, u8) = (1, 191);

    fn asked(frame: &FrameBuf, settings: &mut StationSettings) -> (Vec<Answer>, Option<Change>) {
        let mut answers = Vec::new();
        // whoever tunes refuses a rate of 7
        let tune = &mut |t: &Tuning| t.faults.false_alarms_per_hour != 7.0;
        let change = answer(frame.as_ref(), US, settings, 1_000, tune, &mut |a| answers.push(a));
        (answers, change)
    }

    fn station() -> Encoder {
        Encoder::new(255, 190)
    }

    fn commanded(command: MavCmd, param1: f32, param2: f32, target_component: u8) -> FrameBuf {
        let target_system = 1;
        station().encode(&COMMAND_LONG_DATA {
            command,
            param1,
            param2,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }

    #[test]
    fn parameters_are_listed_read_and_set() {
        let mut settings = StationSettings::default();
        let list = station().encode(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 191 });
        let (answers, _) = asked(&list, &mut settings);
        assert_eq!(answers.len(), parameters::all().len());

        let set = PARAM_SET_DATA {
            param_value: 4.0,
            target_system: 1,
            target_component: 191,
            param_id: characters("OUT_WIND_HZ"),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        };
        let (answers, change) = asked(&station().encode(&set), &mut settings);
        assert!(matches!(&answers[..], [Answer::Parameter(p)] if p.param_value == 4.0), "{answers:?}");
        assert_eq!(change, Some(Change::Parameter("OUT_WIND_HZ")));
        assert_eq!(settings.outputs.rates.wind_estimate, Rate::hz(4.0));

        let by_index = PARAM_REQUEST_READ_DATA {
            param_index: 8,
            target_system: 1,
            target_component: 191,
            ..PARAM_REQUEST_READ_DATA::DEFAULT
        };
        let by_name = PARAM_REQUEST_READ_DATA { param_index: -1, param_id: characters("OUT_WIND_HZ"), ..by_index };
        for read in [by_index, by_name] {
            let (again, _) = asked(&station().encode(&read), &mut settings);
            assert_eq!(again, answers);
        }
    }

    #[test]
    fn what_the_observers_refuse_stays_as_it_was() {
        let mut settings = StationSettings::default();
        let mut set = |param_value| {
            let set = PARAM_SET_DATA {
                param_value,
                target_system: 1,
                target_component: 191,
                param_id: characters("FLT_ALARMS_HOUR"),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            };
            let (answers, change) = asked(&station().encode(&set), &mut settings);
            match &answers[..] {
                [Answer::Parameter(p)] => (p.param_value, change),
                other => panic!("{other:?}"),
            }
        };
        let changed = Some(Change::Parameter("FLT_ALARMS_HOUR"));
        assert_eq!(set(0.004), (0.004, None), "that is what it was");
        assert_eq!(set(0.5), (0.5, changed));
        assert_eq!(set(7.0), (0.5, None), "refused");
        assert_eq!(set(99.0), (10.0, changed), "the most there is");
    }

    #[test]
    fn what_is_for_others_is_left_to_them() {
        let mut settings = StationSettings::default();
        for (target_system, target_component) in [(1, 1), (2, 191)] {
            let list = station().encode(&PARAM_REQUEST_LIST_DATA { target_system, target_component });
            assert_eq!(asked(&list, &mut settings), (vec![], None));
        }
        // an arming command to everybody is not ours to refuse
        let arm = commanded(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0, 0);
        assert_eq!(asked(&arm, &mut settings), (vec![], None));
        let arm = commanded(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0, 191);
        let (answers, _) = asked(&arm, &mut settings);
        assert!(matches!(&answers[..], [Answer::Ack(a)] if a.result == MavResult::MAV_RESULT_UNSUPPORTED));
    }

    #[test]
    fn intervals_are_set_told_and_reset() {
        let mut settings = StationSettings::default();
        let set = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
        let (answers, change) = asked(&commanded(set, 44101.0, 50_000.0, 191), &mut settings);
        assert_eq!(change, Some(Change::Interval(44101)));
        assert!(
            matches!(&answers[..], [Answer::Ack(a)] if a.result == MavResult::MAV_RESULT_ACCEPTED && a.target_system == 255)
        );
        let told = |settings: &mut StationSettings| match &asked(
            &commanded(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, 44101.0, 0.0, 191),
            settings,
        )
        .0[..]
        {
            [Answer::Interval(i), Answer::Ack(_)] => i.interval_us,
            other => panic!("{other:?}"),
        };
        assert_eq!(told(&mut settings), 50_000);
        asked(&commanded(set, 44101.0, -1.0, 191), &mut settings);
        assert_eq!(told(&mut settings), -1);
        asked(&commanded(set, 44101.0, 0.0, 191), &mut settings);
        assert_eq!(told(&mut settings), 100_000);
        let (answers, change) = asked(&commanded(set, 30.0, 50_000.0, 191), &mut settings);
        assert!(
            change.is_none() && matches!(&answers[..], [Answer::Ack(a)] if a.result == MavResult::MAV_RESULT_DENIED)
        );
    }

    #[test]
    fn who_we_are_is_told() {
        let mut settings = StationSettings::default();
        for id in [COMPONENT_INFORMATION_BASIC, AUTOPILOT_VERSION] {
            let (answers, _) = asked(&commanded(MavCmd::MAV_CMD_REQUEST_MESSAGE, id as f32, 0.0, 191), &mut settings);
            assert!(matches!(&answers[..], [_, Answer::Ack(a)] if a.result == MavResult::MAV_RESULT_ACCEPTED), "{id}");
        }
        let ping = station().encode(&PING_DATA { time_usec: 5, seq: 7, target_system: 0, target_component: 0 });
        let (answers, _) = asked(&ping, &mut settings);
        assert!(
            matches!(&answers[..], [Answer::Ping(p)] if (p.time_usec, p.seq, p.target_system, p.target_component) == (5, 7, 255, 190))
        );
    }
}
