//! The verb `conceal` of the extension: recordings with physics that their model lacks, for the demo and for tests.

use std::collections::BTreeMap;

use ltp_core::conceal::{self as core, Difficulty, Draw, Label, Recipe};
use ltp_core::error::Error;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::json;

use crate::door;
use crate::error::from_panic;
use crate::model::Model;
use crate::recording::Recording;

/// A model that lacks a piece of physics, recordings that have it, and the label that says what it was.
///
/// An effect wants its port, and a port its effect; without both, the seed draws them. The effect `nothing` conceals nothing.
#[pyfunction]
#[pyo3(signature = (
    model="cart_pendulum", effect=None, port=None, size=0.15, snr=100.0, duration=10.0, dt=0.01, amplitude=4.0, seed=0
))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn conceal<'py>(
    py: Python<'py>,
    model: &str,
    effect: Option<String>,
    port: Option<String>,
    size: f64,
    snr: f64,
    duration: f64,
    dt: f64,
    amplitude: f64,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let effect = door::short(py, || together(effect, port))?;
    let model = model.to_owned();
    let recipe = Recipe { model, effect, size, snr, duration: (duration, dt), amplitude, seed };
    let case = door::long(py, None, move |_| core::conceal(&recipe))?;
    let records = |of: Vec<_>| PyList::new(py, of.into_iter().map(Recording::from));
    let dict = PyDict::new(py);
    dict.set_item("model", Model::from(case.model))?;
    dict.set_item("train", records(case.train)?)?;
    dict.set_item("test", records(case.test)?)?;
    dict.set_item("label", text(&case.label)?)?;
    Ok(dict)
}

/// A case drawn from system, difficulty and seed: the model as an engineer would state it, recordings, and the label.
///
/// `effect` and `at` belong together; without them the seed draws what is concealed.
#[pyfunction]
#[pyo3(signature = (system, difficulty, seed, effect=None, at=None))]
pub fn draw_case<'py>(
    py: Python<'py>,
    system: &str,
    difficulty: &str,
    seed: u64,
    effect: Option<String>,
    at: Option<String>,
) -> PyResult<Bound<'py, PyDict>> {
    let (effect, difficulty) = door::short(py, || Ok((together(effect, at)?, Difficulty::named(difficulty)?)))?;
    let what = Draw { system: system.to_owned(), difficulty, effect, seed };
    let (case, concealed) = door::long(py, None, move |_| core::draw(&what))?;
    let records = |of: Vec<_>| PyList::new(py, of.into_iter().map(Recording::from));
    let dict = PyDict::new(py);
    dict.set_item("model", Model::from(case.model))?;
    dict.set_item("train", records(case.train)?)?;
    dict.set_item("test", records(case.test)?)?;
    dict.set_item("label", serde_json::to_string(&concealed).map_err(|e| from_panic(&e.to_string()))?)?;
    Ok(dict)
}

/// Names of the systems and of the difficulties that cases are drawn from.
#[pyfunction]
pub fn case_choices() -> (Vec<&'static str>, Vec<&'static str>) {
    (core::SYSTEMS.to_vec(), Difficulty::ALL.iter().map(|(name, _)| *name).collect())
}

/// Effect and port, or neither.
fn together(effect: Option<String>, port: Option<String>) -> ltp_core::Result<Option<(String, String)>> {
    match (effect, port) {
        (None, None) => Ok(None),
        (Some(effect), None) if effect == "nothing" => Ok(Some((effect, String::new()))),
        (Some(effect), Some(port)) => Ok(Some((effect, port))),
        (given, _) => Err(Error::Model {
            path: "conceal".into(),
            message: format!(
                "found {} alone, expected an effect with its port; give both, or neither to let the seed draw them",
                if given.is_some() { "an effect" } else { "a port" }
            ),
        }),
    }
}

/// The label as JSON, keys sorted, so that the same label is always the same text.
fn text(label: &Label) -> PyResult<String> {
    let parameters: BTreeMap<_, _> = label.parameters.iter().map(|(name, value)| (name, value)).collect();
    let sorted = BTreeMap::from([
        ("at", json!(label.at)),
        ("effect", json!(label.effect)),
        ("parameters", json!(parameters)),
        ("seed", json!(label.seed)),
    ]);
    serde_json::to_string(&sorted).map_err(|e| from_panic(&e.to_string()))
}
