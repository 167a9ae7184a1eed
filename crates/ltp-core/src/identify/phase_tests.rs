//! Tests of phase from events: planted phases, and cycles with one thing wrong.

use super::*;
use crate::identify::planted::{DT, joins, phase_of, places, recording};

fn walker(runs: usize) -> (Vec<crate::identify::planted::Place>, Recording) {
    let places = places(runs, 6, 1);
    let y = places.iter().map(|p| (std::f64::consts::TAU * p.phase).cos()).collect();
    let recording = recording(&places, &vec![0.0; places.len()], vec![y]);
    (places, recording)
}

#[test]
fn phase_is_the_planted_one_and_stops_outside_the_cycles() {
    let (places, recording) = walker(3);
    let phase = phase_of(&recording, joins(&places));
    assert_eq!((phase.cycles().len(), phase.good()), (18, 18));
    assert!(phase.warnings.is_empty());
    // The marks are medians of noisy shares; the planted phase puts them at one half.
    assert!((phase.marks()[1] - 0.5).abs() < 0.02 && (phase.period() - 1.0).abs() < 0.03);
    for (place, t) in places.iter().zip(recording.t()) {
        let found = phase.at(*t);
        if place.cycle == usize::MAX {
            assert_eq!(found, None);
        } else {
            let half = if place.phase < 0.5 { place.phase / 0.5 } else { (place.phase - 0.5) / 0.5 };
            let (low, high) = if place.phase < 0.5 { (0.0, phase.marks()[1]) } else { (phase.marks()[1], 1.0) };
            assert!((found.expect("inside") - (low + half * (high - low))).abs() < 1e-9);
        }
    }
    let runs: Vec<usize> = phase.cycles().iter().map(|c| c.run).collect();
    assert_eq!(runs, [[0; 6], [1; 6], [2; 6]].concat());
    let links = phase.successors().iter().filter(|s| s.is_some()).count();
    assert_eq!(links, 3 * 5, "no cycle follows across a join");
}

#[test]
fn elapsed_phase_does_not_know_when_the_step_ends() {
    let (places, recording) = walker(1);
    let phase = phase_of(&recording, Vec::new());
    let all = phase.segments();
    let (short, long) = (all.iter().min_by(by_length).expect("one"), all.iter().max_by(by_length).expect("one"));
    let at =
        |s: &Segment, f: fn(&Segment, f64) -> f64| (f(s, s.times.0 + 0.2) - s.phases.0) / (s.phases.1 - s.phases.0);
    assert!((at(short, Segment::elapsed) - at(long, Segment::elapsed)).abs() < 0.01);
    assert!(at(short, Segment::interpolated) - at(long, Segment::interpolated) > 0.05);
    assert_eq!(short.elapsed(short.times.0 + 10.0), short.phases.1);
    assert_eq!(places[short.rows(recording.t()).start].since, 0);
}

fn by_length(a: &&Segment, b: &&Segment) -> std::cmp::Ordering {
    (a.times.1 - a.times.0).total_cmp(&(b.times.1 - b.times.0))
}

#[test]
fn a_noisy_channel_switches_once_and_where_it_passes_the_level() {
    let t: Vec<f64> = (0..400).map(|i| i as f64 * DT).collect();
    let mut random = crate::numeric::rng::SplitMix64::new(4);
    let y: Vec<f64> = t.iter().map(|t| (std::f64::consts::TAU * t).sin() + 0.02 * random.normal()).collect();
    let recording = Recording::new("noisy", t, vec![], vec![y], vec![], vec!["y".into()]).expect("good");
    let events = Events::from_switch(&recording, "y", Some(0.0)).expect("switches");
    assert_eq!(events.kinds(), [1, 0, 1, 0, 1, 0, 1]);
    for (found, truth) in events.times().iter().zip([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]) {
        assert!((found - truth).abs() < 0.015, "{found} for {truth}");
    }
}

/// One thing wrong with one cycle at a time; the others stay good.
#[test]
fn cycles_in_trouble_are_named_and_left_out() {
    let (_, recording) = walker(1);
    let good = Events::from_switch(&recording, "contact", None).expect("switches");
    let judged = |events: &Events, options: &Options, recording: &Recording| {
        let phase = phase_from_events(recording, events, options).expect("a phase");
        let troubles: Vec<(usize, &str)> =
            phase.cycles().iter().enumerate().filter_map(|(i, c)| Some((i, c.trouble.as_ref()?.word()))).collect();
        assert_eq!(phase.warnings.len(), 1);
        assert_eq!(phase.good(), phase.cycles().len() - troubles.len());
        troubles.clone()
    };
    let start = good.times()[4];
    let across = Options { joins: vec![start + 0.3], ..Options::default() };
    assert_eq!(judged(&good, &across, &recording), [(2, "join")]);

    let without = |gone: usize| {
        let keep = (0..good.times().len()).filter(|i| *i != gone);
        Events::new(keep.clone().map(|i| good.times()[i]).collect(), keep.map(|i| good.kinds()[i]).collect())
            .expect("events")
    };
    assert_eq!(judged(&without(5), &Options::default(), &recording), [(2, "events")]);

    let mut y: Vec<f64> = recording.output(0).collect();
    y[recording.t().partition_point(|t| *t < start) + 7] = f64::NAN;
    let inputs = (0..2).map(|i| recording.input(i).collect()).collect();
    let gap = Recording::new(
        "gap",
        recording.t().to_vec(),
        inputs,
        vec![y],
        recording.input_names().to_vec(),
        vec!["y0".into()],
    );
    assert_eq!(judged(&good, &Options::default(), &gap.expect("good")), [(2, "gap")]);

    let mut late: Vec<f64> = good.times().to_vec();
    (6..late.len()).for_each(|i| late[i] += 0.5);
    let late = Events::new(late, good.kinds().to_vec()).expect("events");
    assert_eq!(judged(&late, &Options::default(), &recording), [(2, "duration")]);
}

#[test]
fn a_join_on_an_event_parts_runs_and_costs_no_cycle() {
    let (places, recording) = walker(2);
    let phase = phase_of(&recording, joins(&places));
    // The same join, given as the first sample of the new run instead of the event half a sample before.
    let shifted = phase_of(&recording, joins(&places).iter().map(|j| j + 0.5 * DT).collect());
    assert_eq!(phase, shifted);
    assert_eq!(phase.good(), 12);
}

#[test]
fn groups_are_runs_or_else_stretches() {
    let (places, recording) = walker(5);
    let (groups, count) = phase_of(&recording, joins(&places)).groups();
    assert_eq!(count, 5);
    assert_eq!(
        groups.iter().map(|g| g.expect("good")).collect::<Vec<_>>(),
        [[0; 6], [1; 6], [2; 6], [3; 6], [4; 6]].concat()
    );
    let (groups, count) = phase_of(&recording, Vec::new()).groups();
    assert_eq!(count, 10);
    assert_eq!(groups.iter().map(|g| g.expect("good")).collect::<Vec<_>>(), (0..30).map(|i| i / 3).collect::<Vec<_>>());
}

#[test]
fn bad_input_says_what_is_wrong() {
    let (_, recording) = walker(1);
    let events = Events::from_switch(&recording, "contact", None).expect("switches");
    let failed = |options: Options| phase_from_events(&recording, &events, &options).expect_err("bad").to_string();
    assert!(failed(Options { tolerance: 0.0, ..Options::default() }).contains("tolerance = 0"));
    assert!(failed(Options { joins: vec![f64::NAN], ..Options::default() }).contains("time of a join = NaN"));
    let text = failed(Options { start: 7, ..Options::default() });
    assert!(text.contains("found 0 samples, at least 3"), "{text}");
    let text = Events::from_switch(&recording, "contakt", None).expect_err("bad").to_string();
    assert!(text.contains("no channel `contakt`") && text.contains("did you mean `contact`"), "{text}");
    let text = Events::from_switch(&recording, "u", None).expect_err("bad").to_string();
    assert!(text.contains("choose a channel that switches"), "{text}");
    assert!(Events::from_switch(&recording, "contact", Some(1.5)).is_err());
    assert!(Events::new(vec![0.0, 0.0], vec![0, 0]).is_err());
    assert!(Events::new(vec![0.0, f64::NAN], vec![0, 0]).is_err());
    assert!(Events::new(vec![0.0, 1.0], vec![0]).is_err());
}
