//! Owns: the work that simulations do, pinned. A change here is not a failure of the method but a change of its cost: look
//! at it, then accept it.

use ltp_core::model::{Backend, Model, System, zoo};
use ltp_core::simulate::{Hold, Inputs, Plan, simulate};

/// Steps, evaluations, events, ticks, bisections, polishes.
fn work(model: &Model, t_end: f64, step: f64) -> String {
    let system = model.compile_for(vec![], Backend::Plain);
    let wave: Vec<f64> = (0..=1000).map(|k| 0.5 * (0.02 * f64::from(k)).sin()).collect();
    let columns = vec![wave; system.inputs()];
    let inputs = Inputs::samples(0.0, 0.01, &columns, Hold::FirstOrder).unwrap();
    let plan = Plan::new(t_end, 0.01).unwrap().with_step(step);
    let s = simulate(&system, system.parameters(), &inputs, &plan).unwrap().stats;
    format!(
        "steps {}, evaluations {}, events {}, ticks {}, bisections {}, polishes {}",
        s.steps, s.evaluations, s.events, s.ticks, s.bisections, s.polishes
    )
}

fn of(name: &str, t_end: f64, step: f64) -> String {
    work(&zoo(name).unwrap(), t_end, step)
}

#[test]
fn reference_problems() {
    insta::assert_snapshot!(of("three_mode_hopper", 10.0, 1e-3), @"steps 10030, evaluations 60931, events 30, ticks 0, bisections 1401, polishes 90");
    insta::assert_snapshot!(of("hopper", 3.3, 1e-3), @"steps 3320, evaluations 20541, events 20, ticks 0, bisections 1033, polishes 80");
    insta::assert_snapshot!(of("bouncing_ball", 6.0, 1e-2), @"steps 506, evaluations 5536, events 100, ticks 0, bisections 4157, polishes 300");
    insta::assert_snapshot!(of("cart_pendulum", 2.0, 1e-3), @"steps 2000, evaluations 12001, events 0, ticks 0, bisections 0, polishes 0");
    insta::assert_snapshot!(of("mathieu", 10.0, 1e-2), @"steps 1000, evaluations 6001, events 0, ticks 0, bisections 0, polishes 0");
}

#[test]
fn friction() {
    let drive = zoo("drive").unwrap().attach("coulomb_friction", "drive", &[("force", 0.3)]).unwrap();
    insta::assert_snapshot!(work(&drive, 10.0, 1e-3), @"steps 10013, evaluations 60404, events 13, ticks 0, bisections 711, polishes 39");
    let two = zoo("two_mass").unwrap().attach("coulomb_friction", "motor", &[("force", 0.1)]).unwrap();
    let two = two.attach("coulomb_friction", "load", &[("force", 0.1)]).unwrap();
    insta::assert_snapshot!(work(&two, 5.0, 1e-3), @"steps 5008, evaluations 30267, events 8, ticks 0, bisections 472, polishes 27");
}
