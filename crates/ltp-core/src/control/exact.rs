//! Floquet exponents of the closed loop `A(t) - B(t) K(t)` with their derivatives, fast enough for an optimiser.
//!
//! Matrices are sampled once. A step is the exponential of the fourth-order Magnus expansion on two Gauss nodes, by a diagonal
//! Pade approximant that stays bounded however fast a mode decays. Where all harmonics of system and gain are multiples of `d`
//! the d-th part of a period is enough. An exponent moves by `-1/L int y^T B dK x dt` with the Floquet eigenvectors `x(t)` and
//! `y(t)` of the adjoint system: the integrand is periodic, so that even steps integrate it to rounding and the derivative
//! costs no more than two vectors carried along.
//!
//! References: S. Blanes et al., Phys. Rep. 470 (2009), 151-238, section 5 (Magnus); V. A. Yakubovich, V. M. Starzhinskii,
//! *Linear differential equations with periodic coefficients*, 1975 (derivatives of multipliers).

use std::f64::consts::TAU;

use super::law::Law;
use super::lifted::{smooth, step};
use super::spectrum::{Mode, Spectrum};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::moving_eigen::Eigenpairs;
use crate::periodic::{Entry, LtpSystem};

/// Steps in a whole period unless told otherwise.
pub const STEPS: usize = 96;
/// Most states.
const LARGEST: usize = 16;

/// Sampled matrices and the form of the gain.
#[derive(Clone, Debug)]
pub struct Exact {
    law: Law,
    /// The part of the period that is enough, s, and its steps.
    length: f64,
    steps: usize,
    /// A (2*steps, nx, nx) and B (2*steps, nx, nu) at the two nodes of each step.
    a: Vec<f64>,
    b: Vec<f64>,
    /// Terms of the gain (2*steps, terms) there.
    waves: Vec<f64>,
    /// B and terms at the start of each step.
    b_start: Vec<f64>,
    waves_start: Vec<f64>,
}

impl Exact {
    /// With `steps` in a whole period ([`STEPS`] when `None`).
    ///
    /// # Errors
    /// `Model` for a system with jumps, `Shape` for a law of other lengths, `OutOfRange` for more than 16 states.
    pub fn new(system: &LtpSystem, law: &Law, steps: Option<usize>) -> Result<Self> {
        smooth(system)?;
        let size = system.size();
        if (law.nu, law.nx) != (size.nu, size.nx) {
            let what = format!("gain, (nu, nx) = ({}, {}) row-major", size.nu, size.nx);
            return Err(Error::Shape { what, expected: size.nu * size.nx, found: law.nu * law.nx });
        }
        if size.nx > LARGEST {
            let expected = format!("at most {LARGEST} for this objective; use the lifted one, or fewer states");
            return Err(Error::OutOfRange { what: "number of states".into(), found: size.nx as f64, expected });
        }
        let half = |entry| system.fourier(entry, 16)[16..].to_vec();
        let divisor = step(&half(Entry::A), &half(Entry::B), &law.harmonics).max(1);
        let highest = law.harmonics.last().copied().unwrap_or(0);
        let steps = steps.unwrap_or(STEPS).max(16 * highest).div_ceil(divisor).max(4);
        let (length, period) = (system.period() / divisor as f64, system.period());
        let h = length / steps as f64;
        let inner = 3.0_f64.sqrt() / 6.0;
        let nodes: Vec<f64> = (0..steps).flat_map(|i| [0.5 - inner, 0.5 + inner].map(|c| (i as f64 + c) * h)).collect();
        let starts: Vec<f64> = (0..steps).map(|i| i as f64 * h).collect();
        let begin = system.start();
        let sampled = |entry, times: &[f64]| times.iter().flat_map(|t| system.matrix(entry, begin + t)).collect();
        let terms = law.terms();
        let angle = |t: f64| TAU * (begin + t) / period;
        let waved = |times: &[f64]| times.iter().flat_map(|t| terms.iter().map(|w| w.at(angle(*t)))).collect();
        Ok(Self {
            law: law.clone(),
            length,
            steps,
            a: sampled(Entry::A, &nodes),
            b: sampled(Entry::B, &nodes),
            waves: waved(&nodes),
            b_start: sampled(Entry::B, &starts),
            waves_start: waved(&starts),
        })
    }

    /// The gain's form.
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// Finds all exponents of the gain with unknowns `x`, in the strip `|Im| <= pi / L` of the part L of the period that is
    /// enough.
    ///
    /// # Errors
    /// `NoConvergence` for a gain that is not finite.
    pub fn modes(&self, x: &[f64], spectrum: &mut Spectrum) -> Result<()> {
        // The next length that was compiled; states that are not there stand still.
        match self.law.nx {
            1 | 2 => self.propagate::<2>(x, spectrum),
            3 | 4 => self.propagate::<4>(x, spectrum),
            5 | 6 => self.propagate::<6>(x, spectrum),
            7 | 8 => self.propagate::<8>(x, spectrum),
            _ => self.propagate::<LARGEST>(x, spectrum),
        }
        let nx = self.law.nx;
        spectrum.pairs.resize(1, Eigenpairs::default());
        spectrum.modes.clear();
        let size = spectrum.gain.iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
        for &value in spectrum.pairs[0].values(&spectrum.gain[..nx * nx], nx)? {
            // what is below rounding of the monodromy matrix has decayed at least as fast as rounding shows
            let value = if value.norm() > f64::EPSILON * size { value } else { Complex::from(f64::EPSILON * size) };
            spectrum.modes.push(Mode { value: value.ln() / self.length, class: 0, central: true });
        }
        Ok(())
    }

    /// Derivative of an exponent by all unknowns; false at a defective one.
    pub fn derivative(&self, mode: &Mode, spectrum: &Spectrum, out: &mut Vec<Complex>) -> bool {
        let Law { nu, nx, .. } = self.law;
        let zero = Complex::new(0.0, 0.0);
        out.clear();
        out.resize(self.law.unknowns(), zero);
        let multiplier = (mode.value * self.length).exp();
        let Some(pair) = spectrum.pairs[0].pair(multiplier) else {
            return false;
        };
        let each = nx * nx;
        let mut forward = Vec::with_capacity((self.steps + 1) * nx);
        forward.extend_from_slice(&pair.right);
        for (i, step) in spectrum.matrix.chunks_exact(each).enumerate() {
            for row in step.chunks_exact(nx) {
                let next = row.iter().zip(&forward[i * nx..]).map(|(a, x)| x * *a).sum();
                forward.push(next);
            }
        }
        let terms = self.waves_start.len() / self.steps;
        let scale = -1.0 / (self.steps as f64 * multiplier);
        let (mut back, mut next) = (pair.left, vec![zero; nx]);
        for (i, step) in spectrum.matrix.chunks_exact(each).enumerate().rev() {
            next.fill(zero);
            for (y, row) in back.iter().zip(step.chunks_exact(nx)) {
                next.iter_mut().zip(row).for_each(|(n, a)| *n += y * *a);
            }
            std::mem::swap(&mut back, &mut next);
            let b = &self.b_start[i * nx * nu..(i + 1) * nx * nu];
            for u in 0..nu {
                let push: Complex = (0..nx).map(|r| back[r] * b[r * nu + u]).sum::<Complex>() * scale;
                for t in 0..terms {
                    let weight = push * self.waves_start[i * terms + t];
                    let row = &mut out[(t * nu + u) * nx..(t * nu + u + 1) * nx];
                    row.iter_mut().zip(&forward[i * nx..]).for_each(|(o, x)| *o += weight * x);
                }
            }
        }
        true
    }

    /// Exponents of the open loop, and how far the inputs reach each mode: rms over the period of `|y^T B|`, relative to `|y|
    /// |B|`.
    ///
    /// # Errors
    /// As [`Exact::modes`].
    pub fn reach(&self) -> Result<Vec<(Complex, f64)>> {
        let Law { nu, nx, .. } = self.law;
        let mut spectrum = Spectrum::default();
        self.modes(&vec![0.0; self.law.unknowns()], &mut spectrum)?;
        let of_one = |mode: &Mode| {
            let pair = spectrum.pairs[0].vectors((mode.value * self.length).exp());
            let (mut y, mut moved, mut most) = (pair.left, 0.0, 0.0);
            for (i, step) in spectrum.matrix.chunks_exact(nx * nx).enumerate().rev() {
                y = (0..nx).map(|c| (0..nx).map(|r| y[r] * step[r * nx + c]).sum()).collect();
                let b = &self.b_start[i * nx * nu..(i + 1) * nx * nu];
                let size: f64 = y.iter().map(Complex::norm_sqr).sum();
                let push = |u: usize| (0..nx).map(|r| y[r] * b[r * nu + u]).sum::<Complex>().norm_sqr();
                moved += (0..nu).map(push).sum::<f64>() / size;
                most += b.iter().map(|b| b * b).sum::<f64>();
            }
            (mode.value, if most > 0.0 { (moved / most).sqrt() } else { 0.0 })
        };
        Ok(spectrum.modes.iter().map(of_one).collect())
    }

    /// Transition matrices of all steps into `spectrum.matrix` (steps, nx, nx), their product into `spectrum.gain` (nx, nx).
    fn propagate<const N: usize>(&self, x: &[f64], spectrum: &mut Spectrum) {
        let Law { nu, nx, .. } = self.law;
        let terms = self.waves.len() / (2 * self.steps);
        let h = self.length / self.steps as f64;
        let mut gain = [0.0; LARGEST];
        let mut closed = |node: usize| -> [[f64; N]; N] {
            let mut m = [[0.0; N]; N];
            let a = &self.a[node * nx * nx..(node + 1) * nx * nx];
            for (row, a) in m.iter_mut().zip(a.chunks_exact(nx)) {
                row[..nx].copy_from_slice(a);
            }
            let b = &self.b[node * nx * nu..(node + 1) * nx * nu];
            for u in 0..nu {
                gain[..nx].copy_from_slice(&x[u * nx..(u + 1) * nx]);
                let first = self.waves[node * terms];
                gain[..nx].iter_mut().for_each(|g| *g *= first);
                for t in 1..terms {
                    let wave = self.waves[node * terms + t];
                    let own = &x[(t * nu + u) * nx..];
                    gain[..nx].iter_mut().zip(own).for_each(|(g, x)| *g += wave * x);
                }
                for r in 0..nx {
                    let weight = b[r * nu + u];
                    (0..N).for_each(|c| m[r][c] -= weight * gain[c]);
                }
            }
            m
        };
        spectrum.matrix.clear();
        let mut all = identity::<N>();
        for i in 0..self.steps {
            let (first, second) = (closed(2 * i), closed(2 * i + 1));
            let step = exponential(&magnus(&first, &second, h));
            all = times(&step, &all);
            step[..nx].iter().for_each(|row| spectrum.matrix.extend_from_slice(&row[..nx]));
        }
        spectrum.gain.clear();
        all[..nx].iter().for_each(|row| spectrum.gain.extend_from_slice(&row[..nx]));
    }
}

type Matrix<const N: usize> = [[f64; N]; N];

fn identity<const N: usize>() -> Matrix<N> {
    let mut m = [[0.0; N]; N];
    (0..N).for_each(|i| m[i][i] = 1.0);
    m
}

#[inline(always)]
fn times<const N: usize>(a: &Matrix<N>, b: &Matrix<N>) -> Matrix<N> {
    let mut out = [[0.0; N]; N];
    for i in 0..N {
        for k in 0..N {
            for j in 0..N {
                out[i][j] += a[i][k] * b[k][j];
            }
        }
    }
    out
}

/// `h/2 (A1 + A2) + sqrt(3)/12 h^2 [A2, A1]`.
#[inline(always)]
fn magnus<const N: usize>(first: &Matrix<N>, second: &Matrix<N>, h: f64) -> Matrix<N> {
    let (one, other) = (times(second, first), times(first, second));
    let weight = 3.0_f64.sqrt() / 12.0 * h * h;
    let mut out = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..N {
            out[i][j] = 0.5 * h * (first[i][j] + second[i][j]) + weight * (one[i][j] - other[i][j]);
        }
    }
    out
}

/// The exponential by its [3/3] Pade approximant: right to the seventh power of `m`, and bounded for decaying modes.
#[inline(always)]
fn exponential<const N: usize>(m: &Matrix<N>) -> Matrix<N> {
    let square = times(m, m);
    let mut odd = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..N {
            odd[i][j] = square[i][j] / 120.0;
        }
        odd[i][i] += 0.5;
    }
    let odd = times(m, &odd);
    let (mut left, mut right) = (identity::<N>(), identity::<N>());
    for i in 0..N {
        for j in 0..N {
            left[i][j] += square[i][j] / 10.0 - odd[i][j];
            right[i][j] += square[i][j] / 10.0 + odd[i][j];
        }
    }
    solve(left, right)
}

/// `left^{-1} right` by elimination with row interchanges.
#[inline(always)]
fn solve<const N: usize>(mut left: Matrix<N>, mut right: Matrix<N>) -> Matrix<N> {
    for k in 0..N {
        let pivot = (k + 1..N).fold(k, |p, i| if left[i][k].abs() > left[p][k].abs() { i } else { p });
        if pivot != k {
            left.swap(k, pivot);
            right.swap(k, pivot);
        }
        let inverse = 1.0 / left[k][k];
        for i in k + 1..N {
            let factor = left[i][k] * inverse;
            for j in k + 1..N {
                left[i][j] -= factor * left[k][j];
            }
            for j in 0..N {
                right[i][j] -= factor * right[k][j];
            }
        }
    }
    for k in (0..N).rev() {
        let inverse = 1.0 / left[k][k];
        for j in 0..N {
            let sum: f64 = (k + 1..N).map(|i| left[k][i] * right[i][j]).sum();
            right[k][j] = (right[k][j] - sum) * inverse;
        }
    }
    right
}
