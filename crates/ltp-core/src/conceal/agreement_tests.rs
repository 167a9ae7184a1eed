//! Every effect at every place of every system: what is concealed here means what the effect's document means, by the engine
//! under test. The two share expressions at ports and contacts, and nothing at inputs, outputs and parameters.

use super::machine::Machine;
use super::palette::{Sketch, places};
use super::setups::{SYSTEMS, Setup};
use crate::model::{System, zoo};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;
use crate::simulate::{Hold, Inputs, Plan, simulate};

/// Laws with corners: the engine's fixed steps pass over them.
const CORNERS: [&str; 5] = ["backlash", "hysteresis", "input_saturation", "input_dead_zone", "output_backlash"];
/// Where the two mean different things by what was before the record, which is cut off here: at rest, settled, or on a line.
const BEGINNINGS: [(&str, &str); 5] = [
    ("pendulum", "output_lag"),
    ("duffing", "output_delay"),
    ("hopper", "output_delay"),
    ("hopper", "output_lag"),
    ("hopper", "input_lag"),
];

/// Largest difference over the spread of an output; the engine's fixed steps are the larger part of it.
fn furthest(system: &str, name: &str, at: &str) -> Option<f64> {
    let model = zoo(system).unwrap();
    let mut random = SplitMix64::new(11);
    let mut setup = Setup::new(system, false, &mut random).unwrap();
    setup.samples = 240;
    setup.lead = 0;
    let sketch = Sketch::new(&model, &setup, name, at, &mut random).ok()?;
    let planted = sketch.at_strength(0.05);
    // What a draw would reject: a parameter beyond its bounds, a motion that is none.
    let machine = Machine::new(&model, std::slice::from_ref(&planted)).ok()?;
    let take = setup.measure(&model, &machine, 0).ok()?;
    let given: Vec<(&str, f64)> = planted.parameters.iter().map(|(n, v)| (n.as_str(), *v)).collect();
    let compiled = model.attach(name, at, &given).unwrap().compile();
    let held = Inputs::samples(0.0, setup.dt, &[take.wave.samples[..240].to_vec()], Hold::FirstOrder).unwrap();
    let mut plan = Plan::new(239.0 * setup.dt, setup.dt).unwrap();
    plan.substeps = 8;
    if system == "pendulum" {
        let mut x0 = compiled.initial_state();
        x0[..2].fill(0.0);
        plan.initial_state = Some(x0);
    }
    let engine = simulate(&compiled, System::parameters(&compiled), &held, &plan).unwrap();
    let ny = model.outputs().len();
    let worst = (0..ny).map(|j| {
        let column = |y: &[f64]| y.iter().skip(j).step_by(ny).copied().collect::<Vec<f64>>();
        let (a, b) = (column(&take.motion.outputs), column(&engine.outputs));
        let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        off / stats::std(b)
    });
    Some(worst.fold(0.0, f64::max))
}

#[test]
fn what_is_concealed_is_what_the_documents_say() {
    let mut wrong = Vec::new();
    let mut tried = 0;
    for system in SYSTEMS {
        for (name, at) in places(&zoo(system).unwrap(), false).unwrap() {
            if BEGINNINGS.contains(&(system, name.as_str())) {
                continue;
            }
            let Some(off) = furthest(system, &name, &at) else { continue };
            tried += 1;
            let bound = if CORNERS.contains(&name.as_str()) { 1e-3 } else { 1e-5 };
            if off > bound {
                wrong.push(format!("{system}: {name}@{at} {off:.1e}"));
            }
        }
    }
    assert!(tried > 100, "{tried}");
    assert!(wrong.is_empty(), "of {tried}:\n{}", wrong.join("\n"));
}
