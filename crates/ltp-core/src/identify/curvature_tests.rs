//! The penalised estimate of systems whose harmonic transfer functions are written down.

use super::*;
use crate::identify::{Method, Options as Task, Orbit, identify};
use crate::numeric::{fft, rng::SplitMix64};
use crate::signal::Recording;
use std::f64::consts::TAU;

const PERIOD: f64 = 0.25;
const DT: f64 = 0.25 / 32.0;
const K: i64 = 2;
/// Highest excited frequency, Hz.
const BAND_HZ: f64 = 3.0;

/// A system with a lag in each harmonic, of either sign: `H_k = c_k / (1 + j w tau_k)`.
fn truth(k: i64, omega: f64, y: usize, u: usize) -> Complex {
    let size = [1.0, 0.5, 0.2][k.unsigned_abs() as usize] * [[1.0, -0.7], [0.4, 2.0]][y][u];
    let gain = Complex::from_polar(size, 0.9 * k as f64);
    let lag = 0.05 * (1.0 + k.unsigned_abs() as f64 + 0.5 * u as f64);
    gain / Complex::new(1.0, omega * lag)
}

/// A steady periodic record of `periods` periods: white input up to the band, and what the system makes of it.
fn record(periods: usize, (inputs, outputs): (usize, usize), noise: f64, seed: u64) -> Recording {
    let n = periods * 32;
    let spacing = 1.0 / (periods as f64 * PERIOD);
    let mut random = SplitMix64::new(seed);
    let last = (BAND_HZ / spacing) as i64;
    let lines: Vec<Vec<Complex>> = (0..inputs)
        .map(|_| {
            let line = |b: i64| Complex::new(random.normal(), if b == 0 { 0.0 } else { random.normal() });
            (0..=last).map(line).map(|v| v * (n as f64).sqrt()).collect()
        })
        .collect();
    let input = |i: usize, b: i64| match lines[i].get(b.unsigned_abs() as usize) {
        Some(v) if b < 0 => v.conj(),
        Some(v) => *v,
        None => Complex::new(0.0, 0.0),
    };
    let output = |j: usize, b: i64| -> Complex {
        let terms = (-K..=K).flat_map(|k| (0..inputs).map(move |i| (k, i, b - k * periods as i64)));
        terms.map(|(k, i, from)| truth(k, TAU * spacing * from as f64, j, i) * input(i, from)).sum()
    };
    let u = (0..inputs).map(|i| fft::inverse(&(0..=last).map(|b| input(i, b)).collect::<Vec<_>>(), n)).collect();
    let y = (0..outputs)
        .map(|j| {
            let mut y = fft::inverse(&(0..=n as i64 / 2).map(|b| output(j, b)).collect::<Vec<_>>(), n);
            y.iter_mut().for_each(|v| *v += noise * random.normal());
            y
        })
        .collect();
    let names = |kind: &str, count: usize| (0..count).map(|i| format!("{kind}{i}")).collect();
    let t = (0..n).map(|i| i as f64 * DT).collect();
    Recording::new("made", t, u, y, names("u", inputs), names("y", outputs)).expect("a record")
}

fn task(own: Options) -> Task {
    let (harmonics, band) = (K as usize, Some(TAU * BAND_HZ));
    Task { period: PERIOD, harmonics, band, orbit: Orbit::Deviation, method: Method::Curvature(own) }
}

fn with(smoothness: f64) -> Task {
    task(Options { smoothness: Some(smoothness), solver: Solver::Smoother })
}

/// Errors of all values, beside their standard deviations.
fn errors(htf: &Htf) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    for k in -K..=K {
        for (b, &omega) in htf.omega().iter().enumerate() {
            for y in 0..htf.outputs() {
                for u in 0..htf.inputs() {
                    let at = htf.index(k, b, y, u);
                    let sd = htf.sd().expect("standard deviations")[at];
                    out.push(((htf.values()[at] - truth(k, omega, y, u)).norm(), sd));
                }
            }
        }
    }
    out
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1));
    (sum / f64::from(count)).sqrt()
}

#[test]
fn without_noise_the_truth_is_found() {
    // Bias falls with the square of the width over which lines are taken together: four times the length, less still.
    let error = |periods: usize| {
        let htf = identify(&[record(periods, (1, 1), 0.0, 3)], &task(Options::default())).expect("a good record");
        rms(errors(&htf).into_iter().map(|(error, _)| error))
    };
    let (short, long) = (error(150), error(600));
    assert!(short < 0.05 && long < short / 4.0, "{short} {long}");
}

#[test]
fn the_banded_route_finds_the_same() {
    let recording = record(200, (2, 2), 0.1, 5);
    for smoothness in [1e-2, 1e2, 1e5] {
        let solve = |solver| {
            let own = Options { smoothness: Some(smoothness), solver };
            identify(std::slice::from_ref(&recording), &task(own)).expect("a good record")
        };
        let (smoother, banded) = (solve(Solver::Smoother), solve(Solver::Banded));
        let largest = smoother.values().iter().map(|v| v.norm()).fold(0.0, f64::max);
        for (a, b) in smoother.values().iter().zip(banded.values()) {
            assert!((a - b).norm() < 1e-8 * largest, "{smoothness}: {a} {b}");
        }
    }
}

#[test]
fn standard_deviations_are_honest_and_noise_is_read_off() {
    for seed in [1, 2, 3] {
        let htf = identify(&[record(600, (1, 1), 0.3, seed)], &task(Options::default())).expect("a good record");
        let ratio = rms(errors(&htf).into_iter().map(|(error, sd)| error / sd));
        assert!((0.6..1.5).contains(&ratio), "seed {seed}: errors are {ratio} standard deviations");
        let noise = htf.figures.iter().find(|(name, _)| name == "noise_sd").expect("a figure").1;
        assert!((noise / 0.3 - 1.0).abs() < 0.05, "seed {seed}: noise {noise}");
    }
}

#[test]
fn cross_validation_comes_near_the_best_smoothness() {
    let recording = [record(400, (1, 1), 0.3, 9)];
    let error = |task: &Task| {
        let htf = identify(&recording, task).expect("a good record");
        rms(errors(&htf).into_iter().map(|(error, _)| error))
    };
    let best = (0..=12).map(|decade| error(&with(10_f64.powi(decade - 3)))).fold(f64::INFINITY, f64::min);
    let chosen = error(&task(Options::default()));
    assert!(chosen < 1.3 * best, "{chosen}, the best is {best}");
}

#[test]
fn what_is_left_of_the_orbit_does_no_harm_when_told() {
    let clean = record(200, (1, 1), 0.05, 4);
    let spoil = |size: f64| {
        let y = clean.output(0).zip(clean.t()).map(|(y, t)| y + size * (1.0 + (TAU * t / PERIOD).cos())).collect();
        let columns = (vec![clean.input(0).collect()], vec![y]);
        let names = (clean.input_names().to_vec(), clean.output_names().to_vec());
        Recording::new("spoilt", clean.t().to_vec(), columns.0, columns.1, names.0, names.1).expect("a record")
    };
    let solve = |size, orbit| {
        let htf = identify(&[spoil(size)], &Task { orbit, ..with(1e3) }).expect("a good record");
        rms(errors(&htf).into_iter().map(|(error, _)| error))
    };
    let (untouched, dropped) = (solve(0.0, Orbit::Removed), solve(1.0, Orbit::Removed));
    assert!((dropped / untouched - 1.0).abs() < 1e-6, "{dropped} {untouched}");
    assert!(solve(1.0, Orbit::Deviation) > 2.0 * dropped, "the orbit must do harm when it is not told of");
}

#[test]
fn two_inputs_and_two_outputs_are_told_apart() {
    let htf = identify(&[record(800, (2, 2), 0.02, 11)], &task(Options::default())).expect("a good record");
    assert!(rms(errors(&htf).into_iter().map(|(error, _)| error)) < 0.05);
}

#[test]
fn a_second_record_adds_what_it_knows() {
    let solve = |records: &[Recording]| {
        let htf = identify(records, &with(1e3)).expect("good records");
        (rms(errors(&htf).into_iter().map(|(error, _)| error)), rms(htf.sd().expect("sd").iter().copied()))
    };
    let (a, b) = (record(300, (1, 1), 0.3, 1), record(300, (1, 1), 0.3, 2));
    let ((one, one_sd), (two, two_sd)) = (solve(std::slice::from_ref(&a)), solve(&[a.clone(), b]));
    assert!(two < one && two_sd < 0.85 * one_sd, "errors {one}, {two}; sd {one_sd}, {two_sd}");
    // the order of the records is no matter of record
    let c = record(240, (1, 1), 0.3, 3);
    let (ab, ba) = (solve(&[a.clone(), c.clone()]), solve(&[c, a]));
    assert!((ab.0 - ba.0).abs() < 1e-8 && (ab.1 / ba.1 - 1.0).abs() < 1e-4, "{ab:?} {ba:?}");
}

#[test]
fn records_of_other_lengths_are_taken_with_a_warning() {
    let records = [record(300, (1, 1), 0.1, 1), record(240, (1, 1), 0.1, 2)];
    let htf = identify(&records, &with(1e3)).expect("good records");
    assert!(htf.warnings.iter().any(|w| w.contains("300, 240 periods")), "{:?}", htf.warnings);
    let one = identify(&records[..1], &with(1e3)).expect("a good record");
    let error = |htf: &Htf| rms(errors(htf).into_iter().map(|(error, _)| error));
    assert!(error(&htf) < error(&one), "{} {}", error(&htf), error(&one));
}

#[test]
fn coherence_tells_noise_from_response() {
    let coherence = |noise: f64| {
        let htf = identify(&[record(400, (1, 1), noise, 2)], &with(1e4)).expect("a good record");
        let values = htf.coherence().expect("coherence").to_vec();
        values.iter().sum::<f64>() / values.len() as f64
    };
    assert!(coherence(0.0) > 0.99 && coherence(30.0) < 0.5, "{} {}", coherence(0.0), coherence(30.0));
}

#[test]
fn a_smoothness_that_cannot_be_is_refused() {
    let recording = [record(100, (1, 1), 0.1, 1)];
    for smoothness in [0.0, -1.0, f64::NAN] {
        assert!(matches!(identify(&recording, &with(smoothness)), Err(Error::OutOfRange { .. })));
    }
}
