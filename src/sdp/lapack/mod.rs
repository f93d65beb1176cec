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
mod tests;
