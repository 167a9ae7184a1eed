//! The loops of the thesis: which printed figures hold, and what the failing cases really do. Figures: docs/certificate.md.

use super::*;
use crate::feedforward::{Options as Solve, Reference, Sinusoid, feedforward};
use crate::model::{Model, System, zoo};
use crate::numeric::fourier_series::FourierSeries;
use std::f64::consts::PI;

const DOWN: f64 = 2.0 * PI;
const UP: f64 = 10.0 * PI;

fn hanging() -> Model {
    zoo("cart_pendulum").expect("zoo")
}

fn inverted() -> Model {
    hanging().with_parameters(&[("K_s", 0.74, None)]).expect("a stiffer spring")
}

fn sine(amplitude: f64, phase: f64, offset: f64) -> Sinusoid {
    Sinusoid { amplitude, phase, offset }
}

/// (4.1), with the input from (3.1) and (3.4).
fn down() -> Reference {
    let given = [(0, sine(0.05, 0.0, 0.0)), (1, sine(-0.2472, 0.6809, 0.0))];
    Reference::of_sinusoids(&hanging(), DOWN, &given, 0, &[]).expect("a reference")
}

/// (4.5) as the tables were made with it.
fn up() -> Reference {
    let given = [(0, sine(0.03752, -0.0769, 0.0)), (1, sine(0.1, 0.0, PI))];
    Reference::of_sinusoids(&inverted(), UP, &given, 0, &[]).expect("a reference")
}

/// The orbit that (4.5) should have been.
fn true_up() -> Reference {
    let system = inverted().compile();
    let wanted = sine(0.1, 0.0, PI).series(UP).expect("a sine");
    feedforward(&system, system.parameters(), 1, &wanted, &Solve::default()).expect("a reference")
}

fn gain(omega: f64, values: [f64; 4]) -> FourierSeries {
    FourierSeries::constant(2.0 * PI / omega, &values).expect("a gain")
}

fn near(found: f64, expected: f64, within: f64) {
    assert!((found - expected).abs() <= within, "found {found}, expected {expected} +- {within}");
}

#[test]
fn the_downward_loop_settles_as_printed() {
    let options = Options { deviations: vec![vec![0.02, 0.2, 0.0, 0.0]], horizon: Some(10.0), ..Options::default() };
    let gain = gain(DOWN, [69.69, -2.01, 19.62, 6.54]);
    let found = certify(&hanging(), &down(), &gain, &options).expect("a certificate");
    near(found.exponents[0].re, -7.595, 1e-3);
    near(found.lifted[0].central, -7.595, 1e-3);
    let run = &found.runs[0];
    near(run.settled[0].expect("x settles"), 1.19, 0.011);
    near(run.settled[1].expect("theta settles"), 1.08, 0.011);
    near(run.steady[0], 0.0022, 6e-5);
    near(run.steady[1], 0.0019, 6e-5);
    near(run.feedback[0], 1.2, 0.15);
    assert!(run.returns && found.tolerated[0].multiple > 1.0);
    assert_eq!(found.verdict, Verdict::Stable, "{}", found.sentence);
}

#[test]
fn the_failing_cases_are_stable_around_the_orbits_they_really_have() {
    for (values, along, around, errors) in [
        ([397.1, 216.2, 47.5, -17.6], -0.3906, -0.226, (0.136, 0.143)),
        ([4.36, 4.99, -8.86, 4.87], -0.4039, -0.192, (0.0551, 0.0580)),
        ([1000.5, 3.9, 5.4, -0.7], -0.2312, -0.320, (0.0105, 0.0584)),
        ([1093.2, 4.3, 75.6, 2.5], -0.2264, -0.334, (0.0052, 0.0590)),
    ] {
        let found = certify(&inverted(), &up(), &gain(UP, values), &Options::default()).expect("a certificate");
        let orbit = found.orbit.as_ref().expect("an orbit");
        near(found.exponents[0].re, along, 6e-4);
        near(orbit.slowest(), around, 3e-3);
        near(orbit.error[0], errors.0, 2e-3);
        near(orbit.error[1], errors.1, 2e-3);
        assert!(found.sentence.contains("not an orbit"), "{}", found.sentence);
    }
}

#[test]
fn on_the_true_orbit_the_printed_gains_are_slow_and_the_edge_of_the_lift_lies() {
    let reference = true_up();
    let open = certify(&inverted(), &reference, &gain(UP, [0.0; 4]), &Options::default()).expect("a certificate");
    near(open.open[1].re, -0.0065, 6e-5);
    assert_eq!(open.verdict, Verdict::Neutral, "{}", open.sentence);
    for (values, slow) in [
        ([1000.5, 3.9, 5.4, -0.7], -0.0071),
        ([1093.2, 4.3, 75.6, 2.5], -0.0031),
        ([397.1, 216.2, 47.5, -17.6], -0.0220),
        ([4.36, 4.99, -8.86, 4.87], -0.0054),
    ] {
        let found = certify(&inverted(), &reference, &gain(UP, values), &Options::default()).expect("a certificate");
        near(found.exponents[0].re, slow, 6e-5);
        let orbit = found.orbit.as_ref().expect("an orbit");
        // The loop's orbit is the reference itself, and its exponents by the engine are those along it.
        assert!(orbit.error.iter().all(|e| *e < 1e-6), "{:?}", orbit.error);
        near(orbit.slowest(), found.exponents[0].re, 1e-6);
        assert!(found.lifted[1].distance < 1e-5, "{:?} {:?}", found.lifted, found.exponents);
    }
    let edge = certify(&inverted(), &reference, &gain(UP, [397.1, 216.2, 47.5, -17.6]), &Options::default());
    let edge = edge.expect("a certificate");
    near(edge.lifted[0].all, -0.0130, 6e-5);
    near(edge.lifted[1].all, -0.0130, 6e-5);
    near(edge.lifted[0].central, -0.0220, 6e-5);
    assert!(edge.reasons.iter().any(|r| r.starts_with("truncation")), "{:?}", edge.reasons);
}

#[test]
fn a_pendulum_one_percent_longer_makes_it_unstable() {
    let l_p = inverted().parameter("l_p").expect("l_p");
    let options = Options { spread: vec![(l_p, 0.01)], ..Options::default() };
    let gain = gain(UP, [1000.5, 3.9, 5.4, -0.7]);
    let found = certify(&inverted(), &true_up(), &gain, &options).expect("a certificate");
    let spread = found.spread.as_ref().expect("a spread");
    assert_eq!(spread.cases.len(), 3);
    near(spread.cases[1].slowest.expect("an orbit"), -0.0071, 6e-5);
    let worst = spread.worst().expect("a case");
    assert!(worst.slowest.is_none_or(|s| s > 0.0), "{worst:?}");
    assert_eq!(found.verdict, Verdict::Disagree);
    assert!(found.sentence.contains("not robust") && found.sentence.contains("l_p"), "{}", found.sentence);
}

#[test]
fn a_change_of_amplitude_keeps_the_errors_that_are_printed() {
    let given = [(0, sine(0.07, 0.0, 0.0)), (1, sine(-0.3387, 0.6691, 0.0))];
    let wide = Reference::of_sinusoids(&hanging(), DOWN, &given, 0, &[]).expect("a reference");
    let gain = gain(DOWN, [81.75, 6.71, 19.99, 7.11]);
    // The input stays that of the smaller orbit (section 4.1.4).
    let wide = Reference { inputs: down().inputs, ..wide };
    let stage = |reference: Reference, until| Stage { reference, gain: gain.clone(), until };
    let found = track(&hanging(), &[stage(down(), 10.0), stage(wide, 20.0)], &[0.0; 4]).expect("a motion");
    near(found.stages[1].steady[0], 0.0809, 1e-4);
    near(found.stages[1].steady[1], 0.0859, 1e-4);
    assert_eq!(found.t.len() * 4, found.states.len());
    assert_eq!(found.t.len(), found.inputs.len());
    assert!(found.t.windows(2).all(|w| w[1] > w[0]));
    let short = [stage(down(), 10.0), stage(down(), 5.0)];
    assert!(track(&hanging(), &short, &[0.0; 4]).is_err() && track(&hanging(), &[], &[0.0; 4]).is_err());
}

#[test]
fn the_cost_by_simulation_is_that_of_the_prototype() {
    let task = Task {
        deviation: vec![0.02, 0.2, 0.0, 0.0],
        weights: vec![5.0, 1.0, 0.0, 0.0],
        steady_weights: Vec::new(),
        steady_from: 0.0,
        t_end: 10.0,
        dt: 2e-3,
        harmonics: vec![0],
    };
    let cost = SimulationCost::new(&hanging(), &down(), task.clone()).expect("a cost");
    near(cost.evaluate(&[69.69, -2.01, 19.62, 6.54]), 0.2292, 1e-3);
    near(cost.evaluate(&[872.59, -8.88, 13.6, 1.2]), 0.1446, 1e-3);
    assert_eq!(cost.evaluate(&[-1e6, 0.0, 0.0, 0.0]), f64::INFINITY);
    assert!(SimulationCost::new(&hanging(), &down(), Task { weights: vec![1.0], ..task.clone() }).is_err());
    let (value, slope) = cost.with_gradient(&[69.69, -2.01, 19.62, 6.54]);
    near(value, cost.evaluate(&[69.69, -2.01, 19.62, 6.54]), 1e-12);
    for k in 0..4 {
        let at = |h: f64| {
            let mut gain = [69.69, -2.01, 19.62, 6.54];
            gain[k] += h;
            cost.evaluate(&gain)
        };
        near(slope[k], (at(1e-4) - at(-1e-4)) / 2e-4, 1e-8);
    }
    // The mean given as a second harmonic that is zero changes nothing.
    let two = SimulationCost::new(&hanging(), &down(), Task { harmonics: vec![0, 2], ..task }).expect("a cost");
    let mut wide = [0.0; 12];
    wide[..4].copy_from_slice(&[69.69, -2.01, 19.62, 6.54]);
    near(two.evaluate(&wide), cost.evaluate(&wide[..4]), 1e-12);
    wide[4..].copy_from_slice(&[1.0, 2.0, 3.0, 4.0, 0.5, -1.0, 0.25, 2.0]);
    let gain = two.gain(&wide).expect("a gain");
    let (sin, cos) = (2.0 * DOWN * 0.15).sin_cos();
    near(gain.value(0.15)[0], 69.69 + cos - 0.5 * sin, 1e-12);
}

#[test]
fn design_by_simulation_finds_what_the_thesis_found() {
    let task = Task {
        deviation: vec![0.02, 0.2, 0.0, 0.0],
        weights: vec![5.0, 1.0, 0.0, 0.0],
        steady_weights: Vec::new(),
        steady_from: 0.0,
        t_end: 10.0,
        dt: 1e-2,
        harmonics: vec![0],
    };
    let cost = SimulationCost::new(&hanging(), &down(), task).expect("a cost");
    let found = design_by_simulation(&cost, &Search::default()).expect("a gain");
    // 0.1446 is printed, 0.1430 the best known: nearly flat in the gain of the cart, so anything between is as good.
    let value = found.figure("cost").expect("a cost");
    assert!(value < 0.146, "{found:?}");
    assert!(found.figure("norm").expect("a norm") <= 1000.0 * (1.0 + 1e-9));
    assert!(design_by_simulation(&cost, &Search { limit: -1.0, ..Search::default() }).is_err());
}

#[test]
fn a_periodic_gain_closes_as_it_is_written() {
    let (model, reference) = (inverted(), true_up());
    let c = |re, im| crate::numeric::Complex::new(re, im);
    let zero = c(0.0, 0.0);
    let lines = [c(300.0, 0.0), c(20.0, 0.0), c(40.0, 0.0), c(3.0, 0.0), zero, zero, zero, zero];
    let second = [c(5.0, -2.0), c(1.0, 4.0), c(0.5, 0.0), c(0.0, 0.7)];
    let gain = FourierSeries::new(0.2, 4, [&lines[..], &second[..]].concat()).expect("a gain");
    let system = close(&model, &reference, &gain).expect("a loop").compile();
    let plant = model.compile();
    let (x, t) = ([0.01, PI + 0.05, 0.3, -0.8], 0.137);
    let mut u = reference.inputs.value(t)[0];
    let (k, z) = (gain.value(t), reference.states.value(t));
    for c in 0..4 {
        u -= k[c] * (x[c] - z[c]);
    }
    let (mut closed, mut open) = ([0.0; 4], [0.0; 4]);
    system.flow(0, crate::model::Point { t, x: &x, u: &[], p: system.parameters() }, &mut closed);
    plant.flow(0, crate::model::Point { t, x: &x, u: &[u], p: plant.parameters() }, &mut open);
    for (a, b) in closed.iter().zip(open) {
        near(*a, b, 1e-12 * b.abs().max(1.0));
    }
}

#[test]
fn several_inputs_are_closed_and_the_others_stay_free() {
    let text = r#"
        name = "three pushes"
        [states]
        a = { value = 0.0 }
        b = { value = 0.0 }
        [inputs]
        one = {}
        two = {}
        three = {}
        [flow]
        a = "b + one"
        b = "-a + 2*two + three*a"
        [outputs]
        a = "a"
    "#;
    let model = Model::from_toml(text, "test").expect("a model");
    let states = FourierSeries::constant(1.0, &[0.5, -0.25]).expect("states");
    let inputs = FourierSeries::constant(1.0, &[0.1, 0.0, 0.0]).expect("inputs");
    let system = model.compile();
    let reference = Reference::new(&system, system.parameters(), 0, states, inputs).expect("a reference");
    let gain = FourierSeries::constant(1.0, &[0.0, 0.0, 3.0, 4.0, 0.0, 0.0]).expect("a gain");
    let closed = close(&model, &reference, &gain).expect("a loop");
    assert_eq!(closed.inputs(), ["three"]);
    assert_eq!(closed.outputs(), ["a", "input one", "input two"]);
    let system = closed.compile();
    let mut rates = [0.0; 2];
    let at = crate::model::Point { t: 0.3, x: &[1.0, 2.0], u: &[0.7], p: system.parameters() };
    system.flow(0, at, &mut rates);
    near(rates[0], 2.0 + 0.1, 1e-14);
    near(rates[1], -1.0 + 2.0 * -(3.0 * 0.5 + 4.0 * 2.25) + 0.7, 1e-13);
}

#[test]
fn what_does_not_fit_is_refused() {
    let (model, reference) = (inverted(), true_up());
    let three = FourierSeries::constant(0.2, &[1.0; 3]).expect("a gain");
    assert!(close(&model, &reference, &three).is_err_and(|e| e.to_string().contains("gain")));
    let c = crate::numeric::Complex::new(1.0, 0.0);
    let other = FourierSeries::new(0.3, 4, vec![c; 8]).expect("a gain");
    assert!(close(&model, &reference, &other).is_err_and(|e| e.to_string().contains("period")));
    let gain = gain(UP, [1.0; 4]);
    let bad = |options: Options| certify(&model, &reference, &gain, &options).is_err();
    assert!(bad(Options { truncation: 0, ..Options::default() }));
    assert!(bad(Options { deviations: vec![vec![0.0; 3]], ..Options::default() }));
    assert!(bad(Options { spread: vec![(99, 0.1)], ..Options::default() }));
    // An input that nothing moves stays one.
    let rest = FourierSeries::constant(0.2, &[0.0]).expect("no input");
    let idle = Reference { inputs: rest, ..reference.clone() };
    let none = FourierSeries::constant(0.2, &[0.0; 4]).expect("no gain");
    assert_eq!(close(&model, &idle, &none).expect("a loop").inputs(), ["V"]);
}
