//! Siddiqi's least squares with a curvature penalty, as published: equations (8) to (12).
//!
//! At each output frequency `w` the lines obey `Y(w) = sum_k U(w - k w_p) G_k(w)`, with `G_k(w) = H_k(w - k w_p)`: one
//! equation for 2K+1 unknowns. What makes them determined is that every `G_k` bends little from line to line,
//!
//! `min sum_w |Y - sum_k U G_k|^2 + alpha S sum_w sum_k |G_k(w + dw) - 2 G_k(w) + G_k(w - dw)|^2`,
//!
//! `S` the mean of `|U|^2` over the lines of the band, so that the smoothness `alpha` is a pure number (it goes with the fourth
//! power of the record's length). All harmonics and frequencies are one problem, for `|w|` up to band plus `(K + 0.33) w_p`; a
//! real system's halves mirror each other, and only one is computed. [`crate::numeric::smoother`] solves it in memory
//! proportional to the unknowns, [`crate::numeric::penalised`] as the banded system of the paper. Products `U^* U` and
//! `U^* Y` are never averaged: they are the extended power and cross spectral densities of the single record.
//!
//! The smoothness is chosen by generalised cross-validation, noise is read off the residuals along the output frequency, and
//! standard deviations are those of the random walk that the penalty stands for: they know nothing of resonances sharper
//! than it allows, nor of harmonics beyond K.
//!
//! References: I. Uyanik, M. M. Ankarali, N. J. Cowan, U. Saranli, Ö. Morgül, Transactions of the Institute of Measurement and
//! Control 38 (2016) 1105-1120 [doi 10.1177/0142331215583327]; A. Siddiqi, *Identification of the Harmonic Transfer
//! Functions of a Helicopter Rotor*, MIT 2001; P. Craven and G. Wahba, Numerische Mathematik 31 (1978) 377-403.

mod axis;

use std::time::{Duration, Instant};

use super::Spectra;
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::penalised::Penalised;
use crate::numeric::smoother::{End, Estimate, Observations, Smoother, Uncertainty};
use crate::periodic::Htf;
use axis::Axis;

/// Decades of the smoothness that cross-validation looks at, and the steps of its first look.
const DECADES: [f64; 2] = [-6.0, 12.0];
const LOOK: f64 = 2.0;
/// Cross-validation ends when the smoothness is known to this many decades.
const ENOUGH: f64 = 0.1;
/// Noise is read off this part of a pumping frequency on either side, and off at least so many free residuals.
const WINDOW: f64 = 1.0 / 16.0;
const FREE: f64 = 10.0;
/// Less than this share of the data left free by the unknowns is doubtful.
const DOUBTFUL: f64 = 0.1;
/// What cross-validation charges for a parameter.
const PARAMETER: f64 = 1.4;

/// Options of the method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Weight of the curvature, in units of the mean `|U|^2` per line within the band; `None`: by generalised
    /// cross-validation.
    pub smoothness: Option<f64>,
    /// Route to the minimiser.
    pub solver: Solver,
}

/// Route to the minimiser: both find the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// A Kalman smoother along the output frequency.
    #[default]
    Smoother,
    /// One banded system, as published. Standard deviations and cross-validation still come from the smoother.
    Banded,
}

/// Harmonic transfer functions with standard deviations and coherence.
///
/// Figures: `smoothness`, `gcv` (of the first output), `noise_sd` (per output, in its unit, of a sample), `frequencies` and
/// `unknowns` (complex, of both halves), `equations` (of one half) and `determined` (of them, what the unknowns use up),
/// `solve_seconds` (of the solution alone; the only figure that differs from run to run).
///
/// # Errors
/// `OutOfRange` for a smoothness that is not positive, `NoConvergence` when the data leave the problem singular.
pub fn identify(spectra: &Spectra, options: &super::Options, own: &Options) -> Result<Htf> {
    if let Some(smoothness) = own.smoothness
        && !(smoothness > 0.0 && smoothness.is_finite())
    {
        let expected = "a positive, finite number; leave it out to have it found from the data".into();
        return Err(Error::OutOfRange { what: "smoothness".into(), found: smoothness, expected });
    }
    let axis = Axis::new(spectra, options.harmonics);
    let observations = axis.observations(spectra, false);
    let data: Vec<Vec<Complex>> = (0..spectra.outputs()).map(|j| axis.data(spectra, j, false)).collect();
    let end = End::Mirror(axis.mirror());
    let mut warnings: Vec<String> = spectra.warnings().iter().chain(&axis.warnings).cloned().collect();

    let smoothness = match own.smoothness {
        Some(smoothness) => smoothness,
        None => cross_validate(&observations, &end, &data, &mut warnings)?,
    };
    let began = Instant::now();
    let smoother = Smoother::new(&observations, smoothness, &end)?;
    let factored = began.elapsed();
    let uncertainty = smoother.uncertainty();
    let began = Instant::now();
    let fits: Vec<Estimate> = match own.solver {
        Solver::Smoother => data.iter().map(|y| smoother.solve(y)).collect::<Result<_>>()?,
        Solver::Banded => banded(spectra, &axis, smoothness)?,
    };
    let solved = began.elapsed() + if own.solver == Solver::Smoother { factored } else { Duration::ZERO };
    let free: f64 = uncertainty.remaining.iter().sum();
    let rows = axis.rows() as f64;
    if free < DOUBTFUL * rows {
        warnings.push(format!(
            "{} harmonics use up {:.1} % of {rows} equations at smoothness {smoothness:.3e}: little is left to tell noise from \
             response; use fewer harmonics, more smoothness or a longer record",
            2 * options.harmonics + 1,
            100.0 * (1.0 - free / rows)
        ));
    }
    let answer = Answer { spectra, axis: &axis, uncertainty: &uncertainty, fits: &fits, data: &data };
    let mut htf = answer.htf()?;
    let (frequencies, unknowns) = ((2 * axis.top + 1) as f64, axis.unknowns());
    let figure = |name: &str, value: f64| (name.to_owned(), value);
    htf.figures = vec![
        figure("smoothness", smoothness),
        figure("gcv", score(&fits[0], &uncertainty)),
        figure("frequencies", frequencies),
        figure("unknowns", frequencies * unknowns as f64),
        figure("equations", rows),
        figure("determined", rows - free),
        figure("solve_seconds", solved.as_secs_f64()),
    ];
    let noise = fits.iter().map(|fit| (power(&fit.residuals) / free).sqrt());
    htf.figures.extend(noise.map(|sd| figure("noise_sd", sd)));
    htf.warnings = warnings;
    Ok(htf)
}

/// The smoothness with the smallest product over the outputs of generalised cross-validation scores.
fn cross_validate(
    observations: &Observations,
    end: &End,
    data: &[Vec<Complex>],
    warnings: &mut Vec<String>,
) -> Result<f64> {
    let score = |decade: f64| -> Result<f64> {
        let smoother = Smoother::new(observations, 10_f64.powf(decade), end)?;
        let uncertainty = smoother.uncertainty();
        data.iter().map(|y| Ok(score(&smoother.solve(y)?, &uncertainty).ln())).sum()
    };
    let count = ((DECADES[1] - DECADES[0]) / LOOK).round() as usize;
    let grid: Vec<f64> = (0..=count).map(|i| DECADES[0] + i as f64 * LOOK).collect();
    let scores: Vec<f64> = grid.iter().map(|&decade| score(decade)).collect::<Result<_>>()?;
    let best = (0..=count).min_by(|&a, &b| scores[a].total_cmp(&scores[b])).unwrap_or(0);
    if best == 0 || best == count {
        warnings.push(format!(
            "cross-validation asks for a smoothness of 1e{} or beyond: {}",
            grid[best],
            if best == 0 {
                "the response varies from line to line; record longer"
            } else {
                "nothing bends; the record says little"
            }
        ));
        return Ok(10_f64.powf(grid[best]));
    }
    // golden section
    let golden = 0.5 * (5_f64.sqrt() - 1.0);
    let (mut low, mut high) = (grid[best - 1], grid[best + 1]);
    let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_a, mut at_b) = (score(a)?, score(b)?);
    while high - low > ENOUGH {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - golden * (high - low);
            at_a = score(a)?;
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + golden * (high - low);
            at_b = score(b)?;
        }
    }
    Ok(10_f64.powf(0.5 * (low + high)))
}

/// Generalised cross-validation: the mean square of the residuals over the square of the share that is free, every parameter
/// counted 1.4 times. Counted once, the score has a second minimum where the fit interpolates, and takes it for the better one
/// when there is hardly any noise (Y.-J. Kim and C. Gu, J. R. Statist. Soc. B 66 (2004) 337-356).
fn score(fit: &Estimate, uncertainty: &Uncertainty) -> f64 {
    let rows = fit.residuals.len() as f64;
    let used = rows - uncertainty.remaining.iter().sum::<f64>();
    let free = 1.0 - PARAMETER * used / rows;
    if free > 0.0 { power(&fit.residuals) / rows / (free * free) } else { f64::INFINITY }
}

fn power(values: &[Complex]) -> f64 {
    values.iter().map(|v| v.norm_sqr()).sum()
}

/// Each output's fit by the banded system over both halves; the half from the top down to zero is kept.
fn banded(spectra: &Spectra, axis: &Axis, smoothness: f64) -> Result<Vec<Estimate>> {
    let observations = axis.observations(spectra, true);
    let system = Penalised::new(&observations, smoothness)?;
    let (n, rows) = (axis.unknowns(), axis.rows());
    let fit = |j: usize| {
        let y = axis.data(spectra, j, true);
        let (mut values, passes) = system.solve(&y)?;
        values.truncate((axis.top + 1) * n);
        let fitted = |row: usize, t: usize| -> Complex {
            (0..n).map(|i| observations.coefficient(row, i) * values[t * n + i]).sum()
        };
        let residuals = axis.steps().zip(0..rows).map(|(t, row)| y[row] - fitted(row, t)).collect();
        Ok(Estimate { values, residuals, passes })
    };
    (0..spectra.outputs()).map(fit).collect()
}

/// What the fit says, on its way from `G_k` at output frequencies to `H_k` at input frequencies.
struct Answer<'a> {
    spectra: &'a Spectra,
    axis: &'a Axis,
    uncertainty: &'a Uncertainty,
    fits: &'a [Estimate],
    data: &'a [Vec<Complex>],
}

impl Answer<'_> {
    fn htf(&self) -> Result<Htf> {
        let (axis, k) = (self.axis, self.axis.harmonics as i64);
        let lines = (self.spectra.band() / axis.spacing * (1.0 + 1e-12)) as usize + 1;
        let omega: Vec<f64> = (0..lines).map(|b| b as f64 * axis.spacing).collect();
        let (mirror, n) = (axis.mirror(), axis.unknowns());
        let noise: Vec<(Vec<f64>, Vec<f64>)> = (0..self.fits.len()).map(|j| self.noise(j)).collect();
        let (mut values, mut sd) = (Vec::new(), Vec::new());
        for harmonic in -k..=k {
            for b in 0..lines {
                let out = b as i64 + harmonic * axis.periods as i64;
                let step = axis.top.saturating_sub(out.unsigned_abs() as usize);
                for (fit, (variance, _)) in self.fits.iter().zip(&noise) {
                    for i in 0..axis.inputs {
                        let at = (harmonic + k) as usize * axis.inputs + i;
                        let value =
                            if out < 0 { fit.values[step * n + mirror[at]].conj() } else { fit.values[step * n + at] };
                        let own = if out < 0 { mirror[at] } else { at };
                        values.push(value / axis.scale[i]);
                        sd.push((self.variance(step, own) * variance[step]).sqrt() / axis.scale[i]);
                    }
                }
            }
        }
        let coherence =
            (0..lines).flat_map(|b| noise.iter().map(move |(_, coherence)| coherence[axis.top - b])).collect();
        let size = (self.fits.len(), axis.inputs);
        let method = "least squares with a curvature penalty (Siddiqi 2001, Uyanik et al. 2015)";
        Htf::new(self.spectra.period(), axis.harmonics, omega, size, values, method)?
            .with_sd(sd)?
            .with_coherence(coherence)
    }

    /// Variance of unknown `i` for unit noise at a step, between the steps where it is known.
    fn variance(&self, step: usize, i: usize) -> f64 {
        let (steps, n) = (&self.uncertainty.steps, self.axis.unknowns());
        let at = |c: usize| self.uncertainty.variances[c * n + i].max(f64::MIN_POSITIVE);
        let above = steps.partition_point(|&s| s < step).min(steps.len() - 1);
        if above == 0 || steps[above] == step {
            return at(above);
        }
        let share = (step - steps[above - 1]) as f64 / (steps[above] - steps[above - 1]) as f64;
        (at(above - 1).ln() * (1.0 - share) + at(above).ln() * share).exp()
    }

    /// Of output `j` at every step: variance of the noise around it, and the part of the output's power that is explained.
    fn noise(&self, j: usize) -> (Vec<f64>, Vec<f64>) {
        let steps = self.axis.top + 1;
        let mut sums = vec![[0.0; 3]; steps + 1];
        let rows =
            self.axis.steps().zip(&self.fits[j].residuals).zip(self.uncertainty.remaining.iter().zip(&self.data[j]));
        for ((step, residual), (free, y)) in rows {
            let values = [residual.norm_sqr(), free.max(0.0), y.norm_sqr()];
            (0..3).for_each(|i| sums[step + 1][i] += values[i]);
        }
        for step in 0..steps {
            (0..3).for_each(|i| sums[step + 1][i] += sums[step][i]);
        }
        let within = |low: usize, high: usize, i: usize| sums[high][i] - sums[low][i];
        let width = ((WINDOW * self.axis.periods as f64) as usize).max(1);
        let at = |step: usize| {
            let mut width = width;
            loop {
                let (low, high) = (step.saturating_sub(width), (step + width + 1).min(steps));
                let [rest, free, all] = [0, 1, 2].map(|i| within(low, high, i));
                if free >= FREE || (low == 0 && high == steps) {
                    let explained = if all > 0.0 { (1.0 - rest / all).clamp(0.0, 1.0) } else { 0.0 };
                    return (rest / free.max(f64::MIN_POSITIVE), explained);
                }
                width *= 2;
            }
        };
        (0..steps).map(at).unzip()
    }
}

#[cfg(test)]
#[path = "curvature_tests.rs"]
mod tests;
