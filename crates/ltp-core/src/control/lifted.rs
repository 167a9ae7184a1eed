//! Eigenvalues of the lifted closed loop `A - N - B K` with their derivatives, fast enough for an optimiser.
//!
//! In the orthonormal basis `1, sqrt(2) cos n w t, sqrt(2) sin n w t` the truncated harmonic state space is a real matrix similar
//! to the block Toeplitz one, and its block (i, j) is the mean of `phi_i M(t) phi_j`. Where all harmonics of system and gain
//! are multiples of `d` it falls apart into blocks of harmonics that are equal up to sign modulo d: the 20 x 20 lift of a
//! system with even harmonics into 12 x 12 and 8 x 8. A derivative is `-y^T B E x` with the eigenvectors of the block.
//!
//! References: N. M. Wereley, Ph.D. thesis, MIT 1991; A. D. Duyul, M.Sc. thesis, METU 2018, equations (3.11) to (3.15).

use std::f64::consts::{SQRT_2, TAU};

use super::law::{Law, Wave};
use super::spectrum::{Mode, Spectrum};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::divisor::gcd;
use crate::numeric::moving_eigen::Eigenpairs;
use crate::periodic::{Entry, LtpSystem};

/// Coefficients of this share of the largest one are rounding.
const ROUNDING: f64 = 1e-10;
/// Coefficients of this share of the largest one must be inside the lift.
const MATTERS: f64 = 1e-2;

/// The lift of a system and the form of its gain.
#[derive(Clone, Debug)]
pub struct Lifted {
    law: Law,
    classes: Vec<Class>,
    /// Central modes have at most this imaginary part, rad/s.
    strip: f64,
    step: usize,
}

/// Harmonics that couple.
#[derive(Clone, Debug)]
struct Class {
    /// Basis functions.
    blocks: usize,
    /// A - N (blocks*nx, blocks*nx).
    a: Vec<f64>,
    /// B (blocks*nx, blocks*nu).
    b: Vec<f64>,
    /// For each term of the gain: entries (row, column, value) of its multiplication.
    terms: Vec<Vec<(usize, usize, f64)>>,
}

/// A basis function: harmonic, and whether it is the sine.
type Function = (usize, bool);

impl Lifted {
    /// The lift with harmonics -truncation..=truncation.
    ///
    /// # Errors
    /// `Model` for a system with jumps, `Shape` for a law of other lengths, `OutOfRange` for a truncation too low for the
    /// harmonics of the system or of the gain, saying which suffices.
    pub fn new(system: &LtpSystem, law: &Law, truncation: usize) -> Result<Self> {
        smooth(system)?;
        let size = system.size();
        if (law.nu, law.nx) != (size.nu, size.nx) {
            let what = format!("gain, (nu, nx) = ({}, {}) row-major", size.nu, size.nx);
            return Err(Error::Shape { what, expected: size.nu * size.nx, found: law.nu * law.nx });
        }
        let reach = 2 * truncation.max(8);
        let half = |entry| system.fourier(entry, reach)[reach..].to_vec();
        let (a, b) = (half(Entry::A), half(Entry::B));
        let needed = last(&a, MATTERS).max(last(&b, MATTERS)).div_ceil(2);
        let needed = needed.max(law.harmonics.last().copied().unwrap_or(0).div_ceil(2));
        if needed > truncation {
            let expected = format!(
                "at least {needed}: the lift truncated at N holds harmonics up to 2 N, and those of the matrices (above {} % \
                 of the largest) or of the gain reach higher",
                100.0 * MATTERS
            );
            return Err(Error::OutOfRange { what: "truncation".into(), found: truncation as f64, expected });
        }
        let step = step(&a, &b, &law.harmonics);
        let pumping = TAU / system.period();
        let (step, strip) =
            if step == 0 { (2 * truncation + 1, f64::INFINITY) } else { (step, 0.5 * step as f64 * pumping) };
        let functions = |residue: usize| -> Vec<Function> {
            let inside = (0..=truncation).filter(|n| (n % step).min(step - n % step) == residue);
            inside.flat_map(|n| if n == 0 { vec![(0, false)] } else { vec![(n, false), (n, true)] }).collect()
        };
        let classes = (0..=step / 2).map(functions).filter(|f| !f.is_empty());
        let classes = classes.map(|f| Class::new(&f, (&a, size.nx), (&b, size.nu), law, pumping)).collect();
        Ok(Self { law: law.clone(), classes, strip: strip * (1.0 + 1e-9), step })
    }

    /// The gain's form.
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// All harmonics are multiples of this one; `2 N + 1` when nothing varies.
    pub fn step(&self) -> usize {
        self.step
    }

    /// Finds all modes of the gain with unknowns `x`.
    ///
    /// # Errors
    /// `NoConvergence` for a gain that is not finite.
    pub fn modes(&self, x: &[f64], spectrum: &mut Spectrum) -> Result<()> {
        spectrum.modes.clear();
        spectrum.pairs.resize(self.classes.len(), Eigenpairs::default());
        for (k, class) in self.classes.iter().enumerate() {
            class.close(x, &self.law, &mut spectrum.gain, &mut spectrum.matrix);
            let order = class.blocks * self.law.nx;
            let values = spectrum.pairs[k].values(&spectrum.matrix, order)?;
            spectrum.modes.extend(values.iter().map(|&value| Mode { value, class: k, central: false }));
        }
        // One copy of each exponent stands in the strip; where the cut of the lift has moved one out of it on both sides, the
        // nearest to the strip stand for it.
        let middle = &mut spectrum.modes[..self.classes[0].blocks * self.law.nx];
        let mut distances: Vec<f64> = middle.iter().map(|m| m.value.im.abs()).collect();
        distances.sort_by(f64::total_cmp);
        let width = self.strip.max(distances[self.law.nx - 1] * (1.0 + 1e-9));
        middle.iter_mut().for_each(|m| m.central = m.value.im.abs() <= width);
        Ok(())
    }

    /// Derivative of a mode by all unknowns; false at a defective eigenvalue.
    pub fn derivative(&self, mode: &Mode, spectrum: &Spectrum, out: &mut Vec<Complex>) -> bool {
        let Law { nu, nx, .. } = self.law;
        out.clear();
        out.resize(self.law.unknowns(), Complex::new(0.0, 0.0));
        let class = &self.classes[mode.class];
        let Some(pair) = spectrum.pairs[mode.class].pair(mode.value) else {
            return false;
        };
        let columns = class.blocks * nu;
        let mut push = vec![Complex::new(0.0, 0.0); columns];
        for (y, row) in pair.left.iter().zip(class.b.chunks_exact(columns)) {
            push.iter_mut().zip(row).for_each(|(p, b)| *p += y * *b);
        }
        for (entries, out) in class.terms.iter().zip(out.chunks_exact_mut(nu * nx)) {
            for &(i, j, value) in entries {
                for u in 0..nu {
                    let weight = push[i * nu + u] * value;
                    for s in 0..nx {
                        out[u * nx + s] -= weight * pair.right[j * nx + s];
                    }
                }
            }
        }
        true
    }
}

impl Class {
    fn new(
        functions: &[Function],
        (a, nx): (&[Vec<Complex>], usize),
        (b, nu): (&[Vec<Complex>], usize),
        law: &Law,
        pumping: f64,
    ) -> Self {
        let m = functions.len();
        let lifted = |coefficients: &[Vec<Complex>], columns: usize| {
            let mut out = vec![0.0; m * nx * m * columns];
            for (i, &left) in functions.iter().enumerate() {
                for (j, &right) in functions.iter().enumerate() {
                    for r in 0..nx {
                        for c in 0..columns {
                            let one =
                                |k: usize| coefficients.get(k).map_or(Complex::new(0.0, 0.0), |m| m[r * columns + c]);
                            out[(i * nx + r) * m * columns + j * columns + c] = mean(left, right, one);
                        }
                    }
                }
            }
            out
        };
        let mut a = lifted(a, nx);
        let order = m * nx;
        for i in 0..m {
            if let (n, true) = functions[i] {
                // the cosine of the same harmonic stands before its sine
                for r in 0..nx {
                    let (cos, sin) = ((i - 1) * nx + r, i * nx + r);
                    a[sin * order + cos] += n as f64 * pumping;
                    a[cos * order + sin] -= n as f64 * pumping;
                }
            }
        }
        let entries = |wave: Wave| {
            let all = (0..m * m).map(|k| (k / m, k % m));
            let valued = all.map(|(i, j)| (i, j, mean(functions[i], functions[j], |k| wave.coefficient(k))));
            valued.filter(|e| e.2 != 0.0).collect()
        };
        Self { blocks: m, a, b: lifted(b, nu), terms: law.terms().into_iter().map(entries).collect() }
    }

    /// `A - N - B K` of the gain with unknowns `x`.
    fn close(&self, x: &[f64], law: &Law, gain: &mut Vec<f64>, out: &mut Vec<f64>) {
        let Law { nu, nx, .. } = *law;
        let (order, inner) = (self.blocks * nx, self.blocks * nu);
        gain.clear();
        gain.resize(inner * order, 0.0);
        for (entries, x) in self.terms.iter().zip(x.chunks_exact(nu * nx)) {
            for &(i, j, value) in entries {
                for u in 0..nu {
                    let row = &mut gain[(i * nu + u) * order + j * nx..][..nx];
                    row.iter_mut().zip(&x[u * nx..]).for_each(|(g, x)| *g += value * x);
                }
            }
        }
        out.clear();
        out.extend_from_slice(&self.a);
        for (row, weights) in out.chunks_exact_mut(order).zip(self.b.chunks_exact(inner)) {
            for (weight, gain) in weights.iter().zip(gain.chunks_exact(order)).filter(|(w, _)| **w != 0.0) {
                row.iter_mut().zip(gain).for_each(|(a, g)| *a -= weight * g);
            }
        }
    }
}

/// Mean over a period of `phi_left g phi_right` for a real g with coefficients `c(k)`, k >= 0.
fn mean((n, left_sine): Function, (m, right_sine): Function, c: impl Fn(usize) -> Complex) -> f64 {
    let (below, above) = (n.abs_diff(m), n + m);
    let sign = if n >= m { 1.0 } else { -1.0 };
    // means of cos(k w t) g and sin(k w t) g
    let (cos, sin) = (|k| c(k).re, |k| -c(k).im);
    let half = match (left_sine, right_sine) {
        (false, false) => cos(below) + cos(above),
        (true, true) => cos(below) - cos(above),
        (true, false) => sin(above) + sign * sin(below),
        (false, true) => sin(above) - sign * sin(below),
    };
    let root = |n: usize| if n == 0 { 1.0 } else { SQRT_2 };
    0.5 * root(n) * root(m) * half
}

/// The last harmonic with an entry above a share of the largest entry of all.
fn last(coefficients: &[Vec<Complex>], share: f64) -> usize {
    let size = |m: &Vec<Complex>| m.iter().fold(0.0_f64, |l, c| l.max(c.norm()));
    let largest = coefficients.iter().map(size).fold(0.0, f64::max);
    coefficients.iter().rposition(|m| size(m) > share * largest).unwrap_or(0)
}

/// Greatest common divisor of all harmonics of system and gain; 0 when nothing varies.
pub(super) fn step(a: &[Vec<Complex>], b: &[Vec<Complex>], gain: &[usize]) -> usize {
    let mut step = gain.iter().fold(0, |d, &h| gcd(d, h));
    for coefficients in [a, b] {
        let size = |m: &Vec<Complex>| m.iter().fold(0.0_f64, |l, c| l.max(c.norm()));
        let largest = coefficients.iter().map(size).fold(0.0, f64::max);
        let present = coefficients.iter().enumerate().filter(|(_, m)| size(m) > ROUNDING * largest);
        step = present.fold(step, |d, (h, _)| gcd(d, h));
    }
    step
}

/// Refuses systems with jumps.
pub(super) fn smooth(system: &LtpSystem) -> Result<()> {
    let Some(jump) = system.jumps().next() else { return Ok(()) };
    let message = format!("the state jumps (`{}`): these designs are for smooth systems; remove the jump", jump.name);
    Err(Error::Model { path: "control".into(), message })
}
