//! Owns: how simulations end early. Zeno, chattering, grazing, escape and the step limit are results: the trajectory up to
//! there is kept and right.

#[path = "oracles/closed_forms.rs"]
mod closed_forms;

use closed_forms::BouncingBall;
use ltp_core::Error;
use ltp_core::model::{Model, System, zoo};
use ltp_core::simulate::{Inputs, Plan, Stop, Trajectory, simulate};

fn run(model: &Model, plan: &Plan) -> Trajectory {
    let system = model.compile();
    let found = simulate(&system, system.parameters(), &Inputs::constant(&vec![0.0; system.inputs()]), plan).unwrap();
    let n = found.t.len();
    let rows = [found.states.len() / system.states(), found.outputs.len() / system.outputs(), found.mode.len()];
    assert_eq!(rows, [n; 3], "a partial trajectory has complete rows");
    assert!(found.states.iter().all(|x| x.is_finite()));
    found
}

fn one_state(flow: &str, x0: f64, transition: &str) -> Model {
    let text = format!(
        "name = 'test'\n[states]\nx = {{ value = {x0} }}\n[flow]\nx = '{flow}'\n[outputs]\nx = 'x'\n{transition}"
    );
    Model::from_toml(&text, "test.toml").unwrap()
}

#[test]
fn zeno_names_the_accumulation_time_and_keeps_what_came_before() {
    let ball = BouncingBall { g: 9.81, e: 0.8, y0: 1.0 };
    for step in [1e-2, 1e-3] {
        let found = run(&zoo("bouncing_ball").unwrap(), &Plan::new(6.0, 0.01).unwrap().with_step(step));
        let Stop::Zeno { time, accumulation, ref event, .. } = found.stop else { panic!("{:?}", found.stop) };
        assert!((accumulation - ball.zeno()).abs() < 1e-9, "{accumulation} {}", ball.zeno());
        assert!(time < accumulation && event == "impact");
        for (n, e) in found.events.iter().enumerate().take(60) {
            assert!((e.time - ball.impact(n as u32 + 1)).abs() < 1e-11, "impact {n}");
        }
        for (t, x) in found.t.iter().zip(found.states.chunks(2)) {
            assert!((x[0] - ball.at(*t).0).abs() < 1e-9, "at {t}");
        }
        assert_eq!(found.t.len(), 407);
    }
}

#[test]
fn chattering_between_two_modes_is_named() {
    let text = r#"
name = "switch"
[states]
x = { value = 1.005 }
[modes.above.flow]
x = "-1"
[modes.below.flow]
x = "1"
[[transitions]]
name = "down"
from = "above"
to = "below"
guard = "x"
[[transitions]]
name = "up"
from = "below"
to = "above"
guard = "x"
direction = "rising"
[outputs]
x = "x"
"#;
    let found = run(&Model::from_toml(text, "switch.toml").unwrap(), &Plan::new(2.0, 0.01).unwrap());
    let Stop::Chattering { time, .. } = found.stop else { panic!("{:?} {:?}", found.stop, found.events.len()) };
    assert!((time - 1.005).abs() < 1e-9);
    assert_eq!(found.t.len(), 101);
}

#[test]
fn grazing_is_named_whether_rounding_lets_it_cross_or_not() {
    let text = r#"
name = "thrown up to a ceiling"
[states]
y = {}
v = { value = 1.0 }
[flow]
y = "v"
v = "-2"
[[transitions]]
name = "ceiling"
guard = "y - HEIGHT"
direction = "rising"
reset = { v = "-v" }
[outputs]
y = "y"
"#;
    // the apex is at 0.25
    for height in ["0.25", "0.2500000000000001", "0.2499999999999999"] {
        let model = Model::from_toml(&text.replace("HEIGHT", height), "throw.toml").unwrap();
        let found = run(&model, &Plan::new(2.0, 0.07).unwrap().with_step(0.07));
        let Stop::Grazing { time, ref event, .. } = found.stop else { panic!("{height}: {:?}", found.stop) };
        assert!((time - 0.5).abs() < 1e-6 && event == "ceiling");
        assert_eq!(found.t.len(), 8);
    }
    let lower = Model::from_toml(&text.replace("HEIGHT", "0.249"), "throw.toml").unwrap();
    let found = run(&lower, &Plan::new(0.6, 0.07).unwrap());
    assert!(found.stop.is_finished() && found.events.len() == 1, "a shallow crossing is a crossing: {:?}", found.stop);
}

#[test]
fn a_rebound_shorter_than_a_step_is_seen() {
    let model = zoo("bouncing_ball").unwrap().with_parameters(&[("e", 0.01, None)]).unwrap();
    let ball = BouncingBall { g: 9.81, e: 0.01, y0: 1.0 };
    let found = run(&model, &Plan::new(0.4606, 0.4606).unwrap().with_step(0.1));
    assert!(found.events.len() >= 2);
    assert!((found.events[1].time - ball.impact(2)).abs() < 1e-12);
}

#[test]
fn escape_names_the_last_finite_time() {
    let found = run(&one_state("x^2", 1.0, ""), &Plan::new(2.0, 0.001).unwrap());
    let Stop::Escape { time, state, .. } = found.stop else { panic!("{:?}", found.stop) };
    assert!((time - 1.0).abs() < 0.02 && state == "x");
    let k = 500;
    assert!((found.states[k] - 1.0 / (1.0 - found.t[k])).abs() < 1e-9);
}

#[test]
fn step_limit_keeps_the_part_that_was_reached() {
    let mut plan = Plan::new(2.0, 0.001).unwrap();
    plan.max_steps = 777;
    let found = run(&one_state("-x", 1.0, ""), &plan);
    assert!(matches!(found.stop, Stop::StepLimit { limit: 777, .. }), "{:?}", found.stop);
    assert_eq!(found.t.len(), 778);
    assert!((found.states[777] - (-0.777f64).exp()).abs() < 1e-12);
    assert!(found.stop.sentence().contains("777"));
}

#[test]
fn what_cannot_be_right_is_an_error() {
    let system = zoo("drive").unwrap().compile();
    let plan = Plan::new(1.0, 0.1).unwrap();
    let p = system.parameters();
    let shape = simulate(&system, p, &Inputs::constant(&[]), &plan).unwrap_err();
    assert!(matches!(shape, Error::Shape { expected: 1, found: 0, .. }), "{shape}");
    let shape = simulate(&system, &p[1..], &Inputs::constant(&[0.0]), &plan).unwrap_err();
    assert!(matches!(shape, Error::Shape { expected: 2, found: 1, .. }), "{shape}");
    let nan = simulate(&system, &[f64::NAN, 1.0], &Inputs::constant(&[0.0]), &plan).unwrap_err();
    assert!(matches!(nan, Error::NotFinite { row: 0, .. }), "{nan}");
    let state = simulate(&system, p, &Inputs::constant(&[0.0]), &plan.from(&[0.0])).unwrap_err();
    assert!(matches!(state, Error::Shape { expected: 2, found: 1, .. }), "{state}");
    for (end, dt) in [(0.0, 0.1), (1.0, -0.1), (f64::INFINITY, 0.1), (1.0, f64::NAN), (1e9, 1e-9)] {
        assert!(matches!(Plan::new(end, dt), Err(Error::OutOfRange { .. })), "{end} {dt}");
    }
}
