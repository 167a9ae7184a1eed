//! Records too long to be fitted whole: thinned where the motion's band allows, then cut to their most telling stretches.
//!
//! A fit costs as much as its records are long, many hundred times over, while what they tell grows with the square root. So
//! the total length is bounded: first every m-th sample is kept, if motion and input are slow enough for that, without any
//! filter, since the model is compared at instants and a filter would have to be modelled; then each record gives the stretch
//! that moves most and one that moves about 0.4 times as much, because two amplitudes part laws that one cannot.

use super::super::experiment::Experiment;
use super::super::words::number;
use crate::error::Result;
use crate::model::{Model, System};
use crate::numeric::{spectrum, stats};
use crate::simulate::{Hold, Inputs};

/// Samples of all train records together beyond which a diagnosis takes minutes.
pub const LONGEST: usize = 50_000;
/// Samples kept per period of the fastest motion that stands above the noise.
const PER_PERIOD: f64 = 20.0;
/// Share of the power above noise that is allowed to be faster.
const FASTER: f64 = 1e-3;
/// Error of a thinned input between its samples, relative to its spread.
const FAITHFUL: f64 = 0.01;
/// Most samples dropped for one kept.
const MOST: usize = 64;
/// Samples that a band is judged from.
const JUDGED: usize = 1 << 16;
/// Amplitude of the second stretch relative to the first.
const SECOND: f64 = 0.4;

/// Train and test records of at most `limit` samples in total each, and what was done, in sentences. Records that are short
/// enough come back as they are.
///
/// # Errors
/// None that records which exist could cause.
pub fn shorten(
    model: &Model,
    train: Vec<Experiment>,
    test: Vec<Experiment>,
    limit: usize,
) -> Result<(Vec<Experiment>, Vec<Experiment>, Vec<String>)> {
    let mut said = Vec::new();
    let train = bounded(model, train, limit, &mut said)?;
    let test = bounded(model, test, limit, &mut said)?;
    Ok((train, test, said))
}

fn bounded(model: &Model, records: Vec<Experiment>, limit: usize, said: &mut Vec<String>) -> Result<Vec<Experiment>> {
    let total: usize = records.iter().map(Experiment::len).sum();
    if total <= limit {
        return Ok(records);
    }
    let needed = total.div_ceil(limit).min(MOST);
    // One factor for all: noise and its colour are judged per sample, over all records.
    let factor = records.iter().map(|e| allowed(e, needed)).min().unwrap_or(1);
    let share = limit as f64 / total as f64;
    let mut out = Vec::new();
    for e in records {
        let (n, dt) = (e.len(), e.dt);
        let thin = if factor > 1 { thinned(&e, factor)? } else { e };
        let keep = ((n as f64 * share) as usize).max(64);
        let pieces = if thin.len() > keep { stretches(model, &thin, keep) } else { vec![thin] };
        let mut words = Vec::new();
        if factor > 1 {
            words.push(format!(
                "every {factor}th sample is used ({} s instead of {} s)",
                number(dt * factor as f64),
                number(dt)
            ));
        }
        if pieces.iter().any(|p| p.len() * factor < n - factor) {
            let spans: Vec<String> = pieces
                .iter()
                .map(|p| format!("{} to {} s", number(p.t0), number(p.t0 + p.len() as f64 * p.dt)))
                .collect();
            words.push(format!("only its most telling stretches are ({})", spans.join(", ")));
        }
        let name = pieces[0].name.split(" [").next().unwrap_or_default().to_string();
        said.push(format!("recording `{name}` has {n} samples, too many to fit in bounded time: {}", words.join("; ")));
        out.extend(pieces);
    }
    Ok(out)
}

/// By how much a record may be thinned, up to a largest factor.
fn allowed(e: &Experiment, most: usize) -> usize {
    let mut factor = most;
    for j in 0..e.outputs() {
        let y: Vec<f64> = e.output(j).collect();
        let Some(run) = stats::finite_runs(y.iter().copied()).into_iter().max_by_key(std::ops::Range::len) else {
            continue;
        };
        let judged = &y[run.start..run.end.min(run.start + JUDGED)];
        let mean = stats::mean(judged.iter().copied());
        let centred: Vec<f64> = judged.iter().map(|v| v - mean).collect();
        let floor = spectrum::noise_floor(&centred).powi(2);
        let beyond: Vec<f64> =
            spectrum::periodogram(&centred).iter().map(|p| if *p > 10.0 * floor { *p } else { 0.0 }).collect();
        let total: f64 = beyond.iter().sum();
        let mut left = total;
        let top = beyond.iter().position(|p| {
            left -= p;
            left <= FASTER * total
        });
        let Some(top) = top.filter(|t| *t > 0) else { continue };
        // Line `top` of n samples has n/top samples per period.
        factor = factor.min((centred.len() as f64 / top as f64 / PER_PERIOD) as usize);
    }
    let faithful = |m: &usize| {
        (0..e.inputs.count()).all(|i| {
            let u: Vec<f64> = super::input(e, i).into_iter().take(JUDGED).collect();
            let error = (0..u.len().saturating_sub(*m)).map(|k| {
                let (at, s) = (k / m * m, (k % m) as f64 / *m as f64);
                u[k] - (1.0 - s) * u[at] - s * u[(at + m).min(u.len() - 1)]
            });
            stats::rms(error) <= FAITHFUL * stats::std(u.iter().copied())
        })
    };
    (2..=factor).rev().find(faithful).unwrap_or(1)
}

/// Every m-th sample; inputs run straight between the samples that are kept.
fn thinned(e: &Experiment, m: usize) -> Result<Experiment> {
    let ny = e.outputs();
    let columns: Vec<Vec<f64>> =
        (0..e.inputs.count()).map(|i| super::input(e, i).into_iter().step_by(m).collect()).collect();
    let dt = e.dt * m as f64;
    let mut out = e.part(0, e.len().div_ceil(m));
    out.y = e.y.chunks(ny).step_by(m).flatten().copied().collect();
    out.dt = dt;
    out.inputs = Inputs::samples(e.t0, dt, &columns, Hold::FirstOrder)?;
    Ok(out)
}

/// The most telling stretches of a record, `keep` samples together.
fn stretches(model: &Model, e: &Experiment, keep: usize) -> Vec<Experiment> {
    let name = |from: usize, to: usize| {
        let mut piece = e.part(from, to);
        let (a, b) = (piece.t0, piece.t0 + piece.len() as f64 * e.dt);
        piece.name = format!("{} [{} to {} s]", e.name, number(a), number(b));
        piece
    };
    let period = model.compile().period(&model.parameters().iter().map(|p| p.value).collect::<Vec<_>>());
    // A run starts in the starting mode: a hybrid record can only be cut where its cycle begins, or not be entered at all.
    let stride = match (model.modes().len(), period) {
        (1, _) => (keep / 8).max(1) as f64,
        (_, Some(period)) => (keep as f64 * e.dt / 8.0 / period).ceil() * period / e.dt,
        (_, None) => return vec![name(0, keep)],
    };
    let half = keep / 2;
    let starts: Vec<usize> =
        (0..).map(|k| (f64::from(k) * stride).round() as usize).take_while(|from| from + half <= e.len()).collect();
    let sizes: Vec<f64> = (0..e.outputs()).map(|j| stats::std(e.output(j))).collect();
    let motion = |&from: &usize| -> f64 {
        let spread = |j: usize| stats::std(e.output(j).skip(from).take(half)) / sizes[j];
        (0..e.outputs()).map(spread).filter(|s| s.is_finite()).map(|s| s * s).sum::<f64>().sqrt()
    };
    let motions: Vec<f64> = starts.iter().map(motion).collect();
    let Some(first) = (0..starts.len()).max_by(|a, b| motions[*a].total_cmp(&motions[*b])) else {
        return vec![name(0, keep)];
    };
    let apart = |k: &usize| starts[*k].abs_diff(starts[first]) >= half;
    let off = |k: &usize| (motions[*k] - SECOND * motions[first]).abs();
    let second = (0..starts.len()).filter(apart).min_by(|a, b| off(a).total_cmp(&off(b)));
    let mut chosen: Vec<usize> = [Some(first), second].into_iter().flatten().map(|k| starts[k]).collect();
    chosen.sort_unstable();
    chosen.into_iter().map(|from| name(from, from + half)).collect()
}
