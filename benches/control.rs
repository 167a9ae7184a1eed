//! One evaluation of a closed loop with its gradient: lifted at several truncations, and exact; one whole design of each kind.
//!
//! Bars on one core: exact with gradient 0.05 ms, lifted with gradient at N = 2 0.1 ms. Against `numpy.linalg.eigvals` in one run:
//! `control_side_by_side.py`.

use std::f64::consts::TAU;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ltp_core::control::{
    Exact, Law, Lifted, Measure, Objective, Options, Spectrum, Weights, harmonic_balance, periodic_lqr,
};
use ltp_core::model::{Point, System, zoo};
use ltp_core::numeric::gauss::Gauss;
use ltp_core::periodic::{LtpSystem, Segment, Size, system::NODES};

/// The hanging cart-pendulum along (4.1) of Duyul's thesis, with the voltage that (3.1) asks for.
fn downward() -> LtpSystem {
    let system = zoo("cart_pendulum").expect("in the zoo").compile();
    let p = system.parameters().to_vec();
    let gauss = Gauss::new(NODES);
    let sine = |amplitude: f64, phase: f64, t: f64| {
        let (sin, cos) = (TAU * t + phase).sin_cos();
        [amplitude * sin, amplitude * TAU * cos, -amplitude * TAU * TAU * sin]
    };
    let segment = |k: usize| {
        let (start, end) = (f64::from(k as u32) / 16.0, f64::from(k as u32 + 1) / 16.0);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for node in &gauss.nodes {
            let t = start + node * (end - start);
            let ([x, v, acceleration], [theta, omega, alpha]) = (sine(0.05, 0.0, t), sine(-0.2472, 0.6809, t));
            let force = 0.78 * acceleration + 0.063 * (theta.cos() * alpha - theta.sin() * omega * omega);
            let (states, volt) = ([x, theta, v, omega], [(force + 12.0236 * v) / 1.72354]);
            let at = Point { t, x: &states, u: &volt, p: &p };
            let mut jacobian = vec![0.0; 4 + 16 + 4 * system.free().len()];
            system.flow_jacobian(0, at, &mut jacobian);
            a.extend_from_slice(&jacobian[4..20]);
            let mut by_input = vec![0.0; 4 + system.outputs()];
            system.input_jacobian(0, at, &mut by_input);
            b.extend_from_slice(&by_input[..4]);
        }
        Segment { start, end, a, b, c: vec![], d: vec![], jumps: vec![] }
    };
    LtpSystem::new(1.0, 0.0, Size { nx: 4, nu: 1, ny: 0 }, (0..16).map(segment).collect()).expect("a system")
}

fn evaluation(c: &mut Criterion) {
    let mut group = c.benchmark_group("closed_loop_with_gradient");
    let system = downward();
    let law = Law::new(1, 4, 1.0, &[0]).expect("a law");
    let gain = [69.69, -2.01, 19.62, 6.54];
    let lifted = |n: usize| Objective::Lifted(Lifted::new(&system, &law, n).expect("a lift"));
    let exact = Objective::Exact(Exact::new(&system, &law, None).expect("samples"));
    let all = [2, 5, 10, 20].map(|n| (format!("lifted, N = {n}"), lifted(n)));
    for (name, objective) in all.into_iter().chain([("exact".to_owned(), exact)]) {
        let (mut spectrum, mut gradient) = (Spectrum::default(), Vec::new());
        let mut once = || objective.abscissa(black_box(&gain), true, &mut spectrum, Some(&mut gradient));
        group.bench_function(name, |b| b.iter(|| once().expect("modes")));
    }
    group.finish();
}

fn design(c: &mut Criterion) {
    let mut group = c.benchmark_group("design");
    group.sample_size(10);
    let system = downward();
    let lifted = Options { limit: Some(200.0), fastest: Some(50.0), ..Options::default() };
    let exact = Options { measure: Measure::Exact, ..lifted.clone() };
    for (name, options) in [("harmonic balance, lifted", lifted), ("harmonic balance, exact", exact)] {
        group.bench_function(name, |b| b.iter(|| harmonic_balance(&system, &[], &options).expect("a gain")));
    }
    let mut states = vec![0.0; 16];
    (states[0], states[5]) = (25.0, 1.0);
    let weights = Weights { states, inputs: vec![1e-3], shift: 0.0 };
    group.bench_function("periodic regulator", |b| b.iter(|| periodic_lqr(&system, &weights, None).expect("a gain")));
    group.finish();
}

criterion_group!(benches, evaluation, design);
criterion_main!(benches);
