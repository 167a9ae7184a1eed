//! The harmonic transfer functions of a fit, with their standard deviations and the coherence.

use faer::Mat;
use nalgebra::DMatrix;

use super::fit::{Fit, Output};
use super::layout::{BLOCK, Channel, Place};
use super::posterior::{denominator, entry};
use crate::error::Result;
use crate::identify::Spectra;
use crate::numeric::Complex;
use crate::numeric::quartic::{self, BUMPS};
use crate::periodic::Htf;

/// Points of the answer per pumping frequency, at least; resonances and the delay are resolved between them.
const FINEST: f64 = 256.0;
/// Points of the answer at most.
const POINTS: usize = 4096;
/// Half a window of the coherence, in pumping frequencies.
const WINDOW: f64 = 1.0 / 32.0;

/// The harmonic transfer functions up to `harmonics` and `band` (rad/s).
///
/// # Errors
/// As [`Htf::new`].
pub(super) fn answer(spectra: &Spectra, fit: &Fit, harmonics: usize, band: f64) -> Result<Htf> {
    let omega = grid(spectra, band);
    let (ny, nu) = (spectra.outputs(), spectra.inputs());
    let size = (2 * harmonics + 1) * omega.len() * ny * nu;
    let (mut values, mut sd) = (vec![Complex::new(0.0, 0.0); size], vec![0.0; size]);
    let spread = fit.precision.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(fit.a.len(), fit.a.len()));
    for row in 0..=2 * harmonics {
        let k = row as i64 - harmonics as i64;
        for (i, &omega_i) in omega.iter().enumerate() {
            for (y, output) in fit.outputs.iter().enumerate() {
                for u in 0..nu {
                    let at = ((row * omega.len() + i) * ny + y) * nu + u;
                    (values[at], sd[at]) = value(fit, output, &spread, k, u, omega_i);
                }
            }
        }
    }
    let coherence = coherence(spectra, fit, &omega);
    Htf::new(spectra.period(), harmonics, omega, (ny, nu), values, "")?.with_sd(sd)?.with_coherence(coherence)
}

/// Frequencies of the answer: the lines of the longest record, or a finer grid where they are too far apart.
fn grid(spectra: &Spectra, band: f64) -> Vec<f64> {
    let lines = spectra.records().iter().map(|r| r.spacing()).fold(f64::INFINITY, f64::min);
    let finer = (lines / (spectra.pumping() / FINEST)).ceil().max(1.0);
    let coarser = (band * (1.0 + 1e-9) / (lines / finer) / POINTS as f64).ceil().max(1.0);
    let step = lines / finer * coarser;
    let last = (band * (1.0 + 1e-9) / step) as usize;
    (0..=last).map(|i| i as f64 * step).collect()
}

/// Value and standard deviation of harmonic `k` from input `u` at input frequency `omega >= 0`.
fn value(fit: &Fit, output: &Output, spread: &DMatrix<f64>, k: i64, u: usize, omega: f64) -> (Complex, f64) {
    let layout = &fit.layout;
    let place = omega / layout.width();
    let cell = place.floor();
    let bumps = quartic::values(place - cell);
    // Splines of negative output frequency are images of those that are stored.
    let first = cell as i64 + k * layout.knots;
    let image = first < 0;
    let channel = Channel::Harmonic { k: if image { -k } else { k }, input: u };
    let number = |l: usize| if image { BLOCK as i64 - 1 - first - l as i64 } else { first + l as i64 };
    let places: Vec<Option<Place>> = (0..BUMPS).map(|l| layout.place(channel, number(l))).collect();
    let seen = |v: Complex| if image { v.conj() } else { v };
    let turn = Complex::from_polar(1.0, -omega * std::f64::consts::TAU / layout.pumping);
    let factor = Complex::from_polar(1.0, -omega * layout.delay) / denominator(&fit.a, turn);
    let sum = |of: &dyn Fn(Place) -> Complex| -> Complex {
        places.iter().zip(&bumps).filter_map(|(p, &bump)| p.map(|p| seen(of(p)) * bump)).sum()
    };
    let value = factor * sum(&|(block, row)| output.coefficients[block][row]);
    let mut variance = 0.0;
    for (p, &b) in places.iter().zip(&bumps) {
        for (q, &c) in places.iter().zip(&bumps) {
            if let (&Some(p), &Some(q)) = (p, q) {
                variance += b * c * entry(&output.posterior.covariance, p, q).re;
            }
        }
    }
    variance *= factor.norm_sqr();
    // The denominator moves the value directly, and through the numerators that make up for it.
    let mut power = value / denominator(&fit.a, turn);
    let slopes: Vec<Complex> = (0..fit.a.len())
        .map(|i| {
            power *= turn;
            let solution: &[Mat<Complex>] = &output.posterior.solutions;
            power - factor * sum(&|(block, row)| solution[block][(row, i + 1)])
        })
        .collect();
    for (i, left) in slopes.iter().enumerate() {
        for (j, right) in slopes.iter().enumerate() {
            variance += (left.conj() * right).re * spread[(i, j)];
        }
    }
    (value, variance.max(0.0).sqrt())
}

/// One minus the residuals' share of the power around each output frequency, (omega, outputs).
fn coherence(spectra: &Spectra, fit: &Fit, omega: &[f64]) -> Vec<f64> {
    let mut coherence = vec![0.0; omega.len() * fit.outputs.len()];
    for (y, output) in fit.outputs.iter().enumerate() {
        let mut lines: Vec<(f64, f64, f64)> = Vec::new();
        for (c, cell) in fit.cells.iter().enumerate() {
            for (r, row) in cell.rows.iter().enumerate() {
                let at = row.line as f64 * spectra.records()[row.record].spacing();
                lines.push((at, output.residuals[c][r], output.power[c][r]));
            }
        }
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (i, &omega) in omega.iter().enumerate() {
            let mut half = WINDOW * spectra.pumping();
            let mut sums = (0.0, 0.0);
            while sums.1 == 0.0 && half < spectra.pumping() {
                let first = lines.partition_point(|l| l.0 < omega - half);
                let end = lines.partition_point(|l| l.0 <= omega + half);
                sums = lines[first..end].iter().fold((0.0, 0.0), |s, l| (s.0 + l.1, s.1 + l.2));
                half *= 2.0;
            }
            coherence[i * fit.outputs.len() + y] = if sums.1 > 0.0 { (1.0 - sums.0 / sums.1).max(0.0) } else { 0.0 };
        }
    }
    coherence
}
