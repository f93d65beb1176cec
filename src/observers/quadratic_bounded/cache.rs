//! Sampled designs in the cache of gains: what a file holds are the numbers of `Core`.

use super::plant::{NoiseBlock, SampledPlant};
use super::sampled::{Core, DesignError, PartialStep, Prepared, SampledDesign, complete, design_sampled};
use crate::observers::cache::{Cache, Rows};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

impl Cache {
    /// A sampled design, from the cache or made and then kept. See [`design_sampled`].
    ///
    /// # Errors
    /// Those of [`design_sampled`].
    pub fn sampled(&self, plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Result<SampledDesign, DesignError> {
        self.fetch(
            "qb",
            &Inputs::of(plant, alpha, nodes),
            |record: &CoreRecord| {
                let prepared = Prepared::new(plant, alpha, nodes).map_err(|e| e.to_string())?;
                let core = record.core(&prepared, nodes).ok_or("its numbers do not fit the plant")?;
                complete(&prepared, core, 0.0).map_err(|e| e.to_string())
            },
            || design_sampled(plant, alpha, nodes).map(|design| (CoreRecord::of(&design), design)),
        )
    }
}

/// [`design_sampled`] through the user's cache.
///
/// # Errors
/// Those of [`design_sampled`].
pub fn design_cached(plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Result<SampledDesign, DesignError> {
    Cache::of_user().sampled(plant, alpha, nodes)
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Inputs {
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
            alpha,
            nodes: nodes.to_vec(),
            a: Rows::of(&plant.a),
            c: Rows::of(&plant.c),
            e1: Rows::of(&plant.e1),
            process: blocks(&plant.process),
            output: blocks(&plant.output),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::step_nodes;
    use nalgebra::dmatrix;
    use std::path::{Path, PathBuf};

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
        doctored(&|v| v["numbers"]["p"] = serde_json::json!([[9e9, 0.0], [0.0, 9e9]]));
        doctored(&|v| v["numbers"]["p"] = serde_json::json!([[-1.0, 0.0], [0.0, 1.0]]));
        doctored(&|v| v["numbers"]["p"] = serde_json::json!([[1.0]]));
        doctored(&|v| v["numbers"]["gains"][0] = serde_json::json!([[0.0, 0.0], [0.0, 0.0]]));
        doctored(&|v| v["numbers"]["partial"][0]["growth"] = serde_json::json!([0.5, 0.5, 0.5]));
        doctored(&|v| v["numbers"]["partial"][1]["gains"] = v["numbers"]["partial"][2]["gains"].clone());
        doctored(&|v| v["numbers"]["shares"] = serde_json::json!([[9.0, 9.0, 9.0], [9.0, 9.0, 9.0], [9.0, 9.0, 9.0]]));
        doctored(&|v| v["numbers"]["nodes"] = serde_json::json!([0.01, 0.011, 0.012]));
        doctored(&|v| v["numbers"]["partial"] = serde_json::json!([]));
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
        let key = |p: &SampledPlant, alpha, nodes: &[f64]| Cache::key(&Inputs::of(p, alpha, nodes)).unwrap();
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
