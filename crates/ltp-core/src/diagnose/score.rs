//! How well a candidate explains and predicts: residuals, deviances that survive coloured noise, and energy that is
//! neither noise nor explained.

use super::experiment::{Experiment, Run};
use super::fit::Ground;
use crate::model::Compiled;
use crate::numeric::{stats, whiten};

/// Order of the autoregression that whitens residuals.
const ORDER: usize = 8;

/// Residuals of train and held-out records, in units of each output's noise; (n, ny) row-major, NaN at gaps.
#[derive(Clone, Debug)]
pub struct Residuals {
    /// One per train record.
    pub train: Vec<Vec<f64>>,
    /// One per held-out record.
    pub test: Vec<Vec<f64>>,
    outputs: usize,
}

impl Residuals {
    /// Residuals of a system at given parameters and initial states; NaN throughout where a run fails.
    pub fn of(system: &Compiled, p: &[f64], train: (Ground<'_>, &[Vec<f64>]), test: (Ground<'_>, &[Vec<f64>])) -> Self {
        let all = |(ground, x0): (Ground<'_>, &[Vec<f64>])| -> Vec<Vec<f64>> {
            ground.experiments.iter().zip(x0).map(|(e, x0)| one(system, p, ground, e, x0)).collect()
        };
        let outputs = train.0.sigma.len();
        Self { train: all(train), test: all(test), outputs }
    }

    /// Whether every record could be simulated.
    pub fn complete(&self) -> bool {
        self.train.iter().chain(&self.test).all(|r| r.iter().any(|v| v.is_finite()))
    }

    fn channel<'a>(&self, records: &'a [Vec<f64>], j: usize) -> Vec<Vec<f64>> {
        let ny = self.outputs;
        let series = |r: &'a Vec<f64>| -> Vec<Vec<f64>> {
            let s: Vec<f64> = r.iter().skip(j).step_by(ny).copied().collect();
            stats::finite_runs(s.iter().copied()).into_iter().map(|run| s[run].to_vec()).collect()
        };
        records.iter().flat_map(series).collect()
    }

    /// Sum of squares and number of samples of one output.
    pub fn energy(&self, records: &[Vec<f64>], j: usize) -> (f64, f64) {
        let values = records.iter().flat_map(|r| r.iter().skip(j).step_by(self.outputs)).filter(|v| v.is_finite());
        values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0))
    }

    /// Sum of squares beyond noise, over all outputs, in units of noise.
    pub fn structural(&self, records: &[Vec<f64>]) -> f64 {
        (0..self.outputs)
            .map(|j| {
                let (s, n) = self.energy(records, j);
                s - n
            })
            .sum()
    }

    /// Concentrated Gaussian deviance `sum N ln(S/N)` of white residuals.
    pub fn deviance(&self, records: &[Vec<f64>]) -> f64 {
        (0..self.outputs)
            .map(|j| {
                let (s, n) = self.energy(records, j);
                if n > 0.0 { n * (s / n).max(1e-6).ln() } else { 0.0 }
            })
            .sum()
    }

    /// Whitening filters of the train residuals, one per output.
    pub fn filters(&self) -> Vec<Vec<f64>> {
        (0..self.outputs)
            .map(|j| {
                let runs = self.channel(&self.train, j);
                let runs: Vec<&[f64]> = runs.iter().filter(|r| r.len() > 4 * ORDER).map(Vec::as_slice).collect();
                whiten::ar_burg_pooled(&runs, ORDER)
            })
            .collect()
    }

    /// As [`Residuals::deviance`], of residuals whitened by given filters.
    pub fn whitened_deviance(&self, records: &[Vec<f64>], filters: &[Vec<f64>]) -> f64 {
        (0..self.outputs)
            .map(|j| {
                let (mut s, mut n) = (0.0, 0.0);
                for run in self.channel(records, j) {
                    for e in whiten::whiten(&run, &filters[j]) {
                        s += e * e;
                        n += 1.0;
                    }
                }
                if n > 0.0 { n * (s / n).max(1e-12).ln() } else { 0.0 }
            })
            .sum()
    }

    /// By how much coloured residuals widen intervals: the square root of the ratio of long-run variance to one.
    pub fn inflation(&self) -> f64 {
        let filters = self.filters();
        let widest = (0..self.outputs).map(|j| {
            let (s, n) = self.energy(&self.train, j);
            if n == 0.0 {
                return 1.0;
            }
            let (mut se, mut ne) = (0.0, 0.0);
            for run in self.channel(&self.train, j) {
                for e in whiten::whiten(&run, &filters[j]) {
                    se += e * e;
                    ne += 1.0;
                }
            }
            let gain = (1.0 - filters[j].iter().sum::<f64>()).abs().max(1e-3);
            let long_run = if ne > 0.0 { se / ne / (gain * gain) } else { s / n };
            // Never beyond what a handful of independent stretches would allow.
            (s / n).max(long_run.min(0.1 * s)).max(1.0)
        });
        widest.fold(1.0, f64::max).sqrt()
    }
}

fn one(system: &Compiled, p: &[f64], ground: Ground<'_>, e: &Experiment, x0: &[f64]) -> Vec<f64> {
    let run = Run { system, p, x0, experiment: e, substeps: ground.substeps, observer: None, control: ground.control };
    let ny = e.outputs();
    match run.outputs() {
        Some(y) => y.iter().zip(&e.y).enumerate().map(|(i, (y, m))| (y - m) / ground.sigma[i % ny]).collect(),
        None => vec![f64::NAN; e.y.len()],
    }
}
