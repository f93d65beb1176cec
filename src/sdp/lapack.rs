//! The eight BLAS and LAPACK routines that Clarabel's semidefinite cone calls, over `faer`.
//!
//! Clarabel declares them as Fortran symbols and leaves the library to the final program. Defining them here keeps the
//! program pure Rust: no system library, no C compiler, no Fortran. The feature `system-openblas` leaves this file out
//! and links OpenBLAS instead.
//!
//! Conventions are Fortran's: column-major storage with a leading dimension, every argument by pointer, `lwork = −1`
//! asks for the workspace size (faer brings its own, so the answer is always 1), `info = −k` names the first bad
//! argument, `info > 0` a numerical failure. Only what Clarabel can ask for is provided; the rest is refused through
//! `info`. Nothing here panics: unwinding out of an `extern "C"` function would abort the process.

use core::ffi::{c_char, c_int};
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::{matmul, triangular, triangular::BlockStructure};
use faer::linalg::{evd, svd};
use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, MatMut, MatRef, Par, Spec};

/// Referenced by the bridge, so that a linker that scans archives once takes this object before it meets Clarabel.
pub(super) fn keep_linked() {
    std::hint::black_box((dgemm_ as *const (), dpotrf_ as *const (), dsyevr_ as *const (), dgesdd_ as *const ()));
}

/// A Fortran character argument, upper case.
///
/// # Safety
/// `c` points to a readable character.
unsafe fn letter(c: *const c_char) -> u8 {
    (unsafe { *c } as u8).to_ascii_uppercase()
}

/// A Fortran integer argument as a size; negative counts as nothing to do.
///
/// # Safety
/// `n` points to a readable integer.
unsafe fn size(n: *const c_int) -> usize {
    usize::try_from(unsafe { *n }).unwrap_or(0)
}

/// # Safety
/// `p` points to a readable column-major `rows × cols` matrix whose columns lie `ld ≥ rows` numbers apart.
unsafe fn view<'a>(p: *const f64, rows: usize, cols: usize, ld: *const c_int) -> MatRef<'a, f64> {
    unsafe { MatRef::from_raw_parts(p, rows, cols, 1, *ld as isize) }
}

/// # Safety
/// As [`view`], writable and not aliased.
unsafe fn view_mut<'a>(p: *mut f64, rows: usize, cols: usize, ld: *const c_int) -> MatMut<'a, f64> {
    unsafe { MatMut::from_raw_parts_mut(p, rows, cols, 1, *ld as isize) }
}

/// `op(M)`, `rows × cols` after the operation: the matrix itself for `N`, its transpose for `T` and `C`.
///
/// # Safety
/// As [`view`] for the stored shape.
unsafe fn operand<'a>(trans: u8, p: *const f64, rows: usize, cols: usize, ld: *const c_int) -> MatRef<'a, f64> {
    unsafe { if trans == b'N' { view(p, rows, cols, ld) } else { view(p, cols, rows, ld).transpose() } }
}

/// Multiplies by β and says how the product is to be added. β = 0 overwrites without reading, NaN included.
fn scale(mut c: MatMut<'_, f64>, beta: f64, touched: BlockStructure) -> Accum {
    if beta == 0.0 {
        return Accum::Replace;
    }
    if beta != 1.0 {
        for j in 0..c.ncols() {
            let rows = match touched {
                BlockStructure::TriangularUpper => 0..j + 1,
                BlockStructure::TriangularLower => j..c.nrows(),
                _ => 0..c.nrows(),
            };
            for i in rows {
                c[(i, j)] *= beta;
            }
        }
    }
    Accum::Add
}

fn triangle(uplo: u8) -> BlockStructure {
    if uplo == b'U' { BlockStructure::TriangularUpper } else { BlockStructure::TriangularLower }
}

/// C ← α·op(A)·op(B) + β·C.
///
/// # Safety
/// BLAS's contract: pointers to matrices of the stated shapes, C apart from A and B.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgemm_(
    transa: *const c_char,
    transb: *const c_char,
    m: *const c_int,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    b: *const f64,
    ldb: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    unsafe {
        let (m, n, k) = (size(m), size(n), size(k));
        let a = operand(letter(transa), a, m, k, lda);
        let b = operand(letter(transb), b, k, n, ldb);
        let mut c = view_mut(c, m, n, ldc);
        let accum = scale(c.rb_mut(), *beta, BlockStructure::Rectangular);
        matmul(c, accum, a, b, *alpha, Par::Seq);
    }
}

/// One triangle of C ← α·op(A)·op(A)ᵀ + β·C, with op(A) `n × k`.
///
/// # Safety
/// BLAS's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyrk_(
    uplo: *const c_char,
    trans: *const c_char,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    unsafe {
        let (n, k, half) = (size(n), size(k), triangle(letter(uplo)));
        let a = operand(letter(trans), a, n, k, lda);
        let mut c = view_mut(c, n, n, ldc);
        let accum = scale(c.rb_mut(), *beta, half);
        let all = BlockStructure::Rectangular;
        triangular::matmul(c, half, accum, a, all, a.transpose(), all, *alpha, Par::Seq);
    }
}

/// One triangle of C ← α·op(A)·op(B)ᵀ + α·op(B)·op(A)ᵀ + β·C, with op(A), op(B) `n × k`.
///
/// # Safety
/// BLAS's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyr2k_(
    uplo: *const c_char,
    trans: *const c_char,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    b: *const f64,
    ldb: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    unsafe {
        let (n, k, half) = (size(n), size(k), triangle(letter(uplo)));
        let a = operand(letter(trans), a, n, k, lda);
        let b = operand(letter(trans), b, n, k, ldb);
        let mut c = view_mut(c, n, n, ldc);
        let accum = scale(c.rb_mut(), *beta, half);
        let all = BlockStructure::Rectangular;
        triangular::matmul(c.rb_mut(), half, accum, a, all, b.transpose(), all, *alpha, Par::Seq);
        triangular::matmul(c, half, Accum::Add, b, all, a.transpose(), all, *alpha, Par::Seq);
    }
}

/// Cholesky factor in place: A = LLᵀ (`L`) or UᵀU (`U`). `info = k` when the leading minor of order k is not positive.
///
/// # Safety
/// LAPACK's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dpotrf_(
    uplo: *const c_char,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    info: *mut c_int,
) {
    unsafe {
        let n = size(n);
        let stored = view_mut(a, n, n, lda);
        // U = Lᵀ: the transposed view of an upper factor is a lower one
        let mut lower = if letter(uplo) == b'U' { stored.transpose_mut() } else { stored };
        // faer uses the other triangle as workspace, LAPACK's callers rely on it being left alone: factor a copy
        let mut factor = Mat::from_fn(n, n, |i, j| if i >= j { lower[(i, j)] } else { 0.0 });
        let mut memory = MemBuffer::new(llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default()));
        let stack = MemStack::new(&mut memory);
        let done =
            llt::factor::cholesky_in_place(factor.as_mut(), Default::default(), Par::Seq, stack, Spec::default());
        *info = match done {
            Ok(_) => 0,
            Err(llt::factor::LltError::NonPositivePivot { index }) => index as c_int + 1,
        };
        for j in 0..n {
            for i in j..n {
                lower[(i, j)] = factor[(i, j)];
            }
        }
    }
}

/// Solves A·X = B in place of B, with the factor that [`dpotrf_`] left.
///
/// # Safety
/// LAPACK's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dpotrs_(
    uplo: *const c_char,
    n: *const c_int,
    nrhs: *const c_int,
    a: *const f64,
    lda: *const c_int,
    b: *mut f64,
    ldb: *const c_int,
    info: *mut c_int,
) {
    unsafe {
        let (n, nrhs) = (size(n), size(nrhs));
        let stored = view(a, n, n, lda);
        let lower = if letter(uplo) == b'U' { stored.transpose() } else { stored };
        let mut memory = MemBuffer::new(llt::solve::solve_in_place_scratch::<f64>(n, nrhs, Par::Seq));
        llt::solve::solve_in_place(lower, view_mut(b, n, nrhs, ldb), Par::Seq, MemStack::new(&mut memory));
        *info = 0;
    }
}

/// All eigenvalues (ascending) and, with `jobz = V`, eigenvectors of a symmetric matrix of which one triangle is
/// stored. `range` other than `A` is refused (`info = −2`); input that is not finite gives `info = 1`.
///
/// # Safety
/// LAPACK's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyevr_(
    jobz: *const c_char,
    range: *const c_char,
    uplo: *const c_char,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    _vl: *const f64,
    _vu: *const f64,
    _il: *const c_int,
    _iu: *const c_int,
    _abstol: *const f64,
    m: *mut c_int,
    w: *mut f64,
    z: *mut f64,
    ldz: *const c_int,
    isuppz: *mut c_int,
    work: *mut f64,
    lwork: *const c_int,
    iwork: *mut c_int,
    liwork: *const c_int,
    info: *mut c_int,
) {
    unsafe {
        *info = 0;
        if letter(range) != b'A' {
            *info = -2;
            return;
        }
        if *lwork == -1 || *liwork == -1 {
            *work = 1.0;
            *iwork = 1;
            return;
        }
        let n = size(n);
        *m = n as c_int;
        if n == 0 {
            return;
        }
        let stored = view(a, n, n, lda);
        let lower = if letter(uplo) == b'U' { stored.transpose() } else { stored };
        if !(0..n).all(|j| (j..n).all(|i| lower[(i, j)].is_finite())) {
            *info = 1;
            return;
        }
        let vectors = letter(jobz) == b'V';
        let want = if vectors { evd::ComputeEigenvectors::Yes } else { evd::ComputeEigenvectors::No };
        let scratch = evd::self_adjoint_evd_scratch::<f64>(n, want, Par::Seq, Spec::default());
        let mut memory = MemBuffer::new(scratch);
        let mut values = Diag::<f64>::zeros(n);
        let into = vectors.then(|| view_mut(z, n, n, ldz));
        let stack = MemStack::new(&mut memory);
        if evd::self_adjoint_evd(lower, values.as_mut(), into, Par::Seq, stack, Spec::default()).is_err() {
            *info = 1;
            return;
        }
        for i in 0..n {
            *w.add(i) = values[i];
            // every eigenvector is dense: its support is 1..n
            if vectors {
                *isuppz.add(2 * i) = 1;
                *isuppz.add(2 * i + 1) = n as c_int;
            }
        }
    }
}

/// How many left and right singular vectors a job letter asks for: none, the first min(m, n), or all.
fn vectors_wanted(job: u8, all: usize, thin: usize) -> Option<usize> {
    match job {
        b'N' => Some(0),
        b'S' => Some(thin),
        b'A' => Some(all),
        _ => None,
    }
}

/// A = U·diag(s)·Vᵀ into the caller's arrays; `cols_u` and `rows_vt` are 0, min(m, n) or full.
///
/// # Safety
/// As LAPACK's `dgesvd`.
unsafe fn factor_svd(
    a: MatRef<'_, f64>,
    s: *mut f64,
    (u, cols_u, ldu): (*mut f64, usize, *const c_int),
    (vt, rows_vt, ldvt): (*mut f64, usize, *const c_int),
) -> c_int {
    let (m, n) = a.shape();
    let k = m.min(n);
    if !(0..n).all(|j| (0..m).all(|i| a[(i, j)].is_finite())) {
        return 1;
    }
    let want = |count: usize, all: usize| match count {
        0 => svd::ComputeSvdVectors::No,
        c if c == all => svd::ComputeSvdVectors::Full,
        _ => svd::ComputeSvdVectors::Thin,
    };
    let mut memory =
        MemBuffer::new(svd::svd_scratch::<f64>(m, n, want(cols_u, m), want(rows_vt, n), Par::Seq, Spec::default()));
    let mut values = Diag::<f64>::zeros(k);
    // faer gives V; its transposed view is the caller's Vᵀ
    let (into_u, into_v) = unsafe {
        (
            (cols_u > 0).then(|| view_mut(u, m, cols_u, ldu)),
            (rows_vt > 0).then(|| view_mut(vt, rows_vt, n, ldvt).transpose_mut()),
        )
    };
    let stack = MemStack::new(&mut memory);
    if svd::svd(a, values.as_mut(), into_u, into_v, Par::Seq, stack, Spec::default()).is_err() {
        return 1;
    }
    for i in 0..k {
        unsafe { *s.add(i) = values[i] };
    }
    0
}

/// Singular value decomposition, `jobz` one of `N`, `S`, `A` for both sides (`O` is refused: `info = −1`).
///
/// # Safety
/// LAPACK's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgesdd_(
    jobz: *const c_char,
    m: *const c_int,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    s: *mut f64,
    u: *mut f64,
    ldu: *const c_int,
    vt: *mut f64,
    ldvt: *const c_int,
    work: *mut f64,
    lwork: *const c_int,
    _iwork: *mut c_int,
    info: *mut c_int,
) {
    // both sides the same: the argument serves for both letters
    unsafe { dgesvd_(jobz, jobz, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, info) }
}

/// Singular value decomposition with a job letter per side, each one of `N`, `S`, `A`.
///
/// # Safety
/// LAPACK's contract.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgesvd_(
    jobu: *const c_char,
    jobvt: *const c_char,
    m: *const c_int,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    s: *mut f64,
    u: *mut f64,
    ldu: *const c_int,
    vt: *mut f64,
    ldvt: *const c_int,
    work: *mut f64,
    lwork: *const c_int,
    info: *mut c_int,
) {
    unsafe {
        *info = 0;
        let (m, n) = (size(m), size(n));
        let Some(cols_u) = vectors_wanted(letter(jobu), m, m.min(n)) else {
            *info = -1;
            return;
        };
        let Some(rows_vt) = vectors_wanted(letter(jobvt), n, m.min(n)) else {
            *info = -2;
            return;
        };
        if *lwork == -1 {
            *work = 1.0;
            return;
        }
        if m.min(n) > 0 {
            *info = factor_svd(view(a, m, n, lda), s, (u, cols_u, ldu), (vt, rows_vt, ldvt));
        }
    }
}

#[cfg(test)]
mod tests {
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
            dgemm_(
                &c(b'N'),
                &c(b'N'),
                &n,
                &n,
                &n,
                &one,
                a.as_ptr(),
                &n,
                a.as_ptr(),
                &n,
                &zero,
                pc.data.as_mut_ptr(),
                &n,
            );
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
                    dgesvd_(
                        &c(jobu),
                        &c(jobvt),
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
                        &mut info,
                    );
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
}
