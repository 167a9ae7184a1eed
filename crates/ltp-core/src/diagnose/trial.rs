//! A model with some effects attached, fitted to the train records and asked to predict the held-out ones.

use indexmap::IndexMap;

use super::experiment::Experiment;
use super::fit::{FINE, Fitted, Ground, Point, Prior, Subject, full, homotopy, stage};
use super::prepare::Ties;
use super::score::Residuals;
use super::seen::Doubt;
use crate::error::Result;
use crate::model::{Backend, Compiled, Model, System};

/// Relative difference of cost below which two fits ended in the same valley.
const AGREE: f64 = 1e-3;
/// How often a fit that has not reached its goal goes on from where it is.
const PATIENCE: usize = 4;
/// Error of a predicted record over that of the fitted ones, both in units of noise, above which its start is looked for
/// once more with an observer.
const STRAYED: f64 = 1.2;

/// Shares of a record from its beginning in which its start is looked for, before the whole.
const GROWING: [f64; 2] = [0.08, 0.3];

/// Channels of delayed inputs that a model may have behind its own.
const DELAYED: usize = 16;

/// An effect and where it acts.
pub type Attachment = (String, String);

/// What the fits of all candidates share.
#[derive(Clone, Copy)]
pub struct Bench<'a> {
    /// Nominal model.
    pub model: &'a Model,
    /// Train records.
    pub train: Ground<'a>,
    /// Held-out records.
    pub test: Ground<'a>,
    /// Starting states of the train records.
    pub train_start: &'a [Vec<f64>],
    /// Starting states of the held-out records.
    pub test_start: &'a [Vec<f64>],
    /// Observers of several bandwidths for the train records, each from strong to weak.
    pub train_ties: &'a [Ties],
    /// Observer for the held-out records, from strong to weak.
    pub test_ties: &'a Ties,
}

impl Bench<'_> {
    /// Number of measured samples of the train records.
    pub fn samples(&self) -> f64 {
        self.train.experiments.iter().map(|e| e.y.iter().filter(|v| v.is_finite()).count() as f64).sum()
    }
}

/// A fitted hypothesis: the nominal model with none, one or several effects.
pub struct Trial {
    /// What was fitted.
    pub made: Made,
    /// Fit to the train records.
    pub fit: Fitted,
    /// Initial states of the held-out records.
    pub test_x0: Vec<Vec<f64>>,
    /// Residuals of train and held-out records.
    pub residuals: Residuals,
    /// Why the recordings do not show what its name says, if so.
    pub doubt: Option<Doubt>,
}

impl Trial {
    /// `effect@place`, joined by ` + `, or `nothing`.
    pub fn label(&self) -> String {
        label(&self.made.effects)
    }

    /// Standard deviations of the free parameters, coloured residuals accounted for.
    pub fn sds(&self) -> Vec<f64> {
        let inflation = self.residuals.inflation();
        self.fit.sd.iter().map(|s| s * inflation).collect()
    }

    /// Where nominal parameters are as stated and starts as first seen: what absorbed a mismatch leads away from it.
    pub fn as_stated(&self, bench: &Bench<'_>) -> Point {
        let known = |(p, v): (&Prior, &f64)| if p.sd.is_finite() { p.mean } else { *v };
        let theta = self.made.priors.iter().zip(&self.fit.point.theta).map(known).collect();
        Point { theta, x0: bench.train_start.to_vec() }
    }

    /// All parameters at the fit.
    pub fn parameters(&self) -> Vec<f64> {
        full(&self.made.system, &self.fit.point.theta)
    }

    /// Mean square of the train residuals, in units of noise.
    pub fn left(&self) -> f64 {
        let each = self.residuals.train.iter().flatten().filter(|v| v.is_finite());
        let (s, n) = each.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
        if n > 0.0 { s / n } else { 1.0 }
    }

    /// As [`Made::own`].
    pub fn own(&self, k: usize) -> Vec<(usize, String)> {
        self.made.own(k)
    }

    /// Parameters of the `k`-th effect by their names in the library.
    pub fn effect_parameters(&self, k: usize) -> IndexMap<String, f64> {
        self.own(k).into_iter().map(|(i, name)| (name, self.fit.point.theta[i])).collect()
    }

    /// Number of unknowns of the fit.
    pub fn unknowns(&self) -> usize {
        self.fit.point.theta.len() + self.fit.point.x0.iter().map(Vec::len).sum::<usize>()
    }
}

/// `effect@place`, joined by ` + `, or `nothing`.
pub fn label(effects: &[Attachment]) -> String {
    let each: Vec<String> = effects.iter().map(|(e, p)| format!("{e}@{p}")).collect();
    if each.is_empty() { "nothing".into() } else { each.join(" + ") }
}

/// Free parameters that belong to the effect number `k` of a model's document.
pub fn own(model: &Model, system: &Compiled, k: usize) -> Vec<(usize, String)> {
    let infos = model.parameters();
    let free = system.free().iter().enumerate();
    free.filter(|(_, i)| infos[**i].effect == Some(k)).map(|(n, i)| (n, short(&infos[*i].name).to_string())).collect()
}

/// `force` of `coulomb_friction@drive.force`.
pub fn short(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// What the document states of its free parameters: those of effects that it holds already are known as little as it says.
pub fn stated(model: &Model, system: &Compiled) -> Vec<Prior> {
    let infos = model.parameters();
    system.free().iter().map(|&i| Prior::stated(infos[i].value, infos[i].sd, infos[i].bounds)).collect()
}

/// Fits the model without any effect.
///
/// # Errors
/// [`crate::Error::NoConvergence`] when it cannot be followed from any start.
pub fn nominal(bench: &Bench<'_>) -> Result<Trial> {
    let model = bench.model.clone();
    let system = model.compile();
    let priors = stated(&model, &system);
    let theta: Vec<f64> = priors.iter().map(|p| p.mean).collect();
    let start = Point { theta, x0: bench.train_start.to_vec() };
    let subject = Subject { system: &system, priors: &priors, still: None, extra: &[] };
    let first = descend(bench, &subject, &[start], bench.train_ties)?;
    let fit = first.ok_or_else(|| crate::Error::NoConvergence {
        method: "fit of the nominal model".into(),
        iterations: 0,
        residual: f64::INFINITY,
        advice: "it cannot be simulated along the recordings: check signs and units of the model and of the columns"
            .into(),
    })?;
    let made = Made { effects: Vec::new(), model, system, priors, extra: Vec::new() };
    finish(bench, made, fit, bench.test_start)
}

/// Fits from several starts, free and tied, and keeps the lowest free-run cost.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn descend(bench: &Bench<'_>, subject: &Subject<'_>, starts: &[Point], ties: &[Ties]) -> Result<Option<Fitted>> {
    let mut best: Option<Fitted> = None;
    let mut keep = |f: Option<Fitted>| {
        if let Some(f) = f.filter(|f| best.as_ref().is_none_or(|b| f.cost < b.cost)) {
            best = Some(f);
        }
    };
    // Free from the first start and tied from it: two different ways down. Where both end in one valley there is no need to
    // look for others; where they differ, every start and every tie is tried and the lowest free-run cost is kept.
    let run = |start: &Point, tie: &[Vec<Vec<f64>>]| homotopy(subject, bench.train, start, bench.train_start, tie);
    let middle = ties.len() / 2;
    let first = run(&starts[0], &[]);
    let tied = ties.get(middle).and_then(|tie| run(&starts[0], tie));
    let agree = matches!((&first, &tied), (Some(a), Some(b)) if a.converged && b.converged && (a.cost - b.cost).abs() <= AGREE * a.cost.min(b.cost));
    keep(first);
    keep(tied);
    for (k, start) in starts.iter().enumerate().filter(|_| !agree) {
        for (n, tie) in ties.iter().enumerate().filter(|(n, _)| k > 0 || *n != middle) {
            bench.train.control.check()?;
            if k == 0 || n == middle {
                keep(run(start, tie));
            }
        }
        if k > 0 {
            keep(run(start, &[]));
        }
    }
    bench.train.control.check()?;
    let Some(mut fit) = best else { return Ok(None) };
    // The data are matched long before the priors have had their say along the valleys that the data leave open.
    for _ in 0..PATIENCE {
        let further = if fit.converged { None } else { run(&fit.point, &[]) };
        let Some(f) = further.filter(|f| f.cost < fit.cost) else { break };
        fit = f;
    }
    Ok(Some(fit))
}

/// A hypothesis ready to be fitted.
pub struct Made {
    /// Effects with their places.
    pub effects: Vec<Attachment>,
    /// Model with the effects attached.
    pub model: Model,
    /// Compiled model.
    pub system: Compiled,
    /// Priors of its free parameters.
    pub priors: Vec<Prior>,
    /// Sizes of the states that effects brought along.
    pub extra: Vec<f64>,
}

impl Made {
    /// Free parameters of the `k`-th effect: their places among the free ones and their names in the library.
    pub fn own(&self, k: usize) -> Vec<(usize, String)> {
        own(&self.model, &self.system, self.model.document().effects.len() - self.effects.len() + k)
    }

    /// Waves as people write them: with a positive amplitude, and a phase within half a turn.
    fn upright(&self, theta: &mut [f64]) {
        for k in 0..self.effects.len() {
            let own = self.own(k);
            let place = |name: &str| own.iter().find(|(_, n)| n == name).map(|(i, _)| *i);
            if let (Some(amplitude), Some(phase)) = (place("amplitude"), place("phase")) {
                let half = if theta[amplitude] < 0.0 { std::f64::consts::PI } else { 0.0 };
                theta[amplitude] = theta[amplitude].abs();
                let turn = std::f64::consts::TAU;
                theta[phase] = (theta[phase] + half + 0.5 * turn).rem_euclid(turn) - 0.5 * turn;
            }
        }
    }

    /// The same, compiled anew.
    pub fn copy(&self) -> Self {
        let (effects, model, system) = (self.effects.clone(), self.model.clone(), self.model.compile());
        Self { effects, model, system, priors: self.priors.clone(), extra: self.extra.clone() }
    }

    /// What a fit needs of it.
    pub fn subject(&self) -> Subject<'_> {
        Subject { system: &self.system, priors: &self.priors, still: None, extra: &self.extra }
    }
}

/// Predicts the held-out records with a fitted hypothesis; `near` are starting states close to theirs.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn finish(bench: &Bench<'_>, made: Made, mut fit: Fitted, near: &[Vec<f64>]) -> Result<Trial> {
    made.upright(&mut fit.point.theta);
    let Made { model, system, .. } = &made;
    let p = full(system, &fit.point.theta);
    let level = fit.cost / bench.samples().max(1.0);
    let near = widened(system, &p, bench.test.experiments, near);
    let followed = widened(system, &p, bench.test.experiments, bench.test_start);
    let expected = Expected { level, followed: &followed };
    let test_x0 = starts(model, &made.extra, &p, bench.test, &near, bench.test_ties, Some(expected));
    bench.train.control.check()?;
    let residuals = Residuals::of(system, &p, (bench.train, &fit.point.x0), (bench.test, &test_x0));
    Ok(Trial { made, fit, test_x0, residuals, doubt: None })
}

/// Starting states of records with those that effects bring along, where they are to begin under parameters `p`.
pub fn widened(system: &Compiled, p: &[f64], records: &[Experiment], x0: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let one = |(e, x): (&Experiment, &Vec<f64>)| {
        if x.len() == system.states() {
            return x.clone();
        }
        // Room for channels behind the inputs: delayed ones are at rest before the record.
        let mut u = vec![0.0; system.inputs() + DELAYED];
        e.inputs.eval(e.inputs.interval(e.t0 + 1e-6 * e.dt), e.t0, &mut u[..system.inputs()]);
        system.started(x, e.t0, &u, p)
    };
    records.iter().zip(x0).map(one).collect()
}

/// What a prediction of records should reach.
#[derive(Clone, Copy)]
pub struct Expected<'a> {
    /// Mean square residual of the fitted records.
    level: f64,
    /// Starting states as the filter saw them.
    followed: &'a [Vec<f64>],
}

/// Initial states of records under fixed parameters, from the recordings and an observer. Where it is known how well the
/// fitted records are met, further ways are tried only while a record is met worse: the observer, then the beginning of the
/// record by itself, growing to the whole, since a start that lands in another mode is never corrected by what comes later.
pub fn starts(
    model: &Model,
    extra: &[f64],
    p: &[f64],
    ground: Ground<'_>,
    near: &[Vec<f64>],
    ties: &Ties,
    expected: Option<Expected<'_>>,
) -> Vec<Vec<f64>> {
    // Without derivatives by the parameters a run is two to three times cheaper.
    let system = model.compile_for(Vec::new(), Backend::Native);
    let subject = Subject { system: &system, priors: &[], still: Some(p), extra };
    // Each record on its own: they share nothing but the parameters.
    ground
        .experiments
        .iter()
        .enumerate()
        .map(|(r, e)| {
            let one = Ground { experiments: std::slice::from_ref(e), ..ground };
            let from = Point { theta: Vec::new(), x0: vec![near[r].clone()] };
            let prior = [near[r].clone()];
            let seen = e.y.iter().filter(|v| v.is_finite()).count() as f64;
            let bar = expected.map_or(0.0, |x| STRAYED * STRAYED * x.level * seen);
            let mut best = stage(&subject, one, &from, &prior, None, FINE);
            let mut keep = |f: Option<Fitted>| {
                let better = f.filter(|f| best.as_ref().is_none_or(|b| f.cost < b.cost));
                best = better.or(best.take());
                best.as_ref().is_some_and(|b| b.cost <= bar)
            };
            let own: Ties = ties.iter().map(|strength| vec![strength[r].clone()]).collect();
            let grown = |start: &Vec<f64>| {
                let mut at = Point { theta: Vec::new(), x0: vec![start.clone()] };
                let prior = [start.clone()];
                for share in GROWING {
                    let end = ((share * e.len() as f64) as usize).clamp(e.len().min(8), e.len());
                    let part = [e.part(0, end)];
                    let ground = Ground { experiments: &part, ..ground };
                    at = stage(&subject, ground, &at, &prior, None, FINE)?.point;
                }
                stage(&subject, one, &at, &prior, None, FINE)
            };
            let done = keep(None) || keep(homotopy(&subject, one, &from, &prior, &own));
            if let (false, Some(x)) = (done, expected) {
                let _ = keep(grown(&near[r])) || keep(grown(&x.followed[r]));
            }
            best.map_or(near[r].clone(), |f| f.point.x0[0].clone())
        })
        .collect()
}
