//! Tests of the periodic ARX model: planted machines, with and without feedback, and one that does not vary.

use super::*;
use crate::identify::held_out::held_out;
use crate::identify::planted::{DT, Place, joins, phase_of, places, recording};

/// Amplitude of the planted periodic coefficients; 0 plants a time-invariant machine.
struct Planted {
    depth: f64,
    /// Gain of a feedback from the output to the input.
    feedback: f64,
}

impl Planted {
    fn coefficients(&self, phi: f64) -> (f64, f64, f64) {
        let (sin, cos) = (TAU * phi).sin_cos();
        (1.5 + 0.1 * self.depth * cos, -0.7, 0.1 * (1.0 + 0.8 * self.depth * sin))
    }

    /// Input and output at the places: `y = c + a1 y- + a2 y-- + b u- + e`, the input known before the output.
    fn run(&self, places: &[Place], seed: u64) -> (Vec<f64>, Vec<f64>) {
        let mut random = SplitMix64::new(seed);
        let (mut u, mut y) = (vec![0.0; places.len()], vec![0.0; places.len()]);
        for i in 2..places.len() {
            let (a1, a2, b) = self.coefficients(places[i].elapsed);
            y[i] =
                (TAU * places[i].elapsed).cos() + a1 * y[i - 1] + a2 * y[i - 2] + b * u[i - 1] + 0.02 * random.normal();
            u[i] = random.normal() - self.feedback * y[i];
        }
        (u, y)
    }

    /// The exact answer after a unit step at `phase`, `steps` samples later.
    fn step(&self, phase: f64, steps: usize) -> f64 {
        let mut y = [0.0, 0.0];
        for i in 1..=steps {
            let (a1, a2, b) = self.coefficients(phase + i as f64 * DT);
            y = [a1 * y[0] + a2 * y[1] + b, y[0]];
        }
        y[0]
    }
}

fn options(harmonics: usize, draws: usize) -> Options {
    let base = Options::new(&["u".into()], &["y0".into()]);
    Options { output_lags: 2, input_lags: 1, spacing: 1, harmonics, offset: 1, draws, ..base }
}

fn planted(truth: &Planted, seed: u64) -> (Recording, Phase) {
    let places = places(12, 5, seed);
    let (u, y) = truth.run(&places, seed + 1000);
    let recording = recording(&places, &u, vec![y]);
    let phase = phase_of(&recording, joins(&places));
    (recording, phase)
}

/// The planted phase puts the second switch at one half; the found one puts it at the median share, a little off.
fn as_planted(phase: &Phase, phi: f64) -> f64 {
    let mark = phase.marks()[1];
    if phi < mark { 0.5 * phi / mark } else { 0.5 + 0.5 * (phi - mark) / (1.0 - mark) }
}

#[test]
fn the_band_of_the_step_response_covers_the_truth_with_and_without_feedback() {
    for feedback in [0.0, 0.3] {
        let truth = Planted { depth: 1.0, feedback };
        let (mut inside, mut all) = (0, 0);
        for seed in 0..30 {
            let (recording, phase) = planted(&truth, seed);
            let model = identify_arx(&recording, &phase, &options(1, 100)).expect("a model");
            assert!((model.noise_sd[0] / 0.02 - 1.0).abs() < 0.1, "noise {}", model.noise_sd[0]);
            for phi in [0.1, 0.6] {
                let found = model.step_response("u", phi, 10.0 * DT).expect("a response");
                let error = found.values[10] - truth.step(as_planted(&phase, phi), 10);
                assert!(error.abs() < 0.15, "error {error} of about 1.2");
                inside += usize::from(error.abs() < 1.96 * found.sd[10]);
                all += 1;
            }
        }
        // 95 % of 60 would be 57; twelve groups make bands of about 90 %, and 54 - 3 sqrt(60 0.9 0.1) = 47.
        assert!(inside >= 47, "{inside} of {all} inside with feedback {feedback}");
    }
}

#[test]
fn time_variation_is_claimed_where_planted_and_not_elsewhere() {
    let claims = |depth: f64, seed: u64, offset: usize| {
        let (recording, phase) = planted(&Planted { depth, feedback: 0.0 }, seed);
        let score =
            |harmonics| held_out(&recording, &phase, &Options { offset, ..options(harmonics, 0) }).expect("a score");
        let (periodic, constant) = (score(1), score(0));
        periodic.ratio(&constant.model, 0, 500, 1).expect("a ratio")
    };
    assert!((0..10).all(|seed| claims(1.0, seed, 4).interval.1 < 0.7));
    let false_claims = |offset| (0..20).filter(|seed| claims(0.0, *seed, offset).interval.1 < 1.0).count();
    assert!(false_claims(4) <= 1, "{} of 20", false_claims(4));
    // The found mark is a little off the planted one half, so that one harmonic does not carry the orbit: the
    // coefficients make up for it, and a time variation is seen that is not there. `Options::offset` warns of this.
    assert!(false_claims(1) > 1);
}

#[test]
fn free_run_starts_from_measured_samples_and_follows_the_planted_machine() {
    let places = places(6, 5, 9);
    let truth = Planted { depth: 1.0, feedback: 0.0 };
    let (u, y) = truth.run(&places, 10);
    let recording = recording(&places, &u, vec![y.clone()]);
    let phase = phase_of(&recording, joins(&places));
    let model = identify_arx(&recording, &phase, &options(1, 0)).expect("a model");
    let prediction = model.predict(&recording, &phase).expect("a prediction");
    for (i, place) in places.iter().enumerate() {
        assert_eq!(prediction[i].is_nan(), place.since < 2 || place.cycle == usize::MAX, "sample {i}");
    }
    let inside = || (0..y.len()).filter(|i| !prediction[*i].is_nan());
    let (error, size) = (stats::rms(inside().map(|i| y[i] - prediction[i])), stats::std(inside().map(|i| y[i])));
    assert!(error < 0.1 * size, "error {error} of {size}");
    let response = model.step_response("u", 0.1, 0.1).expect("a response");
    assert!(response.sd.iter().all(|sd| sd.is_nan()), "no draws, no bands");
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    let (recording, phase) = planted(&Planted { depth: 1.0, feedback: 0.0 }, 2);
    let sd = |seed| {
        let model = identify_arx(&recording, &phase, &Options { seed, ..options(1, 20) }).expect("a model");
        model.step_response("u", 0.2, 0.1).expect("a response").sd
    };
    assert_eq!(sd(1), sd(1));
    assert_ne!(sd(1), sd(2));
}

#[test]
fn bad_input_says_what_is_wrong() {
    let (recording, phase) = planted(&Planted { depth: 1.0, feedback: 0.0 }, 3);
    let failed = |options: Options| identify_arx(&recording, &phase, &options).expect_err("bad").to_string();
    assert!(failed(Options { spacing: 0, ..options(1, 0) }).contains("spacing = 0"));
    assert!(failed(Options { output_lags: 0, ..options(1, 0) }).contains("output_lags = 0"));
    assert!(failed(Options { outputs: vec![], ..options(1, 0) }).contains("outputs = 0"));
    assert!(failed(Options { inputs: vec!["v".into()], ..options(1, 0) }).contains("no channel `v`"));
    assert!(failed(Options { inputs: vec!["u".into(); 2], ..options(1, 0) }).contains("cannot be told apart"));
    assert!(failed(options(500, 0)).contains("fewer harmonics or lags"));
    let model = identify_arx(&recording, &phase, &options(1, 0)).expect("a model");
    assert!(model.step_response("w", 0.1, 0.1).is_err());
    assert!(model.step_response("u", 1.0, 0.1).expect_err("bad").to_string().contains("phase = 1"));
    assert!(model.step_response("u", 0.1, 0.001).expect_err("bad").to_string().contains("at least 0.01 s"));
    let to_the_switch = model.step_response("u", 0.4, 9.0).expect("cut short");
    assert!(to_the_switch.t.len() <= 11, "{} samples pass the switch", to_the_switch.t.len());
}
