//! From fits to the noun: tables, the augmented model, traces and the sentence.

use indexmap::IndexMap;

use super::experiment::{Experiment, Run};
use super::fit::{Ground, full};
use super::forward::{Explained, Round};
use super::law::LawFunction;
use super::result::{Absorbed, Candidate, Estimate, FitReport, FitRow, Law, NamedEffect, ParameterReport, RecordTrace};
use super::runner::{Aside, Why};
use super::trial::Trial;
use crate::error::Result;
use crate::model::{Model, System};
use crate::numeric::stats;

/// Least share of a stated uncertainty that recordings are held to resolve.
const LEARNED: f64 = 0.5;

/// Standard deviations by which a parameter must move to count as having soaked something up.
const SOAKED: f64 = 3.0;

/// Parameters and initial states with which a system runs along train and held-out records.
pub struct Point<'a> {
    /// System.
    pub system: &'a crate::model::Compiled,
    /// All parameters.
    pub p: Vec<f64>,
    /// Initial states of the train records.
    pub train: &'a [Vec<f64>],
    /// Initial states of the held-out records.
    pub test: &'a [Vec<f64>],
}

/// Outputs of every record at a point; empty where a run fails.
fn outputs(point: &Point<'_>, train: Ground<'_>, test: Ground<'_>) -> Vec<Vec<f64>> {
    let all = |ground: Ground<'_>, x0: &[Vec<f64>]| -> Vec<Vec<f64>> {
        let one = |(e, x0): (&Experiment, &Vec<f64>)| {
            let Ground { substeps, control, .. } = ground;
            let run = Run { system: point.system, p: &point.p, x0, experiment: e, substeps, observer: None, control };
            run.outputs().unwrap_or_default()
        };
        ground.experiments.iter().zip(x0).map(one).collect()
    };
    let mut out = all(train, point.train);
    out.extend(all(test, point.test));
    out
}

/// Traces and error table of all records: as stated, refitted, and with the effect where one was named.
pub fn fits(model: &Model, train: Ground<'_>, test: Ground<'_>, points: &[Point<'_>]) -> (Vec<RecordTrace>, FitReport) {
    let runs: Vec<Vec<Vec<f64>>> = points.iter().map(|p| outputs(p, train, test)).collect();
    let mut traces = Vec::new();
    let mut report = FitReport::default();
    let names: Vec<String> = model.outputs().into_iter().map(String::from).collect();
    let ny = names.len();
    for (r, e) in train.experiments.iter().chain(test.experiments).enumerate() {
        let is_test = r >= train.experiments.len();
        let get = |which: usize| runs.get(which).map_or(Vec::new(), |all| all[r].clone());
        for (j, output) in names.iter().enumerate() {
            let spread = stats::std(e.output(j));
            if !spread.is_finite() {
                continue;
            }
            let spread = spread.max(f64::MIN_POSITIVE);
            let rms = |which: usize| -> Option<f64> {
                let y = get(which.min(points.len() - 1));
                let errors = y.iter().skip(j).step_by(ny).zip(e.output(j)).map(|(y, m)| y - m);
                let v = stats::rms(errors);
                (!y.is_empty() && v.is_finite()).then_some(v)
            };
            let row = FitRow {
                record: e.name.clone(),
                output: output.clone(),
                unit: model.unit(output).unwrap_or("1").to_string(),
                nominal: rms(0).map(|v| v / spread),
                before: rms(1).map(|v| v / spread),
                after: rms(2).map(|v| v / spread),
                floor: train.sigma[j] / spread,
                rms_before: rms(1),
                rms_after: rms(2),
            };
            if is_test { report.test.push(row) } else { report.train.push(row) }
        }
        traces.push(RecordTrace {
            name: e.name.clone(),
            test: is_test,
            t: (0..e.len()).map(|k| e.t0 + k as f64 * e.dt).collect(),
            output_names: names.clone(),
            measured: e.y.clone(),
            nominal: get(0),
            before: get(1),
            after: get(2),
        });
    }
    (traces, report)
}

/// The rankings of all rounds in public form, the first round first.
pub fn candidates(e: &Explained) -> Vec<Candidate> {
    let mut base = &e.nominal;
    let mut out = Vec::new();
    for round in &e.rounds {
        out.extend(ranked(base, round));
        if let Some(i) = round.accepted {
            base = &round.trials[i];
        }
    }
    out
}

fn ranked(base: &Trial, round: &Round) -> Vec<Candidate> {
    let with: Vec<String> = round.onto.iter().map(|(e, at)| format!("{e}@{at}")).collect();
    let own_deviance = base.residuals.deviance(&base.residuals.test);
    let newest = |t: &Trial| t.made.effects.last().filter(|_| t.made.effects.len() > with.len()).cloned();
    let public = |t: &Trial, score: Option<f64>| {
        let (name, at) = newest(t).unwrap_or(("nothing".into(), String::new()));
        // Two at once: the other one stands among those that it is added to.
        let added = t.made.effects.len().saturating_sub(1);
        Candidate {
            name,
            at,
            with: t.made.effects[..added].iter().map(|(e, at)| format!("{e}@{at}")).collect(),
            score,
            held_out: t.residuals.complete().then(|| t.residuals.deviance(&t.residuals.test) - own_deviance),
            converged: t.fit.converged,
            parameters: if newest(t).is_some() { t.effect_parameters(added) } else { IndexMap::new() },
            note: match (t.residuals.complete(), &t.doubt) {
                (false, _) => Some("could not be simulated along every record".into()),
                (true, doubt) => doubt.as_ref().map(|d| format!("not named: {}", d.words())),
            },
        }
    };
    let order = round.ranking.relative(round.accepted);
    let mut out: Vec<Candidate> =
        order.into_iter().map(|(i, score)| public(i.map_or(base, |i| &round.trials[i]), Some(score))).collect();
    let listed = |i: usize| round.ranking.order.iter().any(|(o, _)| *o == Some(i));
    out.extend(round.trials.iter().enumerate().filter(|(i, _)| !listed(*i)).map(|(_, t)| public(t, None)));
    let best = round.trials.iter().map(|t| t.fit.cost).fold(f64::INFINITY, f64::min);
    let mut aside: Vec<&Aside> = round.aside.iter().collect();
    aside.sort_by(|a, b| a.cost.unwrap_or(f64::INFINITY).total_cmp(&b.cost.unwrap_or(f64::INFINITY)));
    out.extend(aside.into_iter().map(|a| Candidate {
        name: a.effect.0.clone(),
        at: a.effect.1.clone(),
        with: with.clone(),
        score: None,
        held_out: None,
        converged: false,
        parameters: a.parameters.clone(),
        note: Some(match (a.why, a.cost) {
            (Why::Imitated, _) if with.is_empty() => {
                "the nominal parameters can do the same: it cannot be told from them".into()
            }
            (Why::Imitated, _) => "what is fitted already can do the same: it cannot be told from it".into(),
            (Why::Behind, Some(c)) => format!(
                "set aside unfinished: its sum of squares stood {} above the best of those that were fitted to the end",
                super::words::number(c - best)
            ),
            (Why::RuledOut, _) => "what was found before leaves it nothing to act on".into(),
            _ => "it changes nothing along these recordings, or could not be simulated along them".into(),
        }),
    }));
    out
}

/// Nominal parameters that moved when the effects were named, the most first.
pub fn absorbed(nominal: &Trial, after: &Trial, parameters: &IndexMap<String, ParameterReport>) -> Vec<Absorbed> {
    if after.made.effects.is_empty() {
        return Vec::new();
    }
    let infos = nominal.made.model.parameters();
    let mut out: Vec<Absorbed> = parameters
        .iter()
        .filter_map(|(name, p)| {
            let sigmas = (p.before - p.after).abs() / p.sd.max(f64::MIN_POSITIVE);
            let info = infos.iter().find(|i| i.name == *name)?;
            let (low, high) = info.bounds;
            let forbidden = if p.before <= low {
                Some(format!("it was pressed against its least possible value {}", super::words::number(low)))
            } else if p.before >= high {
                Some(format!("it was pressed against its largest possible value {}", super::words::number(high)))
            } else if p.before * p.nominal < 0.0 {
                Some("its sign turned".into())
            } else {
                None
            };
            (sigmas > SOAKED || forbidden.is_some()).then(|| Absorbed {
                parameter: name.clone(),
                before: p.before,
                after: p.after,
                sigmas,
                unit: p.unit.clone(),
                forbidden,
            })
        })
        .collect();
    out.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    out
}

/// Nominal parameters: stated, absorbed, and with the effect.
pub fn parameters(nominal: &Trial, after: &Trial) -> IndexMap<String, ParameterReport> {
    let sd = after.sds();
    nominal
        .made
        .system
        .free()
        .iter()
        .enumerate()
        .filter(|(k, _)| *k < nominal.made.priors.len())
        .map(|(k, &i)| {
            let info = &nominal.made.model.parameters()[i];
            let (stated, value) = (info.sd.unwrap_or(f64::NAN), after.fit.point.theta[k]);
            // What is stated takes part in the fit: where it is right, the fit stays within what the recordings add to it.
            let learned = (stated.powi(2) - sd[k].powi(2)).max(0.0).sqrt().max(LEARNED * stated);
            let report = ParameterReport {
                nominal: info.value,
                nominal_sd: stated,
                before: nominal.fit.point.theta[k],
                after: value,
                sd: sd[k],
                away: (value - info.value).abs() / learned,
                unit: info.unit.clone().unwrap_or_else(|| "1".into()),
            };
            (info.name.clone(), report)
        })
        .collect()
}

/// The named effects with intervals.
pub fn effects(trial: &Trial, shares: &[f64]) -> Vec<NamedEffect> {
    let sd = trial.sds();
    let infos = trial.made.model.parameters();
    let estimate = |k: usize| {
        let unit = infos[trial.made.system.free()[k]].unit.clone().unwrap_or_else(|| "1".into());
        let sd = (sd[k].is_finite() && sd[k] > 0.0).then_some(sd[k]);
        Estimate { value: trial.fit.point.theta[k], sd, unit }
    };
    trial
        .made
        .effects
        .iter()
        .enumerate()
        .map(|(n, (name, at))| NamedEffect {
            name: name.clone(),
            at: at.clone(),
            parameters: trial.own(n).into_iter().map(|(k, own)| (own, estimate(k))).collect(),
            share: shares.get(n).copied().unwrap_or(0.0),
        })
        .collect()
}

/// The model with fitted values, and their uncertainties as the new stated ones.
///
/// # Errors
/// None that a fitted model could cause.
pub fn augmented(trial: &Trial) -> Result<Model> {
    let infos = trial.made.model.parameters();
    let sd = trial.sds();
    let p = full(&trial.made.system, &trial.fit.point.theta);
    let values: Vec<(&str, f64, Option<f64>)> = trial
        .made
        .system
        .free()
        .iter()
        .enumerate()
        .map(|(k, &i)| (infos[i].name.as_str(), p[i], (sd[k].is_finite() && sd[k] > 0.0).then_some(sd[k])))
        .collect();
    trial.made.model.with_parameters(&values)
}

/// The law of the first named effect at a port, with its band.
///
/// # Errors
/// As [`LawFunction::new`].
pub fn law(trial: &Trial, located: &[super::result::Force]) -> Result<Option<Law>> {
    let library = trial.made.model.library();
    for (k, (name, at)) in trial.made.effects.iter().enumerate() {
        if library.get(name)?.on != "port" || located.first().is_none_or(|f| f.at != *at) {
            continue;
        }
        let Some(function) = LawFunction::new(library, name)? else { continue };
        let sds = trial.sds();
        let (own, sd): (Vec<f64>, Vec<f64>) =
            trial.own(k).into_iter().map(|(i, _)| (trial.fit.point.theta[i], sds[i])).unzip();
        return Ok(Some(function.table(located, &own, &sd, &trial.made.model.port_units(at)?)));
    }
    Ok(None)
}
