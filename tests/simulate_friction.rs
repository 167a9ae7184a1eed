//! Owns: set-valued dry friction. Truth is a closed form where there is one, else a time-stepping of the set-valued law
//! itself (velocity-level impulses, projected onto the cone), which knows neither modes nor events.

#[path = "oracles/closed_forms.rs"]
mod closed_forms;
#[path = "oracles/set_valued.rs"]
mod set_valued;

use closed_forms::StickSlip;
use ltp_core::model::{Model, Point, System, zoo};
use ltp_core::simulate::{Inputs, Plan, Trajectory, simulate};
use set_valued::Cart;

/// A block under `A sin(w t)`.
const BLOCK: &str = include_str!("oracles/block.toml");

fn block(rig: &StickSlip) -> Model {
    let values = [("m", rig.m, None), ("b", rig.b, None), ("A", rig.amplitude, None), ("w", rig.omega, None)];
    let model = Model::from_toml(BLOCK, "block.toml").unwrap().with_parameters(&values).unwrap();
    model.attach("coulomb_friction", "block", &[("force", rig.coulomb)]).unwrap()
}

fn run(model: &Model, inputs: &Inputs, plan: &Plan) -> Trajectory {
    let system = model.compile_for(vec![], ltp_core::model::Backend::Native);
    let found = simulate(&system, system.parameters(), inputs, plan).unwrap();
    assert!(found.stop.is_finished(), "{}", found.stop.sentence());
    found
}

#[test]
fn stick_slip_is_its_closed_form() {
    let rigs = [
        StickSlip { m: 1.0, b: 0.0, coulomb: 0.8, amplitude: 1.0, omega: 2.0 },
        StickSlip { m: 95.1, b: 203.5, coulomb: 20.4, amplitude: 40.0, omega: 3.0 },
        StickSlip { m: 1.0, b: 0.1, coulomb: 0.2, amplitude: 1.0, omega: 5.0 },
    ];
    for rig in rigs {
        let found = run(&block(&rig), &Inputs::constant(&[]), &Plan::new(20.0, 0.01).unwrap().with_step(1e-3));
        let truth = rig.at(20.0);
        assert_eq!(found.events.len(), truth.switches.len(), "{rig:?}");
        for (event, (time, _)) in found.events.iter().zip(&truth.switches) {
            assert!((event.time - time).abs() <= 1e-9, "{rig:?}: {} {time}", event.time);
        }
        for (t, x) in found.t.iter().zip(found.states.chunks(2)) {
            let b = rig.at(*t);
            assert!((x[0] - b.q).abs() <= 1e-10 && (x[1] - b.v).abs() <= 1e-10, "{rig:?} at {t}: {x:?} {b:?}");
        }
    }
}

#[test]
fn stick_is_exact() {
    let rig = StickSlip { m: 1.0, b: 0.0, coulomb: 0.8, amplitude: 1.0, omega: 2.0 };
    let system = block(&rig).compile();
    let found = run(&block(&rig), &Inputs::constant(&[]), &Plan::new(20.0, 0.01).unwrap().with_step(1e-3));
    let sticks = |k: usize| system.mode_name(found.mode[k]).contains("sticks");
    let mut pairs = 0;
    for k in (1..found.t.len()).filter(|&k| sticks(k) && sticks(k - 1)) {
        let (before, after) = (&found.states[2 * k - 2..2 * k], &found.states[2 * k..2 * k + 2]);
        assert!(after[1].abs() <= 1e-15 && (after[1] - before[1]).abs() <= 1e-15, "{before:?} {after:?}");
        assert!((after[0] - before[0]).abs() <= 1e-16, "{before:?} {after:?}");
        pairs += 1;
    }
    assert!(pairs > 500);
    let held = StickSlip { coulomb: 1.5, ..rig };
    let found = run(&block(&held), &Inputs::constant(&[]), &Plan::new(20.0, 0.01).unwrap());
    assert!(found.states.iter().all(|x| *x == 0.0) && found.events.is_empty());
}

#[test]
fn a_slip_shorter_than_a_step_begins_and_ends() {
    // the load passes the level for 28 ms around its crest; one step spans all of it
    let rig = StickSlip { m: 1.0, b: 0.0, coulomb: 0.9999, amplitude: 1.0, omega: 1.0 };
    let truth = rig.at(20.0);
    for step in [0.5, 0.1, 0.01] {
        let found = run(&block(&rig), &Inputs::constant(&[]), &Plan::new(20.0, 0.5).unwrap().with_step(step));
        assert_eq!(found.events.len(), truth.switches.len(), "step {step}");
        assert!((found.states[found.states.len() - 2] - truth.q).abs() < 1e-6);
    }
}

#[test]
fn a_jump_of_the_input_breaks_both_elements_at_once() {
    let text = r#"
name = "two blocks"
[states]
q1 = {}
v1 = {}
q2 = {}
v2 = {}
[inputs]
f = {}
[flow]
q1 = "v1"
v1 = "f"
q2 = "v2"
v2 = "-f"
[outputs]
q1 = "q1"
[ports.one]
position = "q1"
velocity = "v1"
acts = { v1 = "1" }
[ports.two]
position = "q2"
velocity = "v2"
acts = { v2 = "1" }
"#;
    let model = Model::from_toml(text, "two.toml").unwrap();
    let model = model.attach("coulomb_friction", "one", &[("force", 0.5)]).unwrap();
    let model = model.attach("coulomb_friction", "two", &[("force", 0.5)]).unwrap();
    let force = vec![vec![0.0, 2.0, 2.0, 2.0]];
    let inputs = Inputs::samples(0.0, 1.0, &force, ltp_core::simulate::Hold::ZeroOrder).unwrap();
    let found = run(&model, &inputs, &Plan::new(3.0, 1.0).unwrap().with_step(0.01));
    let x = &found.states[12..];
    for (found, expected) in x.iter().zip([3.0, 3.0, -3.0, -3.0]) {
        assert!((found - expected).abs() < 1e-12, "{x:?}");
    }
}

/// Dry friction at a port for the oracle: level at a speed, row of the state that is its velocity as coefficients, and
/// what its force does to the rates.
struct Element {
    level: fn(f64) -> f64,
    velocity: Vec<f64>,
    acts: fn(&[f64]) -> Vec<f64>,
}

/// Time-stepping of the set-valued law: the smooth part by the midpoint rule, then impulses that bring each port's velocity
/// to rest or as near as the friction cone allows, swept until they agree. First order, and no notion of modes.
fn impulses(
    smooth: &dyn System,
    p: &[f64],
    u: &dyn Fn(f64) -> f64,
    elements: &[Element],
    t_end: f64,
    h: f64,
) -> Vec<f64> {
    let mut x = smooth.initial_state();
    let n = x.len();
    let (mut f, mut middle) = (vec![0.0; n], vec![0.0; n]);
    let steps = (t_end / h).round() as usize;
    let mut last = vec![0.0; elements.len()];
    for k in 0..steps {
        let t = k as f64 * h;
        let columns: Vec<Vec<f64>> = elements.iter().map(|e| (e.acts)(&x)).collect();
        let dry = |f: &mut Vec<f64>, forces: &[f64]| {
            for (c, w) in columns.iter().zip(forces) {
                f.iter_mut().zip(c).for_each(|(f, c)| *f += c * w);
            }
        };
        smooth.flow(0, Point { t, x: &x, u: &[u(t)], p }, &mut f);
        dry(&mut f, &last);
        for i in 0..n {
            middle[i] = x[i] + 0.5 * h * f[i];
        }
        smooth.flow(0, Point { t: t + 0.5 * h, x: &middle, u: &[u(t + 0.5 * h)], p }, &mut f);
        let mut next: Vec<f64> = x.iter().zip(&f).map(|(x, f)| x + h * f).collect();
        let mut impulse = vec![0.0; elements.len()];
        for _ in 0..40 {
            for (j, e) in elements.iter().enumerate() {
                let speed = |x: &[f64]| -> f64 { x.iter().zip(&e.velocity).map(|(x, c)| x * c).sum() };
                let (v, mobility) = (speed(&next), speed(&columns[j]));
                let bound = h * (e.level)(speed(&x));
                let wanted = (impulse[j] - v / mobility).clamp(-bound, bound);
                let change = wanted - impulse[j];
                impulse[j] = wanted;
                next.iter_mut().zip(&columns[j]).for_each(|(x, c)| *x += c * change);
            }
        }
        // positions follow the mean velocity of the step, friction included
        for i in 0..n / 2 {
            next[i] = x[i] + 0.5 * h * (x[n / 2 + i] + next[n / 2 + i]);
        }
        last = impulse.iter().map(|j| j / h).collect();
        x = next;
    }
    x
}

/// The simulation lies within `bound` of the oracle, and the distance falls with the oracle's step.
fn against_impulses(nominal: &Model, dry: &Model, elements: &[Element], amplitude: f64, omega: f64, bound: f64) {
    let t_end = 2.0;
    let u = |t: f64| amplitude * (omega * t).sin();
    let samples: Vec<f64> = (0..=20_000).map(|k| u(1e-4 * f64::from(k))).collect();
    let inputs = Inputs::samples(0.0, 1e-4, &[samples], ltp_core::simulate::Hold::Cubic).unwrap();
    let found = run(dry, &inputs, &Plan::new(t_end, t_end).unwrap().with_step(1e-4));
    let system = nominal.compile();
    let x = &found.states[system.states()..];
    let sticks = found.events.len();
    assert!(sticks >= 4, "the test wants sticking: {sticks} events");
    let distance = |h: f64| {
        let oracle = impulses(&system, system.parameters(), &u, elements, t_end, h);
        let size = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        x.iter().zip(&oracle).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / size
    };
    let (coarse, fine) = (distance(8e-5), distance(1e-5));
    assert!(fine <= bound, "{}: {coarse:e} {fine:e}", nominal.name());
    assert!(fine <= 0.4 * coarse || fine < 1e-8, "{}: {coarse:e} {fine:e}", nominal.name());
}

#[test]
fn stribeck_friction_on_the_drive() {
    let nominal = zoo("drive").unwrap();
    let force = [("force", 20.0), ("static_force", 30.0), ("stribeck_velocity", 0.02)];
    let dry = nominal.attach("stribeck_friction", "drive", &force).unwrap();
    let element = Element {
        level: |v| 20.0 + 10.0 * (-(v / 0.02).powi(2)).exp(),
        velocity: vec![0.0, 1.0],
        acts: |_| vec![0.0, 1.0 / 95.1],
    };
    against_impulses(&nominal, &dry, &[element], 60.0, 7.0, 2e-4);
}

#[test]
fn coupled_elements_on_the_two_mass_drive() {
    let nominal = zoo("two_mass").unwrap();
    let dry = nominal.attach("coulomb_friction", "motor", &[("force", 0.2)]).unwrap();
    let dry = dry.attach("coulomb_friction", "load", &[("force", 0.3)]).unwrap();
    let elements = [
        Element { level: |_| 0.2, velocity: vec![0.0, 0.0, 1.0, 0.0], acts: |_| vec![0.0, 0.0, 1.0 / 0.016, 0.0] },
        Element { level: |_| 0.3, velocity: vec![0.0, 0.0, 0.0, 1.0], acts: |_| vec![0.0, 0.0, 0.0, 1.0 / 0.004] },
    ];
    against_impulses(&nominal, &dry, &elements, 1.0, 9.0, 1e-3);
}

#[test]
fn friction_of_the_cart_under_its_pendulum() {
    let nominal = zoo("cart_pendulum").unwrap();
    let dry = nominal.attach("coulomb_friction", "cart", &[("force", 1.5)]).unwrap();
    let acts = |x: &[f64]| {
        // a force on the cart, through the inverse of the mass matrix
        let (a, b, d) = (0.78, 0.063 * x[1].cos(), 0.0252);
        let determinant = a * d - b * b;
        vec![0.0, 0.0, d / determinant, -b / determinant]
    };
    let element = Element { level: |_| 1.5, velocity: vec![0.0, 0.0, 1.0, 0.0], acts };
    against_impulses(&nominal, &dry, &[element], 3.0, 6.0, 1e-3);
}

#[test]
fn the_cart_moves_as_an_adaptive_integration_of_the_set_valued_law_says() {
    let cart = Cart { friction: 0.8, volts: 2.0, omega: 5.0 };
    let model = zoo("cart_pendulum").unwrap().attach("coulomb_friction", "cart", &[("force", cart.friction)]).unwrap();
    let driven = model.with_input_expressions(&[("V", "2*sin(5*t)")]).unwrap();
    let compiled = driven.compile();
    let plan = Plan::new(6.0, 0.01).unwrap().with_step(5e-4);
    let found = simulate(&compiled, compiled.parameters(), &Inputs::constant(&[]), &plan).unwrap();
    let (truth, switches) = cart.motion(&found.t, 1e-13);
    assert!(switches >= 15, "stick and slip must alternate for the comparison to mean something: {switches}");
    assert_eq!(found.events.len(), switches);
    let width = found.outputs.len() / found.t.len();
    let far = (0..found.t.len())
        .flat_map(|k| (0..2).map(move |j| (k, j)))
        .map(|(k, j)| (found.outputs[k * width + j] - truth[k][j]).abs())
        .fold(0.0, f64::max);
    assert!(far < 1e-9, "largest difference {far}");
}
