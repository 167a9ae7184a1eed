//! What simulations cost: 100 s of the three-mode hopper (219 events) at several steps, with and without sensitivities, and
//! the driven cart-pendulum.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ltp_core::model::{Backend, System, zoo};
use ltp_core::simulate::{Hold, Inputs, Plan, simulate};

fn hopper(c: &mut Criterion) {
    let mut group = c.benchmark_group("three_mode_hopper_100_s");
    group.sample_size(20);
    let model = zoo("three_mode_hopper").expect("in the zoo");
    let system = model.compile_for((0..model.parameters().len()).collect(), Backend::Native);
    let inputs = Inputs::constant(&[]);
    for step in [5e-3, 2e-3, 1e-3, 1e-4] {
        let mut plan = Plan::new(100.0, 0.1).expect("a plan").with_step(step);
        group.bench_function(format!("h = {step:e}"), |b| {
            b.iter(|| simulate(&system, system.parameters(), &inputs, black_box(&plan)).expect("a trajectory"));
        });
        plan.derivatives = true;
        if step > 5e-4 {
            group.bench_function(format!("h = {step:e} with 8 sensitivities"), |b| {
                b.iter(|| simulate(&system, system.parameters(), &inputs, black_box(&plan)).expect("a trajectory"));
            });
        }
    }
    group.finish();
}

fn cart_pendulum(c: &mut Criterion) {
    let mut group = c.benchmark_group("cart_pendulum_10_s");
    group.sample_size(20);
    let wave: Vec<f64> = (0..=10_000).map(|k| (6.0 * 1e-3 * f64::from(k)).sin()).collect();
    let inputs = Inputs::samples(0.0, 1e-3, &[wave], Hold::FirstOrder).expect("samples");
    let model = zoo("cart_pendulum").expect("in the zoo");
    let dry = model.attach("coulomb_friction", "cart", &[("force", 0.5)]).expect("an effect");
    for (name, model) in [("", &model), (", dry friction", &dry)] {
        let system = model.compile();
        let mut plan = Plan::new(10.0, 1e-3).expect("a plan");
        for derivatives in [false, true] {
            plan.derivatives = derivatives;
            let count = system.states() + system.free().len();
            let what = if derivatives { format!(" with {count} sensitivities") } else { String::new() };
            group.bench_function(format!("h = 1e-3{name}{what}"), |b| {
                b.iter(|| simulate(&system, system.parameters(), &inputs, black_box(&plan)).expect("a trajectory"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, hopper, cart_pendulum);
criterion_main!(benches);
