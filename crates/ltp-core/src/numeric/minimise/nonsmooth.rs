//! Descent on functions with kinks: BFGS with a weak Wolfe line search, and an exact penalty for constraints.
//!
//! Quasi-Newton steps find the minimum of a nonsmooth function when the line search asks for no more than the weak Wolfe
//! conditions: what curvature they measure across a kink makes the model steep there, which is what it should be. The search
//! ends when it finds no such step, when the gradient vanishes or when the evaluations are spent. Constraints `g <= 0` enter as
//! a multiple of `max(0, g)`, exact for one that is large enough; it is raised until the minimum is feasible. From an
//! infeasible start, the violation alone is descended first.
//!
//! Reference: A. S. Lewis, M. L. Overton, *Nonsmooth optimization via quasi-Newton methods*, Math. Program. 141 (2013),
//! 135-163: algorithms 2.1 and 2.6.

use super::{Best, Evaluation, Problem};

/// Armijo and Wolfe constants of the line search.
const DECREASE: f64 = 1e-4;
const CURVATURE: f64 = 0.9;
/// Doublings and bisections of one line search.
const TRIALS: usize = 40;
/// Times the penalty is raised, each time tenfold.
const ROUNDS: usize = 6;

/// How the descent goes about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Evaluations at most.
    pub budget: usize,
    /// Length of the first step, in units of the unknowns.
    pub step: f64,
    /// Weight of a constraint at first, in units of the objective per unit of the constraint.
    pub penalty: f64,
}

impl Default for Options {
    /// 2000 evaluations, first step 1, first weight 10.
    fn default() -> Self {
        Self { budget: 2000, step: 1.0, penalty: 10.0 }
    }
}

/// Descends from `start` (n) and gives the best point seen.
pub fn descend(problem: &impl Problem, start: &[f64], options: &Options) -> Best {
    let mut search = Search {
        problem,
        best: Best::nothing(start),
        evaluation: Evaluation::default(),
        budget: options.budget.max(1),
        value_weight: 1.0,
        penalty: options.penalty,
    };
    let mut x = start.to_vec();
    let mut gradient = vec![0.0; x.len()];
    search.at(&x, &mut gradient);
    if search.best.violation > 0.0 {
        search.value_weight = 0.0;
        search.penalty = 1.0;
        search.bfgs(&mut x, options.step);
        (search.value_weight, search.penalty) = (1.0, options.penalty);
    }
    for _ in 0..ROUNDS {
        x.clone_from(&search.best.x);
        let before = search.best.clone();
        search.bfgs(&mut x, options.step);
        search.at(&x, &mut gradient);
        // A minimum of the penalised function that is feasible is one of the problem.
        let feasible = search.evaluation.violation() <= 1e-9;
        let still = search.best.violation == before.violation
            && (before.value - search.best.value).abs() <= 1e-9 * before.value.abs();
        if search.spent() || (feasible && still) {
            break;
        }
        if !feasible {
            search.penalty *= 10.0;
        }
    }
    search.best
}

struct Search<'a, P> {
    problem: &'a P,
    best: Best,
    evaluation: Evaluation,
    budget: usize,
    value_weight: f64,
    penalty: f64,
}

impl<P: Problem> Search<'_, P> {
    fn spent(&self) -> bool {
        self.best.evaluations >= self.budget
    }

    /// Penalised objective and its gradient.
    fn at(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let e = &mut self.evaluation;
        self.problem.evaluate(x, true, e);
        let violation = e.violation();
        self.best.see(x, e.value, violation);
        if !violation.is_finite() {
            return f64::INFINITY;
        }
        for (g, own) in gradient.iter_mut().zip(&e.gradient) {
            *g = self.value_weight * own;
        }
        for (c, row) in e.constraints.iter().zip(e.constraint_gradients.chunks_exact(x.len())) {
            if *c > 0.0 {
                gradient.iter_mut().zip(row).for_each(|(g, r)| *g += self.penalty * r);
            }
        }
        let objective = if self.value_weight > 0.0 { self.value_weight * e.value } else { 0.0 };
        objective + self.penalty * violation
    }

    /// One run from `x`, which it moves to the end.
    fn bfgs(&mut self, x: &mut [f64], first: f64) {
        let n = x.len();
        let mut gradient = vec![0.0; n];
        let mut value = self.at(x, &mut gradient);
        let mut inverse = vec![0.0; n * n];
        let mut fresh = true;
        while !self.spent() && value.is_finite() {
            let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
            if norm == 0.0 || (self.value_weight == 0.0 && value == 0.0) {
                return;
            }
            if fresh {
                inverse.fill(0.0);
                (0..n).for_each(|i| inverse[i * n + i] = first / norm);
            }
            let direction: Vec<f64> = inverse.chunks_exact(n).map(|row| -dot(row, &gradient)).collect();
            let slope = dot(&direction, &gradient);
            let step = if slope < 0.0 { self.wolfe(x, value, slope, &direction) } else { None };
            let Some((length, next_value, next_gradient)) = step else {
                if fresh {
                    return;
                }
                // the model may have become useless: one more try along the gradient
                fresh = true;
                continue;
            };
            let s: Vec<f64> = direction.iter().map(|d| length * d).collect();
            let y: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
            let sy = dot(&s, &y);
            if fresh && sy > 0.0 {
                let scale = sy / dot(&y, &y);
                (0..n).for_each(|i| inverse[i * n + i] = scale);
            }
            fresh = false;
            x.iter_mut().zip(&s).for_each(|(x, s)| *x += s);
            let small = (value - next_value).abs() <= 1e-14 * value.abs();
            (value, gradient) = (next_value, next_gradient);
            if sy > 0.0 {
                update(&mut inverse, &s, &y, sy);
            }
            if small {
                return;
            }
        }
    }

    /// A step that fulfils the weak Wolfe conditions by doubling and bisection; the best one tried when the budget ends.
    fn wolfe(&mut self, x: &[f64], value: f64, slope: f64, direction: &[f64]) -> Option<(f64, f64, Vec<f64>)> {
        let (mut low, mut high, mut length) = (0.0, f64::INFINITY, 1.0);
        let mut gradient = vec![0.0; x.len()];
        let mut sufficient = None;
        for _ in 0..TRIALS {
            if self.spent() {
                break;
            }
            let trial: Vec<f64> = x.iter().zip(direction).map(|(x, d)| x + length * d).collect();
            let next = self.at(&trial, &mut gradient);
            if next.is_nan() || next >= value + DECREASE * length * slope {
                high = length;
            } else {
                sufficient = Some((length, next, gradient.clone()));
                if dot(&gradient, direction) >= CURVATURE * slope {
                    return sufficient;
                }
                low = length;
            }
            length = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * low };
        }
        sufficient
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The BFGS update of the inverse (n, n).
fn update(inverse: &mut [f64], s: &[f64], y: &[f64], sy: f64) {
    let n = s.len();
    let hy: Vec<f64> = inverse.chunks_exact(n).map(|row| dot(row, y)).collect();
    let factor = (1.0 + dot(y, &hy) / sy) / sy;
    for i in 0..n {
        for j in 0..n {
            inverse[i * n + j] += factor * s[i] * s[j] - (hy[i] * s[j] + s[i] * hy[j]) / sy;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::minimise::testing::Kink;

    #[test]
    fn a_curved_kink_is_followed_to_its_minimum() {
        let best = descend(&Kink { weight: 8.0, limit: 9.0 }, &[-1.2, 1.0], &Options::default());
        assert!(best.value < 1e-9 && best.violation == 0.0, "{best:?}");
        assert!(best.evaluations < 2000, "it ends by itself: {}", best.evaluations);
    }

    #[test]
    fn a_constraint_is_kept_and_met() {
        // within |x| <= 1 the kink x_0 = x_1^2 ends at x_0 = (sqrt 5 - 1)/2
        let best = descend(&Kink { weight: 8.0, limit: 1.0 }, &[0.1, 0.3], &Options::default());
        let x0 = 0.5 * (5.0_f64.sqrt() - 1.0);
        assert!(best.violation == 0.0 && (best.value - (1.0 - x0).powi(2)).abs() < 1e-7, "{best:?}");
        // from outside as well
        let best = descend(&Kink { weight: 8.0, limit: 1.0 }, &[7.0, 30.0], &Options::default());
        assert!(best.violation == 0.0 && (best.value - (1.0 - x0).powi(2)).abs() < 1e-6, "{best:?}");
    }

    #[test]
    fn the_budget_is_kept() {
        let best =
            descend(&Kink { weight: 8.0, limit: 9.0 }, &[-1.2, 1.0], &Options { budget: 17, ..Options::default() });
        assert!(best.evaluations <= 18, "{}", best.evaluations);
    }
}
