//! Tests of the cycle average: planted orbits, jumps and scatter.

use super::*;
use crate::identify::planted::{joins, phase_of, places, recording};
use crate::numeric::rng::SplitMix64;

/// A motion with a jump at the second switch.
fn motion(phase: f64) -> f64 {
    (std::f64::consts::TAU * phase).sin() + if phase < 0.5 { 1.0 } else { -2.0 }
}

#[test]
fn the_orbit_is_recovered_through_its_jumps_whatever_the_cycles_last() {
    let places = places(2, 20, 3);
    let y = places.iter().map(|p| motion(p.phase)).collect();
    let recording = recording(&places, &vec![0.0; places.len()], vec![y]);
    let phase = phase_of(&recording, joins(&places));
    let average = cycle_average(&recording, &phase, &["y0".into()], 50).expect("an average");
    let mark = phase.marks()[1];
    for (phi, found) in average.phase.iter().zip(&average.mean) {
        let planted = if *phi < mark { 0.5 * phi / mark } else { 0.5 + 0.5 * (phi - mark) / (1.0 - mark) };
        // Linear between samples: 0.02 of a cycle apart at most, so an error of (2 pi 0.02)^2 / 8.
        assert!((found - motion(planted)).abs() < 2.5e-3, "{found} at {phi}");
    }
    assert!(average.spread.iter().all(|s| *s < 2.5e-3));
}

/// Runs differ by 1, cycles of a run by 0.5: the spread holds both, the error of the mean counts runs.
#[test]
fn bands_are_the_planted_scatter() {
    let (runs, cycles) = (200, 5);
    let places = places(runs, cycles, 4);
    let mut random = SplitMix64::new(5);
    let of_run: Vec<f64> = (0..runs).map(|_| random.normal()).collect();
    let of_cycle: Vec<f64> = (0..runs * cycles).map(|_| 0.5 * random.normal()).collect();
    let y = places.iter().map(|p| motion(p.phase) + of_run[p.run] + of_cycle.get(p.cycle).unwrap_or(&0.0)).collect();
    let recording = recording(&places, &vec![0.0; places.len()], vec![y]);
    let average =
        cycle_average(&recording, &phase_of(&recording, joins(&places)), &["y0".into()], 20).expect("an average");
    assert_eq!((average.cycles, average.groups), (1000, 200));
    // Standard deviations from 200 draws have 5 % of scatter, from 800 degrees of freedom 2.5 %: four of them.
    let near = |found: f64, truth: f64, scatter: f64| {
        assert!((found / truth - 1.0).abs() < 4.0 * scatter, "{found} for {truth}")
    };
    for i in 0..20 {
        near(average.spread[i], (1.0 + 0.25_f64).sqrt(), 0.05);
        near(average.within[i], 0.5, 0.025);
        near(average.standard_error[i], ((1.0 + 0.25 / 5.0) / 200.0_f64).sqrt(), 0.05);
    }
}

#[test]
fn bad_input_says_what_is_wrong() {
    let places = places(1, 5, 6);
    let recording = recording(&places, &vec![0.0; places.len()], vec![vec![0.0; places.len()]]);
    let phase = phase_of(&recording, Vec::new());
    let text = cycle_average(&recording, &phase, &["y0".into()], 1).expect_err("bad").to_string();
    assert!(text.contains("points = 1"), "{text}");
    let text = cycle_average(&recording, &phase, &["y1".into()], 10).expect_err("bad").to_string();
    assert!(text.contains("no channel `y1`"), "{text}");
}
