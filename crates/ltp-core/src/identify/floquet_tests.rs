//! Tests of the Floquet estimate against closed forms.

use super::*;
use crate::identify::testing::{Gain, Sandwich, multisine, noisy, recording, resonant};
use crate::identify::{self, Method, Orbit};
use crate::signal::Recording;
use std::f64::consts::TAU;

const DT: f64 = 0.01;
const PERIODS: usize = 200;

fn options(period: f64, harmonics: usize, own: Options) -> identify::Options {
    let band = Some(TAU * 3.0);
    identify::Options { period, harmonics, band, orbit: Orbit::Deviation, method: Method::Floquet(own) }
}

fn estimate(recordings: &[Recording], harmonics: usize) -> Htf {
    identify::identify(recordings, &options(0.5, harmonics, Options::default())).expect("an estimate")
}

/// A broad input that repeats after 200 periods: every line up to 3.2 Hz.
fn broad(seed: u64) -> Vec<f64> {
    let n = (PERIODS as f64 * 0.5 / DT) as usize;
    multisine(n, &(1..320).collect::<Vec<_>>(), seed)
}

fn figure(htf: &Htf, name: &str) -> f64 {
    htf.figures.iter().find(|(n, _)| n == name).map_or(f64::NAN, |(_, v)| *v)
}

#[test]
fn one_two_and_four_multipliers_are_found_and_the_functions_with_them() {
    let gains = (Gain { depth: 0.6, phase: 0.4 }, Gain { depth: 0.8, phase: -1.1 });
    let with = |modes| Sandwich { period: 0.5, before: gains.0, after: gains.1, modes };
    let cases = [
        (with(vec![(2.0, 3.0, f64::INFINITY)]), 1.0, 1e-4),
        (resonant(), 2.0, 1e-4),
        (with(vec![(40.0, 7.0, 0.08), (30.0, 15.0, 0.05)]), 4.0, 1e-3),
    ];
    for (system, order, bound) in cases {
        let u = broad(1);
        let y = system.respond(&u, 0.0, DT);
        let htf = estimate(&[recording(u, y, 0.0, DT)], 3);
        assert_eq!(figure(&htf, "order"), order, "{:?}", htf.figures);
        let error = system.error(&htf, TAU * 3.0);
        assert!(error < bound, "order {order}: error {error}");
        for truth in system.multipliers() {
            let found = (1..=order as usize).map(|i| {
                Complex::new(figure(&htf, &format!("multiplier{i}_re")), figure(&htf, &format!("multiplier{i}_im")))
            });
            let distance = found.map(|m| (m - truth).norm()).fold(f64::INFINITY, f64::min);
            assert!(distance < bound, "multiplier {truth} missed by {distance}");
        }
    }
}

#[test]
fn a_system_with_short_memory_has_no_multipliers() {
    // Time constant of a fiftieth of the period: e^-50 of an answer is left after one period.
    let gains = (Gain { depth: 0.6, phase: 0.4 }, Gain { depth: 0.8, phase: -1.1 });
    let system = Sandwich { period: 0.5, before: gains.0, after: gains.1, modes: vec![(2.0, 100.0, f64::INFINITY)] };
    let u = broad(1);
    let y = noisy(&system.respond(&u, 0.0, DT), 1e-3, 4);
    let htf = estimate(&[recording(u, y, 0.0, DT)], 3);
    assert_eq!(figure(&htf, "order"), 0.0);
    assert!(system.error(&htf, TAU * 3.0) < 0.02);
}

#[test]
fn records_may_begin_anywhere_on_the_clock_and_away_from_rest() {
    let system = resonant();
    let mut records = Vec::new();
    for (i, t0) in [0.13, 7.31].into_iter().enumerate() {
        let u = broad(2 + i as u64);
        let ring = system.ring(3.0, t0, DT, u.len());
        let y = system.respond(&u, t0, DT).iter().zip(&ring).map(|(y, r)| y + r).collect();
        records.push(recording(u, y, t0, DT));
    }
    let with = system.error(&estimate(&records, 3), TAU * 3.0);
    let without = Options { transients: false, ..Options::default() };
    let leaking = identify::identify(&records, &options(0.5, 3, without)).expect("an estimate");
    let without = system.error(&leaking, TAU * 3.0);
    assert!(with < 1e-4, "{with}");
    assert!(without > 30.0 * with, "leakage must show, or this test tests nothing: {without} {with}");
}

#[test]
fn a_cut_record_is_a_record_that_begins_away_from_rest() {
    // 130.7 of 200 periods: neither the input nor the response repeats in what is left.
    let system = resonant();
    let u = broad(5);
    let y = system.respond(&u, 0.0, DT);
    let cut = recording(u, y, 0.0, DT).slice(11.17, 11.17 + 130.7 * 0.5).expect("samples");
    let error = system.error(&estimate(&[cut], 3), TAU * 2.5);
    assert!(error < 1e-3, "{error}");
}

#[test]
fn periods_need_not_be_whole_samples() {
    let system = Sandwich { period: 0.503_217, ..resonant() };
    let n = 20_000;
    // The response repeats only with a whole number of periods: zero input at the end, and rest when the record ends.
    let mut u = multisine(n, &(1..640).collect::<Vec<_>>(), 6);
    u.iter_mut().enumerate().for_each(|(i, u)| {
        *u *= (std::f64::consts::PI * i as f64 / 15_000.0).sin().max(0.0).powi(2) * f64::from(u8::from(i < 15_000))
    });
    let y = system.respond(&u, 0.0, DT);
    let htf = identify::identify(&[recording(u, y, 0.0, DT)], &options(0.503_217, 3, Options::default()))
        .expect("an estimate");
    let error = system.error(&htf, TAU * 3.0);
    assert!(error < 1e-3, "{error}");
}

#[test]
fn an_orbit_in_the_output_is_left_out() {
    let system = resonant();
    let u = broad(7);
    let orbit = |i: usize| {
        let angle = TAU * (i as f64 * DT / 0.5).fract();
        5.0 + 30.0 * angle.cos() + 10.0 * (2.0 * angle + 1.0).cos() + 4.0 * (3.0 * angle).sin()
    };
    let y: Vec<f64> = system.respond(&u, 0.0, DT).iter().enumerate().map(|(i, y)| y + orbit(i)).collect();
    let record = [recording(u, y, 0.0, DT)];
    let removed = identify::Options { orbit: Orbit::Removed, ..options(0.5, 3, Options::default()) };
    let error = system.error(&identify::identify(&record, &removed).expect("an estimate"), TAU * 3.0);
    assert!(error < 1e-3, "{error}");
    let kept = options(0.5, 3, Options { order: Some(2), ..Options::default() });
    let spoiled = system.error(&identify::identify(&record, &kept).expect("an estimate"), TAU * 3.0);
    assert!(spoiled > 10.0 * error, "{spoiled} {error}");
}

#[test]
fn two_inputs_and_two_outputs_share_their_multipliers() {
    let gains = [Gain { depth: 0.6, phase: 0.4 }, Gain { depth: 0.3, phase: 1.0 }];
    let part = |i: usize, j: usize| Sandwich {
        period: 0.5,
        before: gains[i],
        after: gains[1 - j],
        modes: vec![(40.0 - 25.0 * (i + j) as f64, 7.0, 0.08)],
    };
    let u = [broad(8), broad(9)];
    let y = |j: usize| -> Vec<f64> {
        let parts: Vec<Vec<f64>> = (0..2).map(|i| part(i, j).respond(&u[i], 0.0, DT)).collect();
        parts[0].iter().zip(&parts[1]).map(|(a, b)| a + b).collect()
    };
    let names = |letter: &str| vec![format!("{letter}1"), format!("{letter}2")];
    let t = (0..u[0].len()).map(|i| i as f64 * DT).collect();
    let record = Recording::new("run", t, u.to_vec(), vec![y(0), y(1)], names("u"), names("y")).expect("a recording");
    let htf = estimate(&[record], 2);
    assert_eq!(figure(&htf, "order"), 2.0);
    let mut worst: f64 = 0.0;
    for (i, &omega) in htf.omega().iter().enumerate() {
        for (k, (input, output)) in (-2..=2).flat_map(|k| [(0, 0), (0, 1), (1, 0), (1, 1)].map(|p| (k, p))) {
            let error = htf.value(k, i, output, input) - part(input, output).htf(k, omega);
            worst = worst.max(error.norm());
        }
    }
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn discs_of_95_percent_hold_the_truth_95_times_of_100() {
    let system = resonant();
    let mut covered = Vec::new();
    let mut sum = 0.0;
    for seed in 0..12 {
        let u = broad(20 + seed);
        let y = system.respond(&u, 0.0, DT);
        let (su, sy) = (0.05, 0.1 * crate::numeric::stats::rms(y.iter().copied()));
        let htf = estimate(&[recording(noisy(&u, su, 40 + seed), noisy(&y, sy, 60 + seed), 0.0, DT)], 2);
        assert_eq!(figure(&htf, "order"), 2.0);
        covered.push(system.coverage(&htf));
        sum += system.error(&htf, TAU * 3.0);
    }
    let mean = covered.iter().sum::<f64>() / 12.0;
    assert!((0.92..=0.98).contains(&mean), "{mean}: {covered:?}");
    assert!(sum / 12.0 < 0.1, "{}", sum / 12.0);
}

#[test]
fn harmonics_that_are_not_there_are_called_invisible() {
    let system = resonant();
    let u = broad(30);
    let y = noisy(&system.respond(&u, 0.0, DT), 0.05, 31);
    let htf = estimate(&[recording(u, y, 0.0, DT)], 6);
    assert!(htf.warnings.iter().any(|w| w.contains("harmonics 3 to 6")), "{:?}", htf.warnings);
    let sd = htf.sd().expect("standard deviations");
    // What is claimed about them is small as well.
    let middle = htf.omega().len() / 2;
    assert!(htf.value(5, middle, 0, 0).norm() < 3.0 * sd[htf.index(5, middle, 0, 0)] + 1e-6);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let system = resonant();
    let u = broad(33);
    let y = noisy(&system.respond(&u, 0.0, DT), 0.05, 34);
    let record = [recording(u, y, 0.0, DT)];
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| estimate(&record, 2))
    };
    assert_eq!(with(1).values(), with(3).values());
}

#[test]
fn options_out_of_range_are_named() {
    let record = [recording(broad(1), broad(2), 0.0, DT)];
    let spoil = |own: Options| identify::identify(&record, &options(0.5, 2, own)).expect_err("bad options").to_string();
    assert!(spoil(Options { order: Some(40), ..Options::default() }).contains("order"));
    assert!(spoil(Options { knots: 1, ..Options::default() }).contains("knots"));
    assert!(spoil(Options { reach: Some(-1.0), ..Options::default() }).contains("reach"));
}

#[test]
fn more_harmonics_than_lines_are_refused_with_numbers() {
    // 10 periods and 61 harmonics at 3 Hz: more unknowns than lines.
    let u = multisine(500, &(1..16).collect::<Vec<_>>(), 35);
    let y = resonant().respond(&u, 0.0, DT);
    let mut wide = options(0.5, 20, Options::default());
    wide.method = Method::Floquet(Options { order: Some(8), ..Options::default() });
    let error = identify::identify(&[recording(u, y, 0.0, DT)], &wide).expect_err("too many");
    assert!(matches!(&error, Error::TooShort { needed, found: 500, .. } if *needed > 500), "{error}");
}
