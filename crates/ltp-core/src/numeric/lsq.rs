//! Levenberg-Marquardt: nonlinear least squares with bounds, for problems whose every evaluation is a simulation.
//!
//! At `x` the residuals are linearised, `cost(x + dx) = sum (r + J dx)^2`, and reach this file only as a triangle
//! ([`RowQr`]); the damped step minimises `|R dx + q|^2 + lambda |D dx|^2` by a second triangle, never by normal
//! equations. `D` holds the column norms of `J`, so that neither the step nor `lambda` depends on the units of `x`.
//! The damping follows the gain ratio (decrease found over decrease promised). Bounds: a variable on its bound that
//! the gradient presses outward is frozen for this iteration; one whose step would leave the box stops on the bound,
//! and the others are solved again with it there. The cost never rises; trials that fail, are not finite or exceed
//! 1e8 times the cost are rejected with stronger damping.
//!
//! References: D. W. Marquardt, SIAM J. Appl. Math. 11 (1963) 431-441 (damping and column scaling); H. B. Nielsen,
//! *Damping parameter in Marquardt's method*, IMM-REP-1999-05, DTU (update by the gain ratio); J. J. More, Lecture
//! Notes in Mathematics 630 (1978) 105-116 (scaling that remembers, solution by QR).

use super::rows::RowQr;
use nalgebra::{DMatrix, DVector};

/// Trials with a cost this many times the present one are treated like failed ones.
const HUGE: f64 = 1e8;
/// Singular values of the column-scaled triangle below this fraction of the largest one carry no information.
const RANK: f64 = 1e-10;
/// Damping below which it no longer tells blind directions from seen ones, and above which no step is long enough to
/// matter.
const LAMBDA: std::ops::RangeInclusive<f64> = 1e-16..=1e16;

/// A sum of squares with its linearisation.
pub trait LeastSquares {
    /// Number of unknowns.
    fn len(&self) -> usize;

    /// True when there is nothing to fit.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sum of squares of the residuals at `x` `(len,)`; `None` when it cannot be computed there.
    ///
    /// With `rows` (given empty), every residual `r_i` is pushed as `rows.push(dr_i/dx, r_i)`, so that
    /// `cost(x + dx) = sum (r_i + dr_i/dx . dx)^2` to first order. Prior terms are residuals like all others.
    /// Weight residuals by one over their standard deviation if the covariance of the fit is to be read as such.
    fn evaluate(&mut self, x: &[f64], rows: Option<&mut RowQr>) -> Option<f64>;
}

/// Limits and tolerances of [`minimise`].
#[derive(Debug, Clone)]
pub struct Settings {
    /// Linearisations at most, the first included.
    pub max_iterations: usize,
    /// Steps with `|dx_j| <= xtol (|x_j| + scale_j)` for all `j` end the fit.
    pub xtol: f64,
    /// A possible decrease below `ftol * cost` ends the fit. With unit-variance residuals that leaves every unknown
    /// within `sqrt(ftol * cost)` standard deviations of the minimum.
    pub ftol: f64,
    /// Typical size of each unknown `(n,)`, in its unit; used by `xtol` only.
    pub scale: Vec<f64>,
    /// Smallest allowed value of each unknown `(n,)`; minus infinity when there is none.
    pub lower: Vec<f64>,
    /// Largest allowed value of each unknown `(n,)`.
    pub upper: Vec<f64>,
    /// Whether the point after a step that went well is linearised at once instead of being looked at first: cheaper where a
    /// linearisation costs less than three evaluations, and steps rarely fail.
    pub ahead: bool,
    /// First damping, relative to the squared column norms; 1e-3 for good starts, 1 for poor ones.
    pub initial_lambda: f64,
}

impl Settings {
    /// No bounds, unit scales, `xtol` 1e-8, `ftol` 1e-10, 50 iterations, every point looked at first.
    pub fn new(unknowns: usize) -> Self {
        Settings {
            max_iterations: 50,
            xtol: 1e-8,
            ftol: 1e-10,
            scale: vec![1.0; unknowns],
            lower: vec![f64::NEG_INFINITY; unknowns],
            upper: vec![f64::INFINITY; unknowns],
            ahead: false,
            initial_lambda: 1e-3,
        }
    }
}

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// No decrease worth `ftol` is left.
    CostFlat,
    /// The step fell below `xtol`.
    StepSmall,
    /// No step, however short, lowers the cost although the gradient promises it: a kink, or a wrong derivative.
    Stalled,
    /// The iteration limit.
    MaxIterations,
    /// The starting point itself cannot be evaluated; `x` is the start and `cost` infinite.
    StartFailed,
}

/// The best point found, and how well the data determine it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Best point `(n,)`.
    pub x: Vec<f64>,
    /// Sum of squares there.
    pub cost: f64,
    /// Linearisations made.
    pub iterations: usize,
    /// Evaluations of the cost, those with a linearisation included.
    pub evaluations: usize,
    /// True for `CostFlat` and `StepSmall`.
    pub converged: bool,
    /// Why the iteration ended.
    pub stop: StopReason,
    /// `(J'J)^-1` `(n, n)` over the variables not held on a bound: the covariance when residuals have unit variance.
    /// Held variables have zero rows; a variable the data do not determine has an infinite variance and zero
    /// covariances.
    pub covariance: DMatrix<f64>,
    /// Variables held on a bound `(n,)`.
    pub at_bound: Vec<bool>,
}

impl Fit {
    /// Standard deviation of unknown `j` for residuals of unit variance; 0 on a bound, infinite when undetermined.
    pub fn sd(&self, j: usize) -> f64 {
        self.covariance[(j, j)].sqrt()
    }
}

/// The linearised problem at one point.
struct Local {
    r: DMatrix<f64>,
    q: DVector<f64>,
    frozen: Vec<bool>,
}

/// A step, where it leads (bounds met exactly), and the decrease of the linearised cost it promises.
struct Step {
    dx: DVector<f64>,
    to: Vec<f64>,
    decrease: f64,
}

/// Lowers the sum of squares of `problem` from `x0` `(n,)` as far as the settings ask.
///
/// `x0` is moved into the bounds first. The result is valid whatever the stop reason: `cost` is never above that of
/// the start.
pub fn minimise(problem: &mut dyn LeastSquares, x0: &[f64], settings: &Settings) -> Fit {
    let n = problem.len();
    debug_assert!(x0.len() == n && settings.scale.len() == n && settings.lower.len() == n && settings.upper.len() == n);
    let mut x: Vec<f64> = (0..n).map(|j| clamp(x0[j], settings.lower[j], settings.upper[j])).collect();
    let (mut iterations, mut evaluations) = (1, 1);
    let mut rows = RowQr::new(n);
    let Some((mut cost, mut local)) = linearise(problem, &x, &mut rows, settings) else {
        let covariance = DMatrix::from_diagonal_element(n, n, f64::INFINITY);
        let (stop, at_bound) = (StopReason::StartFailed, vec![false; n]);
        return Fit { x, cost: f64::INFINITY, iterations, evaluations, converged: false, stop, covariance, at_bound };
    };
    let mut weights = vec![0.0; n];
    remember(&mut weights, &local.r);
    let (mut lambda, mut growth) = (settings.initial_lambda.max(*LAMBDA.start()), 2.0_f64);
    let mut flat = 0;
    let mut confident = false;
    let stop = 'outer: loop {
        // What an almost undamped step promises: the whole decrease that is left, in the linearised problem.
        let left = local.step(&x, *LAMBDA.start(), &weights, settings).map_or(0.0, |step| step.decrease);
        if cost == 0.0 || left <= settings.ftol * cost {
            break StopReason::CostFlat;
        }
        if iterations >= settings.max_iterations {
            break StopReason::MaxIterations;
        }
        loop {
            let Some(step) = local.step(&x, lambda, &weights, settings) else {
                break 'outer StopReason::Stalled;
            };
            let small = (0..n).all(|j| step.dx[j].abs() <= settings.xtol * (x[j].abs() + settings.scale[j]));
            if small || lambda > *LAMBDA.end() {
                // A short step means arrival when damping did not shorten it, or when little was left to gain anyway.
                let arrived = lambda <= 1.0 || left <= settings.ftol.sqrt() * cost;
                break 'outer if arrived { StopReason::StepSmall } else { StopReason::Stalled };
            }
            let trial = step.to;
            // After a step that went well the next one will too: it is linearised at once, which costs less than to look
            // first and to linearise then.
            evaluations += 1;
            let (found, accepted) = if confident {
                iterations += 1;
                let ahead = linearise(problem, &trial, &mut rows, settings);
                let found = ahead.as_ref().map(|(c, _)| *c).filter(|c| *c <= HUGE * cost);
                (found, ahead.filter(|(c, _)| *c < cost))
            } else {
                let found = problem.evaluate(&trial, None).filter(|c| c.is_finite() && *c <= HUGE * cost);
                let accepted = match found {
                    Some(lower) if lower < cost => {
                        iterations += 1;
                        evaluations += 1;
                        linearise(problem, &trial, &mut rows, settings).filter(|(c, _)| *c <= cost)
                    }
                    _ => None,
                };
                (found, accepted)
            };
            confident = false;
            let Some((next, linearised)) = accepted else {
                lambda *= if found.is_some() { growth } else { growth.max(10.0) };
                growth *= 2.0;
                continue;
            };
            let gained = cost - next;
            let ratio = if step.decrease > 0.0 { gained / step.decrease } else { 0.0 };
            let promised_little = gained <= settings.ftol * cost && step.decrease <= settings.ftol * cost;
            flat = if promised_little { flat + 1 } else { 0 };
            let was_free = lambda <= 1.0;
            confident = settings.ahead && ratio > 0.5;
            lambda = (lambda * (1.0 - (2.0 * ratio.min(2.0) - 1.0).powi(3)).max(1.0 / 3.0)).max(*LAMBDA.start());
            growth = 2.0;
            (x, cost, local) = (trial, next, linearised);
            remember(&mut weights, &local.r);
            if flat > 0 && (was_free || flat >= 3) {
                break 'outer StopReason::CostFlat;
            }
            break;
        }
    };
    let covariance = local.covariance();
    let converged = matches!(stop, StopReason::CostFlat | StopReason::StepSmall);
    Fit { x, cost, iterations, evaluations, converged, stop, covariance, at_bound: local.frozen }
}

/// Cost and linearisation at `x`; `None` when either is not finite.
fn linearise(problem: &mut dyn LeastSquares, x: &[f64], rows: &mut RowQr, settings: &Settings) -> Option<(f64, Local)> {
    rows.clear();
    let cost = problem.evaluate(x, Some(rows)).filter(|c| c.is_finite())?;
    let (r, q) = (rows.r(), rows.rhs());
    if !(r.iter().all(|v| v.is_finite()) && q.iter().all(|v| v.is_finite())) {
        return None;
    }
    let gradient = r.tr_mul(&q);
    let frozen = (0..x.len())
        .map(|j| {
            (x[j] <= settings.lower[j] && gradient[j] > 0.0)
                || (x[j] >= settings.upper[j] && gradient[j] < 0.0)
                || settings.lower[j] >= settings.upper[j]
        })
        .collect();
    Some((cost, Local { r, q, frozen }))
}

/// Column norms that forget slowly: a column that was large keeps damping its variable for a few iterations.
fn remember(weights: &mut [f64], r: &DMatrix<f64>) {
    for (weight, column) in weights.iter_mut().zip(r.column_iter()) {
        *weight = column.norm().max(0.5 * *weight);
    }
}

impl Local {
    /// Damped step inside the box from `x`; `None` when even damping leaves nothing to solve.
    fn step(&self, x: &[f64], lambda: f64, weights: &[f64], settings: &Settings) -> Option<Step> {
        let n = x.len();
        let mut dx = DVector::zeros(n);
        let mut to = x.to_vec();
        let mut fixed = self.frozen.clone();
        loop {
            let free: Vec<usize> = (0..n).filter(|&j| !fixed[j]).collect();
            // Variables already stopped on a bound contribute a known part to the right-hand side.
            let known = &self.q + &self.r * &dx;
            let inner = self.damped(&free, &known, lambda, weights)?;
            // The bound that the straight way meets first; the others may not be met once this one holds.
            let mut first: Option<(f64, usize, f64)> = None;
            for (&j, &change) in free.iter().zip(inner.iter()) {
                let bound = if change < 0.0 { settings.lower[j] } else { settings.upper[j] };
                let share = (bound - x[j]) / change;
                if share < 1.0 && first.is_none_or(|(least, ..)| share < least) {
                    first = Some((share, j, bound));
                }
            }
            let Some((_, j, bound)) = first else {
                for (&j, &change) in free.iter().zip(inner.iter()) {
                    dx[j] = change;
                    to[j] = clamp(x[j] + change, settings.lower[j], settings.upper[j]);
                }
                break;
            };
            dx[j] = bound - x[j];
            to[j] = bound;
            fixed[j] = true;
        }
        let decrease = self.q.norm_squared() - (&self.q + &self.r * &dx).norm_squared();
        Some(Step { dx, to, decrease })
    }

    /// Minimises `|R_free d + known|^2 + lambda |D d|^2`.
    fn damped(&self, free: &[usize], known: &DVector<f64>, lambda: f64, weights: &[f64]) -> Option<DVector<f64>> {
        let mut stacked = RowQr::new(free.len());
        let mut row = vec![0.0; free.len()];
        for i in 0..self.r.nrows() {
            row.iter_mut().zip(free).for_each(|(value, &j)| *value = self.r[(i, j)]);
            stacked.push(&row, known[i]);
        }
        row.fill(0.0);
        for (place, &j) in free.iter().enumerate() {
            // A column of zeros has no gradient either; any damping keeps its variable where it is.
            row[place] = lambda.sqrt() * if weights[j] > 0.0 { weights[j] } else { 1.0 };
            stacked.push(&row, 0.0);
            row[place] = 0.0;
        }
        stacked.minimiser()
    }

    /// `(R'R)^-1` over the free variables by the singular values of the column-scaled triangle.
    fn covariance(&self) -> DMatrix<f64> {
        let n = self.frozen.len();
        let mut covariance = DMatrix::zeros(n, n);
        let free: Vec<usize> = (0..n).filter(|&j| !self.frozen[j]).collect();
        if free.is_empty() {
            return covariance;
        }
        let norms: Vec<f64> =
            free.iter().map(|&j| self.r.column(j).norm()).map(|v| if v > 0.0 { v } else { 1.0 }).collect();
        let scaled = DMatrix::from_fn(n, free.len(), |i, c| self.r[(i, free[c])] / norms[c]);
        // A column too long for its square tells nothing, and the decomposition would not end.
        if scaled.iter().any(|v| !v.is_finite()) || norms.iter().any(|v| !v.is_finite()) {
            return DMatrix::from_diagonal_element(n, n, f64::INFINITY);
        }
        let svd = scaled.svd(false, true);
        let Some(v_t) = svd.v_t else {
            return DMatrix::from_diagonal_element(n, n, f64::INFINITY);
        };
        let floor = RANK * svd.singular_values.max();
        let lost = |c: usize| -> f64 {
            let blind = svd.singular_values.iter().enumerate().filter(|(_, s)| **s <= floor);
            blind.map(|(k, _)| v_t[(k, c)].powi(2)).sum()
        };
        // A thousandth of a variable's direction in the blind space: its value is the damping's, not the data's.
        let undetermined: Vec<bool> = (0..free.len()).map(|c| lost(c) > 1e-6).collect();
        for (a, &i) in free.iter().enumerate() {
            for (b, &j) in free.iter().enumerate() {
                covariance[(i, j)] = match (undetermined[a] || undetermined[b], a == b) {
                    (true, true) => f64::INFINITY,
                    (true, false) => 0.0,
                    _ => {
                        let seen = svd.singular_values.iter().enumerate().filter(|(_, s)| **s > floor);
                        seen.map(|(k, s)| v_t[(k, a)] * v_t[(k, b)] / (s * s)).sum::<f64>() / (norms[a] * norms[b])
                    }
                };
            }
        }
        covariance
    }
}

/// `value` moved into `[low, high]`; unlike `f64::clamp` it accepts an empty interval (the upper end wins).
fn clamp(value: f64, low: f64, high: f64) -> f64 {
    value.max(low).min(high)
}

#[cfg(test)]
#[path = "lsq_tests.rs"]
mod tests;
