//! Owns: how accurate a simulation is. Closed forms give the truth: orders of convergence, event times, the sample grid,
//! inputs between samples, simultaneous events; the loop over stages is the oracle of the compiled step.

#[path = "oracles/closed_forms.rs"]
mod closed_forms;

use closed_forms::{ThreeModeHopper, drive_step, duffing};
use ltp_core::model::{Backend, Compiled, Model, System, zoo};
use ltp_core::numeric::spline::{Cubic, Ends};
use ltp_core::simulate::{Hold, Inputs, Plan, Trajectory, simulate};

fn run(system: &Compiled, inputs: &Inputs, plan: &Plan) -> Trajectory {
    let trajectory = simulate(system, system.parameters(), inputs, plan).unwrap();
    assert!(trajectory.stop.is_finished(), "{}", trajectory.stop.sentence());
    trajectory
}

fn hopper_run(step: f64) -> Trajectory {
    let system = zoo("three_mode_hopper").unwrap().compile();
    run(&system, &Inputs::constant(&[]), &Plan::new(100.0, 0.1).unwrap().with_step(step))
}

fn last(trajectory: &Trajectory, nx: usize) -> &[f64] {
    &trajectory.states[trajectory.states.len() - nx..]
}

/// Slopes of log(error) over log(step) from one step to the next.
fn slopes(steps: &[f64], errors: &[f64]) -> Vec<f64> {
    let pairs = steps.windows(2).zip(errors.windows(2));
    pairs.map(|(h, e)| (e[0] / e[1]).ln() / (h[0] / h[1]).ln()).collect()
}

#[test]
fn three_mode_hopper_to_the_promised_digits() {
    let truth = ThreeModeHopper::default().at(100.0);
    let found = hopper_run(1e-3);
    assert!((last(&found, 2)[0] - truth.y).abs() <= 1e-8);
    assert_eq!(found.events.len(), 219);
    for (event, (name, time)) in found.events.iter().zip(&truth.events) {
        assert_eq!(event.name, *name);
        assert!((event.time - time).abs() <= 2e-9, "{name} at {time}: found {}", event.time);
    }
}

#[test]
fn order_five_where_the_motion_is_smooth() {
    let text = r#"
name = "duffing"
[states]
x = { value = 1.0 }
v = {}
[parameters]
m = { value = 1.0 }
k = { value = 1.0 }
k_3 = { value = 0.5 }
[flow]
x = "v"
v = "-(k*x + k_3*x^3)/m"
[outputs]
x = "x"
"#;
    let system = Model::from_toml(text, "duffing.toml").unwrap().compile();
    let truth = duffing(1.0, 1.0, 0.5, 1.0, 20.0);
    let steps = [0.1, 0.05, 0.025, 0.0125];
    let error = |h: &f64| {
        let found = run(&system, &Inputs::constant(&[]), &Plan::new(20.0, 0.1).unwrap().with_step(*h));
        let x = last(&found, 2);
        ((x[0] - truth.0).powi(2) + (x[1] - truth.1).powi(2)).sqrt()
    };
    let errors: Vec<f64> = steps.iter().map(error).collect();
    for slope in slopes(&steps, &errors) {
        assert!((slope - 5.0).abs() <= 0.1, "slope {slope}, errors {errors:?}");
    }
}

#[test]
fn order_five_through_events() {
    let truth = ThreeModeHopper::default().at(100.0);
    let steps = [1e-2, 5e-3, 2e-3, 1e-3, 5e-4];
    let errors: Vec<f64> = steps.iter().map(|&h| (last(&hopper_run(h), 2)[0] - truth.y).abs()).collect();
    for slope in slopes(&steps, &errors) {
        assert!(slope >= 4.9, "slope {slope}, errors {errors:?}");
    }
}

#[test]
fn sample_grid_is_kept_after_events() {
    let model = ThreeModeHopper::default();
    let found = hopper_run(1e-3);
    for (k, (t, x)) in found.t.iter().zip(found.states.chunks(2)).enumerate() {
        assert_eq!(*t, k as f64 * 0.1);
        assert!((x[0] - model.at(*t).y).abs() <= 1e-8, "at {t}");
    }
}

#[test]
fn compiled_step_equals_the_loop_over_stages() {
    let wave: Vec<f64> = (0..=400).map(|k| 0.3 * (0.05 * f64::from(k)).sin()).collect();
    for name in ["three_mode_hopper", "cart_pendulum", "hopper", "mathieu", "van_der_pol"] {
        let model = zoo(name).unwrap();
        let count = model.inputs().len();
        let columns = vec![wave.clone(); count];
        let inputs = Inputs::samples(0.0, 0.01, &columns, Hold::FirstOrder).unwrap();
        let plan = Plan::new(4.0, 0.01).unwrap().with_step(1e-3);
        let [native, plain] =
            [Backend::Native, Backend::Plain].map(|b| run(&model.compile_for(vec![], b), &inputs, &plan));
        assert_eq!(native, plain, "{name}");
    }
}

/// A mass without friction, or with, under the sampled force: q and v at the end.
fn carriage(b: f64, force: &[f64], dt: f64, hold: Hold, step: f64) -> (f64, f64) {
    let model = zoo("drive").unwrap().with_parameters(&[("M", 2.0, None), ("b", b, None)]).unwrap();
    let inputs = Inputs::samples(0.0, dt, &[force.to_vec()], hold).unwrap();
    let end = (force.len() - 1) as f64 * dt;
    let found = run(&model.compile(), &inputs, &Plan::new(end, end).unwrap().with_step(step));
    (last(&found, 2)[0], last(&found, 2)[1])
}

const FORCE: [f64; 9] = [0.0, 1.0, -2.0, 3.0, 0.5, 0.5, -1.0, 4.0, 2.0];

#[test]
fn zero_order_hold_is_the_closed_form_piece_by_piece() {
    for step in [0.05, 0.03] {
        let (mut q, mut v) = (0.0, 0.0);
        for f in &FORCE[..8] {
            (q, v) = drive_step(2.0, 0.7, *f, q, v, 0.1);
        }
        let found = carriage(0.7, &FORCE, 0.1, Hold::ZeroOrder, step);
        assert!((found.0 - q).abs() < 1e-11 && (found.1 - v).abs() < 1e-11, "step {step}: {found:?}, expected {q} {v}");
    }
}

#[test]
fn first_order_hold_and_cubic_are_integrated_exactly() {
    let dt = 0.1;
    let grid: Vec<f64> = (0..FORCE.len()).map(|k| k as f64 * dt).collect();
    let spline = Cubic::new(&grid, &FORCE, Ends::Natural).unwrap();
    let line = |w: &[f64]| [w[0], (w[1] - w[0]) / dt, 0.0, 0.0];
    let lines: Vec<[f64; 4]> = FORCE.windows(2).map(line).collect();
    for (hold, pieces) in [(Hold::FirstOrder, lines), (Hold::Cubic, spline.pieces().to_vec())] {
        let (mut q, mut v) = (0.0, 0.0);
        for c in &pieces {
            let moment = |j: usize, n: f64| c[j] * dt.powf(n) / 2.0;
            let dv: f64 = (0..4).map(|j| moment(j, j as f64 + 1.0) / (j as f64 + 1.0)).sum();
            let dq: f64 = (0..4).map(|j| moment(j, j as f64 + 2.0) / ((j as f64 + 1.0) * (j as f64 + 2.0))).sum();
            (q, v) = (q + v * dt + dq, v + dv);
        }
        // 0.04 does not divide the sampling step: a step must end where a polynomial does
        for step in [0.1, 0.04] {
            let found = carriage(0.0, &FORCE, dt, hold, step);
            assert!((found.0 - q).abs() < 1e-13 && (found.1 - v).abs() < 1e-13, "{hold:?} {step}: {found:?}, {q} {v}");
        }
    }
}

#[test]
fn simultaneous_events_fire_in_declared_order() {
    let text = r#"
name = "two balls and a counter"
[states]
a = { value = 1.0 }
va = {}
b = { value = 1.0 }
vb = {}
n = {}
[flow]
a = "va"
va = "-9.81"
b = "vb"
vb = "-9.81"
n = "0"
[[transitions]]
name = "second ball"
guard = "b"
reset = { vb = "-0.5*vb", n = "10*n + 2" }
[[transitions]]
name = "first ball"
guard = "a"
reset = { va = "-0.5*va", n = "10*n + 1" }
[outputs]
n = "n"
"#;
    let system = Model::from_toml(text, "balls.toml").unwrap().compile();
    let found = run(&system, &Inputs::constant(&[]), &Plan::new(0.6, 0.1).unwrap().with_step(1e-3));
    let names: Vec<&str> = found.events.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["second ball", "first ball"]);
    assert!((found.events[0].time - (2.0f64 / 9.81).sqrt()).abs() < 1e-12);
    assert_eq!(found.events[0].time, found.events[1].time);
    assert_eq!(last(&found, 5)[4], 21.0);
}

#[test]
fn a_section_that_does_not_stop_the_motion_counts_each_passage_once() {
    let text = r#"
name = "counter"
[states]
x = { value = 1.0 }
v = {}
n = {}
[flow]
x = "v"
v = "-100*x"
n = "0"
[[transitions]]
name = "down"
guard = "x - 0.3"
direction = "DIRECTION"
reset = { n = "n + 1" }
[outputs]
x = "x"
"#;
    for (direction, passages) in [("falling", 159), ("rising", 159), ("either", 318)] {
        let system = Model::from_toml(&text.replace("DIRECTION", direction), "counter.toml").unwrap().compile();
        let found = run(&system, &Inputs::constant(&[]), &Plan::new(100.0, 0.1).unwrap().with_step(2e-3));
        assert_eq!(last(&found, 3)[2], f64::from(passages), "{direction}");
    }
}
