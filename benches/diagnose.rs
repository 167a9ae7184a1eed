//! What a whole diagnosis costs, the full vocabulary at every place, on all cores: a smooth machine and the hopper of which
//! only the height is recorded. The bars of the project are 2 s and 8 s on two cores.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use ltp_core::conceal::{Difficulty, Draw, draw};
use ltp_core::diagnose::{Control, Options, diagnose};

fn cases(c: &mut Criterion) {
    let cancelled = AtomicBool::new(false);
    let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
    let mut group = c.benchmark_group("diagnose");
    group.sample_size(10).measurement_time(Duration::from_secs(30));
    for (system, effect, at) in [
        ("cart_pendulum", "coulomb_friction", "cart"),
        ("drive", "stribeck_friction", "drive"),
        ("hopper", "parameter_drift", "d"),
    ] {
        let what = Draw {
            system: system.into(),
            difficulty: Difficulty::Noisy,
            seed: 7,
            effect: Some((effect.into(), at.into())),
        };
        let (case, _) = draw(&what).expect("the case can be drawn");
        group.bench_function(format!("{effect} of the {system}"), |b| {
            b.iter(|| diagnose(black_box(&case.model), &case.train, &case.test, &Options::default(), &control));
        });
    }
    group.finish();
}

criterion_group!(benches, cases);
criterion_main!(benches);
