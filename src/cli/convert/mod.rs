//! `mavobserver convert`: telemetry logs to MCAP, and back.

mod inputs;
mod job;

use super::{Failure, print};
use crate::record::Encoding;
use indicatif::{ProgressBar, ProgressStyle};
use job::{Job, Outcome};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

const EXAMPLES: &str = "Examples:
  mavobserver convert flight.tlog                     # flight.mcap beside it
  mavobserver convert flight.tlog -o recordings/flight.mcap
  mavobserver convert logs/ -o recordings/            # a whole folder, all cores
  mavobserver convert 'logs/2026-*.tlog' --json
  mavobserver convert flight.mcap -o again.tlog       # byte for byte the log it was made from";

/// Turn telemetry logs into MCAP recordings, and recordings back into telemetry logs
///
/// Reads .tlog files, MAVLink streams without time stamps (.rlog, .raw), PX4's ULog, ArduPilot's dataflash logs (.bin), and
/// MCAP; what a file is, its content tells. The
/// recordings open in Foxglove, PlotJuggler and rerun: protobuf with units and enum names, one topic for each message.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ConvertArgs {
    /// Files, folders (searched with all below them) or patterns with * and ?
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// A file, for a single input, or a folder; otherwise results go beside the inputs
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Overwrite files that exist
    #[arg(long)]
    pub force: bool,
    /// How messages are written; JSON is larger and cannot be turned back into a log
    #[arg(long, value_enum, default_value_t)]
    pub encoding: EncodingArg,
    /// Files converted at once; all cores if not given
    #[arg(short, long, value_name = "N")]
    pub jobs: Option<usize>,
    /// Print what was done as one JSON object
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Clone, Copy, Default, clap::ValueEnum)]
pub enum EncodingArg {
    #[default]
    Protobuf,
    Json,
}

impl From<EncodingArg> for Encoding {
    fn from(arg: EncodingArg) -> Self {
        match arg {
            EncodingArg::Protobuf => Self::Protobuf,
            EncodingArg::Json => Self::Json,
        }
    }
}

/// The logs in a folder and below, by name.
pub(super) fn logs_below(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    Ok(inputs::find(&[folder.to_owned()])?.into_iter().map(|input| input.path).collect())
}

pub fn run(args: &ConvertArgs) -> Result<(), Failure> {
    let inputs = inputs::find(&args.inputs)?;
    let mut jobs = job::plan(&inputs, args.output.as_deref())?;
    // the largest first, so that no core is left alone with it at the end
    jobs.sort_by_key(|job| std::cmp::Reverse(job.bytes));
    let bar = progress(jobs.iter().map(|job| job.bytes).sum());
    let outcomes = convert_all(&jobs, args, &bar);
    bar.finish_and_clear();
    let failed = outcomes.iter().filter(|o| o.result.is_err()).count();
    if args.json {
        let rows: Vec<_> = outcomes.iter().map(Outcome::json).collect();
        print(&format!("{:#}", serde_json::json!({ "files": rows, "failed": failed })))?;
    }
    match failed {
        0 => Ok(()),
        n => Err(Failure::Failed(format!("{n} of {} files could not be converted", outcomes.len()))),
    }
}

/// Converts on all cores; each summary line is printed as its file is done.
fn convert_all(jobs: &[Job], args: &ConvertArgs, bar: &ProgressBar) -> Vec<Outcome> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let workers = args.jobs.unwrap_or(cores).clamp(1, jobs.len().max(1));
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(Vec::with_capacity(jobs.len()));
    let work = || {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let outcome = job.run(args.encoding.into(), args.force, &mut |n| bar.inc(n));
            bar.suspend(|| outcome.tell(args.json));
            if let Ok(mut all) = outcomes.lock() {
                all.push(outcome);
            }
        }
    };
    thread::scope(|scope| {
        (1..workers).for_each(|_| drop(scope.spawn(work)));
        work();
    });
    // a worker that panicked has told so; the others' outcomes count
    outcomes.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// On standard error, and only if that is a terminal.
fn progress(bytes: u64) -> ProgressBar {
    let bar = ProgressBar::new(bytes);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes} {bytes_per_sec} {eta}") {
        bar.set_style(style);
    }
    bar
}
