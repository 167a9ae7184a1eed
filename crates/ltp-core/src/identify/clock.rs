//! Whether the recordings keep the clock they are said to keep.
//!
//! The response of a periodic system to any input is cyclostationary: `y(t) u(t - tau)` has lines at the multiples of
//! `1 / T`, however broad the spectra of `y` and `u` are. Their strength over candidate periods shows the true one to a
//! fraction of a bin. Where the outputs hold the periodic orbit, its own lines are looked at instead. A system whose
//! response shows no period at all passes: it may well be time-invariant.
//!
//! Reference: W. A. Gardner, *Exploitation of spectral redundancy in cyclostationary signals*, IEEE Signal Processing Magazine
//! 8(2) (1991) 14-36.

use std::f64::consts::TAU;

use super::spectra::Record;
use super::{Orbit, Spectra};
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
const SEEN: f64 = 100.0;
/// Another period fits better when its lines are this many times stronger.
const BETTER: f64 = 1.3;

/// Power of the product of outputs and inputs along frequency, up to a little more than the multiples looked at.
struct Cyclic {
    power: Vec<f64>,
    /// Points per Hz.
    density: f64,
}

impl Cyclic {
    fn at(&self, hertz: f64) -> f64 {
        self.power.get((hertz * self.density).round() as usize).copied().unwrap_or(0.0)
    }
}

/// Refuses a period when the recordings show another one.
///
/// # Errors
/// `OutOfRange`, with the period that fits better.
pub(super) fn check(spectra: &Spectra, orbit: Orbit) -> Result<()> {
    let spectrum: Vec<Cyclic> = spectra.records().iter().map(|record| cyclic(spectra, record, orbit)).collect();
    let line = |hertz: f64| spectrum.iter().map(|s| s.at(hertz)).sum::<f64>();
    let score = |hertz: f64| (1..=MULTIPLES).map(|k| line(k as f64 * hertz)).sum::<f64>();
    let clock = 1.0 / spectra.period();
    let longest = spectra.records().iter().map(|r| TAU / r.spacing()).fold(0.0, f64::max);
    let step = 1.0 / (FINENESS * MULTIPLES as f64 * longest);
    let count = (RANGE * clock / step).floor() as i64;
    let candidates: Vec<(f64, f64)> =
        (-count..=count).map(|i| clock + i as f64 * step).map(|hertz| (hertz, score(hertz))).collect();
    let typical = stats::median(&candidates.iter().map(|c| c.1).collect::<Vec<_>>());
    let best = candidates.iter().copied().fold((clock, score(clock)), |best, c| if c.1 > best.1 { c } else { best });
    // A clock that is too fast by a whole factor shows lines between its own.
    let slower = (2..=3).find(|&factor| {
        let between = (1..factor).map(|j| line(clock * f64::from(j) / f64::from(factor))).fold(f64::INFINITY, f64::min);
        between > SEEN / MULTIPLES as f64 * typical && between > 0.1 * score(clock) / MULTIPLES as f64
    });
    let found = spectra.period();
    let what = "period".to_owned();
    if best.1 > BETTER * score(clock) && best.1 > SEEN * typical {
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

fn cyclic(spectra: &Spectra, record: &Record, orbit: Orbit) -> Cyclic {
    let clock = spectra.pumping();
    let duration = TAU / record.spacing();
    let highest = (MULTIPLES as f64 * (1.0 + RANGE) + 1.0) * clock;
    let lines = |omega: f64| ((omega / record.spacing()) as usize).min(record.lines() - 1);
    let inputs = lines(spectra.band());
    let outputs = lines(spectra.band() + highest);
    // Products reach to the sum of the two bands; nothing may fold back onto the multiples looked at.
    let samples = (inputs + outputs + lines(highest) + 2).next_power_of_two();
    let padded = PADDING * samples;
    let count = (lines(highest) + 1) * PADDING;
    let mut power = vec![0.0; count];
    let mut gather = |mut x: Vec<f64>| {
        let (mean, size) = (stats::mean(x.iter().copied()), stats::rms(x.iter().copied()));
        x.iter_mut().for_each(|v| *v = (*v - mean) / size.max(f64::MIN_POSITIVE));
        x.resize(padded, 0.0);
        fft::forward(&x).iter().zip(&mut power).for_each(|(line, sum)| *sum += line.norm_sqr());
    };
    for j in 0..spectra.outputs() {
        let y: Vec<Complex> = (0..=outputs).map(|b| record.output(j, b as i64)).collect();
        let y = fft::inverse(&y, samples);
        if orbit == Orbit::Removed {
            gather(y);
            continue;
        }
        for i in 0..spectra.inputs() {
            for lag in 0..LAGS {
                let delay = lag as f64 * TAU / (4.0 * spectra.band());
                let late = |b: usize| {
                    record.input(i, b as i64) * Complex::from_polar(1.0, -(b as f64) * record.spacing() * delay)
                };
                let u: Vec<Complex> = (0..=inputs).map(late).collect();
                let u = fft::inverse(&u, samples);
                gather(y.iter().zip(&u).map(|(y, u)| y * u).collect());
            }
        }
    }
    // Lines of a record that repeats at `duration` stand at whole multiples of PADDING.
    Cyclic { power, density: PADDING as f64 * duration }
}
