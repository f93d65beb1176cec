use super::Zonotope;
use super::rounding::{gamma, up};
use nalgebra::{SMatrix, SVector};

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// The image `{Lx}` under a linear map (eq. 3b of Wang and Puig).
    pub fn map<const K: usize>(&self, l: &SMatrix<f64, K, N>) -> Zonotope<K, M> {
        let mut out = Zonotope::point(SVector::zeros());
        self.clone_spread(|z| z.map_into(l, &mut out));
        out
    }

    /// The image under a linear map, written over `out`. The slack is mapped as a box, which widens it where the map
    /// turns: call [`Self::spread`] before to keep it exact. Zeros of the map cost nothing.
    pub fn map_into<const K: usize>(&self, l: &SMatrix<f64, K, N>, out: &mut Zonotope<K, M>) {
        let len = self.len;
        out.len = len;
        let sums = self.row_sums();
        for i in 0..K {
            let target = &mut out.rows[i][..len];
            target.fill(0.0);
            let (mut centre, mut slack, mut size) = (0.0, 0.0, 0.0);
            for k in 0..N {
                let a = l[(i, k)];
                if a == 0.0 {
                    continue;
                }
                for (t, h) in target.iter_mut().zip(&self.rows[k][..len]) {
                    *t += a * h;
                }
                centre += a * self.centre[k];
                slack += a.abs() * self.slack[k];
                size += a.abs() * (sums[k] + self.centre[k].abs());
            }
            // each entry is a sum of N products
            out.centre[i] = centre;
            out.slack[i] = up(slack + gamma(N + 1) * up(size, 2 * N), N + 2);
        }
    }

    /// Works on a copy whose slack has become generators.
    fn clone_spread<R>(&self, work: impl FnOnce(&Self) -> R) -> R {
        let mut z = self.clone();
        z.spread();
        work(&z)
    }
}
