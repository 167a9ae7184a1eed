//! Tests of the spectra: what they are, and what is refused.

use super::*;
use crate::identify::testing::{multisine, recording, resonant};
use crate::identify::{Method, floquet, lines};

const DT: f64 = 0.01;

fn options() -> Options {
    let method = Method::Floquet(floquet::Options::default());
    Options { period: 0.5, harmonics: 3, band: None, orbit: Orbit::Deviation, method }
}

/// 100 periods of 0.5 s, input up to 3 Hz.
fn good() -> Recording {
    let u = multisine(5000, &(1..=150).collect::<Vec<_>>(), 1);
    let y = resonant().respond(&u, 0.0, DT);
    recording(u, y, 0.0, DT)
}

fn refused(recording: Recording, options: &Options) -> String {
    Spectra::new(&[recording], options).err().map_or(String::new(), |e| e.to_string())
}

#[test]
fn harmonics_relate_the_lines_exactly() {
    let system = resonant();
    let spectra = Spectra::new(&[good()], &options()).expect("good input");
    let record = &spectra.records()[0];
    assert_eq!((record.periods(), record.samples()), (100, 5000));
    for b in [3_i64, 77, 140, -20] {
        let expected: Complex = (-3..=3)
            .map(|k| b - 100 * k)
            .map(|from| system.htf((b - from) / 100, from as f64 * record.spacing()) * record.input(0, from))
            .sum();
        assert!((record.output(0, b) - expected).norm() < 1e-10);
    }
    // The band ends within a window of the last line.
    assert!((spectra.band() - TAU * 3.0).abs() <= spectra.window() + 1e-9, "{}", spectra.band() / TAU);
}

#[test]
fn the_clock_is_that_of_the_times() {
    // The same motion, recorded from 0.37 s on: the lines differ by what time zero means, and by nothing else.
    let u = multisine(5000, &(1..=150).collect::<Vec<_>>(), 1);
    let y = resonant().respond(&u, 0.0, DT);
    let turned = |x: &[f64]| -> Vec<f64> { (0..5000).map(|i| x[(i + 37) % 5000]).collect() };
    let from_start = Spectra::new(&[recording(u.clone(), y.clone(), 0.0, DT)], &options()).expect("good");
    let later = Spectra::new(&[recording(turned(&u), turned(&y), 0.37, DT)], &options()).expect("good");
    for b in [3, 77, 140] {
        let (a, c) = (&from_start.records()[0], &later.records()[0]);
        assert!((a.output(0, b) - c.output(0, b)).norm() < 1e-9 && (a.input(0, b) - c.input(0, b)).norm() < 1e-9);
    }
}

#[test]
fn a_record_is_cut_to_whole_periods() {
    let u = multisine(5000, &(1..=150).collect::<Vec<_>>(), 1);
    let y = resonant().respond(&u, 0.0, DT);
    let cut = recording(u[..4983].to_vec(), y[..4983].to_vec(), 0.0, DT);
    let spectra = Spectra::new(&[cut], &options()).expect("good input");
    assert_eq!((spectra.records()[0].periods(), spectra.records()[0].samples()), (99, 4950));
}

#[test]
fn impossible_periods_and_bands_are_refused() {
    for period in [0.0, -1.0, f64::NAN] {
        assert!(refused(good(), &Options { period, ..options() }).contains("period"));
    }
    assert!(refused(good(), &Options { period: 0.015, ..options() }).contains("two samples"));
    assert!(refused(good(), &Options { band: Some(-2.0), ..options() }).contains("band"));
}

#[test]
fn too_few_cycles_are_refused_and_few_are_warned_of() {
    let text = refused(good().slice(0.0, 3.2).expect("samples"), &options());
    assert!(text.contains("6.42 periods") && text.contains("at least 400"), "{text}");
    let few = Spectra::new(&[good().slice(0.0, 9.99).expect("samples")], &options()).expect("20 periods");
    assert!(few.warnings().iter().any(|w| w.contains("20 periods")), "{:?}", few.warnings());
}

#[test]
fn harmonics_beyond_the_nyquist_frequency_are_refused_with_the_largest_that_fits() {
    // Nyquist 50 Hz, band 3 Hz, pumping 2 Hz: 23 harmonics end at 49 Hz.
    let band = Some(TAU * 3.0);
    assert!(Spectra::new(&[good()], &Options { harmonics: 23, band, ..options() }).is_ok());
    let text = refused(good(), &Options { harmonics: 24, band, ..options() });
    assert!(text.contains("51.000 Hz") && text.contains("at most 23 harmonics"), "{text}");
}

#[test]
fn bands_without_power_are_named() {
    let sparse = |lines: Vec<usize>| {
        let u = multisine(5000, &lines, 1);
        let y = resonant().respond(&u, 0.0, DT);
        recording(u, y, 0.0, DT)
    };
    let gap: Vec<usize> = (1..50).chain(90..=150).collect();
    let asked = Options { band: Some(TAU * 3.0), ..options() };
    let text = refused(sparse(gap.clone()), &asked);
    assert!(text.contains("from 1.000 to 1.750 Hz"), "{text}");
    // Without a band in mind the same is worth a warning, since the rest can be used.
    let warned = Spectra::new(&[sparse(gap)], &options()).expect("usable");
    assert!(warned.warnings().iter().any(|w| w.contains("from 1.000 to 1.750 Hz")), "{:?}", warned.warnings());
    let text = refused(sparse((1..=100).collect()), &asked);
    assert!(text.contains("from 2.250 to 3.000 Hz"), "{text}");
    // Line by line, gaps do not matter.
    let method = Method::Lines(lines::Options::default());
    assert!(Spectra::new(&[sparse(vec![3, 41, 87])], &Options { method, ..options() }).is_ok());
}

#[test]
fn constant_columns_are_refused() {
    let good = good();
    let (u, y): (Vec<f64>, Vec<f64>) = (good.input(0).collect(), good.output(0).collect());
    let text = refused(recording(vec![2.0; 5000], y, 0.0, DT), &options());
    assert!(text.contains("input `u`") && text.contains("2 in every row"), "{text}");
    let text = refused(recording(u, vec![-1.0; 5000], 0.0, DT), &options());
    assert!(text.contains("output `y`") && text.contains("sensor"), "{text}");
}

#[test]
fn gaps_are_refused_with_the_longest_run_between_them() {
    let good = good();
    let mut y: Vec<f64> = good.output(0).collect();
    (1000..1010).for_each(|i| y[i] = f64::NAN);
    let text = refused(recording(good.input(0).collect(), y, 0.0, DT), &options());
    assert!(text.contains("= 10:") && text.contains("from 10.1 s to 49.99 s"), "{text}");
}

#[test]
fn jitter_of_the_clock_is_passed_on_as_a_warning() {
    let good = good();
    let mut random = crate::numeric::rng::SplitMix64::new(3);
    let t = (0..5000).map(|i| (f64::from(i) + 0.05 * random.uniform()) * DT).collect();
    let (u, y) = (good.input(0).collect(), good.output(0).collect());
    let record = Recording::new("run", t, vec![u], vec![y], vec!["u".into()], vec!["y".into()]).expect("a recording");
    let spectra = Spectra::new(&[record], &options()).expect("usable");
    assert!(spectra.warnings().iter().any(|w| w.contains("jitter")), "{:?}", spectra.warnings());
}

#[test]
fn recordings_of_different_columns_are_refused_and_so_is_none() {
    assert!(matches!(Spectra::new(&[], &options()), Err(Error::Shape { found: 0, .. })));
    let good = good();
    let t = good.t().to_vec();
    let (u, y): (Vec<f64>, Vec<f64>) = (good.input(0).collect(), good.output(0).collect());
    let names = vec!["a".to_owned(), "b".to_owned()];
    let two = Recording::new("wide", t, vec![u], vec![y.clone(), y], vec!["u".into()], names).expect("a recording");
    assert!(matches!(Spectra::new(&[good, two], &options()), Err(Error::Shape { expected: 1, found: 2, .. })));
}
