//! Cholesky's factorization of a positive definite Hermitian band matrix, in the place of the band, from both ends at once.
//!
//! The band is cut before its middle: the columns before the cut are eliminated downwards, those behind it upwards, on two
//! threads if there are two, and the `half` columns between them last. The cut does not depend on the threads, so neither
//! do the bits. The upper end is kept reversed (rows and columns counted from the other side), where upwards is downwards.
//!
//! Columns are stored one after the other, real parts and then imaginary parts, from the diagonal down: every step is a
//! run of vector operations over a column. Four columns at a time are brought up to date with all columns that reach them
//! (left-looking), so a column is written once.
//!
//! Reference: G. H. Golub and C. F. Van Loan, *Matrix Computations*, 4th ed., 2013, section 4.3.5; LAPACK's `zpbtrf` is the
//! yardstick of the benchmarks.

use super::Complex;
use crate::error::{Error, Result};
use pulp::{Arch, Simd, WithSimd};

/// Zeros kept below each column, so that a vector may reach beyond the band.
const MARGIN: usize = 7;
/// Columns brought up to date together.
const TOGETHER: usize = 4;

/// One end of the matrix: some columns of the band and the part of the factor that takes their place.
#[derive(Clone)]
struct Side {
    half: usize,
    /// Columns that are eliminated here; those behind them only collect what the elimination leaves.
    own: usize,
    data: Vec<f64>,
}

/// A Hermitian band matrix, to be filled.
#[derive(Clone)]
pub struct BandedHermitian {
    n: usize,
    lower: Side,
    upper: Side,
}

/// Its factor.
pub struct BandedFactor {
    band: BandedHermitian,
}

impl BandedHermitian {
    /// Zero, `n` by `n`, with `half` diagonals on either side of the main one.
    pub fn new(n: usize, half: usize) -> Self {
        let upper = n.saturating_sub(half) / 2;
        let side = |columns: usize, own| Side { half, own, data: vec![0.0; columns * 2 * (half + 1 + MARGIN)] };
        Self { n, lower: side(n - upper, n - upper), upper: side(if upper > 0 { upper + half } else { 0 }, upper) }
    }

    /// Adds `value` to the entry (`i`, `j`) with `i >= j`, and its conjugate to (`j`, `i`).
    ///
    /// # Panics
    /// Outside the band.
    pub fn add(&mut self, i: usize, j: usize, value: Complex) {
        assert!(i < self.n && j <= i && i - j <= self.lower.half, "entry ({i}, {j}) is outside the lower band");
        if i < self.lower.own {
            self.lower.add(j, i - j, value);
        } else {
            self.upper.add(self.n - 1 - i, i - j, value.conj());
        }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.n
    }

    /// Bytes of the storage; the band itself has 16 (half + 1) n.
    pub fn bytes(&self) -> usize {
        8 * (self.lower.data.len() + self.upper.data.len())
    }

    /// The factor, in the place of the matrix.
    ///
    /// # Errors
    /// `NoConvergence` when the matrix is not positive definite to rounding; the message names the column.
    pub fn factor(mut self) -> Result<BandedFactor> {
        let (n, half) = (self.n, self.lower.half);
        let (lower, upper) = (&mut self.lower, &mut self.upper);
        let (first, behind) = (lower.own.saturating_sub(half), upper.own);
        let (down, up) = rayon::join(|| lower.eliminate(0..first), || upper.eliminate(0..behind));
        let wrong = |column: usize| Error::NoConvergence {
            method: format!("Cholesky's factorization of a band (column {column} of {n})"),
            iterations: column,
            residual: f64::NAN,
            advice: "the matrix is not positive definite to rounding: the data leave unknowns there undetermined"
                .into(),
        };
        down.map_err(wrong)?;
        up.map_err(|column| wrong(n - 1 - column))?;
        if behind > 0 {
            upper.collect();
            for a in 0..half {
                for b in a..half {
                    let value = upper.get(behind + a, b - a);
                    lower.add(n - 1 - behind - b, b - a, value.conj());
                }
            }
        }
        lower.eliminate(first..lower.own).map_err(wrong)?;
        Ok(BandedFactor { band: self })
    }
}

impl BandedFactor {
    /// Solves in place, for one right hand side (n).
    ///
    /// # Errors
    /// `Shape`.
    pub fn solve(&self, b: &mut [Complex]) -> Result<()> {
        let BandedHermitian { n, lower, upper } = &self.band;
        if b.len() != *n {
            return Err(Error::Shape { what: "right hand side of a band".into(), expected: *n, found: b.len() });
        }
        let (half, own, behind) = (lower.half, lower.own, upper.own);
        let first = own.saturating_sub(half);
        let mut x = Column::new(b[..own].iter().copied(), half);
        let mut z = Column::new(b[own..].iter().rev().copied(), 2 * half);
        rayon::join(|| lower.forward(&mut x, 0..first), || upper.forward(&mut z, 0..behind));
        if behind > 0 {
            (0..half).for_each(|a| x.set(own - 1 - a, x.get(own - 1 - a) + z.get(behind + a)));
        }
        lower.forward(&mut x, first..own);
        lower.back(&mut x, first..own);
        if behind > 0 {
            (0..half).for_each(|a| z.set(behind + a, x.get(own - 1 - a)));
        }
        rayon::join(|| lower.back(&mut x, 0..first), || upper.back(&mut z, 0..behind));
        for (i, b) in b.iter_mut().enumerate() {
            *b = if i < own { x.get(i) } else { z.get(n - 1 - i) };
        }
        Ok(())
    }

    /// Logarithm of the determinant.
    pub fn log_determinant(&self) -> f64 {
        let of = |side: &Side| (0..side.own).map(|j| 2.0 * side.get(j, 0).re.ln()).sum::<f64>();
        of(&self.band.lower) + of(&self.band.upper)
    }
}

/// A right hand side: real and imaginary parts apart, and room behind.
struct Column {
    stride: usize,
    data: Vec<f64>,
}

impl Column {
    fn new(values: impl ExactSizeIterator<Item = Complex>, room: usize) -> Self {
        let stride = values.len() + room + MARGIN + 1;
        let mut data = vec![0.0; 2 * stride];
        for (i, v) in values.enumerate() {
            data[i] = v.re;
            data[stride + i] = v.im;
        }
        Self { stride, data }
    }

    fn get(&self, i: usize) -> Complex {
        Complex::new(self.data[i], self.data[self.stride + i])
    }

    fn set(&mut self, i: usize, value: Complex) {
        self.data[i] = value.re;
        self.data[self.stride + i] = value.im;
    }
}

impl Side {
    fn stride(&self) -> usize {
        self.half + 1 + MARGIN
    }

    fn add(&mut self, column: usize, below: usize, value: Complex) {
        let stride = self.stride();
        self.data[2 * column * stride + below] += value.re;
        self.data[(2 * column + 1) * stride + below] += value.im;
    }

    fn get(&self, column: usize, below: usize) -> Complex {
        let stride = self.stride();
        Complex::new(self.data[2 * column * stride + below], self.data[(2 * column + 1) * stride + below])
    }

    /// Eliminates these columns; all before them are. The error is the column without a positive pivot.
    fn eliminate(&mut self, columns: std::ops::Range<usize>) -> std::result::Result<(), usize> {
        let end = columns.end;
        Arch::new().dispatch(Eliminate { side: self, columns, pivots: end })
    }

    /// Brings the columns behind the own ones up to date with them.
    fn collect(&mut self) {
        let (own, end) = (self.own, self.own + self.half);
        // no column of this range is a pivot, so none can be wrong
        let _ = Arch::new().dispatch(Eliminate { side: self, columns: own..end, pivots: own });
    }

    fn forward(&self, x: &mut Column, columns: std::ops::Range<usize>) {
        Arch::new().dispatch(Substitute::<false> { side: self, x, columns });
    }

    fn back(&self, x: &mut Column, columns: std::ops::Range<usize>) {
        Arch::new().dispatch(Substitute::<true> { side: self, x, columns });
    }
}

/// Brings `columns` up to date with the columns before them that are `pivots` (below that number), and eliminates those that
/// are pivots themselves.
struct Eliminate<'a> {
    side: &'a mut Side,
    columns: std::ops::Range<usize>,
    pivots: usize,
}

impl WithSimd for Eliminate<'_> {
    type Output = std::result::Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Side { half, data, .. } = self.side;
        let (half, stride) = (*half, *half + 1 + MARGIN);
        let rows = (half + TOGETHER).div_ceil(8) * 8;
        // four columns with a common first row, so that each earlier column is read once for all four
        let mut work = vec![0.0; TOGETHER * 2 * rows];
        let mut from = self.columns.start;
        while from < self.columns.end {
            let count = TOGETHER.min(self.columns.end - from);
            work.fill(0.0);
            for (b, column) in work.chunks_exact_mut(2 * rows).enumerate().take(count) {
                let stored = &data[2 * (from + b) * stride..][..2 * stride];
                let (re, im) = column.split_at_mut(rows);
                re[b..=b + half].copy_from_slice(&stored[..=half]);
                im[b..=b + half].copy_from_slice(&stored[stride..=stride + half]);
            }
            for c in (0..rows).step_by(S::F64_LANES) {
                let first = (from + c).saturating_sub(half);
                update::<S>(simd, &mut work, (rows, c), data, (stride, first..from.min(self.pivots)), from);
            }
            for b in 0..count {
                if from + b >= self.pivots {
                    break;
                }
                let (done, rest) = work.split_at_mut((b + 1) * 2 * rows);
                let (re, im) = done[2 * b * rows..].split_at_mut(rows);
                let pivot = re[b];
                if !(pivot > 0.0 && pivot.is_finite()) {
                    return Err(from + b);
                }
                let (root, inverse) = (pivot.sqrt(), pivot.sqrt().recip());
                re[b + 1..].iter_mut().chain(&mut im[b + 1..]).for_each(|v| *v *= inverse);
                re[b] = root;
                im[b] = 0.0;
                for (next, column) in rest.chunks_exact_mut(2 * rows).enumerate().take(count - b - 1) {
                    let (xr, xi) = (re[b + 1 + next], im[b + 1 + next]);
                    let (to_re, to_im) = column.split_at_mut(rows);
                    for ((to_re, to_im), (re, im)) in to_re.iter_mut().zip(to_im).zip(re.iter().zip(&*im)) {
                        *to_re -= re * xr + im * xi;
                        *to_im -= im * xr - re * xi;
                    }
                }
            }
            for (b, column) in work.chunks_exact(2 * rows).enumerate().take(count) {
                let stored = &mut data[2 * (from + b) * stride..][..2 * stride];
                stored[..=half].copy_from_slice(&column[b..=b + half]);
                stored[stride..=stride + half].copy_from_slice(&column[rows + b..=rows + b + half]);
            }
            from += count;
        }
        Ok(())
    }
}

/// `work[row, b] -= sum_p L[from + row, p] conj(L[from + b, p])` for the rows of one vector from `c` on.
#[inline(always)]
fn update<S: Simd>(
    simd: S,
    work: &mut [f64],
    (rows, c): (usize, usize),
    data: &[f64],
    (stride, pivots): (usize, std::ops::Range<usize>),
    from: usize,
) {
    let mut sums: [[S::f64s; 2]; TOGETHER] =
        std::array::from_fn(|b| [load::<S>(work, 2 * b * rows + c), load::<S>(work, (2 * b + 1) * rows + c)]);
    for p in pivots {
        let column = &data[2 * p * stride..][..2 * stride];
        let (re, im) = column.split_at(stride);
        let at = from - p;
        let (lr, li) = (load::<S>(re, at + c), load::<S>(im, at + c));
        let (fr, fi) = (&re[at..at + TOGETHER], &im[at..at + TOGETHER]);
        for b in 0..TOGETHER {
            let (xr, xi) = (simd.splat_f64s(fr[b]), simd.splat_f64s(fi[b]));
            let [sr, si] = sums[b];
            sums[b] = [
                simd.negate_mul_add_e_f64s(li, xi, simd.negate_mul_add_e_f64s(lr, xr, sr)),
                simd.mul_add_e_f64s(lr, xi, simd.negate_mul_add_e_f64s(li, xr, si)),
            ];
        }
    }
    for (b, [sr, si]) in sums.into_iter().enumerate() {
        store::<S>(work, 2 * b * rows + c, sr);
        store::<S>(work, (2 * b + 1) * rows + c, si);
    }
}

/// Forward (`L z = b`) or back (`L^H x = z`) substitution over some columns.
struct Substitute<'a, const BACK: bool> {
    side: &'a Side,
    x: &'a mut Column,
    columns: std::ops::Range<usize>,
}

impl<const BACK: bool> WithSimd for Substitute<'_, BACK> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (half, stride) = (self.side.half, self.side.stride());
        let (re, im) = self.x.data.split_at_mut(self.x.stride);
        let (start, count) = (self.columns.start, self.columns.len());
        let data = &self.side.data[2 * start * stride..][..2 * count * stride];
        let step = |j: usize, column: &[f64]| {
            let (lr, li) = column.split_at(stride);
            // the vectors below the diagonal: all of the band and perhaps some of the zeros behind it
            let chunks = half.div_ceil(S::F64_LANES);
            let (xr, xi) = (&mut re[j..], &mut im[j..]);
            if BACK {
                let zero = simd.splat_f64s(0.0);
                let mut sums = [zero; 4];
                for c in 0..chunks {
                    let at = 1 + c * S::F64_LANES;
                    let (a, b) = (load::<S>(lr, at), load::<S>(li, at));
                    let (x, y) = (load::<S>(xr, at), load::<S>(xi, at));
                    sums[0] = simd.mul_add_e_f64s(a, x, sums[0]);
                    sums[1] = simd.mul_add_e_f64s(b, y, sums[1]);
                    sums[2] = simd.mul_add_e_f64s(a, y, sums[2]);
                    sums[3] = simd.mul_add_e_f64s(b, x, sums[3]);
                }
                let known_re = simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]));
                let known_im = simd.reduce_sum_f64s(simd.sub_f64s(sums[2], sums[3]));
                xr[0] = (xr[0] - known_re) / lr[0];
                xi[0] = (xi[0] - known_im) / lr[0];
            } else {
                xr[0] /= lr[0];
                xi[0] /= lr[0];
                let (vr, vi) = (simd.splat_f64s(xr[0]), simd.splat_f64s(xi[0]));
                for c in 0..chunks {
                    let at = 1 + c * S::F64_LANES;
                    let (a, b) = (load::<S>(lr, at), load::<S>(li, at));
                    let (x, y) = (load::<S>(xr, at), load::<S>(xi, at));
                    let x = simd.mul_add_e_f64s(b, vi, simd.negate_mul_add_e_f64s(a, vr, x));
                    let y = simd.negate_mul_add_e_f64s(b, vr, simd.negate_mul_add_e_f64s(a, vi, y));
                    store::<S>(xr, at, x);
                    store::<S>(xi, at, y);
                }
            }
        };
        over::<BACK>(start, data, 2 * stride, step);
    }
}

/// Calls `step` for each column, forwards or backwards.
#[inline(always)]
fn over<const BACK: bool>(start: usize, data: &[f64], size: usize, mut step: impl FnMut(usize, &[f64])) {
    if BACK {
        data.chunks_exact(size).enumerate().rev().for_each(|(j, column)| step(start + j, column));
    } else {
        data.chunks_exact(size).enumerate().for_each(|(j, column)| step(start + j, column));
    }
}

#[inline(always)]
fn load<S: Simd>(values: &[f64], at: usize) -> S::f64s {
    S::as_simd_f64s(&values[at..at + S::F64_LANES]).0[0]
}

#[inline(always)]
fn store<S: Simd>(values: &mut [f64], at: usize, value: S::f64s) {
    S::as_mut_simd_f64s(&mut values[at..at + S::F64_LANES]).0[0] = value;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;
    use nalgebra::{DMatrix, DVector};

    /// A random positive definite band and the same as a dense matrix.
    fn random(n: usize, half: usize, seed: u64) -> (BandedHermitian, DMatrix<Complex>) {
        let mut random = SplitMix64::new(seed);
        let (mut band, mut dense) = (BandedHermitian::new(n, half), DMatrix::zeros(n, n));
        for j in 0..n {
            for i in j..(j + half + 1).min(n) {
                let mut value = Complex::new(random.normal(), random.normal());
                if i == j {
                    value = Complex::new(4.0 * (half + 1) as f64 + value.re, 0.0);
                }
                band.add(i, j, value);
                dense[(i, j)] = value;
                dense[(j, i)] = value.conj();
            }
        }
        (band, dense)
    }

    #[test]
    fn the_band_agrees_with_a_dense_solution() {
        for (n, half) in [(1, 0), (2, 1), (5, 0), (7, 3), (9, 8), (20, 3), (50, 7), (64, 12), (130, 42)] {
            let (band, dense) = random(n, half, n as u64);
            let mut b: Vec<Complex> = (0..n).map(|i| Complex::new(1.0 + (i as f64).sin(), 0.3 * i as f64)).collect();
            let expected = dense.clone().lu().solve(&DVector::from_vec(b.clone())).expect("regular");
            let factor = band.factor().expect("positive definite");
            factor.solve(&mut b).expect("sizes agree");
            for i in 0..n {
                assert!((b[i] - expected[i]).norm() < 1e-12 * expected.norm(), "{n} {half}: {i}");
            }
            let log = dense.determinant().re.ln();
            assert!(log.is_infinite() || (factor.log_determinant() - log).abs() < 1e-10 * log.abs(), "{n} {half}");
        }
    }

    #[test]
    fn threads_do_not_change_a_bit() {
        let solve = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| {
                let mut b: Vec<Complex> = (0..600).map(|i| Complex::new(1.0, i as f64)).collect();
                let (band, _) = random(600, 10, 5);
                band.factor().expect("positive definite").solve(&mut b).expect("sizes agree");
                b
            })
        };
        assert_eq!(solve(1), solve(2));
    }

    #[test]
    fn the_storage_is_hardly_more_than_the_band() {
        let band = BandedHermitian::new(100_000, 42);
        assert!(band.bytes() as f64 <= 1.2 * (16 * 43 * 100_000) as f64, "{}", band.bytes());
    }

    #[test]
    fn an_indefinite_band_is_refused_with_its_column() {
        for wrong in [0, 3, 20, 21, 22, 38, 39] {
            let mut band = BandedHermitian::new(40, 2);
            (0..40).for_each(|i| band.add(i, i, Complex::new(if i == wrong { -1.0 } else { 1.0 }, 0.0)));
            let Err(Error::NoConvergence { iterations, .. }) = band.factor() else { panic!("{wrong} went unseen") };
            assert!(iterations == wrong || (iterations == 39 - wrong && wrong > 20), "{iterations} for {wrong}");
        }
    }
}
