//! Isolability and what would separate rivals: what the geometry says is what the mechanics says.

use std::sync::atomic::AtomicBool;

use indexmap::IndexMap;
use ltp_core::diagnose::isolability::{Plan, Planned, Rival, Signal, isolability, separating};
use ltp_core::diagnose::{Control, Experiment};
use ltp_core::model::{Model, System, zoo};
use ltp_core::simulate::{Hold, Inputs};

const DT: f64 = 0.01;

fn volts(k: usize, amplitude: f64) -> f64 {
    let t = DT * k as f64;
    amplitude * ((3.1 * t).sin() + 0.8 * (5.3 * t + 1.0).sin() + 0.5 * (1.3 * t + 2.0).sin())
}

fn with_control<T>(work: impl FnOnce(&Control<'_>) -> T) -> T {
    let cancelled = AtomicBool::new(false);
    work(&Control { cancelled: &cancelled, progress: &|_, _| {} })
}

#[test]
fn rivals_are_separated_by_the_experiment_that_mechanics_asks_for() {
    // A constant torque and a biased angle sensor do the same as long as the pendulum stays near the vertical.
    let nominal = zoo("cart_pendulum").unwrap();
    let torque = nominal.attach("constant_force", "pendulum", &[("force", 6.8e-3)]).unwrap();
    let bias = nominal.attach("output_bias", "theta", &[("bias", 1.3e-2)]).unwrap();
    let (n, sigma) = (1000, [1.5e-3, 2.6e-3]);
    let columns = [(0..n).map(|k| volts(k, 3.0)).collect::<Vec<_>>()];
    let inputs = Inputs::samples(0.0, DT, &columns, Hold::FirstOrder).unwrap();
    let experiments = [Experiment::planned("small", (0.0, DT), n, 2, inputs)];
    let rest = [vec![0.0; 4]];
    let values = |m: &Model| m.compile().parameters().to_vec();
    let rival = |label: &str, model| Rival { label: label.into(), p: values(model), model, x0: &rest };
    let rivals = [rival("constant_force@pendulum", &torque), rival("output_bias@theta", &bias)];
    let found = with_control(|control| separating(&rivals, &nominal, &experiments, &sigma, 1, control)).unwrap();
    assert!(found.iter().any(|s| s.kind == "amplitude" && s.sentence.contains("twice")), "{found:?}");
    assert!(found.iter().all(|s| s.gain > 10.0 && s.separates == ["output_bias@theta"]));
    assert!(found.windows(2).all(|w| w[0].gain >= w[1].gain));
}

#[test]
fn what_is_the_same_physics_is_never_separated() {
    let nominal = zoo("cart_pendulum").unwrap();
    let record = |amplitude: f64| {
        let volts = (0..601).map(|k| volts(k, amplitude)).collect();
        Planned {
            name: "planned".into(),
            inputs: IndexMap::from([("V".into(), Signal::Samples(volts))]),
            ..Planned::default()
        }
    };
    let effects = ["constant_force", "input_bias", "coulomb_friction", "viscous_friction"].map(String::from);
    let plan = Plan { effects: Some(effects.into()), ..Plan::new(vec![record(3.0), record(1.0)], 6.0, DT) };
    let found = with_control(|control| isolability(&nominal, &plan, control)).unwrap();
    let at = |label: &str| found.effects.iter().position(|e| e.label() == label).unwrap();
    let (force, offset, dry) = (at("constant_force@cart"), at("input_bias@V"), at("coulomb_friction@cart"));
    assert!(found.separation[force][offset] < 1e-3 * found.separation[force][dry], "{:?}", found.separation);
    assert!(found.separation[force][dry] > 10.0);
    // Damping at the cart is a parameter of the model already.
    let viscous = &found.effects[at("viscous_friction@cart")];
    assert!(!viscous.detectable && viscous.alike.is_some(), "{viscous:?}");
    let open = found.advice.iter().find(|a| a.of.contains(&"constant_force@cart".to_string())).unwrap();
    assert!(open.by.is_empty(), "no experiment tells an offset of the input from a constant force: {open:?}");
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let model = zoo("drive").unwrap();
    let inputs = IndexMap::from([("tau".into(), Signal::Expression("40*sin(3*t)".into()))]);
    let record = Planned { name: "planned".into(), inputs, ..Planned::default() };
    let [one, two] = [1, 2].map(|threads| {
        let plan = Plan { threads, ..Plan::new(vec![record.clone()], 3.0, DT) };
        serde_json::to_string(&with_control(|control| isolability(&model, &plan, control)).unwrap()).unwrap()
    });
    assert_eq!(one, two);
}
