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
    /// Whether the number is fitted by its logarithm: it is positive beyond doubt. The scale that masses, dampings and gains
    /// share, which no free motion can reveal, is then a straight valley along which the priors decide; and a stiffness or a
    /// wavelength may be off by a factor of ten.
    pub log: bool,
}

impl Prior {
    /// Knowledge of a nominal parameter as stated.
    pub fn stated(mean: f64, sd: Option<f64>, bounds: (f64, f64)) -> Self {
        let sd = sd.unwrap_or(f64::INFINITY);
        let log = bounds.0 >= 0.0 && sd.is_finite() && mean > 3.0 * sd;
        let scale = if sd.is_finite() { sd } else { mean.abs() }.max(1e-300);
        Self { mean, sd, bounds, scale, log }
    }

    /// From the number to what is fitted.
    fn inward(&self, v: f64) -> f64 {
        if self.log { v.max(1e-9 * self.mean).ln() } else { v }
    }

    /// From what is fitted to the number.
    fn outward(&self, z: f64) -> f64 {
        if self.log { z.exp() } else { z }
    }

    /// Derivative of the number by what is fitted, at a value of the number.
    fn slope(&self, v: f64) -> f64 {
        if self.log { v } else { 1.0 }
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
    /// Natural size of each state; zero where it starts from what is known and nothing else.
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

/// All parameters of a system with the free ones set.
pub fn full(system: &Compiled, theta: &[f64]) -> Vec<f64> {
    let mut p = system.parameters().to_vec();
    for (&i, v) in system.free().iter().zip(theta) {
        p[i] = *v;
    }
    p
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
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// Compiled model.
    pub system: &'a Compiled,
    /// Priors of the free parameters.
    pub priors: &'a [Prior],
    /// All parameters where only initial states move; `None` where the free ones move too.
    pub still: Option<&'a [f64]>,
    /// Sizes of the states that effects brought along, after the model's own.
    pub extra: &'a [f64],
}

impl Subject<'_> {
    fn moves(&self) -> bool {
        self.still.is_none()
    }
}

/// Where linearised residuals go: the row of derivatives, and the residual.
pub type Sink<'a> = dyn FnMut(&[f64], f64) + 'a;

struct Problem<'a> {
    subject: &'a Subject<'a>,
    ground: Ground<'a>,
    prior_x0: &'a [Vec<f64>],
    observers: Option<&'a [Vec<f64>]>,
}

impl Problem<'_> {
    fn parameters(&self) -> usize {
        if self.subject.moves() { self.subject.priors.len() } else { 0 }
    }

    /// The free parameters behind the fitted numbers.
    fn numbers(&self, z: &[f64]) -> Vec<f64> {
        self.subject.priors.iter().zip(&z[..self.parameters()]).map(|(p, z)| p.outward(*z)).collect()
    }

    /// The fitted numbers of a point.
    fn inward(&self, at: &Point) -> Vec<f64> {
        let priors = self.subject.priors.iter().zip(&at.theta).take(self.parameters());
        priors.map(|(p, v)| p.inward(*v)).chain(at.x0.iter().flatten().copied()).collect()
    }

    fn unpack(&self, z: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let system = self.subject.system;
        let p = self.subject.still.map_or_else(|| full(system, &self.numbers(z)), <[f64]>::to_vec);
        let nx = system.states();
        (p, z[self.parameters()..].chunks(nx).map(<[f64]>::to_vec).collect())
    }
}

impl LeastSquares for Problem<'_> {
    fn len(&self) -> usize {
        self.parameters() + self.ground.experiments.len() * self.subject.system.states()
    }

    fn evaluate(&mut self, z: &[f64], rows: Option<&mut RowQr>) -> Option<f64> {
        match rows {
            Some(rows) => self
                .data(z, Some(&mut |row, r| rows.push(row, r)))
                .map(|c| c + self.beliefs(z, Some(&mut |row, r| rows.push(row, r)))),
            None => self.data(z, None).map(|c| c + self.beliefs(z, None)),
        }
        .filter(|c| c.is_finite())
    }
}

impl Problem<'_> {
    /// Sum of squares of the residuals of all samples.
    fn data(&self, z: &[f64], mut rows: Option<&mut Sink<'_>>) -> Option<f64> {
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
                    for (i, (to, from)) in row[first..first + nx].iter_mut().zip(d).enumerate() {
                        *to = if self.is_held(i) { 0.0 } else { from / sigma[j] };
                    }
                    for ((to, from), slope) in row[..np].iter_mut().zip(&d[nx..]).zip(&slope) {
                        *to = from * slope / sigma[j];
                    }
                    if row.iter().any(|v| !v.is_finite()) {
                        cost = f64::NAN;
                        row.fill(0.0);
                    }
                    rows(&row, residual);
                }
            })
            .ok()?;
        }
        Some(cost)
    }

    /// Sum of squares of the deviations from what was known before.
    fn beliefs(&self, z: &[f64], mut rows: Option<&mut Sink<'_>>) -> f64 {
        let (np, nx) = (self.parameters(), self.subject.system.states());
        let theta = self.numbers(z);
        let mut row = vec![0.0; z.len()];
        let mut cost = 0.0;
        let mut prior = |i: usize, value: f64, slope: f64, mean: f64, sd: f64| {
            if sd.is_finite() {
                row[i] = slope / sd;
                cost += ((value - mean) / sd).powi(2);
                if let Some(rows) = rows.as_deref_mut() {
                    rows(&row, (value - mean) / sd);
                }
                row[i] = 0.0;
            }
        };
        for (i, p) in self.subject.priors.iter().enumerate().take(np) {
            prior(i, theta[i], p.slope(theta[i]), p.mean, p.sd);
        }
        let initial = self.subject.system.initial_state();
        for (r, mean) in self.prior_x0.iter().enumerate() {
            for i in 0..nx {
                let at = np + r * nx + i;
                let sd = if self.is_held(i) { 1.0 } else { self.state_size(i) };
                prior(at, z[at], 1.0, mean.get(i).copied().unwrap_or(initial[i]), sd);
            }
        }
        cost
    }

    /// Whether a state starts from what is known: a foot a millionth of a noise above the ground is not on it.
    fn is_held(&self, i: usize) -> bool {
        self.state_size(i) == 0.0
    }

    /// Natural size of a state, those of effects after the model's own.
    fn state_size(&self, i: usize) -> f64 {
        let own = self.ground.state_scale;
        own.get(i).or_else(|| self.subject.extra.get(i - own.len())).copied().unwrap_or(1.0)
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
pub const FINE: Effort = Effort { iterations: 60, ftol: 1e-6 };

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
    let mut problem = Problem { subject, ground, prior_x0, observers };
    let np = problem.parameters();
    let z = problem.inward(from);
    let mut settings = lsq::Settings::new(z.len());
    settings.max_iterations = effort.iterations;
    settings.ftol = effort.ftol;
    settings.ahead = true;
    for (i, p) in subject.priors.iter().enumerate().take(np) {
        settings.lower[i] = if p.log { p.inward(p.bounds.0) } else { p.bounds.0 };
        settings.upper[i] = p.inward(p.bounds.1);
        settings.scale[i] = p.scale / p.slope(p.mean).abs();
    }
    for i in np..z.len() {
        let (record, state) = ((i - np) / nx, (i - np) % nx);
        settings.scale[i] = problem.state_size(state);
        if problem.is_held(state) {
            let known = prior_x0[record][state];
            (settings.lower[i], settings.upper[i]) = (known, known);
        }
    }
    let fit = lsq::minimise(&mut problem, &z, &settings);
    if !fit.cost.is_finite() {
        return None;
    }
    let x0 = fit.x[np..].chunks(nx).map(<[f64]>::to_vec).collect();
    let theta = if subject.moves() { problem.numbers(&fit.x) } else { from.theta.clone() };
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

/// The residuals of a fit and their derivatives by what was fitted, row by row: of the data into `data`, of what was known
/// before into `beliefs`. `None` where the run fails.
pub fn linearised(
    subject: &Subject<'_>,
    ground: Ground<'_>,
    at: &Point,
    prior_x0: &[Vec<f64>],
    data: &mut Sink<'_>,
    beliefs: &mut Sink<'_>,
) -> Option<()> {
    let problem = Problem { subject, ground, prior_x0, observers: None };
    let z = problem.inward(at);
    problem.data(&z, Some(data)).filter(|c| c.is_finite())?;
    problem.beliefs(&z, Some(beliefs));
    Some(())
}

/// A point moved by a step of the fitted numbers, inside the bounds.
pub fn moved(subject: &Subject<'_>, ground: Ground<'_>, at: &Point, step: &[f64]) -> Point {
    let problem = Problem { subject, ground, prior_x0: &[], observers: None };
    let z: Vec<f64> = problem.inward(at).iter().zip(step).map(|(z, d)| z + d).collect();
    let np = problem.parameters();
    let inside = |(v, p): (f64, &Prior)| v.clamp(p.bounds.0, p.bounds.1);
    let theta = problem.numbers(&z).into_iter().zip(subject.priors).map(inside).collect();
    Point { theta, x0: z[np..].chunks(subject.system.states()).map(<[f64]>::to_vec).collect() }
}

/// Cost of a point, priors included; `None` where the run fails.
pub fn cost(subject: &Subject<'_>, ground: Ground<'_>, at: &Point, prior_x0: &[Vec<f64>]) -> Option<f64> {
    let mut problem = Problem { subject, ground, prior_x0, observers: None };
    let z = problem.inward(at);
    problem.evaluate(&z, None)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::model::zoo;
    use crate::signal::Recording;
    use crate::simulate::Hold;

    /// A mass that coasts from 0.2 m at 0.5 m/s, fitted from rest at the origin.
    fn fitted(state_scale: &[f64]) -> Vec<f64> {
        let model = zoo("drive").unwrap().with_parameters(&[("b", 0.0, None)]).unwrap();
        let system = model.compile();
        let t: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
        let (still, q) = (vec![0.0; 100], t.iter().map(|t| 0.2 + 0.5 * t).collect());
        let r = Recording::new("run", t, vec![still], vec![q], vec!["tau".into()], vec!["q".into()]).unwrap();
        let experiments = [Experiment::new(&model, &r, Hold::FirstOrder).unwrap()];
        let cancelled = AtomicBool::new(false);
        let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
        let ground = Ground { experiments: &experiments, sigma: &[1e-3], substeps: 1, state_scale, control: &control };
        let p = system.parameters().to_vec();
        let subject = Subject { system: &system, priors: &[], still: Some(&p), extra: &[] };
        let from = Point { theta: Vec::new(), x0: vec![vec![0.0, 0.0]] };
        let prior = from.x0.clone();
        stage(&subject, ground, &from, &prior, None, FINE).unwrap().point.x0.swap_remove(0)
    }

    #[test]
    fn a_state_without_a_size_starts_exactly_where_it_is_known_to() {
        let free = fitted(&[1.0, 1.0]);
        assert!((free[0] - 0.2).abs() < 1e-4 && (free[1] - 0.5).abs() < 1e-4, "{free:?}");
        let held = fitted(&[0.0, 1.0]);
        // To the bit: a foot a billionth above the ground is in the air. The speed makes up for it as it can.
        assert_eq!(held[0], 0.0);
        assert!(held[1] > 0.6, "{held:?}");
    }
}
