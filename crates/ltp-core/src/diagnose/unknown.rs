//! Physics outside the library: a force law without a name, in cubic B-splines over what it depends on.
//!
//! The law is an effect like any other, only with a coefficient per spline: it is attached to a port, fitted jointly with
//! everything else, and must predict the held-out records to be believed. Three families are tried at every port: a force
//! that follows position, one that follows velocity, and a damping that follows position.

use indexmap::IndexMap;

use super::candidates::Place;
use super::forward::Explained;
use super::judge::{self, Halves};
use super::result::{Force, Law};
use super::search::search;
use super::trial::{Bench, Made, Trial};
use crate::error::Result;
use crate::model::effects::EffectParameter;
use crate::model::{Effect, Model, System};
use crate::numeric::spline::BSplines;

/// Pieces of the cubic spline.
const PIECES: usize = 9;
/// Mean square residual in units of noise above which a law without a name is looked for.
const LEFT: f64 = 1.5;
/// Share of what a named effect leaves that a law without a name must remove to be said instead of it.
const INSTEAD: f64 = 0.5;
/// Difference, as a share of what the named effects leave, below which a law does as well without them as beside them.
const ALIKE: f64 = 0.1;
/// Points of the table.
const GRID: usize = 121;

/// A family of laws.
#[derive(Clone, Copy, PartialEq)]
enum Family {
    Position,
    Velocity,
    DampingOverPosition,
}

const FAMILIES: [Family; 3] = [Family::Position, Family::Velocity, Family::DampingOverPosition];

impl Family {
    fn name(self) -> &'static str {
        match self {
            Family::Position => "unnamed_force_of_position",
            Family::Velocity => "unnamed_force_of_velocity",
            Family::DampingOverPosition => "unnamed_damping_over_position",
        }
    }

    fn variable(self) -> &'static str {
        if self == Family::Velocity { "velocity" } else { "position" }
    }

    fn of(self, f: &Force) -> &[f64] {
        if self == Family::Velocity { &f.velocity } else { &f.position }
    }

    /// The effect over a range of the variable.
    fn effect(self, (low, high): (f64, f64)) -> Effect {
        let width = (high - low) / PIECES as f64;
        let x = self.variable();
        let term = |j: usize| {
            let u = format!("abs(({x} - ({})) / {width})", low + (j as f64 - 1.0) * width);
            format!("c{j}*if({u} < 1, 2/3 - {u}^2 + {u}^3/2, max(2 - {u}, 0)^3/6)")
        };
        let sum: Vec<String> = (0..PIECES + 3).map(term).collect();
        let (factor, unit) = match self {
            Family::DampingOverPosition => ("-velocity*", "force/velocity"),
            _ => ("", "force"),
        };
        let coefficient = EffectParameter { unit: unit.into(), scale: unit.into(), ..EffectParameter::default() };
        Effect {
            sentence: format!("a force without a name that follows {x}"),
            on: "port".into(),
            law: Some(format!("{factor}({})", sum.join(" + "))),
            parameters: (0..PIECES + 3).map(|j| (format!("c{j}"), coefficient.clone())).collect(),
            reference: "de Boor, A Practical Guide to Splines, 2001".into(),
            ..Effect::default()
        }
    }
}

/// A law without a name that was accepted.
pub struct Unnamed {
    /// The fitted hypothesis.
    pub trial: Trial,
    /// Table of the law.
    pub law: Law,
    /// Whether it stands beside named effects, for what they leave.
    pub beside: bool,
}

/// Looks for a law without a name: instead of named effects that leave much, or for what they leave.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn unnamed(
    bench: &Bench<'_>,
    e: &Explained,
    forces: &[(String, Vec<Force>)],
    places: &[Place],
    halves: Option<&Halves>,
    warnings: &mut Vec<String>,
) -> Result<Option<Unnamed>> {
    if e.last().left() < LEFT {
        // Names that only work together at one port may be the first terms of a series for another law.
        let effects = &e.last().made.effects;
        if effects.len() < 2
            || effects.iter().any(|(_, at)| forces.iter().all(|(port, _)| port != at) || *at != effects[0].1)
        {
            return Ok(None);
        }
        let alone = added(bench, &e.nominal, forces, places, halves, &mut Vec::new())?;
        return Ok(alone.filter(|u| {
            let ranking = judge::rank(e.last(), [&u.trial]);
            ranking.score(None) - ranking.score(Some(0)) > judge::APART
        }));
    }
    let energy = |t: &Trial| t.residuals.structural(&t.residuals.train);
    let alone = added(bench, &e.nominal, forces, places, halves, warnings)?;
    if !e.found() {
        return Ok(alone);
    }
    let beside = added(bench, e.last(), forces, places, halves, warnings)?;
    let named = energy(e.last());
    let reached = beside.as_ref().map_or(named, |u| energy(&u.trial));
    let better = |u: &Unnamed| energy(&u.trial) < INSTEAD * named && energy(&u.trial) < reached + ALIKE * named;
    Ok(alone.filter(better).or(beside))
}

/// The best law on top of a hypothesis, where it is accepted.
fn added(
    bench: &Bench<'_>,
    base: &Trial,
    forces: &[(String, Vec<Force>)],
    places: &[Place],
    halves: Option<&Halves>,
    warnings: &mut Vec<String>,
) -> Result<Option<Unnamed>> {
    let mut model = base.made.model.clone();
    let mut jobs = Vec::new();
    let mut ranges = IndexMap::new();
    for (port, along) in forces {
        let Some(place) = places.iter().find(|p| p.at == *port) else { continue };
        for family in FAMILIES {
            let values = || along.iter().flat_map(|f| family.of(f).iter().copied());
            let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
            if !(high > low && (high - low).is_finite()) {
                continue;
            }
            let name = format!("{}_{}", family.name(), ranges.len());
            model = model.with_effect(&name, family.effect((low, high)))?;
            ranges.insert((name.clone(), port.clone()), (family, low, high));
            jobs.push((name, place.clone()));
        }
    }
    if jobs.is_empty() {
        return Ok(None);
    }
    let base = retold(base, model);
    let mut found = search(bench, &base, &jobs, (0.9, 0.95), false)?;
    let ranking = judge::rank(&base, &found.trials);
    let Some(best) = ranking.winner(&found.trials) else { return Ok(None) };
    let evidence = judge::weigh(bench, &base, &found.trials[best], halves, jobs.len())?;
    if !evidence.explains() {
        let (family, ..) = found.trials[best]
            .made
            .effects
            .last()
            .and_then(|key| ranges.get(key))
            .map_or((Family::Position, 0.0, 0.0), |r| *r);
        warnings.extend(evidence.refusal(&format!("a law without a name that follows {}", family.variable()), None));
        return Ok(None);
    }
    let trial = found.trials.swap_remove(best);
    let Some(((_, port), &(family, low, high))) = trial.made.effects.last().and_then(|key| ranges.get_key_value(key))
    else {
        return Ok(None);
    };
    let law = table(&trial, port, family, (low, high))?;
    Ok(Some(Unnamed { law, beside: trial.made.effects.len() > 1, trial }))
}

/// A fitted hypothesis with a larger library behind it.
fn retold(t: &Trial, model: Model) -> Trial {
    let system = model.compile();
    debug_assert_eq!(system.states(), t.made.system.states());
    let made = Made {
        effects: t.made.effects.clone(),
        priors: t.made.priors.clone(),
        extra: t.made.extra.clone(),
        model,
        system,
    };
    Trial { made, fit: t.fit.clone(), test_x0: t.test_x0.clone(), residuals: t.residuals.clone(), doubt: None }
}

/// The law over its range with the band of its coefficients.
fn table(t: &Trial, port: &str, family: Family, (low, high): (f64, f64)) -> Result<Law> {
    let basis = BSplines::new(low, high, PIECES)?;
    let sds = t.sds();
    let own = t.own(t.made.effects.len() - 1);
    let grid: Vec<f64> = (0..GRID).map(|i| low + (high - low) * i as f64 / (GRID - 1) as f64).collect();
    let sign = if family == Family::DampingOverPosition { -1.0 } else { 1.0 };
    let at = |x: f64, value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        basis.row(x).iter().zip(&own).map(|(b, (k, _))| b * value(*k)).collect()
    };
    let force = |x: f64| sign * at(x, &|k| t.fit.point.theta[k]).iter().sum::<f64>();
    let sd = |x: f64| at(x, &|k| sds[k]).iter().map(|v| v * v).sum::<f64>().sqrt();
    let [unit, position, velocity] = t.made.model.port_units(port)?;
    let per = if family == Family::DampingOverPosition { format!("{unit} / ({velocity})") } else { unit };
    Ok(Law {
        at: port.to_string(),
        variable: family.variable().to_string(),
        unit: per,
        variable_unit: if family == Family::Velocity { velocity } else { position },
        force: grid.iter().map(|x| force(*x)).collect(),
        sd: grid.iter().map(|x| sd(*x)).collect(),
        grid,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::zoo;

    #[test]
    fn the_law_as_an_effect_is_the_spline() {
        let (low, high) = (-0.7, 1.9);
        let basis = BSplines::new(low, high, PIECES).unwrap();
        let model = zoo("drive").unwrap().with_effect("law", Family::Velocity.effect((low, high))).unwrap();
        let names: Vec<String> = (0..PIECES + 3).map(|j| format!("c{j}")).collect();
        let values: Vec<(&str, f64)> = names.iter().enumerate().map(|(j, n)| (n.as_str(), (j as f64).sin())).collect();
        let model = model.attach("law", "drive", &values).unwrap();
        let plain = zoo("drive").unwrap().compile();
        let system = model.compile();
        let mass = plain.parameters()[0];
        for i in 0..50 {
            let v = low + (high - low) * f64::from(i) / 49.0;
            let (x, u) = ([0.1, v], [2.0]);
            let (mut with, mut without) = ([0.0; 2], [0.0; 2]);
            system.flow(0, crate::model::Point { t: 0.0, x: &x, u: &u, p: system.parameters() }, &mut with);
            plain.flow(0, crate::model::Point { t: 0.0, x: &x, u: &u, p: plain.parameters() }, &mut without);
            let force: f64 = basis.row(v).iter().zip(&values).map(|(b, (_, c))| b * c).sum();
            assert!(((with[1] - without[1]) * mass - force).abs() < 1e-9 * mass, "at {v}");
        }
    }
}
