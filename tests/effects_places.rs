//! Owns: effects at inputs, outputs, contacts and parameters against hand-written models, samples and formulas.

#[path = "oracles/runs.rs"]
mod runs;

use ltp_core::model::{Library, Model, System, zoo};
use ltp_core::simulate::{Hold, Inputs};
use runs::{apart, run};

fn samples(change: impl Fn(f64) -> f64, hold: Hold) -> Inputs {
    let column = (0..2001).map(|k| change(3.0 * (0.011 * f64::from(k)).sin())).collect();
    Inputs::samples(0.0, 0.001, &[column], hold).unwrap()
}

#[test]
fn inputs_are_changed_as_their_samples_would_be() {
    let drive = zoo("cart_pendulum").unwrap();
    type Change = fn(f64) -> f64;
    type Case<'a> = (&'a str, &'a [(&'a str, f64)], Change);
    let cases: [Case<'_>; 4] = [
        ("input_gain", &[("gain", 1.2)], |u| 1.2 * u),
        ("input_bias", &[("bias", -0.4)], |u| u - 0.4),
        ("input_saturation", &[("limit", 2.0)], |u| u.clamp(-2.0, 2.0)),
        ("input_dead_zone", &[("width", 0.7)], |u| u - u.clamp(-0.7, 0.7)),
    ];
    for (effect, values, change) in cases {
        let model = drive.attach(effect, "V", values).unwrap();
        let found = run(&model, &samples(|u| u, Hold::ZeroOrder), 1.9, 0.01, 1e-3);
        let truth = run(&drive, &samples(change, Hold::ZeroOrder), 1.9, 0.01, 1e-3);
        assert!(apart(&found.outputs, &truth.outputs) < 1e-12, "{effect}");
        assert!(found.inputs.iter().any(|u| *u > 2.5), "the trajectory shows the input as it was given");
    }
}

#[test]
fn effects_at_one_input_act_in_the_order_in_which_they_were_attached() {
    let drive = zoo("drive").unwrap();
    let first = drive.attach("input_gain", "tau", &[("gain", 2.0)]).unwrap();
    let first = first.attach("input_saturation", "tau", &[("limit", 3.0)]).unwrap();
    let second = drive.attach("input_saturation", "tau", &[("limit", 3.0)]).unwrap();
    let second = second.attach("input_gain", "tau", &[("gain", 2.0)]).unwrap();
    for (model, force) in [(first, 3.0), (second, 6.0)] {
        let found = run(&model, &Inputs::constant(&[100.0]), 1.0, 0.1, 0.01);
        let truth = run(&drive, &Inputs::constant(&[force]), 1.0, 0.1, 0.01);
        assert!(apart(&found.outputs, &truth.outputs) < 1e-13);
    }
}

#[test]
fn an_input_lag_answers_a_step_exponentially() {
    let model = zoo("drive").unwrap().attach("input_lag", "tau", &[("time_constant", 0.2)]).unwrap();
    let found = run(&model, &Inputs::constant(&[5.0]), 1.0, 0.1, 0.005);
    for (t, x) in found.t.iter().zip(found.states.chunks(3)) {
        let expected = 5.0 * (1.0 - (-t / 0.2f64).exp());
        assert!((x[2] - expected).abs() < 1e-9, "{t}: {} {expected}", x[2]);
    }
}

#[test]
fn the_hoppers_whole_actuator_is_a_place() {
    let hopper = zoo("hopper").unwrap();
    assert_eq!(hopper.places("input_gain").unwrap(), ["u_c", "u"]);
    let model = hopper.attach("input_saturation", "u", &[("limit", 60.0)]).unwrap();
    let mut document = hopper.document().clone();
    document.signals["u"] = ltp_core::model::Definition::Plain("max(-60, min(60, a*cos(omega_p*t) + u_c))".into());
    let truth = Model::new(document, Library::shipped().unwrap(), "clipped").unwrap();
    let u = Inputs::constant(&[2.0]);
    let (found, truth) = (run(&model, &u, 0.6, 0.01, 1e-4), run(&truth, &u, 0.6, 0.01, 1e-4));
    // The one ends its steps at the corners, the other passes over them.
    assert!(apart(&found.outputs, &truth.outputs) < 1e-8);
    assert_ne!(found.outputs, run(&hopper, &u, 0.6, 0.01, 1e-4).outputs);
}

#[test]
fn an_effect_on_a_signal_leaves_what_a_port_adds_to_it_alone() {
    let hopper = zoo("hopper").unwrap();
    // The force of the actuator on the leg is doubled, that of the port on the leg is not.
    let pushed = hopper.attach("constant_force", "leg", &[("force", 3.0)]).unwrap();
    let model = pushed.attach("input_gain", "f", &[("gain", 1.5)]).unwrap();
    let mut document = hopper.document().clone();
    let text = format!("1.5*({}) + 3", document.signals["f"].expression());
    document.signals["f"] = ltp_core::model::Definition::Plain(text);
    let truth = Model::new(document, Library::shipped().unwrap(), "by hand").unwrap();
    let u = Inputs::constant(&[0.0]);
    let (found, truth) = (run(&model, &u, 0.3, 0.01, 1e-4), run(&truth, &u, 0.3, 0.01, 1e-4));
    assert!(apart(&found.outputs, &truth.outputs) < 1e-12);
}

#[test]
fn places_that_are_none_are_refused() {
    let model = zoo("two_mass").unwrap();
    let text = |effect: &str, at: &str| model.attach(effect, at, &[]).err().unwrap().to_string();
    assert!(text("input_gain", "shaft_torque").contains("no input enters the signal"));
    assert!(text("input_gain", "theta_l").contains("there is no input"));
    assert!(text("output_gain", "tau").contains("there is no output"));
    assert!(text("restitution", "toe").contains("there is no contact"));
    assert!(text("parameter_drift", "J").contains("there is no parameter"));
    assert!(text("coulomb_friction", "moter").contains("`motor`"));
    assert_eq!(model.places("parameter_drift").unwrap(), ["J_m", "J_l", "k", "c", "b"]);
    assert_eq!(zoo("hopper").unwrap().places("parameter_error").unwrap(), ["omega_p", "g"]);
}

#[test]
fn outputs_are_scaled_shifted_and_filtered() {
    let pendulum = zoo("pendulum").unwrap();
    let u = Inputs::constant(&[0.0]);
    let truth = run(&pendulum, &u, 1.0, 0.01, 1e-3).outputs;
    let scaled = pendulum.attach("output_gain", "theta", &[("gain", 0.9)]).unwrap();
    let scaled = scaled.attach("output_bias", "theta", &[("bias", 0.1)]).unwrap();
    let expected: Vec<f64> = truth.iter().map(|y| 0.9 * y + 0.1).collect();
    assert!(apart(&run(&scaled, &u, 1.0, 0.01, 1e-3).outputs, &expected) < 1e-14);
    // A filter that has settled on the start follows a ramp late by its time constant.
    let slow = zoo("drive").unwrap().attach("output_lag", "q", &[("time_constant", 0.05)]).unwrap();
    let found = run(&slow, &Inputs::constant(&[203.5]), 6.0, 0.1, 0.005);
    let (x, y) = (&found.states[found.states.len() - 3..], found.outputs.last().unwrap());
    assert!((x[0] - y - 0.05 * x[1]).abs() < 1e-5, "{x:?} {y}");
    assert_eq!(pendulum.attach("output_lag", "theta", &[]).unwrap().compile().initial_state()[2], 2.0);
}

#[test]
fn parameters_are_off_and_drift() {
    let drive = zoo("drive").unwrap();
    let u = Inputs::constant(&[50.0]);
    let off = drive.attach("parameter_error", "b", &[("offset", 10.0)]).unwrap();
    let truth = drive.with_parameters(&[("b", 213.5, None)]).unwrap();
    assert!(apart(&run(&off, &u, 2.0, 0.1, 0.01).outputs, &run(&truth, &u, 2.0, 0.1, 0.01).outputs) < 1e-13);
    let drifting = drive.attach("parameter_drift", "b", &[("rate", 10.0)]).unwrap();
    let mut document = drive.document().clone();
    document.flow["v"] = "(tau - (b + 10*t)*v)/M".into();
    let truth = Model::new(document, drive.library().clone(), "by hand");
    // the literal 10 has no unit, so the document is read without them
    let truth = truth.or_else(|_| {
        let mut plain = drive.document().clone();
        plain.flow["v"] = "(tau - (b + 10*t)*v)/M".into();
        plain.states.values_mut().for_each(|s| s.unit = None);
        plain.parameters.values_mut().for_each(|s| s.unit = None);
        plain.inputs.values_mut().for_each(|s| s.unit = None);
        plain.ports.clear();
        Model::new(plain, drive.library().clone(), "by hand")
    });
    assert!(
        apart(&run(&drifting, &u, 2.0, 0.1, 0.01).outputs, &run(&truth.unwrap(), &u, 2.0, 0.1, 0.01).outputs) < 1e-13
    );
    let clock = zoo("hopper").unwrap().attach("parameter_drift", "omega_p", &[("rate", 0.1)]);
    assert!(clock.err().unwrap().to_string().contains("may depend on parameters only"));
}

/// A ball that stays on the ground once it has touched it.
const BALL: &str = r#"
name = "ball"
initial_mode = "flight"
[states]
y = { value = 1.0, unit = "m" }
v = { value = 0.0, unit = "m/s" }
[parameters]
m = { value = 0.5, sd = 0.01, unit = "kg" }
g = { value = 10.0, unit = "m/s^2" }
[modes.flight.flow]
y = "v"
v = "-g"
[modes.rest.flow]
y = "0"
v = "0"
[[transitions]]
name = "landing"
from = "flight"
to = "rest"
guard = "y"
direction = "falling"
reset = { v = "0" }
[outputs]
y = { value = "y", unit = "m" }
[ports.ball]
position = "y"
velocity = "v"
acts.flight = { v = "1/m" }
unit = "N"
[contacts.floor]
free_mode = "flight"
held_mode = "rest"
gap = "y"
rate = "v"
port = "ball"
"#;

fn ball() -> Model {
    Model::from_toml(BALL, "ball").unwrap()
}

#[test]
fn a_ball_bounces_until_it_is_too_slow() {
    let e = 0.5f64;
    let model = ball().attach("restitution", "floor", &[("coefficient", e)]).unwrap();
    let found = run(&model, &Inputs::constant(&[]), 3.0, 0.01, 1e-3);
    let first = 0.2f64.sqrt();
    let speed = 10.0 * first;
    // bounce n leaves with e^n speed; the last one leaves faster than a millimetre per second
    let bounces = (1..).take_while(|n| e.powi(*n) * speed > 1e-3).count();
    assert_eq!(found.events.len(), bounces + 1);
    let mut time = first;
    for (n, event) in found.events.iter().enumerate() {
        assert!((event.time - time).abs() < 1e-9, "{n}: {} {time}", event.time);
        let landed = n == bounces;
        assert_eq!(event.name, if landed { "landing" } else { "landing (rebound)" });
        assert_eq!(event.mode_after, usize::from(landed));
        time += 2.0 * e.powi(n as i32 + 1) * speed / 10.0;
    }
    assert_eq!(found.states[found.states.len() - 1], 0.0);
}

#[test]
fn the_ground_may_be_elsewhere() {
    let model = ball().attach("ground_height", "floor", &[("height", 0.2)]).unwrap();
    let found = run(&model, &Inputs::constant(&[]), 1.0, 0.01, 1e-3);
    assert!((found.events[0].time - 0.16f64.sqrt()).abs() < 1e-10);
    assert!((found.outputs.last().unwrap() - 0.2).abs() < 1e-10);
    let both = model.attach("restitution", "floor", &[("coefficient", 0.5)]).unwrap();
    let found = run(&both, &Inputs::constant(&[]), 0.6, 0.01, 1e-3);
    let t = found.t[55] - 0.16f64.sqrt();
    assert!((found.outputs[55] - (0.2 + 2.0 * t - 5.0 * t * t)).abs() < 1e-9);
}

#[test]
fn yielding_ground_gives_the_energy_back_and_carries_the_weight() {
    let u = Inputs::constant(&[]);
    let springy = ball().attach("compliant_ground", "floor", &[("stiffness", 2000.0), ("damping", 0.0)]).unwrap();
    let found = run(&springy, &u, 2.0, 0.001, 1e-4);
    assert_eq!(found.events.len(), 4);
    for (x, &mode) in found.states.chunks(2).zip(&found.mode) {
        let spring = if mode == 1 { 0.5 * 2000.0 * x[0] * x[0] } else { 0.0 };
        let energy = 0.5 * 0.5 * x[1] * x[1] + 0.5 * 10.0 * x[0] + spring;
        assert!((energy - 5.0).abs() < 1e-8, "{energy}");
        assert_eq!(mode == 1, x[0] < 0.0);
    }
    // In contact: a half wave around the static penetration -m g/k.
    let omega = (2000.0f64 / 0.5).sqrt();
    let rest = -0.5 * 10.0 / 2000.0;
    let span = found.events[1].time - found.events[0].time;
    let speed = 20.0f64.sqrt();
    let expected = 2.0 / omega * (std::f64::consts::PI - (speed / (omega * -rest)).atan());
    assert!((span - expected).abs() < 1e-9, "{span} {expected}");

    let damped = ball().attach("compliant_ground", "floor", &[("stiffness", 2000.0), ("damping", 20.0)]).unwrap();
    let found = run(&damped, &u, 4.0, 0.001, 1e-4);
    assert!((found.outputs.last().unwrap() - rest).abs() < 1e-9, "{}", found.outputs.last().unwrap());
    // It leaves where the force has fallen to zero: before the gap opens, and without a jump of velocity.
    let liftoff = found.events[1].time;
    let before = (liftoff / 0.001).floor() as usize;
    let x = &found.states[2 * before..2 * before + 2];
    let left = liftoff - found.t[before];
    let (y, v) = (x[0] + x[1] * left, x[1]);
    assert!(y < 0.0 && (2000.0 * y + 20.0 * v).abs() < 0.01 * 20.0 * v, "{y} {v}");
}

#[test]
fn contacts_say_what_they_lack() {
    let say = |text: &str, effect: &str| {
        Model::from_toml(text, "ball").unwrap().attach(effect, "floor", &[]).err().unwrap().to_string()
    };
    assert!(say(&BALL.replace("guard = \"y\"", "guard = \"y - 0.1\""), "ground_height").contains("with the guard `y`"));
    assert!(say(&BALL.replace("port = \"ball\"", ""), "compliant_ground").contains("needs the contact's `port`"));
    assert!(say(&BALL.replace("rate = \"v\"", "rate = \"1*v + 0*v\""), "restitution").contains("a state by itself"));
    let two = ball().attach("restitution", "floor", &[]).unwrap().attach("compliant_ground", "floor", &[]);
    assert!(two.err().unwrap().to_string().contains("one effect at a time"));
}

/// Drag against air that moves.
const WIND: &str = r#"
sentence = "air that moves"
on = "port"
law = "-drag*(velocity - wind)*abs(velocity - wind)"
reference = "the weather"
[parameters]
drag = { unit = "force/velocity^2", min = 0.0, scale = "force/velocity^2" }
wind = { unit = "velocity", value = 1.0, scale = "velocity", shape = [0.5, 1.0] }
"#;

#[test]
fn ones_own_effect_is_like_any_other() {
    let drive = zoo("drive").unwrap().with_effects(&[("wind", WIND)]).unwrap();
    assert_eq!(drive.places("wind").unwrap(), ["drive"]);
    let model = drive.attach("wind", "drive", &[("drag", 3.0)]).unwrap();
    assert_eq!(model.parameters().last().unwrap().value, 1.0);
    assert_eq!(model.unit("wind@drive.drag").unwrap(), "N s^2/m^2");
    let still = run(&model, &Inputs::constant(&[0.0]), 400.0, 10.0, 0.1);
    let v = still.states.last().unwrap();
    assert!((3.0 * (1.0 - v) * (1.0 - v) - 203.5 * v).abs() < 1e-9, "{v}");
    let text = model.to_toml().unwrap();
    assert!(Model::from_toml(&text, "again").err().unwrap().to_string().contains("there is no effect `wind`"));
    let library = Library::with(&[("wind", WIND)]).unwrap();
    let again = Model::new(ltp_core::model::Document::from_toml(&text, "again").unwrap(), library, "again").unwrap();
    assert_eq!(again.document(), model.document());
    let twice = drive.with_effects(&[("wind", WIND)]).err().unwrap().to_string();
    assert!(twice.contains("of this name already"), "{twice}");
}

#[test]
fn a_document_that_is_no_effect_is_refused() {
    let add = |text: &str| {
        Library::shipped().unwrap().add_toml("mine", text).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let body = "sentence = \"s\"\nreference = \"r\"\n";
    assert!(add(&format!("{body}on = \"prot\"\nlaw = \"0\"")).contains("port, input, output, contact, parameter"));
    assert!(add(&format!("{body}on = \"input\"\ndry = \"1\"")).contains("exactly one of `law`"));
    assert!(add(&format!("{body}on = \"port\"\nlaw = \"1\"\ndry = \"1\"")).contains("found law and dry"));
    assert!(
        add(&format!("{body}on = \"port\"\nlaw = \"f\"\n[parameters]\nf = {{ unit = \"force\", min = 1.0 }}"))
            .contains("default 0")
    );
    assert!(add(&format!("{body}on = \"port\"\nlaw = \"2*(velocity\"")).contains("not closed"));
    assert!(
        add(&format!("{body}on = \"input\"\nlaw = \"value\"\n[parameters]\nvalue = {{ unit = \"1\" }}"))
            .contains("`value` cannot name")
    );
    assert!(
        Library::shipped().unwrap().add_toml("my effect", WIND).err().unwrap().to_string().contains("called by a name")
    );
    let taken = Library::shipped().unwrap().add_toml("input_gain", &format!("{body}on = \"input\"\nlaw = \"value\""));
    assert!(taken.err().unwrap().to_string().contains("of this name already"));
}
