use super::scale::Scale;

/// Points in a column beyond which only its first, lowest, highest and last are kept.
const KEPT: usize = 4;

/// The line's unbroken pieces, with no more points than the picture can show: of many points in one of `columns`
/// columns, the first, the lowest, the highest and the last stay, so that no spike is lost. Points without a place on
/// the scales, or beside the x axis, break the line.
pub(super) fn line(points: &[[f64; 2]], x: &Scale, y: &Scale, columns: usize) -> Vec<Vec<[f64; 2]>> {
    pieces(points, |p| x.share(p[0]).filter(|_| y.share(p[1]).is_some()))
        .map(|piece| {
            let mut kept = Vec::new();
            for column in grouped(piece, x, columns) {
                if column.len() <= KEPT {
                    kept.extend_from_slice(column);
                    continue;
                }
                // every index below comes from this column, which is not empty
                let by_y = |a: &usize, b: &usize| column[*a][1].total_cmp(&column[*b][1]);
                let lowest = (0..column.len()).min_by(by_y).unwrap_or(0);
                let highest = (0..column.len()).max_by(by_y).unwrap_or(0);
                let mut picked = [0, lowest, highest, column.len() - 1];
                picked.sort_unstable();
                let mut last = None;
                for i in picked.into_iter().filter(|i| last.replace(*i) != Some(*i)) {
                    kept.push(column[i]);
                }
            }
            kept
        })
        .collect()
}

/// Likewise for bands: a column becomes its outermost ends.
pub(super) fn band(ends: &[[f64; 3]], x: &Scale, y: &Scale, columns: usize) -> Vec<Vec<[f64; 3]>> {
    pieces(ends, |e| x.share(e[0]).filter(|_| y.share(e[1]).is_some() && y.share(e[2]).is_some()))
        .map(|piece| {
            let mut kept = Vec::new();
            for column in grouped(piece, x, columns) {
                let outermost = column
                    .iter()
                    .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], e| [low.min(e[1]), high.max(e[2])]);
                match column {
                    [first, .., last] if column.len() > KEPT => {
                        kept.extend([first, last].map(|e| [e[0], outermost[0], outermost[1]]));
                    }
                    few => kept.extend_from_slice(few),
                }
            }
            kept
        })
        .collect()
}

/// Runs of points whose share of the x axis exists and lies on it.
fn pieces<'a, const N: usize>(
    points: &'a [[f64; N]],
    share: impl Fn(&[f64; N]) -> Option<f64> + 'a,
) -> impl Iterator<Item = &'a [[f64; N]]> {
    let shown = move |p: &[f64; N]| share(p).is_some_and(|s| (-1e-9..=1.0 + 1e-9).contains(&s));
    points.split(move |p| !shown(p)).filter(|piece| !piece.is_empty())
}

/// Neighbours in the same column of the picture.
fn grouped<'a, const N: usize>(
    piece: &'a [[f64; N]],
    x: &'a Scale,
    columns: usize,
) -> impl Iterator<Item = &'a [[f64; N]]> {
    let column = move |p: &[f64; N]| (x.share(p[0]).unwrap_or(0.0) * columns as f64) as usize;
    piece.chunk_by(move |a, b| column(a) == column(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_points_become_few_and_the_spike_stays() {
        let mut points: Vec<_> = (0..100_000).map(|i| [f64::from(i), 0.0]).collect();
        points[54_321][1] = 9.0;
        let (x, y) = (Scale::Linear([0.0, 1e5]), Scale::Linear([0.0, 10.0]));
        let thin = line(&points, &x, &y, 100);
        assert_eq!(thin.len(), 1);
        assert!(thin[0].len() <= 400 && thin[0].contains(&[54_321.0, 9.0]));
        assert!(thin[0].is_sorted_by(|a, b| a[0] < b[0]));
        let ends: Vec<_> = points.iter().map(|p| [p[0], p[1] - 1.0, p[1] + 1.0]).collect();
        let thin = band(&ends, &x, &y, 100);
        assert!(thin[0].len() <= 200 && thin[0].iter().any(|e| e[2] == 10.0));
    }

    #[test]
    fn gaps_break_the_line() {
        let points = [[0.0, 1.0], [1.0, f64::NAN], [2.0, 1.0], [3.0, -1.0], [4.0, 1.0], [9.0, 1.0]];
        let x = Scale::Linear([0.0, 5.0]);
        assert_eq!(
            line(&points, &x, &Scale::Log([0.1, 2.0]), 10),
            [vec![[0.0, 1.0]], vec![[2.0, 1.0]], vec![[4.0, 1.0]]]
        );
        assert_eq!(line(&points, &x, &Scale::Linear([0.1, 2.0]), 10).len(), 2);
    }
}
