//! Whether recordings show what an effect's name says: a law with corners that no motion passes is a smooth law with
//! another name, what repeats must have been seen to, and a shape that nothing determines is another effect's (a spring
//! that never yields).

use indexmap::IndexMap;

use super::candidates::Place;
use super::experiment::Run;
use super::fit::Ground;
use super::law::evaluate;
use super::trial::{Bench, Trial};
use crate::error::Result;

/// Standard deviation of a shape over its value, above which recordings do not show it.
const VAGUE: f64 = 0.5;

/// What is doubtful about a name that fits.
#[derive(Clone, Debug, PartialEq)]
pub enum Doubt {
    /// No recording passes a corner of its law.
    NoCorner,
    /// The recordings hold a part of its period only.
    NoPeriod {
        /// Period, s or in the unit of the port.
        every: f64,
        /// Part of it that the recordings hold.
        held: f64,
    },
    /// What makes the effect what it is stands at the end of its range, or anywhere.
    Shapeless(String),
}

impl Doubt {
    /// In words, after "because".
    pub fn words(&self) -> String {
        let number = super::words::number;
        match self {
            Self::Shapeless(name) => {
                format!("the recordings do not determine its {name}, without which it is another effect")
            }
            Self::NoCorner => "no recording passes a corner of its law, which is smooth without".into(),
            Self::NoPeriod { every, held } => format!(
                "it would repeat every {}, of which the recordings hold {}: nobody has seen it repeat",
                number(*every),
                number(*held)
            ),
        }
    }
}

/// The first doubt about what a hypothesis adds to its first `before` effects.
///
/// # Errors
/// What the library says of an effect's period.
pub fn doubt(bench: &Bench<'_>, trial: &Trial, before: usize, jobs: &[(String, Place)]) -> Result<Option<Doubt>> {
    let library = trial.made.model.library();
    for (k, (name, at)) in trial.made.effects.iter().enumerate().skip(before) {
        let effect = library.get(name)?;
        if let Some(repeats) = &effect.repeats {
            let own = trial.effect_parameters(k);
            let known: IndexMap<&str, f64> = own.iter().map(|(n, v)| (n.as_str(), *v)).collect();
            let every = evaluate(&repeats.every, &known, library)?.abs();
            let longest = bench.train.experiments.iter().map(|e| e.len() as f64 * e.dt).fold(0.0, f64::max);
            let seen = match repeats.over.as_str() {
                "position" => jobs.iter().find(|(n, p)| n == name && p.at == *at).map(|(_, p)| p.sizes.travel),
                _ => Some(longest),
            };
            // What swings for ever has no period, and nothing shows it.
            if let Some(seen) = seen.filter(|s| s.partial_cmp(&every) != Some(std::cmp::Ordering::Greater)) {
                return Ok(Some(Doubt::NoPeriod { every, held: seen / every }));
            }
        }
        let sd = trial.sds();
        for (i, own) in trial.own(k) {
            // What has a shape and a value of its own to begin with is no size.
            let p = effect.parameters.get(&own).filter(|p| !p.shape.is_empty() && p.value.is_some() && p.sd.is_none());
            let vague = sd[i] == 0.0 || sd[i].is_nan() || sd[i] > VAGUE * trial.fit.point.theta[i].abs();
            if vague && p.is_some_and(|p| p.neutral.is_finite()) {
                return Ok(Some(Doubt::Shapeless(own)));
            }
        }
        if !effect.corners.is_empty() && !passes(bench, trial, &format!("{name}, corner ")) {
            return Ok(Some(Doubt::NoCorner));
        }
    }
    Ok(None)
}

/// Whether an event whose name begins so happens along the train records.
fn passes(bench: &Bench<'_>, trial: &Trial, event: &str) -> bool {
    let Ground { experiments, substeps, control, .. } = bench.train;
    let (system, p) = (&trial.made.system, &trial.parameters());
    experiments.iter().zip(&trial.fit.point.x0).any(|(experiment, x0)| {
        let run = Run { system, p, x0, experiment, substeps, observer: None, control };
        run.go(false, &mut |_, _, _| {}).is_ok_and(|events| events.iter().any(|e| e.name.starts_with(event)))
    })
}
