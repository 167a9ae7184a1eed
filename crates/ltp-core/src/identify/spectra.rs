//! `Spectra`: recordings as lines on which the clock is a whole number of bins, and what cannot be identified refused.
//!
//! A record is cut to a whole number of periods, so that the pumping frequency is exactly `periods` bins and
//! `Y(b) = sum_k H_k(b - k periods) U(b - k periods)` holds line by line, without leakage between the harmonics: at 420 s,
//! rounding the clock to the nearest bin instead costs more than the whole response. Where the period is no whole number of
//! samples, the lines are taken at multiples of `1 / (periods T)` all the same. Phases are those of the clock: time zero is
//! the clock's, wherever a record begins.

use std::f64::consts::TAU;

use super::{Method, Options, Orbit, clock};
use crate::error::{Error, Result};
use crate::numeric::{Complex, chirp_z, fft, stats};
use crate::signal::Recording;

/// Fewest periods a record must hold.
const MIN_PERIODS: usize = 8;
/// Fewer periods than this leave a warning.
const FEW_PERIODS: usize = 50;
/// A record of whole periods may miss a whole number of samples by this many samples.
const WHOLE: f64 = 1e-3;
/// To have whole samples in whole periods, at most this share of a record is given up.
const SACRIFICE: f64 = 0.02;
/// Output lines on either side of a multiple of the pumping frequency that hold the rest of an orbit.
const ORBIT_LINES: i64 = 2;
/// Windows in which the input must have power, per pumping frequency.
const WINDOWS: f64 = 8.0;
/// Power per line, relative to the median of the excited windows, below which nothing can be said.
const NO_POWER: f64 = 1e-5;
/// Power per line, relative to the strongest window, that is no excitation.
const FAINT: f64 = 1e-6;
/// Power per line, relative to the windows just below, above which an input is still within its band.
const EDGE: f64 = 0.02;

/// Lines of all recordings, checked: what exists can be identified.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectra {
    period: f64,
    orbit: Orbit,
    records: Vec<Record>,
    input_names: Vec<String>,
    output_names: Vec<String>,
    band: f64,
    /// Per input: up to where it has power, rad/s.
    excited: Vec<f64>,
    warnings: Vec<String>,
}

/// Lines of one recording. White noise of variance `s^2` has the expectation `s^2` on every line, however long the record is.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    name: String,
    samples: usize,
    dt: f64,
    periods: usize,
    spacing: f64,
    start: f64,
    inputs: Vec<Vec<Complex>>,
    outputs: Vec<Vec<Complex>>,
}

impl Record {
    /// Name of the recording.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Number of samples that were transformed.
    pub fn samples(&self) -> usize {
        self.samples
    }
    /// Sampling step, s.
    pub fn dt(&self) -> f64 {
        self.dt
    }
    /// Number of periods, which is the pumping frequency in lines.
    pub fn periods(&self) -> usize {
        self.periods
    }
    /// Distance between lines, rad/s: the pumping frequency divided by the number of periods.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }
    /// Time of the clock at the first sample, s, within a period.
    pub fn start(&self) -> f64 {
        self.start
    }
    /// Number of lines from zero upwards; the last is at or below the Nyquist frequency.
    pub fn lines(&self) -> usize {
        self.samples / 2 + 1
    }
    /// Line `b`, of either sign, of input `i`; zero beyond the Nyquist frequency.
    pub fn input(&self, i: usize, b: i64) -> Complex {
        line(&self.inputs[i], b)
    }
    /// Line `b`, of either sign, of output `j`; zero beyond the Nyquist frequency.
    pub fn output(&self, j: usize, b: i64) -> Complex {
        line(&self.outputs[j], b)
    }
}

fn line(lines: &[Complex], b: i64) -> Complex {
    let zero = Complex::new(0.0, 0.0);
    let value = lines.get(b.unsigned_abs() as usize).copied().unwrap_or(zero);
    if b < 0 { value.conj() } else { value }
}

impl Spectra {
    /// Lines of `recordings`, and the band in which they can be identified.
    ///
    /// # Errors
    /// `OutOfRange` for a period or band that cannot be, gaps in an output, harmonics beyond the Nyquist frequency, a band in
    /// which the input has no power, and constant columns; `TooShort` for fewer than 8 periods; `Shape` when recordings
    /// have different numbers of columns or there is none.
    pub fn new(recordings: &[Recording], options: &Options) -> Result<Self> {
        let period = options.period;
        if !(period > 0.0 && period.is_finite()) {
            let expected = "a positive, finite time in s".into();
            return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
        }
        let Some(first) = recordings.first() else {
            return Err(Error::Shape { what: "recordings to identify from".into(), expected: 1, found: 0 });
        };
        let mut warnings = Vec::new();
        let mut records = Vec::new();
        for recording in recordings {
            check_columns(recording, first)?;
            warnings.extend(recording.warnings().iter().cloned());
            records.push(transform(recording, period, &mut warnings)?);
        }
        let mut spectra = Spectra {
            period,
            orbit: options.orbit,
            records,
            input_names: first.input_names().to_vec(),
            output_names: first.output_names().to_vec(),
            band: 0.0,
            excited: Vec::new(),
            warnings,
        };
        spectra.excited = (0..spectra.inputs()).map(|i| spectra.edge(i) as f64 * spectra.window()).collect();
        spectra.band = spectra.find_band(options)?;
        spectra.check_nyquist(options)?;
        let whole: Vec<Record> = recordings.iter().map(uncut).collect();
        // An orbit shows its clock beyond doubt. Deviations show it only by statistics, which an input that repeats with a
        // rhythm of its own can mislead: a doubt, not a refusal.
        match (clock::check(&spectra, &whole, options.orbit), options.orbit) {
            (Err(complaint), Orbit::Deviation) => spectra.warnings.push(complaint.to_string()),
            (checked, _) => checked?,
        }
        Ok(spectra)
    }

    /// Period T, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Pumping frequency, rad/s.
    pub fn pumping(&self) -> f64 {
        TAU / self.period
    }
    /// The recordings' lines, in the order given.
    pub fn records(&self) -> &[Record] {
        &self.records
    }
    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.input_names.len()
    }
    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.output_names.len()
    }
    /// Names of the inputs.
    pub fn input_names(&self) -> &[String] {
        &self.input_names
    }
    /// Names of the outputs.
    pub fn output_names(&self) -> &[String] {
        &self.output_names
    }
    /// Largest input frequency of the estimate, rad/s: as asked for, or as far as every input has power.
    pub fn band(&self) -> f64 {
        self.band
    }
    /// Frequency up to which input `i` has power, rad/s.
    pub fn excited(&self, i: usize) -> f64 {
        self.excited[i]
    }
    /// What was doubtful about the recordings.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Whether output line `b` of `record` says something about the deviations: not where the orbit's lines stand.
    pub fn informative(&self, record: &Record, b: i64) -> bool {
        let periods = record.periods as i64;
        let away = (b.rem_euclid(periods)).min(periods - b.rem_euclid(periods));
        self.orbit == Orbit::Deviation || away > ORBIT_LINES
    }

    /// Mean power per line of input `i` in windows of an eighth of the pumping frequency, from zero upwards, over all records.
    ///
    /// As many windows as every record has below its Nyquist frequency.
    pub fn input_power(&self, i: usize) -> Vec<f64> {
        let width = self.window();
        let top = self.records.iter().map(|r| r.spacing * (r.lines() - 1) as f64).fold(f64::INFINITY, f64::min);
        let windows = ((top / width) as usize).max(1);
        let (mut power, mut count) = (vec![0.0; windows], vec![0_usize; windows]);
        for record in &self.records {
            for (b, value) in record.inputs[i].iter().enumerate() {
                if let Some(at) = Some((b as f64 * record.spacing / width) as usize).filter(|&at| at < windows) {
                    power[at] += value.norm_sqr();
                    count[at] += 1;
                }
            }
        }
        power.iter().zip(&count).map(|(p, &n)| if n > 0 { p / n as f64 } else { 0.0 }).collect()
    }

    /// Width of the windows of [`Spectra::input_power`], rad/s.
    pub fn window(&self) -> f64 {
        self.pumping() / WINDOWS
    }

    /// Power per line that a window of input must exceed to be told from white noise of power `noise`.
    pub(super) fn above_noise(&self, noise: f64) -> f64 {
        let lines: f64 = self.records.iter().map(|r| self.window() / r.spacing()).sum();
        noise * (1.0 + 8.0 / lines.max(1.0).sqrt())
    }

    /// Number of windows up to the edge of input `i`'s band: from there on, every window has far less power than those just
    /// below, or none above a floor as white noise has it.
    fn edge(&self, i: usize) -> usize {
        let power = self.input_power(i);
        let mut rest = vec![0.0_f64; power.len() + 1];
        for i in (0..power.len()).rev() {
            rest[i] = rest[i + 1].max(power[i]);
        }
        let below = |i: &usize| rest[*i] < EDGE * stats::median(&power[i.saturating_sub(3)..*i]);
        let drop = (1..power.len()).find(below).unwrap_or(power.len());
        // Where single lines stand apart, windows between them hold nothing but rounding.
        let strongest = power.iter().copied().fold(0.0, f64::max);
        let floor = self.above_noise(stats::median(&power[power.len() / 2..])).max(FAINT * strongest);
        match power.iter().rposition(|p| *p > floor) {
            Some(last) if 2 * (last + 1) < power.len() => drop.min(last + 1),
            _ => drop,
        }
    }

    /// The band: what was asked for, or what the weakest input excites; with a complaint where it has no power.
    fn find_band(&mut self, options: &Options) -> Result<f64> {
        let width = self.window();
        if let Some(band) = options.band
            && !(band > 0.0 && band.is_finite())
        {
            let expected = "a positive, finite angular frequency in rad/s".into();
            return Err(Error::OutOfRange { what: "band".into(), found: band, expected });
        }
        let powers: Vec<Vec<f64>> = (0..self.inputs()).map(|i| self.input_power(i)).collect();
        let band = options.band.unwrap_or_else(|| self.excited.iter().copied().fold(f64::INFINITY, f64::min));
        for ((power, &edge), name) in powers.iter().zip(&self.excited).zip(&self.input_names) {
            let inside = &power[..((band / width).ceil() as usize).clamp(1, power.len())];
            let excited = &power[..((edge / width).ceil() as usize).clamp(1, power.len())];
            // White noise on a measured input is no excitation: the lines above the band show its level.
            let noise = if 2 * excited.len() < power.len() { stats::median(&power[power.len() / 2..]) } else { 0.0 };
            let level = (NO_POWER * stats::median(excited)).max(self.above_noise(noise));
            let gaps = gaps(inside, level);
            let Some(&(from, to)) = gaps.iter().max_by_key(|(from, to)| to - from) else { continue };
            if matches!(options.method, Method::Lines(_)) {
                continue;
            }
            let hertz = |window: usize| window as f64 * width / TAU;
            let found = format!("input `{name}` has no power from {:.3} to {:.3} Hz", hertz(from), hertz(to));
            let missing: usize = gaps.iter().map(|(from, to)| to - from).sum();
            // A penalty on curvature says something everywhere; how little, its standard deviations tell.
            let extrapolates = matches!(options.method, Method::Curvature(_)) && options.band.is_some();
            if !extrapolates && (options.band.is_some() || 2 * missing > inside.len()) {
                let usable = gaps[0].0 as f64 * width;
                let expected = format!(
                    "a band in rad/s in which every input has power, but {found}; excite that band{}",
                    if usable > 0.0 { format!(", or ask for at most {usable:.4} rad/s") } else { String::new() }
                );
                return Err(Error::OutOfRange { what: "band".into(), found: band, expected });
            }
            let advice = "what is said there is extrapolated: excite that band";
            self.warnings.push(format!("{found}; {advice}"));
        }
        Ok(band)
    }

    fn check_nyquist(&mut self, options: &Options) -> Result<()> {
        for record in &self.records {
            let nyquist = 0.5 * TAU / record.dt;
            let highest = self.band + options.harmonics as f64 * self.pumping();
            if highest > nyquist * (1.0 + 1e-9) {
                let possible = ((nyquist - self.band) / self.pumping()).floor();
                let expected = format!(
                    "outputs below the Nyquist frequency {:.3} Hz of recording `{}`, but inputs up to {:.3} Hz come out at up \
                     to {:.3} Hz; {} or sample faster",
                    nyquist / TAU,
                    record.name,
                    self.band / TAU,
                    highest / TAU,
                    if possible >= 0.0 {
                        format!("use at most {possible} harmonics,")
                    } else {
                        "narrow the band,".into()
                    }
                );
                return Err(Error::OutOfRange { what: "harmonics".into(), found: options.harmonics as f64, expected });
            }
        }
        Ok(())
    }
}

/// Columns that can be transformed, as many as in the `first` recording.
fn check_columns(recording: &Recording, first: &Recording) -> Result<()> {
    let name = recording.name();
    let columns = [
        ("inputs", first.input_names().len(), recording.input_names().len()),
        ("outputs", first.output_names().len(), recording.output_names().len()),
    ];
    for (what, expected, found) in columns {
        if found != expected || found == 0 {
            let what = format!("{what} of recording `{name}`, beside the first recording `{}`", first.name());
            return Err(Error::Shape { what, expected: expected.max(1), found });
        }
    }
    for (j, column) in recording.output_names().iter().enumerate() {
        let gaps = recording.len() - recording.valid(j);
        if gaps > 0 {
            let longest = recording.segments(j).into_iter().max_by_key(ExactSizeIterator::len).unwrap_or(0..0);
            let t = recording.t();
            let piece = longest.clone().next().map_or(String::new(), |start| {
                format!("; its longest run without runs from {} s to {} s: slice it", t[start], t[longest.end - 1])
            });
            let what = format!("gaps in output `{column}` of recording `{name}`");
            let expected = format!("none: a spectrum needs every sample{piece}");
            return Err(Error::OutOfRange { what, found: gaps as f64, expected });
        }
    }
    let inputs = (0..recording.input_names().len()).map(|i| (recording.input(i).collect::<Vec<_>>(), "input", i));
    let outputs = (0..recording.output_names().len()).map(|j| (recording.output(j).collect::<Vec<_>>(), "output", j));
    for (values, kind, column) in inputs.chain(outputs) {
        if values.iter().all(|v| *v == values[0]) {
            let names = if kind == "input" { recording.input_names() } else { recording.output_names() };
            let what = format!("standard deviation of {kind} `{}` of recording `{name}`", names[column]);
            let expected = format!(
                "a signal that moves, but it is {} in every row; {}",
                values[0],
                if kind == "input" { "excite the system" } else { "check the sensor" }
            );
            return Err(Error::OutOfRange { what, found: 0.0, expected });
        }
    }
    Ok(())
}

/// Lines of one recording as it is, whatever its period.
fn uncut(recording: &Recording) -> Record {
    let (samples, dt) = (recording.len(), recording.dt());
    let scale = 1.0 / (samples as f64).sqrt();
    let lines = |x: Vec<f64>| -> Vec<Complex> { fft::forward(&x).into_iter().map(|line| line * scale).collect() };
    Record {
        name: recording.name().to_owned(),
        samples,
        dt,
        periods: 0,
        spacing: TAU / (samples as f64 * dt),
        start: 0.0,
        inputs: (0..recording.input_names().len()).map(|i| lines(recording.input(i).collect())).collect(),
        outputs: (0..recording.output_names().len()).map(|j| lines(recording.output(j).collect())).collect(),
    }
}

/// Lines of one recording, cut to whole periods.
fn transform(recording: &Recording, period: f64, warnings: &mut Vec<String>) -> Result<Record> {
    let (name, n, dt) = (recording.name(), recording.len(), recording.dt());
    let per_period = period / dt;
    if per_period < 2.0 {
        let expected = format!("at least two samples of recording `{name}` (dt = {dt} s) per period; sample faster");
        return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
    }
    let most = ((n as f64 + WHOLE) / per_period).floor() as usize;
    if most < MIN_PERIODS {
        let what = format!(
            "recording `{name}` holds {:.2} periods of {period} s, fewer than {MIN_PERIODS}",
            n as f64 / per_period
        );
        return Err(Error::TooShort { what, needed: (MIN_PERIODS as f64 * per_period).ceil() as usize, found: n });
    }
    if most < FEW_PERIODS {
        warnings.push(format!(
            "recording `{name}` holds {most} periods of {period} s: resonances sharper than {:.3} Hz are not resolved; record \
             {FEW_PERIODS} or more",
            1.0 / (most as f64 * period)
        ));
    }
    let miss = |periods: usize| periods as f64 * per_period - (periods as f64 * per_period).round();
    let fewest = ((most as f64 * (1.0 - SACRIFICE)).ceil() as usize).max(MIN_PERIODS);
    let whole = (fewest..=most).rev().find(|&periods| miss(periods).abs() <= WHOLE);
    let periods = whole.unwrap_or(most);
    let samples = ((periods as f64 * per_period).round() as usize).min(n);
    let spacing = TAU / (periods as f64 * period);
    let start = recording.t()[0].rem_euclid(period);
    let scale = 1.0 / (samples as f64).sqrt();
    let lines = |values: Vec<f64>| -> Vec<Complex> {
        let mut values = values;
        values.truncate(samples);
        let raw = if whole.is_some() {
            fft::forward(&values)
        } else {
            // The first and the last sample are neighbours on the circle and share what the samples do not cover.
            let share = 1.0 + 0.5 * miss(periods);
            values[0] *= share;
            values[samples - 1] *= share;
            chirp_z::lines(&values, 1.0 / (periods as f64 * per_period), samples / 2 + 1)
        };
        let turn = |b: usize| Complex::from_polar(scale, -(b as f64) * spacing * start);
        raw.into_iter().enumerate().map(|(b, value)| value * turn(b)).collect()
    };
    let inputs = (0..recording.input_names().len()).map(|i| lines(recording.input(i).collect())).collect();
    let outputs = (0..recording.output_names().len()).map(|j| lines(recording.output(j).collect())).collect();
    Ok(Record { name: name.to_owned(), samples, dt, periods, spacing, start, inputs, outputs })
}

/// Runs of windows below `level`.
fn gaps(power: &[f64], level: f64) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (i, _) in power.iter().enumerate().filter(|(_, p)| **p <= level) {
        match runs.last_mut() {
            Some(run) if run.1 == i => run.1 = i + 1,
            _ => runs.push((i, i + 1)),
        }
    }
    runs
}

#[cfg(test)]
#[path = "spectra_tests.rs"]
mod tests;
