//! The truth integrator against closed forms, the slow integrator, its own tolerance, and the engine under test.

use super::truth::{Run, run};
use super::{Machine, Planted, Wave, motion};
use crate::model::{Model, System, zoo};
use crate::numeric::stats;
use crate::simulate::{Hold, Inputs, Plan, simulate};

pub(super) fn planted(name: &str, at: &str, parameters: &[(&str, f64)]) -> Planted {
    let parameters = parameters.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
    Planted { name: name.into(), at: at.into(), parameters }
}

fn sines(dt: f64, samples: usize, count: usize) -> Vec<Vec<f64>> {
    let wave = |t: f64, c: usize| 3.0 * (3.1 * t + c as f64).sin() + 2.0 * (7.7 * t).cos();
    (0..count).map(|c| (0..samples).map(|k| wave(k as f64 * dt, c)).collect()).collect()
}

fn wave(dt: f64, columns: &[Vec<f64>]) -> Wave {
    let n = columns.first().map_or(2, Vec::len);
    let samples = (0..n).flat_map(|k| columns.iter().map(move |c| c[k])).collect();
    Wave { dt, count: columns.len(), samples, periodic: false }
}

fn outputs(model: &Model, planted: &[Planted], wave: &mut Wave, samples: usize, tolerance: f64) -> Vec<f64> {
    let machine = Machine::new(model, planted).unwrap();
    let x0: Vec<f64> = model.document().states.values().map(|s| s.value).collect();
    run(&machine, wave, &Run { x0: &x0, lead: 0, samples, tolerance }, None).unwrap().outputs
}

fn furthest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_step_on_the_drive_is_its_closed_form() {
    let (mass, b, force) = (95.1, 203.5, 100.0);
    let y = outputs(&zoo("drive").unwrap(), &[], &mut wave(0.01, &[vec![force; 101]]), 101, 1e-10);
    for (k, q) in y.iter().enumerate() {
        let t = k as f64 * 0.01;
        let exact = force / b * (t - mass / b * (1.0 - (-b / mass * t).exp()));
        assert!((q - exact).abs() < 1e-12, "{t}: {q} {exact}");
    }
}

#[test]
fn dry_friction_holds_breaks_and_stops_where_it_must() {
    // A ramp of force on a mass with friction F: rest until the ramp reaches F, then the mass moves without a jump.
    let model = zoo("drive").unwrap().with_parameters(&[("b", 0.0, None)]).unwrap();
    let friction = planted("coulomb_friction", "drive", &[("force", 20.0)]);
    let ramp: Vec<f64> = (0..=400).map(|k| if k <= 200 { 0.3 * f64::from(k) } else { 0.0 }).collect();
    let y = outputs(&model, &[friction], &mut wave(0.01, &[ramp]), 401, 1e-10);
    let (begin, mass, slope) = (20.0 / 30.0, 95.1, 30.0);
    for (k, q) in y.iter().enumerate().take(201) {
        let s = (k as f64 * 0.01 - begin).max(0.0);
        let exact = slope * s * s * s / (6.0 * mass);
        assert!((q - exact).abs() < 1e-11, "{k}: {q} {exact}");
    }
    // It rests at last.
    let (v, q) = (slope * (2.0 - begin) * (2.0 - begin) / (2.0 * mass), y[200]);
    assert!(y[400] > q && furthest(&y[395..], &[y[400]; 6]) < 1e-12 && v > 0.0);
}

#[test]
fn it_agrees_with_the_slow_integrator() {
    let model = zoo("cart_pendulum").unwrap();
    let columns = sines(0.01, 201, 1);
    let held = Inputs::samples(0.0, 0.01, &columns, Hold::FirstOrder).unwrap();
    for effect in [
        planted("coulomb_friction", "cart", &[("force", 1.0)]),
        planted("coulomb_friction", "pendulum", &[("force", 0.05)]),
        planted("quadratic_drag", "cart", &[("drag", 3.0)]),
    ] {
        let given: Vec<(&str, f64)> = effect.parameters.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        let attached = model.attach(&effect.name, &effect.at, &given).unwrap();
        let slow = motion(&attached, &held, &[0.0; 4], 201, 0.01).unwrap();
        let y = outputs(&model, std::slice::from_ref(&effect), &mut wave(0.01, &columns), 201, 1e-10);
        let size = stats::rms(slow.iter().copied());
        let off = furthest(&slow, &y) / size;
        // The slow one has steps of 5e-5 s and is of first order where friction changes sign.
        assert!(off < 1e-4, "{}@{}: {off}", effect.name, effect.at);
        let system = attached.compile();
        let engine = simulate(&system, System::parameters(&system), &held, &Plan::new(2.0, 0.01).unwrap()).unwrap();
        let off = furthest(&engine.outputs, &y) / size;
        assert!(off < 1e-6, "engine, {}@{}: {off}", effect.name, effect.at);
    }
}

#[test]
fn it_converges_with_its_tolerance() {
    let model = zoo("two_mass").unwrap();
    let columns = sines(0.005, 201, 1);
    let effects = [
        planted("stribeck_friction", "load", &[("force", 0.3), ("static_force", 0.5), ("stribeck_velocity", 1.0)]),
        planted("coulomb_friction", "motor", &[("force", 0.2)]),
    ];
    let at = |tolerance| outputs(&model, &effects, &mut wave(0.005, &columns), 201, tolerance);
    let best = at(1e-13);
    let size = stats::rms(best.iter().copied());
    let errors: Vec<f64> = [1e-6, 1e-8, 1e-10].iter().map(|&tol| furthest(&best, &at(tol)) / size).collect();
    assert!(errors[0] > 5.0 * errors[2] && errors[2] < 1e-8, "{errors:?}");
}

#[test]
fn the_hopper_hops_as_the_engine_says() {
    let model = zoo("hopper").unwrap();
    let columns = sines(0.0025, 661, 1);
    let held = Inputs::samples(0.0, 0.0025, &columns, Hold::FirstOrder).unwrap();
    for effects in [vec![], vec![planted("coulomb_friction", "leg", &[("force", 0.5)])]] {
        let y = outputs(&model, &effects, &mut wave(0.0025, &columns), 661, 1e-10);
        let attached = effects.iter().fold(model.clone(), |m, e| {
            let given: Vec<(&str, f64)> = e.parameters.iter().map(|(n, v)| (n.as_str(), *v)).collect();
            m.attach(&e.name, &e.at, &given).unwrap()
        });
        let system = attached.compile();
        let engine = simulate(&system, System::parameters(&system), &held, &Plan::new(1.65, 0.0025).unwrap()).unwrap();
        let off = furthest(&y[..660], &engine.outputs[..660]);
        assert!(off < 1e-7, "{off}");
    }
}

#[test]
fn an_input_that_comes_late_is_the_input_earlier() {
    let model = zoo("cart_pendulum").unwrap();
    let columns = sines(0.01, 101, 1);
    let late = |delay| {
        outputs(&model, &[planted("input_delay", "V", &[("delay", delay)])], &mut wave(0.01, &columns), 101, 1e-11)
    };
    let plain = outputs(&model, &[], &mut wave(0.01, &columns), 101, 1e-11);
    let by_three = late(0.03);
    for k in 3..101 {
        assert!(furthest(&by_three[2 * k..2 * k + 2], &plain[2 * (k - 3)..2 * (k - 3) + 2]) < 1e-10);
    }
    let sensed = |delay: f64| {
        outputs(&model, &[planted("output_delay", "x", &[("delay", delay)])], &mut wave(0.01, &columns), 101, 1e-11)
    };
    // A sensor that is late by the same time, off the grid as well, shows the same in its own channel only.
    for delay in [0.03, 0.0134] {
        let (a, b) = (late(delay), sensed(delay));
        for k in 0..101 {
            assert!((a[2 * k] - b[2 * k]).abs() < 1e-10, "{delay} {k}");
            assert!((b[2 * k + 1] - plain[2 * k + 1]).abs() < 1e-10);
        }
    }
}

#[test]
fn lags_follow_and_play_holds() {
    let model = zoo("drive").unwrap();
    // Lag of a step on an integrator of known form: v' = (y - b v)/M with y = F (1 - exp(-t/tau)).
    let model = model.with_parameters(&[("b", 0.0, None), ("M", 1.0, None)]).unwrap();
    let (force, tau) = (2.0, 0.05);
    let lag = planted("input_lag", "tau", &[("time_constant", tau)]);
    let y = outputs(&model, &[lag], &mut wave(0.01, &[vec![force; 101]]), 101, 1e-11);
    for (k, q) in y.iter().enumerate() {
        let t = k as f64 * 0.01;
        let exact = force * (t * t / 2.0 - tau * t + tau * tau * (1.0 - (-t / tau).exp()));
        assert!((q - exact).abs() < 1e-11, "{t}");
    }
    let gap = planted("output_backlash", "q", &[("gap", 0.2)]);
    let plain = outputs(&model, &[], &mut wave(0.01, &[vec![force; 101]]), 101, 1e-11);
    let y = outputs(&model, &[gap], &mut wave(0.01, &[vec![force; 101]]), 101, 1e-11);
    for (y, q) in y.iter().zip(&plain) {
        assert!((y - (q - 0.1).max(0.0)).abs() < 1e-12);
    }
}

#[test]
fn a_clocked_signal_can_be_acted_on() {
    // A gain on the hopper's whole actuator is a gain on its clock's amplitude where nothing else enters.
    let model = zoo("hopper").unwrap();
    let zero = vec![vec![0.0; 400]];
    let gain = outputs(&model, &[planted("input_gain", "u", &[("gain", 1.01)])], &mut wave(0.0025, &zero), 400, 1e-11);
    let same = model.with_parameters(&[("a", 75.0 * 1.01, None)]).unwrap();
    let direct = outputs(&same, &[], &mut wave(0.0025, &zero), 400, 1e-11);
    assert!(furthest(&gain, &direct) < 1e-9, "{}", furthest(&gain, &direct));
}

#[test]
fn a_motion_that_is_too_stiff_is_given_up_in_bounded_time() {
    // An explicit method takes steps as short as the fastest decay, however small the motion: 1e9 N s/m on 95 kg.
    let machine =
        Machine::new(&zoo("drive").unwrap(), &[planted("viscous_friction", "drive", &[("damping", 1e9)])]).unwrap();
    let mut input = wave(0.01, &[vec![100.0; 101]]);
    let failed = run(&machine, &mut input, &Run { x0: &[0.0, 0.0], lead: 0, samples: 101, tolerance: 1e-10 }, None);
    assert!(failed.is_err_and(|e| e.to_string().contains("so stiff")));
}
