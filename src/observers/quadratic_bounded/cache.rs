//! Designs kept on disk, so that a start costs a proof instead of a synthesis.
//!
//! One JSON file per design under `$XDG_CACHE_HOME/mavobserver` (else `~/.cache/mavobserver`), named by a hash of all
//! inputs, which stand in the file too and are compared. A file holds only the numbers of `Core`: everything that is
//! claimed about them is proven anew when they are read, so a damaged or doctored file is redone, never believed.
//! Trouble with the cache is no error: the design is then made.

use super::plant::{NoiseBlock, SampledPlant};
use super::sampled::{Core, DesignError, PartialStep, Prepared, SampledDesign, complete, design_sampled};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Raised when the same inputs come to mean another design.
const FORMAT: u32 = 1;

/// Where designs are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cache {
    Directory(PathBuf),
    /// Nothing is read or written.
    Off,
}

impl Cache {
    /// The user's cache directory; off when the environment names none.
    pub fn of_user() -> Self {
        let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
        absolute("XDG_CACHE_HOME")
            .or_else(|| absolute("HOME").map(|h| h.join(".cache")))
            .map_or(Self::Off, |base| Self::Directory(base.join("mavobserver")))
    }

    /// A sampled design, from the cache or made and then kept. See [`design_sampled`].
    ///
    /// # Errors
    /// Those of [`design_sampled`].
    pub fn sampled(&self, plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Result<SampledDesign, DesignError> {
        let Self::Directory(directory) = self else { return design_sampled(plant, alpha, nodes) };
        let inputs = Inputs::of(plant, alpha, nodes);
        let path = directory.join(format!("qb-{:016x}.json", inputs.hash()));
        if let Some(design) = read(&path, &inputs, plant, alpha) {
            return Ok(design);
        }
        let design = design_sampled(plant, alpha, nodes)?;
        if let Err(e) = write(directory, &path, &Entry { inputs, core: CoreRecord::of(&design) }) {
            tracing::debug!("design not cached in {}: {e}", path.display());
        }
        Ok(design)
    }
}

/// [`design_sampled`] through the user's cache.
///
/// # Errors
/// Those of [`design_sampled`].
pub fn design_cached(plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Result<SampledDesign, DesignError> {
    Cache::of_user().sampled(plant, alpha, nodes)
}

/// A matrix as rows, as one reads it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Rows(Vec<Vec<f64>>);

impl Rows {
    fn of(m: &DMatrix<f64>) -> Self {
        Self(m.row_iter().map(|r| r.iter().copied().collect()).collect())
    }

    fn matrix(&self, rows: usize, cols: usize) -> Option<DMatrix<f64>> {
        let fits = self.0.len() == rows && self.0.iter().all(|r| r.len() == cols);
        (fits && self.0.iter().flatten().all(|x| x.is_finite()))
            .then(|| DMatrix::from_fn(rows, cols, |i, j| self.0[i][j]))
    }
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Inputs {
    format: u32,
    alpha: f64,
    nodes: Vec<f64>,
    a: Rows,
    c: Rows,
    e1: Rows,
    process: Vec<(Rows, Rows)>,
    output: Vec<(Rows, Rows)>,
}

impl Inputs {
    fn of(plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Self {
        let blocks = |b: &[NoiseBlock]| b.iter().map(|b| (Rows::of(&b.w), Rows::of(&b.q))).collect();
        Self {
            format: FORMAT,
            alpha,
            nodes: nodes.to_vec(),
            a: Rows::of(&plant.a),
            c: Rows::of(&plant.c),
            e1: Rows::of(&plant.e1),
            process: blocks(&plant.process),
            output: blocks(&plant.output),
        }
    }

    /// FNV-1a over every number and shape; a collision costs a miss, since the inputs themselves are compared.
    fn hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut take = |bits: u64| {
            for byte in bits.to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        };
        take(u64::from(self.format));
        take(self.alpha.to_bits());
        let mut row = |r: &[f64]| {
            take(r.len() as u64);
            r.iter().for_each(|x| take(x.to_bits()));
        };
        row(&self.nodes);
        let blocks = self.process.iter().chain(&self.output).flat_map(|(w, q)| [w, q]);
        for m in [&self.a, &self.c, &self.e1].into_iter().chain(blocks) {
            row(&[m.0.len() as f64]);
            m.0.iter().for_each(|r| row(r));
        }
        hash
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct PartialRecord {
    gains: Vec<Rows>,
    growth: Vec<f64>,
    weights: Vec<Vec<f64>>,
}

#[derive(Debug, Serialize, Deserialize)]
struct CoreRecord {
    nodes: Vec<f64>,
    p: Rows,
    gains: Vec<Rows>,
    shares: Vec<Vec<f64>>,
    partial: Vec<PartialRecord>,
}

impl CoreRecord {
    fn of(d: &SampledDesign) -> Self {
        let partial = |s: &PartialStep| PartialRecord {
            gains: s.gains.iter().map(Rows::of).collect(),
            growth: s.growth.clone(),
            weights: s.weights.clone(),
        };
        Self {
            nodes: d.dt_s.clone(),
            p: Rows::of(&d.p),
            gains: d.gains.iter().map(Rows::of).collect(),
            shares: d.shares.clone(),
            partial: d.partial.iter().map(partial).collect(),
        }
    }

    /// The numbers in the shapes this plant needs; `None` when they do not have them.
    fn core(&self, prepared: &Prepared<'_>, asked: &[f64]) -> Option<Core> {
        let (n, p) = (prepared.plant.a.nrows(), prepared.plant.c.nrows());
        let count = self.nodes.len();
        let blocks = prepared.process.len() + prepared.output.len();
        let positive = |v: &[f64]| v.iter().all(|x| x.is_finite() && *x > 0.0);
        let weights_fit = |w: &[Vec<f64>]| w.len() == count && w.iter().all(|w| w.len() == blocks && positive(w));
        let gains = |g: &[Rows]| -> Option<Vec<DMatrix<f64>>> {
            if g.len() == count { g.iter().map(|r| r.matrix(n, p)).collect() } else { None }
        };
        // a synthesis may have added nodes, but it kept the range; shares of more than the whole would prove nothing
        let nodes_fit = self.nodes.windows(2).all(|w| w[0] < w[1])
            && self.nodes.first() == asked.first()
            && self.nodes.last() == asked.last();
        let shares_fit = self.shares.iter().all(|s| s.iter().sum::<f64>() <= 1.0 + 1e-12);
        if !nodes_fit || !shares_fit || !weights_fit(&self.shares) {
            return None;
        }
        if self.partial.len() != prepared.subsets().len() {
            return None;
        }
        let mut partial = Vec::new();
        for (outputs, record) in prepared.subsets().zip(&self.partial) {
            if record.growth.len() != count || !positive(&record.growth) || !weights_fit(&record.weights) {
                return None;
            }
            let gains = gains(&record.gains)?;
            // a missing output must not be used
            let unused = |j: usize| outputs & (1 << j) == 0;
            if gains.iter().any(|g| (0..p).any(|j| unused(j) && g.column(j).amax() != 0.0)) {
                return None;
            }
            partial.push(PartialStep {
                outputs,
                gains,
                growth: record.growth.clone(),
                offset: record.weights.iter().map(|w| w.iter().sum()).collect(),
                weights: record.weights.clone(),
            });
        }
        Some(Core {
            nodes: self.nodes.clone(),
            p: self.p.matrix(n, n)?,
            gains: gains(&self.gains)?,
            shares: self.shares.clone(),
            partial,
        })
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Entry {
    inputs: Inputs,
    core: CoreRecord,
}

fn read(path: &Path, inputs: &Inputs, plant: &SampledPlant, alpha: f64) -> Option<SampledDesign> {
    let text = std::fs::read_to_string(path).ok()?;
    let redo = |why: &str| tracing::warn!("{} is redone: {why}", path.display());
    let Ok(entry) = serde_json::from_str::<Entry>(&text) else {
        redo("not a design");
        return None;
    };
    if entry.inputs != *inputs {
        redo("made for other inputs");
        return None;
    }
    let prepared = Prepared::new(plant, alpha, &inputs.nodes).ok()?;
    let Some(core) = entry.core.core(&prepared, &inputs.nodes) else {
        redo("its numbers do not fit the plant");
        return None;
    };
    complete(&prepared, core, 0.0).inspect_err(|e| redo(&e.to_string())).ok()
}

/// Writes beside the file and renames, so that no reader meets half an entry.
fn write(directory: &Path, path: &Path, entry: &Entry) -> std::io::Result<()> {
    std::fs::create_dir_all(directory)?;
    let part = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::File::create(&part).and_then(|mut file| {
        file.write_all(&serde_json::to_vec(entry)?)?;
        file.sync_all()
    });
    written.and_then(|()| std::fs::rename(&part, path)).inspect_err(|_| {
        // best effort: a leftover part is harmless
        let _ = std::fs::remove_file(&part);
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::step_nodes;
    use nalgebra::dmatrix;

    fn axis() -> SampledPlant {
        SampledPlant {
            a: dmatrix![0.0, 1.0; 0.0, 0.0],
            process: vec![NoiseBlock::scalar(2, 1, 10.0)],
            c: dmatrix![1.0, 0.0; 0.0, 1.0],
            output: vec![NoiseBlock::scalar(2, 0, 0.3), NoiseBlock::scalar(2, 1, 1.5)],
            e1: DMatrix::identity(2, 2),
        }
    }

    fn nodes() -> Vec<f64> {
        step_nodes(0.01, 0.03, 3)
    }

    fn only_file(directory: &Path) -> PathBuf {
        let files: Vec<_> = std::fs::read_dir(directory).unwrap().map(|f| f.unwrap().path()).collect();
        assert_eq!(files.len(), 1, "{files:?}");
        files[0].clone()
    }

    #[test]
    fn a_kept_design_comes_back_without_the_solver() {
        let home = tempfile::tempdir().unwrap();
        let cache = Cache::Directory(home.path().join("not/yet/there"));
        let made = cache.sampled(&axis(), 3.0, &nodes()).unwrap();
        let kept = cache.sampled(&axis(), 3.0, &nodes()).unwrap();
        assert!(made.solve_s > 0.0 && kept.solve_s == 0.0);
        assert_eq!(SampledDesign { solve_s: made.solve_s, ..kept }, made);
        // other inputs are other designs
        assert!(cache.sampled(&axis(), 3.1, &nodes()).unwrap().solve_s > 0.0);
    }

    #[test]
    fn a_damaged_or_doctored_file_is_redone() {
        let home = tempfile::tempdir().unwrap();
        let cache = Cache::Directory(home.path().to_owned());
        let honest = cache.sampled(&axis(), 3.0, &nodes()).unwrap();
        let file = only_file(home.path());
        let text = std::fs::read_to_string(&file).unwrap();
        let mut lies: Vec<String> = vec![String::new(), "{}".into(), text[..text.len() / 2].into()];
        let mut doctored = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
            change(&mut value);
            lies.push(value.to_string());
        };
        // a smaller ellipsoid, no gain, a bound that does not grow, an output used in secret, weights from nothing
        doctored(&|v| v["core"]["p"] = serde_json::json!([[9e9, 0.0], [0.0, 9e9]]));
        doctored(&|v| v["core"]["p"] = serde_json::json!([[-1.0, 0.0], [0.0, 1.0]]));
        doctored(&|v| v["core"]["p"] = serde_json::json!([[1.0]]));
        doctored(&|v| v["core"]["gains"][0] = serde_json::json!([[0.0, 0.0], [0.0, 0.0]]));
        doctored(&|v| v["core"]["partial"][0]["growth"] = serde_json::json!([0.5, 0.5, 0.5]));
        doctored(&|v| v["core"]["partial"][1]["gains"] = v["core"]["partial"][2]["gains"].clone());
        doctored(&|v| v["core"]["shares"] = serde_json::json!([[9.0, 9.0, 9.0], [9.0, 9.0, 9.0], [9.0, 9.0, 9.0]]));
        doctored(&|v| v["core"]["nodes"] = serde_json::json!([0.01, 0.011, 0.012]));
        doctored(&|v| v["core"]["partial"] = serde_json::json!([]));
        doctored(&|v| v["inputs"]["alpha"] = serde_json::json!(30.0));
        for lie in &lies {
            std::fs::write(&file, lie).unwrap();
            let redone = cache.sampled(&axis(), 3.0, &nodes()).unwrap();
            assert!(redone.solve_s > 0.0, "believed {lie}");
            assert_eq!(redone.p, honest.p);
        }
    }

    #[test]
    fn a_cache_that_cannot_be_written_does_no_harm() {
        let home = tempfile::tempdir().unwrap();
        let file = home.path().join("file");
        std::fs::write(&file, "in the way").unwrap();
        assert!(Cache::Directory(file).sampled(&axis(), 3.0, &nodes()).is_ok());
        assert!(Cache::Off.sampled(&axis(), 3.0, &nodes()).is_ok());
    }

    #[test]
    fn every_input_changes_the_key() {
        let key = |p: &SampledPlant, alpha, nodes: &[f64]| Inputs::of(p, alpha, nodes).hash();
        let mut other = axis();
        other.process[0].w[(0, 0)] = 1e-12;
        let keys = [
            key(&axis(), 3.0, &nodes()),
            key(&axis(), 3.0 + 1e-15, &nodes()),
            key(&axis(), 3.0, &nodes()[..2]),
            key(&other, 3.0, &nodes()),
            key(&SampledPlant { e1: dmatrix![0.0, 1.0], ..axis() }, 3.0, &nodes()),
        ];
        assert!((0..keys.len()).all(|i| (0..i).all(|j| keys[i] != keys[j])));
    }
}
