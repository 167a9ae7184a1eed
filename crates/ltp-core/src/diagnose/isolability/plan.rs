//! What is planned: records by their inputs, sensors by their noise, and which effects are asked about.

use indexmap::IndexMap;

use super::super::experiment::Experiment;
use super::super::prepare;
use super::variation::Start;
use crate::error::{Error, Result, nearest};
use crate::model::document::{Definition, Input, State};
use crate::model::{Backend, Document, Model, Point, System};
use crate::simulate::{Hold, Inputs};

/// An input of a planned record.
#[derive(Clone, Debug, PartialEq)]
pub enum Signal {
    /// An expression of the time `t` in s.
    Expression(String),
    /// Samples (n).
    Samples(Vec<f64>),
}

/// A planned record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planned {
    /// Name.
    pub name: String,
    /// Inputs by name; those that are left out take the default of the document.
    pub inputs: IndexMap<String, Signal>,
    /// Initial values that replace those of the document, by state.
    pub initial_state: IndexMap<String, f64>,
}

/// A planned set of experiments.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Records, all of one length and sampling.
    pub records: Vec<Planned>,
    /// Length, s.
    pub t_end: f64,
    /// Sampling, s.
    pub dt: f64,
    /// How inputs run between samples.
    pub hold: Hold,
    /// Noise of each sensor, one standard deviation, by the name of an output or a state; all outputs where `None`. NaN for
    /// `noise` times the output's motion.
    pub sensors: Option<IndexMap<String, f64>>,
    /// Noise of sensors without a figure, as a share of the motion they see.
    pub noise: f64,
    /// Size at which effects are tried, as a share of what is natural at their place.
    pub size: f64,
    /// Effects to ask about; the whole library where `None`.
    pub effects: Option<Vec<String>>,
    /// Threads; one per core where zero.
    pub threads: usize,
}

impl Plan {
    /// Records of `t_end` seconds, sampled every `dt` seconds, with noise of 1 % of the motion and effects at 5 % of their
    /// natural sizes.
    pub fn new(records: Vec<Planned>, t_end: f64, dt: f64) -> Self {
        let hold = Hold::default();
        Self { records, t_end, dt, hold, sensors: None, noise: 0.01, size: 0.05, effects: None, threads: 0 }
    }

    /// The records in the model's terms.
    pub(super) fn records(&self, model: &Model) -> Result<Vec<Start>> {
        for (what, v) in [("dt", self.dt), ("t_end", self.t_end), ("noise", self.noise), ("size", self.size)] {
            if !(v > 0.0 && v.is_finite()) {
                let expected = "a positive, finite number".into();
                return Err(Error::OutOfRange { what: what.into(), found: v, expected });
            }
        }
        let n = (self.t_end / self.dt + 1e-9).floor() as usize + 1;
        if !(16..=200_000).contains(&n) {
            let expected = "16 to 200 000 samples; change dt or t_end".into();
            return Err(Error::OutOfRange { what: "t_end/dt".into(), found: self.t_end / self.dt, expected });
        }
        if self.records.is_empty() {
            return Err(Error::TooShort { what: "planned records".into(), needed: 1, found: 0 });
        }
        self.records.iter().map(|r| self.record(model, r, n)).collect()
    }

    fn record(&self, model: &Model, r: &Planned, n: usize) -> Result<Start> {
        let known = model.inputs();
        let context = format!("planned record `{}`", r.name);
        if let Some(name) = r.inputs.keys().find(|name| !known.contains(&name.as_str())) {
            return Err(Error::UnknownName {
                kind: "input".into(),
                name: name.clone(),
                nearest: nearest(name, known),
                context,
            });
        }
        let mut columns = Vec::new();
        for (name, input) in &model.document().inputs {
            let column = match (r.inputs.get(name), input.value) {
                (Some(Signal::Samples(s)), _) if s.len() == n => s.clone(),
                (Some(Signal::Samples(s)), _) => {
                    return Err(Error::Shape {
                        what: format!("input `{name}` of {context}"),
                        expected: n,
                        found: s.len(),
                    });
                }
                (Some(Signal::Expression(text)), _) => evaluated(model, text, self.dt, n)?,
                (None, Some(v)) => vec![v; n],
                (None, None) => {
                    let message = "nothing is planned for this input and the document has no default `value`".into();
                    return Err(Error::Model { path: format!("inputs.{name} in {context}"), message });
                }
            };
            if let Some(row) = column.iter().position(|v| !v.is_finite()) {
                return Err(Error::NotFinite { what: context, row, column: name.clone(), value: column[row] });
            }
            columns.push(column);
        }
        let mut x0 = model.compile_for(Vec::new(), Backend::Plain).initial_state();
        for (name, v) in &r.initial_state {
            let at = model.states().iter().position(|s| s == name).ok_or_else(|| Error::UnknownName {
                kind: "state".into(),
                name: name.clone(),
                nearest: nearest(name, model.states()),
                context: context.clone(),
            })?;
            x0[at] = *v;
        }
        let inputs = Inputs::samples(0.0, self.dt, &columns, self.hold)?;
        let experiment = Experiment::planned(&r.name, (0.0, self.dt), n, model.outputs().len(), inputs);
        Ok(Start { experiment, x0 })
    }

    /// Noise of every output of the model whose states are all outputs; `None` for what is not measured.
    pub(super) fn sensors(&self, wide: &Model, extra: &[String], spread: &[f64]) -> Result<Vec<Option<f64>>> {
        let names = wide.outputs();
        let chosen: IndexMap<String, f64> = match &self.sensors {
            Some(given) => given.clone(),
            None => names.iter().filter(|n| !extra.iter().any(|e| e == *n)).map(|n| ((*n).into(), f64::NAN)).collect(),
        };
        if chosen.is_empty() {
            return Err(Error::TooShort { what: "sensors".into(), needed: 1, found: 0 });
        }
        let mut out = vec![None; names.len()];
        for (name, sd) in chosen {
            let j = names.iter().position(|n| *n == name).ok_or_else(|| Error::UnknownName {
                kind: "output or state".into(),
                name: name.clone(),
                nearest: nearest(&name, names.clone()),
                context: "sensors".into(),
            })?;
            let sd = if sd.is_nan() { self.noise * spread[j] } else { sd };
            if !(sd > 0.0 && sd.is_finite()) {
                return Err(Error::Data {
                    what: format!("sensor `{name}`"),
                    message: format!(
                        "a noise of {sd} leaves nothing to compare; it does not move along the planned records, or its noise \
                         was given as zero: state a positive noise, or plan another input"
                    ),
                });
            }
            out[j] = Some(sd);
        }
        Ok(out)
    }

    /// Every effect with every place where it may act.
    pub(super) fn jobs(&self, model: &Model) -> Result<Vec<(String, String)>> {
        let all = prepare::candidates(model.library());
        let chosen = self.effects.clone().unwrap_or_else(|| all.clone());
        let mut jobs = Vec::new();
        for name in chosen {
            if !all.contains(&name) {
                return Err(Error::UnknownName {
                    kind: "effect".into(),
                    nearest: nearest(&name, &all),
                    name,
                    context: "effects".into(),
                });
            }
            jobs.extend(model.places(&name)?.into_iter().map(|place| (name.clone(), place)));
        }
        Ok(jobs)
    }
}

/// Samples of an expression of `t`, which may name the model's parameters.
fn evaluated(model: &Model, text: &str, dt: f64, n: usize) -> Result<Vec<f64>> {
    // Numbers in the expression carry the unit of the input, so units are not checked: parameters are taken as numbers.
    let mut bare = Document {
        name: "input".into(),
        states: IndexMap::from([("rest_".to_string(), State { value: 0.0, unit: None })]),
        inputs: IndexMap::from([("value_".to_string(), Input::default())]),
        parameters: model.document().parameters.clone(),
        flow: IndexMap::from([("rest_".to_string(), "0".to_string())]),
        outputs: IndexMap::from([("rest_".to_string(), Definition::Plain("rest_".into()))]),
        ..Document::default()
    };
    bare.parameters.values_mut().for_each(|p| p.unit = None);
    let bare = Model::new(bare, model.library().clone(), "planned input")?;
    let system = bare.with_input_expressions(&[("value_", text)])?.compile_for(Vec::new(), Backend::Plain);
    let mut out = vec![0.0; 2];
    Ok((0..n)
        .map(|k| {
            let at = Point { t: k as f64 * dt, x: &[0.0], u: &[], p: system.parameters() };
            system.output(0, at, &mut out);
            out[1]
        })
        .collect())
}
