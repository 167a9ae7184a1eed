//! The 2n x 2n Hermitian matrix of levels and slopes, in four n x n blocks, and the few passes a sweep makes over it.
//!
//! Real and imaginary parts lie in rows of their own, padded to eight numbers, so that every pass is a run of vector
//! operations of the widest kind the machine has. The lower left block is kept although it is the mirror image of the upper
//! right one: the step `levels += slopes` then needs no transposition.

use crate::numeric::Complex;
use pulp::{Arch, Simd, WithSimd};

/// Numbers per row are a multiple of this.
const LANES: usize = 8;
/// Rows of one block row: level-level, level-slope, slope-level, slope-slope; real and imaginary.
const PLANES: usize = 8;

/// Room of a padded row of `n` numbers.
pub(super) fn padded(n: usize) -> usize {
    n.div_ceil(LANES) * LANES
}

/// A complex vector of `n` entries: real parts, then imaginary parts, each padded with zeros.
#[derive(Clone)]
pub(super) struct Vector {
    pub(super) stride: usize,
    pub(super) data: Vec<f64>,
}

impl Vector {
    pub(super) fn zero(n: usize) -> Self {
        let stride = padded(n);
        Self { stride, data: vec![0.0; 2 * stride] }
    }

    pub(super) fn get(&self, i: usize) -> Complex {
        Complex::new(self.data[i], self.data[self.stride + i])
    }

    pub(super) fn set(&mut self, i: usize, value: Complex) {
        self.data[i] = value.re;
        self.data[self.stride + i] = value.im;
    }

    pub(super) fn fill(&mut self, values: &[f64]) {
        self.data.copy_from_slice(values);
    }
}

/// `sum_i conj(a_i) b_i` of two padded vectors (real parts, then imaginary parts).
#[inline(always)]
pub(super) fn inner(a: &[f64], b: &[f64]) -> Complex {
    let stride = a.len() / 2;
    let ((ar, ai), (br, bi)) = (a.split_at(stride), b.split_at(stride));
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    let rows =
        ar.chunks_exact(LANES).zip(ai.chunks_exact(LANES)).zip(br.chunks_exact(LANES).zip(bi.chunks_exact(LANES)));
    for ((ar, ai), (br, bi)) in rows {
        for l in 0..LANES {
            re[l] += ar[l] * br[l] + ai[l] * bi[l];
            im[l] += ar[l] * bi[l] - ai[l] * br[l];
        }
    }
    Complex::new(re.iter().sum(), im.iter().sum())
}

/// `a += factor b` of two padded vectors.
#[inline(always)]
pub(super) fn add(a: &mut [f64], factor: Complex, b: &[f64]) {
    let stride = a.len() / 2;
    let ((ar, ai), (br, bi)) = (a.split_at_mut(stride), b.split_at(stride));
    for ((ar, ai), (br, bi)) in ar.iter_mut().zip(ai).zip(br.iter().zip(bi)) {
        *ar += factor.re * br - factor.im * bi;
        *ai += factor.re * bi + factor.im * br;
    }
}

/// Numbers that begin where a line of the cache begins: a vector that lies across two lines costs twice.
pub(super) struct Aligned {
    start: usize,
    data: Vec<f64>,
}

impl Aligned {
    pub(super) fn zeros(len: usize) -> Self {
        let data = vec![0.0; len + LANES];
        let start = data.as_ptr().align_offset(8 * LANES).min(LANES);
        Self { start, data }
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.len());
        copy.copy_from_slice(self);
        copy
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];

    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.data[self.start..self.data.len() - LANES + self.start]
    }
}

impl std::ops::DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        let end = self.data.len() - LANES + self.start;
        &mut self.data[self.start..end]
    }
}

/// The matrix: block row `i` holds row `i` of each block.
#[derive(Clone)]
pub(super) struct Blocks {
    n: usize,
    stride: usize,
    data: Aligned,
}

impl Blocks {
    /// Zero.
    pub(super) fn zero(n: usize) -> Self {
        let stride = padded(n);
        Self { n, stride, data: Aligned::zeros(n * PLANES * stride) }
    }

    /// The diagonal matrix of these levels and slopes.
    pub(super) fn diagonal(levels: &[f64], slopes: &[f64]) -> Self {
        let mut blocks = Self::zero(levels.len());
        for (i, (&level, &slope)) in levels.iter().zip(slopes).enumerate() {
            blocks.set((0, i), (0, i), Complex::new(level, 0.0));
            blocks.set((1, i), (1, i), Complex::new(slope, 0.0));
        }
        blocks
    }

    /// Entry of the level (0) or slope (1) `i` with the level or slope `j`.
    pub(super) fn get(&self, (a, i): (usize, usize), (b, j): (usize, usize)) -> Complex {
        let at = (i * PLANES + 2 * (2 * a + b)) * self.stride + j;
        Complex::new(self.data[at], self.data[at + self.stride])
    }

    fn set(&mut self, (a, i): (usize, usize), (b, j): (usize, usize), value: Complex) {
        let at = (i * PLANES + 2 * (2 * a + b)) * self.stride + j;
        self.data[at] = value.re;
        self.data[at + self.stride] = value.im;
    }

    /// Adds `value` to an entry and its conjugate to the mirror image.
    pub(super) fn add_pair(&mut self, p: (usize, usize), q: (usize, usize), value: Complex) {
        self.set(p, q, self.get(p, q) + value);
        if p != q {
            self.set(q, p, self.get(q, p) + value.conj());
        }
    }

    /// Level and slope halves of `M (u, 0)`.
    pub(super) fn times_level(&self, u: &Vector, level: &mut Vector, slope: &mut Vector) {
        Arch::new().dispatch(Times {
            blocks: self,
            rows: [(0, &u.data), (4, &[])],
            level: &mut level.data,
            slope: &mut slope.data,
        });
    }

    /// Level and slope halves of `M (x, y)`.
    pub(super) fn times(&self, x: &Vector, y: &Vector, level: &mut Vector, slope: &mut Vector) {
        Arch::new().dispatch(Times {
            blocks: self,
            rows: [(0, &x.data), (4, &y.data)],
            level: &mut level.data,
            slope: &mut slope.data,
        });
    }

    /// `M -= g g^H` with `g` = (`level`, `slope`).
    pub(super) fn subtract(&mut self, level: &Vector, slope: &Vector) {
        let (level, slope) = (&level.data, &slope.data);
        Arch::new().dispatch(Advance::<false, true> { blocks: self, level, slope, noise: 0.0 });
    }

    /// One step of the walk, `M <- T M T^H + diag(0, noise)` with `T`: level += slope; then `M -= g g^H` if there is a `g`.
    pub(super) fn advance(&mut self, g: Option<(&Vector, &Vector)>, noise: f64) {
        match g {
            Some((level, slope)) => {
                let (level, slope) = (&level.data, &slope.data);
                Arch::new().dispatch(Advance::<true, true> { blocks: self, level, slope, noise })
            }
            None => Arch::new().dispatch(Advance::<true, false> { blocks: self, level: &[], slope: &[], noise }),
        }
    }

    /// [`Self::advance`] by `g`, and halves of the product with `(u, 0)` as by [`Self::times_level`], in one pass over the
    /// matrix: it is as large as the first cache.
    pub(super) fn advance_times_level(
        &mut self,
        g: [&Vector; 2],
        noise: f64,
        u: &Vector,
        [level, slope]: [&mut Vector; 2],
    ) {
        let g = g.map(|half| &half.data[..]);
        let product = [&mut level.data[..], &mut slope.data[..]];
        Arch::new().dispatch(AdvanceTimes { blocks: self, g, noise, u: &u.data, product });
    }

    /// The adjoint step, `M <- T^H M T`.
    pub(super) fn retreat(&mut self) {
        Arch::new().dispatch(Retreat { blocks: self });
    }

    /// `M -= (h, 0) m^H + m (h, 0)^H` with `m` = (`level`, `slope`): the slope-slope block stays as it is.
    pub(super) fn subtract_level_pair(&mut self, h: &Vector, level: &Vector, slope: &Vector) {
        Arch::new().dispatch(SubtractLevelPair { blocks: self, h: &h.data, level: &level.data, slope: &slope.data });
    }

    /// Makes the matrix Hermitian to the last bit.
    pub(super) fn symmetrise(&mut self) {
        for i in 0..self.n {
            for (a, b) in [(0, 0), (1, 1)] {
                for j in 0..=i {
                    let mean = 0.5 * (self.get((a, i), (b, j)) + self.get((b, j), (a, i)).conj());
                    self.set((a, i), (b, j), mean);
                    self.set((b, j), (a, i), mean.conj());
                }
            }
            for j in 0..self.n {
                let mean = 0.5 * (self.get((0, i), (1, j)) + self.get((1, j), (0, i)).conj());
                self.set((0, i), (1, j), mean);
                self.set((1, j), (0, i), mean.conj());
            }
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.data)
    }
}

/// `M x` by rows: for Hermitian `M`, `M x = conj(sum_j conj(x_j) row_j(M))`.
struct Times<'a> {
    blocks: &'a Blocks,
    /// First plane of a block row, and the half of `x` it belongs to (nothing: zero).
    rows: [(usize, &'a [f64]); 2],
    level: &'a mut [f64],
    slope: &'a mut [f64],
}

impl WithSimd for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (n, stride) = (self.blocks.n, self.blocks.stride);
        let zero = simd.splat_f64s(0.0);
        for chunk in (0..stride).step_by(S::F64_LANES) {
            // products of real and imaginary parts apart: twice the independent sums, so that none has to wait
            let mut sums = [zero; 8];
            for (plane, x) in self.rows.iter().filter(|(_, x)| !x.is_empty()) {
                let (re, im) = x.split_at(stride);
                let rows = self.blocks.data.chunks_exact(PLANES * stride);
                for ((row, &re), &im) in rows.zip(&re[..n]).zip(&im[..n]) {
                    let (re, im) = (simd.splat_f64s(re), simd.splat_f64s(im));
                    for half in 0..2 {
                        let at = (plane + 2 * half) * stride + chunk;
                        let (a, b) = (load::<S>(row, at), load::<S>(row, at + stride));
                        let s = &mut sums[4 * half..4 * half + 4];
                        // conj(x) m: real x m, imaginary
                        s[0] = simd.mul_add_e_f64s(re, a, s[0]);
                        s[1] = simd.mul_add_e_f64s(im, b, s[1]);
                        s[2] = simd.mul_add_e_f64s(im, a, s[2]);
                        s[3] = simd.mul_add_e_f64s(re, b, s[3]);
                    }
                }
            }
            for (out, s) in [(&mut *self.level, &sums[..4]), (&mut *self.slope, &sums[4..])] {
                store::<S>(out, chunk, simd.add_f64s(s[0], s[1]));
                store::<S>(out, stride + chunk, simd.sub_f64s(s[2], s[3]));
            }
        }
    }
}

/// What a chunk of eight planes of a row is after a step of the walk: `level += slope` on both sides.
#[inline(always)]
fn stepped<S: Simd>(simd: S, m: &mut [S::f64s; PLANES]) {
    for part in 0..2 {
        let (a, b, t, d) = (m[part], m[2 + part], m[4 + part], m[6 + part]);
        m[part] = simd.add_f64s(simd.add_f64s(a, b), simd.add_f64s(t, d));
        m[2 + part] = simd.add_f64s(b, d);
        m[4 + part] = simd.add_f64s(t, d);
    }
}

/// Takes a chunk of `g g^H` from a chunk of eight planes of a row: `g` at the row and at the chunk's columns, as level and
/// slope, real and imaginary parts.
#[inline(always)]
fn corrected<S: Simd>(simd: S, m: &mut [S::f64s; PLANES], row: [S::f64s; 4], columns: [S::f64s; 4]) {
    for (half, other) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let p = 4 * half + 2 * other;
        let (gr, gi) = (row[2 * half], row[2 * half + 1]);
        let (vr, vi) = (columns[2 * other], columns[2 * other + 1]);
        m[p] = simd.negate_mul_add_e_f64s(gi, vi, simd.negate_mul_add_e_f64s(gr, vr, m[p]));
        m[p + 1] = simd.mul_add_e_f64s(gr, vi, simd.negate_mul_add_e_f64s(gi, vr, m[p + 1]));
    }
}

/// One step of the walk (if `STEP`), one rank-one correction (if `CORRECT`), in one pass over the matrix.
struct Advance<'a, const STEP: bool, const CORRECT: bool> {
    blocks: &'a mut Blocks,
    level: &'a [f64],
    slope: &'a [f64],
    noise: f64,
}

impl<const STEP: bool, const CORRECT: bool> WithSimd for Advance<'_, STEP, CORRECT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (n, stride) = (self.blocks.n, self.blocks.stride);
        let zero = simd.splat_f64s(0.0);
        for (i, row) in self.blocks.data.chunks_exact_mut(PLANES * stride).enumerate().take(n) {
            let g = if CORRECT { splats(simd, self.level, self.slope, i) } else { [zero; 4] };
            for c in (0..stride).step_by(S::F64_LANES) {
                let mut m: [S::f64s; PLANES] = std::array::from_fn(|p| load::<S>(row, p * stride + c));
                if STEP {
                    stepped(simd, &mut m);
                }
                if CORRECT {
                    corrected(simd, &mut m, g, chunks::<S>(self.level, self.slope, c));
                }
                for (p, value) in m.into_iter().enumerate() {
                    store::<S>(row, p * stride + c, value);
                }
            }
            row[6 * stride + i] += self.noise;
        }
    }
}

/// One step of the walk with a rank-one correction, and the product with `(u, 0)`.
struct AdvanceTimes<'a> {
    blocks: &'a mut Blocks,
    g: [&'a [f64]; 2],
    noise: f64,
    u: &'a [f64],
    product: [&'a mut [f64]; 2],
}

impl WithSimd for AdvanceTimes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (n, stride) = (self.blocks.n, self.blocks.stride);
        let zero = simd.splat_f64s(0.0);
        let (ur, ui) = self.u.split_at(stride);
        let ([level, slope], mut product) = (self.g, self.product);
        for c in (0..stride).step_by(S::F64_LANES) {
            let columns = chunks::<S>(level, slope, c);
            // products of real and imaginary parts apart, as in `Times`
            let mut sums = [zero; 8];
            for (i, row) in self.blocks.data.chunks_exact_mut(PLANES * stride).enumerate().take(n) {
                let mut m: [S::f64s; PLANES] = std::array::from_fn(|p| load::<S>(row, p * stride + c));
                stepped(simd, &mut m);
                corrected(simd, &mut m, splats(simd, level, slope, i), columns);
                let (re, im) = (simd.splat_f64s(ur[i]), simd.splat_f64s(ui[i]));
                for half in 0..2 {
                    let (a, b) = (m[2 * half], m[2 * half + 1]);
                    let s = &mut sums[4 * half..4 * half + 4];
                    s[0] = simd.mul_add_e_f64s(re, a, s[0]);
                    s[1] = simd.mul_add_e_f64s(im, b, s[1]);
                    s[2] = simd.mul_add_e_f64s(im, a, s[2]);
                    s[3] = simd.mul_add_e_f64s(re, b, s[3]);
                }
                for (p, value) in m.into_iter().enumerate() {
                    store::<S>(row, p * stride + c, value);
                }
            }
            for (half, out) in product.iter_mut().enumerate() {
                let s = &sums[4 * half..4 * half + 4];
                store::<S>(out, c, simd.add_f64s(s[0], s[1]));
                store::<S>(out, stride + c, simd.sub_f64s(s[2], s[3]));
            }
        }
        for (i, row) in self.blocks.data.chunks_exact_mut(PLANES * stride).enumerate().take(n) {
            row[6 * stride + i] += self.noise;
        }
    }
}

/// `M -= (h, 0) m^H + m (h, 0)^H`.
struct SubtractLevelPair<'a> {
    blocks: &'a mut Blocks,
    h: &'a [f64],
    level: &'a [f64],
    slope: &'a [f64],
}

impl WithSimd for SubtractLevelPair<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (n, stride) = (self.blocks.n, self.blocks.stride);
        for (i, row) in self.blocks.data.chunks_exact_mut(PLANES * stride).enumerate().take(n) {
            let of = |v: &[f64]| (simd.splat_f64s(v[i]), simd.splat_f64s(v[stride + i]));
            let (h, level, slope) = (of(self.h), of(self.level), of(self.slope));
            for c in (0..stride).step_by(S::F64_LANES) {
                take::<S>(simd, row, (c, stride), h, (self.level, c));
                take::<S>(simd, row, (c, stride), level, (self.h, c));
                take::<S>(simd, row, (2 * stride + c, stride), h, (self.slope, c));
                take::<S>(simd, row, (4 * stride + c, stride), slope, (self.h, c));
            }
        }
    }
}

/// `M <- T^H M T`.
struct Retreat<'a> {
    blocks: &'a mut Blocks,
}

impl WithSimd for Retreat<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (n, stride) = (self.blocks.n, self.blocks.stride);
        for row in self.blocks.data.chunks_exact_mut(PLANES * stride).take(n) {
            for c in (0..2 * stride).step_by(S::F64_LANES) {
                let [a, b, t, d]: [S::f64s; 4] = std::array::from_fn(|p| load::<S>(row, 2 * p * stride + c));
                store::<S>(row, 2 * stride + c, simd.add_f64s(b, a));
                store::<S>(row, 4 * stride + c, simd.add_f64s(t, a));
                store::<S>(row, 6 * stride + c, simd.add_f64s(simd.add_f64s(d, b), simd.add_f64s(t, a)));
            }
        }
    }
}

/// `row[at..] -= x conj(v[c..])`, for one vector of real and (a `stride` further) imaginary parts.
#[inline(always)]
fn take<S: Simd>(
    simd: S,
    row: &mut [f64],
    (at, stride): (usize, usize),
    x: (S::f64s, S::f64s),
    (v, c): (&[f64], usize),
) {
    let (vr, vi) = (load::<S>(v, c), load::<S>(v, stride + c));
    let (re, im) = (load::<S>(row, at), load::<S>(row, at + stride));
    store::<S>(row, at, simd.negate_mul_add_e_f64s(x.1, vi, simd.negate_mul_add_e_f64s(x.0, vr, re)));
    store::<S>(row, at + stride, simd.mul_add_e_f64s(x.0, vi, simd.negate_mul_add_e_f64s(x.1, vr, im)));
}

/// Number `i` of two vectors, real and imaginary parts, in all lanes.
#[inline(always)]
fn splats<S: Simd>(simd: S, level: &[f64], slope: &[f64], i: usize) -> [S::f64s; 4] {
    let stride = level.len() / 2;
    [level[i], level[stride + i], slope[i], slope[stride + i]].map(|v| simd.splat_f64s(v))
}

/// Numbers from `c` on of two vectors, real and imaginary parts.
#[inline(always)]
fn chunks<S: Simd>(level: &[f64], slope: &[f64], c: usize) -> [S::f64s; 4] {
    let stride = level.len() / 2;
    [load::<S>(level, c), load::<S>(level, stride + c), load::<S>(slope, c), load::<S>(slope, stride + c)]
}

#[inline(always)]
fn load<S: Simd>(values: &[f64], at: usize) -> S::f64s {
    S::as_simd_f64s(&values[at..at + S::F64_LANES]).0[0]
}

#[inline(always)]
fn store<S: Simd>(values: &mut [f64], at: usize, value: S::f64s) {
    S::as_mut_simd_f64s(&mut values[at..at + S::F64_LANES]).0[0] = value;
}
