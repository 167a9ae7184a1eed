//! Whether the recordings keep the clock they are said to keep.
//!
//! The response of a periodic system to any input is cyclostationary: `y(t) u(t - tau)` has lines at the multiples of
//! `1 / T`, however broad the spectra of `y` and `u` are. Their strength over candidate periods shows the true one to a
//! fraction of a bin. Where the input consists of single lines, the outputs are looked at around those lines instead, since
//! differences of the lines themselves would drown the clock. Where the outputs hold the periodic orbit, its own lines are looked at instead. A system whose
//! response shows no period at all passes: it may well be time-invariant.
//!
//! Reference: W. A. Gardner, *Exploitation of spectral redundancy in cyclostationary signals*, IEEE Signal Processing Magazine
//! 8(2) (1991) 14-36.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use super::spectra::Record;
use super::{Orbit, Spectra, lines};
use crate::error::{Error, Result};
use crate::numeric::{Complex, fft, stats};

/// Lags at which outputs and inputs are multiplied.
const LAGS: usize = 16;
/// Multiples of the clock that are looked at.
const MULTIPLES: usize = 3;
/// Candidate periods: this share on either side of the one given.
const RANGE: f64 = 0.05;
/// Points of a spectrum per bin.
const PADDING: usize = 4;
/// Candidates per bin of the highest multiple.
const FINENESS: f64 = 8.0;
/// A period is seen when its lines are this many times stronger than those of the median candidate.
const SEEN: f64 = 6.0;
/// The same for an orbit's own lines: few numbers are added, and chance goes further.
const SEEN_ORBIT: f64 = 100.0;
/// Width of the windows in which spectra are made flat, in pumping frequencies, so that a resonance does not speak for all.
const FLAT: f64 = 1.0 / 16.0;
/// Power, relative to the mean, that is rounding and is not made flat.
const RUBBISH: f64 = 1e-9;
/// Share of the lines modulo the clock that answers may take before they say nothing of it.
const CROWDED: f64 = 0.25;
/// Another period fits better when its lines are this many times stronger.
const BETTER: f64 = 1.3;
/// Lines between the multiples count when they are this strong against those on them.
const BETWEEN: f64 = 0.5;

/// Power along frequency in which a clock shows.
struct Cyclic {
    power: Vec<f64>,
    /// Points per Hz.
    density: f64,
    /// Frequencies (Hz) from which the multiples are counted, and which hold no sign of a clock themselves.
    origins: Vec<f64>,
}

impl Cyclic {
    /// Power at a multiple of a clock, `hertz` away from the origins.
    fn at(&self, hertz: f64) -> f64 {
        let place = |f: f64| (f.abs() * self.density).round() as usize;
        let power = |f: f64| self.power.get(place(f)).copied().unwrap_or(0.0);
        self.origins.iter().map(|origin| power(origin + hertz)).sum()
    }
}

/// Refuses a period when the recordings show another one; `records` are their lines without any cut.
///
/// # Errors
/// `OutOfRange`, with the period that fits better.
pub(super) fn check(spectra: &Spectra, records: &[Record], orbit: Orbit) -> Result<()> {
    let spectrum: Vec<Cyclic> = records.iter().map(|record| cyclic(spectra, record, orbit)).collect();
    let seen = if orbit == Orbit::Removed { SEEN_ORBIT } else { SEEN };
    let line = |hertz: f64| spectrum.iter().map(|s| s.at(hertz)).sum::<f64>();
    let score = |hertz: f64| (1..=MULTIPLES).map(|k| line(k as f64 * hertz)).sum::<f64>();
    let clock = 1.0 / spectra.period();
    let longest = records.iter().map(|r| TAU / r.spacing()).fold(0.0, f64::max);
    let step = 1.0 / (FINENESS * MULTIPLES as f64 * longest);
    let count = (RANGE * clock / step).floor() as i64;
    let candidates: Vec<(f64, f64)> =
        (-count..=count).map(|i| clock + i as f64 * step).map(|hertz| (hertz, score(hertz))).collect();
    let typical = stats::median(&candidates.iter().map(|c| c.1).collect::<Vec<_>>());
    let best = candidates.iter().copied().fold((clock, score(clock)), |best, c| if c.1 > best.1 { c } else { best });
    // A clock that is too fast by a whole factor shows lines between its own.
    let slower = (2..=3).find(|&factor| {
        let between = (1..factor).map(|j| line(clock * f64::from(j) / f64::from(factor))).fold(f64::INFINITY, f64::min);
        between > seen / MULTIPLES as f64 * typical && between > BETWEEN * score(clock) / MULTIPLES as f64
    });
    let found = spectra.period();
    let what = "period".to_owned();
    if best.1 > BETTER * score(clock) && best.1 > seen * typical {
        let expected = format!(
            "the period of the recordings, in s: their lines stand at multiples of 1/({:.9} s), {:.2} times stronger than at \
             those of 1/({found} s), which is {:.2} lines away; give the period of the clock with all its digits",
            1.0 / best.0,
            best.1 / score(clock),
            (best.0 - clock).abs() * longest
        );
        return Err(Error::OutOfRange { what, found, expected });
    }
    if let Some(factor) = slower {
        let expected = format!(
            "the period of the recordings, in s: they show lines between the multiples of 1/({found} s); {} s, {factor} times \
             the period given, fits better",
            f64::from(factor) * found
        );
        return Err(Error::OutOfRange { what, found, expected });
    }
    Ok(())
}

/// Where to look for the clock in one record.
fn cyclic(spectra: &Spectra, record: &Record, orbit: Orbit) -> Cyclic {
    let sparse =
        |i: usize| lines::excited_lines(spectra, std::slice::from_ref(record), i, lines::Options::default().weakest).0;
    let excited: Vec<i64> = (0..spectra.inputs()).flat_map(sparse).collect();
    if orbit == Orbit::Removed {
        return of_outputs(spectra, record, &[]);
    }
    if crowded((spectra.pumping() / record.spacing()).round() as i64, &excited) {
        return Cyclic { power: Vec::new(), density: 1.0, origins: Vec::new() };
    }
    if excited.is_empty() { of_products(spectra, record) } else { of_outputs(spectra, record, &excited) }
}

/// Whether the answers to the excited lines stand so close that every candidate period leads from one to another: then they
/// say nothing of the clock. All odd lines of a multisine whose lines have residues of their own are answers, for one.
fn crowded(periods: i64, excited: &[i64]) -> bool {
    let answers: BTreeSet<i64> =
        excited.iter().flat_map(|b| [b.rem_euclid(periods), (-b).rem_euclid(periods)]).collect();
    answers.len() as f64 > CROWDED * periods as f64
}

/// Largest frequency away from an origin that is looked at, rad/s.
fn farthest(spectra: &Spectra) -> f64 {
    (MULTIPLES as f64 * (1.0 + RANGE) + 1.0) * spectra.pumping()
}

/// Number of lines up to `omega`.
fn lines_below(record: &Record, omega: f64) -> usize {
    ((omega / record.spacing()) as usize).min(record.lines() - 1)
}

/// Adds the power of a series that is scaled to one, padded, along the first points of its spectrum.
fn gather(power: &mut [f64], mut x: Vec<f64>) {
    let padded = PADDING * x.len();
    let (mean, size) = (stats::mean(x.iter().copied()), stats::std(x.iter().copied()));
    x.iter_mut().for_each(|v| *v = (*v - mean) / size.max(f64::MIN_POSITIVE));
    x.resize(padded, 0.0);
    fft::forward(&x).iter().zip(power).for_each(|(line, sum)| *sum += line.norm_sqr());
}

/// The outputs themselves, seen from the excited lines, or from zero where there are none (the orbit's own lines).
fn of_outputs(spectra: &Spectra, record: &Record, excited: &[i64]) -> Cyclic {
    let density = PADDING as f64 * TAU / record.spacing();
    let last = lines_below(record, farthest(spectra) + spectra.band());
    let samples = (2 * last + 2).next_power_of_two();
    let mut power = vec![0.0; (last + 1) * PADDING];
    for j in 0..spectra.outputs() {
        let mut y: Vec<Complex> = (0..=last).map(|b| record.output(j, b as i64)).collect();
        excited.iter().filter(|&&b| b as usize <= last).for_each(|&b| y[b as usize] = Complex::new(0.0, 0.0));
        gather(&mut power, fft::inverse(&y, samples));
    }
    let hertz = |b: &i64| *b as f64 * record.spacing() / TAU;
    let within = excited.iter().filter(|&&b| b as f64 * record.spacing() <= spectra.band());
    let origins = if excited.is_empty() { vec![0.0] } else { within.flat_map(|b| [hertz(b), -hertz(b)]).collect() };
    Cyclic { power, density, origins }
}

/// Lines divided by the rms of those around them.
fn flat(spectra: &Spectra, record: &Record, lines: Vec<Complex>) -> Vec<Complex> {
    let half = ((0.5 * FLAT * spectra.pumping() / record.spacing()) as usize).max(4);
    let mut sums = vec![0.0];
    lines.iter().for_each(|l| sums.push(sums[sums.len() - 1] + l.norm_sqr()));
    let least = RUBBISH * sums[lines.len()] / lines.len().max(1) as f64;
    let scaled = |b: usize| {
        let (first, end) = (b.saturating_sub(half), (b + half + 1).min(lines.len()));
        lines[b] / ((sums[end] - sums[first]) / (end - first) as f64 + least).sqrt()
    };
    (0..lines.len()).map(scaled).collect()
}

/// Products of outputs and delayed inputs.
fn of_products(spectra: &Spectra, record: &Record) -> Cyclic {
    let highest = farthest(spectra);
    let inputs = lines_below(record, spectra.band());
    let outputs = lines_below(record, spectra.band() + highest);
    // Products reach to the sum of the two bands; nothing may fold back onto the multiples looked at.
    let samples = (inputs + outputs + lines_below(record, highest) + 2).next_power_of_two();
    let mut power = vec![0.0; (lines_below(record, highest) + 1) * PADDING];
    for j in 0..spectra.outputs() {
        let y = flat(spectra, record, (0..=outputs).map(|b| record.output(j, b as i64)).collect());
        let y = fft::inverse(&y, samples);
        let inputs = (0..spectra.inputs())
            .map(|i| flat(spectra, record, (0..=inputs).map(|b| record.input(i, b as i64)).collect()));
        let inputs: Vec<Vec<Complex>> = inputs.collect();
        for (input, lag) in inputs.iter().flat_map(|input| (0..LAGS).map(move |lag| (input, lag))) {
            let delay = lag as f64 * TAU / (4.0 * spectra.band());
            let late =
                |(b, line): (usize, &Complex)| line * Complex::from_polar(1.0, -(b as f64) * record.spacing() * delay);
            let u = fft::inverse(&input.iter().enumerate().map(late).collect::<Vec<_>>(), samples);
            gather(&mut power, y.iter().zip(&u).map(|(y, u)| y * u).collect());
        }
    }
    Cyclic { power, density: PADDING as f64 * TAU / record.spacing(), origins: vec![0.0] }
}

#[cfg(test)]
mod tests {
    use crate::identify::testing::{Gain, Sandwich, multisine, noisy, recording, resonant};
    use crate::identify::{Method, Options, Orbit, Spectra, floquet};
    use crate::signal::Recording;

    const DT: f64 = 0.01;

    fn options(period: f64, orbit: Orbit) -> Options {
        let method = Method::Floquet(floquet::Options::default());
        Options { period, harmonics: 2, band: None, orbit, method }
    }

    fn record(system: &Sandwich, noise: f64) -> Recording {
        let u = multisine(20_000, &(1..=600).collect::<Vec<_>>(), 1);
        let y = noisy(&system.respond(&u, 0.0, DT), noise, 2);
        recording(u, y, 0.0, DT)
    }

    /// What is said of the period: a refusal, or the doubt that a deviation allows.
    fn said(record: Recording, options: &Options) -> String {
        match Spectra::new(&[record], options) {
            Err(refusal) => refusal.to_string(),
            Ok(spectra) => spectra.warnings().iter().filter(|w| w.starts_with("period = ")).cloned().collect(),
        }
    }

    /// The period a refusal proposes.
    fn proposed(record: Recording, options: &Options) -> f64 {
        let text = said(record, options);
        let number = text.split("1/(").nth(1).and_then(|rest| rest.split(' ').next()).unwrap_or_default();
        number.parse().unwrap_or(f64::NAN)
    }

    #[test]
    fn the_right_period_passes_with_and_without_noise() {
        for noise in [0.0, 0.5] {
            assert_eq!(said(record(&resonant(), noise), &options(0.5, Orbit::Deviation)), "");
        }
    }

    #[test]
    fn a_period_half_a_line_off_is_doubted_and_the_right_one_proposed() {
        // 400 periods: half a line is an eighth of a percent.
        for wrong in [0.5 * (1.0 + 1.0 / 800.0), 0.49, 0.5 * (1.0 - 1.0 / 300.0)] {
            let found = proposed(record(&resonant(), 0.1), &options(wrong, Orbit::Deviation));
            assert!((found - 0.5).abs() < 2e-4 * 0.5, "{wrong}: {found}");
        }
    }

    #[test]
    fn a_whole_fraction_of_the_period_is_doubted() {
        let text = said(record(&resonant(), 0.0), &options(0.25, Orbit::Deviation));
        assert!(text.contains("0.5 s, 2 times"), "{text}");
        // Twice the period describes the system as well, with every other harmonic zero.
        assert_eq!(said(record(&resonant(), 0.0), &options(1.0, Orbit::Deviation)), "");
    }

    #[test]
    fn a_system_without_a_clock_may_be_given_any() {
        let still = Gain { depth: 0.0, phase: 0.0 };
        let system = Sandwich { before: still, after: still, ..resonant() };
        assert_eq!(said(record(&system, 0.1), &options(0.37, Orbit::Deviation)), "");
    }

    #[test]
    fn an_orbit_shows_its_own_clock() {
        let good = record(&resonant(), 0.0);
        let orbit = |t: f64| 100.0 * (std::f64::consts::TAU * t / 0.5).cos();
        let y = good.output(0).zip(good.t()).map(|(y, &t)| y + orbit(t)).collect();
        let record = recording(good.input(0).collect(), y, 0.0, DT);
        assert_eq!(said(record.clone(), &options(0.5, Orbit::Removed)), "");
        assert!(Spectra::new(std::slice::from_ref(&record), &options(0.5007, Orbit::Removed)).is_err());
        let found = proposed(record, &options(0.5007, Orbit::Removed));
        assert!((found - 0.5).abs() < 1e-4, "{found}");
    }

    #[test]
    fn single_lines_show_the_clock_around_them() {
        let sparse = [31, 84, 137, 190, 243, 296, 349, 402, 455, 508];
        let u = multisine(20_000, &sparse, 1);
        let y = noisy(&resonant().respond(&u, 0.0, DT), 0.1, 2);
        let record = recording(u, y, 0.0, DT);
        assert_eq!(said(record.clone(), &options(0.5, Orbit::Deviation)), "");
        let found = proposed(record, &options(0.5013, Orbit::Deviation));
        assert!((found - 0.5).abs() < 2e-4 * 0.5, "{found}");
    }
}
