//! From a model and recordings to a [`Diagnosis`]: locate the mismatch, name the physics that was left out, model it,
//! show that the held-out error falls — or say that it cannot be told.
//!
//! Read in order: `experiment` (a recording in the model's terms), `kalman`, `prepare` and `prepared` (sizes, noise, starts,
//! observers), `fit` (the homotopy from prediction error to simulation error), `trial` (a fitted hypothesis), `hypothesis` and
//! `locate` (at which port, sensor or input), `dependence` and `occasions` (on which variable, and when), `sizes`, `places` and
//! `candidates` (every effect at every place), `screen` (the linearised test), `runner` (a candidate on its way), `search`
//! (successive halving), `score`, `seen` and `judge` (ranking and acceptance), `forward` (several effects), `law`, `unknown`,
//! `conclude` (the verdict), `report`, `words`, [`result`] (the noun).

mod candidates;
mod conclude;
mod dependence;
mod experiment;
mod fit;
mod forward;
pub mod harmonic;
mod hypothesis;
pub mod isolability;
mod judge;
mod kalman;
mod law;
mod locate;
mod occasions;
mod places;
mod prepare;
mod prepared;
pub mod quality;
mod report;
pub mod result;
mod runner;
mod score;
mod screen;
mod search;
mod seen;
mod sizes;
mod trial;
mod unknown;
mod words;

use std::time::Instant;

pub use experiment::{Control, Experiment};
pub use result::{Diagnosis, Verdict};

use crate::error::{Error, Result, nearest};
use crate::model::{Model, System};
use crate::signal::Recording;
use crate::simulate::Hold;
use places::Places;
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
    quality::clipped_to_gaps(model, &mut train);
    quality::clipped_to_gaps(model, &mut test);

    (control.progress)("following the recordings", 0.05);
    let prepared = Prepared::new(model, train, test, control, &mut warnings)?;
    (control.progress)("refitting the nominal parameters", 0.1);
    let (sigma, nominal) = prepared.nominal(model, control)?;
    let bench = prepared.bench(model, &sigma, control);
    (control.progress)("locating the mismatch", 0.15);
    let scene = Scene { sigma: sigma.clone(), ..prepared.scene.clone() };
    let (forces, located) = locate::everywhere(&bench, &scene, &nominal, options.seed, &mut warnings)?;
    let places = Places::new(&bench, &scene, &nominal, &forces);
    let jobs = places.jobs(&names)?;
    let ports = places.ports().to_vec();
    // A record of its own that was predicted is the best witness; a piece cut from the train records is not one.
    let halves = if own_test { None } else { Some(prepared.halves(model, control)?) };
    let explained = forward::explain(&bench, &scene, nominal, &jobs, halves.as_ref(), &mut warnings)?;
    let others: Vec<&[Vec<f64>]> =
        explained.rounds.iter().flat_map(|r| r.trials.iter().map(|t| t.residuals.train.as_slice())).collect();
    let own = &explained.nominal.residuals.train;
    if let Some(stranger) = quality::stranger(model, &prepared.train, &sigma, own, &others) {
        return Err(stranger);
    }
    (control.progress)("weighing the evidence", 0.9);
    // What a sensor is off by is no force: a law at a port that fits it is an accident.
    let at_sensor = located.as_ref().is_some_and(|l| l.location.kind == "output");
    let forces = if at_sensor { Vec::new() } else { forces };
    let unnamed = unknown::unnamed(&bench, &explained, &forces, &ports, halves.as_ref(), &mut warnings)?;
    conclude::conclude(conclude::Case {
        model,
        bench: &bench,
        scene: &scene,
        explained,
        unnamed,
        located,
        seed: options.seed,
        warnings,
        clock,
    })
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
    let system = model.compile();
    let period = system.period(system.parameters());
    let mut parts = (Vec::new(), Vec::new());
    for e in all {
        let cut = prepare::cut(&e, 1.0 - HELD_OUT, period);
        let mut held = e.part(cut, e.len());
        held.name = format!("{} (held out)", e.name);
        parts.0.push(e.part(0, cut));
        parts.1.push(held);
    }
    warnings.push("no test recording was given: the last third of every recording is held out instead".into());
    Ok(parts)
}
