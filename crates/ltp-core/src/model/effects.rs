//! The effects library: candidate pieces of physics, each a document of its own.
//!
//! An effect names where it acts, its law in words of that place, its parameters with units relative to it, and a
//! reference. A user adds an effect by a TOML file, without code. What an effect does stands under exactly one key:
//!
//! | `on` | key | meaning | words beside parameters, states, `t` and the model's own names |
//! |---|---|---|---|
//! | `port` | `law` | smooth force | `position`, `velocity`; `port_stiffness`; `free_acceleration`, `mobility` |
//! | `port` | `dry` | magnitude of a set-valued friction force that opposes motion and holds at rest up to that magnitude | `position`, `velocity` |
//! | `input` | `law` | what the model sees instead of the input or signal | `value`: what stands there |
//! | `input` | `delay` | time by which it is late, s | (parameters only) |
//! | `output` | `law` | what is measured | `value`: what would be measured |
//! | `output` | `delay` | time by which the sensor is late, s | (parameters only) |
//! | `output` | `play` | gap of a play that the sensor has | (parameters only) |
//! | `contact` | `law` | force of a ground that yields, on the contact's port | `gap`, `rate` |
//! | `contact` | `gap` | distance to the ground as it really is | `gap`, `rate` |
//! | `contact` | `rebound` | rate just after touchdown, from the one before | `gap`, `rate` |
//! | `parameter` | `law` | what the model sees instead of the parameter | `value` |
//!
//! Laws on inputs and ports that have corners may name what passes through zero there (`corners`, in the same words). What
//! repeats says over what and how often (`repeats`).
//!
//! `port_stiffness` is the stiffness that the model has along the port, `free_acceleration` the acceleration of the port
//! without this force, `mobility` what a unit of this force adds to it (`port_laws`).

use std::sync::OnceLock;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::document::Named;
use super::parse::{is_name, is_reserved, parse};
use crate::error::{Error, Result, nearest};

/// One effect of the library.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// What it is, in plain words.
    pub sentence: String,
    /// Where it acts: `port`, `input`, `output`, `contact` or `parameter`.
    pub on: String,
    /// Smooth force on the port, of the ground on a contact's port, or what replaces the input, output or parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<String>,
    /// Magnitude of a set-valued friction force on the port.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dry: Option<String>,
    /// Distance of a contact to the ground as it really is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap: Option<String>,
    /// Rate of a contact's gap after touchdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rebound: Option<String>,
    /// Time by which an input or output is late, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<String>,
    /// Gap of a play at an output: what is shown follows only where it would leave half the gap on either side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub play: Option<String>,
    /// What passes through zero where the law has a corner, in its words: steps end there, so that none straddles it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corners: Vec<String>,
    /// What of it repeats: recordings that do not hold one whole period do not show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats: Option<Repeats>,
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

/// Over what an effect repeats, and how often.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repeats {
    /// `time`, or `position` of the port.
    pub over: String,
    /// The period, of the effect's parameters.
    pub every: String,
}

/// A state that an effect brings along.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectState {
    /// Initial value.
    #[serde(default)]
    pub value: f64,
    /// Initial value as an expression, evaluated at the model's initial state, t = 0 and the default inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Unit in words of the place, as for parameters.
    pub unit: String,
    /// Rate.
    pub flow: String,
}

/// A parameter of an effect.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectParameter {
    /// Unit in words of the place: `force`, `position`, `velocity` of a port or contact, `input`, `output`, `value` (of a
    /// parameter), `time`, and their quotients; `1` for a pure number.
    pub unit: String,
    /// Value at which the effect is absent; infinite where only the limit is.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub neutral: f64,
    /// Value where the effect is attached without one; `neutral` where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Prior uncertainty around `value` of a shape parameter that recordings need not determine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Smallest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest possible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Natural scale, in the same words, from the sizes that the place sees.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub scale: String,
    /// Starting value of a fit from the effect's other parameters; an amplitude started by a score test where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Starting values of a shape parameter, as multiples of its scale.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shape: Vec<f64>,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // the form that serde asks for
fn is_zero(v: &f64) -> bool {
    *v == 0.0
}

impl EffectParameter {
    /// Value where the effect is attached without one.
    pub fn default_value(&self) -> f64 {
        self.value.unwrap_or(self.neutral)
    }
}

/// Words of places, which laws use.
const WORDS: [&str; 6] = ["position", "velocity", "port_stiffness", "free_acceleration", "mobility", "value"];

/// What an effect does at its place: the key of its document and the expression there.
const ACTIONS: [(&str, &[&str]); 5] = [
    ("port", &["law", "dry"]),
    ("input", &["law", "delay"]),
    ("output", &["law", "delay", "play"]),
    ("contact", &["law", "gap", "rebound"]),
    ("parameter", &["law"]),
];

impl Effect {
    /// The keys that say what it does, with their expressions.
    fn actions(&self) -> Vec<(&'static str, &str)> {
        let all = [
            ("law", &self.law),
            ("dry", &self.dry),
            ("gap", &self.gap),
            ("rebound", &self.rebound),
            ("delay", &self.delay),
            ("play", &self.play),
        ];
        all.into_iter().filter_map(|(key, text)| Some((key, text.as_deref()?))).collect()
    }

    /// Whether what it does depends on a word, such as `port_stiffness`.
    pub fn uses(&self, word: &str) -> bool {
        let texts =
            self.actions().into_iter().map(|(_, text)| text).chain(self.states.values().map(|s| s.flow.as_str()));
        texts.into_iter().any(|text| parse(text, "").is_ok_and(|tree| tree.mentions(word)))
    }

    /// Whether it says one thing that can be said about its place.
    fn check(&self, path: &str) -> Result<()> {
        let fault = |message: String| Err(Error::Document { path: path.into(), message });
        let Some((_, keys)) = ACTIONS.iter().find(|(on, _)| *on == self.on) else {
            let known: Vec<&str> = ACTIONS.iter().map(|(on, _)| *on).collect();
            return fault(format!("on = \"{}\": an effect acts on one of {}", self.on, known.join(", ")));
        };
        let found = self.actions();
        match found.as_slice() {
            [(key, _)] if keys.contains(key) => {}
            _ => {
                let names: Vec<&str> = found.iter().map(|(key, _)| *key).collect();
                return fault(format!(
                    "an effect on a {} gives exactly one of `{}`; found {}",
                    self.on,
                    keys.join("`, `"),
                    if names.is_empty() { "none".into() } else { names.join(" and ") }
                ));
            }
        }
        let texts = found.into_iter().chain(self.states.values().map(|s| ("flow", s.flow.as_str())));
        let corners = self.corners.iter().map(|text| ("corners", text.as_str()));
        for (key, text) in texts.chain(corners) {
            parse(text, &format!("{path}, {key}"))?;
        }
        if !self.corners.is_empty() && !["input", "port"].contains(&self.on.as_str()) {
            return fault(format!("`corners` are of laws on inputs and ports, not on a {}", self.on));
        }
        if let Some(Repeats { over, every }) = &self.repeats {
            parse(every, &format!("{path}, repeats.every"))?;
            if over != "time" && !(over == "position" && self.on == "port") {
                return fault(format!("repeats.over: `{over}` is neither `time` nor, on a port, `position`"));
            }
        }
        let taken = |name: &str| !is_name(name) || is_reserved(name) || WORDS.contains(&name);
        if let Some(name) = self.parameters.keys().chain(self.states.keys()).find(|name| taken(name)) {
            return fault(format!("`{name}` cannot name a parameter or a state of it; choose another name"));
        }
        for (name, p) in &self.parameters {
            let low = p.min.unwrap_or(f64::NEG_INFINITY);
            let high = p.max.unwrap_or(f64::INFINITY);
            let v = p.default_value();
            if v.is_nan() || v < low || v > high {
                return fault(format!("parameters.{name}: its default {v} is not within {low} .. {high}"));
            }
        }
        Ok(())
    }
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

/// Text of every effect that ships with the crate, by name, in the order of the vocabulary.
pub const SHIPPED: [(&str, &str); 29] = shipped![
    "viscous_friction",
    "coulomb_friction",
    "stribeck_friction",
    "quadratic_drag",
    "linear_stiffness",
    "cubic_stiffness",
    "constant_force",
    "backlash",
    "hysteresis",
    "position_periodic_force",
    "time_periodic_force",
    "added_mass",
    "flexible_mode",
    "input_gain",
    "input_bias",
    "input_delay",
    "input_lag",
    "input_saturation",
    "input_dead_zone",
    "output_gain",
    "output_bias",
    "output_delay",
    "output_lag",
    "output_backlash",
    "compliant_ground",
    "restitution",
    "ground_height",
    "parameter_error",
    "parameter_drift",
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

    /// The shipped library with effects of one's own, each a name and the TOML text of its document.
    ///
    /// # Errors
    /// As [`Library::add_toml`].
    pub fn with<S: AsRef<str>>(own: &[(S, S)]) -> Result<Self> {
        let mut library = Self::shipped()?;
        for (name, text) in own {
            library.add_toml(name.as_ref(), text.as_ref())?;
        }
        Ok(library)
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
    /// [`Error::Document`] when it does not say exactly one thing that can be said about its place, or has a name that is
    /// taken.
    pub fn add(&mut self, name: &str, effect: Effect) -> Result<()> {
        let fault = |message: &str| Error::Document { path: format!("effect `{name}`"), message: message.into() };
        effect.check(&format!("effect `{name}`"))?;
        if !is_name(name) {
            return Err(fault("an effect is called by a name: letters, digits and `_`, beginning with a letter"));
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
