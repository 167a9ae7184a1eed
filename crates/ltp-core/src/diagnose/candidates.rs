//! Candidates: the nominal model and every effect at every port, each refitted jointly with nominal parameters and initial
//! states from several starts, and asked to predict the held-out records.

use indexmap::IndexMap;
use rayon::prelude::*;

use super::fit::{Fitted, Ground, Point, Prior, Subject, distinct, homotopy};
use super::law::{LawFunction, PortScales};
use super::prepare::Ties;
use super::result::Force;
use super::score::Residuals;
use crate::error::Result;
use crate::model::{Compiled, Model, System};

/// Relative difference of cost below which two fits ended in the same valley.
const AGREE: f64 = 1e-3;

/// How often a fit that has not reached its goal goes on from where it is.
const PATIENCE: usize = 4;

/// Share of an effect's action on the outputs that nothing else can imitate, below which it is another parameter's.
const IMITATED: f64 = 1e-4;

/// What the fits of all candidates share.
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

/// A fitted candidate.
pub struct Trial {
    /// Effect and port; `None` for the nominal model.
    pub effect: Option<(String, String)>,
    /// Model with the effect attached.
    pub model: Model,
    /// Compiled model.
    pub system: Compiled,
    /// Priors of its free parameters.
    pub priors: Vec<Prior>,
    /// Fit to the train records.
    pub fit: Fitted,
    /// Initial states of the held-out records.
    pub test_x0: Vec<Vec<f64>>,
    /// Residuals of train and held-out records.
    pub residuals: Residuals,
    /// Whether nominal parameters can do the same, so that it cannot be told from them.
    pub imitated: bool,
}

impl Trial {
    /// `effect@port`, or `nothing`.
    pub fn label(&self) -> String {
        self.effect.as_ref().map_or("nothing".into(), |(e, p)| format!("{e}@{p}"))
    }

    /// Standard deviations of the free parameters, coloured residuals accounted for.
    pub fn sds(&self) -> Vec<f64> {
        let inflation = self.residuals.inflation();
        self.fit.sd.iter().map(|s| s * inflation).collect()
    }

    /// All parameters at the fit.
    pub fn parameters(&self) -> Vec<f64> {
        full(&self.system, &self.fit.point.theta)
    }

    /// The effect's own parameters by their names in the library.
    pub fn effect_parameters(&self) -> IndexMap<String, f64> {
        let infos = self.model.parameters();
        let free = self.system.free().iter().zip(&self.fit.point.theta);
        free.filter(|(i, _)| infos[**i].effect.is_some() && self.effect.is_some())
            .map(|(i, v)| (short(&infos[*i].name).to_string(), *v))
            .collect()
    }
}

/// `force` of `coulomb_friction@drive.force`.
pub fn short(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// All parameters of a system with the free ones set.
pub fn full(system: &Compiled, theta: &[f64]) -> Vec<f64> {
    let mut p = system.parameters().to_vec();
    for (&i, v) in system.free().iter().zip(theta) {
        p[i] = *v;
    }
    p
}

/// Priors of the free parameters: stated uncertainty for nominal ones, bounds and sizes for those of the last effect.
pub fn priors(model: &Model, system: &Compiled, scales: Option<&PortScales>) -> Result<Vec<Prior>> {
    let own = model.document().effects.len().checked_sub(1);
    system
        .free()
        .iter()
        .map(|&i| {
            let info = &model.parameters()[i];
            let mut prior = Prior {
                mean: info.value,
                sd: info.sd.unwrap_or(f64::INFINITY),
                bounds: info.bounds,
                scale: info.sd.unwrap_or(info.value.abs()).max(1e-300),
            };
            if let (Some(k), Some(scales), true) = (info.effect, scales, info.effect == own) {
                let effect = model.library().get(&model.document().effects[k].name)?;
                let words = effect.parameters.get(short(&info.name)).map_or("", |p| p.scale.as_str());
                prior = Prior { mean: 0.0, sd: f64::INFINITY, scale: scales.of(words), ..prior };
            }
            Ok(prior)
        })
        .collect()
}

/// Fits the nominal model; `start` are values of its free parameters.
///
/// # Errors
/// [`crate::Error::NoConvergence`] when it cannot be followed from any start.
pub fn nominal(bench: &Bench<'_>) -> Result<Trial> {
    let model = bench.model.clone();
    let system = model.compile();
    let priors = priors(&model, &system, None)?;
    let theta: Vec<f64> = priors.iter().map(|p| p.mean).collect();
    let start = Point { theta, x0: bench.train_start.to_vec() };
    trial(bench, None, model, system, priors, &[start], bench.train_ties)?.ok_or_else(|| crate::Error::NoConvergence {
        method: "fit of the nominal model".into(),
        iterations: 0,
        residual: f64::INFINITY,
        advice: "it cannot be simulated along the recordings: check signs and units of the model and of the columns"
            .into(),
    })
}

/// Fits one model from several starts and ties, keeps the lowest free-run cost, and predicts the held-out records.
fn trial(
    bench: &Bench<'_>,
    effect: Option<(String, String)>,
    model: Model,
    system: Compiled,
    priors: Vec<Prior>,
    starts: &[Point],
    ties: &[Ties],
) -> Result<Option<Trial>> {
    let subject = Subject { system: &system, priors: &priors, moves: true };
    let mut best: Option<Fitted> = None;
    let mut keep = |f: Option<Fitted>| {
        if let Some(f) = f.filter(|f| best.as_ref().is_none_or(|b| f.cost < b.cost)) {
            best = Some(f);
        }
    };
    // Free from the first start and tied from it: two different ways down. Where both end in one valley there is no need to
    // look for others; where they differ, every start and every tie is tried and the lowest free-run cost is kept.
    let run = |start: &Point, tie: &[Vec<Vec<f64>>]| homotopy(&subject, bench.train, start, bench.train_start, tie);
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
    let test_x0 = predict(bench, &system, &priors, &fit.point.theta);
    let p = full(&system, &fit.point.theta);
    let residuals = Residuals::of(&system, &p, (bench.train, &fit.point.x0), (bench.test, &test_x0));
    Ok(Some(Trial { effect, model, system, priors, fit, test_x0, residuals, imitated: false }))
}

/// Initial states of the held-out records under fixed parameters.
pub fn predict(bench: &Bench<'_>, system: &Compiled, priors: &[Prior], theta: &[f64]) -> Vec<Vec<f64>> {
    let subject = Subject { system, priors, moves: false };
    starts(&subject, bench.test, theta, bench.test_start, bench.test_ties)
}

/// Initial states of records under fixed parameters, from the recordings and an observer.
pub fn starts(
    subject: &Subject<'_>,
    ground: Ground<'_>,
    theta: &[f64],
    start: &[Vec<f64>],
    ties: &Ties,
) -> Vec<Vec<f64>> {
    // Each record on its own: they share nothing but the parameters.
    ground
        .experiments
        .iter()
        .enumerate()
        .map(|(r, e)| {
            let one = Ground { experiments: std::slice::from_ref(e), ..ground };
            let from = Point { theta: theta.to_vec(), x0: vec![start[r].clone()] };
            let own: Ties = ties.iter().map(|strength| vec![strength[r].clone()]).collect();
            let prior = [start[r].clone()];
            let direct = homotopy(subject, one, &from, &prior, &[]);
            let tied = homotopy(subject, one, &from, &prior, &own);
            let best = [direct, tied].into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost));
            best.map_or(start[r].clone(), |f| f.point.x0[0].clone())
        })
        .collect()
}

/// What is known about a port before its effects are fitted.
pub struct PortGuess {
    /// Port.
    pub port: String,
    /// Force that the model as stated misses there.
    pub stated: Vec<Force>,
    /// Sizes.
    pub scales: PortScales,
}

/// Fits every effect at every port. Richer members of a family start from the simpler ones, and the simpler ones again
/// from the richer ones, since each may fall into a valley that the other knows a way out of.
///
/// # Errors
/// [`crate::Error::Interrupted`], and what attaching an effect may say.
pub fn all(bench: &Bench<'_>, names: &[String], guesses: &[PortGuess], nominal: &Trial) -> Result<Vec<Trial>> {
    let library = bench.model.library();
    let mut jobs = Vec::new();
    for guess in guesses {
        for name in names {
            jobs.push((name.clone(), guess));
        }
    }
    let total = jobs.len().max(1) as f64;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let tell = |label: &str| {
        let n = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        (bench.train.control.progress)(label, 0.2 + 0.6 * n as f64 / total);
    };
    let simple = |name: &str| library.get(name).is_ok_and(|e| e.extends.is_none());
    let (first, second): (Vec<_>, Vec<_>) = jobs.into_iter().partition(|(name, _)| simple(name));
    let run = |(name, guess): &(String, &PortGuess), from: Option<&Trial>| -> Result<Option<Trial>> {
        tell(&format!("{name}@{}", guess.port));
        one(bench, name, guess, nominal, from)
    };
    let mut trials: Vec<Trial> =
        first.par_iter().map(|job| run(job, None)).collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    let find = |trials: &[Trial], name: &str, port: &str| {
        trials.iter().position(|t| t.effect.as_ref().is_some_and(|(e, p)| e == name && p == port))
    };
    let base_of = |name: &str| library.get(name).ok().and_then(|e| e.extends.clone());
    let richer: Vec<Trial> = second
        .par_iter()
        .map(|job| {
            let base = base_of(&job.0).and_then(|b| find(&trials, &b, &job.1.port));
            run(job, base.map(|b| &trials[b]))
        })
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    for rich in richer {
        let Some((name, port)) = rich.effect.clone() else { continue };
        let simple = base_of(&name).and_then(|b| find(&trials, &b, &port));
        if let Some(b) = simple.filter(|&b| rich.fit.cost < trials[b].fit.cost)
            && let Some(better) = again(bench, &trials[b], &rich)?
        {
            trials[b] = better;
        }
        trials.push(rich);
    }
    Ok(trials)
}

/// Fits one effect at one port.
fn one(
    bench: &Bench<'_>,
    name: &str,
    guess: &PortGuess,
    nominal: &Trial,
    simpler: Option<&Trial>,
) -> Result<Option<Trial>> {
    let model = bench.model.attach(name, &guess.port, &[])?;
    let system = model.compile();
    let mut priors = priors(&model, &system, Some(&guess.scales))?;
    let effect = model.library().get(name)?.clone();
    let law = LawFunction::new(model.library(), name)?;
    let n_nominal = nominal.fit.point.theta.len();
    let shapes: Vec<Vec<f64>> = effect.parameters.values().map(|p| p.shape.clone()).collect();
    let mut grid: Vec<Vec<f64>> = vec![Vec::new()];
    for (k, (parameter, shape)) in effect.parameters.iter().zip(&shapes).enumerate() {
        let scale = priors[n_nominal + k].scale;
        let inherited = simpler.and_then(|s| s.effect_parameters().get(parameter.0).copied());
        grid = grid
            .into_iter()
            .flat_map(|so_far| {
                let values: Vec<f64> = if !shape.is_empty() {
                    shape.iter().map(|s| s * scale).collect()
                } else if let Some(v) = inherited {
                    vec![v]
                } else if parameter.1.start.is_some() {
                    vec![1.5 * so_far.first().copied().unwrap_or(scale)]
                } else {
                    vec![f64::NAN] // an amplitude, set from the missing force below
                };
                values.into_iter().map(move |v| [so_far.clone(), vec![v]].concat())
            })
            .collect();
    }
    for (k, parameter) in effect.parameters.values().enumerate() {
        if !parameter.shape.is_empty() {
            // A width or speed far outside the motion has no effect: keep it where the recordings can see it.
            let scale = priors[n_nominal + k].scale;
            priors[n_nominal + k].bounds = (1e-4 * scale, 2.0 * scale);
        }
    }
    let amplitudes = |p: &[f64]| -> Vec<f64> {
        let mut own: Vec<f64> = p.iter().map(|v| if v.is_nan() { 0.0 } else { *v }).collect();
        for k in 0..own.len() {
            if !p[k].is_nan() {
                continue;
            }
            let prior = priors[n_nominal + k];
            let a = law.as_ref().map_or(0.0, |l| l.amplitude(&guess.stated, &own, k));
            let allowed = a >= prior.bounds.0 && a <= prior.bounds.1 && a.abs() > 0.05 * prior.scale;
            own[k] = if allowed { a } else { 0.2 * prior.scale };
        }
        own
    };
    let mut starts = Vec::new();
    for p in &grid {
        let own = amplitudes(p);
        let join = |theta: &[f64]| [theta, &own].concat();
        if let Some(s) = simpler {
            starts.push(Point { theta: join(&s.fit.point.theta[..n_nominal]), x0: s.fit.point.x0.clone() });
            continue;
        }
        let stated: Vec<f64> = nominal.priors.iter().map(|p| p.mean).collect();
        starts.push(Point { theta: join(&stated), x0: bench.train_start.to_vec() });
        starts.push(Point { theta: join(&nominal.fit.point.theta), x0: nominal.fit.point.x0.clone() });
    }
    // What nominal parameters can do as well needs no search: one rough fit shows its row in the table. The question is
    // asked where the effect is still absent: later the scale of all forces together could imitate it.
    let absent = |k: usize| effect.parameters.get_index(k).is_some_and(|(_, p)| p.shape.is_empty());
    let zero: Vec<f64> =
        (0..effect.parameters.len()).map(|k| if absent(k) { 0.0 } else { priors[n_nominal + k].scale }).collect();
    let without =
        Point { theta: [nominal.fit.point.theta.as_slice(), &zero].concat(), x0: nominal.fit.point.x0.clone() };
    let subject = Subject { system: &system, priors: &priors, moves: true };
    let hopeless = effect.extends.is_none()
        && distinct(&subject, bench.train, &without)
            .is_some_and(|d| (0..zero.len()).filter(|k| absent(*k)).all(|k| d[n_nominal + k] < IMITATED));
    if hopeless {
        starts.drain(..starts.len() - 1);
    }
    let ties = if hopeless || simpler.is_some() { &[] } else { bench.train_ties };
    let label = Some((name.to_string(), guess.port.clone()));
    let found = trial(bench, label, model, system, priors, &starts, ties)?;
    Ok(found.map(|t| Trial { imitated: hopeless, ..t }))
}

/// The simpler member of a family once more, from where the richer one ended.
fn again(bench: &Bench<'_>, simple: &Trial, rich: &Trial) -> Result<Option<Trial>> {
    let infos = rich.model.parameters();
    let values: IndexMap<&str, f64> =
        rich.system.free().iter().zip(&rich.fit.point.theta).map(|(&i, v)| (short(&infos[i].name), *v)).collect();
    let names = simple.system.free().iter().map(|&i| short(&simple.model.parameters()[i].name));
    let theta: Vec<f64> =
        names.zip(&simple.fit.point.theta).map(|(n, old)| values.get(n).copied().unwrap_or(*old)).collect();
    let start = Point { theta, x0: rich.fit.point.x0.clone() };
    let model = simple.model.clone();
    let system = model.compile();
    let priors = simple.priors.clone();
    let new = trial(bench, simple.effect.clone(), model, system, priors, &[start], &[])?;
    Ok(new.filter(|n| n.fit.cost < simple.fit.cost))
}
