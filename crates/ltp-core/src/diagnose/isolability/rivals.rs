//! Fitted explanations that recordings cannot tell apart: which further experiment would.
//!
//! For each variation one rival is taken as the truth and the other refits, linearised where it stands: what its parameters
//! and initial states leave of the difference of the two predictions, on the recordings that there are and on the variation
//! together, is the deviance that the experiment would bring. The smaller of both directions counts.

use super::super::experiment::{Control, Experiment};
use super::super::words::quantity;
use super::APART;
use super::geometry::{basis, remove};
use super::setup::{Response, respond};
use super::variation::{Start, Variation, variations, widened, with_states_measured};
use crate::error::Result;
use crate::model::{Compiled, Model, System};
use crate::numeric::stats;

/// Samples of a record beyond which it is thinned for this prediction.
const ENOUGH: usize = 1000;

/// A fitted explanation.
pub struct Rival<'a> {
    /// What it is called: `effect@place`.
    pub label: String,
    /// The model with the effect attached.
    pub model: &'a Model,
    /// All its parameters at the fit.
    pub p: Vec<f64>,
    /// Initial state of each experiment at the fit.
    pub x0: &'a [Vec<f64>],
}

/// An experiment that would separate rivals.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Suggestion {
    /// What to do, and what it would bring.
    pub sentence: String,
    /// `amplitude`, `sensor`, `slow`, `bandwidth` or `longer`.
    pub kind: String,
    /// The rivals that it separates from the first one.
    pub separates: Vec<String>,
    /// The least predicted gain in deviance over them.
    pub gain: f64,
}

/// A rival ready to run: compiled with all its states as outputs.
struct Ready {
    system: Compiled,
    p: Vec<f64>,
    stiffness: Vec<f64>,
}

/// Which variations of the experiments would separate the first rival from the others, best first; empty where none of them
/// would. `nominal` is the model that the rivals extend, `sigma` the noise of each output, `substeps` the steps per sample.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn separating(
    rivals: &[Rival<'_>],
    nominal: &Model,
    experiments: &[Experiment],
    sigma: &[f64],
    substeps: u64,
    control: &Control<'_>,
) -> Result<Vec<Suggestion>> {
    let Some((first, others)) = rivals.split_first().filter(|(_, o)| !o.is_empty()) else { return Ok(Vec::new()) };
    let states = nominal.states().len();
    let (wide, extra) = with_states_measured(nominal)?;
    let extra: Vec<String> = extra.into_iter().take(states).collect();
    let outputs = sigma.len() + extra.len();
    let starts: Vec<Start> = experiments
        .iter()
        .zip(first.x0)
        .map(|(e, x0)| Start { experiment: e.part(0, e.len().min(ENOUGH)), x0: x0[..states].to_vec() })
        .collect();
    let records = widened(&starts, outputs);
    let varied = variations(&records, nominal.document().clock.is_some())?;
    let pool: Vec<&Start> =
        records.iter().chain(varied.iter().flat_map(|v| v.added.iter().chain(&v.instead))).collect();
    let ready = |r: &Rival<'_>| -> Result<Ready> {
        // The rival's own further states stay unseen: nobody could buy a sensor for them.
        let mut document = r.model.document().clone();
        for name in &extra {
            document.outputs.insert(name.clone(), wide.document().outputs[name].clone());
        }
        let model = Model::new(document, r.model.library().clone(), r.model.name())?;
        let system = model.compile();
        let sd = |&i: &usize| model.parameters()[i].sd.map_or(0.0, |s| 1.0 / s);
        let stiffness = system.free().iter().map(sd).collect();
        Ok(Ready { system, p: r.p.clone(), stiffness })
    };
    let all: Vec<Ready> = std::iter::once(first).chain(others).map(ready).collect::<Result<_>>()?;
    let mut runs: Vec<Vec<Option<Response>>> = Vec::new();
    for (k, r) in all.iter().enumerate() {
        control.check()?;
        let along = |(i, s): (usize, &&Start)| {
            let own = rivals[k].x0.get(i).filter(|_| i < records.len());
            let start = Start { experiment: s.experiment.clone(), x0: own.unwrap_or(&s.x0).clone() };
            respond(&r.system, &r.p, &start, substeps, control)
        };
        runs.push(pool.iter().enumerate().map(along).collect());
    }
    let deviance = |j: usize, records: &[usize], sigma: &[f64]| {
        let one_way =
            |truth: usize, fitted: usize| left(&all[fitted], &runs[truth], &runs[fitted], records, sigma, outputs);
        Some(one_way(0, j)?.min(one_way(j, 0)?))
    };
    let base: Vec<usize> = (0..records.len()).collect();
    let mut known = sigma.to_vec();
    known.resize(outputs, f64::INFINITY);
    let now: Vec<f64> = (1..all.len()).map(|j| deviance(j, &base, &known).unwrap_or(0.0)).collect();
    let mut out = Vec::new();
    let mut judge = |kind: &str, sentence: String, records: &[usize], sigma: &[f64]| {
        let found = (1..all.len()).filter_map(|j| Some((j, deviance(j, records, sigma)? - now[j - 1])));
        let apart: Vec<(usize, f64)> = found.filter(|(_, gain)| *gain > APART).collect();
        if !apart.is_empty() {
            let separates: Vec<String> = apart.iter().map(|(j, _)| rivals[*j].label.clone()).collect();
            let gain = apart.iter().map(|(_, g)| *g).fold(f64::INFINITY, f64::min);
            out.push(Suggestion { sentence, kind: kind.into(), separates, gain });
        }
    };
    let mut next = records.len();
    for Variation { kind, sentence, added, instead } in &varied {
        let own: Vec<usize> = (next..next + added.len() + instead.len()).collect();
        next += own.len();
        let records = if instead.is_empty() { [base.clone(), own].concat() } else { own };
        judge(kind, sentence.clone(), &records, &known);
    }
    let quality: Vec<f64> = (0..sigma.len())
        .map(|j| sigma[j] / stats::std(experiments.iter().flat_map(|e| e.output(j))))
        .filter(|v| v.is_finite())
        .collect();
    for (k, name) in extra.iter().enumerate() {
        let j = sigma.len() + k;
        let seen = runs[0][..records.len()].iter().flatten().flat_map(|r| r.y.iter().skip(j).step_by(outputs).copied());
        let sd = stats::median(&quality) * stats::std(seen);
        if sd > 0.0 && sd.is_finite() {
            let mut sigma = known.clone();
            sigma[j] = sd;
            let noise = quantity(sd, wide.unit(name).unwrap_or("1"));
            judge("sensor", format!("a sensor for the state `{name}` (noise {noise})"), &base, &sigma);
        }
    }
    out.sort_by(|a, b| b.separates.len().cmp(&a.separates.len()).then(b.gain.total_cmp(&a.gain)));
    Ok(out)
}

/// What a fitted rival leaves of the truth's prediction after a linearised refit; `None` where a run failed.
fn left(
    fitted: &Ready,
    truth: &[Option<Response>],
    own: &[Option<Response>],
    records: &[usize],
    sigma: &[f64],
    outputs: usize,
) -> Option<f64> {
    let (nx, np) = (fitted.system.states(), fitted.stiffness.len());
    let ns = nx + np;
    let pairs: Vec<(&Response, &Response)> =
        records.iter().map(|&r| Some((truth[r].as_ref()?, own[r].as_ref()?))).collect::<Option<_>>()?;
    let stacked = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        let mut out = Vec::new();
        for (r, (_, own)) in pairs.iter().enumerate() {
            for i in 0..own.y.len() {
                let s = sigma[i % outputs];
                if s.is_finite() {
                    out.push(of(r, i) / s);
                }
            }
        }
        out
    };
    let mut columns = Vec::new();
    for (k, stiffness) in fitted.stiffness.iter().enumerate() {
        let mut c = stacked(&|r, i| pairs[r].1.d[i * ns + nx + k]);
        c.extend((0..np).map(|j| if j == k { *stiffness } else { 0.0 }));
        columns.push(c);
    }
    for record in 0..pairs.len() {
        for k in 0..nx {
            let mut c = stacked(&|r, i| if r == record { pairs[r].1.d[i * ns + k] } else { 0.0 });
            c.extend(vec![0.0; np]);
            columns.push(c);
        }
    }
    let mut difference = stacked(&|r, i| pairs[r].0.y[i] - pairs[r].1.y[i]);
    difference.extend(vec![0.0; np]);
    remove(&basis(&columns), &mut difference);
    Some(difference.iter().map(|v| v * v).sum())
}
