//! Minimisation of functions that have kinks, several valleys and constraints: largest eigenvalues, for one.
//!
//! Three methods meet in two nouns, the [`Problem`] and the [`Best`] point: [`nonsmooth`] is a local descent that does not
//! need a gradient where there is none, [`evolution`] and [`swarm`] look everywhere. All are given a number of evaluations and
//! keep to it; the last two a seed, and the same seed gives the same bits on any number of threads. Constraints come first: a
//! feasible point is better than an infeasible one, and of two infeasible ones the one that violates less.
//!
//! Reference: K. Deb, *An efficient constraint handling method for genetic algorithms*, Comput. Methods Appl. Mech. Eng. 186
//! (2000), 311-338 (feasibility first).

pub mod evolution;
pub mod nonsmooth;
pub mod swarm;

/// What a problem is at one point. Buffers are the caller's and are kept from one evaluation to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// The objective; NaN where it does not exist.
    pub value: f64,
    /// Its gradient (n); any subgradient at a kink. Left as it is unless asked for.
    pub gradient: Vec<f64>,
    /// Constraints (m): fulfilled when `<= 0`, scaled by the problem so that they compare.
    pub constraints: Vec<f64>,
    /// Their gradients (m, n), row-major. Left as it is unless asked for.
    pub constraint_gradients: Vec<f64>,
}

impl Evaluation {
    /// Sum of what constraints are violated by; 0 at a feasible point, infinite where something is not a number.
    pub fn violation(&self) -> f64 {
        let sum: f64 = self.constraints.iter().map(|g| g.max(0.0)).sum();
        let known = !self.value.is_nan() && self.constraints.iter().all(|g| !g.is_nan());
        if known { sum } else { f64::INFINITY }
    }
}

/// A function to minimise under constraints.
pub trait Problem: Sync {
    /// Number of unknowns, n.
    fn unknowns(&self) -> usize;
    /// Evaluates at `x` (n), with gradients when `gradients` is true.
    fn evaluate(&self, x: &[f64], gradients: bool, out: &mut Evaluation);
}

/// The best point that a method has seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// The point (n).
    pub x: Vec<f64>,
    /// The objective there.
    pub value: f64,
    /// Sum of violated constraints there: 0 when feasible.
    pub violation: f64,
    /// Evaluations spent.
    pub evaluations: usize,
}

impl Best {
    /// Nothing seen yet.
    pub fn nothing(x: &[f64]) -> Self {
        Self { x: x.to_vec(), value: f64::INFINITY, violation: f64::INFINITY, evaluations: 0 }
    }

    /// True when `value` under `violation` is better than this: feasible first, then less violation, then less value.
    pub fn is_beaten_by(&self, value: f64, violation: f64) -> bool {
        if violation == self.violation { value < self.value } else { violation < self.violation }
    }

    /// Keeps the point when it is better; counts the evaluation.
    pub fn see(&mut self, x: &[f64], value: f64, violation: f64) {
        self.evaluations += 1;
        if self.is_beaten_by(value, violation) {
            self.x.copy_from_slice(x);
            (self.value, self.violation) = (value, violation);
        }
    }

    /// The better of both; evaluations are added.
    pub fn or(self, other: Self) -> Self {
        let evaluations = self.evaluations + other.evaluations;
        let better = if self.is_beaten_by(other.value, other.violation) { other } else { self };
        Self { evaluations, ..better }
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use super::{Evaluation, Problem};

    /// `w |x_1^2 - x_0| + (1 - x_0)^2`, a curved kink with its minimum 0 at (1, 1), under `|x| <= limit`.
    pub struct Kink {
        pub weight: f64,
        pub limit: f64,
    }

    impl Problem for Kink {
        fn unknowns(&self) -> usize {
            2
        }
        fn evaluate(&self, x: &[f64], _: bool, out: &mut Evaluation) {
            let ridge = x[1] * x[1] - x[0];
            out.value = self.weight * ridge.abs() + (1.0 - x[0]).powi(2);
            let side = self.weight * ridge.signum();
            out.gradient = vec![-side - 2.0 * (1.0 - x[0]), 2.0 * side * x[1]];
            let norm = x[0].hypot(x[1]);
            out.constraints = vec![norm / self.limit - 1.0];
            out.constraint_gradients = x.iter().map(|x| x / norm / self.limit).collect();
        }
    }
}
