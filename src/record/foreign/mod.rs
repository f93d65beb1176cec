//! Logs that autopilots write themselves: PX4's ULog and ArduPilot's dataflash log.
//!
//! Both describe their own messages, which become topics of a recording as they are. For the observers the messages
//! that matter are told as MAVLink frames, at the full rate of the log, so everything behind works as with telemetry.

mod ardupilot;
mod dataflash;
mod px4;
mod row;
mod said;
mod ulog;

pub use row::Row;

use super::error::RecordError;
use super::files::FileKind;
use crate::wire::FrameRef;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Hears of a log's rows, in order, and may end the reading.
pub type RowSink<'a> = dyn FnMut(Row<'_>) -> ControlFlow<()> + 'a;

/// Reads an autopilot's own log row by row. A damaged or cut-off log gives what can be read; `false` says that something
/// is missing at its end.
///
/// # Errors
/// The file cannot be read, is no such log, or is damaged in a way that its parser does not survive.
pub fn read_rows(path: &Path, kind: FileKind, sink: &mut RowSink<'_>) -> Result<bool, RecordError> {
    // The parsers come from elsewhere and are not free of panics on damaged input. What they and the sink hold is dropped
    // with this call's error.
    let read = catch_unwind(AssertUnwindSafe(|| match kind {
        FileKind::Ulog => ulog::read(path, sink),
        _ => dataflash::read(path, sink),
    }));
    read.unwrap_or_else(|_| Err(RecordError::Damaged("its parser gave up".to_owned())))
}

/// What to add to boot time to get UNIX time, µs, from the first GNSS fix that tells the time.
///
/// # Errors
/// As [`read_rows`].
pub fn unix_minus_boot_us(path: &Path, kind: FileKind) -> Result<Option<u64>, RecordError> {
    let mut offset = None;
    read_rows(path, kind, &mut |row| {
        offset = row.unix_us().and_then(|unix| unix.checked_sub(row.boot_us()?));
        if offset.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    Ok(offset)
}

/// Reads an autopilot's own log as MAVLink frames with receive times, µs since 1970 (since boot where the log does not
/// know the date).
///
/// # Errors
/// As [`read_rows`].
pub fn read_frames(
    path: &Path,
    kind: FileKind,
    sink: &mut dyn FnMut(u64, FrameRef<'_>) -> ControlFlow<()>,
) -> Result<bool, RecordError> {
    let offset = unix_minus_boot_us(path, kind)?.unwrap_or(0);
    let mut px4 = px4::Px4::default();
    let mut ardupilot = ardupilot::ArduPilot::default();
    read_rows(path, kind, &mut |row| {
        let Some(boot_us) = row.boot_us() else { return ControlFlow::Continue(()) };
        let mut flow = ControlFlow::Continue(());
        let mut give = |frame: FrameRef<'_>| {
            if flow.is_continue() {
                flow = sink(boot_us.saturating_add(offset), frame);
            }
        };
        match kind {
            FileKind::Ulog => px4.row(&row, boot_us, &mut give),
            _ => ardupilot.row(&row, boot_us, &mut give),
        }
        flow
    })
}
