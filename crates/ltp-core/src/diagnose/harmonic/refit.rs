//! The harmonic map of a diagnosis: of the refitted nominal model, and what a named effect leaves of it.
//!
//! Only recordings whose input repeats, on lines that tell the harmonics apart, are asked: then the map costs one orbit and one
//! run, and its noise is what does not repeat. A record in which the harmonics overlap is left to the verb
//! [`super::harmonic_map`], which is asked for by name and may take its time.

use super::super::experiment::{Control, Experiment};
use super::{At, EventTime, HarmonicMap, Measured, Options, fine, on_orbit};
use crate::cycle;
use crate::error::{Error, Result};
use crate::model::{Compiled, Model, System};

/// A model as fitted to records, with all its parameters.
#[derive(Clone, Copy)]
pub struct Refit<'a> {
    /// Model.
    pub model: &'a Model,
    /// The same, compiled.
    pub system: &'a Compiled,
    /// Parameters.
    pub p: &'a [f64],
    /// Records.
    pub experiments: &'a [Experiment],
    /// To stop early.
    pub control: &'a Control<'a>,
}

impl Refit<'_> {
    /// What the records say; `None` without a clock, and where they cannot tell the harmonics apart.
    fn measured(&self, options: &Options) -> Option<Measured> {
        let period = self.system.period(self.p)?;
        Measured::by_lines(self.model, self.experiments, period, options).ok()
    }

    fn map(&self, measured: &Measured, options: &Options) -> Result<HarmonicMap> {
        let Refit { model, system, p, experiments, control } = *self;
        let substeps = fine(experiments, measured.htf.period());
        let orbit = cycle::cycle(system, p, &cycle::Options::default())?;
        // The model's own run shows what the estimator makes of it; a start that was fitted to a machine which is not the
        // model would only ring.
        let starts: Vec<Vec<f64>> = experiments.iter().map(|e| on_orbit(&orbit, e.t0)).collect();
        At { model, system, p, experiments, starts: &starts, substeps, control }.map(measured, &orbit, options)
    }
}

/// The map of a refitted model with event times that were measured before; `None` where the records do not give one.
///
/// Records that were made for a map and a model that fails along them leave a warning, not an error.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn of_refit(at: Refit<'_>, events: &[EventTime], warnings: &mut Vec<String>) -> Result<Option<HarmonicMap>> {
    let options = Options::default();
    let Some(measured) = at.measured(&options) else { return Ok(None) };
    match at.map(&measured, &options) {
        Ok(mut map) => {
            map.events = events.to_vec();
            map.sentence = map.said();
            Ok(Some(map))
        }
        Err(Error::Interrupted) => Err(Error::Interrupted),
        Err(e) => {
            warnings.push(format!("there is no harmonic map: {e}"));
            Ok(None)
        }
    }
}

/// Mean square of the map of a model with what was named attached; `None` where it cannot be made.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn after(at: Refit<'_>) -> Result<Option<f64>> {
    let options = Options::default();
    let Some(measured) = at.measured(&options) else { return Ok(None) };
    match at.map(&measured, &options) {
        Ok(map) => Ok(Some(map.mean_square)),
        Err(Error::Interrupted) => Err(Error::Interrupted),
        Err(_) => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::super::columns;
    use super::*;
    use crate::model::zoo;
    use crate::signal::Recording;
    use crate::simulate::Hold;

    /// A record of the input `name` and the output `y` that no machine made: what is asked is what becomes of its samples.
    fn record(model: &Model, hold: Hold) -> Experiment {
        let t: Vec<f64> = (0..40).map(|k| 0.3 + 0.01 * f64::from(k)).collect();
        let wave = |rate: f64| -> Vec<f64> { t.iter().map(|t| (rate * t).sin()).collect() };
        let (input, output) = (model.inputs()[0].to_string(), model.outputs()[0].to_string());
        let recording =
            Recording::new("r", t.clone(), vec![wave(9.0)], vec![wave(7.0)], vec![input], vec![output]).unwrap();
        Experiment::new(model, &recording, hold).unwrap()
    }

    #[test]
    fn a_record_gives_back_the_samples_that_it_was_made_of() {
        let model = zoo("hopper").unwrap();
        for hold in [Hold::FirstOrder, Hold::ZeroOrder, Hold::Cubic] {
            let whole = record(&model, hold);
            for e in [whole.part(0, 40), whole.part(13, 40)] {
                let kept = columns(&model, &e).unwrap();
                assert_eq!(kept.output(0).collect::<Vec<_>>(), e.output(0).collect::<Vec<_>>());
                for (t, u) in kept.t().iter().zip(kept.input(0)) {
                    assert!((u - (9.0 * t).sin()).abs() < 1e-12, "{hold:?} at {t}");
                }
            }
        }
    }

    #[test]
    fn without_a_clock_or_a_repeating_input_there_is_no_map_and_no_complaint() {
        let control = Control { cancelled: &AtomicBool::new(false), progress: &|_, _| () };
        for name in ["drive", "hopper"] {
            let model = zoo(name).unwrap();
            let (system, e) = (model.compile(), record(&model, Hold::FirstOrder));
            let p = system.parameters().to_vec();
            let experiments = std::slice::from_ref(&e);
            let at = Refit { model: &model, system: &system, p: &p, experiments, control: &control };
            let mut warnings = Vec::new();
            assert_eq!(of_refit(at, &[], &mut warnings).unwrap(), None);
            assert_eq!(after(at).unwrap(), None);
            assert!(warnings.is_empty());
        }
    }
}
