//! The compiled flow of the cart-pendulum against the same flow written by hand, and what loading a model costs.
//!
//! Bars: compiled at most 1.5 times the hand-written; a model with all its Jacobians loaded within 20 ms.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ltp_core::model::{Backend, Model, Point, System, ZOO, zoo};

/// Rates of the cart-pendulum, inverted by hand; the motor's constants are folded as a careful author would.
#[inline(never)]
fn by_hand(p: &[f64], x: &[f64], volt: f64, out: &mut [f64]) {
    let [mc, mp, l, beq, bp, ks, g, kg, kt, km, rm, r] = p[..] else { panic!("twelve parameters") };
    let per_volt = kg * kt / (rm * r);
    let force = per_volt * (volt - kg * km / r * x[2]);
    let (sin, cos) = x[1].sin_cos();
    let (a, b, d) = (mc + mp, mp * l * cos, mp * l * l * (4.0 / 3.0));
    let f1 = force - beq * x[2] + mp * l * sin * x[3] * x[3];
    let f2 = -bp * x[3] - ks * (x[1] - std::f64::consts::PI) - mp * g * l * sin;
    let inverse = 1.0 / (a * d - b * b);
    out[0] = x[2];
    out[1] = x[3];
    out[2] = (d * f1 - b * f2) * inverse;
    out[3] = (a * f2 - b * f1) * inverse;
}

fn flow(c: &mut Criterion) {
    let mut group = c.benchmark_group("cart_pendulum_flow");
    let model = zoo("cart_pendulum").expect("in the zoo");
    let (native, plain) = (model.compile(), model.compile_for(model.uncertain(), Backend::Plain));
    let p = native.parameters().to_vec();
    let x = [0.1, 0.7, -0.3, 1.1];
    let mut out = [0.0; 4];
    group.bench_function("by hand", |b| b.iter(|| by_hand(black_box(&p), black_box(&x), black_box(2.0), &mut out)));
    for (name, system) in [("compiled", &native), ("plain", &plain)] {
        let at = Point { t: 0.0, x: &x, u: &[2.0], p: &p };
        group.bench_function(name, |b| b.iter(|| system.flow(0, black_box(at), &mut out)));
    }
    let mut jacobian = vec![0.0; 4 + 4 * (4 + native.free().len())];
    let at = Point { t: 0.0, x: &x, u: &[2.0], p: &p };
    group.bench_function("with jacobian", |b| b.iter(|| native.flow_jacobian(0, black_box(at), &mut jacobian)));
    group.finish();
}

fn load(c: &mut Criterion) {
    let mut group = c.benchmark_group("load_with_jacobians");
    for (name, text) in ZOO {
        group.bench_function(*name, |b| {
            b.iter(|| {
                let model = Model::from_toml(black_box(text), name).expect("in the zoo");
                model.compile_for((0..model.parameters().len()).collect(), Backend::Native).warm();
            });
        });
    }
    group.finish();
}

criterion_group!(benches, flow, load);
criterion_main!(benches);
