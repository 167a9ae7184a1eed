//! The noun `Case`: recordings of a model with concealed physics, made by integrators that share nothing with the one
//! under test. A diagnosis that names the physics cannot owe it to a shared error.
//!
//! Read in order: `extrapolation` (one step), `slip` (set-valued friction), `machine` (a model and what is concealed in
//! it), `sensing` (late sensors and play), [`truth`] (a run with its events), [`mod@strang`] (the slow integrator that the
//! truth is held against), `setups` (how each machine is excited and recorded), `palette` (which effects are drawn, and how
//! large), `trace` (what the nominal parameters can imitate), [`mod@draw`] (a case from system, difficulty and seed),
//! `recipe` (the demonstration).

#[cfg(test)]
mod agreement_tests;
pub mod draw;
mod extrapolation;
mod machine;
mod palette;
mod recipe;
mod sensing;
mod setups;
mod shown;
#[cfg(test)]
mod shown_tests;
mod slip;
pub mod strang;
mod trace;
pub mod truth;
#[cfg(test)]
mod truth_tests;

use serde::Serialize;

use crate::model::Model;
use crate::signal::Recording;

pub use draw::{Concealed, Difficulty, Draw, draw};
pub use machine::{Machine, Wave};
pub use recipe::{Recipe, conceal};
pub use setups::{SYSTEMS, Setup, Take};
pub use strang::motion;

/// One concealed piece of physics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Planted {
    /// Effect.
    pub name: String,
    /// Port, input, output, contact or parameter.
    pub at: String,
    /// Parameters in the units of the model.
    pub parameters: Vec<(String, f64)>,
}

impl Planted {
    /// Value of a parameter; zero where it has none.
    pub fn value(&self, name: &str) -> f64 {
        self.parameters.iter().find(|(n, _)| n == name).map_or(0.0, |(_, v)| *v)
    }
}

/// A concealed case: what a diagnosis may see, and what it must not.
#[derive(Clone)]
pub struct Case {
    /// What was concealed: not for the eyes of the diagnosis.
    pub label: Label,
    /// The model as an engineer would state it: parameters off by about half their uncertainty, the effect left out.
    pub model: Model,
    /// Two train recordings of different amplitude.
    pub train: Vec<Recording>,
    /// One held-out recording.
    pub test: Vec<Recording>,
}

/// What was concealed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Label {
    /// Effect; `nothing` for a clean case.
    pub effect: String,
    /// Port.
    pub at: String,
    /// Parameters of the effect.
    pub parameters: Vec<(String, f64)>,
    /// Seed.
    pub seed: u64,
}
