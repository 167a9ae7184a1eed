//! Tests of the section map: planted multipliers, nothing planted, and runs too short to tell.

use super::*;
use crate::identify::planted::{Place, joins, phase_of, places, recording};

/// Deviations `z[n+1] = A z[n] + e` on an orbit, constant over each cycle, around a fixed point of each run that is `apart`.
fn planted(places: &[Place], map: [[f64; 2]; 2], apart: f64, seed: u64) -> Recording {
    let mut random = SplitMix64::new(seed);
    let count = places.iter().filter(|p| p.cycle != usize::MAX).map(|p| p.cycle).max().map_or(0, |n| n + 1);
    let (mut z, mut offset, mut run) = ([random.normal(), random.normal()], [0.0; 2], usize::MAX);
    let mut states = Vec::with_capacity(count);
    for cycle in 0..count {
        let here = places.iter().find(|p| p.cycle == cycle).map_or(0, |p| p.run);
        if here != run {
            run = here;
            offset = [apart * random.normal(), apart * random.normal()];
        }
        z = [0, 1].map(|i| map[i][0] * z[0] + map[i][1] * z[1] + random.normal());
        states.push([0, 1].map(|i| offset[i] + z[i]));
    }
    let output = |j: usize| {
        let value =
            |p: &Place| 20.0 * (std::f64::consts::TAU * p.phase).sin() + states.get(p.cycle).map_or(0.0, |z| z[j]);
        places.iter().map(value).collect()
    };
    recording(places, &vec![0.0; places.len()], vec![output(0), output(1)])
}

fn both() -> Vec<Coordinate> {
    ["y0", "y1"].map(|channel| Coordinate { channel: channel.into(), rate: false }).to_vec()
}

/// Eigenvalues 0.7 and -0.4.
const MAP: [[f64; 2]; 2] = [[0.5, 0.3], [0.6, -0.2]];

#[test]
fn multipliers_of_one_long_run_are_covered_and_claimed() {
    let (mut inside, mut claimed) = ([0, 0], 0);
    for seed in 0..30 {
        let places = places(1, 150, seed);
        let recording = planted(&places, MAP, 0.0, 100 + seed);
        let options = Options { draws: 300, ..Options::new(0.25, both()) };
        let map = identify_map(&recording, &phase_of(&recording, Vec::new()), &options).expect("a map");
        assert_eq!((map.pairs, map.multipliers.len()), (149, 2));
        for (k, truth) in [0.7, 0.4].iter().enumerate() {
            inside[k] += usize::from((map.magnitude[k].0..map.magnitude[k].1).contains(truth));
        }
        claimed += usize::from(map.claims());
        assert!(map.warnings.is_empty());
    }
    // 95 % of 30 is 28.5; 28.5 - 3 sqrt(30 0.95 0.05) = 24.9.
    assert!(inside[0] >= 25 && inside[1] >= 25, "{inside:?}");
    assert_eq!(claimed, 30);
}

#[test]
fn nothing_planted_nothing_claimed() {
    let claimed = (0..30).filter(|seed| {
        let places = places(1, 60, *seed);
        let recording = planted(&places, [[0.0; 2]; 2], 0.0, 200 + seed);
        let options = Options { draws: 300, ..Options::new(0.25, both()) };
        identify_map(&recording, &phase_of(&recording, Vec::new()), &options).expect("a map").claims()
    });
    let claimed = claimed.count();
    assert!(claimed <= 1, "{claimed} of 30");
}

/// Twelve runs of five cycles with fixed points of their own: either intercept is wrong, in opposite directions, and says so.
#[test]
fn short_runs_mislead_and_are_warned_of() {
    let (mut common, mut per_run) = (Vec::new(), Vec::new());
    for seed in 0..20 {
        let places = places(12, 5, seed);
        let recording = planted(&places, [[0.5, 0.0], [0.0, 0.5]], 5.0, 300 + seed);
        let phase = phase_of(&recording, joins(&places));
        let options = Options { draws: 200, ..Options::new(0.25, both()[..1].to_vec()) };
        let map = identify_map(&recording, &phase, &options).expect("a map");
        assert!(map.warnings[0].contains("push multipliers towards one"), "{:?}", map.warnings);
        common.push(map.multipliers[0].re);
        let map =
            identify_map(&recording, &phase, &Options { intercept: Intercept::PerRun, ..options }).expect("a map");
        assert!(map.warnings[0].contains("Nickell"), "{:?}", map.warnings);
        assert_eq!((map.pairs, map.groups), (48, 12));
        per_run.push(map.multipliers[0].re);
    }
    assert!(stats::mean(common.iter().copied()) > 0.9, "common {common:?}");
    assert!(stats::mean(per_run.iter().copied()) < 0.3, "per run {per_run:?}");
}

#[test]
fn rates_are_slopes_at_the_section_and_matrices_have_units() {
    let places = places(1, 40, 7);
    let recording = planted(&places, MAP, 0.0, 8);
    let phase = phase_of(&recording, Vec::new());
    let coordinates = vec![Coordinate { channel: "y0".into(), rate: true }];
    let map =
        identify_map(&recording, &phase, &Options { draws: 0, ..Options::new(0.05, coordinates) }).expect("a map");
    // d/dt of 20 sin(2 pi phase) near phase 0.05, where phase advances by one half per step of 0.46 to 0.54 s.
    let slope = |step: f64| 20.0 * std::f64::consts::TAU * (0.05 * std::f64::consts::TAU).cos() * 0.5 / step;
    assert!(map.states.iter().all(|v| (0.97 * slope(0.54)..1.03 * slope(0.46)).contains(v)), "{:?}", map.states);

    let fitted = |scale: f64| {
        let outputs = vec![recording.output(0).map(|v| scale * v).collect(), recording.output(1).collect()];
        let inputs = (0..2).map(|i| recording.input(i).collect()).collect();
        let names = (recording.input_names().to_vec(), recording.output_names().to_vec());
        let scaled = Recording::new("scaled", recording.t().to_vec(), inputs, outputs, names.0, names.1).expect("good");
        identify_map(&scaled, &phase, &Options { draws: 0, ..Options::new(0.25, both()) }).expect("a map")
    };
    let (one, ten) = (fitted(1.0), fitted(10.0));
    assert!((ten.matrix[1] / one.matrix[1] - 10.0).abs() < 1e-6 && (ten.matrix[2] / one.matrix[2] - 0.1).abs() < 1e-8);
    assert!((ten.multipliers[0] - one.multipliers[0]).norm() < 1e-9);
}

#[test]
fn bad_input_says_what_is_wrong() {
    let places = places(1, 12, 9);
    let recording = planted(&places, MAP, 0.0, 10);
    let phase = phase_of(&recording, Vec::new());
    let failed = |options: Options| identify_map(&recording, &phase, &options).expect_err("bad").to_string();
    assert!(failed(Options::new(1.0, both())).contains("phase of the section = 1"));
    assert!(failed(Options::new(0.2, vec![])).contains("coordinates = 0"));
    assert!(failed(Options { window: 1, ..Options::new(0.2, both()) }).contains("window = 1"));
    let twice = vec![both()[0].clone(), both()[0].clone()];
    assert!(failed(Options::new(0.2, twice)).contains("leave one out"));
    let many = [both(), both()].concat();
    assert!(failed(Options::new(0.2, many)).contains("found 11 samples, at least 15"));
    let unknown = vec![Coordinate { channel: "hip".into(), rate: false }];
    assert!(failed(Options::new(0.2, unknown)).contains("no channel `hip`"));
}
