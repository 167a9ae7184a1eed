//! For machines with a clock: where in harmonics and frequency a recording differs from the model, and which events come early
//! or late.
//!
//! The *harmonic map* is the identified harmonic transfer functions of the recording minus the exact ones of the model, in units
//! of the standard deviation of the difference. That has two parts: noise, which `identify` takes from repeated periods where
//! the input repeats; and what the estimator makes of the model's own run along the same inputs, where the truth is known:
//! distortion of a finite input, beyond what its start makes (that of the recording is in its noise). What remains is physics.
//!
//! `events` measures when transitions happened; `refit` makes the map that a diagnosis gives.
//!
//! Reference: Uyanik et al., *Identification of a vertical hopping robot model via harmonic transfer functions*, Trans. Inst.
//! Meas. Control 38 (2016) 501-511; the statistics of lines as in [`crate::identify`].

mod events;
mod refit;

pub use events::{EventTime, event_times};
pub use refit::{Refit, after, of_refit};

use serde::Serialize;

use super::experiment::{Control, Experiment, Run};
use super::fit::{self, Effort, Ground, Subject};
use super::prepare;
use super::words::number;
use crate::cycle::{self, LimitCycle};
use crate::error::{Error, Result};
use crate::identify::{self, Method, Orbit, floquet, lines};
use crate::linearize::linearize;
use crate::model::{Backend, Compiled, Model, System};
use crate::numeric::stats;
use crate::periodic::Htf;
use crate::signal::Recording;
use crate::simulate::Hold;

/// Mean square of a map that is noise alone; more than this beyond one, and beyond chance, is a difference.
const BEYOND: f64 = 0.5;
/// Standard deviations of the mean square that are beyond chance.
const CHANCE: f64 = 6.0;
/// Largest entry, in standard deviations, beyond which a single line is a difference.
const ALONE: f64 = 7.0;
/// Standard deviations by which an event must be off to be said.
const SAID: f64 = 4.0;
/// Standard deviations of the model's own run that are put down to its start.
const BEGUN: f64 = 2.0;
/// Standard deviation over transfer function from which nothing can be told.
const LOST: f64 = 1.0;
/// Steps in one period at least.
const STEPS: f64 = 500.0;
/// Enough to find an initial state.
const EFFORT: Effort = Effort { iterations: 25, ftol: 1e-6 };

/// Choices of a harmonic map.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Largest harmonic.
    pub harmonics: usize,
    /// Largest input frequency, rad/s; as far as the input has power where `None`.
    pub band: Option<f64>,
    /// How inputs run between samples.
    pub hold: Hold,
}

impl Default for Options {
    fn default() -> Self {
        Self { harmonics: 3, band: None, hold: Hold::default() }
    }
}

/// Where in harmonics and frequency a recording differs from the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HarmonicMap {
    /// Name of the model.
    pub model_name: String,
    /// Period, s.
    pub period: f64,
    /// Harmonics (2K+1).
    pub harmonics: Vec<i64>,
    /// Input frequencies (n), rad/s.
    pub omega: Vec<f64>,
    /// Names of the outputs (ny).
    pub outputs: Vec<String>,
    /// Names of the inputs (nu).
    pub inputs: Vec<String>,
    /// Magnitude of the difference in units of its standard deviation (ny, nu, 2K+1, n).
    pub z: Vec<Vec<Vec<Vec<f64>>>>,
    /// Mean square of the map: one where there is noise alone.
    pub mean_square: f64,
    /// Standard deviations over the size of the model's transfer functions, both rms, where that is worst: what is smaller
    /// than this share of them is lost in noise.
    pub blur: f64,
    /// Whether the map stands above noise.
    pub differs: bool,
    /// Event times, measured minus predicted.
    pub events: Vec<EventTime>,
    /// How the transfer functions were estimated.
    pub method: String,
    /// The whole in a sentence.
    pub sentence: String,
    /// What to keep in mind.
    pub warnings: Vec<String>,
}

/// The harmonic map of recordings of a clock-driven machine, and the times of its events; the model at its own parameters.
///
/// # Errors
/// [`Error::Model`] for a model without a clock, [`Error::NoConvergence`] when it has no periodic orbit near its start, and what
/// [`identify::identify`] says of recordings that cannot be used.
pub fn harmonic_map(
    model: &Model,
    recordings: &[Recording],
    options: &Options,
    control: &Control<'_>,
) -> Result<HarmonicMap> {
    let system = model.compile();
    let p = system.parameters().to_vec();
    let Some(period) = system.period(&p) else {
        return Err(Error::Model {
            path: model.name().to_string(),
            message: "it has no [clock]: harmonics of what is not periodic do not exist; use diagnose".into(),
        });
    };
    let experiments: Vec<Experiment> =
        recordings.iter().map(|r| Experiment::new(model, r, options.hold)).collect::<Result<_>>()?;
    (control.progress)("identifying", 0.0);
    let measured = Measured::of(model, &experiments, period, options)?;
    control.check()?;
    (control.progress)("finding the orbit", 0.4);
    let orbit = cycle::cycle(&system, &p, &cycle::Options::default())?;
    (control.progress)("running the model along the recordings", 0.5);
    let substeps = fine(&experiments, period);
    let starts = starts(model, &p, &orbit, &experiments, substeps, control);
    let at = At { model, system: &system, p: &p, experiments: &experiments, starts: &starts, substeps, control };
    let mut map = at.map(&measured, &orbit, options)?;
    (control.progress)("measuring event times", 0.8);
    let sigma = prepare::floors(&experiments, None);
    map.events = event_times(model, &system, &p, &experiments, &starts, &sigma, substeps, &mut map.warnings);
    map.sentence = map.said();
    (control.progress)("done", 1.0);
    Ok(map)
}

/// Steps per sample with which the model's own run is exact beside noise.
fn fine(experiments: &[Experiment], period: f64) -> u64 {
    (experiments[0].dt * STEPS / period).ceil().max(1.0) as u64
}

/// What the recordings say without the model: transfer functions between the columns that it knows.
struct Measured {
    kept: Vec<Recording>,
    htf: Htf,
    method: String,
}

impl Measured {
    /// Line by line where the input repeats, since noise is then what does not; with a common denominator elsewhere.
    fn of(model: &Model, experiments: &[Experiment], period: f64, options: &Options) -> Result<Self> {
        match Self::by_lines(model, experiments, period, options) {
            Err(Error::OutOfRange { .. } | Error::Shape { .. }) => {
                let kept = kept(model, experiments)?;
                let htf = identified(&kept, period, options, Method::Floquet(floquet::Options::default()))?;
                Ok(Self { kept, htf, method: "floquet".into() })
            }
            other => other,
        }
    }

    /// Line by line.
    fn by_lines(model: &Model, experiments: &[Experiment], period: f64, options: &Options) -> Result<Self> {
        let kept = kept(model, experiments)?;
        let htf = identified(&kept, period, options, Method::Lines(lines::Options::default()))?;
        Ok(Self { kept, htf, method: "lines".into() })
    }

    /// The same estimate of other outputs (n, ny) of the model, record by record.
    fn again(&self, model: &Model, outputs: &[Vec<f64>], options: &Options) -> Result<Htf> {
        let own: Vec<Recording> =
            self.kept.iter().zip(outputs).map(|(r, y)| simulated(model, r, y)).collect::<Result<_>>()?;
        let lines = || Method::Lines(lines::Options::default());
        let floquet = || Method::Floquet(floquet::Options::default());
        let method = if self.method == "lines" { lines() } else { floquet() };
        identified(&own, self.htf.period(), options, method)
    }
}

fn identified(recordings: &[Recording], period: f64, options: &Options, method: Method) -> Result<Htf> {
    let (harmonics, band) = (options.harmonics, options.band);
    identify::identify(recordings, &identify::Options { period, harmonics, band, orbit: Orbit::Removed, method })
}

/// A model at given parameters beside the records of its machine.
#[derive(Clone, Copy)]
struct At<'a> {
    model: &'a Model,
    system: &'a Compiled,
    p: &'a [f64],
    experiments: &'a [Experiment],
    /// Initial state of each record.
    starts: &'a [Vec<f64>],
    substeps: u64,
    control: &'a Control<'a>,
}

impl At<'_> {
    /// The map around an orbit of the model, as yet without event times and sentence.
    fn map(&self, measured: &Measured, orbit: &LimitCycle, options: &Options) -> Result<HarmonicMap> {
        let exact = linearize(self.system, self.p, orbit)?.htf(measured.htf.omega(), options.harmonics)?;
        self.control.check()?;
        let own = measured.again(self.model, &self.runs()?, options)?;
        let mut map = compare(self.model, &measured.kept[0], &measured.htf, &exact, &own)?;
        map.method.clone_from(&measured.method);
        map.warnings.clone_from(&measured.htf.warnings);
        Ok(map)
    }

    /// Outputs of the model along the records.
    fn runs(&self) -> Result<Vec<Vec<f64>>> {
        let At { system, p, substeps, control, .. } = *self;
        let run = |(e, x0): (&Experiment, &Vec<f64>)| {
            Run { system, p, x0, experiment: e, substeps, observer: None, control }.outputs().ok_or_else(|| {
                Error::NoConvergence {
                    method: format!("simulation of the model along `{}`", e.name),
                    iterations: 0,
                    residual: f64::INFINITY,
                    advice: "it leaves its orbit: check that the recording is of this machine".into(),
                }
            })
        };
        self.experiments.iter().zip(self.starts).map(run).collect()
    }
}

/// The columns of records that a map is made of: inputs that move, and outputs that were measured.
fn kept(model: &Model, experiments: &[Experiment]) -> Result<Vec<Recording>> {
    experiments.iter().map(|e| columns(model, e)).collect()
}

fn columns(model: &Model, e: &Experiment) -> Result<Recording> {
    let t: Vec<f64> = (0..e.len()).map(|k| e.t0 + k as f64 * e.dt).collect();
    let (mut inputs, mut input_names) = (Vec::new(), Vec::new());
    for (i, name) in model.inputs().into_iter().enumerate() {
        let mut u = vec![0.0; e.inputs.count()];
        // A quarter of a sample on, the interval is beyond doubt; its polynomial begins at the sample.
        let sample = |t: &f64| {
            e.inputs.eval(e.inputs.interval(t + 0.25 * e.dt), *t, &mut u);
            u[i]
        };
        let column: Vec<f64> = t.iter().map(sample).collect();
        if stats::std(column.iter().copied()) > 0.0 {
            inputs.push(column);
            input_names.push(name.to_string());
        }
    }
    let (mut outputs, mut output_names) = (Vec::new(), Vec::new());
    for (j, name) in model.outputs().into_iter().enumerate() {
        if e.output(j).any(f64::is_finite) {
            outputs.push(e.output(j).collect());
            output_names.push(name.to_string());
        }
    }
    if inputs.is_empty() || outputs.is_empty() {
        return Err(Error::Data {
            what: format!("recording `{}`", e.name),
            message: "a harmonic map needs an input of the model that moves and an output of the model; probe the machine with a \
                      small multisine"
                .into(),
        });
    }
    Recording::new(&e.name, t, inputs, outputs, input_names, output_names)
}

/// A recording with its outputs replaced by those of a run (n, ny) of the model.
fn simulated(model: &Model, r: &Recording, y: &[f64]) -> Result<Recording> {
    let names = model.outputs();
    let column = |name: &String| -> Vec<f64> {
        let j = names.iter().position(|n| n == name).unwrap_or(0);
        y.iter().skip(j).step_by(names.len()).copied().collect()
    };
    Recording::new(
        r.name(),
        r.t().to_vec(),
        (0..r.input_names().len()).map(|i| r.input(i).collect()).collect(),
        r.output_names().iter().map(column).collect(),
        r.input_names().to_vec(),
        r.output_names().to_vec(),
    )
}

/// Initial state of each record: that of the orbit at the record's phase, fitted to what was measured.
fn starts(
    model: &Model,
    p: &[f64],
    orbit: &LimitCycle,
    experiments: &[Experiment],
    substeps: u64,
    control: &Control<'_>,
) -> Vec<Vec<f64>> {
    let sigma = prepare::floors(experiments, None);
    let nx = orbit.start.len();
    let scale: Vec<f64> = (0..nx)
        .map(|i| orbit.trajectory.states.iter().skip(i).step_by(nx).fold(1e-9_f64, |m, v| m.max(v.abs())))
        .collect();
    let system = &model.compile_for(Vec::new(), Backend::Native);
    let subject = Subject { system, priors: &[], still: Some(p), extra: &[] };
    experiments
        .iter()
        .map(|e| {
            let x0 = on_orbit(orbit, e.t0);
            // A few periods say where it started; more would fit the mismatch into the start.
            let few = e.part(0, ((8.0 * orbit.period / e.dt) as usize).min(e.len()));
            let ground = Ground {
                experiments: std::slice::from_ref(&few),
                sigma: &sigma,
                substeps,
                state_scale: &scale.iter().map(|s| 0.1 * s).collect::<Vec<_>>(),
                control,
            };
            let from = fit::Point { theta: Vec::new(), x0: vec![x0.clone()] };
            let fitted = fit::stage(&subject, ground, &from, std::slice::from_ref(&x0), None, EFFORT);
            fitted.map_or(x0, |f| f.point.x0[0].clone())
        })
        .collect()
}

/// The state on an orbit at a time.
fn on_orbit(orbit: &LimitCycle, t: f64) -> Vec<f64> {
    let (n, nx) = (orbit.trajectory.t.len(), orbit.start.len());
    let phase = (t / orbit.period).rem_euclid(1.0);
    let k = ((phase * (n - 1) as f64).round() as usize).min(n - 1);
    orbit.trajectory.states[k * nx..(k + 1) * nx].to_vec()
}

fn compare(model: &Model, r: &Recording, measured: &Htf, exact: &Htf, own: &Htf) -> Result<HarmonicMap> {
    let k = measured.harmonics() as i64;
    let places = |all: Vec<&str>, names: &[String]| -> Vec<usize> {
        names.iter().filter_map(|n| all.iter().position(|a| a == n)).collect()
    };
    let (outputs, inputs) = (places(model.outputs(), r.output_names()), places(model.inputs(), r.input_names()));
    let sd = measured.sd().ok_or_else(|| Error::NoConvergence {
        method: "identification".into(),
        iterations: 0,
        residual: f64::NAN,
        advice: "no standard deviations came with the estimate: record more periods".into(),
    })?;
    let own_sd = own.sd();
    let (mut z, mut total, mut count, mut blur) = (Vec::new(), 0.0, 0.0, 0.0_f64);
    let same = own.omega().len() == measured.omega().len();
    for (y, exact_y) in outputs.iter().enumerate() {
        let mut by_input = Vec::new();
        for (u, exact_u) in inputs.iter().enumerate() {
            let mut rows = Vec::new();
            let (mut vague, mut size) = (0.0, 0.0);
            for h in -k..=k {
                let row: Vec<f64> = (0..measured.omega().len())
                    .map(|i| {
                        let truth = exact.value(h, i, *exact_y, *exact_u);
                        // What of the model's own run does not repeat is how it began; how the recording began is in its sd.
                        let began = own_sd.map_or(0.0, |sd| BEGUN * sd[own.index(h, i, y, u)]);
                        let off = if same { (own.value(h, i, y, u) - truth).norm_sqr() } else { 0.0 };
                        let bias = (off - began * began).max(0.0).sqrt();
                        let noise = sd[measured.index(h, i, y, u)].hypot(bias);
                        let difference = (measured.value(h, i, y, u) - truth).norm();
                        vague += noise * noise;
                        size += truth.norm_sqr();
                        if noise > 0.0 { difference / noise } else { f64::NAN }
                    })
                    .collect();
                for v in row.iter().filter(|v| v.is_finite()) {
                    total += v * v;
                    count += 1.0;
                }
                rows.push(row);
            }
            blur = blur.max((vague / size).sqrt());
            by_input.push(rows);
        }
        z.push(by_input);
    }
    let mean_square = if count > 0.0 { total / count } else { f64::NAN };
    let largest = z.iter().flatten().flatten().flatten().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    let differs = mean_square > 1.0 + BEYOND + CHANCE / count.max(1.0).sqrt() || largest > ALONE;
    Ok(HarmonicMap {
        model_name: model.name().to_string(),
        period: measured.period(),
        harmonics: (-k..=k).collect(),
        omega: measured.omega().to_vec(),
        outputs: r.output_names().to_vec(),
        inputs: r.input_names().to_vec(),
        z,
        mean_square,
        blur,
        differs,
        events: Vec::new(),
        method: String::new(),
        sentence: String::new(),
        warnings: Vec::new(),
    })
}

impl HarmonicMap {
    /// The largest entry: output, input, harmonic, frequency (rad/s), standard deviations.
    pub fn peak(&self) -> Option<(&str, &str, i64, f64, f64)> {
        let mut best: Option<(&str, &str, i64, f64, f64)> = None;
        for (y, by_input) in self.outputs.iter().zip(&self.z) {
            for (u, rows) in self.inputs.iter().zip(by_input) {
                for (h, row) in self.harmonics.iter().zip(rows) {
                    for (w, v) in self.omega.iter().zip(row).filter(|(_, v)| v.is_finite()) {
                        if best.is_none_or(|b| *v > b.4) {
                            best = Some((y, u, *h, *w, *v));
                        }
                    }
                }
            }
        }
        best
    }

    /// `the harmonic map stands above noise at harmonic +1 from u to h near 5.4 Hz`; `None` where it does not.
    pub fn stands(&self) -> Option<String> {
        let (y, u, h, w, _) = self.peak().filter(|_| self.differs)?;
        let hz = number(w / std::f64::consts::TAU);
        let h = if h == 0 { "0".into() } else { format!("{h:+}") };
        Some(format!("the harmonic map stands above noise, most at harmonic {h} from {u} to {y} near {hz} Hz"))
    }

    fn said(&self) -> String {
        let mut parts = Vec::new();
        match self.peak().filter(|_| self.differs) {
            Some((y, u, h, w, v)) => parts.push(format!(
                "The transfer functions from {u} to {y} differ from the model's: {} times their standard deviation on average, most \
                 in harmonic {h} at {} Hz ({} times)",
                number(self.mean_square.sqrt()),
                number(w / std::f64::consts::TAU),
                number(v)
            )),
            None if self.blur > LOST => parts.push(format!(
                "These recordings cannot tell whether the transfer functions are those of the model: their standard deviation \
                 is {} times their size",
                number(self.blur)
            )),
            None => parts.push(format!(
                "The transfer functions are those of the model within their noise ({} standard deviations on average, each {} % \
                 of their size)",
                number(self.mean_square.sqrt()),
                number(100.0 * self.blur)
            )),
        }
        let off: Vec<String> = self.events.iter().filter(|e| e.is_off(SAID)).map(EventTime::sentence).collect();
        if !off.is_empty() {
            parts.push(off.join(", "));
        } else if !self.events.is_empty() {
            parts.push("events happen when they should".into());
        }
        format!("{}.", parts.join("; "))
    }
}
