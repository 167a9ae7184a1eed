//! Owns: effects at ports against closed forms, hand-written models and textbook frequencies.

use ltp_core::model::{Model, System, zoo};
use ltp_core::simulate::{Hold, Inputs, Plan, Trajectory, simulate};

fn run(model: &Model, x0: &[f64], u: &Inputs, t_end: f64, dt: f64, step: f64) -> Trajectory {
    let system = model.compile();
    let plan = Plan::new(t_end, dt).unwrap().with_step(step).from(x0);
    let found = simulate(&system, system.parameters(), u, &plan).unwrap();
    assert!(found.stop.is_finished(), "{}", found.stop.sentence());
    found
}

/// Largest difference of two runs' outputs, over the largest output.
fn apart(a: &Trajectory, b: &Trajectory) -> f64 {
    let size = b.outputs.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    a.outputs.iter().zip(&b.outputs).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size
}

fn wave(count: usize, amplitude: f64) -> Inputs {
    let column: Vec<f64> = (0..2001).map(|k| amplitude * (0.02 * f64::from(k)).sin()).collect();
    Inputs::samples(0.0, 0.001, &vec![column; count], Hold::Cubic).unwrap()
}

/// A mass on a linear spring, 2 kg and 50 N/m: 5 rad/s.
const SLIDER: &str = r#"
name = "slider"
[states]
q = { value = 0.1, unit = "m" }
v = { value = 0.0, unit = "m/s" }
[inputs]
u = { unit = "N", value = 0.0 }
[parameters]
m = { value = 2.0, sd = 0.1, unit = "kg" }
k = { value = 50.0, sd = 1.0, unit = "N/m" }
pitch = { value = 0.05, unit = "m" }
speed = { value = 7.0, unit = "rad/s" }
push = { value = 2.0, unit = "N" }
[flow]
q = "v"
v = "(u - k*q)/m"
[outputs]
q = "q"
[ports.slide]
position = "q"
velocity = "v"
acts = { v = "1/m" }
unit = "N"
"#;

fn slider() -> Model {
    Model::from_toml(SLIDER, "slider").unwrap()
}

#[test]
fn added_mass_slows_the_swing() {
    let model = slider().attach("added_mass", "slide", &[("mass", 3.0)]).unwrap();
    let found = run(&model, &[0.1, 0.0], &Inputs::constant(&[0.0]), 3.0, 0.1, 1e-3);
    let omega = (50.0f64 / 5.0).sqrt();
    for (t, q) in found.t.iter().zip(&found.outputs) {
        assert!((q - 0.1 * (omega * t).cos()).abs() < 1e-10, "t = {t}: {q}");
    }
}

#[test]
fn added_mass_under_dry_friction_is_a_heavier_block_with_the_same_friction() {
    let rubbing = |model: &Model| model.attach("coulomb_friction", "slide", &[("force", 1.3)]).unwrap();
    let heavy = slider().with_parameters(&[("m", 2.7, None)]).unwrap();
    let first = rubbing(&slider()).attach("added_mass", "slide", &[("mass", 0.7)]).unwrap();
    let second = rubbing(&slider().attach("added_mass", "slide", &[("mass", 0.7)]).unwrap());
    let u = wave(1, 6.0);
    let truth = run(&rubbing(&heavy), &[0.1, 0.0], &u, 2.0, 0.01, 1e-3);
    assert!(truth.events.len() > 4, "it should stick and slip");
    for model in [first, second] {
        let found = run(&model, &[0.1, 0.0], &u, 2.0, 0.01, 1e-3);
        assert!(apart(&found, &truth) < 1e-11);
        assert_eq!(found.events.len(), truth.events.len());
    }
}

#[test]
fn masses_at_all_ports_of_a_shaft_are_its_inertias() {
    let shaft = zoo("two_mass").unwrap();
    let more = shaft.with_parameters(&[("J_m", 0.021, None), ("J_l", 0.0065, None)]).unwrap();
    let u = wave(1, 0.5);
    let truth = run(&more, &[0.0; 4], &u, 1.0, 0.01, 2e-4);
    let ports = [("motor", 0.005), ("load", 0.0025)];
    for order in [[0, 1], [1, 0]] {
        let mut model = shaft.clone();
        for k in order {
            model = model.attach("added_mass", ports[k].0, &[("mass", ports[k].1)]).unwrap();
        }
        assert!(apart(&run(&model, &[0.0; 4], &u, 1.0, 0.01, 2e-4), &truth) < 1e-11);
    }
}

#[test]
fn added_mass_on_a_mass_matrix_is_an_entry_of_it() {
    let model = zoo("cart_pendulum").unwrap();
    let u = wave(1, 3.0);
    let x0 = [0.0, 1.0, 0.0, 0.0];
    let mut document = model.document().clone();
    document.mass_matrix.as_mut().unwrap().matrix[0][0] = "M_c + M_p + 0.3".into();
    let truth = Model::new(document, model.library().clone(), "heavy").unwrap();
    let found = model.attach("added_mass", "cart", &[("mass", 0.3)]).unwrap();
    assert!(apart(&run(&found, &x0, &u, 1.5, 0.01, 1e-3), &run(&truth, &x0, &u, 1.5, 0.01, 1e-3)) < 1e-11);
}

#[test]
fn flexible_mode_has_the_coupled_frequencies() {
    // 2 kg on 50 N/m with 0.5 kg on 20 N/m hung on it, started in each of its own shapes.
    let (m, k, a, c) = (2.0f64, 50.0f64, 0.5f64, 20.0f64);
    let model = slider().attach("flexible_mode", "slide", &[("mass", a), ("stiffness", c)]).unwrap();
    assert_eq!(model.states()[2..], ["flexible_mode@slide.displacement", "flexible_mode@slide.speed"]);
    // det [[k + c - m w, -c], [-c, c - a w]] = 0 with w = omega^2
    let (p, q) = (m * c + a * (k + c), (k + c) * c - c * c);
    let root = (p * p - 4.0 * m * a * q).sqrt();
    for w in [(p - root) / (2.0 * m * a), (p + root) / (2.0 * m * a)] {
        let shape = c / (c - a * w); // of the hung mass, per unit of the slider
        let found = run(&model, &[0.1, 0.0, 0.1 * (shape - 1.0), 0.0], &Inputs::constant(&[0.0]), 3.0, 0.1, 1e-3);
        for (t, y) in found.t.iter().zip(&found.outputs) {
            assert!((y - 0.1 * (w.sqrt() * t).cos()).abs() < 1e-9, "omega^2 = {w}, t = {t}: {y}");
        }
    }
}

#[test]
fn flexible_mode_starts_with_the_speed_of_its_port() {
    let moving = SLIDER.replace("v = { value = 0.0", "v = { value = 0.4");
    let model = Model::from_toml(&moving, "slider").unwrap().attach("flexible_mode", "slide", &[]).unwrap();
    assert_eq!(model.compile().initial_state(), [0.1, 0.4, 0.0, 0.4]);
}

#[test]
fn backlash_in_the_shaft_is_a_dead_zone_in_its_spring() {
    let shaft = zoo("two_mass").unwrap();
    let mut document = shaft.document().clone();
    let torque = "k*(theta_m - theta_l - max(-0.01, min(0.01, theta_m - theta_l))) + c*(omega_m - omega_l)";
    document.signals["shaft_torque"] = ltp_core::model::Definition::Plain(torque.into());
    let truth = Model::new(document, shaft.library().clone(), "dead zone").unwrap();
    let model = shaft.attach("backlash", "shaft", &[("gap", 0.02)]).unwrap();
    let u = wave(1, 0.8);
    let blunt = run(&truth, &[0.0; 4], &u, 1.5, 0.01, 2e-3);
    // Where steps pass over the corners, only very short ones are exact.
    let (found, truth) = (run(&model, &[0.0; 4], &u, 1.5, 0.01, 1e-4), run(&truth, &[0.0; 4], &u, 1.5, 0.01, 4e-6));
    assert!(apart(&found, &truth) < 1e-8, "{}", apart(&found, &truth));
    // Steps end at the corners of the law: long ones lose nothing there.
    let coarse = run(&model, &[0.0; 4], &u, 1.5, 0.01, 2e-3);
    assert!(
        20.0 * apart(&coarse, &truth) < apart(&blunt, &truth),
        "{} {}",
        apart(&coarse, &truth),
        apart(&blunt, &truth)
    );
    let tight = run(&shaft, &[0.0; 4], &u, 1.5, 0.01, 1e-4);
    assert!(apart(&found, &tight) > 1e-3, "it should matter");
}

#[test]
fn backlash_needs_a_spring() {
    let drive = zoo("drive").unwrap();
    let text = drive.attach("backlash", "drive", &[("gap", 0.01)]).err().unwrap().to_string();
    assert!(text.contains("no stiffness along this port") && text.contains("backlash@drive"), "{text}");
    assert!(drive.places("backlash").unwrap().is_empty());
    // The shaft's spring turns both ends: its play is between them, and not an angle of one of them.
    let shaft = zoo("two_mass").unwrap();
    let text = shaft.attach("backlash", "motor", &[("gap", 0.01)]).err().unwrap().to_string();
    assert!(text.contains("at the port between the two") && text.contains("backlash@motor"), "{text}");
    assert_eq!(shaft.places("backlash").unwrap(), ["shaft"]);
    assert_eq!(zoo("hopper").unwrap().places("backlash").unwrap(), ["leg"]);
    assert_eq!(zoo("cart_pendulum").unwrap().places("backlash").unwrap(), ["pendulum"]);
    let sprung = drive.attach("linear_stiffness", "drive", &[("stiffness", 3.0)]).unwrap();
    assert_eq!(sprung.places("backlash").unwrap(), ["drive"]);
}

#[test]
fn a_yielding_spring_is_stiff_first_and_then_constant() {
    // Pushed slowly one way: force stiffness*x for small x, stiffness*yield_displacement at last; and its slope between
    // them is tanh for a sharpness of two.
    let text = r#"
name = "pusher"
[states]
q = { value = 0.0, unit = "m" }
v = { value = 0.2, unit = "m/s" }
[parameters]
m = { value = 1e9, unit = "kg" }
[flow]
q = "v"
v = "0"
[outputs]
a = { value = "q", unit = "m" }
[ports.plate]
position = "q"
velocity = "v"
acts = { v = "1/m" }
unit = "N"
"#;
    let model = Model::from_toml(text, "pusher").unwrap();
    let model = model.attach("hysteresis", "plate", &[("stiffness", 100.0), ("yield_displacement", 0.05)]).unwrap();
    let found = run(&model, &[0.0, 0.2, 0.0], &Inputs::constant(&[]), 1.0, 0.05, 1e-3);
    for (x, t) in found.states.chunks(3).zip(&found.t) {
        let z = (0.2 * t / 0.05f64).tanh();
        assert!((x[2] - z).abs() < 1e-9, "t = {t}: {} instead of {z}", x[2]);
    }
    let sharpness = model.parameters().iter().find(|p| p.name == "hysteresis@plate.sharpness").unwrap();
    assert_eq!((sharpness.value, sharpness.sd), (2.0, Some(0.5)));
}

#[test]
fn periodic_forces_are_what_a_document_would_say() {
    let u = wave(1, 5.0);
    let truth =
        |force: &str| Model::from_toml(&SLIDER.replace("u - k*q", &format!("u - k*q + {force}")), "truth").unwrap();
    let cases = [
        (
            "position_periodic_force",
            [("amplitude", 2.0), ("wavelength", 0.05), ("phase", 0.4)],
            "push*sin(2*pi*q/pitch + 0.4)",
        ),
        ("time_periodic_force", [("amplitude", 2.0), ("omega", 7.0), ("phase", 0.4)], "push*sin(speed*t + 0.4)"),
    ];
    for (effect, values, force) in cases {
        let found = run(&slider().attach(effect, "slide", &values).unwrap(), &[0.1, 0.0], &u, 1.5, 0.01, 5e-4);
        assert!(apart(&found, &run(&truth(force), &[0.1, 0.0], &u, 1.5, 0.01, 5e-4)) < 1e-12);
    }
}
