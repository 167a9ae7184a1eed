//! Tests of the lifted and of the exact objective: published eigenvalues, each other, differences.

use super::exact::Exact;
use super::law::Law;
use super::lifted::Lifted;
use super::spectrum::{Objective, Spectrum};
use super::testing::{UP, downward, inverted, inverted_printed};
use crate::numeric::Complex;
use crate::numeric::eigen::eigenvalues_complex;
use crate::periodic::{Entry, LtpSystem};

fn law(system: &LtpSystem, harmonics: &[usize]) -> Law {
    Law::new(1, 4, system.period(), harmonics).expect("a law")
}

fn lifted(system: &LtpSystem, harmonics: &[usize], n: usize) -> Objective {
    Objective::Lifted(Lifted::new(system, &law(system, harmonics), n).expect("a lift"))
}

fn exact(system: &LtpSystem, harmonics: &[usize]) -> Objective {
    Objective::Exact(Exact::new(system, &law(system, harmonics), None).expect("samples"))
}

/// The block Toeplitz matrix `A - N - B K_T` as it is printed, for a gain of any harmonics.
fn dense(system: &LtpSystem, law: &Law, x: &[f64], n: usize) -> Vec<Complex> {
    let (m, nx) = (2 * n + 1, 4);
    let mut out = system.lift(n).expect("a lift");
    let b = system.fourier(Entry::B, 2 * n);
    let gain = law.series(x).expect("a gain");
    let k = |h: isize| -> Vec<Complex> {
        let c = gain.coefficient(h.unsigned_abs()).map_or(vec![Complex::from(0.0); nx], <[_]>::to_vec);
        if h < 0 { c.iter().map(Complex::conj).collect() } else { c }
    };
    for i in 0..m {
        for j in 0..m {
            for l in 0..m {
                let k = k(l as isize - j as isize);
                for r in 0..nx {
                    for c in 0..nx {
                        out[(i * nx + r) * m * nx + j * nx + c] -= b[i + 2 * n - l][r] * k[c];
                    }
                }
            }
        }
    }
    out
}

const PRINTED: [f64; 4] = [69.69, -2.01, 19.62, 6.54];

#[test]
fn modes_are_the_eigenvalues_of_the_printed_matrix() {
    let periodic = [50.0, -20.0, 30.0, 5.0, 3.0, 1.0, -2.0, 0.5, -4.0, 0.0, 1.5, -0.3];
    for (system, harmonics, x) in [(downward(), vec![0], &PRINTED[..]), (inverted_printed(), vec![0, 2], &periodic)] {
        for n in [2, 3, 5] {
            let expected = eigenvalues_complex(&dense(&system, &law(&system, &harmonics), x, n), 4 * (2 * n + 1));
            let mut spectrum = Spectrum::default();
            lifted(&system, &harmonics, n).modes(x, &mut spectrum).expect("modes");
            assert_eq!(spectrum.modes.iter().map(|m| m.class).max(), Some(1), "even harmonics: two classes");
            for value in expected.expect("eigenvalues") {
                let nearest = spectrum.modes.iter().map(|m| (m.value - value).norm()).fold(f64::MAX, f64::min);
                assert!(nearest < 1e-9 * value.norm().max(1.0), "{n}: {value} {nearest:.1e}");
            }
        }
    }
}

#[test]
fn printed_gains_give_the_known_figures() {
    // research section 5: largest real part over the 20 x 20 lift, and exact
    let cases = [
        (downward(), PRINTED, -7.596, -7.595),
        (downward(), [81.75, 6.71, 19.99, 7.11], -6.790, -6.863),
        (inverted_printed(), [1000.5, 3.9, 5.4, -0.7], -0.2296, -0.2312),
        (inverted_printed(), [397.1490, 216.1851, 47.4926, -17.5772], -0.3904, -0.3906),
        (inverted(UP, UP, 0.1), [397.1490, 216.1851, 47.4926, -17.5772], -0.0130, -0.0220),
    ];
    for (system, gain, all, floquet) in cases {
        let mut spectrum = Spectrum::default();
        let digit = |a: f64, b: f64| (a - b).abs() < if b.abs() > 1.0 { 6e-4 } else { 6e-5 };
        let lift = lifted(&system, &[0], 2);
        let found = lift.abscissa(&gain, true, &mut spectrum, None).expect("modes");
        assert!(digit(found, all), "lifted {found} {all}");
        let central = lift.abscissa(&gain, false, &mut spectrum, None).expect("modes");
        let found = exact(&system, &[0]).abscissa(&gain, true, &mut spectrum, None).expect("modes");
        assert!(digit(found, floquet), "exact {found} {floquet}");
        assert!((central - found).abs() < 2e-4 * found.abs().max(0.3), "central {central} {found}");
    }
}

#[test]
fn derivatives_are_differences() {
    let periodic = [950.0, -320.0, 600.0, -250.0, 30.0, 10.0, -20.0, 5.0, -4.0, 40.0, 15.0, -3.0];
    let upright = inverted(UP, UP, 0.1);
    for (system, harmonics, x) in [(downward(), vec![0], PRINTED.to_vec()), (upright, vec![0, 2], periodic.to_vec())] {
        for objective in [lifted(&system, &harmonics, 2), exact(&system, &harmonics)] {
            let mut spectrum = Spectrum::default();
            objective.modes(&x, &mut spectrum).expect("modes");
            for mode in spectrum.modes.clone() {
                objective.modes(&x, &mut spectrum).expect("modes");
                let mut derivative = Vec::new();
                assert!(objective.derivative(&mode, &spectrum, &mut derivative));
                let size = derivative.iter().fold(0.0_f64, |m, d| m.max(d.norm()));
                for i in 0..x.len() {
                    let h = 1e-5 * x[i].abs().max(1.0);
                    let mut nearest = |step: f64| {
                        let mut moved = x.clone();
                        moved[i] += step;
                        objective.modes(&moved, &mut spectrum).expect("modes");
                        let values = spectrum.modes.iter().filter(|m| m.class == mode.class).map(|m| m.value);
                        values.min_by(|a, b| (a - mode.value).norm().total_cmp(&(b - mode.value).norm())).expect("one")
                    };
                    let difference = (nearest(h) - nearest(-h)) / (2.0 * h);
                    let error = (difference - derivative[i]).norm();
                    assert!(error < 2e-4 * size, "{mode:?} {i}: {error:.1e} of {size:.1e}");
                }
            }
        }
    }
}

#[test]
fn sampled_exponents_are_those_of_the_collocation() {
    let cases = [
        (downward(), vec![0], PRINTED.to_vec()),
        (downward(), vec![0], vec![938.0, 317.0, 129.0, 48.0]),
        (inverted(UP, UP, 0.1), vec![0], vec![999.0, -385.0, 681.0, -275.0]),
    ];
    for (system, harmonics, x) in cases {
        let mut spectrum = Spectrum::default();
        let found = exact(&system, &harmonics).abscissa(&x, true, &mut spectrum, None).expect("modes");
        let gain = law(&system, &harmonics).series(&x).expect("a gain");
        let expected = system.closed(&gain).and_then(|closed| closed.exponents()).expect("exponents")[0].re;
        assert!((found - expected).abs() < 1e-5 * expected.abs().max(1.0), "{found} {expected}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let system = inverted(UP, UP, 0.1);
    let error = Lifted::new(&system, &law(&system, &[0]), 0).expect_err("too low").to_string();
    assert!(error.contains("truncation = 0") && error.contains("at least 1"), "{error}");
    let error = Lifted::new(&system, &law(&system, &[0, 6]), 2).expect_err("too low").to_string();
    assert!(error.contains("at least 3"), "{error}");
    let wrong = Law::new(2, 4, 0.2, &[0]).expect("a law");
    assert!(Lifted::new(&system, &wrong, 2).is_err() && Exact::new(&system, &wrong, None).is_err());
}
