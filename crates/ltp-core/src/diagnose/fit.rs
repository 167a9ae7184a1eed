//! Fitting: nominal parameters, effect parameters and one initial state per experiment, jointly.
//!
//! A fit follows a homotopy: first runs tied to the recording by an observer (prediction error), then with a weaker tie,
//! then free (simulation error). Ties keep a model that is still wrong near the recorded motion; only the free run
//! decides. Parameters carry their stated uncertainty as a prior, initial states a weak one.

use super::experiment::{Control, Experiment, Observer, Run};
use crate::model::{Compiled, System};
use crate::numeric::lsq::{self, LeastSquares};
use crate::numeric::rows::RowQr;

/// What is known of a fitted number before the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Value.
    pub mean: f64,
    /// Standard deviation; infinite where nothing is known.
    pub sd: f64,
    /// Bounds.
    pub bounds: (f64, f64),
    /// Natural size.
    pub scale: f64,
}

impl Prior {
    /// Whether the number is fitted by its logarithm: positive beyond doubt. The scale that masses, dampings and gains
    /// share, which no free motion can reveal, is then a straight valley along which the priors decide.
    fn by_logarithm(&self) -> bool {
        self.bounds.0 >= 0.0 && self.sd.is_finite() && self.mean > 3.0 * self.sd
    }

    /// From the number to what is fitted.
    fn inward(&self, v: f64) -> f64 {
        if self.by_logarithm() { v.max(1e-9 * self.mean).ln() } else { v }
    }

    /// From what is fitted to the number.
    fn outward(&self, z: f64) -> f64 {
        if self.by_logarithm() { z.exp() } else { z }
    }

    /// Derivative of the number by what is fitted, at a value of the number.
    fn slope(&self, v: f64) -> f64 {
        if self.by_logarithm() { v } else { 1.0 }
    }
}

/// What all fits of one diagnosis share.
#[derive(Clone, Copy)]
pub struct Ground<'a> {
    /// Recordings.
    pub experiments: &'a [Experiment],
    /// Noise of each output, one standard deviation.
    pub sigma: &'a [f64],
    /// Steps per sample.
    pub substeps: u64,
    /// Natural size of each state.
    pub state_scale: &'a [f64],
    /// To stop early.
    pub control: &'a Control<'a>,
}

/// A point of a fit: values of the free parameters, and the initial state of each experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Free parameters.
    pub theta: Vec<f64>,
    /// Initial states, one after the other.
    pub x0: Vec<Vec<f64>>,
}

/// A finished fit.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Where it ended.
    pub point: Point,
    /// Sum of squares, priors included.
    pub cost: f64,
    /// Standard deviations of the free parameters for residuals of unit variance.
    pub sd: Vec<f64>,
    /// Whether the iteration reached its goal.
    pub converged: bool,
}

/// A model with the priors of its free parameters.
pub struct Subject<'a> {
    /// Compiled model.
    pub system: &'a Compiled,
    /// Priors of the free parameters.
    pub priors: &'a [Prior],
    /// Whether parameters move, or only initial states.
    pub moves: bool,
}

struct Problem<'a> {
    subject: &'a Subject<'a>,
    ground: Ground<'a>,
    prior_x0: &'a [Vec<f64>],
    fixed: &'a [f64],
    observers: Option<&'a [Vec<f64>]>,
}

impl Problem<'_> {
    fn parameters(&self) -> usize {
        if self.subject.moves { self.subject.priors.len() } else { 0 }
    }

    /// The free parameters behind the fitted numbers.
    fn numbers(&self, z: &[f64]) -> Vec<f64> {
        self.subject.priors.iter().zip(&z[..self.parameters()]).map(|(p, z)| p.outward(*z)).collect()
    }

    fn unpack(&self, z: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let system = self.subject.system;
        let mut p = system.parameters().to_vec();
        let moved = if self.subject.moves { self.numbers(z) } else { self.fixed.to_vec() };
        for (&i, v) in system.free().iter().zip(moved) {
            p[i] = v;
        }
        let nx = system.states();
        (p, z[self.parameters()..].chunks(nx).map(<[f64]>::to_vec).collect())
    }
}

impl LeastSquares for Problem<'_> {
    fn len(&self) -> usize {
        self.parameters() + self.ground.experiments.len() * self.subject.system.states()
    }

    fn evaluate(&mut self, z: &[f64], mut rows: Option<&mut RowQr>) -> Option<f64> {
        let (p, x0) = self.unpack(z);
        let system = self.subject.system;
        let (np, nx, nf) = (self.parameters(), system.states(), system.free().len());
        let ns = nx + nf;
        let sigma = self.ground.sigma;
        let wants = rows.is_some();
        let theta = self.numbers(z);
        let slope: Vec<f64> = self.subject.priors.iter().zip(&theta).map(|(p, v)| p.slope(*v)).collect();
        let mut cost = 0.0;
        let mut row = vec![0.0; z.len()];
        for (r, experiment) in self.ground.experiments.iter().enumerate() {
            let observer = self.observers.map(|o| Observer { gains: &o[r] });
            let Ground { substeps, control, .. } = self.ground;
            let run = Run { system, p: &p, x0: &x0[r], experiment, substeps, observer, control };
            let ny = experiment.outputs();
            let first = np + r * nx;
            run.go(wants, &mut |k, y, dy| {
                for j in 0..ny {
                    let measured = experiment.y[k * ny + j];
                    if measured.is_nan() {
                        continue;
                    }
                    let residual = (y[j] - measured) / sigma[j];
                    cost += residual * residual;
                    let Some(rows) = rows.as_deref_mut() else { continue };
                    row.fill(0.0);
                    let d = &dy[j * ns..(j + 1) * ns];
                    for (to, from) in row[first..first + nx].iter_mut().zip(d) {
                        *to = from / sigma[j];
                    }
                    for ((to, from), slope) in row[..np].iter_mut().zip(&d[nx..]).zip(&slope) {
                        *to = from * slope / sigma[j];
                    }
                    if row.iter().any(|v| !v.is_finite()) {
                        cost = f64::NAN;
                        row.fill(0.0);
                    }
                    rows.push(&row, residual);
                }
            })
            .ok()?;
        }
        row.fill(0.0);
        let mut prior = |i: usize, value: f64, slope: f64, mean: f64, sd: f64| {
            if sd.is_finite() {
                row[i] = slope / sd;
                cost += ((value - mean) / sd).powi(2);
                if let Some(rows) = rows.as_deref_mut() {
                    rows.push(&row, (value - mean) / sd);
                }
                row[i] = 0.0;
            }
        };
        for (i, p) in self.subject.priors.iter().enumerate().take(np) {
            prior(i, theta[i], slope[i], p.mean, p.sd);
        }
        for (r, mean) in self.prior_x0.iter().enumerate() {
            for i in 0..nx {
                let at = np + r * nx + i;
                prior(at, z[at], 1.0, mean[i], self.ground.state_scale[i]);
            }
        }
        cost.is_finite().then_some(cost)
    }
}

/// How far a stage of a fit goes.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Linearisations at most.
    pub iterations: usize,
    /// A possible decrease below this fraction of the cost ends it.
    pub ftol: f64,
}

/// Rough: enough to follow the recording from a poor start.
pub const ROUGH: Effort = Effort { iterations: 8, ftol: 1e-3 };
/// Fine: as far as the data go.
pub const FINE: Effort = Effort { iterations: 60, ftol: 1e-8 };

/// One stage of a fit from a point; with `observers`, runs are tied to the recordings.
pub fn stage(
    subject: &Subject<'_>,
    ground: Ground<'_>,
    from: &Point,
    prior_x0: &[Vec<f64>],
    observers: Option<&[Vec<f64>]>,
    effort: Effort,
) -> Option<Fitted> {
    let nx = subject.system.states();
    let mut problem = Problem { subject, ground, prior_x0, fixed: &from.theta, observers };
    let np = problem.parameters();
    let mut z: Vec<f64> = subject.priors.iter().zip(&from.theta).take(np).map(|(p, v)| p.inward(*v)).collect();
    z.extend(from.x0.iter().flatten());
    let mut settings = lsq::Settings::new(z.len());
    settings.max_iterations = effort.iterations;
    settings.ftol = effort.ftol;
    for (i, p) in subject.priors.iter().enumerate().take(np) {
        settings.lower[i] = if p.by_logarithm() { p.inward(p.bounds.0) } else { p.bounds.0 };
        settings.upper[i] = p.inward(p.bounds.1);
        settings.scale[i] = p.scale / p.slope(p.mean).abs();
    }
    for i in np..z.len() {
        settings.scale[i] = ground.state_scale[(i - np) % nx];
    }
    let fit = lsq::minimise(&mut problem, &z, &settings);
    if !fit.cost.is_finite() {
        return None;
    }
    let x0 = fit.x[np..].chunks(nx).map(<[f64]>::to_vec).collect();
    let theta = if subject.moves { problem.numbers(&fit.x) } else { from.theta.clone() };
    let sd = (0..np).map(|i| fit.sd(i) * subject.priors[i].slope(theta[i])).collect();
    Some(Fitted { point: Point { theta, x0 }, cost: fit.cost, sd, converged: fit.converged })
}

/// The whole homotopy: tied, tied four times weaker, free. `observers` are from strong to weak; free from the start where
/// there are none.
pub fn homotopy(
    subject: &Subject<'_>,
    ground: Ground<'_>,
    from: &Point,
    prior_x0: &[Vec<f64>],
    observers: &[Vec<Vec<f64>>],
) -> Option<Fitted> {
    let mut at = from.clone();
    for tie in observers {
        if let Some(f) = stage(subject, ground, &at, prior_x0, Some(tie), ROUGH) {
            at = f.point;
        }
    }
    stage(subject, ground, &at, prior_x0, None, FINE)
}

/// How much of each parameter's effect on the outputs the other unknowns cannot imitate, by data alone: one is all of it.
pub fn distinct(subject: &Subject<'_>, ground: Ground<'_>, at: &Point) -> Option<Vec<f64>> {
    let np = subject.priors.len();
    let free: Vec<Prior> = subject.priors.iter().map(|p| Prior { sd: f64::INFINITY, ..*p }).collect();
    let free = Subject { priors: &free, ..*subject };
    let mut problem = Problem { subject: &free, ground, prior_x0: &[], fixed: &at.theta, observers: None };
    let mut z = at.theta.clone();
    z.extend(at.x0.iter().flatten());
    let mut rows = RowQr::new(z.len());
    problem.evaluate(&z, Some(&mut rows))?;
    let r = rows.r();
    let norms: Vec<f64> = (0..z.len()).map(|j| r.column(j).norm()).collect();
    let share = |j: usize| {
        if norms[j] == 0.0 {
            return 0.0;
        }
        // The column against all others, by the triangle with this column last.
        let others: Vec<usize> = (0..z.len()).filter(|&i| i != j && norms[i] > 0.0).collect();
        let mut last = RowQr::new(others.len());
        let mut row = vec![0.0; others.len()];
        for i in 0..r.nrows() {
            for (to, &c) in row.iter_mut().zip(&others) {
                *to = r[(i, c)] / norms[c];
            }
            last.push(&row, r[(i, j)] / norms[j]);
        }
        // A touch of ridge: others that are collinear among themselves must not count as one dimension more.
        for c in 0..others.len() {
            row.fill(0.0);
            row[c] = 1e-7;
            last.push(&row, 0.0);
        }
        last.residual_sum_squares().max(0.0).sqrt()
    };
    Some((0..np).map(share).collect())
}
