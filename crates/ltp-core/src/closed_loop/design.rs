//! Design by simulation, for comparison: the particle swarm of the thesis on [`SimulationCost`] (section 4.1.6, eq. 4.4).

use super::cost::SimulationCost;
use crate::control::Feedback;
use crate::error::{Error, Result};
use crate::numeric::minimise::swarm::{self, swarm};
use crate::numeric::minimise::{Evaluation, Problem};

/// Relative excess over the limit that a descent may leave.
const FEASIBLE: f64 = 1e-9;

/// How a gain is sought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Largest Euclidean norm of all numbers in the gain; also the standard deviation of the swarm's first places.
    pub limit: f64,
    /// Particles.
    pub particles: usize,
    /// Rounds after the first.
    pub rounds: usize,
    /// Evaluations of one descent inside; 0 leaves the local solver out.
    pub descent: usize,
    /// Evaluations at most.
    pub budget: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
}

impl Default for Search {
    fn default() -> Self {
        Self { limit: 1000.0, particles: 10, rounds: 50, descent: 40, budget: 4000, seed: 0 }
    }
}

/// The gain of least cost within the limit that the swarm finds.
///
/// # Errors
/// `OutOfRange` for a limit that is not positive, `NoConvergence` when every motion was lost.
pub fn design_by_simulation(cost: &SimulationCost, search: &Search) -> Result<Feedback> {
    if !(search.limit > 0.0 && search.limit.is_finite()) {
        let expected = "a positive norm that the gain must keep".into();
        return Err(Error::OutOfRange { what: "limit".into(), found: search.limit, expected });
    }
    let Search { particles, rounds, descent, budget, seed, .. } = *search;
    let options = swarm::Options { budget, particles, rounds, seed, descent };
    let scale = vec![search.limit; cost.len()];
    let best = swarm(&Limited { cost, limit: search.limit }, &scale, &options);
    if !(best.value.is_finite() && best.violation <= FEASIBLE) {
        return Err(Error::NoConvergence {
            method: "design by simulation".into(),
            iterations: best.evaluations,
            residual: best.violation,
            advice: format!(
                "no gain of norm up to {} kept the motion; raise the limit or the budget, or start from a smaller deviation",
                search.limit
            ),
        });
    }
    let norm = best.x.iter().map(|k| k * k).sum::<f64>().sqrt();
    Ok(Feedback {
        gain: cost.gain(&best.x)?,
        method: "simulation".into(),
        figures: vec![
            ("cost".into(), best.value),
            ("norm".into(), norm),
            ("evaluations".into(), best.evaluations as f64),
        ],
        warnings: Vec::new(),
    })
}

/// The cost under a limit of the gain's norm.
struct Limited<'a> {
    cost: &'a SimulationCost,
    limit: f64,
}

impl Problem for Limited<'_> {
    fn unknowns(&self) -> usize {
        self.cost.len()
    }

    fn evaluate(&self, x: &[f64], gradients: bool, out: &mut Evaluation) {
        let norm = x.iter().map(|k| k * k).sum::<f64>().sqrt();
        out.constraints = vec![norm / self.limit - 1.0];
        if gradients {
            (out.value, out.gradient) = self.cost.with_gradient(x);
            out.constraint_gradients = x.iter().map(|k| k / norm.max(f64::MIN_POSITIVE) / self.limit).collect();
        } else {
            out.value = self.cost.evaluate(x);
        }
    }
}
