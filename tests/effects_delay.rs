//! Owns: what needs the past. Late inputs against moved samples, late and loose sensors against what they should show, their
//! derivatives against central differences, and who refuses them.

#[path = "oracles/runs.rs"]
mod runs;

use ltp_core::cycle::{Options, cycle};
use ltp_core::model::{Backend, Model, System, zoo};
use ltp_core::simulate::engine::{Engine, Settings};
use ltp_core::simulate::sensor::Sensor;
use ltp_core::simulate::{Hold, Inputs, Plan, simulate};
use runs::{apart, run};

/// Samples of 2 s that do not begin at zero.
fn column(dt: f64) -> Vec<f64> {
    (0..=(2.0 / dt).round() as usize).map(|k| 40.0 * (3.0 * (k as f64 * dt) + 0.8).sin()).collect()
}

/// What samples held in a way are at a time, zero before them.
fn at(column: &[f64], dt: f64, hold: Hold, t: f64) -> f64 {
    if t < -1e-12 {
        return 0.0;
    }
    let k = ((t / dt + 1e-9).floor() as usize).min(column.len() - 1);
    let part = if k + 1 < column.len() { t / dt - k as f64 } else { 0.0 };
    match hold {
        Hold::ZeroOrder => column[k],
        _ => column[k] + part * (column[(k + 1).min(column.len() - 1)] - column[k]),
    }
}

#[test]
fn a_late_input_is_the_input_moved() {
    let drive = zoo("drive").unwrap();
    let (dt, fine) = (0.01, 1e-4);
    for (hold, delay) in
        [(Hold::FirstOrder, 0.05), (Hold::FirstOrder, 0.0137), (Hold::ZeroOrder, 0.05), (Hold::ZeroOrder, 0.0137)]
    {
        let samples = column(dt);
        let given = Inputs::samples(0.0, dt, std::slice::from_ref(&samples), hold).unwrap();
        // Every corner of the moved input lies on the fine grid; the jump at its beginning needs the grid of a zero-order hold.
        let steps = (1.6 / fine) as usize;
        let moved: Vec<f64> = (0..=steps).map(|k| at(&samples, dt, hold, k as f64 * fine - delay)).collect();
        let moved = Inputs::samples(0.0, fine, &[moved], hold).unwrap();
        let late = drive.attach("input_delay", "tau", &[("delay", delay)]).unwrap();
        let found = run(&late, &given, 1.5, 0.01, 0.01);
        let truth = run(&drive, &moved, 1.5, 0.01, 0.01);
        // With straight lines the jump at the beginning is a ramp of one fine step in `moved`.
        let bound = if hold == Hold::ZeroOrder { 1e-12 } else { 2e-4 };
        assert!(
            apart(&found.outputs, &truth.outputs) < bound,
            "{hold:?} {delay}: {}",
            apart(&found.outputs, &truth.outputs)
        );
        assert_eq!(found.inputs[3], samples[3]);
    }
}

#[test]
fn a_late_input_that_begins_at_zero_is_exact_with_straight_lines() {
    let drive = zoo("drive").unwrap();
    let samples: Vec<f64> = (0..200).map(|k| 40.0 * (0.03 * f64::from(k)).sin()).collect();
    let given = Inputs::samples(0.0, 0.01, std::slice::from_ref(&samples), Hold::FirstOrder).unwrap();
    let moved: Vec<f64> =
        (0..16000).map(|k| at(&samples, 0.01, Hold::FirstOrder, 1e-4 * f64::from(k) - 0.0137)).collect();
    let moved = Inputs::samples(0.0, 1e-4, &[moved], Hold::FirstOrder).unwrap();
    let late = drive.attach("input_delay", "tau", &[("delay", 0.0137)]).unwrap();
    assert!(apart(&run(&late, &given, 1.5, 0.01, 0.01).outputs, &run(&drive, &moved, 1.5, 0.01, 0.01).outputs) < 1e-12);
}

#[test]
fn the_past_of_an_input_is_what_the_document_says() {
    let text = zoo("drive").unwrap().to_toml().unwrap();
    let with = |before: &str| {
        let text = text.replace("[inputs.tau]\n", &format!("[inputs.tau]\nbefore = {before}\n"));
        let model = Model::from_toml(&text, "drive").unwrap();
        let late = model.attach("input_delay", "tau", &[("delay", 0.137)]).unwrap();
        assert_eq!(Model::from_toml(&late.to_toml().unwrap(), "again").unwrap().document(), late.document());
        late
    };
    let drive = zoo("drive").unwrap();
    let held = run(&with("\"hold\""), &Inputs::constant(&[7.0]), 1.0, 0.1, 0.01);
    assert!(apart(&held.outputs, &run(&drive, &Inputs::constant(&[7.0]), 1.0, 0.1, 0.01).outputs) < 1e-12);
    let rested = run(&with("\"zero\""), &Inputs::constant(&[7.0]), 1.0, 0.1, 0.01);
    let system = drive.compile();
    let plan = Plan::new(0.863, 0.863).unwrap().with_step(0.01);
    let truth = simulate(&system, system.parameters(), &Inputs::constant(&[7.0]), &plan).unwrap();
    assert!((rested.outputs[10] - truth.outputs[1]).abs() < 1e-13);
    // A record of one period, repeated before it: the same as the samples turned by the delay.
    let period = |k: i32| 5.0 * (2.0 * std::f64::consts::PI * f64::from(k) / 100.0).sin() + 2.0;
    let wave = |turn: i32| {
        let samples: Vec<f64> = (0..=100).map(|k| period(k - turn)).collect();
        Inputs::samples(0.0, 0.01, &[samples], Hold::FirstOrder).unwrap()
    };
    let model = with("{ periodic = \"1.0\" }").with_parameters(&[("input_delay@tau.delay", 0.13, None)]).unwrap();
    let turned = run(&drive, &wave(13), 1.0, 0.1, 0.01);
    assert!(apart(&run(&model, &wave(0), 1.0, 0.1, 0.01).outputs, &turned.outputs) < 1e-12);
    let wrong = text.replace("[inputs.tau]\n", "[inputs.tau]\nbefore = \"rest\"\n");
    assert!(Model::from_toml(&wrong, "drive").err().unwrap().to_string().contains("\"hold\""));
}

/// Derivatives of the states at the end by the delay, against central differences (ahead of zero, one-sided ones).
fn by_delay(model: &Model, name: &str, u: &Inputs, t_end: f64, step: f64, tolerance: f64) {
    let k = model.parameter(name).unwrap();
    let system = model.compile_for(vec![k], Backend::Native);
    let end = |delay: f64, derivatives: bool| {
        let mut p = system.parameters().to_vec();
        p[k] = delay;
        let mut plan = Plan::new(t_end, t_end).unwrap().with_step(step);
        plan.derivatives = derivatives;
        let found = simulate(&system, &p, u, &plan).unwrap();
        assert!(found.stop.is_finished(), "{}", found.stop.sentence());
        let nx = system.states();
        let slope = found.sensitivities[found.sensitivities.len() / 2..].to_vec();
        (found.states[nx..].to_vec(), slope)
    };
    let delay = system.parameters()[k];
    let h = 1e-6;
    let (base, slope) = end(delay, true);
    let (high, low) = (end(delay + h, false).0, end(delay - h, false).0);
    let nx = base.len();
    for i in 0..nx {
        let expected = (high[i] - low[i]) / (2.0 * h);
        let found = slope[i * (nx + 1) + nx];
        let size = expected.abs().max(1e-3 * base[i].abs());
        assert!((found - expected).abs() <= tolerance * size, "{name}, state {i}: found {found}, expected {expected}");
    }
}

#[test]
fn derivatives_by_the_delay_are_exact() {
    let cart = zoo("cart_pendulum").unwrap();
    for hold in [Hold::FirstOrder, Hold::ZeroOrder, Hold::Cubic] {
        let u = Inputs::samples(0.0, 0.01, &[column(0.01)], hold).unwrap();
        let model = cart.attach("input_delay", "V", &[("delay", 0.0437)]).unwrap();
        by_delay(&model, "input_delay@V.delay", &u, 0.9, 5e-3, 1e-6);
    }
    // The hopper's whole actuator, its clock included, through liftoff and touchdown.
    let hopper = zoo("hopper").unwrap().attach("input_delay", "u", &[("delay", 0.004)]).unwrap();
    let u = Inputs::samples(0.0, 0.01, &[column(0.01).iter().map(|v| 0.1 * v).collect()], Hold::FirstOrder).unwrap();
    by_delay(&hopper, "input_delay@u.delay", &u, 0.5, 2e-4, 1e-5);
    // Two delays in a row, dry friction behind them.
    let drive = zoo("drive").unwrap().attach("coulomb_friction", "drive", &[("force", 8.0)]).unwrap();
    let model = drive.attach("input_gain", "tau", &[("gain", 1.1)]).unwrap();
    let model = model.attach("input_delay", "tau", &[("delay", 0.021)]).unwrap();
    by_delay(
        &model,
        "input_delay@tau.delay",
        &Inputs::samples(0.0, 0.01, &[column(0.01)], Hold::ZeroOrder).unwrap(),
        1.7,
        2e-3,
        1e-5,
    );
}

#[test]
fn at_no_delay_the_derivative_is_that_of_the_first_delay() {
    let model = zoo("drive").unwrap().attach("input_delay", "tau", &[]).unwrap();
    let k = model.parameter("input_delay@tau.delay").unwrap();
    let system = model.compile_for(vec![k], Backend::Native);
    for hold in [Hold::FirstOrder, Hold::ZeroOrder] {
        let u = Inputs::samples(0.0, 0.01, &[column(0.01)], hold).unwrap();
        let end = |delay: f64| {
            let mut p = system.parameters().to_vec();
            p[k] = delay;
            simulate(&system, &p, &u, &Plan::new(0.7, 0.7).unwrap().with_step(5e-3).with_derivatives()).unwrap()
        };
        let (base, next, far) = (end(0.0), end(1e-5), end(2e-5));
        for i in 0..2 {
            let expected = (4.0 * next.states[2 + i] - far.states[2 + i] - 3.0 * base.states[2 + i]) / 2e-5;
            let found = base.sensitivities[6 + 3 * i + 2];
            assert!((found - expected).abs() < 1e-6 * expected.abs(), "{hold:?} {i}: {found} {expected}");
        }
    }
}

#[test]
fn what_depends_on_the_motion_cannot_be_delayed() {
    let cart = zoo("cart_pendulum").unwrap();
    let text = cart.attach("input_delay", "F", &[]).err().unwrap().to_string();
    assert!(text.contains("depends on the motion") && text.contains("input_delay"), "{text}");
    let lagging = cart.attach("input_lag", "V", &[]).unwrap();
    assert!(lagging.attach("input_delay", "V", &[]).err().unwrap().to_string().contains("before any lag"));
    assert_eq!(zoo("hopper").unwrap().places("input_delay").unwrap(), ["u_c", "u"]);
    assert_eq!(cart.places("output_delay").unwrap(), ["x", "theta"]);
}

#[test]
fn methods_that_know_only_the_present_refuse_the_past() {
    let hopper = zoo("hopper").unwrap();
    for (effect, at) in [("input_delay", "u_c"), ("output_delay", "h"), ("output_backlash", "h")] {
        let system = hopper.attach(effect, at, &[]).unwrap().compile();
        let text = cycle(&system, system.parameters(), &Options::default()).err().unwrap().to_string();
        assert!(text.contains("cycle") && text.contains("leave that effect out"), "{text}");
    }
}

/// Outputs and their derivatives by the free parameters at every sample.
fn shown(model: &Model, free: Vec<usize>, p: &[f64], samples: u64, step: f64, substeps: u64) -> (Vec<f64>, Vec<f64>) {
    let system = model.compile_for(free, Backend::Native);
    let inputs = Inputs::constant(&vec![0.0; system.inputs()]);
    let settings = Settings { t0: 0.0, step, max_steps: 1_000_000, derivatives: true };
    let (x0, mode) = (system.initial_state(), system.initial_mode());
    let mut engine = Engine::new(&system, p, &inputs, &x0, mode, settings).unwrap();
    let mut sensor = Sensor::new(&system, p, &inputs, &x0, mode, settings).unwrap();
    let (ny, ns) = (system.outputs(), system.states() + system.free().len());
    let (mut y, mut dy) = (vec![0.0; ny], vec![0.0; ny * ns]);
    let (mut all, mut slopes) = (Vec::new(), Vec::new());
    for k in 0..samples {
        sensor.advance(&mut engine, k * substeps, &mut y, &mut dy).unwrap();
        all.extend_from_slice(&y);
        slopes.extend_from_slice(&dy);
    }
    (all, slopes)
}

#[test]
fn a_late_sensor_shows_what_was_there() {
    let pendulum = zoo("pendulum").unwrap();
    let u = Inputs::constant(&[0.0]);
    let fine = run(&pendulum, &u, 2.0, 1e-4, 1e-4).outputs;
    for delay in [0.0, 0.02, 0.0137, 0.1234, 1.03, 3e-4] {
        let late = pendulum.attach("output_delay", "theta", &[("delay", delay)]).unwrap();
        let found = run(&late, &u, 2.0, 0.01, 2e-3);
        for (t, y) in found.t.iter().zip(&found.outputs) {
            let back = ((t - delay) / 1e-4).round();
            if back >= 0.0 {
                assert!((y - fine[back as usize]).abs() < 1e-9, "{delay} {t}: {y} {}", fine[back as usize]);
            }
        }
    }
}

#[test]
fn a_loose_sensor_stands_still_after_reversals() {
    let pendulum = zoo("pendulum").unwrap();
    let u = Inputs::constant(&[0.0]);
    // Play by its definition, along outputs at every millisecond of the finest and at every grid point of the run.
    let played = |every: f64| -> Vec<f64> {
        let plain = run(&pendulum, &u, 3.0, every, 2e-3).outputs;
        let mut play = plain[0];
        let shown = plain.iter().map(|y| {
            play = play.clamp(y - 0.15, y + 0.15);
            play
        });
        shown.collect::<Vec<_>>().into_iter().step_by((0.01 / every).round() as usize).collect()
    };
    let loose = pendulum.attach("output_backlash", "theta", &[("gap", 0.3)]).unwrap();
    let found = run(&loose, &u, 3.0, 0.01, 2e-3).outputs;
    let truth = played(2e-5);
    assert!(apart(&found, &truth) < 1e-8, "{}", apart(&found, &truth));
    assert!(apart(&played(2e-3), &truth) > 30.0 * apart(&found, &truth), "extremes lie between grid points");
    // In the order of attachment: a late sensor with play behind it.
    let both = pendulum.attach("output_delay", "theta", &[("delay", 0.05)]).unwrap();
    let both = run(&both.attach("output_backlash", "theta", &[("gap", 0.3)]).unwrap(), &u, 3.0, 0.01, 2e-3).outputs;
    assert!(apart(&both[100..], &found[95..found.len() - 5]) < 1e-4);
}

#[test]
fn sensors_are_differentiated() {
    let model = zoo("pendulum").unwrap().attach("output_bias", "theta", &[("bias", 0.1)]).unwrap();
    let model = model.attach("output_delay", "theta", &[("delay", 0.0137)]).unwrap();
    let model = model.attach("output_backlash", "theta", &[("gap", 0.2)]).unwrap();
    let names = ["l", "output_bias@theta.bias", "output_delay@theta.delay", "output_backlash@theta.gap"];
    let free: Vec<usize> = names.iter().map(|n| model.parameter(n).unwrap()).collect();
    let p: Vec<f64> = model.parameters().iter().map(|p| p.value).collect();
    let (_, slopes) = shown(&model, free.clone(), &p, 150, 2e-3, 5);
    let ns = 2 + free.len();
    for (c, &i) in free.iter().enumerate() {
        let moved = |d: f64| {
            let mut q = p.clone();
            q[i] += d;
            shown(&model, free.clone(), &q, 150, 2e-3, 5).0
        };
        let h = 1e-6;
        let (high, low) = (moved(h), moved(-h));
        let size = slopes.iter().skip(2 + c).step_by(ns).fold(1e-3f64, |m, v| m.max(v.abs()));
        for k in 0..150 {
            let expected = (high[k] - low[k]) / (2.0 * h);
            let found = slopes[k * ns + 2 + c];
            assert!((found - expected).abs() <= 1e-6 * size, "{} at {k}: {found} {expected}", names[c]);
        }
    }
}
