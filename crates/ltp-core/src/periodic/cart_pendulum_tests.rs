//! Tests on the inverted cart-pendulum of Duyul (2018) along its true orbit: lifted modes, pumping frequency, bandwidth.

use super::modes::LiftedMode;
use super::{Entry, LtpSystem, Size};
use crate::numeric::Complex;
use crate::numeric::eigen::eigenvalues_complex;
use crate::numeric::fourier_series::FourierSeries;
use std::f64::consts::{PI, TAU};

/// Gain of Table 4.3 of the thesis.
const TABLE_4_3: [f64; 4] = [397.1, 216.2, 47.5, -17.6];

/// A(t), B(t) of equations (3.1), (3.2), (3.10) with K_s = 0.74 along `theta = pi + amplitude sin(10 pi t)`; the acceleration
/// of the cart follows from (3.2), and A knows of force and speed of the cart no more than that.
pub(super) fn inverted(amplitude: f64) -> LtpSystem {
    let w = 10.0 * PI;
    LtpSystem::smooth(TAU / w, Size { nx: 4, nu: 1, ny: 0 }, |t, entry| {
        let (m, total, inertia, g, b_p, k_s) = (0.063, 0.78, 0.0252, 9.8, 0.05, 0.74);
        let (damping, motor) = (4.3 + 7.723_560_9, 1.723_538_2);
        let theta = PI + amplitude * (w * t).sin();
        let (rate, acceleration) = (amplitude * w * (w * t).cos(), -amplitude * w * w * (w * t).sin());
        let (s, c) = theta.sin_cos();
        let cart = -(inertia * acceleration + m * g * s + b_p * rate + k_s * (theta - PI)) / (m * c);
        let determinant = total * inertia - (m * c).powi(2);
        // Columns of the right-hand sides by theta, cart speed, rate and voltage, then the inverse of the mass matrix.
        let columns = [
            (m * c * rate * rate + m * s * acceleration, -m * g * c - k_s + m * s * cart),
            (-damping, 0.0),
            (2.0 * m * s * rate, -b_p),
            (motor, 0.0),
        ];
        let [a, b, d, v] =
            columns.map(|(f, h)| ((inertia * f - m * c * h) / determinant, (total * h - m * c * f) / determinant));
        match entry {
            Entry::A => vec![0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, a.0, b.0, d.0, 0.0, a.1, b.1, d.1],
            Entry::B => vec![0.0, 0.0, v.0, v.1],
            _ => vec![],
        }
    })
    .expect("cart-pendulum")
}

fn closed() -> LtpSystem {
    let system = inverted(0.1);
    system.closed(&FourierSeries::constant(system.period(), &TABLE_4_3).expect("gain")).expect("closed")
}

fn largest(modes: &[LiftedMode], chosen: impl Fn(&LiftedMode) -> bool) -> f64 {
    modes.iter().filter(|m| chosen(m)).map(|m| m.value.re).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn central_modes_agree_with_floquet_and_those_of_the_edge_are_flagged() {
    let system = closed();
    let exact = system.exponents().expect("exponents");
    assert!((exact[0].re + 0.0220).abs() < 1e-4, "{exact:?}");
    for truncation in 2..=20 {
        let modes = system.lifted_modes(truncation).expect("modes");
        assert_eq!(modes.len(), 4 * (2 * truncation + 1));
        // What an unflagged search would optimise, and what is true.
        assert!((largest(&modes, |_| true) + 0.0130).abs() < 5e-5, "{truncation}");
        assert!((largest(&modes, |m| m.converged) - exact[0].re).abs() < 5e-6, "{truncation}");
        for (i, exponent) in exact.iter().enumerate() {
            let found = modes.iter().filter(|m| m.converged && m.exponent == i);
            let nearest = found.map(|m| m.distance).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-5 * exponent.norm(), "{truncation}: {exponent} {nearest:e}");
        }
        // The eigenvectors, which know nothing of Floquet, say the same.
        for m in &modes {
            assert_eq!(m.converged, m.edge < 0.5, "{truncation}: {m:?}");
        }
        // Each copy once; the artefacts are as many as the two families of blocks have edges.
        let artefacts = modes.iter().filter(|m| !m.converged).count();
        assert_eq!(artefacts, 16, "{truncation}");
    }
}

#[test]
fn the_true_pumping_frequency_is_twice_that_of_the_orbit() {
    let system = closed();
    assert_eq!(system.pumping_divisor(), 2);
    let half = system.shortened().expect("shortened");
    assert!((half.period() - 0.1).abs() < 1e-15);
    let eigenvalues = |m: Vec<Complex>, n: usize| eigenvalues_complex(&m, n).expect("eigenvalues");
    let all = eigenvalues(system.lift(2).expect("lift"), 20);
    // Blocks -2, 0, 2 and -1, 1 of the lift do not know each other.
    let lift = system.lift(2).expect("lift");
    let part = |blocks: &[usize]| -> Vec<Complex> {
        let rows: Vec<usize> = blocks.iter().flat_map(|b| 4 * b..4 * b + 4).collect();
        rows.iter().flat_map(|&r| rows.iter().map(move |&c| (r, c))).map(|(r, c)| lift[r * 20 + c]).collect()
    };
    let even = eigenvalues(part(&[0, 2, 4]), 12);
    let odd = eigenvalues(part(&[1, 3]), 8);
    let shortened = eigenvalues(half.lift(1).expect("lift"), 12);
    let near = |v: &Complex, set: &[Complex]| set.iter().map(|s| (s - v).norm()).fold(f64::INFINITY, f64::min);
    let union: Vec<Complex> = even.iter().chain(&odd).copied().collect();
    let worst = all.iter().map(|v| near(v, &union)).fold(0.0, f64::max);
    let same = shortened.iter().map(|v| near(v, &even)).fold(0.0, f64::max);
    assert!(worst < 1e-11 && same < 1e-11, "{worst} {same}");
    let back: Vec<Complex> = half.multipliers().iter().map(|m| m * m).collect();
    assert!(system.multipliers().iter().all(|m| near(m, &back) < 1e-12));
}

#[test]
fn the_bandwidth_says_which_truncation_suffices() {
    let system = inverted(0.1);
    let found = [1e-1, 1e-3, 1e-6].map(|share| system.bandwidth(share).expect("bandwidth"));
    assert!(found.is_sorted() && found[0] == 2 && found[2] <= 8, "{found:?}");
    let error = system.check_truncation(0).expect_err("too low").to_string();
    assert!(error.contains("truncation = 0: expected at least"), "{error}");
    assert!(system.lifted_modes(0).is_err() && system.check_truncation(2).is_ok(), "{found:?}");
    assert!(system.bandwidth(0.0).is_err());
}
