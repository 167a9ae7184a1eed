//! From a model and recordings to a [`Diagnosis`]: locate the mismatch, name the physics that was left out, model it,
//! show that the held-out error falls — or say that it cannot be told.
//!
//! Read in order: `experiment` (a recording in the model's terms), `kalman`, `prepare` and `prepared` (sizes, noise, starts, observers), `fit`
//! (the homotopy from prediction error to simulation error), `locate` (which port, which variable), `law`, `candidates`
//! (every effect at every port), `score`, `judge` (ranking and acceptance), `report`, `words`, [`result`] (the noun).

mod candidates;
mod experiment;
mod fit;
pub mod isolability;
mod judge;
mod kalman;
mod law;
mod locate;
mod prepare;
mod prepared;
pub mod quality;
mod report;
pub mod result;
mod score;
mod unknown;
mod words;

use std::time::Instant;

pub use experiment::{Control, Experiment};
pub use result::{Diagnosis, Verdict};

use crate::error::{Error, Result, nearest};
use crate::model::{Model, System};
use crate::signal::Recording;
use crate::simulate::Hold;
use candidates::{Bench, Trial};
use locate::Located;
use prepare::Scene;
use prepared::Prepared;

/// Choices of a diagnosis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Effects to try; the whole library where `None`.
    pub candidates: Option<Vec<String>>,
    /// How inputs run between samples.
    pub hold: Hold,
    /// Seed of the permutation test.
    pub seed: u64,
    /// Threads; one per core where zero. The result has the same bits whatever the number.
    pub threads: usize,
}

/// Share of each train record that is held out where no test record is given.
const HELD_OUT: f64 = 1.0 / 3.0;
/// Remaining error, in noise floors, that no verdict may call explained.
const FAR: f64 = 10.0;
/// Gain in log-likelihood of a missing force that is beyond doubt.
const DECISIVE: f64 = 50.0;
/// Deviation of a parameter from its stated value, in its stated uncertainty, that makes a verdict.
const MOVED: f64 = 3.0;

/// Compares a model with recordings.
///
/// # Errors
/// Input errors of recordings that do not fit the model, [`Error::NoConvergence`] when the nominal model cannot be
/// simulated along them, [`Error::Interrupted`].
pub fn diagnose(
    model: &Model,
    train: &[Recording],
    test: &[Recording],
    options: &Options,
    control: &Control<'_>,
) -> Result<Diagnosis> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    match pool {
        Ok(pool) => pool.install(|| work(model, train, test, options, control)),
        Err(_) => work(model, train, test, options, control),
    }
}

fn work(
    model: &Model,
    train: &[Recording],
    test: &[Recording],
    options: &Options,
    control: &Control<'_>,
) -> Result<Diagnosis> {
    let clock = Instant::now();
    let mut warnings: Vec<String> = Vec::new();
    for r in train.iter().chain(test) {
        warnings.extend(r.warnings().iter().cloned());
    }
    let names = effect_names(model, options)?;
    (control.progress)("reading the recordings", 0.0);
    let own_test = !test.is_empty();
    let (train, test) = split(model, train, test, options.hold, &mut warnings)?;
    warnings.extend(quality::check(model, &train, &test)?);
    let (mut train, mut test, shortened) = quality::shorten(model, train, test, quality::LONGEST)?;
    warnings.extend(shortened);
    quality::clipped_to_gaps(&mut train);
    quality::clipped_to_gaps(&mut test);

    (control.progress)("following the recordings", 0.05);
    let prepared = Prepared::new(model, train, test, control, &mut warnings)?;
    (control.progress)("refitting the nominal parameters", 0.1);
    let (sigma, nominal) = prepared.nominal(model, control)?;
    let bench = prepared.bench(model, &sigma, control);
    (control.progress)("locating the mismatch", 0.15);
    let scene = Scene { sigma: sigma.clone(), ..prepared.scene.clone() };
    let (guesses, located) = locate::everywhere(&bench, &scene, &nominal, options.seed, &mut warnings)?;
    let trials = candidates::all(&bench, &names, &guesses, &nominal)?;
    (control.progress)("weighing the evidence", 0.85);
    let ranking = judge::rank(&nominal, &trials);
    let winner = ranking.winner(&trials);
    // A record of its own that was predicted is the best witness; a piece cut from the train records is not one.
    let halves = if own_test { None } else { Some(prepared.halves(model, control)?) };
    let evidence = match winner {
        Some(w) => Some(judge::weigh(&bench, &nominal, &trials[w], halves.as_ref(), names.len() * guesses.len())?),
        None => None,
    };
    let accepted = winner.filter(|_| evidence.is_some_and(|e| e.accepted()));
    if let (Some(w), Some(e), None) = (winner, evidence, accepted) {
        warnings.extend(e.refusal(&trials[w].label()));
    }
    conclude(Case {
        model,
        bench: &bench,
        scene: &scene,
        nominal: &nominal,
        trials: &trials,
        ranking: &ranking,
        accepted,
        evidence,
        located,
        warnings,
        clock,
    })
}

/// Everything the conclusion draws on.
struct Case<'a> {
    model: &'a Model,
    bench: &'a Bench<'a>,
    scene: &'a Scene,
    nominal: &'a Trial,
    trials: &'a [Trial],
    ranking: &'a judge::Ranking,
    accepted: Option<usize>,
    evidence: Option<judge::Evidence>,
    located: Option<Located>,
    warnings: Vec<String>,
    clock: Instant,
}

fn conclude(case: Case<'_>) -> Result<Diagnosis> {
    let Case { model, bench, nominal, trials, ranking, accepted, evidence, mut warnings, .. } = case;
    let after = accepted.map_or(nominal, |i| &trials[i]);
    let near = accepted.map_or(Vec::new(), |w| ranking.ambiguous(trials, w));
    let parameters = report::parameters(nominal, after);
    let away = |p: &result::ParameterReport| (p.after - p.nominal).abs() / p.nominal_sd.hypot(p.sd);
    let moved: Vec<(String, f64)> =
        parameters.iter().map(|(n, p)| (n.clone(), away(p))).filter(|(_, s)| *s > MOVED).collect();
    let unknown = match (&case.located, accepted) {
        (Some(l), None) => unknown::law(l, nominal),
        _ => None,
    };

    let stated_theta: Vec<f64> = nominal.priors.iter().map(|p| p.mean).collect();
    let subject = fit::Subject { system: &nominal.system, priors: &nominal.priors, moves: false };
    let stated_train =
        candidates::starts(&subject, bench.train, &stated_theta, bench.train_start, &bench.train_ties[1]);
    let stated_test = candidates::predict(bench, &nominal.system, &nominal.priors, &stated_theta);
    let point = |t: &'_ Trial| t.parameters();
    let mut points = vec![
        report::Point {
            system: &nominal.system,
            p: candidates::full(&nominal.system, &stated_theta),
            train: &stated_train,
            test: &stated_test,
        },
        report::Point {
            system: &nominal.system,
            p: point(nominal),
            train: &nominal.fit.point.x0,
            test: &nominal.test_x0,
        },
    ];
    if let Some(w) = accepted {
        let t = &trials[w];
        points.push(report::Point { system: &t.system, p: point(t), train: &t.fit.point.x0, test: &t.test_x0 });
    }
    let (records, fit) = report::fits(model, bench.train, bench.test, &points);
    // Far above the noise, and a force at a port would explain it: that is neither consistent nor a parameter.
    let unexplained = words::remaining(&fit) > FAR && case.located.as_ref().is_some_and(|l| l.gain > DECISIVE);
    let verdict = match accepted {
        Some(_) if !near.is_empty() => Verdict::Ambiguous,
        Some(_) => Verdict::Effect,
        None if unknown.is_some() || unexplained => Verdict::Unknown,
        None if !moved.is_empty() => Verdict::Parameter,
        None => Verdict::Consistent,
    };
    doubts(after, trials, &fit, &mut warnings);

    let forces = match accepted.and_then(|w| Some((&trials[w], trials[w].effect.as_ref()?))) {
        // With the effect named, its force is what the nominal equations miss when nothing else has to make up for it.
        Some((t, (_, port))) => {
            let p = candidates::full(&nominal.system, &t.fit.point.theta[..nominal.priors.len()]);
            locate::missing(bench, case.scene, &p, port)?
        }
        None => case.located.as_ref().map_or(Vec::new(), |l| l.forces.clone()),
    };
    let law = match accepted {
        Some(w) => report::law(&trials[w], &forces)?,
        None => unknown.clone(),
    };
    let share = evidence.map_or(0.0, |e| e.share);
    let silent = matches!(verdict, Verdict::Consistent | Verdict::Parameter);
    let mut diagnosis = Diagnosis {
        model_name: model.name().to_string(),
        verdict,
        sentence: String::new(),
        location: case.located.map(|l| l.location).filter(|_| !silent),
        effects: accepted.and_then(|w| report::effect(&trials[w], share)).into_iter().collect(),
        ambiguous_with: near.iter().map(|&i| trials[i].label()).collect(),
        candidates: report::candidates(ranking, accepted, nominal, trials),
        parameters,
        fit,
        model: report::augmented(after)?.to_toml()?,
        law: unknown,
        warnings,
        seconds: 0.0,
        traces: result::Traces { records, force: forces, law },
    };
    diagnosis.sentence = words::sentence(&diagnosis, &moved);
    diagnosis.seconds = case.clock.elapsed().as_secs_f64();
    (bench.train.control.progress)("done", 1.0);
    Ok(diagnosis)
}

/// Doubts that a reader must know of.
fn doubts(after: &Trial, trials: &[Trial], fit: &result::FitReport, warnings: &mut Vec<String>) {
    for row in &fit.train {
        let left = row.after.unwrap_or(0.0) / row.floor.max(f64::MIN_POSITIVE);
        if left > words::DOUBTFUL {
            warnings.push(format!(
                "{} of `{}`: the remaining error is {} times the noise floor; something smaller is still unexplained, and \
                 intervals are widened accordingly",
                row.output,
                row.record,
                words::number(left)
            ));
        }
    }
    let free = after.system.free();
    for ((&i, v), prior) in free.iter().zip(&after.fit.point.theta).zip(&after.priors) {
        if *v <= prior.bounds.0 || *v >= prior.bounds.1 {
            let name = &after.model.parameters()[i].name;
            warnings.push(format!(
                "parameter `{name}` ended on its bound {}: widen it or doubt the model",
                words::number(*v)
            ));
        }
    }
    let lost: Vec<String> = trials.iter().filter(|t| !t.fit.converged && !t.imitated).map(Trial::label).collect();
    if !lost.is_empty() {
        warnings.push(format!("not converged, so that its rank may be too low: {}", lost.join(", ")));
    }
}

fn effect_names(model: &Model, options: &Options) -> Result<Vec<String>> {
    let all = prepare::candidates(model.library());
    let Some(chosen) = &options.candidates else { return Ok(all) };
    for name in chosen {
        if !all.contains(name) {
            return Err(Error::UnknownName {
                kind: "effect".into(),
                name: name.clone(),
                nearest: nearest(name, &all),
                context: "candidates".into(),
            });
        }
    }
    Ok(chosen.clone())
}

/// Recordings in the model's terms; without test records the end of every train record is held out.
fn split(
    model: &Model,
    train: &[Recording],
    test: &[Recording],
    hold: Hold,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Experiment>, Vec<Experiment>)> {
    if train.is_empty() {
        return Err(Error::TooShort { what: "train recordings".into(), needed: 1, found: 0 });
    }
    let read = |r: &Recording| Experiment::new(model, r, hold);
    let all: Vec<Experiment> = train.iter().map(read).collect::<Result<_>>()?;
    if !test.is_empty() {
        return Ok((all, test.iter().map(read).collect::<Result<_>>()?));
    }
    let mut parts = (Vec::new(), Vec::new());
    for e in all {
        let cut = ((1.0 - HELD_OUT) * e.len() as f64) as usize;
        let mut held = e.part(cut, e.len());
        held.name = format!("{} (held out)", e.name);
        parts.0.push(e.part(0, cut));
        parts.1.push(held);
    }
    warnings.push("no test recording was given: the last third of every recording is held out instead".into());
    Ok(parts)
}
