//! Level 6: what a feedback does to the nonlinear system it was designed for. The noun is [`Certificate`].
//!
//! [`close()`] puts reference and gain into the model, which becomes an ordinary model; [`certify()`] asks every witness there
//! is whether that loop is stable, and says why where they disagree; [`track()`] runs through stages of references;
//! [`SimulationCost`] is the design objective of those who simulate instead, [`design_by_simulation`] their search.

pub mod certify;
pub mod close;
pub mod cost;
pub mod design;
mod orbit;
mod run;
mod spread;
pub mod track;
mod verdict;

pub use certify::{Certificate, Lifted, Options, Tolerated, certify};
pub use close::close;
pub use cost::{SimulationCost, Task};
pub use design::{Search, design_by_simulation};
pub use orbit::Orbit;
pub use run::Run;
pub use spread::{Case, Spread};
pub use track::{Stage, Tracked, track};
pub use verdict::Verdict;

#[cfg(test)]
mod tests;
