use nalgebra::Vector3;

/// A vector that changes over time as a chain of quadratics, zero outside them. Constants, steps, ramps, triangles,
/// parabolas and recorded series (joined by straight lines) are all of this kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Profile {
    /// In order of time, without overlap.
    pieces: Vec<Piece>,
}

/// `a + b·s + c·s²` with s = t − start, for start ≤ t < end.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    start_s: f64,
    end_s: f64,
    a: Vector3<f64>,
    b: Vector3<f64>,
    c: Vector3<f64>,
}

impl Piece {
    fn end_value(&self) -> Vector3<f64> {
        // a piece without beginning is constant
        let s = if self.start_s.is_finite() { self.end_s - self.start_s } else { 0.0 };
        self.a + (self.b + self.c * s) * s
    }
}

impl Profile {
    /// The same value at all times.
    pub fn steady(value: Vector3<f64>) -> Self {
        let mut p = Self::default();
        p.constant(f64::NEG_INFINITY, f64::INFINITY, value);
        p
    }

    /// Straight lines between `(time, value)` knots, held before the first and after the last. Knots must be in order
    /// of time; one that is not later than its predecessor is a jump at the predecessor's time.
    pub fn series(knots: &[(f64, Vector3<f64>)]) -> Self {
        let mut p = Self::default();
        if let (Some(first), Some(last)) = (knots.first(), knots.last()) {
            p.constant(f64::NEG_INFINITY, first.0, first.1);
            for pair in knots.windows(2) {
                if let [from, to] = pair {
                    p.ramp(from.0, to.0, from.1, to.1);
                }
            }
            p.constant(last.0, f64::INFINITY, last.1);
        }
        p
    }

    /// A new value at each of the given times, reached over `ramp_s` seconds (0: at once); zero before the first.
    pub fn steps(changes: &[(f64, Vector3<f64>)], ramp_s: f64) -> Self {
        let mut knots = Vec::with_capacity(2 * changes.len());
        let mut before = Vector3::zeros();
        for (i, &(t, value)) in changes.iter().enumerate() {
            let room = changes.get(i + 1).map_or(f64::INFINITY, |next| next.0 - t);
            knots.push((t, before));
            knots.push((t + ramp_s.min(room).max(0.0), value));
            before = value;
        }
        Self::series(&knots)
    }

    /// The disturbance of the quadratic-boundedness paper (its Fig. 3): constant steps from 5 to 15 s, a triangle
    /// from 20 to 30 s, a parabola from 35 to 45 s. The figure's numbers are not printed: the peak is given here.
    pub fn paper(peak: Vector3<f64>) -> Self {
        let mut p = Self::default();
        for (i, share) in [1.0, -1.0, 0.5, -0.5].into_iter().enumerate() {
            let start = 5.0 + 2.5 * i as f64;
            p.constant(start, start + 2.5, peak * share);
        }
        p.ramp(20.0, 22.5, Vector3::zeros(), peak);
        p.ramp(22.5, 27.5, peak, -peak);
        p.ramp(27.5, 30.0, -peak, Vector3::zeros());
        // peak·(1 − ((t − 40)/5)²) = peak·(2s/5 − s²/25) with s = t − 35
        p.pieces.push(Piece {
            start_s: 35.0,
            end_s: 45.0,
            a: Vector3::zeros(),
            b: peak * 0.4,
            c: peak * (-1.0 / 25.0),
        });
        p
    }

    /// A constant for a while.
    pub fn pulse(start_s: f64, end_s: f64, value: Vector3<f64>) -> Self {
        let mut p = Self::default();
        p.constant(start_s, end_s, value);
        p
    }

    /// Every value sent through a linear map.
    #[must_use]
    pub fn mapped(&self, map: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Self {
        let piece = |p: &Piece| Piece { a: map(p.a), b: map(p.b), c: map(p.c), ..*p };
        Self { pieces: self.pieces.iter().map(piece).collect() }
    }

    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        let after = self.pieces.partition_point(|p| p.start_s <= t_s);
        match after.checked_sub(1).and_then(|i| self.pieces.get(i)) {
            Some(p) if t_s < p.end_s => {
                // a piece without beginning is constant
                let s = if p.start_s.is_finite() { t_s - p.start_s } else { 0.0 };
                p.a + (p.b + p.c * s) * s
            }
            _ => Vector3::zeros(),
        }
    }

    /// Instants at which it jumps or begins a ramp that reaches at least a new value: the beginnings of its pieces, but
    /// not of those that only hold on to the end of the piece before.
    pub fn changes(&self) -> impl Iterator<Item = f64> {
        let held = |p: &Piece| p.b == Vector3::zeros() && p.c == Vector3::zeros();
        self.pieces.iter().enumerate().filter_map(move |(i, p)| {
            let before = i.checked_sub(1).and_then(|i| self.pieces.get(i));
            let joins = before.is_some_and(|b| b.end_s == p.start_s && (b.end_value() - p.a).norm() < 1e-9);
            let new = p.start_s.is_finite() && !(joins && held(p));
            new.then_some(p.start_s)
        })
    }

    fn constant(&mut self, start_s: f64, end_s: f64, a: Vector3<f64>) {
        if end_s > start_s {
            self.pieces.push(Piece { start_s, end_s, a, b: Vector3::zeros(), c: Vector3::zeros() });
        }
    }

    fn ramp(&mut self, start_s: f64, end_s: f64, from: Vector3<f64>, to: Vector3<f64>) {
        if end_s > start_s {
            let b = (to - from) / (end_s - start_s);
            self.pieces.push(Piece { start_s, end_s, a: from, b, c: Vector3::zeros() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn x(v: f64) -> Vector3<f64> {
        Vector3::x() * v
    }

    #[test]
    fn steps_hold_until_the_next() {
        let p = Profile::steps(&[(10.0, x(3.0)), (20.0, x(8.0))], 0.0);
        assert_eq!([9.9, 10.0, 19.9, 20.0, 1e6].map(|t| p.at(t).x), [0.0, 3.0, 3.0, 8.0, 8.0]);
        let ramped = Profile::steps(&[(10.0, x(3.0)), (20.0, x(8.0))], 2.0);
        assert_eq!([9.0, 11.0, 12.0, 21.0, 30.0].map(|t| ramped.at(t).x), [0.0, 1.5, 3.0, 5.5, 8.0]);
    }

    #[test]
    fn a_series_is_interpolated_and_held_at_its_ends() {
        let p = Profile::series(&[(1.0, x(0.0)), (3.0, x(4.0))]);
        assert_eq!([-5.0, 1.0, 2.0, 3.0, 50.0].map(|t| p.at(t).x), [0.0, 0.0, 2.0, 4.0, 4.0]);
        assert_eq!(Profile::series(&[(2.0, x(7.0))]).at(-1.0).x, 7.0);
        assert_eq!(Profile::series(&[]).at(1.0).x, 0.0);
        assert_eq!(Profile::steady(x(2.0)).at(1e9).x, 2.0);
    }

    #[test]
    fn changes_are_where_something_new_begins() {
        let p = Profile::steps(&[(10.0, x(3.0)), (20.0, x(8.0))], 2.0);
        assert_eq!(p.changes().collect::<Vec<_>>(), [10.0, 20.0]);
        assert_eq!(Profile::steady(x(1.0)).changes().count(), 0);
        let paper: Vec<_> = Profile::paper(x(2.0)).changes().collect();
        assert_eq!(paper, [5.0, 7.5, 10.0, 12.5, 20.0, 22.5, 27.5, 35.0]);
    }

    #[test]
    fn the_papers_disturbance_has_steps_then_a_triangle_then_a_parabola() {
        let p = Profile::paper(x(2.0));
        let expected = [(4.9, 0.0), (6.0, 2.0), (8.0, -2.0), (17.0, 0.0), (22.5, 2.0), (25.0, 0.0), (27.5, -2.0)];
        for (t, v) in expected.into_iter().chain([(32.0, 0.0), (40.0, 2.0), (37.5, 1.5), (45.0, 0.0), (60.0, 0.0)]) {
            assert!((p.at(t).x - v).abs() < 1e-12, "{t} s: {}", p.at(t).x);
        }
    }
}
