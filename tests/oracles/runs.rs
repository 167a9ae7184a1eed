//! Owns: a run of a model that must reach its end, and how far two runs are apart, shared by the tests of effects.

use ltp_core::model::{Model, System};
use ltp_core::simulate::{Inputs, Plan, Trajectory, simulate};

/// A run of a model to its end.
pub fn run(model: &Model, u: &Inputs, t_end: f64, dt: f64, step: f64) -> Trajectory {
    let system = model.compile();
    let plan = Plan::new(t_end, dt).unwrap().with_step(step);
    let found = simulate(&system, system.parameters(), u, &plan).unwrap();
    assert!(found.stop.is_finished(), "{}", found.stop.sentence());
    found
}

/// Largest difference over the size of the second series.
pub fn apart(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size
}
