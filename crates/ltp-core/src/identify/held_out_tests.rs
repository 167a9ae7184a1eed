//! Tests of the held-out score: a model that is right, and runs that must not enter their own prediction.

use super::*;
use crate::identify::planted::{joins, phase_of, places, recording};

/// A first-order machine around an orbit of its own in every run.
fn walk() -> (Recording, Phase, Options) {
    let places = places(6, 5, 11);
    let mut random = SplitMix64::new(12);
    let u: Vec<f64> = places.iter().map(|p| p.run as f64 + random.normal()).collect();
    let mut y = vec![0.0; places.len()];
    for i in 1..y.len() {
        y[i] = 0.8 * y[i - 1] + 0.2 * u[i - 1] + (std::f64::consts::TAU * places[i].elapsed).cos();
    }
    let recording = recording(&places, &u, vec![y]);
    let phase = phase_of(&recording, joins(&places));
    let base = Options::new(&["u".into()], &["y0".into()]);
    let options = Options { output_lags: 1, input_lags: 1, harmonics: 0, offset: 1, draws: 0, ..base };
    (recording, phase, options)
}

#[test]
fn a_model_that_is_right_beats_both_rivals_and_equals_itself() {
    let (recording, phase, options) = walk();
    let score = held_out(&recording, &phase, &options).expect("a score");
    assert_eq!((score.groups, score.group.len()), (6, 60));
    // Without noise only the found mark, a little off the planted one half, leaves an error.
    assert!(score.rms(&score.model, 0) < 0.05 * score.rms(&score.orbit, 0));
    assert!(score.rms(&score.model, 0) < 0.05 * score.rms(&score.previous, 0));
    let missing = score.previous.iter().filter(|e| e.is_nan()).count();
    assert_eq!(missing, 6 * 2, "the first cycle of each run has none before it");
    let itself = score.ratio(&score.model, 0, 200, 3).expect("a ratio");
    assert_eq!((itself.value, itself.interval), (1.0, (1.0, 1.0)));
    let orbit = score.ratio(&score.orbit, 0, 200, 3).expect("a ratio");
    assert!(orbit.interval.0 <= orbit.value && orbit.value <= orbit.interval.1 && orbit.interval.1 < 0.2);
    let mean_square = score.rms_by_group(&score.model, 0).iter().map(|r| r * r).sum::<f64>() / 6.0;
    assert!((mean_square.sqrt() / score.rms(&score.model, 0) - 1.0).abs() < 1e-12);
    assert!(score.ratio(&score.model[1..], 0, 200, 3).is_err());
}

/// What a held-out run is predicted by must not have seen it: spoiling its output changes no other run's prediction of it.
#[test]
fn the_held_out_run_does_not_enter_its_own_prediction() {
    let (recording, phase, options) = walk();
    let (u, y): (Vec<f64>, Vec<f64>) = (recording.input(0).collect(), recording.output(0).collect());
    let last = phase.segments().last().expect("one").rows(recording.t());
    let mut spoiled = y.clone();
    let mut random = SplitMix64::new(13);
    // Everything in the last segment but the sample it starts from.
    last.clone().skip(1).for_each(|i| spoiled[i] += random.normal());
    let inputs = vec![u, recording.input(1).collect()];
    let names = (recording.input_names().to_vec(), recording.output_names().to_vec());
    let other =
        Recording::new("spoiled", recording.t().to_vec(), inputs, vec![spoiled], names.0, names.1).expect("good");
    let (a, b) =
        (held_out(&recording, &phase, &options).expect("one"), held_out(&other, &phase, &options).expect("one"));
    assert_eq!(a.prediction[last.start + 1..last.end], b.prediction[last.start + 1..last.end]);
    let first = phase.segments()[0].rows(recording.t());
    assert_ne!(a.prediction[first.start + 1..first.end], b.prediction[first.start + 1..first.end]);
}
