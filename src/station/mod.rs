//! What we answer when we are asked: our own parameters, message intervals, single messages, pings.
//!
//! A ground station or a companion program treats us like any component: it lists and sets our parameters
//! (PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET), asks how often a message leaves and changes that
//! (MAV_CMD_SET_MESSAGE_INTERVAL, MAV_CMD_GET_MESSAGE_INTERVAL), asks who we are (MAV_CMD_REQUEST_MESSAGE for
//! COMPONENT_INFORMATION_BASIC, AUTOPILOT_VERSION, MESSAGE_INTERVAL) and how far away (PING).
//!
//! In: one frame and the settings that our parameters stand for. Out: [`Answer`]s for its sender, and a [`Change`] of
//! the settings. No I/O and no clock. Imports `wire`, `observers`, `faults`, `pipeline` and `outputs` only.

mod answers;
mod file;
mod parameters;

pub use answers::{Answer, Change, answer};
pub use file::{ParameterFile, ParameterFileError};
pub use parameters::{Parameter, StationSettings, all as parameters, find as parameter};
