//! What the two routes through penalised least squares cost: a tenth of the paper's record, and the whole (704 445 complex
//! unknowns, half-bandwidth 42).

use std::f64::consts::{PI, TAU};
use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use ltp_core::numeric::penalised::normal_matrix;
use ltp_core::numeric::smoother::{End, Observations, Smoother};
use ltp_core::numeric::{Complex, fft};

const PERIOD: f64 = 0.33;
const DT: f64 = 1e-3;
const K: i64 = 10;
const TOP_HZ: f64 = 5.0 + 10.0 / PERIOD + 1.0;

/// Rows of the paper's chirps (0 to 5 Hz in 20 s, again and again) for `periods` periods, from the top down to zero, or on
/// to the mirror of the top; and the products of rows with data that are a smooth response.
fn rows(periods: i64, both: bool) -> (Observations, Vec<Complex>) {
    let n = periods * 330;
    let time = |i: i64| (i as f64 * DT).rem_euclid(20.0);
    let u: Vec<f64> = (0..n).map(|i| if i * 11 < n * 10 { (0.25 * PI * time(i).powi(2)).sin() } else { 0.0 }).collect();
    let lines = fft::forward(&u);
    let line = |b: i64| if b < 0 { lines[-b as usize].conj() } else { lines[b as usize] };
    let spacing = 1.0 / (periods as f64 * PERIOD);
    let top = (TOP_HZ / spacing) as i64;
    let scale = (lines[..(5.0 / spacing) as usize].iter().map(|v| v.norm_sqr()).sum::<f64>() / (5.0 / spacing)).sqrt();
    let mut observations = Observations::new((2 * K + 1) as usize);
    let mut y = Vec::new();
    for b in (if both { -top } else { 0 }..=top).rev() {
        let row: Vec<Complex> = (-K..=K).map(|k| line(b - k * periods) / scale).collect();
        observations.step([&row[..]]);
        let response =
            |k: i64| 1.0 / Complex::new(1.0 + (k * k) as f64, TAU * (b - k * periods) as f64 * spacing * 0.1);
        y.push((-K..=K).zip(&row).map(|(k, u)| u * response(k)).sum());
    }
    (observations, y)
}

fn routes(c: &mut Criterion) {
    for (name, periods) in [("a tenth of the paper's record", 140), ("the paper's record", 1400)] {
        let mut group = c.benchmark_group(name);
        group.sample_size(10);
        let (half, y) = rows(periods, false);
        let end = End::Mirror((0..(2 * K + 1) as usize).rev().collect());
        group.bench_function("smoother", |b| {
            b.iter(|| Smoother::new(black_box(&half), 10.0, &end).expect("good").solve(&y).expect("good"));
        });
        let smoother = Smoother::new(&half, 10.0, &end).expect("good");
        group.bench_function("leverages and variances", |b| b.iter(|| smoother.uncertainty()));
        let (whole, y) = rows(periods, true);
        let n = whole.unknowns();
        let right: Vec<Complex> =
            (0..whole.steps() * n).map(|i| whole.coefficient(i / n, i % n).conj() * y[i / n]).collect();
        group.bench_function("banded: assembly", |b| b.iter(|| normal_matrix(black_box(&whole), 10.0, 0.0)));
        group.bench_function("banded: factor and solve", |b| {
            b.iter_batched(
                || (normal_matrix(&whole, 10.0, 0.0), right.clone()),
                |(band, mut x)| band.factor().expect("good").solve(&mut x).expect("good"),
                BatchSize::PerIteration,
            );
        });
        group.finish();
    }
}

criterion_group!(benches, routes);
criterion_main!(benches);
