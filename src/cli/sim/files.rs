use crate::cli::Failure;
use crate::sim::{Received, Run, TruthLog};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Rows of truth a second, and how often files are brought up to date, s of simulated time.
const TRUTH_HZ: f64 = 50.0;
const FLUSH_S: f64 = 1.0;

type Sink = BufWriter<File>;

/// What is written beside sending: the log of what the ground receives, and the truth.
pub(super) struct Files {
    tlog: Option<(PathBuf, Sink)>,
    truth: Vec<(PathBuf, TruthLog<Sink>)>,
    next_row_s: f64,
    next_flush_s: f64,
}

impl Files {
    pub fn create(tlog: Option<&Path>, truth: Option<&Path>, run: &Run) -> Result<Self, Failure> {
        let open = |path: PathBuf| match File::create(&path) {
            Ok(file) => Ok((path, BufWriter::with_capacity(1 << 16, file))),
            Err(e) => Err(failed(&path, &e)),
        };
        let tlog = tlog.map(|path| open(path.to_owned())).transpose()?;
        let mut logs = Vec::new();
        if let Some(path) = truth {
            let vehicles = run.vehicle_count();
            for index in 0..vehicles {
                let (path, sink) = open(if vehicles == 1 { path.to_owned() } else { numbered(path, index + 1) })?;
                let log = TruthLog::new(sink).map_err(|e| failed(&path, &e))?;
                logs.push((path, log));
            }
        }
        Ok(Self { tlog, truth: logs, next_row_s: 1.0 / TRUTH_HZ, next_flush_s: FLUSH_S })
    }

    /// Appends a frame as received. Damaged ones too: a log holds what came.
    pub fn frame(&mut self, received: &Received<'_>) -> Result<(), Failure> {
        let Some((path, sink)) = &mut self.tlog else { return Ok(()) };
        let write = |sink: &mut Sink| -> io::Result<()> {
            sink.write_all(&received.unix_us.to_be_bytes())?;
            sink.write_all(received.bytes)
        };
        write(sink).map_err(|e| failed(path, &e))
    }

    /// Appends the truth when a row is due.
    pub fn truth(&mut self, run: &Run) -> Result<(), Failure> {
        let now_s = run.now_s();
        if now_s + 1e-9 >= self.next_row_s {
            self.next_row_s += 1.0 / TRUTH_HZ;
            for (index, (path, log)) in self.truth.iter_mut().enumerate() {
                let index = index as u8;
                if let Some(vehicle) = run.vehicle(index) {
                    log.write(run.boot_s(index), vehicle).map_err(|e| failed(path, &e))?;
                }
            }
        }
        if now_s >= self.next_flush_s {
            self.next_flush_s = now_s + FLUSH_S;
            self.flush()?;
        }
        Ok(())
    }

    pub fn finish(mut self) -> Result<(), Failure> {
        self.flush()
    }

    fn flush(&mut self) -> Result<(), Failure> {
        if let Some((path, sink)) = &mut self.tlog {
            sink.flush().map_err(|e| failed(path, &e))?;
        }
        for (path, log) in &mut self.truth {
            log.flush().map_err(|e| failed(path, &e))?;
        }
        Ok(())
    }
}

/// `truth.csv` of system 3 is `truth.3.csv`.
fn numbered(path: &Path, system: u8) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!(".{system}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

fn failed(path: &Path, e: &io::Error) -> Failure {
    Failure::Failed(format!("cannot write {}: {e}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_vehicles_get_files_of_their_own() {
        assert_eq!(numbered(Path::new("out/truth.csv"), 3), Path::new("out/truth.3.csv"));
        assert_eq!(numbered(Path::new("truth"), 12), Path::new("truth.12"));
    }
}
