//! The harmonic state space: a smooth periodic system as an infinite time-invariant one, truncated.
//!
//! With `x(t) = sum_n x_n e^{(s + j n w_p) t}` the system reads `s X = (A - N) X + B U`, `Y = C X + D U`: `A` is block Toeplitz
//! with the Fourier coefficient `A_{i-j}` in block `(i, j)`, and `N = blkdiag(j n w_p I)`.
//!
//! References: N. M. Wereley, S. R. Hall, *Frequency response of linear time periodic systems*, CDC 1990; E. Möllerstedt,
//! *Dynamic Analysis of Harmonics in Electrical Systems*, Lund 2000.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

use super::htf::Htf;
use super::system::{Entry, LtpSystem, NODES, Size};
use crate::error::{Error, Result};
use crate::numeric::Complex;

impl LtpSystem {
    /// Fourier coefficients `M_k = 1/T int M(t) e^{-j k w_p t} dt` of a matrix for k = -K..=K, row-major each.
    pub fn fourier(&self, entry: Entry, harmonics: usize) -> Vec<Vec<Complex>> {
        let pumping = TAU / self.period();
        let each = self.matrix(entry, self.start()).len();
        let mut sums = vec![vec![Complex::new(0.0, 0.0); each]; 2 * harmonics + 1];
        let mut value = Vec::new();
        for segment in self.segments() {
            let whole = segment.end - segment.start;
            // Twelve nodes integrate a product with two radians of oscillation to rounding.
            let parts = (harmonics as f64 * pumping * whole / 2.0).ceil().max(1.0) as usize;
            for part in 0..parts {
                for i in 0..NODES {
                    let theta = (part as f64 + self.gauss().nodes[i]) / parts as f64;
                    let weight = self.gauss().weights[i] * whole / parts as f64 / self.period();
                    self.at(segment, theta, entry, &mut value);
                    for (row, sum) in sums.iter_mut().enumerate() {
                        let k = row as f64 - harmonics as f64;
                        let turn = Complex::from_polar(weight, -k * pumping * (segment.start + theta * whole));
                        sum.iter_mut().zip(&value).for_each(|(s, v)| *s += turn * v);
                    }
                }
            }
        }
        sums
    }

    /// The matrix `A - N` of the harmonic state space with blocks -N..=N, row-major, of order `(2N+1) nx`.
    ///
    /// # Errors
    /// `Model` for a system with jumps, which have no Fourier series that converges.
    pub fn lift(&self, truncation: usize) -> Result<Vec<Complex>> {
        if let Some(jump) = self.jumps().next() {
            let message = format!(
                "the state jumps (`{}`): its harmonic state space does not converge; `htf` is exact through jumps",
                jump.name
            );
            return Err(Error::Model { path: "lift".into(), message });
        }
        let (nx, blocks) = (self.size().nx, 2 * truncation + 1);
        let a = self.fourier(Entry::A, 2 * truncation);
        let pumping = TAU / self.period();
        let n = blocks * nx;
        let mut out = vec![Complex::new(0.0, 0.0); n * n];
        for row in 0..n {
            for column in 0..n {
                let (i, r, j, c) = (row / nx, row % nx, column / nx, column % nx);
                out[row * n + column] = a[i + 2 * truncation - j][r * nx + c];
            }
            out[row * n + row].im -= (row / nx) as f64 * pumping - truncation as f64 * pumping;
        }
        Ok(out)
    }

    /// Harmonic transfer functions with harmonics -K..=K at `omega` (rad/s) by the harmonic state space truncated at `N >= K`:
    /// `C (jw I - (A - N))^{-1} B + D`.
    ///
    /// # Errors
    /// As [`LtpSystem::lift`]; `OutOfRange` for a truncation below K and for a frequency that is an eigenvalue of the lift.
    pub fn lifted_htf(&self, omega: &[f64], harmonics: usize, truncation: usize) -> Result<Htf> {
        if truncation < harmonics {
            let expected = format!("at least the {harmonics} harmonics asked for");
            return Err(Error::OutOfRange { what: "truncation".into(), found: truncation as f64, expected });
        }
        let lift = self.lift(truncation)?;
        let Size { nx, nu, ny } = self.size();
        let blocks = 2 * truncation + 1;
        let n = blocks * nx;
        let b = self.fourier(Entry::B, truncation);
        let c = self.fourier(Entry::C, truncation + harmonics);
        let d = self.fourier(Entry::D, harmonics);
        let rows = 2 * harmonics + 1;
        let mut values = vec![Complex::new(0.0, 0.0); rows * omega.len() * ny * nu];
        for (i, &w) in omega.iter().enumerate() {
            let matrix = DMatrix::from_fn(n, n, |r, col| {
                let own = if r == col { Complex::new(0.0, w) } else { Complex::new(0.0, 0.0) };
                own - lift[r * n + col]
            });
            let lu = matrix.lu();
            for input in 0..nu {
                let right = DVector::from_fn(n, |r, _| b[r / nx][r % nx * nu + input]);
                let x = lu.solve(&right).ok_or_else(|| Error::OutOfRange {
                    what: "omega".into(),
                    found: w,
                    expected: "a frequency that is no eigenvalue of the lift: there the response grows without end"
                        .into(),
                })?;
                for row in 0..rows {
                    for y in 0..ny {
                        let mut sum = d[row][y * nu + input];
                        for m in 0..blocks {
                            // harmonic of C that carries block m - N to harmonic row - K
                            let k = row + 2 * truncation - m;
                            sum += (0..nx).map(|s| c[k][y * nx + s] * x[m * nx + s]).sum::<Complex>();
                        }
                        values[((row * omega.len() + i) * ny + y) * nu + input] = sum;
                    }
                }
            }
        }
        let method = format!("harmonic state space, truncated at {truncation} harmonics");
        let mut htf = Htf::new(self.period(), harmonics, omega.to_vec(), (ny, nu), values, &method)?;
        htf.warnings.extend(self.check_truncation(truncation).err().map(|e| e.to_string()));
        Ok(htf)
    }
}
