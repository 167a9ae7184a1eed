//! Tests of the transverse linearization, on systems made from a known `x = P(t) z`, `z' = L z` with a phase mode in `L`.

use nalgebra::DMatrix;
use std::f64::consts::TAU;

use super::{Entry, LtpSystem, Size};
use crate::error::Error;
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;

const T: f64 = 1.3;

/// The system of `P`, its derivative and `L`, with B = (1, 2, ..), C = I; its tangent is the first column of P.
fn made(n: usize, p: impl Fn(f64) -> (DMatrix<f64>, DMatrix<f64>), l: &DMatrix<f64>) -> (LtpSystem, FourierSeries) {
    let system = LtpSystem::smooth(T, Size { nx: n, nu: 1, ny: n }, |t, entry| {
        let (p, slope) = p(t);
        match entry {
            Entry::A => {
                let a = (slope + &p * l) * p.try_inverse().expect("regular");
                a.transpose().iter().copied().collect()
            }
            Entry::B => (1..=n).map(|i| i as f64).collect(),
            Entry::C => DMatrix::<f64>::identity(n, n).iter().copied().collect(),
            Entry::D => vec![0.0; n],
        }
    })
    .expect("system");
    let samples: Vec<f64> =
        (0..64).flat_map(|i| p(T * f64::from(i) / 64.0).0.column(0).iter().copied().collect::<Vec<_>>()).collect();
    (system, FourierSeries::from_samples(T, n, &samples).expect("tangent"))
}

/// A tangent on a cone: its frame comes back turned.
fn cone() -> (LtpSystem, FourierSeries, [f64; 2]) {
    let tilt = DMatrix::from_row_slice(3, 3, &[0.6, 0.0, 0.8, 0.0, 1.0, 0.0, -0.8, 0.0, 0.6]);
    let l = DMatrix::from_row_slice(3, 3, &[0.0, 0.3, -0.5, 0.0, -0.4, 1.1, 0.0, 0.0, -1.5]);
    let p = move |t: f64| {
        let (s, c) = (TAU * t / T).sin_cos();
        let w = TAU / T;
        let turn = DMatrix::from_row_slice(3, 3, &[c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0]);
        let slope = DMatrix::from_row_slice(3, 3, &[-w * s, -w * c, 0.0, w * c, -w * s, 0.0, 0.0, 0.0, 0.0]);
        (turn * &tilt, slope * &tilt)
    };
    let (system, tangent) = made(3, p, &l);
    (system, tangent, [-0.4, -1.5])
}

/// Four states, an orbit that turns in all of them, a pair and a real exponent across.
fn four() -> (LtpSystem, FourierSeries, Vec<Complex>) {
    let mut l = DMatrix::<f64>::zeros(4, 4);
    for (i, j, v) in [(0, 1, 0.2), (0, 3, 0.7), (1, 1, -0.3), (1, 2, 2.0), (2, 1, -2.0), (2, 2, -0.3), (3, 3, 0.4)] {
        l[(i, j)] = v;
    }
    let p = |t: f64| {
        let w = TAU / T;
        let (mut p, mut slope) = (DMatrix::<f64>::identity(4, 4), DMatrix::<f64>::zeros(4, 4));
        for i in 0..4 {
            for j in 0..4 {
                let (k, phase) = (f64::from((i + 2 * j) % 3) + 1.0, 0.7 * f64::from(i) - 1.3 * f64::from(j));
                let at = (i as usize, j as usize);
                p[at] += 0.2 * (k * w * t + phase).sin();
                slope[at] += 0.2 * k * w * (k * w * t + phase).cos();
            }
        }
        (p, slope)
    };
    let (system, tangent) = made(4, p, &l);
    let across = [Complex::new(0.4, 0.0), Complex::new(-0.3, 2.0), Complex::new(-0.3, -2.0)];
    (system, tangent, across.to_vec())
}

#[test]
fn all_exponents_but_that_of_the_phase_stand_across() {
    let (three, cone_tangent, cone_rates) = cone();
    let (wide, four_tangent, four_rates) = four();
    let real: Vec<Complex> = cone_rates.iter().map(|&r| Complex::from(r)).collect();
    for (system, tangent, expected) in [(three, cone_tangent, real), (wide, four_tangent, four_rates)] {
        let n = system.size().nx;
        for tangent in [Some(&tangent), None] {
            let across = system.transverse(tangent).expect("transverse");
            assert!(across.defect < 1e-9 && across.warnings.is_empty(), "{} {:?}", across.defect, across.warnings);
            assert_eq!(across.system.size(), Size { nx: n - 1, nu: 1, ny: n });
            for (found, expected) in across.system.exponents().expect("exponents").iter().zip(&expected) {
                assert!((found - expected).norm() < 1e-9, "{found} {expected}");
            }
            // The frame is orthonormal, stands across the tangent, and obeys its equation.
            for t in [0.0, 0.21, 0.9, 1.29] {
                let z = DMatrix::from_row_slice(n, n - 1, &across.frame.value(t));
                let slope = DMatrix::from_row_slice(n, n - 1, &across.frame.derivative().value(t));
                assert!((z.transpose() * &z - DMatrix::identity(n - 1, n - 1)).norm() < 1e-11);
                let q = DMatrix::from_vec(n, 1, across.tangent.value(t));
                assert!((z.transpose() * &q).norm() < 1e-10 * q.norm());
                let a = DMatrix::from_row_slice(n, n, &system.matrix(Entry::A, t));
                let own = DMatrix::from_row_slice(n - 1, n - 1, &across.system.matrix(Entry::A, t));
                assert!((z.transpose() * (a * &z - slope) - own).norm() < 1e-8, "{t}");
            }
        }
    }
}

#[test]
fn a_gain_across_moves_the_exponents_of_the_whole_and_leaves_the_phase() {
    let (system, tangent, _) = four();
    let across = system.transverse(Some(&tangent)).expect("transverse");
    let c = |re, im| Complex::new(re, im);
    let gain =
        FourierSeries::new(T, 3, vec![c(0.5, 0.0), c(-0.2, 0.0), c(1.0, 0.0), c(0.1, 0.2), c(0.0, 0.3), c(-0.1, 0.0)])
            .expect("gain");
    let narrow = across.system.closed(&gain).expect("closed").exponents().expect("exponents");
    let whole = system.closed(&across.gain(&gain).expect("lifted")).expect("closed").exponents().expect("exponents");
    for exponent in &narrow {
        let nearest = whole.iter().map(|e| (e - exponent).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-8, "{exponent} of {narrow:?} in {whole:?}");
    }
    assert!(whole.iter().any(|e| e.norm() < 1e-8), "{whole:?}");
    let short = FourierSeries::constant(T, &[1.0, 2.0]).expect("constant");
    assert!(matches!(across.gain(&short), Err(Error::Shape { expected: 3, found: 2, .. })));
}

#[test]
fn a_tangent_that_cannot_be_is_refused_and_one_that_is_no_motion_is_doubted() {
    let (system, tangent, _) = cone();
    let c = |re, im| Complex::new(re, im);
    assert!(matches!(
        system.transverse(Some(&FourierSeries::constant(T, &[1.0]).expect("short"))),
        Err(Error::Shape { expected: 3, found: 1, .. })
    ));
    let other = FourierSeries::new(2.0 * T, 3, tangent.coefficients().to_vec()).expect("other period");
    assert!(matches!(system.transverse(Some(&other)), Err(Error::OutOfRange { .. })));
    let zero = c(0.0, 0.0);
    let line = FourierSeries::new(T, 3, vec![zero, zero, zero, c(0.5, 0.0), zero, zero]).expect("line");
    let still = system.transverse(Some(&line)).expect_err("vanishes").to_string();
    assert!(still.contains("smallest length of the tangent"), "{still}");
    let fixed = FourierSeries::constant(T, &[1.0, 0.0, 0.0]).expect("fixed");
    let doubted = system.transverse(Some(&fixed)).expect("computed");
    assert!(doubted.defect > 1e-3 && doubted.warnings.len() == 1);
    let clocked = super::cart_pendulum_tests::inverted(0.1)
        .closed(&FourierSeries::constant(0.2, &[100.0, 50.0, 10.0, 0.0]).expect("gain"));
    let refused = clocked.expect("closed").transverse(None).expect_err("no phase").to_string();
    assert!(refused.contains("no Floquet multiplier is one"), "{refused}");
}
