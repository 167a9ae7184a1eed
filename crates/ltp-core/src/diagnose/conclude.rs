//! The verdict: what the search came to, held against the noise, put into the noun.

use std::time::Instant;

use super::fit::full;
use super::forward::{self, Explained};
use super::harmonic::{self, event_times};
use super::isolability::{Rival, Suggestion, separating};
use super::locate::{self, Located};
use super::prepare::Scene;
use super::result::{self, Diagnosis, Location, ParameterReport, Verdict};
use super::trial::{Bench, Trial, starts};
use super::unknown::Unnamed;
use super::{dependence, occasions, report, words};
use crate::error::Result;
use crate::model::{Model, System};

/// Remaining error, in noise floors, that no verdict may call explained.
const FAR: f64 = 10.0;
/// Remaining error, in noise floors, beyond which nobody may say that the structure is right.
const RIGHT: f64 = 3.0;
/// Gain in log-likelihood of a missing force that is beyond doubt.
const DECISIVE: f64 = 50.0;
/// Deviation of a parameter from its stated value, in its stated uncertainty, that makes a verdict.
const MOVED: f64 = 3.0;

/// The effect that is an error of a parameter stated as exact: the structure is right.
const OFF: &str = "parameter_error";

/// Everything the conclusion draws on.
pub struct Case<'a> {
    /// The model as stated.
    pub model: &'a Model,
    /// Records with what their fits share.
    pub bench: &'a Bench<'a>,
    /// Sizes, speeds, noise.
    pub scene: &'a Scene,
    /// What the search came to.
    pub explained: Explained,
    /// A law without a name that was accepted.
    pub unnamed: Option<Unnamed>,
    /// Where a missing force explains best what the nominal model leaves.
    pub located: Option<Located>,
    /// Seed of what is random.
    pub seed: u64,
    /// Doubts so far.
    pub warnings: Vec<String>,
    /// Start of the work.
    pub clock: Instant,
}

/// Concludes.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn conclude(case: Case<'_>) -> Result<Diagnosis> {
    let Case { model, bench, explained, unnamed, located, mut warnings, .. } = case;
    let nominal = &explained.nominal;
    // A law without a name stands instead of names that explain less.
    let found = explained.found() && unnamed.as_ref().is_none_or(|u| u.beside);
    let after = if found { explained.last() } else { nominal };
    let shown = unnamed.as_ref().map_or(after, |u| &u.trial);
    let parameters = report::parameters(nominal, after);
    let stated = |p: &ParameterReport| (p.after - p.nominal).abs() / p.nominal_sd;
    let moved: Vec<(String, f64)> =
        parameters.iter().filter(|(_, p)| p.away > MOVED).map(|(n, p)| (n.clone(), stated(p))).collect();
    let near: Vec<String> = explained
        .rounds
        .iter()
        .filter(|r| found && r.accepted.is_some())
        .flat_map(|r| r.near.iter().map(|&i| alternative(&r.trials[i], r.onto.len())))
        .collect();
    let law = unnamed.as_ref().map(|u| u.law.clone());
    let (records, fit) = tables(model, bench, nominal, shown)?;
    // Far above the noise, and a force at a port would explain it: that is neither consistent nor a parameter.
    let unexplained = words::remaining(&fit) > FAR && located.as_ref().is_some_and(|l| l.gain > DECISIVE);
    let off = |(name, _): &super::trial::Attachment| name == OFF;
    let verdict = match found {
        true if near.is_empty() && after.made.effects.iter().all(off) => Verdict::Parameter,
        true if !near.is_empty() => Verdict::Ambiguous,
        true => Verdict::Effect,
        false if law.is_some() || unexplained => Verdict::Unknown,
        false if !moved.is_empty() && words::remaining(&fit) > RIGHT => Verdict::Unknown,
        false if !moved.is_empty() => Verdict::Parameter,
        false => Verdict::Consistent,
    };
    doubts(&explained, after, &fit, &mut warnings);
    let events = event_times(
        model,
        &nominal.made.system,
        &nominal.parameters(),
        bench.train.experiments,
        &nominal.fit.point.x0,
        bench.train.sigma,
        bench.train.substeps,
        &mut warnings,
    );
    let harmonic = harmonic::of_refit(clocked(bench, nominal, &nominal.parameters()), &events, &mut warnings)?;
    let harmonic_after =
        if found && harmonic.is_some() { harmonic::after(clocked(bench, after, &after.parameters()))? } else { None };

    // With effects named, their force is what the nominal equations miss when nothing else has to make up for it.
    let port = shown.made.effects.iter().map(|(_, at)| at.as_str()).find(|at| model.ports().contains(at));
    let forces = match port {
        Some(port) => {
            let p = full(&nominal.made.system, &shown.fit.point.theta[..nominal.made.priors.len()]);
            locate::missing(bench, case.scene, &p, port)?
        }
        None => located.as_ref().map_or(Vec::new(), |l| l.forces.clone()),
    };
    let named = if found { report::law(after, &forces)? } else { None };
    // A damping over position is no force over position: it is told as a table only.
    let is_force = |l: &result::Law| forces.first().is_some_and(|f| f.unit == l.unit);
    let drawn = named.or_else(|| law.clone().filter(is_force));
    let silent = matches!(verdict, Verdict::Consistent | Verdict::Parameter);
    let absorbed = report::absorbed(nominal, after, &parameters);
    let mut diagnosis = Diagnosis {
        model_name: model.name().to_string(),
        verdict,
        sentence: String::new(),
        location: if silent { Vec::new() } else { places(after, located, (port, &forces), case.seed) },
        effects: if found { report::effects(after, &explained.shares) } else { Vec::new() },
        ambiguous_with: near,
        candidates: report::candidates(&explained),
        parameters,
        absorbed,
        separate: if found { separate(bench, &explained)? } else { Vec::new() },
        events,
        harmonic,
        harmonic_after,
        fit,
        model: report::augmented(after)?.to_toml()?,
        law,
        warnings,
        seconds: 0.0,
        traces: result::Traces { records, force: forces, law: drawn },
    };
    let others: Vec<&str> = model.ports();
    if let Some(law) =
        diagnosis.law.as_ref().filter(|l| !diagnosis.location.iter().any(|p| p.kind == "port" && p.at == l.at))
    {
        diagnosis.location.push(unmeasured("port".into(), law.at.clone()));
    }
    for l in &mut diagnosis.location {
        if let Some(law) = diagnosis.law.as_ref().filter(|law| law.at == l.at && !found) {
            l.variable.clone_from(&law.variable);
        }
        l.sentence = words::place(l, &others);
    }
    if let (Some(l), Some(stands)) =
        (diagnosis.location.first_mut(), diagnosis.harmonic.as_ref().and_then(harmonic::HarmonicMap::stands))
    {
        l.sentence = format!("{}; {stands}", l.sentence);
    }
    diagnosis.sentence = words::sentence(&diagnosis, &moved);
    diagnosis.seconds = case.clock.elapsed().as_secs_f64();
    (bench.train.control.progress)("done", 1.0);
    Ok(diagnosis)
}

/// A fitted trial as a harmonic map sees it.
fn clocked<'a>(bench: &'a Bench<'a>, t: &'a Trial, p: &'a [f64]) -> harmonic::Refit<'a> {
    let made = &t.made;
    let (experiments, control) = (bench.train.experiments, bench.train.control);
    harmonic::Refit { model: &made.model, system: &made.system, p, experiments, control }
}

/// `effect@place` of what a trial added beyond the hypothesis of its round.
fn alternative(t: &Trial, onto: usize) -> String {
    super::trial::label(&t.made.effects[onto.min(t.made.effects.len())..])
}

/// Where the named effects act, or where a missing force was located. What is missing at a port where something was named is
/// held against what it may depend on, also if it was located elsewhere.
fn places(
    after: &Trial,
    located: Option<Located>,
    (port, forces): (Option<&str>, &[result::Force]),
    seed: u64,
) -> Vec<Location> {
    let found = located.map(|l| l.location);
    if after.made.effects.is_empty() {
        return found.into_iter().collect();
    }
    let library = after.made.model.library();
    after
        .made
        .effects
        .iter()
        .map(|(name, at)| {
            let kind = library.get(name).map_or_else(|_| "port".into(), |e| e.on.clone());
            match &found {
                Some(l) if l.kind == kind && l.at == *at => l.clone(),
                _ if kind == "port" && port == Some(at.as_str()) && !forces.is_empty() => {
                    let (variable, p_value) = dependence::depends_on(forces, seed);
                    let repeats = dependence::repeats(forces, &variable);
                    let (mode, phases) = (occasions::mode(forces), occasions::phases(forces));
                    Location { mode, variable, repeats, phases, p_value, ..unmeasured(kind, at.clone()) }
                }
                _ => unmeasured(kind, at.clone()),
            }
        })
        .collect()
}

/// A place at which something was named, without a measurement of what depends on what there.
fn unmeasured(kind: String, at: String) -> Location {
    let (mode, variable, phases, sentence) = (None, String::new(), Vec::new(), String::new());
    Location { kind, at, mode, variable, repeats: None, phases, p_value: 1.0, margin: 0.0, sentence }
}

/// Which experiment would tell the accepted effect from its rivals.
fn separate(bench: &Bench<'_>, e: &Explained) -> Result<Vec<result::Separating>> {
    let Some(round) = e.rounds.iter().find(|r| r.accepted.is_some() && !r.near.is_empty()) else {
        return Ok(Vec::new());
    };
    let rivals: Vec<Rival<'_>> = round
        .accepted
        .iter()
        .chain(&round.near)
        .map(|i| &round.trials[*i])
        .map(|t| Rival {
            label: alternative(t, round.onto.len()),
            model: &t.made.model,
            p: t.parameters(),
            x0: &t.fit.point.x0,
        })
        .collect();
    let train = bench.train;
    let found = separating(&rivals, bench.model, train.experiments, train.sigma, train.substeps, train.control)?;
    let public = |s: Suggestion| result::Separating {
        sentence: s.sentence,
        kind: s.kind.to_string(),
        separates: s.separates,
        gain: s.gain,
    };
    Ok(found.into_iter().map(public).collect())
}

/// Traces and errors of all records: as stated, refitted, and with what was named.
fn tables(
    model: &Model,
    bench: &Bench<'_>,
    nominal: &Trial,
    last: &Trial,
) -> Result<(Vec<result::RecordTrace>, result::FitReport)> {
    let stated: Vec<f64> = nominal.made.priors.iter().map(|p| p.mean).collect();
    let p = full(&nominal.made.system, &stated);
    let begin = |ground, start, ties| starts(model, &[], &p, ground, start, ties, None);
    let stated_train = begin(bench.train, bench.train_start, &bench.train_ties[1]);
    let stated_test = begin(bench.test, bench.test_start, bench.test_ties);
    let point = |t: &'_ Trial| t.parameters();
    let mut points = vec![
        report::Point { system: &nominal.made.system, p: p.clone(), train: &stated_train, test: &stated_test },
        report::Point {
            system: &nominal.made.system,
            p: point(nominal),
            train: &nominal.fit.point.x0,
            test: &nominal.test_x0,
        },
    ];
    if !last.made.effects.is_empty() {
        let (train, test) = (&last.fit.point.x0, &last.test_x0);
        points.push(report::Point { system: &last.made.system, p: point(last), train, test });
    }
    bench.train.control.check()?;
    Ok(report::fits(model, bench.train, bench.test, &points))
}

/// Doubts that a reader must know of.
fn doubts(e: &Explained, after: &Trial, fit: &result::FitReport, warnings: &mut Vec<String>) {
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
    let free = after.made.system.free();
    for ((&i, v), prior) in free.iter().zip(&after.fit.point.theta).zip(&after.made.priors) {
        if *v <= prior.bounds.0 || *v >= prior.bounds.1 {
            let name = &after.made.model.parameters()[i].name;
            warnings.push(format!(
                "parameter `{name}` ended on its bound {}: widen it or doubt the model",
                words::number(*v)
            ));
        }
    }
    let lost: Vec<String> = e
        .rounds
        .iter()
        .flat_map(|r| r.trials.iter().filter(|t| !t.fit.converged))
        .map(|t| forward::spoken(&t.made.effects))
        .collect();
    if !lost.is_empty() {
        warnings.push(format!("not converged, so that its rank may be too low: {}", lost.join(", ")));
    }
}
