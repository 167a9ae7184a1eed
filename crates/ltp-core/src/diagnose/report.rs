//! From fits to the noun: tables, the augmented model, traces and the sentence.

use indexmap::IndexMap;

use super::candidates::{Trial, full, short};
use super::experiment::{Experiment, Run};
use super::fit::Ground;
use super::judge::Ranking;
use super::law::LawFunction;
use super::result::{Candidate, Estimate, FitReport, FitRow, Law, NamedEffect, ParameterReport, RecordTrace};
use crate::error::Result;
use crate::model::{Model, System};
use crate::numeric::stats;

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

/// The ranking in public form.
pub fn candidates(ranking: &Ranking, winner: Option<usize>, nominal: &Trial, trials: &[Trial]) -> Vec<Candidate> {
    let base = nominal.residuals.deviance(&nominal.residuals.test);
    let public = |t: &Trial, score: Option<f64>| Candidate {
        name: t.effect.as_ref().map_or("nothing".into(), |(e, _)| e.clone()),
        at: t.effect.as_ref().map_or(String::new(), |(_, p)| p.clone()),
        score,
        held_out: t.residuals.complete().then(|| t.residuals.deviance(&t.residuals.test) - base),
        converged: t.fit.converged,
        parameters: t.effect_parameters(),
        note: if t.imitated {
            Some("the nominal parameters can do the same: it cannot be told from them".into())
        } else if !t.residuals.complete() {
            Some("could not be simulated along every record".into())
        } else {
            None
        },
    };
    let mut out: Vec<Candidate> = ranking
        .relative(winner)
        .into_iter()
        .map(|(i, score)| public(i.map_or(nominal, |i| &trials[i]), Some(score)))
        .collect();
    let ranked = |i: usize| ranking.order.iter().any(|(o, _)| *o == Some(i));
    out.extend(trials.iter().enumerate().filter(|(i, _)| !ranked(*i)).map(|(_, t)| public(t, None)));
    out
}

/// Nominal parameters: stated, absorbed, and with the effect.
pub fn parameters(nominal: &Trial, after: &Trial) -> IndexMap<String, ParameterReport> {
    let sd = after.sds();
    nominal
        .system
        .free()
        .iter()
        .enumerate()
        .filter(|(k, _)| *k < nominal.priors.len())
        .map(|(k, &i)| {
            let info = &nominal.model.parameters()[i];
            let report = ParameterReport {
                nominal: info.value,
                nominal_sd: info.sd.unwrap_or(f64::NAN),
                before: nominal.fit.point.theta[k],
                after: after.fit.point.theta[k],
                sd: sd[k],
                unit: info.unit.clone().unwrap_or_else(|| "1".into()),
            };
            (info.name.clone(), report)
        })
        .collect()
}

/// The named effect with intervals.
pub fn effect(trial: &Trial, share: f64) -> Option<NamedEffect> {
    let (name, at) = trial.effect.clone()?;
    let sd = trial.sds();
    let infos = trial.model.parameters();
    let parameters = trial
        .system
        .free()
        .iter()
        .enumerate()
        .filter(|(_, i)| infos[**i].effect.is_some())
        .map(|(k, &i)| {
            let unit = infos[i].unit.clone().unwrap_or_else(|| "1".into());
            let sd = (sd[k].is_finite() && sd[k] > 0.0).then_some(sd[k]);
            (short(&infos[i].name).to_string(), Estimate { value: trial.fit.point.theta[k], sd, unit })
        })
        .collect();
    Some(NamedEffect { name, at, parameters, share })
}

/// The model with fitted values, and their uncertainties as the new stated ones.
///
/// # Errors
/// None that a fitted model could cause.
pub fn augmented(trial: &Trial) -> Result<Model> {
    let infos = trial.model.parameters();
    let sd = trial.sds();
    let p = full(&trial.system, &trial.fit.point.theta);
    let values: Vec<(&str, f64, Option<f64>)> = trial
        .system
        .free()
        .iter()
        .enumerate()
        .map(|(k, &i)| (infos[i].name.as_str(), p[i], (sd[k].is_finite() && sd[k] > 0.0).then_some(sd[k])))
        .collect();
    trial.model.with_parameters(&values)
}

/// The law of a named effect with its band.
///
/// # Errors
/// As [`LawFunction::new`].
pub fn law(trial: &Trial, located: &[super::result::Force]) -> Result<Option<Law>> {
    let Some((name, port)) = &trial.effect else { return Ok(None) };
    let Some(function) = LawFunction::new(trial.model.library(), name)? else { return Ok(None) };
    let own: Vec<f64> = trial.effect_parameters().into_values().collect();
    let sd = trial.sds();
    let sd = &sd[sd.len() - own.len()..];
    Ok(Some(function.table(located, &own, sd, &trial.model.port_units(port)?)))
}
