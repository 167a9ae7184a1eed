//! The model document: the tree that a TOML file, a Python dict and a Rust struct share.
//!
//! It is data only; [`mod@super::assemble`] gives it meaning. Field names are the public format (`docs/model.md`).

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Ordered map by name.
pub type Named<T> = IndexMap<String, T>;

/// A whole model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    /// Name of the model.
    pub name: String,
    /// One sentence about it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Starting mode of a hybrid model; the first one where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_mode: Option<String>,
    /// States with initial values.
    pub states: Named<State>,
    /// Inputs.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub inputs: Named<Input>,
    /// Parameters.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub parameters: Named<Parameter>,
    /// Named intermediate definitions.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub signals: Named<Definition>,
    /// `M(q) d(velocities)/dt = forces`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_matrix: Option<MassMatrix>,
    /// Flow of the only mode, or shared by modes that do not override it.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub flow: Named<String>,
    /// Modes of a hybrid model.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub modes: Named<Mode>,
    /// Events that change mode or state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub transitions: Vec<Transition>,
    /// Sampled updates, such as a digital controller.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ticks: Vec<Tick>,
    /// The pumping clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<Clock>,
    /// What is measured.
    pub outputs: Named<Definition>,
    /// Places where unmodelled physics may act.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub ports: Named<Port>,
    /// Rigid contacts.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub contacts: Named<Contact>,
    /// Physics attached from the effects library.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<Attached>,
}

/// A state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Initial value.
    #[serde(default)]
    pub value: f64,
    /// Unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// An input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Value where none is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Column in recordings, where it differs from the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// What it did before the record, where that matters: zero where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<Before>,
}

/// What an input did before the record: `"zero"`, `"hold"` or `{ periodic = "2*pi/omega" }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "`before` is \"zero\", \"hold\" or { periodic = \"period in s\" }")]
pub enum Before {
    /// It rested.
    Plain(Rest),
    /// It repeated.
    Periodic {
        /// Period, s: an expression of parameters.
        periodic: String,
    },
}

/// How an input rested before the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rest {
    /// At zero.
    Zero,
    /// At its first value.
    Hold,
}

/// A parameter; without `sd` it is exact.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Nominal value.
    pub value: f64,
    /// One-sigma uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Smallest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// An expression with an optional unit, written as a string or as a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Definition {
    /// `q = "expression"`.
    Plain(String),
    /// `q = { value = "expression", unit = "m", column = "name in files" }`.
    Full(FullDefinition),
}

/// The table form of a [`Definition`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FullDefinition {
    /// Expression.
    pub value: String,
    /// Unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Column in recordings, where it differs from the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
}

impl Definition {
    /// The expression.
    pub fn expression(&self) -> &str {
        match self {
            Self::Plain(e) => e,
            Self::Full(d) => &d.value,
        }
    }
    /// The declared unit.
    pub fn unit(&self) -> Option<&str> {
        match self {
            Self::Plain(_) => None,
            Self::Full(d) => d.unit.as_deref(),
        }
    }
    /// The column in recordings.
    pub fn column(&self) -> Option<&str> {
        match self {
            Self::Plain(_) => None,
            Self::Full(d) => d.column.as_deref(),
        }
    }
}

/// Equations of motion as in a textbook: row `i` of `matrix` times the accelerations is `forces[i]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MassMatrix {
    /// States whose rates are the unknowns.
    pub velocities: Vec<String>,
    /// Symmetric positive definite, one row per velocity.
    pub matrix: Vec<Vec<String>>,
    /// One per row; a port that `acts` on a velocity adds to its row.
    pub forces: Vec<String>,
}

/// A mode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Rates of the states.
    #[serde(default)]
    pub flow: Named<String>,
}

/// Which crossing of a guard fires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// From positive to negative.
    #[default]
    Falling,
    /// From negative to positive.
    Rising,
    /// Both.
    Either,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transition {
    /// Name of the event.
    pub name: String,
    /// Mode in which the guard is watched; the only mode where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Mode after the event; the same where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<String>,
    /// Fires where this crosses zero.
    pub guard: String,
    /// Direction of the crossing.
    #[serde(default)]
    pub direction: Direction,
    /// Fires only where this holds too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub when: Option<String>,
    /// New values of states, from the values before the event.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub reset: Named<String>,
}

/// A sampled update: at `t = offset + k*every` all updates happen at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tick {
    /// Name of the update.
    pub name: String,
    /// Sampling period, s: an expression of parameters.
    pub every: String,
    /// First instant, s: an expression of parameters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<String>,
    /// New values of states, from the values before the tick.
    pub update: Named<String>,
}

/// The pumping clock.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clock {
    /// Period, s: an expression of parameters.
    pub period: String,
}

/// A place where unmodelled physics may act.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Position along the port, measured from where a stiffness would be neutral.
    pub position: String,
    /// Velocity along the port.
    pub velocity: String,
    /// State, row of the mass matrix or signal to factor; or mode to such a table.
    pub acts: Acts,
    /// Unit of the generalised force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// What a port's force does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Acts {
    /// The same in every mode.
    Everywhere(Named<String>),
    /// By mode; nothing in a mode that is not named.
    ByMode(Named<Named<String>>),
}

/// A rigid contact: the mode in which the coordinate is free and the mode in which it is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Mode without contact.
    pub free_mode: String,
    /// Mode in contact.
    pub held_mode: String,
    /// Distance to the ground.
    pub gap: String,
    /// Its rate.
    pub rate: String,
    /// Port on which a compliant ground would act.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<String>,
}

/// An effect of the library, attached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attached {
    /// Name in the library.
    pub name: String,
    /// Port on which it acts.
    pub at: String,
    /// Values of its parameters.
    #[serde(default)]
    pub parameters: Named<Parameter>,
}

impl Document {
    /// Reads TOML.
    ///
    /// # Errors
    /// [`Error::Document`] with the line and column that TOML reports.
    pub fn from_toml(text: &str, source: &str) -> Result<Self> {
        toml::from_str(text).map_err(|e| Error::Document { path: source.to_string(), message: e.to_string() })
    }

    /// Reads JSON, the form in which a Python dict arrives.
    ///
    /// # Errors
    /// [`Error::Document`].
    pub fn from_json(text: &str, source: &str) -> Result<Self> {
        serde_json::from_str(text).map_err(|e| Error::Document { path: source.to_string(), message: e.to_string() })
    }

    /// Writes TOML that [`Document::from_toml`] reads back to the same document.
    ///
    /// # Errors
    /// [`Error::Document`] when a value has no TOML form (a non-finite number).
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|e| Error::Document { path: self.name.clone(), message: e.to_string() })
    }
}
