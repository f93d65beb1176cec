//! `mavobserver recover`: what is left of a damaged log.

use super::{Failure, print};
use crate::record::{FileKind, NewFile, RecordError, Recovered, recover_log, recover_mcap};
use serde_json::json;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  mavobserver recover damaged.mcap                 # damaged.recovered.mcap beside it
  mavobserver recover damaged.tlog -o mended.tlog
  mavobserver recover damaged.mcap --json | jq .lost";

/// Losses that are listed one by one.
const MOST_LISTED: usize = 20;

/// Make a readable file of a damaged telemetry log or recording, and say what was lost
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct RecoverArgs {
    /// The damaged file (.tlog, .rlog, .mcap)
    pub input: PathBuf,
    /// The new file; NAME.recovered.EXTENSION beside the damaged one if not given
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Overwrite a file that exists
    #[arg(long)]
    pub force: bool,
    /// Print what was saved and lost as one JSON object
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &RecoverArgs) -> Result<(), Failure> {
    let output = args.output.clone().unwrap_or_else(|| beside(&args.input));
    let recovered = recover(&args.input, &output, args.force)
        .map_err(|e| Failure::Failed(format!("{}: {e}", args.input.display())))?;
    print(&if args.json { json_of(&output, &recovered) } else { text(&output, &recovered) })
}

fn beside(input: &Path) -> PathBuf {
    let extension = input.extension().map_or_else(String::new, |e| e.to_string_lossy().into_owned());
    input.with_extension(format!("recovered.{extension}"))
}

fn recover(input: &Path, output: &Path, force: bool) -> Result<Recovered, RecordError> {
    let kind = FileKind::of(input)?;
    // a recording whose very first bytes are damaged is still one by its name
    let is_mcap = kind == FileKind::Mcap || input.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    if matches!(kind, FileKind::Ulog | FileKind::Dataflash) {
        let advice = "this log's readers step over damage by themselves: use `convert` or `replay`";
        return Err(RecordError::Unsupported(advice.to_owned()));
    }
    let file = NewFile::create(output, force)?;
    let sink = BufWriter::new(file.file()?);
    let (recovered, mut sink) = if is_mcap { recover_mcap(input, sink)? } else { recover_log(input, sink)? };
    sink.flush().map_err(RecordError::Write)?;
    file.commit()?;
    Ok(recovered)
}

fn text(output: &Path, r: &Recovered) -> String {
    use std::fmt::Write;
    let mut s = format!("{}: {} messages saved", output.display(), r.messages);
    if r.lost.is_empty() {
        s += if r.index_rebuilt { "; only the index was missing" } else { "; nothing was damaged" };
        return s;
    }
    let _ = write!(s, ", {} bytes lost in {} places:", r.lost_bytes(), r.lost.len());
    for lost in r.lost.iter().take(MOST_LISTED) {
        let _ = write!(s, "\n  bytes {}–{}: {}", lost.bytes.start, lost.bytes.end, lost.what);
    }
    if r.lost.len() > MOST_LISTED {
        let _ = write!(s, "\n  … and {} more; --json lists all", r.lost.len() - MOST_LISTED);
    }
    s
}

fn json_of(output: &Path, r: &Recovered) -> String {
    let lost = r.lost.iter().map(|l| json!({ "from": l.bytes.start, "to": l.bytes.end, "what": l.what }));
    let object = json!({
        "output": output, "messages": r.messages, "extras": r.extras, "lost_bytes": r.lost_bytes(),
        "index_rebuilt": r.index_rebuilt, "lost": lost.collect::<Vec<_>>(),
    });
    format!("{object:#}")
}
