//! The verb `simulate` of the extension: what Python gave, by name, becomes what the core takes, by number.

use std::sync::Arc;

use ltp_core::error::{Error, Result, nearest};
use ltp_core::model::{self, Compiled, System};
use ltp_core::simulate::{self as core, Hold, Inputs, Plan};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::interrupt::Interruptible;
use crate::model::Model;
use crate::trajectory::Trajectory;
use crate::{array, door};

/// Times may lie this far from an even grid, relative to its step.
const EVEN: f64 = 1e-6;
/// Steps between two samples beyond which a step length must be a slip of the pen.
const MOST_SUBSTEPS: f64 = 1e9;

/// Values by name, in the order given.
type Named<T> = Vec<(String, T)>;

/// Simulates a model on the evenly spaced times `t` (n,), s, from its initial state at `t[0]`.
///
/// An input is an array of samples (n,) at these times, held in between as `hold` says, or an expression of `t`.
#[pyfunction]
#[pyo3(signature = (model, inputs, t, *, hold="first-order", step=None, initial_state=None, initial_mode=None))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn simulate(
    py: Python<'_>,
    model: &Model,
    inputs: &Bound<'_, PyMapping>,
    t: &Bound<'_, PyAny>,
    hold: &str,
    step: Option<f64>,
    initial_state: Option<&Bound<'_, PyMapping>>,
    initial_mode: Option<&str>,
) -> PyResult<Trajectory> {
    let t = array::vector("t", t)?;
    let (mut expressions, mut samples): (Named<String>, Named<Vec<f64>>) = Default::default();
    for (name, value) in inputs.items()?.extract::<Vec<(String, Bound<'_, PyAny>)>>()? {
        match value.extract() {
            Ok(expression) => expressions.push((name, expression)),
            Err(_) => {
                let values = array::vector(&format!("input `{name}`"), &value)?;
                samples.push((name, values));
            }
        }
    }
    let start = initial_state.map_or(Ok(Vec::new()), |given| array::numbers("initial_state", given))?;

    let driven = if expressions.is_empty() { None } else { Some(drive(py, model.core(), &expressions)?) };
    let system = match &driven {
        Some(driven) => door::short(py, || Ok(Arc::new(driven.compile())))?,
        None => model.compiled(py)?,
    };
    let model = model.core();
    let (inputs, plan) = door::short(py, || {
        let mut plan = grid(&t, step)?;
        if step.is_none() {
            plan = plan.suiting(&*system, system.parameters());
        }
        plan.initial_state = Some(initial(model, &system, "initial_state", &start)?);
        plan.initial_mode = initial_mode.map(|mode| model.mode(mode)).transpose()?;
        Ok((sampled(driven.as_ref().unwrap_or(model), samples, hold_named(hold)?, &plan)?, plan))
    })?;
    let ready = Arc::clone(&system);
    let run = door::long(py, None, move |outside| {
        let parameters = ready.parameters().to_vec();
        core::simulate(&Interruptible::new(ready, outside.interrupted), &parameters, &inputs, &plan)
    })?;
    Trajectory::new(py, run, &system, model, &expressions)
}

/// What inputs do between samples.
pub fn hold_named(name: &str) -> Result<Hold> {
    serde_json::from_value(name.into()).map_err(|_| Error::UnknownName {
        kind: "hold".into(),
        name: name.into(),
        nearest: ["first-order", "zero-order", "cubic"].map(String::from).into(),
        context: "between samples".into(),
    })
}

/// The model with expressions in place of inputs.
fn drive(py: Python<'_>, model: &model::Model, expressions: &[(String, String)]) -> PyResult<model::Model> {
    let expressions: Vec<_> = expressions.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    door::short(py, || model.with_input_expressions(&expressions))
}

/// The plan whose samples are at the times `t`.
fn grid(t: &[f64], step: Option<f64>) -> Result<Plan> {
    let n = t.len();
    if n < 2 {
        return Err(Error::TooShort { what: "t".into(), needed: 2, found: n });
    }
    // From zero, the first step is exact to the bit; elsewhere it is the one that rounding hurts most.
    let dt = if t[0] == 0.0 { t[1] } else { (t[n - 1] - t[0]) / (n - 1) as f64 };
    if !(dt > 0.0 && dt.is_finite()) {
        let expected = "a positive number of seconds; times increase in even steps, as np.arange(n)*dt does".into();
        return Err(Error::OutOfRange { what: "t: the step between two samples".into(), found: dt, expected });
    }
    let at = |row: usize| t[0] + row as f64 * dt;
    let slack = EVEN * dt + 4.0 * f64::EPSILON * t[n - 1].abs();
    if let Some(row) = (0..n).find(|&row| t[row].is_nan() || (t[row] - at(row)).abs() > slack) {
        let expected = format!("{} s, as times increase in even steps, here of {dt} s; np.arange(n)*dt does", at(row));
        return Err(Error::OutOfRange { what: format!("t[{row}]"), found: t[row], expected });
    }
    let mut plan = Plan::new(dt, dt)?;
    (plan.t0, plan.samples) = (t[0], n);
    match step {
        None => Ok(plan),
        Some(step) if step > 0.0 && dt / step <= MOST_SUBSTEPS => Ok(plan.with_step(step)),
        Some(found) => {
            let expected =
                format!("a positive time in s, at least {:e} s for samples {dt} s apart", dt / MOST_SUBSTEPS);
            Err(Error::OutOfRange { what: "step".into(), found, expected })
        }
    }
}

/// The model's initial state with some values replaced; `argument` is what errors call them.
pub fn initial(model: &model::Model, system: &Compiled, argument: &str, given: &[(String, f64)]) -> Result<Vec<f64>> {
    let mut x = system.initial_state();
    for (name, value) in given {
        let Some(i) = model.states().iter().position(|state| state == name) else {
            return Err(unknown("state", name, model.states(), argument));
        };
        if !value.is_finite() {
            let expected = format!("a finite number in {}; correct it", model.unit(name).unwrap_or("its unit"));
            return Err(Error::OutOfRange { what: format!("{argument} `{name}`"), found: *value, expected });
        }
        x[i] = *value;
    }
    Ok(x)
}

/// Inputs through samples; those that are not given take the default of the document.
fn sampled(model: &model::Model, mut given: Vec<(String, Vec<f64>)>, hold: Hold, plan: &Plan) -> Result<Inputs> {
    if let Some((name, _)) = given.iter().find(|(name, _)| !model.document().inputs.contains_key(name)) {
        return Err(unknown("input", name, &model.inputs(), model.name()));
    }
    let sampled = !given.is_empty();
    let mut columns = Vec::new();
    for (name, input) in &model.document().inputs {
        columns.push(match given.iter().position(|(other, _)| other == name) {
            Some(k) => checked(name, given.swap_remove(k).1, plan.samples)?,
            None => {
                let missing = || Error::Model {
                    path: format!("{}: inputs.{name}", model.name()),
                    message:
                        "nothing is given for this input and the document has no default `value`; give samples or \
                              an expression of t, such as \"2*sin(3*t)\""
                            .into(),
                };
                vec![input.value.ok_or_else(missing)?; if sampled { plan.samples } else { 1 }]
            }
        });
    }
    if sampled { Inputs::samples(plan.t0, plan.dt, &columns, hold) } else { Ok(Inputs::constant(&columns.concat())) }
}

/// Samples of one input, when there are as many as times and all are finite.
fn checked(name: &str, values: Vec<f64>, expected: usize) -> Result<Vec<f64>> {
    if values.len() != expected {
        return Err(Error::Shape { what: format!("input `{name}` beside t"), expected, found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(row) => Err(Error::NotFinite { what: "inputs".into(), row, column: name.to_owned(), value: values[row] }),
        None => Ok(values),
    }
}

/// An error that names what there is instead.
pub fn unknown<S: AsRef<str>>(kind: &str, name: &str, known: &[S], context: &str) -> Error {
    let nearest = nearest(name, known.iter().map(AsRef::as_ref));
    Error::UnknownName { kind: kind.into(), name: name.into(), nearest, context: context.into() }
}
