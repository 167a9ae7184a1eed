//! Harmonic transfer functions line by line, for periodic excitation.
//!
//! A periodic input excites single lines `b`; harmonic `k` answers on output line `b + k n_T`, where `n_T` is the number of
//! periods in the record. Where an output line has one source only (the excited lines differ modulo `n_T`, up to sign),
//! `H_k(b) = Y(b + k n_T) / U(b)`, without any smoothing and for any number of harmonics. Where several sources meet, several
//! records with other phases are solved together by least squares, or the estimate is refused.
//!
//! Lines that no source reaches are a measure of everything else. Noise is what does not repeat when the record holds several
//! periods of the excitation. If only odd lines answer, even lines hold distortion of even order, and the odd lines that are
//! left out hold distortion of odd order.
//!
//! Reference: R. Pintelon and J. Schoukens, *System Identification: A Frequency Domain Approach*, 2nd edition, sections 4.3
//! and 5.2 (detection lines), for time-invariant systems; Uyanik et al. 2015, equation (6), for the harmonics.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{LN_2, TAU};

use nalgebra::{DMatrix, DVector};

use super::Spectra;
use super::spectra::Record;
use crate::error::{Error, Result};
use crate::numeric::divisor::gcd;
use crate::numeric::{Complex, stats};
use crate::periodic::Htf;

/// Options of the method.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// A line of the input is excited when its power is at least this share of the strongest line's.
    pub weakest: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { weakest: 1e-6 }
    }
}

/// A line is excited when its power is also this many times that of the lines around it that are not.
const ABOVE_NOISE: f64 = 20.0;
/// If more than this share of the lines in the band is excited, the input is not periodic in the record.
const SPARSE: f64 = 0.3;
/// Lines that a noise level is averaged over.
const NEIGHBOURS: usize = 32;
/// Smallest quotient of singular values with which sources are told apart.
const APART: f64 = 1e-6;

/// A source of an output line: input, its line (of either sign), harmonic.
type Source = (usize, i64, i64);

/// Harmonic transfer functions at the excited lines.
///
/// Figures: `frequencies`; `repetitions` of the response in a record; per output (rms of a record, in its unit)
/// `response` on the lines that sources reach, `even_distortion` and `odd_distortion` where the design shows them, and
/// `noise_sd` of a sample. With one repetition noise cannot be told from distortion: `noise_sd` is then that of the lines no
/// source reaches, odd ones if only odd lines answer.
///
/// # Errors
/// `OutOfRange` when the input is not periodic, or sources meet that the records cannot tell apart; `Shape` when records differ
/// in length.
pub fn identify(spectra: &Spectra, options: &super::Options, own: &Options) -> Result<Htf> {
    let design = Design::new(spectra, options.harmonics, own)?;
    let (ny, nu) = (spectra.outputs(), spectra.inputs());
    let omega: Vec<f64> = design.lines.iter().map(|&b| b as f64 * spectra.records()[0].spacing()).collect();
    let harmonics = options.harmonics as i64;
    let size = (2 * options.harmonics + 1) * omega.len() * ny * nu;
    let (mut values, mut sd) = (vec![Complex::new(0.0, 0.0); size], vec![0.0; size]);
    let mut coherence = vec![0.0; omega.len() * ny];
    let mut figures =
        vec![("frequencies".to_owned(), omega.len() as f64), ("repetitions".to_owned(), design.repetitions as f64)];
    let places: BTreeMap<i64, usize> = design.lines.iter().enumerate().map(|(i, &b)| (b, i)).collect();
    for y in 0..ny {
        let noise = design.noise(spectra, y);
        for (&line, sources) in &design.sources {
            let (solved, deviations) = solve(spectra, &design, y, line, sources, noise.at(line))?;
            for ((&(u, b, k), value), deviation) in sources.iter().zip(solved).zip(deviations) {
                // A source of negative frequency is the image of the other harmonic's.
                let (k, value) = if b < 0 { (-k, value.conj()) } else { (k, value) };
                if let Some(&i) = places.get(&b.abs()).filter(|_| k.abs() <= harmonics) {
                    let at = (((k + harmonics) as usize * omega.len() + i) * ny + y) * nu + u;
                    (values[at], sd[at]) = (value, deviation);
                }
            }
        }
        for (i, &b) in design.lines.iter().enumerate() {
            let power: f64 = spectra.records().iter().map(|r| r.output(y, b).norm_sqr()).sum::<f64>();
            let left = noise.at(b) * spectra.records().len() as f64;
            coherence[i * ny + y] = if power > 0.0 { (1.0 - left / power).max(0.0) } else { 0.0 };
        }
        let suffix = if y == 0 { String::new() } else { format!("_{}", spectra.output_names()[y]) };
        figures
            .extend(design.distortion(spectra, y, &noise).into_iter().map(|(name, v)| (name.to_owned() + &suffix, v)));
    }
    let mut htf = Htf::new(spectra.period(), options.harmonics, omega, (ny, nu), values, "")?
        .with_sd(sd)?
        .with_coherence(coherence)?;
    htf.method = "quotients of output and input lines".into();
    htf.figures = figures;
    htf.warnings = spectra.warnings().iter().cloned().chain(design.warnings).collect();
    Ok(htf)
}

/// Number of lines up to where input `i` has power.
fn lines_within(spectra: &Spectra, record: &Record, i: usize) -> usize {
    ((spectra.excited(i) / record.spacing()) as usize).clamp(1, record.lines() - 1) + 1
}

/// Excited lines of input `i` over records of equal length, and the power of the noise between them; no lines when the input
/// does not consist of lines that stand apart.
pub(super) fn excited_lines(spectra: &Spectra, records: &[Record], i: usize, weakest: f64) -> (Vec<i64>, f64) {
    let of_line = |b: i64| records.iter().map(|r| r.input(i, b).norm_sqr()).sum();
    let power: Vec<f64> = (0..records[0].lines() as i64).map(of_line).collect();
    let within = lines_within(spectra, &records[0], i);
    let noise = stats::median(&power[..within]) / LN_2;
    let strongest = power.iter().copied().fold(0.0, f64::max);
    let level = (weakest * strongest).max(ABOVE_NOISE * noise);
    let found: Vec<i64> = (0..power.len() as i64).filter(|&b| power[b as usize] > level).collect();
    if found.len() as f64 > SPARSE * within as f64 { (Vec::new(), noise) } else { (found, noise) }
}

/// Which lines are excited and where they answer.
#[derive(Clone, Debug)]
struct Design {
    /// Excited lines in the band, from zero upwards.
    lines: Vec<i64>,
    /// Output lines from zero upwards, and what arrives there.
    sources: BTreeMap<i64, Vec<Source>>,
    /// Lines modulo the periods that some harmonic of some excited line reaches.
    reached: BTreeSet<i64>,
    periods: i64,
    /// How often the response repeats in a record.
    repetitions: i64,
    /// Only odd lines (in units of the repetitions) answer.
    odd: bool,
    /// Power of the noise on each input's lines.
    input_noise: Vec<f64>,
    warnings: Vec<String>,
}

impl Design {
    fn new(spectra: &Spectra, harmonics: usize, own: &Options) -> Result<Self> {
        let records = spectra.records();
        let first = &records[0];
        if let Some(other) = records.iter().find(|r| (r.samples(), r.periods()) != (first.samples(), first.periods())) {
            let what =
                format!("samples of recording `{}` beside `{}`, for the method of lines", other.name(), first.name());
            return Err(Error::Shape { what, expected: first.samples(), found: other.samples() });
        }
        let periods = first.periods() as i64;
        let highest = ((spectra.band() / first.spacing()) * (1.0 + 1e-9)).floor() as i64;
        let mut excited: Vec<(usize, i64)> = Vec::new();
        let mut input_noise = Vec::new();
        for i in 0..spectra.inputs() {
            // Lines beyond the band are sources as well.
            let (found, noise) = excited_lines(spectra, records, i, own.weakest);
            let top = lines_within(spectra, first, i);
            if found.is_empty() {
                let what = format!("excited lines of input `{}`", spectra.input_names()[i]);
                let expected = format!(
                    "single lines among the {top} up to {:.3} Hz: the record must hold whole periods of a periodic input (cut it, \
                     or use the method `floquet`)",
                    spectra.excited(i) / TAU
                );
                return Err(Error::OutOfRange { what, found: 0.0, expected });
            }
            input_noise.push(noise / records.len() as f64);
            excited.extend(found.into_iter().map(|b| (i, b)));
        }
        let all: BTreeSet<i64> = excited.iter().map(|&(_, b)| b).collect();
        let mut warnings = Vec::new();
        let usable = |b: &i64| records.iter().all(|r| spectra.informative(r, *b)) && b.rem_euclid(periods) != 0;
        let lines: Vec<i64> = all.iter().copied().filter(|b| *b <= highest).filter(usable).collect();
        let lost = all.range(..=highest).count() - lines.len();
        if lost > 0 {
            warnings.push(format!(
                "{lost} excited lines are multiples of the pumping frequency, or stand beside one where the orbit is: left out"
            ));
        }
        if lines.is_empty() {
            let expected = "lines that are no multiples of the pumping frequency; move them".into();
            return Err(Error::OutOfRange { what: "excited lines in the band".into(), found: 0.0, expected });
        }
        let harmonics = harmonics as i64;
        let mut sources: BTreeMap<i64, Vec<Source>> = BTreeMap::new();
        for &(i, b) in &excited {
            for (b, k) in (-harmonics..=harmonics).flat_map(|k| [(b, k), (-b, k)]) {
                let line = b + k * periods;
                if line >= 0 && usable(&line) {
                    sources.entry(line).or_default().push((i, b, k));
                }
            }
        }
        // What arrives from lines beyond the band alone need not be solved.
        sources.retain(|_, from| from.iter().any(|(_, b, _)| b.abs() <= highest));
        let repetitions = all.iter().fold(periods, |divisor, &b| gcd(divisor, b));
        let odd = (periods / repetitions) % 2 == 0 && all.iter().all(|b| (b / repetitions) % 2 == 1);
        let reached = all.iter().flat_map(|b| [b.rem_euclid(periods), (-b).rem_euclid(periods)]).collect();
        Ok(Design { lines, sources, reached, periods, repetitions, odd, input_noise, warnings })
    }

    /// Kind of an output line.
    fn kind(&self, line: i64) -> Kind {
        if line % self.repetitions != 0 {
            Kind::Noise
        } else if self.reached.contains(&line.rem_euclid(self.periods)) {
            Kind::Response
        } else if line / self.repetitions % 2 == 0 {
            Kind::Even
        } else {
            Kind::Odd
        }
    }

    /// Output lines that can be looked at: up to the highest that a source in question reaches.
    fn seen<'a>(&'a self, spectra: &'a Spectra) -> impl Iterator<Item = i64> + 'a {
        let last = self.sources.keys().next_back().copied().unwrap_or(0).min(spectra.records()[0].lines() as i64 - 1);
        (1..=last).filter(|&b| spectra.records().iter().all(|r| spectra.informative(r, b)))
    }

    /// The noise level of an output along its lines.
    fn noise(&self, spectra: &Spectra, y: usize) -> Noise {
        let of = |wanted: &dyn Fn(Kind) -> bool| -> Vec<i64> {
            self.seen(spectra).filter(|&b| wanted(self.kind(b))).collect()
        };
        let candidates: [Vec<i64>; 3] =
            [of(&|k| k == Kind::Noise), of(&|k| self.odd && k == Kind::Odd), of(&|k| k != Kind::Response)];
        let lines = candidates.into_iter().find(|lines| lines.len() >= NEIGHBOURS).unwrap_or_default();
        let mean = |b: &i64| {
            spectra.records().iter().map(|r| r.output(y, *b).norm_sqr()).sum::<f64>() / spectra.records().len() as f64
        };
        let powers = lines.iter().map(mean).collect();
        Noise { lines, powers }
    }

    /// Rms of the response, the distortions and the noise of an output.
    fn distortion(&self, spectra: &Spectra, y: usize, noise: &Noise) -> Vec<(&'static str, f64)> {
        let (mut response, mut even, mut odd) = (0.0, 0.0, 0.0);
        let records = spectra.records();
        let scale = 2.0 / (records[0].samples() * records.len()) as f64;
        for b in self.seen(spectra) {
            let power: f64 = records.iter().map(|r: &Record| r.output(y, b).norm_sqr()).sum::<f64>() * scale;
            // With repetitions the noise is known, and taken out of what is called distortion.
            let noise = if self.repetitions > 1 { noise.at(b) * 2.0 / records[0].samples() as f64 } else { 0.0 };
            match self.kind(b) {
                Kind::Response => response += power,
                Kind::Even => even += power - noise,
                Kind::Odd => odd += power - noise,
                Kind::Noise => {}
            }
        }
        let mut figures = vec![("response", response.sqrt())];
        if self.odd {
            figures.push(("even_distortion", even.max(0.0).sqrt()));
            figures.push(("odd_distortion", odd.max(0.0).sqrt()));
        }
        if !noise.powers.is_empty() {
            figures.push(("noise_sd", (noise.powers.iter().sum::<f64>() / noise.powers.len() as f64).sqrt()));
        }
        figures
    }
}

/// What an output line holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// An answer to an excited line.
    Response,
    /// What does not repeat.
    Noise,
    /// An even multiple of the repetitions that no source reaches.
    Even,
    /// An odd one.
    Odd,
}

/// Powers of lines that hold noise.
#[derive(Clone, Debug)]
struct Noise {
    lines: Vec<i64>,
    powers: Vec<f64>,
}

impl Noise {
    /// Mean power of the noise lines nearest to `line`; zero when there are none.
    fn at(&self, line: i64) -> f64 {
        if self.lines.is_empty() {
            return 0.0;
        }
        let place = self.lines.partition_point(|&b| b < line);
        let first = place.saturating_sub(NEIGHBOURS / 2).min(self.lines.len().saturating_sub(NEIGHBOURS));
        let end = (first + NEIGHBOURS).min(self.lines.len());
        self.powers[first..end].iter().sum::<f64>() / (end - first) as f64
    }
}

/// What the sources of one output line are multiplied by, and its standard deviations.
fn solve(
    spectra: &Spectra,
    design: &Design,
    y: usize,
    line: i64,
    sources: &[Source],
    noise: f64,
) -> Result<(Vec<Complex>, Vec<f64>)> {
    let records = spectra.records();
    let inputs = DMatrix::from_fn(records.len(), sources.len(), |r, c| records[r].input(sources[c].0, sources[c].1));
    let output = DVector::from_fn(records.len(), |r, _| records[r].output(y, line));
    let svd = inputs.clone().svd(false, false);
    let (largest, smallest) = (svd.singular_values.max(), svd.singular_values.min());
    if records.len() < sources.len() || smallest <= APART * largest {
        let hertz = |b: i64| format!("{:.4}", b as f64 * records[0].spacing() / TAU);
        let names: Vec<String> = sources
            .iter()
            .map(|&(u, b, k)| format!("`{}` at {} Hz (harmonic {k})", spectra.input_names()[u], hertz(b)))
            .collect();
        let expected = format!(
            "one source, or as many records with different phases: at {} Hz there arrive {}; choose lines that differ modulo the \
             {} lines of the pumping frequency, up to sign, or use the method `floquet`",
            hertz(line),
            names.join(" and "),
            design.periods
        );
        return Err(Error::OutOfRange {
            what: "sources of an output line".into(),
            found: sources.len() as f64,
            expected,
        });
    }
    let normal = inputs.adjoint() * &inputs;
    let inverse = normal.try_inverse().unwrap_or_else(|| DMatrix::zeros(sources.len(), sources.len()));
    let solved: DVector<Complex> = &inverse * (inputs.adjoint() * output);
    let from_inputs: f64 = solved.iter().zip(sources).map(|(h, &(u, _, _))| h.norm_sqr() * design.input_noise[u]).sum();
    let variance = noise + from_inputs;
    let deviations = (0..sources.len()).map(|i| (inverse[(i, i)].re.max(0.0) * variance).sqrt()).collect();
    Ok((solved.iter().copied().collect(), deviations))
}

#[cfg(test)]
#[path = "lines_tests.rs"]
mod tests;
