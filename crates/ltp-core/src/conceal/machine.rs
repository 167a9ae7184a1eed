//! The true machine: a model with concealed physics, ready for the truth integrator.
//!
//! Laws at ports and contacts come from the effect's document ([`Model::attach`]); what happens to an input, an output or a
//! parameter is realised here a second time, so that a diagnosis does not share it: a delay reads the input's straight
//! lines at an earlier time, an output's delay samples the motion earlier, play walks on a fine grid.

use crate::error::{Error, Result};
use crate::model::document::Input;
use crate::model::friction::{EventParts, Parts};
use crate::model::program::Program;
use crate::model::{Backend, Model, Point, System};

use super::Planted;

/// Samples of the inputs, joined by straight lines.
#[derive(Clone, Debug)]
pub struct Wave {
    /// Distance of samples, s; the first one is at time zero.
    pub dt: f64,
    /// Number of inputs.
    pub count: usize,
    /// Values (n, inputs).
    pub samples: Vec<f64>,
    /// Whether the samples repeat before and after; zero before and constant after where not.
    pub periodic: bool,
}

impl Wave {
    /// Values at a time.
    pub fn eval(&self, t: f64, out: &mut [f64]) {
        let n = (self.samples.len() / self.count.max(1)) as i64;
        // A hair later, so that an instant on the grid belongs to the interval that begins there.
        let k = (t / self.dt + 1e-9).floor() as i64;
        let s = t / self.dt - k as f64;
        if k < 0 && !self.periodic {
            out.fill(0.0);
            return;
        }
        let at = |k: i64| if self.periodic { k.rem_euclid(n) } else { k.min(n - 1) } as usize * self.count;
        let (a, b) = (at(k), at(k + 1));
        for (i, o) in out.iter_mut().enumerate() {
            *o = self.samples[a + i] + s * (self.samples[b + i] - self.samples[a + i]);
        }
    }
}

/// How one input of the equations arises from the recorded ones.
struct Channel {
    source: Source,
    delay: f64,
    gain: f64,
    bias: f64,
    limit: f64,
    dead: f64,
    /// Time constant and place in the state.
    lag: Option<(f64, usize)>,
}

enum Source {
    Input(usize),
    /// A signal of the document, a function of time, inputs and parameters: the last output of this program.
    Signal(Program),
}

/// How one recorded output arises from the one of the equations.
#[derive(Clone, Debug, Default)]
pub struct Sensor {
    /// Factor.
    pub gain: f64,
    /// Added.
    pub bias: f64,
    /// Seconds late.
    pub delay: f64,
    /// Play: width of the gap, in the unit of the output.
    pub gap: f64,
    /// Time constant and place in the state.
    pub lag: Option<(f64, usize)>,
}

/// A model with concealed physics.
pub struct Machine {
    pub(super) modes: Vec<Parts>,
    pub(super) events: Vec<EventParts>,
    pub(super) initial_mode: usize,
    pub(super) sensors: Vec<Sensor>,
    /// States of the equations.
    pub(super) nx: usize,
    /// States altogether, with those of lags.
    pub(super) nz: usize,
    /// Start of the equations' states, as the document says.
    pub(super) initial: Vec<f64>,
    channels: Vec<Channel>,
    recorded: usize,
    p: Vec<f64>,
    drift: Vec<(usize, f64)>,
    name: String,
}

impl Machine {
    /// The machine of a model and what is concealed in it.
    ///
    /// # Errors
    /// What [`Model::attach`] says; [`Error::Model`] for a model with sampled updates.
    pub fn new(model: &Model, planted: &[Planted]) -> Result<Self> {
        let mut truth = model.clone();
        let mut sources: Vec<Source> = (0..model.inputs().len()).map(Source::Input).collect();
        let mut names: Vec<String> = model.inputs().into_iter().map(String::from).collect();
        // A signal that an effect acts on becomes an input, which its own expression drives.
        for e in planted.iter().filter(|e| e.name.starts_with("input_")) {
            if names.contains(&e.at) {
                continue;
            }
            let mut shown = truth.document().clone();
            let signal = shown.signals.get(&e.at).cloned().ok_or_else(|| Error::UnknownName {
                kind: "input or signal".into(),
                name: e.at.clone(),
                nearest: Vec::new(),
                context: format!("conceal: {}", e.name),
            })?;
            shown.outputs.insert("concealed signal".into(), signal.clone());
            let probe = Model::new(shown, truth.library().clone(), "")?;
            let (parts, _, mode) = probe.all_parts().ok_or_else(|| ticking(model))?;
            let source = parts.into_iter().nth(mode).map(|p| p.output).ok_or_else(|| ticking(model))?;
            let mut document = truth.document().clone();
            document.signals.shift_remove(&e.at);
            let input = Input { unit: signal.unit().map(String::from), ..Default::default() };
            document.inputs.insert(e.at.clone(), input);
            truth = Model::new(document, truth.library().clone(), "")?;
            sources.push(Source::Signal(source));
            names.push(e.at.clone());
        }
        let channel =
            |source| Channel { source, delay: 0.0, gain: 1.0, bias: 0.0, limit: f64::INFINITY, dead: 0.0, lag: None };
        let mut channels: Vec<Channel> = sources.into_iter().map(channel).collect();
        let mut sensors = vec![Sensor { gain: 1.0, ..Default::default() }; model.outputs().len()];
        let mut drift = Vec::new();
        let mut lags = Vec::new();
        for e in planted {
            let place = |known: &[&str]| {
                known.iter().position(|n| *n == e.at).ok_or_else(|| Error::UnknownName {
                    kind: "place".into(),
                    name: e.at.clone(),
                    nearest: Vec::new(),
                    context: format!("conceal: {}", e.name),
                })
            };
            let value = |name: &str| e.value(name);
            if e.name.starts_with("input_") {
                let i = place(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
                let c = &mut channels[i];
                match e.name.as_str() {
                    "input_gain" => c.gain = value("gain"),
                    "input_bias" => c.bias = value("bias"),
                    "input_delay" => c.delay = value("delay"),
                    "input_saturation" => c.limit = value("limit"),
                    "input_dead_zone" => c.dead = value("width"),
                    _ => lags.push((true, i, value("time_constant"))),
                }
            } else if e.name.starts_with("output_") {
                let j = place(&model.outputs())?;
                let s = &mut sensors[j];
                match e.name.as_str() {
                    "output_gain" => s.gain = value("gain"),
                    "output_bias" => s.bias = value("bias"),
                    "output_delay" => s.delay = value("delay"),
                    "output_backlash" => s.gap = value("gap"),
                    _ => lags.push((false, j, value("time_constant"))),
                }
            } else if e.name == "parameter_error" {
                let i = truth.parameter(&e.at)?;
                let off = truth.parameters()[i].value + value("offset");
                truth = truth.with_parameters(&[(&e.at, off, None)])?;
            } else if e.name == "parameter_drift" {
                drift.push((truth.parameter(&e.at)?, value("rate")));
            } else {
                let given: Vec<(&str, f64)> = e.parameters.iter().map(|(n, v)| (n.as_str(), *v)).collect();
                truth = truth.attach(&e.name, &e.at, &given)?;
            }
        }
        let nx = truth.states().len();
        for (k, (input, i, tau)) in lags.iter().enumerate() {
            let lag = Some((*tau, nx + k));
            if *input {
                channels[*i].lag = lag;
            } else {
                sensors[*i].lag = lag;
            }
        }
        let (modes, events, initial_mode) = truth.all_parts().ok_or_else(|| ticking(model))?;
        Ok(Self {
            modes,
            events,
            initial_mode,
            sensors,
            nx,
            nz: nx + lags.len(),
            initial: truth.compile_for(Vec::new(), Backend::Plain).initial_state(),
            channels,
            recorded: model.inputs().len(),
            p: truth.parameters().iter().map(|p| p.value).collect(),
            drift,
            name: truth.name().to_string(),
        })
    }

    /// Name of the model, for messages.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Number of inputs of the equations.
    pub(super) fn inputs(&self) -> usize {
        self.channels.len()
    }

    /// Delays of the inputs, s.
    pub(super) fn delays(&self) -> impl Iterator<Item = f64> {
        self.channels.iter().map(|c| c.delay)
    }

    /// Parameters at a time.
    pub(super) fn parameters(&self, t: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(&self.p);
        for (i, rate) in &self.drift {
            out[*i] += rate * t;
        }
    }

    /// Inputs of the equations at a time, and the rates of their lags.
    pub(super) fn drive(&self, wave: &Wave, t: f64, z: &[f64], p: &[f64], u: &mut [f64], rates: Option<&mut [f64]>) {
        let mut rates = rates;
        let mut read = vec![0.0; self.recorded];
        for (i, c) in self.channels.iter().enumerate() {
            let at = t - c.delay;
            wave.eval(at, &mut read);
            let raw = match &c.source {
                Source::Input(i) => read[*i],
                Source::Signal(program) => {
                    let mut all = vec![0.0; program.len()];
                    program.eval(Point { t: at, x: &z[..self.nx], u: &read, p }, &mut all);
                    all[program.len() - 1]
                }
            };
            let scaled = c.gain * raw + c.bias;
            let passed = scaled - scaled.clamp(-c.dead, c.dead);
            let value = passed.clamp(-c.limit, c.limit);
            u[i] = match c.lag {
                None => value,
                Some((tau, k)) => {
                    if let Some(rates) = rates.as_deref_mut() {
                        rates[k] = (value - z[k]) / tau;
                    }
                    z[k]
                }
            };
        }
    }
}

fn ticking(model: &Model) -> Error {
    Error::Model {
        path: model.name().to_string(),
        message: "recordings with concealed physics are made of models without sampled updates ([[ticks]])".into(),
    }
}
