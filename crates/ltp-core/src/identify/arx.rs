//! Periodic ARX: a discrete linear time-periodic model from inputs to outputs whose coefficients are Fourier series in phase.
//!
//! In each segment of a good cycle, with spacing `q` samples and lags counted in spacings,
//!
//! `y[i] = c(phi) + sum_{l=1..na} A_l(phi) y[i - l q] + sum_{l=1..nb} B_l(phi) u_l[i] + e[i]`,
//!
//! where `u_l[i]` is the mean of the input samples from `i - l q` to `i - (l-1) q - 1`: held input (zero order), because under
//! feedback a sample of the input at `i` already answers the noise in `y[i]`. `c` carries the orbit with `offset`
//! harmonics, `A` and `B` have `harmonics` of them: 0 makes the linear time-invariant model around the orbit. No row
//! reaches across an event, so that jumps of velocity are neither fitted nor smeared. A free run with spacing `q` is `q`
//! interleaved runs, each from measured samples of its own: where those are noisy it shows a ripple of that period.
//!
//! The estimate is least squares (a direct prediction-error method, consistent under feedback when the lags take up the
//! noise's colour and the loop has a delay or an excitation of its own; L. Ljung, *System Identification*, 2nd ed., 13.4). Its
//! uncertainty comes from drawing whole groups of cycles with replacement, because samples of one run resemble each
//! other. The draws hold the phase (the marks of the events, the usual durations) and the orders for known: with enough
//! harmonics, 95 % bands from twelve groups cover 90 to 95 %, and where data are so good that the bands are below a percent
//! of the value, too few harmonics let them fall to 75 % (planted walkers). Whether it is worth anything is judged in free
//! run on groups that were held out ([`super::held_out`]).
//!
//! References: S. Bittanti and P. Colaneri, *Periodic Systems*, Springer 2009, ch. 8 (PARX); M. M. Ankarali and N. J. Cowan,
//! IEEE CDC 2014; B. Efron and R. J. Tibshirani, *An Introduction to the Bootstrap*, 1993.

use std::f64::consts::TAU;

use super::phase::{Phase, Segment, samples_of};
use crate::error::{Error, Result};
use crate::numeric::rng::SplitMix64;
use crate::numeric::rows::RowQr;
use crate::numeric::stats;
use crate::signal::Recording;

/// Share of a regressor that is not in the others, below which the data cannot tell them apart.
const DEPENDENT: f64 = 1e-9;

/// What the model is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Names of the channels that drive.
    pub inputs: Vec<String>,
    /// Names of the channels that answer.
    pub outputs: Vec<String>,
    /// Output lags `na`, at least 1.
    pub output_lags: usize,
    /// Input lags `nb`, at least 1.
    pub input_lags: usize,
    /// Samples per lag `q`: neighbouring samples of a smooth motion say the same, and noise would decide.
    pub spacing: usize,
    /// Harmonics of the coefficients; 0 for time-invariant ones.
    pub harmonics: usize,
    /// Harmonics of the offset that carries the orbit. Too few, and the coefficients vary to make up for them: raise it until
    /// the score of the time-invariant model stands still before believing that they vary.
    pub offset: usize,
    /// Bootstrap draws for the uncertainty; 0 for none.
    pub draws: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Options {
    /// Sensible orders for `inputs` and `outputs`: three lags of one sample, two harmonics, eight in the offset, 200 draws.
    pub fn new(inputs: &[String], outputs: &[String]) -> Self {
        let (inputs, outputs) = (inputs.to_vec(), outputs.to_vec());
        let (output_lags, input_lags, spacing, harmonics, offset, draws, seed) = (3, 3, 1, 2, 8, 200, 0);
        Self { inputs, outputs, output_lags, input_lags, spacing, harmonics, offset, draws, seed }
    }

    fn check(&self) -> Result<()> {
        let counts = [("inputs", self.inputs.len()), ("outputs", self.outputs.len())];
        let orders = [("output_lags", self.output_lags), ("input_lags", self.input_lags), ("spacing", self.spacing)];
        for (what, found) in counts.into_iter().chain(orders) {
            if found == 0 {
                return Err(Error::OutOfRange { what: what.into(), found: 0.0, expected: "at least 1".into() });
            }
        }
        Ok(())
    }

    /// Samples at the start of each segment that a prediction needs.
    pub fn start_up(&self) -> usize {
        self.spacing * self.output_lags.max(self.input_lags)
    }

    /// Number of regressors at one phase: output lags, then input lags.
    fn width(&self) -> usize {
        self.output_lags * self.outputs.len() + self.input_lags * self.inputs.len()
    }

    /// Number of unknowns per output.
    fn unknowns(&self) -> usize {
        2 * self.offset + 1 + self.width() * (2 * self.harmonics + 1)
    }
}

/// A periodic ARX model with the draws that carry its uncertainty.
#[derive(Clone, Debug)]
pub struct PeriodicArx {
    /// What it is made of.
    pub options: Options,
    /// Sampling step, s.
    dt: f64,
    /// Period, s, phases of the events and usual durations of the segments between them, s.
    marks: Vec<(f64, f64, f64)>,
    /// Coefficients (ny, unknowns), row-major: offset, then the regressors for each basis function in turn.
    theta: Vec<f64>,
    /// The same for each draw.
    draws: Vec<Vec<f64>>,
    /// Standard deviation of the one-step errors, by output, in its unit.
    pub noise_sd: Vec<f64>,
    /// Rows fitted, and unknowns per output.
    pub size: (usize, usize),
    /// Number of groups of cycles behind the uncertainty.
    pub groups: usize,
    /// What is doubtful, with numbers and advice.
    pub warnings: Vec<String>,
}

/// The answer of the outputs to a step of one input that begins at some phase, as deviations from the orbit.
#[derive(Clone, Debug, PartialEq)]
pub struct StepResponse {
    /// Times since the step (m), s.
    pub t: Vec<f64>,
    /// Deviations (m, ny), row-major, in output units per unit of input.
    pub values: Vec<f64>,
    /// Standard deviations (m, ny) over the draws; NaN without draws.
    pub sd: Vec<f64>,
}

/// Estimates a periodic ARX model from the good cycles.
///
/// # Errors
/// `UnknownName`, `OutOfRange` for orders of zero, `TooShort` when there are fewer rows than three per unknown,
/// `NoConvergence` when the inputs cannot be told apart from the motion.
pub fn identify_arx(recording: &Recording, phase: &Phase, options: &Options) -> Result<PeriodicArx> {
    let parts = Parts::new(recording, phase, options)?;
    parts.fit(recording, phase, None)
}

/// The triangles of every group, from which any choice of groups is fitted without touching the samples again.
pub(super) struct Parts<'a> {
    options: &'a Options,
    /// By group, then output.
    triangles: Vec<Vec<RowQr>>,
    rows: Vec<usize>,
    channels: Channels,
}

impl<'a> Parts<'a> {
    pub(super) fn new(recording: &Recording, phase: &Phase, options: &'a Options) -> Result<Self> {
        options.check()?;
        let channels = Channels::new(recording, options)?;
        let (of_cycle, groups) = phase.groups();
        let unknowns = options.unknowns();
        let inside = |s: &Segment| s.rows(recording.t()).len().saturating_sub(options.start_up());
        // Before any triangle is made: its size is the square of the unknowns.
        enough(recording, phase.segments().iter().map(inside).sum(), unknowns)?;
        let mut triangles = vec![vec![RowQr::new(unknowns); options.outputs.len()]; groups];
        let mut rows = vec![0; groups];
        let (mut regressors, mut row) = (vec![0.0; options.width()], vec![0.0; unknowns]);
        for segment in phase.segments() {
            let Some(group) = of_cycle[segment.cycle] else { continue };
            let range = segment.rows(recording.t());
            for i in range.start + options.start_up()..range.end {
                channels.regressors(options, |l, j| channels.outputs[j][i - l * options.spacing], i, &mut regressors);
                fill(options, segment.elapsed(recording.t()[i]), &regressors, &mut row);
                if row.iter().all(|v| v.is_finite()) && channels.outputs.iter().all(|y| y[i].is_finite()) {
                    let targets = triangles[group].iter_mut().zip(&channels.outputs);
                    targets.for_each(|(triangle, y)| triangle.push(&row, -y[i]));
                    rows[group] += 1;
                }
            }
        }
        Ok(Self { options, triangles, rows, channels })
    }

    /// Fits the groups, all of them or all but `left_out` (then without draws).
    pub(super) fn fit(&self, recording: &Recording, phase: &Phase, left_out: Option<usize>) -> Result<PeriodicArx> {
        let (options, groups) = (self.options, self.triangles.len());
        let chosen: Vec<usize> = (0..groups).filter(|g| Some(*g) != left_out).collect();
        let (rows, unknowns) = (chosen.iter().map(|g| self.rows[*g]).sum::<usize>(), options.unknowns());
        enough(recording, rows, unknowns)?;
        let (theta, squares) = self.solve(&chosen).ok_or_else(|| Error::NoConvergence {
            method: "periodic ARX by least squares".into(),
            iterations: 1,
            residual: f64::NAN,
            advice: "the inputs, lags or harmonics cannot be told apart in these data; take fewer, or a larger spacing"
                .into(),
        })?;
        let (mut draws, mut warnings) = (Vec::new(), Vec::new());
        if left_out.is_none() && options.draws > 0 {
            let mut random = SplitMix64::new(options.seed);
            draws = (0..options.draws)
                .filter_map(|_| self.solve(&(0..groups).map(|_| random.below(groups)).collect::<Vec<_>>()))
                .map(|(theta, _)| theta)
                .collect();
            if groups < 8 {
                warnings.push(format!(
                    "the bands rest on {groups} groups of cycles and are too narrow; record more runs or longer"
                ));
            }
        }
        let freedom = (rows - unknowns) as f64;
        let marks = phase.marks().windows(2).enumerate().map(|(part, w)| (w[0], w[1], usual(phase, part)));
        Ok(PeriodicArx {
            options: options.clone(),
            dt: recording.dt(),
            marks: marks.collect(),
            theta,
            draws,
            noise_sd: squares.iter().map(|s| (s / freedom).sqrt()).collect(),
            size: (rows, unknowns),
            groups,
            warnings,
        })
    }

    /// Coefficients and residual sums of squares of the groups, each as often as it is named.
    fn solve(&self, chosen: &[usize]) -> Option<(Vec<f64>, Vec<f64>)> {
        let (mut theta, mut squares) = (Vec::new(), Vec::new());
        for output in 0..self.options.outputs.len() {
            let mut all = RowQr::new(self.options.unknowns());
            chosen.iter().for_each(|g| all.merge(&self.triangles[*g][output]));
            if all.independence().is_nan() || all.independence() < DEPENDENT {
                return None;
            }
            theta.extend(all.minimiser()?.iter());
            squares.push(all.residual_sum_squares());
        }
        Some((theta, squares))
    }

    pub(super) fn channels(&self) -> &Channels {
        &self.channels
    }
}

/// Whether the rows are at least three per unknown.
fn enough(recording: &Recording, rows: usize, unknowns: usize) -> Result<()> {
    if rows >= 3 * unknowns {
        return Ok(());
    }
    let few = "fewer harmonics or lags need fewer";
    let what = format!("rows for {unknowns} unknowns of a periodic ARX on `{}` ({few})", recording.name());
    Err(Error::TooShort { what, needed: 3 * unknowns, found: rows })
}

fn usual(phase: &Phase, part: usize) -> f64 {
    phase.segments().iter().find(|s| s.part == part).map_or(f64::NAN, |s| s.usual)
}

/// The samples of the channels, and running sums of the inputs.
pub(super) struct Channels {
    pub(super) outputs: Vec<Vec<f64>>,
    sums: Vec<Vec<f64>>,
}

impl Channels {
    fn new(recording: &Recording, options: &Options) -> Result<Self> {
        let of = |names: &[String]| names.iter().map(|name| samples_of(recording, name)).collect::<Result<Vec<_>>>();
        let running = |x: Vec<f64>| {
            std::iter::once(0.0)
                .chain(x.into_iter().scan(0.0, |sum, v| {
                    *sum += v;
                    Some(*sum)
                }))
                .collect()
        };
        Ok(Self { outputs: of(&options.outputs)?, sums: of(&options.inputs)?.into_iter().map(running).collect() })
    }

    /// Regressors of sample `i`; `past(l, j)` is output `j`, `l` spacings before.
    fn regressors(&self, options: &Options, past: impl Fn(usize, usize) -> f64, i: usize, into: &mut [f64]) {
        let (q, mut at) = (options.spacing, 0);
        for l in 1..=options.output_lags {
            for j in 0..options.outputs.len() {
                into[at] = past(l, j);
                at += 1;
            }
        }
        for l in 1..=options.input_lags {
            for sums in &self.sums {
                into[at] = (sums[i - (l - 1) * q] - sums[i - l * q]) / q as f64;
                at += 1;
            }
        }
    }
}

/// One row: the offset's basis, then the regressors times each function of the coefficients' basis.
fn fill(options: &Options, phi: f64, regressors: &[f64], row: &mut [f64]) {
    for (into, v) in row.iter_mut().zip(basis(options.offset, phi)) {
        *into = v;
    }
    let blocks = row[2 * options.offset + 1..].chunks_mut(regressors.len());
    for (block, weight) in blocks.zip(basis(options.harmonics, phi)) {
        block.iter_mut().zip(regressors).for_each(|(into, r)| *into = weight * r);
    }
}

/// 1, cos, sin, cos 2, sin 2, ... of the phase.
fn basis(harmonics: usize, phi: f64) -> impl Iterator<Item = f64> {
    let pair = move |k: usize| {
        let (sin, cos) = (TAU * k as f64 * phi).sin_cos();
        [cos, sin]
    };
    std::iter::once(1.0).chain((1..=harmonics).flat_map(pair))
}

impl PeriodicArx {
    /// Free run of the outputs (n, ny), row-major, through every good segment from its first [`Options::start_up`] measured
    /// samples on, driven by the measured inputs; NaN in those samples and outside.
    ///
    /// # Errors
    /// `UnknownName` when the recording lacks a channel.
    pub fn predict(&self, recording: &Recording, phase: &Phase) -> Result<Vec<f64>> {
        let channels = Channels::new(recording, &self.options)?;
        let ny = self.options.outputs.len();
        let mut all = vec![f64::NAN; recording.len() * ny];
        for segment in phase.segments() {
            self.run(recording, &channels, segment, &mut all);
        }
        Ok(all)
    }

    /// Free run through one segment, written into `all` (n, ny).
    pub(super) fn run(&self, recording: &Recording, channels: &Channels, segment: &Segment, all: &mut [f64]) {
        let (options, ny) = (&self.options, self.options.outputs.len());
        let range = segment.rows(recording.t());
        let first = range.start + options.start_up();
        let (mut regressors, mut row) = (vec![0.0; options.width()], vec![0.0; options.unknowns()]);
        for i in first..range.end {
            let past = |l: usize, j: usize| {
                let at = i - l * options.spacing;
                if at < first { channels.outputs[j][at] } else { all[at * ny + j] }
            };
            channels.regressors(options, past, i, &mut regressors);
            fill(options, segment.elapsed(recording.t()[i]), &regressors, &mut row);
            for (j, theta) in self.theta.chunks(row.len()).enumerate() {
                all[i * ny + j] = theta.iter().zip(&row).map(|(a, b)| a * b).sum();
            }
        }
    }

    /// What the outputs do, as deviations from the orbit, after a unit step of `input` that begins at `phase` in [0, 1), for
    /// `duration` s at most and not beyond the end of the segment, where an event would come.
    ///
    /// # Errors
    /// `UnknownName`; `OutOfRange` for a phase outside [0, 1) or a duration shorter than one spacing.
    pub fn step_response(&self, input: &str, phase: f64, duration: f64) -> Result<StepResponse> {
        let options = &self.options;
        let Some(input) = options.inputs.iter().position(|n| n == input) else {
            let (kind, context) = ("input".into(), "step response of a periodic ARX".into());
            let nearest = crate::error::nearest(input, &options.inputs);
            return Err(Error::UnknownName { kind, name: input.into(), nearest, context });
        };
        let Some(&(start, end, usual)) = self.marks.iter().find(|(a, b, _)| (*a..*b).contains(&phase)) else {
            return Err(Error::OutOfRange { what: "phase".into(), found: phase, expected: "a phase in [0, 1)".into() });
        };
        let step = options.spacing as f64 * self.dt;
        let advance = step * (end - start) / usual;
        let steps = ((duration / step) * (1.0 + 1e-12)).min((end - phase) / advance);
        if steps.is_nan() || steps < 1.0 {
            let expected = format!("at least {step} s, and that much before the event at phase {end}; start earlier");
            return Err(Error::OutOfRange { what: "duration of the step response".into(), found: duration, expected });
        }
        let steps = steps as usize;
        let phases: Vec<f64> = (0..=steps).map(|i| phase + i as f64 * advance).collect();
        let values = self.respond(&self.theta, input, &phases);
        let drawn: Vec<Vec<f64>> = self.draws.iter().map(|theta| self.respond(theta, input, &phases)).collect();
        let sd = (0..values.len()).map(|i| stats::std(drawn.iter().map(|d| d[i]))).collect();
        Ok(StepResponse { t: (0..=steps).map(|i| i as f64 * step).collect(), values, sd })
    }

    /// Deviations (m, ny) along `phases` after a unit step of `input` at the first.
    fn respond(&self, theta: &[f64], input: usize, phases: &[f64]) -> Vec<f64> {
        let (options, ny, nu) = (&self.options, self.options.outputs.len(), self.options.inputs.len());
        let mut values = vec![0.0; phases.len() * ny];
        let (mut regressors, mut row) = (vec![0.0; options.width()], vec![0.0; options.unknowns()]);
        for i in 1..phases.len() {
            regressors.fill(0.0);
            for l in (1..=options.output_lags).filter(|l| *l <= i) {
                regressors[(l - 1) * ny..l * ny].copy_from_slice(&values[(i - l) * ny..(i - l + 1) * ny]);
            }
            for l in (1..=options.input_lags).filter(|l| *l <= i) {
                regressors[options.output_lags * ny + (l - 1) * nu + input] = 1.0;
            }
            fill(options, phases[i], &regressors, &mut row);
            let offset = 2 * options.offset + 1;
            for (j, theta) in theta.chunks(row.len()).enumerate() {
                values[i * ny + j] = theta[offset..].iter().zip(&row[offset..]).map(|(a, b)| a * b).sum();
            }
        }
        values
    }
}

#[cfg(test)]
#[path = "arx_tests.rs"]
mod tests;
