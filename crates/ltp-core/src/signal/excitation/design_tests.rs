//! Tests of the design: what it predicts is what an experiment on a known periodic filter then shows.

use super::*;
use crate::numeric::{Complex, fft};
use crate::signal::excitation::noise;

/// Period of the filter, s, and the sampling step.
const T: f64 = 0.5;
const DT: f64 = 0.01;

/// `y(t) = (1 + 0.8 cos(w_p t + 0.3)) x(t)`, `x' = -3 x + u`: `H_0 = 1/(j w + 3)`, `H_{+-1} = 0.4 e^{+-0.3 j} H_0`.
fn filter(k: i64, omega: f64) -> Complex {
    let lag = Complex::new(3.0, omega).inv();
    match k {
        0 => lag,
        1 | -1 => 0.4 * Complex::from_polar(1.0, 0.3 * k as f64) * lag,
        _ => Complex::ZERO,
    }
}

/// Rms of the output over that of a sine.
fn gain(omega: f64) -> f64 {
    (-1..=1).map(|k| filter(k, omega).norm_sqr()).sum::<f64>().sqrt()
}

fn request() -> Request {
    Request { settle: Some(4), ..Request::new(T, (0.0, TAU * 3.0), 42.0, DT) }
}

fn plan() -> Plan {
    Plan::new(request()).expect("plan")
}

/// The record (after settling, in steady state) of the filter under the design's multisine, in closed form.
fn record(design: &Design) -> Vec<f64> {
    let plan = &design.plan;
    let n = (plan.record() / DT).round() as usize;
    let omega = plan.omega();
    let spectrum = design.multisine.spectrum();
    let pumping = TAU / T;
    let at = |i: usize| {
        let t = plan.settling() + i as f64 * DT;
        let answer = |b: usize, k: i64| {
            let turn = Complex::from_polar(1.0, (omega[b] + k as f64 * pumping) * t);
            (filter(k, omega[b]) * spectrum[b] * turn).re
        };
        (0..omega.len()).map(|b| (-1..=1).map(|k| answer(b, k)).sum::<f64>()).sum()
    };
    (0..n).map(at).collect()
}

/// Line by line: `H_k` on line `i` of the design from the transform of the output.
///
/// The clock's phase and the multisine's at the start of the record both count from t = 0.
fn estimate(design: &Design, spectrum: &[Complex], n: usize, k: i64, i: usize) -> Complex {
    let plan = &design.plan;
    let line = (plan.lines[i] as i64 + k * plan.cycles as i64) * plan.request.repeats as i64;
    let value = spectrum[line.unsigned_abs() as usize];
    let amplitude = 2.0 / n as f64 * if line < 0 { value.conj() } else { value };
    let omega = plan.omega()[i] + k as f64 * TAU / T;
    amplitude / (design.multisine.spectrum()[i] * Complex::from_polar(1.0, omega * plan.settling()))
}

/// Squared errors over predicted variances, of all lines and harmonics -3 to 3, without noise (`None`) or with.
fn errors(design: &Design, seed: Option<u64>) -> Vec<f64> {
    let mut y = record(design);
    if let Some(seed) = seed {
        let sd = design.noise_sd.expect("noise");
        let added = noise(y.len(), sd, seed).expect("noise");
        y.iter_mut().zip(added).for_each(|(y, e)| *y += e);
    }
    let (n, spectrum) = (y.len(), fft::forward(&y));
    let omega = design.plan.omega();
    let error = |i: usize, k: i64| {
        (estimate(design, &spectrum, n, k, i) - filter(k, omega[i])).norm_sqr() / design.sd[i].powi(2)
    };
    (0..omega.len()).flat_map(|i| (-3..=3).map(move |k| (i, k))).map(|(i, k)| error(i, k)).collect()
}

fn shape(noise: Noise) -> Shape {
    Shape { noise, ..Shape::default() }
}

#[test]
fn time_is_divided_into_settling_and_whole_periods() {
    let plan = plan();
    // 42 s are 84 periods: 4 to settle, 80 for the multisine, a class of residues for every 4.
    assert_eq!((plan.settle, plan.cycles, plan.lines.len()), (4, 80, 20));
    assert_eq!((plan.settling(), plan.record()), (2.0, 40.0));
    // 3 Hz and 5 % are 3.15 Hz, line 126.
    let omega = plan.omega();
    assert!(omega[0] < TAU * 0.1 && omega[19] > TAU * 2.9 && omega[19] <= TAU * 3.15);
    let twice = Plan::new(Request { repeats: 2, ..request() }).expect("plan");
    assert_eq!((twice.cycles, twice.record(), twice.lines.len()), (40, 40.0, 10));
    // The hopper of 1400 periods: 100 of them to settle.
    let hopper = Plan::new(Request::new(0.33, (0.0, TAU * 5.0), 462.0, 1e-3)).expect("plan");
    assert_eq!((hopper.settle, hopper.cycles), (100, 1300));
}

#[test]
fn a_period_of_whole_samples_is_looked_for() {
    // 0.3301 s are 330.1 samples: 10 periods are the first whole number of them.
    assert_eq!(whole_samples(1308, 330.1), 1300);
    assert_eq!(whole_samples(1309, 330.0), 1308);
    // Nothing fits: the largest even number, and the advice says so.
    let period = TAU / 19.0;
    let odd = Plan::new(Request::new(period, (0.0, 19.0), 100.0, 1e-3)).expect("plan");
    let advice = design(&odd, None, &Shape::default()).expect("design").advice.join(" ");
    assert!(advice.contains("not a whole number"), "{advice}");
    let good = design(&plan(), None, &Shape::default()).expect("design").advice.join(" ");
    assert!(!good.contains("not a whole number"), "{good}");
}

#[test]
fn without_noise_every_harmonic_is_exact_on_every_line() {
    let design = design(&plan(), None, &shape(Noise::Sd(1.0))).expect("design");
    let worst = errors(&design, None).into_iter().fold(0.0, f64::max).sqrt();
    assert!(worst * design.sd[0] < 1e-12, "{worst}");
}

#[test]
fn lines_that_share_residues_cannot_be_told_apart() {
    // The same as before but for the grid: all odd lines.
    let choice = Choice { kind: Kind::Odd, ..Choice::default() };
    let plan = Plan::new(Request { choice, ..request() }).expect("plan");
    let design = design(&plan, None, &shape(Noise::Sd(1.0))).expect("design");
    let worst = errors(&design, None).into_iter().fold(0.0, f64::max).sqrt();
    assert!(worst * design.sd[0] > 0.05, "{worst}");
}

#[test]
fn predicted_deviations_are_those_of_many_experiments() {
    for repeats in [1, 2] {
        let plan = Plan::new(Request { repeats, ..request() }).expect("plan");
        let gains: Vec<f64> = plan.omega().into_iter().map(gain).collect();
        let design = design(&plan, Some(&gains), &shape(Noise::Snr(5.0))).expect("design");
        let errors: Vec<f64> = (0..40).flat_map(|seed| errors(&design, Some(seed))).collect();
        let n = errors.len() as f64;
        // |noise|^2 over its mean is exponential: mean and standard deviation 1; a disc holds 95 %. Four standard errors.
        let mean = errors.iter().sum::<f64>() / n;
        assert!((mean - 1.0).abs() < 4.0 / n.sqrt(), "{repeats} periods: {mean}");
        let inside = errors.iter().filter(|e| **e <= radius(1.0).powi(2)).count() as f64 / n;
        assert!((inside - 0.95).abs() < 4.0 * (0.05 * 0.95 / n).sqrt(), "{repeats} periods: {inside}");
    }
}

#[test]
fn a_ratio_means_the_output_that_is_there() {
    let plan = plan();
    let gains: Vec<f64> = plan.omega().into_iter().map(gain).collect();
    let design = design(&plan, Some(&gains), &shape(Noise::Snr(5.0))).expect("design");
    let y = record(&design);
    let power = y.iter().map(|y| y * y).sum::<f64>() / y.len() as f64;
    let ratio = power / design.noise_sd.expect("noise").powi(2);
    assert!((ratio / 5.0 - 1.0).abs() < 1e-10, "{ratio}");
}

#[test]
fn shape_one_makes_relative_errors_equal_and_shape_zero_the_lines() {
    let plan = plan();
    let gains: Vec<f64> = plan.omega().into_iter().map(gain).collect();
    let of = |power| design(&plan, Some(&gains), &Shape { power, ..Shape::default() }).expect("design");
    let equal = of(1.0);
    for (sd, g) in equal.sd.iter().zip(&gains) {
        assert!((sd / g / (equal.sd[0] / gains[0]) - 1.0).abs() < 1e-12);
    }
    // Nothing is said in percent while the noise is not known.
    assert!(!equal.advice.join(" ").contains("of the gain"));
    let noisy = design(&plan, Some(&gains), &Shape { power: 1.0, noise: Noise::Sd(0.01), ..Shape::default() });
    let percent = 100.0 * radius(0.01 * equal.sd[0] / gains[0]);
    let words = noisy.expect("design").advice.join(" ");
    assert!(words.contains(&format!(", {percent:.2} % of the gain, worst at")), "{words}");
    let flat = of(0.0);
    assert!(flat.multisine.amplitudes().iter().all(|a| (a - flat.multisine.amplitudes()[0]).abs() < 1e-15));
    // sd = s/r sqrt(2 L / N), with s = r = 1, 20 lines and 4000 samples.
    assert!((flat.sd[0] - 0.1).abs() < 1e-14, "{}", flat.sd[0]);
}

#[test]
fn without_noise_deviations_are_per_unit_of_it() {
    let unit = design(&plan(), None, &Shape::default()).expect("design");
    let some = design(&plan(), None, &shape(Noise::Sd(0.02))).expect("design");
    assert_eq!((unit.noise_sd, some.noise_sd), (None, Some(0.02)));
    for (a, b) in unit.sd.iter().zip(&some.sd) {
        assert!((0.02 * a / b - 1.0).abs() < 1e-14);
    }
    // 1.7308 times 0.1, of 20 lines of one size in 4000 samples.
    assert!(unit.advice.iter().any(|words| words.contains("radius 1.731e-1 s.")), "{:?}", unit.advice);
    assert!(some.advice.iter().any(|words| words.contains("radius 3.462e-3.")), "{:?}", some.advice);
}

#[test]
fn what_cannot_be_designed_is_said_with_numbers() {
    let refused = |request: Request, part: &str| {
        let error = Plan::new(request).expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    };
    refused(Request { period: 0.0, ..request() }, "period = 0");
    refused(Request { dt: f64::NAN, ..request() }, "dt = NaN");
    refused(Request { duration: 3.0, ..request() }, "at least 4 s");
    refused(Request { band: (0.0, 300.0), ..request() }, "below 299.199");
    refused(Request { band: (0.0, 0.01), ..request() }, "at least 1");
    let plan = plan();
    let refused = |gain: Option<&[f64]>, shape: Shape, part: &str| {
        let error = design(&plan, gain, &shape).expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    };
    refused(None, shape(Noise::Snr(5.0)), "without the system's gain");
    refused(Some(&[1.0; 20]), shape(Noise::Snr(-5.0)), "snr = -5");
    refused(None, shape(Noise::Sd(0.0)), "noise_sd = 0");
    refused(Some(&[1.0; 3]), Shape::default(), "found 3 values, expected 20");
    refused(Some(&[0.0; 20]), Shape::default(), "gain[0] = 0");
    refused(None, Shape { rms: 0.0, ..Shape::default() }, "rms = 0");
}

#[test]
fn a_transient_is_given_the_time_it_takes() {
    // The hopper: 0.8479^n below 1e-7 first for n = 98.
    let n = settling_periods(0.8479).expect("stable");
    assert_eq!(n, 98);
    assert!(0.8479_f64.powi(97) > 1e-7 && 0.8479_f64.powi(98) <= 1e-7);
    assert_eq!(settling_periods(0.0), Ok(0));
    for multiplier in [1.0, 1.2, -0.5, f64::NAN] {
        assert!(settling_periods(multiplier).is_err(), "{multiplier}");
    }
}
