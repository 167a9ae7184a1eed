//! A whole experiment: a multisine that fits the band and the time there is, and how well it will show each `H_k`.
//!
//! **What it predicts.** A record of `N` samples holds whole periods of the multisine and its output carries white noise of
//! standard deviation `s`. The amplitude of an output line, `(2/N) sum_n y_n e^{-j w n dt}`, then carries complex noise with
//! `E |.|^2 = (2/N)^2 N s^2`; with one source per output line, `H_k(j w_b)` is that amplitude over `a_b e^{j phi_b}`, so
//!
//! `sd(H_k(j w_b)) = 2 s / (a_b sqrt(N))`,  the same for every harmonic `k`,  with `sd^2 = E |estimate - truth|^2`.
//!
//! The 95 % band is a disc of radius `sqrt(ln 20) sd = 1.7308 sd` in the complex plane, since `|.|^2` of circular normal noise is
//! exponential. This is the line-by-line estimate; one that joins lines by smoothness or common poles is narrower, by about
//! the square root of the number of lines that it joins.
//!
//! **What it proposes.** For a given rms `r` and `L` lines of one size, `sd = s r^-1 sqrt(2 L / N)`. Where the gain differs over the
//! band, amplitudes in proportion to `gain^-p` make the relative errors more alike: p = 1/2 splits the difference, p = 1 makes
//! them equal.

use std::f64::consts::TAU;

use super::lines::{self, Choice, Kind};
use super::{Multisine, SLACK, check_band, positive};
use crate::error::{Error, Result};

/// Lines go past the wanted band by this fraction, since estimates are worst at the ends of theirs.
const MARGIN: f64 = 0.05;
/// By default the system is left to settle for this fraction of the time, but for at most so many periods.
const SETTLE: (f64, usize) = (0.1, 100);
/// What may be left of a transient when the record begins.
const REST: f64 = 1e-7;
/// The number of periods may fall this fraction short of the time there is, to be a whole number of samples.
const GIVE: f64 = 0.05;
/// A period of the multisine within this many samples of a whole number has whole samples.
const WHOLE: f64 = 1e-6;

/// What the experiment is to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Period T of the system, s.
    pub period: f64,
    /// Input frequencies wanted, rad/s.
    pub band: (f64, f64),
    /// Time there is, s, settling included.
    pub duration: f64,
    /// Sampling step, s.
    pub dt: f64,
    /// Periods of the multisine in the record. One has the most lines; two and more show noise and distortion as well.
    pub repeats: usize,
    /// Periods T before the record begins, for the system to settle; `None` for a tenth of the time, at most 100.
    pub settle: Option<usize>,
    /// Which lines.
    pub choice: Choice,
}

impl Request {
    /// A request with one period of the multisine, settling by default, and distinct lines.
    pub fn new(period: f64, band: (f64, f64), duration: f64, dt: f64) -> Self {
        Self { period, band, duration, dt, repeats: 1, settle: None, choice: Choice::default() }
    }
}

/// When what happens, and on which lines: what is settled before anything is known of the system's gain.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The request it answers.
    pub request: Request,
    /// Periods T before the record begins.
    pub settle: usize,
    /// Periods T in one period of the multisine.
    pub cycles: usize,
    /// Lines of the multisine (n_lines).
    pub lines: Vec<usize>,
}

/// Noise on the output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Noise {
    /// Not known: deviations are given for noise of standard deviation one.
    #[default]
    Unknown,
    /// Standard deviation of a sample, in the unit of the output.
    Sd(f64),
    /// Mean square of the output over that of the noise; wants a gain.
    Snr(f64),
}

/// How the multisine is shaped, and what is known of the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Root mean square of the input, in its unit.
    pub rms: f64,
    /// Amplitudes are in proportion to `gain^-power`; without effect when the gain is not known.
    pub power: f64,
    /// Noise on the output.
    pub noise: Noise,
    /// Turns of [`super::crest`].
    pub crest_turns: usize,
    /// Seed of the random phases.
    pub seed: u64,
}

impl Default for Shape {
    fn default() -> Self {
        Self { rms: 1.0, power: 0.5, noise: Noise::Unknown, crest_turns: 200, seed: 0 }
    }
}

/// A proposed experiment and its predicted accuracy.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// The plan.
    pub plan: Plan,
    /// The input, from the beginning of settling on.
    pub multisine: Multisine,
    /// Standard deviation of the output noise that is assumed, in the unit of the output; `None` when not known.
    pub noise_sd: Option<f64>,
    /// Standard deviation (n_lines) of each `H_k` on a line: `sd^2 = E |estimate - truth|^2`, line by line; in units of output
    /// over input, or of output noise over output over input when `noise_sd` is not known.
    pub sd: Vec<f64>,
    /// What it will do, with numbers.
    pub advice: Vec<String>,
}

impl Plan {
    /// Divides the time into settling and whole periods of a multisine, and chooses its lines.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a period, band, duration or step that cannot be, a band beyond half the sampling frequency, a
    /// time too short for four periods, or a band without lines.
    pub fn new(request: Request) -> Result<Self> {
        for (what, found) in [("period", request.period), ("duration", request.duration), ("dt", request.dt)] {
            positive(what, found, "s")?;
        }
        check_band(request.band)?;
        let highest = request.band.1 * (1.0 + MARGIN);
        if highest * request.dt >= 0.5 * TAU {
            let expected = format!(
                "below {:.6} rad/s: with a margin of {} % the lines must stay below half the sampling frequency; sample faster \
                 than every {} s",
                0.5 * TAU / request.dt / (1.0 + MARGIN),
                100.0 * MARGIN,
                request.dt
            );
            return Err(Error::OutOfRange { what: "upper end of the band".into(), found: request.band.1, expected });
        }
        let all = (request.duration / request.period * (1.0 + SLACK)).floor() as usize;
        let settle = request.settle.unwrap_or(((SETTLE.0 * all as f64) as usize).min(SETTLE.1));
        let repeats = request.repeats.max(1);
        let most = all.saturating_sub(settle) / repeats;
        if most < 4 {
            let shortest = (4 * repeats + settle) as f64 * request.period;
            let expected = format!(
                "at least {shortest} s: {settle} periods to settle and {repeats} times four in the record; take longer, or \
                 settle and repeat less"
            );
            return Err(Error::OutOfRange { what: "duration".into(), found: request.duration, expected });
        }
        let cycles = whole_samples(most, request.period / request.dt);
        let lines = lines::choose(request.period, cycles, (request.band.0, highest), &request.choice)?;
        Ok(Self { request: Request { repeats, ..request }, settle, cycles, lines })
    }

    /// Period of the multisine, s.
    pub fn multisine_period(&self) -> f64 {
        self.cycles as f64 * self.request.period
    }
    /// Angular frequencies of the lines (n_lines), rad/s.
    pub fn omega(&self) -> Vec<f64> {
        self.lines.iter().map(|&b| TAU * b as f64 / self.multisine_period()).collect()
    }
    /// Time before the record begins, s.
    pub fn settling(&self) -> f64 {
        self.settle as f64 * self.request.period
    }
    /// Length of the record, s, a whole number of periods of the multisine.
    pub fn record(&self) -> f64 {
        self.request.repeats as f64 * self.multisine_period()
    }
    /// Samples in the record, as a real number: not whole when the period is not.
    fn samples(&self) -> f64 {
        self.record() / self.request.dt
    }
}

impl Design {
    /// Radii (n_lines) of the discs that hold each `H_k` on a line with probability 0.95, in the unit of `sd`.
    pub fn band(&self) -> Vec<f64> {
        self.sd.iter().map(|&sd| radius(sd)).collect()
    }
}

/// An experiment by `plan`, with the system's `gain` at its lines where it is known.
///
/// `gain` (n_lines) is the output's rms over the input's for a sine on that line, `sqrt(sum_k |H_k|^2)`; `|H_0|` alone does for
/// the shape, while a signal-to-noise ratio is then taken to be that of a weaker output.
///
/// # Errors
/// [`Error::Shape`] for gains that are not one per line; [`Error::OutOfRange`] for gains, rms or noise that are not positive,
/// and for a signal-to-noise ratio without gains.
pub fn design(plan: &Plan, gain: Option<&[f64]>, shape: &Shape) -> Result<Design> {
    let weights = gain.map(|gain| check_gain(plan, gain, shape.power)).transpose()?;
    let lines = plan.lines.clone();
    let multisine = Multisine::random(plan.multisine_period(), lines, weights.as_deref(), shape.rms, shape.seed)?
        .with_low_crest(shape.crest_turns);
    let noise_sd = match (shape.noise, gain) {
        (Noise::Unknown, _) => None,
        (Noise::Sd(sd), _) => {
            positive("noise_sd", sd, "unit of the output")?;
            Some(sd)
        }
        (Noise::Snr(snr), Some(gain)) => {
            positive("snr", snr, "mean square of the output over that of the noise, not decibels")?;
            let power: f64 = gain.iter().zip(multisine.amplitudes()).map(|(g, a)| 0.5 * (g * a).powi(2)).sum();
            Some((power / snr).sqrt())
        }
        (Noise::Snr(snr), None) => {
            let expected =
                "no ratio without the system's gain, which says how large the output will be; give a model, or the \
                            noise's standard deviation"
                    .into();
            return Err(Error::OutOfRange { what: "snr".into(), found: snr, expected });
        }
    };
    let unit = 2.0 * noise_sd.unwrap_or(1.0) / plan.samples().sqrt();
    let sd: Vec<f64> = multisine.amplitudes().iter().map(|a| unit / a).collect();
    let mut design = Design { plan: plan.clone(), multisine, noise_sd, sd, advice: Vec::new() };
    design.advice = advice(&design, gain);
    Ok(design)
}

/// Largest number of periods, from `most` down, that is even and a whole number of samples; even at least.
fn whole_samples(most: usize, per_period: f64) -> usize {
    let largest = most - most % 2;
    let least = (((1.0 - GIVE) * most as f64) as usize).max(4);
    let misfit = |cycles: usize| {
        let samples = cycles as f64 * per_period;
        (samples - samples.round()).abs()
    };
    (least..=largest).rev().filter(|c| c % 2 == 0).find(|&c| misfit(c) <= WHOLE).unwrap_or(largest)
}

/// Weights of the lines from the gain there.
fn check_gain(plan: &Plan, gain: &[f64], power: f64) -> Result<Vec<f64>> {
    if gain.len() != plan.lines.len() {
        let what = "gain of the system, one per line".into();
        return Err(Error::Shape { what, expected: plan.lines.len(), found: gain.len() });
    }
    super::finite("power of the shape", power, "0 for a flat spectrum, 1 for equal relative errors")?;
    for (i, &g) in gain.iter().enumerate() {
        positive(&format!("gain[{i}]"), g, "output over input")?;
    }
    // Relative to the largest: a power of a tiny gain could leave the range of numbers.
    let largest = gain.iter().copied().fold(0.0, f64::max);
    Ok(gain.iter().map(|g| (g / largest).powf(-power)).collect())
}

/// What the experiment will do, in sentences with numbers.
fn advice(design: &Design, gain: Option<&[f64]>) -> Vec<String> {
    let Design { plan, multisine, .. } = design;
    let request = &plan.request;
    let hz: Vec<f64> = plan.omega().iter().map(|w| w / TAU).collect();
    let gap = hz.windows(2).map(|w| w[1] - w[0]).fold(hz[0], f64::max);
    let mut words = vec![
        format!(
            "Settle for {} s, then record {} s: {} x {} periods.",
            trimmed(plan.settling()),
            trimmed(plan.record()),
            request.repeats,
            plan.cycles
        ),
        format!(
            "{} lines from {:.4} to {:.4} Hz, up to {gap:.4} Hz apart, crest factor {:.2}.",
            hz.len(),
            hz[0],
            hz[hz.len() - 1],
            multisine.crest()
        ),
    ];
    if request.choice.kind == Kind::Distinct {
        let harmonics = ((0.5 / request.dt - hz[hz.len() - 1]) * request.period).floor();
        words.push(format!(
            "Each output line up to harmonic {harmonics} has one source; even lines show noise and even-order distortion alone."
        ));
    }
    let samples = plan.multisine_period() / request.dt;
    if (samples - samples.round()).abs() > WHOLE {
        words.push(format!(
            "A period of the multisine is {samples:.3} samples, not a whole number: the record will have to be resampled; a dt of \
             {:.9} s avoids that.",
            request.period / (request.period / request.dt).round()
        ));
    }
    words.push(expected_accuracy(design, gain, &hz));
    words.push("Four times the time, or twice the rms, halves it.".into());
    words
}

/// The sentence about bands.
fn expected_accuracy(design: &Design, gain: Option<&[f64]>, hz: &[f64]) -> String {
    let discs = design.band();
    let (noise, unit) = match design.noise_sd {
        Some(sd) => (format!("{sd:.3e}"), ""),
        None => ("s".into(), " s"),
    };
    let text = format!("Output noise of deviation {noise} gives each H_k, line by line, a 95 % disc of radius");
    let radii = span(&discs, |r| format!("{r:.3e}{unit}"));
    let (Some(_), Some(gain)) = (design.noise_sd, gain) else {
        return format!("{text} {radii}.");
    };
    let relative: Vec<f64> = discs.iter().zip(gain).map(|(r, g)| 100.0 * r / g).collect();
    let worst = (0..relative.len()).max_by(|&a, &b| relative[a].total_cmp(&relative[b])).unwrap_or(0);
    let percent = span(&relative, |p| format!("{p:.2} %"));
    format!("{text} {radii}, {percent} of the gain, worst at {:.4} Hz.", hz[worst])
}

/// The least and the largest of some numbers as they are written, or the one that they all are.
fn span(values: &[f64], written: impl Fn(f64) -> String) -> String {
    let least = written(values.iter().copied().fold(f64::INFINITY, f64::min));
    let most = written(values.iter().copied().fold(0.0, f64::max));
    if least == most { most } else { format!("{least} to {most}") }
}

/// A time to the microsecond, without the zeros behind it.
fn trimmed(seconds: f64) -> String {
    format!("{seconds:.6}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Periods after which what is left of a start is below 1e-7, from the largest magnitude of the Floquet multipliers.
///
/// # Errors
/// [`Error::OutOfRange`] for a magnitude that is not in [0, 1): such a system does not settle.
pub fn settling_periods(multiplier: f64) -> Result<usize> {
    if !(0.0..1.0).contains(&multiplier) {
        let expected = "below 1: a cycle that is not stable does not settle; stabilise it first".into();
        return Err(Error::OutOfRange { what: "largest Floquet multiplier".into(), found: multiplier, expected });
    }
    Ok((REST.ln() / multiplier.ln()).ceil() as usize)
}

/// Radius of the disc around an estimate that holds the truth with probability 0.95, from its `sd`.
fn radius(sd: f64) -> f64 {
    20.0_f64.ln().sqrt() * sd
}

#[cfg(test)]
#[path = "design_tests.rs"]
mod tests;
