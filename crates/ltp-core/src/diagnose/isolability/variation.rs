//! Variations of a set-up: what an experimenter could do besides, or instead.

use super::super::experiment::Experiment;
use super::super::quality::input;
use super::super::words::number;
use crate::error::Result;
use crate::model::Model;
use crate::model::document::Definition;
use crate::numeric::stats;
use crate::simulate::{Hold, Inputs};

/// A record with the state it starts from.
#[derive(Clone, Debug)]
pub struct Start {
    /// The record, measured or planned.
    pub experiment: Experiment,
    /// Initial state.
    pub x0: Vec<f64>,
}

/// One variation of a set-up.
pub struct Variation {
    /// `amplitude`, `slow`, `bandwidth` or `longer`.
    pub kind: &'static str,
    /// What to do.
    pub sentence: String,
    /// Records in addition.
    pub added: Vec<Start>,
    /// Records instead of those there are; as they are where empty.
    pub instead: Vec<Start>,
}

/// What can be varied without another sensor.
///
/// # Errors
/// None that records which exist could cause.
pub fn variations(records: &[Start], clocked: bool) -> Result<Vec<Variation>> {
    let moves = |s: &Start| -> f64 {
        (0..s.experiment.inputs.count()).map(|i| stats::std(input(&s.experiment, i))).fold(0.0, f64::max)
    };
    let mut out = Vec::new();
    let Some(strongest) = records.iter().max_by(|a, b| moves(a).total_cmp(&moves(b))) else { return Ok(out) };
    let mut add = |kind, sentence: String, added: Vec<Start>, instead: Vec<Start>| {
        out.push(Variation { kind, sentence, added, instead });
    };
    let e = &strongest.experiment;
    let n = e.len();
    if moves(strongest) > 0.0 {
        for (factor, words) in [(2.0, "twice"), (0.5, "half")] {
            let scaled = with_inputs(strongest, e.dt, n, |u, mean, k| mean + factor * (u[k] - mean))?;
            add("amplitude", format!("a further record with {words} the input amplitude"), vec![scaled], vec![]);
        }
        let slow = with_inputs(strongest, e.dt, n, |u, _, k| 0.5 * (u[k / 2] + u[k.div_ceil(2)]))?;
        add("slow", "a further record with the same input at half the speed".into(), vec![slow], vec![]);
        let fast = with_inputs(strongest, e.dt, n, |u, _, k| u[(2 * k) % n])?;
        add("bandwidth", "a further record with the same input at twice the speed".into(), vec![fast], vec![]);
    } else if !clocked && strongest.x0.iter().any(|x| *x != 0.0) {
        for (factor, words) in [(2.0, "twice"), (0.5, "half")] {
            let x0 = strongest.x0.iter().map(|x| factor * x).collect();
            let scaled = Start { x0, ..strongest.clone() };
            add("amplitude", format!("a further record released from {words} the initial state"), vec![scaled], vec![]);
        }
    }
    let all = |change: &dyn Fn(&Start) -> Result<Start>| records.iter().map(change).collect::<Result<Vec<_>>>();
    let finer = all(&|s| {
        let n = s.experiment.len();
        with_inputs(s, 0.5 * s.experiment.dt, 2 * n - 1, |u, _, k| 0.5 * (u[k / 2] + u[k.div_ceil(2)]))
    })?;
    add("bandwidth", format!("sampling every {} s instead of {} s", number(0.5 * e.dt), number(e.dt)), vec![], finer);
    let longer = all(&|s| {
        let n = s.experiment.len();
        with_inputs(s, s.experiment.dt, 2 * n, |u, _, k| u[k % n])
    })?;
    add("longer", "records twice as long, the input repeated".into(), vec![], longer);
    Ok(out)
}

/// A planned record with inputs from those of another: `value(samples, their mean, row)`.
fn with_inputs(s: &Start, dt: f64, n: usize, value: impl Fn(&[f64], f64, usize) -> f64) -> Result<Start> {
    let e = &s.experiment;
    let columns: Vec<Vec<f64>> = (0..e.inputs.count())
        .map(|i| {
            let u = input(e, i);
            let mean = stats::mean(u.iter().copied());
            (0..n).map(|k| value(&u, mean, k)).collect()
        })
        .collect();
    let hold = if e.inputs.jumps() { Hold::ZeroOrder } else { Hold::FirstOrder };
    let inputs = Inputs::samples(e.t0, dt, &columns, hold)?;
    Ok(Start { experiment: Experiment::planned(&e.name, (e.t0, dt), n, e.outputs(), inputs), x0: s.x0.clone() })
}

/// The model with every state that no output shows as a further output, and the names of these outputs.
///
/// # Errors
/// None that a model which exists could cause.
pub fn with_states_measured(model: &Model) -> Result<(Model, Vec<String>)> {
    let mut document = model.document().clone();
    let shown: Vec<String> = document.outputs.values().map(|o| o.expression().trim().to_string()).collect();
    let mut added = Vec::new();
    for state in model.document().states.keys().filter(|s| !shown.contains(s)) {
        let mut name = state.clone();
        while document.outputs.contains_key(&name) {
            name.push('\'');
        }
        document.outputs.insert(name.clone(), Definition::Plain(state.clone()));
        added.push(name);
    }
    Ok((Model::new(document, model.library().clone(), model.name())?, added))
}

/// The same records with room for more outputs.
pub fn widened(records: &[Start], outputs: usize) -> Vec<Start> {
    let wide = |s: &Start| {
        let e = &s.experiment;
        let experiment = Experiment::planned(&e.name, (e.t0, e.dt), e.len(), outputs, e.inputs.clone());
        Start { experiment, x0: s.x0.clone() }
    };
    records.iter().map(wide).collect()
}
