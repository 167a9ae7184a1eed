//! The references of the thesis, and what cannot be one. Figures: Duyul 2018 as recomputed by hand, see docs/certificate.md.

use super::*;
use crate::model::zoo;
use std::f64::consts::PI;

fn hanging() -> Model {
    zoo("cart_pendulum").expect("zoo")
}

fn inverted() -> Model {
    hanging().with_parameters(&[("K_s", 0.74, None)]).expect("a stiffer spring")
}

fn sine(amplitude: f64, phase: f64, offset: f64) -> Sinusoid {
    Sinusoid { amplitude, phase, offset }
}

/// Amplitude (with the sign that brings the phase nearest to zero) and phase of the first harmonic as a sine.
fn first(series: &FourierSeries, row: usize) -> (f64, f64) {
    let c = series.coefficient(1).expect("a first harmonic")[row] * Complex::new(0.0, 2.0);
    let (amplitude, phase) = c.to_polar();
    if phase.abs() > 0.5 * PI { (-amplitude, phase - PI * phase.signum()) } else { (amplitude, phase) }
}

#[test]
fn the_hanging_reference_of_the_thesis() {
    let system = hanging().compile();
    let p = system.parameters().to_vec();
    for (x, omega, amplitude, phase) in [(0.05, 2.0 * PI, -0.24716, 0.68050), (0.07, 2.0 * PI, -0.33862, 0.66859)] {
        let wanted = sine(x, 0.0, 0.0).series(omega).expect("a sine");
        let found = feedforward(&system, &p, 0, &wanted, &Options::default()).expect("a reference");
        let theta = first(&found.states, 1);
        assert!((theta.0 - amplitude).abs() < 6e-6 && (theta.1 - phase).abs() < 6e-6, "{theta:?}");
        assert!(found.defect.iter().all(|d| *d < 1e-10), "{:?}", found.defect);
    }
}

#[test]
fn the_inverted_reference_is_another_one_than_printed() {
    let model = inverted();
    let system = model.compile();
    let p = system.parameters().to_vec();
    let omega = 10.0 * PI;
    let wanted = sine(0.1, 0.0, PI).series(omega).expect("a sine");
    let found = feedforward(&system, &p, 1, &wanted, &Options::default()).expect("a reference");
    let (x, v) = (first(&found.states, 0), first(&found.inputs, 0));
    assert!((x.0 - 0.04003).abs() < 5e-6 && (x.1 + 0.06323).abs() < 6e-6, "{x:?}");
    let v = if v.0 < 0.0 { (-v.0, v.1 + PI) } else { v };
    assert!((v.0 - 16.8837).abs() < 5e-4 && (v.1 - 2.5161).abs() < 5e-4, "{v:?}");
    // The cart's place is open, and stays where it was.
    assert!(found.states.coefficients()[0].norm() < 1e-12);
    assert!(found.defect.iter().all(|d| *d < 1e-10), "{:?}", found.defect);
}

#[test]
fn sinusoids_get_their_rates_and_the_input_of_the_equation_it_acts_in() {
    let model = inverted();
    let omega = 10.0 * PI;
    let given = [(0, sine(0.0375, -0.0769, 0.0)), (1, sine(0.1, 0.0, PI))];
    let found = Reference::of_sinusoids(&model, omega, &given, 0, &[]).expect("a reference");
    let v = first(&found.inputs, 0);
    let v = if v.0 < 0.0 { (-v.0, v.1 + PI) } else { v };
    assert!((v.0 - 15.6614).abs() < 6e-4 && (v.1 - 2.4914).abs() < 1e-4, "{v:?}");
    assert_eq!(found.states.select(&[2]), found.states.select(&[0]).derivative());
    // (3.1) is balanced; (3.2) is not, by 6.5 % of the inertia torque.
    assert!(found.defect[0] < 1e-14 && found.defect[3] > 0.05, "{:?}", found.defect);
    let hanging = Reference::of_sinusoids(
        &self::hanging(),
        2.0 * PI,
        &[(0, sine(0.05, 0.0, 0.0)), (1, sine(-0.2472, 0.6809, 0.0))],
        0,
        &[],
    )
    .expect("a reference");
    let v = first(&hanging.inputs, 0);
    assert!((v.0.abs() - 2.4923).abs() < 5e-4, "{v:?}");
}

#[test]
fn what_cannot_be_a_reference_is_refused() {
    let model = inverted();
    let system = model.compile();
    let p = system.parameters().to_vec();
    let wanted = |offset| sine(0.1, 0.0, offset).series(10.0 * PI).expect("a sine");
    let solve = |coordinate, offset, options: Options| feedforward(&system, &p, coordinate, &wanted(offset), &options);
    // The pendulum cannot hang in the air at a mean of one radian: no cart motion holds it there.
    let lost = solve(1, 1.0, Options::default()).expect_err("no such motion");
    assert!(matches!(&lost, Error::NoConvergence { advice, .. } if advice.contains("the equation of `")), "{lost}");
    assert!(matches!(solve(7, PI, Options::default()), Err(Error::OutOfRange { .. })));
    assert!(matches!(solve(1, PI, Options { input: 1, ..Options::default() }), Err(Error::OutOfRange { .. })));
    assert!(matches!(solve(1, PI, Options { harmonics: 0, ..Options::default() }), Err(Error::OutOfRange { .. })));
    let start = Some(FourierSeries::constant(0.2, &[0.0; 3]).expect("a series"));
    assert!(matches!(solve(1, PI, Options { start, ..Options::default() }), Err(Error::Shape { .. })));
    let missing = Reference::of_sinusoids(&model, 1.0, &[(0, sine(0.1, 0.0, 0.0))], 0, &[]).expect_err("no theta");
    assert!(missing.to_string().contains("theta"), "{missing}");
    assert!(Reference::of_sinusoids(&model, -1.0, &[], 0, &[]).is_err());
    assert!(number("state", "thet", &["x", "theta"]).is_err_and(|e| e.to_string().contains("theta")));
}
