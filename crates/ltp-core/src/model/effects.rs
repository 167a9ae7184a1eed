//! The effects library: candidate pieces of physics, each a document of its own.
//!
//! An effect names where it acts, its law in terms of `position`, `velocity` and `t` of the port it is attached to, its
//! parameters with units relative to that port, and a reference. `law` is a smooth force; `dry` is the magnitude of a
//! set-valued friction force that opposes motion and holds at rest up to that magnitude. A user adds an effect by a
//! TOML file, without code.

use std::sync::OnceLock;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::document::Named;
use crate::error::{Error, Result, nearest};

/// One effect of the library.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// What it is, in plain words.
    pub sentence: String,
    /// Where it acts: `port`.
    pub on: String,
    /// Smooth force on the port.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<String>,
    /// Magnitude of a set-valued friction force on the port.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dry: Option<String>,
    /// Additional states with their rates.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub states: Named<EffectState>,
    /// Parameters.
    #[serde(default)]
    pub parameters: Named<EffectParameter>,
    /// The simpler effect that this one contains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extends: Option<String>,
    /// What this effect adds to the simpler one, compared with the simpler one's parameter of the same unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excess: Option<String>,
    /// Where the law comes from.
    pub reference: String,
}

/// A state that an effect brings along.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectState {
    /// Initial value.
    #[serde(default)]
    pub value: f64,
    /// Unit in words of the port: `force`, `position`, `velocity`.
    pub unit: String,
    /// Rate.
    pub flow: String,
}

/// A parameter of an effect.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectParameter {
    /// Unit in words of the port: `force`, `position`, `velocity`, `time` and their quotients.
    pub unit: String,
    /// Smallest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Natural scale, in the same words, from the sizes that the port sees.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub scale: String,
    /// Starting value of a fit from the effect's other parameters; an amplitude started by a score test where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Value at which the effect is absent; zero where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub neutral: Option<f64>,
    /// Value where none is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// One-sigma uncertainty of that value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Starting values of a shape parameter, as multiples of its scale.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shape: Vec<f64>,
}

/// The factors of a unit or size in words of a port: `force/velocity^2` is force to the 1, velocity to the -2.
pub fn words(text: &str) -> Vec<(&str, f64)> {
    let mut sign = 1.0;
    let mut out = Vec::new();
    for word in text.split_inclusive(['/', ' ']) {
        let bare = word.trim_end_matches(['/', ' ']);
        let (name, power) = bare.split_once('^').map_or((bare, 1.0), |(n, p)| (n, p.parse().unwrap_or(1.0)));
        out.push((name, sign * power));
        sign = if word.ends_with('/') { -1.0 } else { 1.0 };
    }
    out
}

/// Effects by name: the ones that ship with the crate and those a user adds.
#[derive(Clone, Debug, PartialEq)]
pub struct Library {
    effects: IndexMap<String, Effect>,
}

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("effects/", $name, ".toml")))),*]
    };
}

/// Text of every effect that ships with the crate, by name.
pub const SHIPPED: [(&str, &str); 7] = shipped![
    "viscous_friction",
    "coulomb_friction",
    "stribeck_friction",
    "quadratic_drag",
    "linear_stiffness",
    "cubic_stiffness",
    "constant_force",
];

impl Library {
    /// The library that ships with the crate.
    ///
    /// # Errors
    /// Never in a released crate: a test reads every shipped document.
    pub fn shipped() -> Result<Self> {
        static SHARED: OnceLock<Result<Library>> = OnceLock::new();
        SHARED
            .get_or_init(|| {
                let mut library = Library { effects: IndexMap::new() };
                for (name, text) in SHIPPED {
                    library.add_toml(name, text)?;
                }
                Ok(library)
            })
            .clone()
    }

    /// Adds an effect from TOML text.
    ///
    /// # Errors
    /// [`Error::Document`] when the text is not an effect.
    pub fn add_toml(&mut self, name: &str, text: &str) -> Result<()> {
        let path = format!("effect `{name}`");
        let fault = |message: String| Error::Document { path: path.clone(), message };
        let effect: Effect = toml::from_str(text).map_err(|e| fault(e.to_string()))?;
        self.add(name, effect)
    }

    /// Adds an effect.
    ///
    /// # Errors
    /// [`Error::Document`] when it has neither or both of `law` and `dry`, or a name that is taken.
    pub fn add(&mut self, name: &str, effect: Effect) -> Result<()> {
        let fault = |message: &str| Error::Document { path: format!("effect `{name}`"), message: message.into() };
        if effect.law.is_some() == effect.dry.is_some() {
            return Err(fault("give exactly one of `law` (a smooth force) and `dry` (the size of dry friction)"));
        }
        if self.effects.contains_key(name) {
            return Err(fault("there is an effect of this name already; choose another"));
        }
        self.effects.insert(name.to_string(), effect);
        Ok(())
    }

    /// Names in the order of the vocabulary.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.effects.keys().map(String::as_str)
    }

    /// An effect by name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] with the nearest names.
    pub fn get(&self, name: &str) -> Result<&Effect> {
        self.effects.get(name).ok_or_else(|| Error::UnknownName {
            kind: "effect".into(),
            name: name.into(),
            nearest: nearest(name, self.names()),
            context: "in the effects library".into(),
        })
    }
}
