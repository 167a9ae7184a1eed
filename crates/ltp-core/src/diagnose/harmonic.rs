//! For machines with a clock: where in harmonics and frequency a recording differs from the model, and which events come early
//! or late.
//!
//! The *harmonic map* is the identified harmonic transfer functions of the recording minus the exact ones of the model, in units
//! of the standard deviation of the difference. That has two parts: noise, which `identify` takes from repeated periods where
//! the input repeats; and what the estimator makes of the model's own run along the same inputs, where the truth is known:
//! distortion of a finite input, and the end of the record. What remains is physics.
//!
//! `events` measures when transitions happened.
//!
//! Reference: Uyanik et al., *Identification of a vertical hopping robot model via harmonic transfer functions*, Trans. Inst.
//! Meas. Control 38 (2016) 501-511; the statistics of lines as in [`crate::identify`].

mod events;

pub use events::{EventTime, event_times};

use serde::Serialize;

use super::experiment::{Control, Experiment, Run};
use super::fit::{self, Effort, Ground, Subject};
use super::prepare;
use super::words::number;
use crate::cycle::{self, LimitCycle};
use crate::error::{Error, Result};
use crate::identify::{self, Method, Orbit, floquet, lines};
use crate::linearize::linearize;
use crate::model::{Backend, Model, System};
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
    (control.progress)("finding the orbit", 0.0);
    let orbit = cycle::cycle(&system, &p, &cycle::Options::default())?;
    let exact_system = linearize(&system, &p, &orbit)?;
    let kept: Vec<Recording> = recordings.iter().map(|r| kept(model, r)).collect::<Result<_>>()?;
    (control.progress)("identifying", 0.2);
    let (measured, method) = identified(&kept, period, options)?;
    let exact = exact_system.htf(measured.omega(), options.harmonics)?;
    control.check()?;

    (control.progress)("running the model along the recordings", 0.5);
    let experiments: Vec<Experiment> =
        recordings.iter().map(|r| Experiment::new(model, r, options.hold)).collect::<Result<_>>()?;
    let substeps = (experiments[0].dt * STEPS / period).ceil().max(1.0) as u64;
    let starts = starts(model, &p, &orbit, &experiments, substeps, control);
    let mut own = Vec::new();
    for ((e, x0), r) in experiments.iter().zip(&starts).zip(&kept) {
        let run = Run { system: &system, p: &p, x0, experiment: e, substeps, observer: None, control };
        let y = run.outputs().ok_or_else(|| Error::NoConvergence {
            method: format!("simulation of the model along `{}`", e.name),
            iterations: 0,
            residual: f64::INFINITY,
            advice: "it leaves its orbit: check that the recording is of this machine".into(),
        })?;
        own.push(simulated(model, r, &y)?);
    }
    let (own, _) = identified(&own, period, options)?;
    (control.progress)("measuring event times", 0.8);
    let sigma = prepare::floors(&experiments, None);
    let mut warnings = measured.warnings.clone();
    let events = event_times(model, &system, &p, &experiments, &starts, &sigma, substeps, &mut warnings);
    let mut map = compare(model, &kept[0], &measured, &exact, &own)?;
    map.events = events;
    map.method = method;
    map.warnings = warnings;
    map.sentence = map.said();
    (control.progress)("done", 1.0);
    Ok(map)
}

/// The columns of a recording that the model has: outputs, and inputs that move.
fn kept(model: &Model, r: &Recording) -> Result<Recording> {
    let moving = |i: &usize| stats::std(r.input(*i)) > 0.0 && model.inputs().contains(&r.input_names()[*i].as_str());
    let known = |j: &usize| model.outputs().contains(&r.output_names()[*j].as_str());
    let inputs: Vec<usize> = (0..r.input_names().len()).filter(moving).collect();
    let outputs: Vec<usize> = (0..r.output_names().len()).filter(known).collect();
    if inputs.is_empty() || outputs.is_empty() {
        return Err(Error::Data {
            what: format!("recording `{}`", r.name()),
            message: "a harmonic map needs an input of the model that moves and an output of the model; probe the machine with a \
                      small multisine"
                .into(),
        });
    }
    Recording::new(
        r.name(),
        r.t().to_vec(),
        inputs.iter().map(|&i| r.input(i).collect()).collect(),
        outputs.iter().map(|&j| r.output(j).collect()).collect(),
        inputs.iter().map(|&i| r.input_names()[i].clone()).collect(),
        outputs.iter().map(|&j| r.output_names()[j].clone()).collect(),
    )
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

/// Line by line where the input repeats, since noise is then what does not; with a common denominator elsewhere.
fn identified(recordings: &[Recording], period: f64, options: &Options) -> Result<(Htf, String)> {
    let with = |method: Method| identify::Options {
        period,
        harmonics: options.harmonics,
        band: options.band,
        orbit: Orbit::Removed,
        method,
    };
    match identify::identify(recordings, &with(Method::Lines(lines::Options::default()))) {
        Ok(htf) => Ok((htf, "lines".into())),
        Err(Error::OutOfRange { .. } | Error::Shape { .. }) => {
            let htf = identify::identify(recordings, &with(Method::Floquet(floquet::Options::default())))?;
            Ok((htf, "floquet".into()))
        }
        Err(e) => Err(e),
    }
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
            let phase = (e.t0 / orbit.period).rem_euclid(1.0);
            let n = orbit.trajectory.t.len();
            let k = ((phase * (n - 1) as f64).round() as usize).min(n - 1);
            let x0 = orbit.trajectory.states[k * nx..(k + 1) * nx].to_vec();
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
    let (mut z, mut total, mut count) = (Vec::new(), 0.0, 0.0);
    let same = own.omega().len() == measured.omega().len();
    for (y, exact_y) in outputs.iter().enumerate() {
        let mut by_input = Vec::new();
        for (u, exact_u) in inputs.iter().enumerate() {
            let mut rows = Vec::new();
            for h in -k..=k {
                let row: Vec<f64> = (0..measured.omega().len())
                    .map(|i| {
                        let truth = exact.value(h, i, *exact_y, *exact_u);
                        let bias = if same { (own.value(h, i, y, u) - truth).norm() } else { 0.0 };
                        let noise = sd[measured.index(h, i, y, u)].hypot(bias);
                        let difference = (measured.value(h, i, y, u) - truth).norm();
                        if noise > 0.0 { difference / noise } else { f64::NAN }
                    })
                    .collect();
                for v in row.iter().filter(|v| v.is_finite()) {
                    total += v * v;
                    count += 1.0;
                }
                rows.push(row);
            }
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
            None => parts.push(format!(
                "The transfer functions are those of the model within their noise ({} standard deviations on average)",
                number(self.mean_square.sqrt())
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
