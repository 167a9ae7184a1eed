//! The noun `Model` of the extension, and what ships with the core: the zoo, the library of effects, units.

use std::sync::{Arc, OnceLock};

use ltp_core::error::{Error, nearest};
use ltp_core::model::{self, Compiled, Document, Library, ParameterInfo, ZOO, effects::SHIPPED, units};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMapping};

use crate::{array, door};

/// Equations as data, read and checked; compiled to native code when first simulated.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Model {
    core: model::Model,
    compiled: OnceLock<Arc<Compiled>>,
}

impl From<model::Model> for Model {
    fn from(core: model::Model) -> Self {
        Self { core, compiled: OnceLock::new() }
    }
}

#[pymethods]
impl Model {
    /// A model from the TOML text of a document; `source` is what errors call it, `effects` are names and documents of
    /// effects beyond the shipped ones.
    #[staticmethod]
    #[pyo3(signature = (text, source, effects = Vec::new()))]
    fn from_toml(py: Python<'_>, text: &str, source: &str, effects: Vec<(String, String)>) -> PyResult<Self> {
        let read = || model::Model::new(Document::from_toml(text, source)?, Library::with(&effects)?, source);
        Ok(door::short(py, read)?.into())
    }

    /// A model from the JSON text of a document; the rest as for `from_toml`.
    #[staticmethod]
    #[pyo3(signature = (text, source, effects = Vec::new()))]
    fn from_json(py: Python<'_>, text: &str, source: &str, effects: Vec<(String, String)>) -> PyResult<Self> {
        let read = || model::Model::new(Document::from_json(text, source)?, Library::with(&effects)?, source);
        Ok(door::short(py, read)?.into())
    }

    /// The same model with more effects in its library, each a name and the TOML text of its document.
    fn with_effects(&self, py: Python<'_>, effects: Vec<(String, String)>) -> PyResult<Self> {
        Ok(door::short(py, || self.core.with_effects(&effects))?.into())
    }

    /// Names of the effects in the model's library.
    #[getter]
    fn library(&self) -> Vec<&str> {
        self.core.library().names().collect()
    }

    /// Where an effect may act in this model.
    fn places(&self, py: Python<'_>, effect: &str) -> PyResult<Vec<String>> {
        door::short(py, || self.core.places(effect))
    }

    /// The document as TOML text.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        door::short(py, || self.core.to_toml())
    }

    /// Name of the model.
    #[getter]
    fn name(&self) -> &str {
        self.core.name()
    }

    /// What the document says about itself; may be empty.
    #[getter]
    fn description(&self) -> &str {
        &self.core.document().description
    }

    /// Names of the states, those of attached effects last.
    #[getter]
    fn states(&self) -> Vec<String> {
        self.core.states().to_vec()
    }

    /// Names of the inputs.
    #[getter]
    fn inputs(&self) -> Vec<&str> {
        self.core.inputs()
    }

    /// Names of the outputs.
    #[getter]
    fn outputs(&self) -> Vec<&str> {
        self.core.outputs()
    }

    /// Names of the ports.
    #[getter]
    fn ports(&self) -> Vec<&str> {
        self.core.ports()
    }

    /// Names of the modes.
    #[getter]
    fn modes(&self) -> Vec<&str> {
        self.core.modes()
    }

    /// Each parameter as a dict of name, value, sd, unit, min and max; those of attached effects last.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let dict = |p: &ParameterInfo| {
            let dict = PyDict::new(py);
            dict.set_item("name", &p.name)?;
            describe(&dict, p)?;
            dict.set_item("min", Some(p.bounds.0).filter(|v| v.is_finite()))?;
            dict.set_item("max", Some(p.bounds.1).filter(|v| v.is_finite()))?;
            Ok(dict)
        };
        PyList::new(py, self.core.parameters().iter().map(dict).collect::<PyResult<Vec<_>>>()?)
    }

    /// Each attached effect as a dict of name, at and parameters.
    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for (k, attached) in self.core.document().effects.iter().enumerate() {
            let parameters = PyDict::new(py);
            for p in self.core.parameters().iter().filter(|p| p.effect == Some(k)) {
                let estimate = PyDict::new(py);
                describe(&estimate, p)?;
                parameters.set_item(p.name.rsplit('.').next(), estimate)?;
            }
            let effect = PyDict::new(py);
            effect.set_item("name", &attached.name)?;
            effect.set_item("at", &attached.at)?;
            effect.set_item("parameters", parameters)?;
            list.append(effect)?;
        }
        Ok(list)
    }

    /// Unit of a state, input, output, parameter or signal; `1` where none is declared.
    fn unit(&self, py: Python<'_>, name: &str) -> PyResult<String> {
        door::short(py, || self.core.unit(name).map(str::to_owned))
    }

    /// The name an input or output has in files.
    fn column(&self, py: Python<'_>, name: &str) -> PyResult<String> {
        door::short(py, || self.core.column(name).map(str::to_owned))
    }

    /// The value of an input where none is given, in its unit; None where it must be given.
    fn input_default(&self, py: Python<'_>, name: &str) -> PyResult<Option<f64>> {
        door::short(py, || {
            let inputs = &self.core.document().inputs;
            inputs.get(name).map(|input| input.value).ok_or_else(|| Error::UnknownName {
                kind: "input".into(),
                name: name.into(),
                nearest: nearest(name, inputs.keys().map(String::as_str)),
                context: self.core.name().into(),
            })
        })
    }

    /// The same model with other parameter values.
    fn with_parameters(&self, py: Python<'_>, values: &Bound<'_, PyMapping>) -> PyResult<Self> {
        let values = array::numbers("parameters", values)?;
        let values: Vec<_> = values.iter().map(|(name, value)| (name.as_str(), *value, None)).collect();
        Ok(door::short(py, || self.core.with_parameters(&values))?.into())
    }

    /// The model with an effect of the library at a place; parameters that are left out take the effect's defaults.
    fn attach(&self, py: Python<'_>, effect: &str, at: &str, parameters: &Bound<'_, PyMapping>) -> PyResult<Self> {
        let parameters = array::numbers("parameters", parameters)?;
        let parameters: Vec<_> = parameters.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        Ok(door::short(py, || self.core.attach(effect, at, &parameters))?.into())
    }
}

impl Model {
    /// The model that the core knows.
    pub fn core(&self) -> &model::Model {
        &self.core
    }

    /// The model ready to run, compiled once.
    pub fn compiled(&self, py: Python<'_>) -> PyResult<Arc<Compiled>> {
        door::short(py, || Ok(Arc::clone(self.compiled.get_or_init(|| Arc::new(self.core.compile())))))
    }
}

/// Value, one-sigma uncertainty and unit of a parameter.
fn describe(dict: &Bound<'_, PyDict>, parameter: &ParameterInfo) -> PyResult<()> {
    dict.set_item("value", parameter.value)?;
    dict.set_item("sd", parameter.sd)?;
    dict.set_item("unit", parameter.unit.as_deref().unwrap_or("1"))
}

/// Names of the reference models.
#[pyfunction]
pub fn zoo_names() -> Vec<&'static str> {
    ZOO.iter().map(|(name, _)| *name).collect()
}

/// Document of a reference model.
#[pyfunction]
pub fn zoo_text(py: Python<'_>, name: &str) -> PyResult<&'static str> {
    door::short(py, || model::zoo_text(name))
}

/// Names of the effects that ship with the library.
#[pyfunction]
pub fn effect_names() -> Vec<&'static str> {
    SHIPPED.iter().map(|(name, _)| *name).collect()
}

/// Document of an effect.
#[pyfunction]
pub fn effect_text(py: Python<'_>, name: &str) -> PyResult<&'static str> {
    door::short(py, || {
        Library::shipped()?.get(name)?;
        Ok(SHIPPED.iter().find(|(shipped, _)| *shipped == name).map_or("", |(_, text)| text))
    })
}

/// The factor by which a value in the unit `found` becomes a value in the unit `wanted`.
#[pyfunction]
pub fn unit_factor(py: Python<'_>, found: &str, wanted: &str) -> PyResult<f64> {
    door::short(py, || units::conversion(found, wanted, "unit"))
}
