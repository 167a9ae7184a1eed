//! Unclocked walkers for tests, in which everything is known: steps of varying duration, a contact switch, separate runs.

use super::phase::{Events, Options, Phase, phase_from_events};
use crate::numeric::rng::SplitMix64;
use crate::signal::Recording;

/// Sampling step, s.
pub const DT: f64 = 0.01;
/// Samples of a step: the median is 50, so that the usual duration is exactly 0.5 s. A cycle is two steps.
const STEPS: [usize; 5] = [50, 46, 54, 48, 52];

/// Where a sample stands.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Number of the run and of the cycle, counted through all runs.
    pub run: usize,
    /// Cycle, counted through all runs.
    pub cycle: usize,
    /// Interpolated phase, which knows when the step ends.
    pub phase: f64,
    /// Phase from the time since the last switch over the usual 0.5 s.
    pub elapsed: f64,
    /// Samples since the last switch.
    pub since: usize,
}

/// The places of `runs` runs of `cycles` cycles each, with a step before and one after: the first and the last switch of the
/// record are inside.
pub fn places(runs: usize, cycles: usize, seed: u64) -> Vec<Place> {
    let mut random = SplitMix64::new(seed);
    let mut places = Vec::new();
    let mut step = |run: usize, cycle: usize, part: usize| {
        let length = STEPS[random.below(STEPS.len())];
        places.extend((0..length).map(|since| {
            let along = |length: usize| 0.5 * (part as f64 + ((since as f64 + 0.5) / length as f64).min(1.0));
            Place { run, cycle, phase: along(length), elapsed: along(50), since }
        }));
    };
    step(0, usize::MAX, 1);
    (0..runs * cycles).for_each(|cycle| (0..2).for_each(|part| step(cycle / cycles, cycle, part)));
    step(runs - 1, usize::MAX, 0);
    places
}

/// A recording of `outputs` (named y0, y1, ...) and of input `u` at these places, with the switch as input `contact`.
pub fn recording(places: &[Place], u: &[f64], outputs: Vec<Vec<f64>>) -> Recording {
    let t = (0..places.len()).map(|i| i as f64 * DT).collect();
    let contact = places.iter().map(|p| f64::from(p.phase < 0.5)).collect();
    let names = (0..outputs.len()).map(|j| format!("y{j}")).collect();
    let inputs = vec![u.to_vec(), contact];
    Recording::new("planted", t, inputs, outputs, vec!["u".into(), "contact".into()], names).expect("a good recording")
}

/// Times at which a new run begins: the switches there, halfway between two samples.
pub fn joins(places: &[Place]) -> Vec<f64> {
    (1..places.len()).filter(|&i| places[i].run != places[i - 1].run).map(|i| (i as f64 - 0.5) * DT).collect()
}

/// The phase of such a recording from its switch and joins.
pub fn phase_of(recording: &Recording, joins: Vec<f64>) -> Phase {
    let events = Events::from_switch(recording, "contact", None).expect("switches");
    phase_from_events(recording, &events, &Options { joins, ..Options::default() }).expect("a phase")
}
