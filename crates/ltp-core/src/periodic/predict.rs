//! What harmonic transfer functions predict: their values between the grid, sines in steady state, any input.

use rayon::prelude::*;
use rustfft::FftPlanner;
use std::f64::consts::TAU;

use super::htf::Htf;
use crate::error::{Error, Result};
use crate::numeric::Complex;

/// Points of the polynomial that interpolates between grid frequencies.
const POINTS: usize = 6;
/// Power of an input beyond the grid, relative to all of it, that makes a prediction doubtful.
const OUTSIDE: f64 = 1e-4;

/// A predicted output with what is doubtful about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Outputs (n, ny).
    pub outputs: Vec<f64>,
    /// Doubts, with numbers and advice.
    pub warnings: Vec<String>,
}

impl Htf {
    /// `H_k(j omega)` from input `u` to output `y`, for any sign of `omega` (rad/s) and `k`; zero more than one spacing beyond
    /// the grid, and for harmonics that are not there.
    ///
    /// Between grid frequencies a polynomial through the six nearest values interpolates; across zero, through the values
    /// that a real system has at negative frequencies.
    pub fn at(&self, k: i64, omega: f64, y: usize, u: usize) -> Complex {
        if k.unsigned_abs() as usize > self.harmonics() {
            return Complex::new(0.0, 0.0);
        }
        if omega < 0.0 {
            return self.at(-k, -omega, y, u).conj();
        }
        let grid = self.omega();
        let n = grid.len();
        let last = grid[n - 1];
        // A band that ends between two lines of a record ends up to one spacing above the last of them.
        let beyond = if n > 1 { last - grid[n - 2] } else { 0.0 };
        if omega > last + beyond {
            return Complex::new(0.0, 0.0);
        }
        let above = grid.partition_point(|w| *w < omega);
        if above < n && grid[above] == omega {
            return self.value(k, above, y, u);
        }
        // Grid points of negative index are the mirror images of those above zero.
        let zero = usize::from(grid[0] == 0.0);
        let mirrored = (n - zero) as i64;
        let most = (n as i64 + mirrored).min(POINTS as i64);
        let low = (above as i64 - most / 2).clamp(-mirrored, n as i64 - most);
        let point = |i: i64| -> (f64, Complex) {
            if i >= 0 {
                (grid[i as usize], self.value(k, i as usize, y, u))
            } else {
                let i = (-i - 1) as usize + zero;
                (-grid[i], self.value(-k, i, y, u).conj())
            }
        };
        let points: Vec<(f64, Complex)> = (low..low + most).map(point).collect();
        let mut sum = Complex::new(0.0, 0.0);
        for (i, (at, value)) in points.iter().enumerate() {
            let others = points.iter().enumerate().filter(|(j, _)| *j != i);
            sum += value * others.map(|(_, (w, _))| (omega - w) / (at - w)).product::<f64>();
        }
        sum
    }

    /// Steady state under `amplitude * cos(omega t + phase)` on input `u`, at times `t` (n): outputs (n, ny).
    ///
    /// With `omega = 0` and `phase = 0`, the response to a constant once its transient is over.
    pub fn steady_state(&self, omega: f64, amplitude: f64, phase: f64, u: usize, t: &[f64]) -> Vec<f64> {
        let (ny, harmonics) = (self.outputs(), self.harmonics() as i64);
        let lines: Vec<(f64, Vec<Complex>)> = (-harmonics..=harmonics)
            .map(|k| {
                let values = (0..ny).map(|y| self.at(k, omega, y, u) * Complex::from_polar(amplitude, phase));
                (omega + k as f64 * self.pumping(), values.collect())
            })
            .collect();
        let mut out = Vec::with_capacity(t.len() * ny);
        for &t in t {
            for y in 0..ny {
                out.push(lines.iter().map(|(w, h)| (h[y] * Complex::from_polar(1.0, w * t)).re).sum());
            }
        }
        out
    }

    /// Response to any input, transients included: `u` (n, nu) sampled at `t0 + i*dt`, zero before and after, outputs (n, ny)
    /// at the same times.
    ///
    /// `y(t) = sum_k e^{j k w_p t} F^{-1}[H_k U](t)`; the input is taken as band-limited between its samples, and padded with
    /// rest so that nothing wraps round. What it holds beyond the grid of frequencies cannot be predicted and is said.
    ///
    /// # Errors
    /// `Shape`, `OutOfRange` for a step that is not positive, `NotFinite`.
    pub fn predict(&self, u: &[f64], t0: f64, dt: f64) -> Result<Prediction> {
        let (nu, ny) = (self.inputs(), self.outputs());
        if !(dt > 0.0 && dt.is_finite()) {
            let expected = "a positive sampling step in s".into();
            return Err(Error::OutOfRange { what: "dt".into(), found: dt, expected });
        }
        if u.is_empty() || !u.len().is_multiple_of(nu) {
            return Err(Error::Shape { what: "input samples, n*nu".into(), expected: nu, found: u.len() });
        }
        if let Some(row) = u.iter().position(|v| !v.is_finite()) {
            let value = u[row];
            return Err(Error::NotFinite {
                what: "input".into(),
                row: row / nu,
                column: format!("{}", row % nu),
                value,
            });
        }
        let n = u.len() / nu;
        let grid = self.omega();
        // The longest response the grid can tell from a shorter one, but no more rest than three times the record.
        let spacing =
            if grid.len() > 1 { (grid[grid.len() - 1] - grid[0]) / (grid.len() - 1) as f64 } else { f64::MAX };
        let rest = (TAU / spacing / dt).clamp(20.0 * self.period() / dt, 3.0 * n as f64 + 20.0 * self.period() / dt);
        let length = smooth(n + rest.ceil() as usize);
        let mut planner = FftPlanner::new();
        let forward = planner.plan_fft_forward(length);
        let inverse = planner.plan_fft_inverse(length);
        let zero = Complex::new(0.0, 0.0);
        let spectra: Vec<Vec<Complex>> = (0..nu)
            .map(|j| {
                let mut x = vec![zero; length];
                x.iter_mut().zip(u.iter().skip(j).step_by(nu)).for_each(|(x, u)| x.re = *u);
                forward.process(&mut x);
                x
            })
            .collect();
        let omega = |i: usize| {
            let line = if i <= length / 2 { i as f64 } else { i as f64 - length as f64 };
            line * TAU / (length as f64 * dt)
        };
        let mut warnings = Vec::new();
        let (mut outside, mut all) = (0.0, 0.0);
        for (i, line) in spectra.iter().flat_map(|s| s.iter().enumerate()) {
            all += line.norm_sqr();
            outside += if omega(i).abs() > grid[grid.len() - 1] { line.norm_sqr() } else { 0.0 };
        }
        if outside > OUTSIDE * all {
            warnings.push(format!(
                "{:.2} % of the input's power lies beyond {:.4} rad/s, where the transfer functions end: what it does to the \
                 outputs is not predicted; smooth the input or identify a wider band",
                100.0 * outside / all,
                grid[grid.len() - 1]
            ));
        }
        // x_k = F^{-1}[H_k U]; the harmonic -k gives its conjugate.
        let one = |job: usize| -> Vec<Complex> {
            let (k, y) = ((job / ny) as i64, job % ny);
            let mut lines = vec![zero; length];
            for (j, spectrum) in spectra.iter().enumerate() {
                for (i, line) in lines.iter_mut().enumerate() {
                    *line += self.at(k, omega(i), y, j) * spectrum[i];
                }
            }
            inverse.process(&mut lines);
            lines.truncate(n);
            lines
        };
        let jobs: Vec<usize> = (0..(self.harmonics() + 1) * ny).collect();
        let mut outputs = vec![0.0; n * ny];
        // A few at a time: all of them at once would need K times the memory.
        for chunk in jobs.chunks(8) {
            let parts: Vec<Vec<Complex>> = chunk.par_iter().map(|&job| one(job)).collect();
            for (&job, part) in chunk.iter().zip(parts) {
                let (k, y) = ((job / ny) as f64, job % ny);
                let factor = if k == 0.0 { 1.0 } else { 2.0 } / length as f64;
                for (i, x) in part.iter().enumerate() {
                    let turn = Complex::from_polar(1.0, k * self.pumping() * (t0 + i as f64 * dt));
                    outputs[i * ny + y] += factor * (x * turn).re;
                }
            }
        }
        Ok(Prediction { outputs, warnings })
    }
}

/// The next length whose only prime factors are 2, 3 and 5, which a Fourier transform likes.
fn smooth(n: usize) -> usize {
    let fits = |mut m: usize| {
        for p in [2, 3, 5] {
            while m.is_multiple_of(p) {
                m /= p;
            }
        }
        m == 1
    };
    (n..).find(|&m| fits(m)).unwrap_or(n)
}
