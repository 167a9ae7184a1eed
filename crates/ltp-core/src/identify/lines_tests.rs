//! Tests of the line-by-line estimate.

use super::*;
use crate::identify::testing::{multisine, noisy, recording, resonant};
use crate::identify::{self, Method, Orbit};
use crate::signal::Recording;

const DT: f64 = 0.01;
/// 200 periods of 0.5 s: the pumping frequency is line 200.
const N: usize = 10_000;
/// Odd lines that differ modulo 200 up to sign, up to 3 Hz.
const LINES: [usize; 12] = [5, 31, 57, 83, 109, 135, 161, 187, 211, 237, 263, 289];

fn options(harmonics: usize) -> identify::Options {
    let method = Method::Lines(Options::default());
    identify::Options { period: 0.5, harmonics, band: None, orbit: Orbit::Deviation, method }
}

fn estimate(records: &[Recording], harmonics: usize) -> Htf {
    identify::identify(records, &options(harmonics)).expect("an estimate")
}

fn figure(htf: &Htf, name: &str) -> f64 {
    htf.figures.iter().find(|(n, _)| n == name).map_or(f64::NAN, |(_, v)| *v)
}

#[test]
fn quotients_are_the_closed_form_to_rounding() {
    let system = resonant();
    let u = multisine(N, &LINES, 1);
    let y = system.respond(&u, 0.2, DT);
    let htf = estimate(&[recording(u, y, 0.2, DT)], 10);
    let expected: Vec<f64> = LINES.iter().map(|&b| b as f64 * TAU / 100.0).collect();
    assert!(htf.omega().iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9));
    assert!(system.error(&htf, 100.0) < 1e-11);
    assert!(figure(&htf, "even_distortion") < 1e-10 && figure(&htf, "odd_distortion") < 1e-10, "nothing is planted");
}

#[test]
fn planted_distortion_is_found_by_its_order() {
    let system = resonant();
    let u = multisine(N, &LINES, 2);
    let y = system.respond(&u, 0.0, DT);
    let rms = |x: &[f64]| stats::rms(x.iter().copied());
    let spoiled = |power: i32| {
        let extra: Vec<f64> = y.iter().map(|y| 1e-3 * y.powi(power)).collect();
        let y = y.iter().zip(&extra).map(|(y, e)| y + e).collect();
        let mean = extra.iter().sum::<f64>() / N as f64;
        let moving: Vec<f64> = extra.iter().map(|e| e - mean).collect();
        // Enough harmonics that all the lines of the distortion are looked at.
        (estimate(&[recording(u.clone(), y, 0.0, DT)], 12), rms(&moving))
    };
    let (squared, planted) = spoiled(2);
    let found = figure(&squared, "even_distortion");
    assert!((found / planted - 1.0).abs() < 0.01, "{found} {planted}");
    assert!(figure(&squared, "odd_distortion") < 1e-9);
    assert!(system.error(&squared, 100.0) < 1e-10, "even orders do not touch the estimate");
    let (cubed, planted) = spoiled(3);
    assert!(figure(&cubed, "even_distortion") < 1e-9);
    // Part of a cube falls on the excited lines themselves.
    let found = figure(&cubed, "odd_distortion");
    assert!((0.3..1.0).contains(&(found / planted)), "{found} {planted}");
}

#[test]
fn repetitions_give_the_noise_and_discs_that_cover() {
    let system = resonant();
    let (mut inside, mut all) = (0.0, 0.0);
    for seed in 0..20 {
        let once = multisine(N, &LINES, 3 + seed);
        let u: Vec<f64> = once.iter().chain(&once).copied().collect();
        let y = system.respond(&u, 0.0, DT);
        let htf = estimate(&[recording(noisy(&u, 0.02, 100 + seed), noisy(&y, 0.2, 200 + seed), 0.0, DT)], 2);
        assert_eq!(figure(&htf, "repetitions"), 2.0);
        assert!((figure(&htf, "noise_sd") / 0.2 - 1.0).abs() < 0.1);
        inside += system.coverage(&htf);
        all += 1.0;
    }
    // 1200 values, of which half are independent of the other half: three standard deviations.
    assert!((inside / all - 0.95).abs() < 0.03, "{}", inside / all);
}

#[test]
fn meeting_sources_are_refused_and_two_phases_tell_them_apart() {
    let system = resonant();
    // 105 and 95 meet: -95 + 200 = 105.
    let lines = [31, 95, 105, 161];
    let records: Vec<Recording> = (0..2)
        .map(|seed| {
            let u = multisine(N, &lines, 50 + seed);
            let y = system.respond(&u, 0.0, DT);
            recording(u, y, 0.0, DT)
        })
        .collect();
    let error = identify::identify(&records[..1], &options(3)).expect_err("sources meet").to_string();
    assert!(error.contains("0.9500 Hz") && error.contains("1.0500 Hz"), "{error}");
    assert!(system.error(&estimate(&records, 3), 100.0) < 1e-9);
}

#[test]
fn an_input_that_is_not_periodic_is_refused() {
    let system = resonant();
    let u = multisine(N, &(1..300).collect::<Vec<_>>(), 60);
    let y = system.respond(&u, 0.0, DT);
    let error = identify::identify(&[recording(u, y, 0.0, DT)], &options(2)).expect_err("dense").to_string();
    assert!(error.contains("floquet"), "{error}");
}

#[test]
fn lines_on_the_clock_are_left_out_and_counted() {
    let system = resonant();
    let u = multisine(N, &[31, 83, 200], 70);
    let y = system.respond(&u, 0.0, DT);
    let htf = estimate(&[recording(u, y, 0.0, DT)], 2);
    assert_eq!(htf.omega().len(), 2);
    assert!(htf.warnings.iter().any(|w| w.contains("1 excited lines")), "{:?}", htf.warnings);
}
