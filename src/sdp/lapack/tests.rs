//! Each routine against nalgebra, on matrices that sit inside larger arrays (leading dimension > rows) whose
//! other entries must stay as they were.
use super::*;
use nalgebra::DMatrix;
use proptest::prelude::*;

const UNTOUCHED: f64 = 1.0e300;

/// A column-major array with a leading dimension, filled outside the matrix with a sentinel.
struct Padded {
    data: Vec<f64>,
    rows: usize,
    cols: usize,
    ld: c_int,
}

impl Padded {
    fn new(m: &DMatrix<f64>, pad: usize) -> Self {
        let ld = m.nrows() + pad;
        let mut data = vec![UNTOUCHED; ld * m.ncols().max(1)];
        for j in 0..m.ncols() {
            for i in 0..m.nrows() {
                data[j * ld + i] = m[(i, j)];
            }
        }
        Self { data, rows: m.nrows(), cols: m.ncols(), ld: ld as c_int }
    }

    fn matrix(&self) -> DMatrix<f64> {
        let ld = self.ld as usize;
        for (k, x) in self.data.iter().enumerate() {
            assert!(k % ld < self.rows || *x == UNTOUCHED, "wrote below the matrix");
        }
        DMatrix::from_fn(self.rows, self.cols, |i, j| self.data[j * ld + i])
    }
}

fn c(letter: u8) -> c_char {
    letter as c_char
}

fn entries(seed: u64, rows: usize, cols: usize) -> DMatrix<f64> {
    // a small linear congruential generator: enough to fill a matrix, and repeatable
    let mut state = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    DMatrix::from_fn(rows, cols, |_, _| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    })
}

fn close(a: &DMatrix<f64>, b: &DMatrix<f64>) -> bool {
    a.shape() == b.shape() && (a - b).amax() <= 1e-12 * (1.0 + b.amax())
}

/// op(M) is `rows × cols`.
fn stored(trans: u8, op: &DMatrix<f64>) -> DMatrix<f64> {
    if trans == b'N' { op.clone() } else { op.transpose() }
}

const SIZES: [usize; 6] = [1, 2, 3, 5, 17, 40];

#[test]
fn products_agree_in_every_transposition() {
    for (k, &n) in SIZES.iter().enumerate() {
        let (m, inner) = (SIZES[(k + 1) % 6], SIZES[(k + 2) % 6]);
        for ta in [b'N', b'T', b'c'] {
            for tb in [b'N', b't'] {
                for (alpha, beta) in [(1.0, 0.0), (0.7, 1.0), (-2.0, 0.5)] {
                    let (a, b, c0) = (entries(1, m, inner), entries(2, inner, n), entries(3, m, n));
                    let (pa, pb) =
                        (Padded::new(&stored(ta, &a), 2), Padded::new(&stored(tb.to_ascii_uppercase(), &b), 1));
                    let mut pc = Padded::new(&c0, 3);
                    let (m, n, k) = (m as c_int, n as c_int, inner as c_int);
                    unsafe {
                        dgemm_(
                            &c(ta),
                            &c(tb),
                            &m,
                            &n,
                            &k,
                            &alpha,
                            pa.data.as_ptr(),
                            &pa.ld,
                            pb.data.as_ptr(),
                            &pb.ld,
                            &beta,
                            pc.data.as_mut_ptr(),
                            &pc.ld,
                        );
                    }
                    assert!(close(&pc.matrix(), &(&a * &b * alpha + c0 * beta)));
                }
            }
        }
    }
}

#[test]
fn zero_beta_overwrites_nan() {
    let (a, nan) = (entries(1, 4, 4), DMatrix::from_element(4, 4, f64::NAN));
    let mut pc = Padded::new(&nan, 0);
    let (n, one, zero) = (4, 1.0, 0.0);
    unsafe {
        dgemm_(&c(b'N'), &c(b'N'), &n, &n, &n, &one, a.as_ptr(), &n, a.as_ptr(), &n, &zero, pc.data.as_mut_ptr(), &n);
    }
    assert!(close(&pc.matrix(), &(&a * &a)));
}

#[test]
fn rank_updates_touch_one_triangle() {
    for &n in &SIZES {
        for &k in &SIZES {
            for uplo in [b'U', b'L'] {
                for trans in [b'N', b'T'] {
                    let (a, b, c0) = (entries(4, n, k), entries(5, n, k), entries(6, n, n));
                    let (pa, pb) = (Padded::new(&stored(trans, &a), 1), Padded::new(&stored(trans, &b), 2));
                    let (mut one, mut two) = (Padded::new(&c0, 1), Padded::new(&c0, 1));
                    let (ni, ki, alpha, beta) = (n as c_int, k as c_int, 1.5, 0.25);
                    unsafe {
                        dsyrk_(
                            &c(uplo),
                            &c(trans),
                            &ni,
                            &ki,
                            &alpha,
                            pa.data.as_ptr(),
                            &pa.ld,
                            &beta,
                            one.data.as_mut_ptr(),
                            &one.ld,
                        );
                        dsyr2k_(
                            &c(uplo),
                            &c(trans),
                            &ni,
                            &ki,
                            &alpha,
                            pa.data.as_ptr(),
                            &pa.ld,
                            pb.data.as_ptr(),
                            &pb.ld,
                            &beta,
                            two.data.as_mut_ptr(),
                            &two.ld,
                        );
                    }
                    let keep = |full: DMatrix<f64>| {
                        DMatrix::from_fn(n, n, |i, j| {
                            let inside = if uplo == b'U' { i <= j } else { i >= j };
                            if inside { full[(i, j)] } else { c0[(i, j)] }
                        })
                    };
                    let (ab, aa) = (&a * b.transpose(), &a * a.transpose());
                    assert!(close(&one.matrix(), &keep(&aa * alpha + &c0 * beta)));
                    assert!(close(&two.matrix(), &keep((&ab + ab.transpose()) * alpha + &c0 * beta)));
                }
            }
        }
    }
}

#[test]
fn cholesky_factors_and_solves_from_either_triangle() {
    for &n in &SIZES {
        let half = entries(7, n, n);
        let spd = &half * half.transpose() + DMatrix::identity(n, n);
        let rhs = entries(8, n, 3);
        for uplo in [b'U', b'L'] {
            // the triangle that is not given holds rubbish and keeps it
            let given = DMatrix::from_fn(n, n, |i, j| {
                if (uplo == b'U' && i <= j) || (uplo == b'L' && i >= j) { spd[(i, j)] } else { -7.0 }
            });
            let (mut a, mut b) = (Padded::new(&given, 2), Padded::new(&rhs, 1));
            let (ni, nrhs, mut info) = (n as c_int, 3, -9);
            unsafe { dpotrf_(&c(uplo), &ni, a.data.as_mut_ptr(), &a.ld, &mut info) };
            assert_eq!(info, 0);
            let f = a.matrix();
            let lower = DMatrix::from_fn(n, n, |i, j| match (i >= j, uplo) {
                (true, b'L') => f[(i, j)],
                (true, _) => f[(j, i)],
                (false, _) => 0.0,
            });
            assert!(close(&(&lower * lower.transpose()), &spd));
            for i in 0..n {
                for j in 0..n {
                    assert!(!((uplo == b'U' && i > j) || (uplo == b'L' && i < j)) || f[(i, j)] == -7.0);
                }
            }
            unsafe {
                dpotrs_(&c(uplo), &ni, &nrhs, a.data.as_ptr(), &a.ld, b.data.as_mut_ptr(), &b.ld, &mut info);
            }
            assert_eq!(info, 0);
            assert!(close(&(&spd * b.matrix()), &rhs));
        }
    }
}

#[test]
fn cholesky_names_the_first_bad_minor() {
    for (bad, value) in [(0, -1.0), (2, 0.0), (4, -3.0), (1, f64::NAN)] {
        let mut d = DMatrix::<f64>::identity(5, 5);
        d[(bad, bad)] = value;
        let (n, mut info) = (5, 0);
        unsafe { dpotrf_(&c(b'L'), &n, d.as_mut_ptr(), &n, &mut info) };
        assert_eq!(info, bad as c_int + 1);
    }
}

/// Calls as Clarabel does: first the workspace query, then the work.
fn syevr(a: &DMatrix<f64>, jobz: u8, uplo: u8) -> (c_int, Vec<f64>, DMatrix<f64>) {
    let n = a.nrows();
    let (mut pa, mut z) = (Padded::new(a, 1), DMatrix::zeros(n, n));
    let (ni, mut w, mut found, mut info) = (n as c_int, vec![0.0; n], 0, 0);
    let (mut work, mut iwork, mut isuppz) = (vec![0.0], vec![0], vec![0; 2 * n]);
    let (bound, index, tolerance) = (0.0, 0, -1.0);
    let mut lengths = (-1, -1);
    for _ in 0..2 {
        unsafe {
            dsyevr_(
                &c(jobz),
                &c(b'A'),
                &c(uplo),
                &ni,
                pa.data.as_mut_ptr(),
                &pa.ld,
                &bound,
                &bound,
                &index,
                &index,
                &tolerance,
                &mut found,
                w.as_mut_ptr(),
                z.as_mut_ptr(),
                &ni,
                isuppz.as_mut_ptr(),
                work.as_mut_ptr(),
                &lengths.0,
                iwork.as_mut_ptr(),
                &lengths.1,
                &mut info,
            );
        }
        if info != 0 {
            break;
        }
        lengths = (work[0] as c_int, iwork[0]);
        work.resize(lengths.0 as usize, 0.0);
        iwork.resize(lengths.1 as usize, 0);
    }
    (info, w, z)
}

#[test]
fn eigenvalues_ascend_and_vectors_diagonalise() {
    for &n in &SIZES {
        let half = entries(9, n, n);
        let a = &half + half.transpose();
        let mut expected: Vec<f64> = a.clone().symmetric_eigen().eigenvalues.iter().copied().collect();
        expected.sort_by(f64::total_cmp);
        for uplo in [b'U', b'L'] {
            for jobz in [b'N', b'V'] {
                let (info, w, z) = syevr(&a, jobz, uplo);
                assert_eq!(info, 0);
                assert!(w.iter().zip(&expected).all(|(x, y)| (x - y).abs() < 1e-11 * n as f64));
                if jobz == b'V' {
                    let d = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(w));
                    assert!((&a * &z - &z * d).amax() < 1e-11 * n as f64);
                    assert!((z.transpose() * &z - DMatrix::identity(n, n)).amax() < 1e-12 * n as f64);
                }
            }
        }
    }
}

#[test]
fn eigenvalues_of_what_is_not_finite_are_refused() {
    let mut a = DMatrix::<f64>::identity(4, 4);
    a[(1, 2)] = f64::NAN;
    a[(2, 1)] = f64::NAN;
    assert_eq!(syevr(&a, b'V', b'U').0, 1);
}

fn gesvd(a: &DMatrix<f64>, jobu: u8, jobvt: u8, divide: bool) -> (c_int, Vec<f64>, DMatrix<f64>, DMatrix<f64>) {
    let (m, n) = a.shape();
    let k = m.min(n);
    let shape = |job, all| vectors_wanted(job, all, k).unwrap_or(0);
    let mut pa = Padded::new(a, 1);
    let mut u = Padded::new(&DMatrix::zeros(m, shape(jobu, m)), 2);
    let mut vt = Padded::new(&DMatrix::zeros(shape(jobvt, n), n), 1);
    let (mut s, mut work, mut iwork, mut info) = (vec![0.0; k], vec![0.0], vec![0; 8 * k], 0);
    let (mi, ni, mut lwork) = (m as c_int, n as c_int, -1);
    for _ in 0..2 {
        let (pa_, pu, pvt) = (pa.data.as_mut_ptr(), u.data.as_mut_ptr(), vt.data.as_mut_ptr());
        let (ps, pw) = (s.as_mut_ptr(), work.as_mut_ptr());
        unsafe {
            if divide {
                dgesdd_(
                    &c(jobu),
                    &mi,
                    &ni,
                    pa_,
                    &pa.ld,
                    ps,
                    pu,
                    &u.ld,
                    pvt,
                    &vt.ld,
                    pw,
                    &lwork,
                    iwork.as_mut_ptr(),
                    &mut info,
                );
            } else {
                dgesvd_(&c(jobu), &c(jobvt), &mi, &ni, pa_, &pa.ld, ps, pu, &u.ld, pvt, &vt.ld, pw, &lwork, &mut info);
            }
        }
        if info != 0 {
            break;
        }
        lwork = work[0] as c_int;
        work.resize(lwork as usize, 0.0);
    }
    (info, s, u.matrix(), vt.matrix())
}

#[test]
fn singular_values_and_vectors_rebuild_the_matrix() {
    for (m, n) in [(1, 1), (4, 4), (17, 17), (6, 3), (3, 6), (40, 21)] {
        let a = entries(10, m, n);
        let expected = a.clone().singular_values();
        let k = m.min(n);
        for (jobu, jobvt, divide) in
            [(b'S', b'S', true), (b'A', b'A', true), (b'N', b'N', true), (b'S', b'A', false), (b'A', b'N', false)]
        {
            let (info, s, u, vt) = gesvd(&a, jobu, jobvt, divide);
            assert_eq!(info, 0);
            let mut sorted: Vec<f64> = expected.iter().copied().collect();
            sorted.sort_by(|x, y| y.total_cmp(x));
            assert!(s.iter().zip(&sorted).all(|(x, y)| (x - y).abs() < 1e-11));
            if jobvt != b'N' && jobu != b'N' {
                let d = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(s));
                assert!((u.columns(0, k) * d * vt.rows(0, k) - &a).amax() < 1e-11);
            }
        }
    }
}

#[test]
fn jobs_outside_the_contract_are_refused() {
    let a = entries(11, 3, 3);
    assert_eq!(gesvd(&a, b'O', b'O', true).0, -1);
    assert_eq!(gesvd(&a, b'S', b'O', false).0, -2);
    let mut bad = a.clone();
    bad[(0, 0)] = f64::INFINITY;
    assert_eq!(gesvd(&bad, b'S', b'S', true).0, 1);
}

proptest! {
    #[test]
    fn a_factor_of_any_positive_matrix_solves_it(n in 1usize..30, seed in any::<u64>(), lift in 1e-6..1e3_f64) {
        let half = entries(seed, n, n);
        let spd = &half * half.transpose() + DMatrix::identity(n, n) * lift;
        let x = entries(seed ^ 1, n, 1);
        let (mut f, mut b) = (spd.clone(), &spd * &x);
        let (ni, one, mut info) = (n as c_int, 1, 0);
        unsafe {
            dpotrf_(&c(b'L'), &ni, f.as_mut_ptr(), &ni, &mut info);
            prop_assert_eq!(info, 0);
            dpotrs_(&c(b'L'), &ni, &one, f.as_ptr(), &ni, b.as_mut_ptr(), &ni, &mut info);
        }
        // relative error ≤ condition × rounding
        prop_assert!((b - x).amax() < 1e-13 * n as f64 * (spd.amax() / lift + 1.0) * n as f64);
    }
}
