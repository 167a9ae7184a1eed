//! The worst that parameters may do to a closed loop: its orbit and exponents at the corners and middles of their ranges.

use rayon::prelude::*;

use super::orbit::Orbit;
use crate::error::{Error, Result};
use crate::feedforward::Reference;
use crate::model::System;

/// Parameters that may vary at once: three values of each make 243 cases.
const MOST: usize = 5;

/// Steps from the nominal parameters to others.
const STEPS: u32 = 4;

/// A closed loop under other parameter values than those it was designed for.
#[derive(Clone, Debug)]
pub struct Case {
    /// Relative change of each varied parameter.
    pub changes: Vec<f64>,
    /// Largest real part of the exponents of the closed loop's orbit, 1/s; `None` where no orbit was found.
    pub slowest: Option<f64>,
    /// Largest distance of that orbit from the reference, per state, as a share of the reference's amplitude.
    pub error: Vec<f64>,
}

/// Corners and middles of the ranges of some parameters.
#[derive(Clone, Debug)]
pub struct Spread {
    /// Numbers of the parameters with their relative half ranges.
    pub parameters: Vec<(usize, f64)>,
    /// All cases, the first parameter slowest.
    pub cases: Vec<Case>,
}

impl Spread {
    /// All cases of a closed system; `start` (nx) is near its orbit under nominal parameters.
    pub(super) fn of(
        system: &dyn System,
        p: &[f64],
        reference: &Reference,
        start: &[f64],
        parameters: &[(usize, f64)],
    ) -> Result<Self> {
        if parameters.len() > MOST {
            let expected = format!("at most {MOST} parameters; choose those that matter");
            return Err(Error::OutOfRange { what: "spread".into(), found: parameters.len() as f64, expected });
        }
        for (number, share) in parameters {
            if *number >= p.len() || !(*share > 0.0 && *share < 1.0) {
                let expected = "relative half ranges between 0 and 1 of parameters that exist".into();
                return Err(Error::OutOfRange {
                    what: format!("spread of parameter {number}"),
                    found: *share,
                    expected,
                });
            }
        }
        let count = 3_usize.pow(parameters.len() as u32);
        let case = |index: usize| {
            let change = |k: usize| {
                let digit = index / 3_usize.pow((parameters.len() - 1 - k) as u32) % 3;
                (digit as f64 - 1.0) * parameters[k].1
            };
            let changes: Vec<f64> = (0..parameters.len()).map(change).collect();
            let orbit = followed(system, reference, start, |share| {
                let mut p = p.to_vec();
                parameters.iter().zip(&changes).for_each(|((number, _), change)| p[*number] *= 1.0 + share * change);
                p
            });
            let slowest = orbit.as_ref().map(Orbit::slowest);
            Case { changes, slowest, error: orbit.map_or_else(Vec::new, |o| o.error) }
        };
        Ok(Self { parameters: parameters.to_vec(), cases: (0..count).into_par_iter().map(case).collect() })
    }

    /// The case with the largest real part; one without an orbit is worse than all.
    pub fn worst(&self) -> Option<&Case> {
        let badness = |c: &Case| c.slowest.unwrap_or(f64::INFINITY);
        self.cases.iter().max_by(|a, b| badness(a).total_cmp(&badness(b)))
    }

    /// The worst case with one parameter changed at a time.
    pub fn worst_alone(&self) -> Option<&Case> {
        let alone = |c: &&Case| c.changes.iter().filter(|change| **change != 0.0).count() <= 1;
        let badness = |c: &Case| c.slowest.unwrap_or(f64::INFINITY);
        self.cases.iter().filter(alone).max_by(|a, b| badness(a).total_cmp(&badness(b)))
    }

    /// Largest error of each state over all cases that have an orbit.
    pub fn error(&self) -> Vec<f64> {
        let errors = self.cases.iter().map(|c| &c.error).filter(|e| !e.is_empty());
        errors.fold(Vec::new(), |most, e| {
            if most.is_empty() { e.clone() } else { most.iter().zip(e).map(|(a, b)| a.max(*b)).collect() }
        })
    }
}

/// The orbit that the nominal one becomes while the parameters go to `p(1)` step by step: several may exist there, and it is
/// this branch that a machine whose parameters drift follows. `None` where it is lost and none is found at once either.
fn followed(system: &dyn System, reference: &Reference, start: &[f64], p: impl Fn(f64) -> Vec<f64>) -> Option<Orbit> {
    let mut at = start.to_vec();
    let mut orbit = None;
    for step in 1..=STEPS {
        orbit = Orbit::find(system, &p(f64::from(step) / f64::from(STEPS)), reference, &at).ok();
        match &orbit {
            Some(orbit) => at = orbit.states.value(0.0),
            None => break,
        }
    }
    orbit.or_else(|| Orbit::find(system, &p(1.0), reference, start).ok())
}
