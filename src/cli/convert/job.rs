use super::inputs::Input;
use crate::cli::Failure;
use crate::record::{
    Converted, Encoding, FileKind, NewFile, RecordError, autopilot_log_to_mcap, log_to_mcap, mcap_to_log,
};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Buffer before the disk.
const BUFFER: usize = 256 << 10;

/// One file to convert.
#[derive(Debug)]
pub(super) struct Job {
    input: PathBuf,
    output: PathBuf,
    kind: Result<FileKind, String>,
    pub bytes: u64,
}

pub(super) struct Outcome {
    input: PathBuf,
    output: PathBuf,
    seconds: f64,
    bytes: u64,
    pub result: Result<(Converted, u64), RecordError>,
}

/// Decides where each result goes. No two may go to one place.
pub(super) fn plan(inputs: &[Input], output: Option<&Path>) -> Result<Vec<Job>, Failure> {
    let is_folder = |o: &Path| o.is_dir() || o.as_os_str().to_string_lossy().ends_with('/');
    let folder = output.filter(|o| inputs.len() > 1 || inputs.iter().any(|i| i.below.is_some()) || is_folder(o));
    if let Some(file) = folder.filter(|f| f.is_file()) {
        return Err(Failure::Usage(format!("{} is a file, and there are several logs", file.display())));
    }
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut jobs = Vec::with_capacity(inputs.len());
    for input in inputs {
        let kind = FileKind::of(&input.path).map_err(|e| e.to_string());
        let extension = match kind {
            Ok(FileKind::Mcap) => "tlog",
            _ => "mcap",
        };
        let to = match (folder, output) {
            (Some(folder), _) => {
                // the tree below a folder is kept
                let name = input.below.as_ref().and_then(|root| input.path.strip_prefix(root).ok());
                folder.join(name.unwrap_or(Path::new(input.path.file_name().unwrap_or_default())))
            }
            (None, Some(file)) => file.to_owned(),
            (None, None) => input.path.clone(),
        };
        let named = if output.is_some() && folder.is_none() { to.clone() } else { to.with_extension(extension) };
        // flight.tlog and flight.rlog beside each other: the second keeps its whole name
        let to = if taken.contains_key(&named) { with_suffix(&to, extension) } else { named };
        if let Some(other) = taken.insert(to.clone(), &input.path) {
            let (a, b) = (other.display(), input.path.display());
            return Err(Failure::Usage(format!("{a} and {b} would both become {}", to.display())));
        }
        let bytes = std::fs::metadata(&input.path).map_or(0, |m| m.len());
        jobs.push(Job { input: input.path.clone(), output: to, kind, bytes });
    }
    Ok(jobs)
}

/// The path with another extension behind the one it has.
fn with_suffix(path: &Path, extension: &str) -> PathBuf {
    let mut whole = path.as_os_str().to_owned();
    whole.push(".");
    whole.push(extension);
    whole.into()
}

impl Job {
    pub fn run(&self, encoding: Encoding, force: bool, read: &mut dyn FnMut(u64)) -> Outcome {
        let started = Instant::now();
        let result = self.convert(encoding, force, read);
        Outcome {
            input: self.input.clone(),
            output: self.output.clone(),
            seconds: started.elapsed().as_secs_f64(),
            bytes: self.bytes,
            result,
        }
    }

    fn convert(
        &self,
        encoding: Encoding,
        force: bool,
        read: &mut dyn FnMut(u64),
    ) -> Result<(Converted, u64), RecordError> {
        let kind = self.kind.clone().map_err(RecordError::Unsupported)?;
        let file = NewFile::create(&self.output, force)?;
        let sink = BufWriter::with_capacity(BUFFER, file.file()?);
        let (converted, sink) = match kind {
            FileKind::Mcap => mcap_to_log(&self.input, sink, read)?,
            FileKind::Telemetry => log_to_mcap(&self.input, sink, encoding, read)?,
            FileKind::Ulog | FileKind::Dataflash => autopilot_log_to_mcap(&self.input, kind, sink, read)?,
        };
        let mut inner = sink.into_inner().map_err(|e| RecordError::Write(e.into_error()))?;
        inner.flush().map_err(RecordError::Write)?;
        Ok((converted, file.commit()?))
    }
}

impl Outcome {
    /// One line: on standard output, or not at all with `--json`; failures on standard error.
    pub fn tell(&self, json: bool) {
        match &self.result {
            Err(e) => tracing::error!("{}: {e}", self.input.display()),
            // a reader that has gone away has seen enough
            Ok(_) if !json => drop(crate::cli::print(&self.line())),
            Ok(_) => {}
        }
    }

    fn line(&self) -> String {
        let Ok((c, written)) = &self.result else { return String::new() };
        let mut line = format!("{} → {}: {} messages", self.input.display(), self.output.display(), c.counts.frames);
        if let Some((from, to)) = c.span_ns {
            line += &format!(", {:.0} s", to.saturating_sub(from) as f64 * 1e-9);
        }
        for (n, what) in [(c.counts.unknown, "unknown"), (c.counts.bad, "bad")] {
            if n > 0 {
                line += &format!(", {n} {what}");
            }
        }
        if c.cut_off {
            line += ", cut off before its end";
        }
        let mb = |bytes: u64| bytes as f64 * 1e-6;
        let rate = c.counts.frames as f64 / self.seconds.max(1e-9);
        line + &format!(
            ", {:.1} → {:.1} MB, {:.2} s ({:.0} messages/s)",
            mb(self.bytes),
            mb(*written),
            self.seconds,
            rate
        )
    }

    pub fn json(&self) -> Value {
        let mut row = json!({ "input": self.input, "output": self.output, "seconds": self.seconds });
        match &self.result {
            Err(e) => row["error"] = json!(e.to_string()),
            Ok((c, written)) => {
                row["messages"] = json!(c.counts.frames);
                row["unknown"] = json!(c.counts.unknown);
                row["bad"] = json!(c.counts.bad);
                row["bad_bytes"] = json!(c.counts.bad_bytes);
                row["first_unix_s"] = json!(c.span_ns.map(|s| s.0 as f64 * 1e-9));
                row["last_unix_s"] = json!(c.span_ns.map(|s| s.1 as f64 * 1e-9));
                row["parameters"] = json!(c.parameters);
                row["cut_off"] = json!(c.cut_off);
                row["bytes_read"] = json!(self.bytes);
                row["bytes_written"] = json!(written);
            }
        }
        row
    }
}
