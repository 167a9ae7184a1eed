//! The smoother against dense least squares (QR of all rows and all penalties), and against itself.

use super::*;
use crate::numeric::rng::SplitMix64;
use nalgebra::{DMatrix, DVector};

/// Rows `u` with their data `y`, step by step.
type Problem = Vec<Vec<(Vec<Complex>, Complex)>>;

fn normal(random: &mut SplitMix64) -> Complex {
    Complex::new(random.normal(), random.normal())
}

/// `n` unknowns, some steps with no row, one, or two.
fn scattered(n: usize, steps: usize, seed: u64) -> Problem {
    let mut random = SplitMix64::new(seed);
    let row = |random: &mut SplitMix64| ((0..n).map(|_| normal(random)).collect(), normal(random));
    (0..steps).map(|t| (0..[1, 1, 2, 1, 0, 1][t % 6]).map(|_| row(&mut random)).collect()).collect()
}

/// Lines of a band-limited input (tails of one part in 300) as they appear at harmonics -2..=2, 25 bins apart, on bins
/// `-top..=top` descending; a real system's data.
fn harmonics(top: i64, seed: u64) -> Problem {
    let mut random = SplitMix64::new(seed);
    let mut lines: Vec<Complex> =
        (0..=top + 50).map(|i| normal(&mut random) * if i <= 40 { 1.0 } else { 3e-3 }).collect();
    lines[0].im = 0.0;
    let line = |i: i64| if i < 0 { lines[-i as usize].conj() } else { lines[i as usize] };
    let mut data: Vec<Complex> = (0..=top).map(|_| normal(&mut random)).collect();
    data[0].im = 0.0;
    let y = |i: i64| if i < 0 { data[-i as usize].conj() } else { data[i as usize] };
    (-top..=top).rev().map(|i| vec![((-2..=2).map(|k| line(i - 25 * k)).collect(), y(i))]).collect()
}

fn observations(problem: &Problem) -> (Observations, Vec<Complex>) {
    let mut observations = Observations::new(problem.iter().flatten().next().map_or(1, |(u, _)| u.len()));
    problem.iter().for_each(|rows| observations.step(rows.iter().map(|(u, _)| &u[..])));
    (observations, problem.iter().flatten().map(|(_, y)| *y).collect())
}

/// All rows over all penalties, the dense way: minimiser and inverse of the normal matrix.
struct Dense {
    n: usize,
    x: DVector<Complex>,
    inverse: DMatrix<Complex>,
}

impl Dense {
    /// With a prior for level and slope at the first step, and perhaps the mirrored one at the last.
    fn new(problem: &Problem, smoothness: f64, prior: Option<[&[f64]; 2]>, both: bool) -> Self {
        let n = problem.iter().flatten().next().map_or(1, |(u, _)| u.len());
        let (steps, count) = (problem.len(), problem.iter().flatten().count());
        let penalties = count + (steps - 2) * n;
        let mut a = DMatrix::zeros(penalties + 4 * n, steps * n);
        let mut b = DVector::zeros(a.nrows());
        let rows = problem.iter().enumerate().flat_map(|(t, rows)| rows.iter().map(move |row| (t, row)));
        for (r, (t, (u, y))) in rows.enumerate() {
            (0..n).for_each(|i| a[(r, t * n + i)] = u[i]);
            b[r] = *y;
        }
        for t in 1..steps - 1 {
            for i in 0..n {
                for (at, weight) in [(t - 1, 1.0), (t, -2.0), (t + 1, 1.0)] {
                    a[(count + (t - 1) * n + i, at * n + i)] = Complex::new(weight * smoothness.sqrt(), 0.0);
                }
            }
        }
        if let Some([level, slope]) = prior {
            let ends = if both { vec![(0, 1), (steps - 1, steps - 2)] } else { vec![(0, 1)] };
            for (end, (first, second)) in ends.into_iter().enumerate() {
                for j in 0..n {
                    // at the far end stand the mirrored unknowns
                    let i = if end == 0 { j } else { n - 1 - j };
                    let row = penalties + 2 * end * n + 2 * j;
                    a[(row, first * n + j)] = Complex::new(level[i].powf(-0.5), 0.0);
                    a[(row + 1, first * n + j)] = Complex::new(-slope[i].powf(-0.5), 0.0);
                    a[(row + 1, second * n + j)] = Complex::new(slope[i].powf(-0.5), 0.0);
                }
            }
        }
        let qr = a.qr();
        let r_inverse = qr.r().try_inverse().expect("the data determine all");
        let x = &r_inverse * (qr.q().adjoint() * b);
        Self { n, x, inverse: &r_inverse * r_inverse.adjoint() }
    }

    fn remaining(&self, t: usize, u: &[Complex]) -> f64 {
        let block = self.inverse.view((t * self.n, t * self.n), (self.n, self.n));
        let u = DVector::from_column_slice(u);
        1.0 - u.tr_mul(&(block * u.map(|v| v.conj())))[0].re
    }

    fn variance(&self, t: usize, i: usize) -> f64 {
        self.inverse[(t * self.n + i, t * self.n + i)].re
    }
}

#[test]
fn the_minimiser_is_that_of_dense_least_squares() {
    for (n, steps) in [(1, 3), (1, 30), (2, 9), (3, 40), (9, 30)] {
        let problem = scattered(n, steps, (n + steps) as u64);
        let (observations, y) = observations(&problem);
        if observations.rows() < 2 * n {
            continue;
        }
        for smoothness in [1e-6, 1e-2, 1.0, 1e3, 1e6] {
            let dense = Dense::new(&problem, smoothness, None, false);
            let smoother = Smoother::new(&observations, smoothness, &End::Free).expect("a good problem");
            let estimate = smoother.solve(&y).expect("sizes agree");
            let scale = dense.x.iter().map(|v| v.norm()).fold(0.0, f64::max);
            for (i, x) in estimate.values.iter().enumerate() {
                assert!((x - dense.x[i]).norm() < 1e-8 * scale, "{n}, {steps}, {smoothness}: {i}");
            }
        }
    }
}

#[test]
fn half_an_axis_with_its_mirror_gives_the_whole() {
    let top = 50;
    let whole = harmonics(top, 4);
    let half: Problem = whole[..=top as usize].to_vec();
    let ((whole_rows, whole_y), (half_rows, half_y)) = (observations(&whole), observations(&half));
    let mirror = End::Mirror((0..5).rev().collect());
    for smoothness in [1e-4, 1.0, 1e4] {
        let dense = Dense::new(&whole, smoothness, None, false);
        let all = Smoother::new(&whole_rows, smoothness, &End::Free).expect("a good problem");
        let part = Smoother::new(&half_rows, smoothness, &mirror).expect("a good problem");
        let (all_x, part_x) = (all.solve(&whole_y).expect("sizes"), part.solve(&half_y).expect("sizes"));
        let scale = dense.x.iter().map(|v| v.norm()).fold(0.0, f64::max);
        for (i, x) in part_x.values.iter().enumerate() {
            assert!((x - dense.x[i]).norm() < 1e-8 * scale, "{smoothness}: {i}, {x} {}", dense.x[i]);
            assert!((all_x.values[i] - dense.x[i]).norm() < 1e-8 * scale, "{smoothness}: {i}");
        }
        let dense = Dense::new(&whole, smoothness, Some(part.prior()), true);
        let u = part.uncertainty();
        for (t, rows) in half.iter().enumerate() {
            let (found, expected) = (u.remaining[t], dense.remaining(t, &rows[0].0));
            assert!((found - expected).abs() < 1e-9, "{smoothness}, {t}: {found} {expected}");
            assert!((part_x.residuals[t] - all_x.residuals[t]).norm() < 1e-8, "{smoothness}, {t}");
        }
        // the first step's variance is what rounding leaves of the prior's
        for (c, &t) in u.steps.iter().enumerate().skip(1) {
            for i in 0..5 {
                let (found, expected) = (u.variances[5 * c + i], dense.variance(t, i));
                assert!((found / expected - 1.0).abs() < 1e-6, "{smoothness}: step {t}, {i}: {found} {expected}");
            }
        }
    }
}

#[test]
fn leverages_and_variances_are_those_of_the_inverse() {
    let problem = scattered(3, 40, 8);
    let (observations, _) = observations(&problem);
    for smoothness in [1e-3, 1.0, 1e3] {
        let smoother = Smoother::new(&observations, smoothness, &End::Free).expect("a good problem");
        let dense = Dense::new(&problem, smoothness, Some(smoother.prior()), false);
        let u = smoother.uncertainty();
        let rows = problem.iter().enumerate().flat_map(|(t, rows)| rows.iter().map(move |(row, _)| (t, row)));
        for (r, (t, row)) in rows.enumerate() {
            let expected = dense.remaining(t, row);
            assert!((u.remaining[r] - expected).abs() < 1e-9, "{smoothness}, {r}: {} {expected}", u.remaining[r]);
        }
        // the first step's variance is what rounding leaves of the prior's
        for (c, &t) in u.steps.iter().enumerate().skip(1) {
            for i in 0..3 {
                let (found, expected) = (u.variances[3 * c + i], dense.variance(t, i));
                assert!((found / expected - 1.0).abs() < 1e-6, "{smoothness}: step {t}, {i}: {found} {expected}");
            }
        }
    }
}

#[test]
fn nothing_excited_is_refused() {
    let mut observations = Observations::new(2);
    let zero = [Complex::new(0.0, 0.0); 2];
    (0..9).for_each(|_| observations.step([&zero[..]]));
    let found = Smoother::new(&observations, 1.0, &End::Free).err().expect("refused");
    assert!(found.to_string().contains("nothing is excited"), "{found}");
    let none = Observations::new(2);
    assert!(Smoother::new(&none, 1.0, &End::Free).is_err());
}

#[test]
fn what_cannot_be_is_refused() {
    let (observations, y) = observations(&scattered(2, 12, 3));
    for smoothness in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(Smoother::new(&observations, smoothness, &End::Free), Err(Error::OutOfRange { .. })));
    }
    assert!(matches!(Smoother::new(&observations, 1.0, &End::Mirror(vec![0])), Err(Error::Shape { .. })));
    let smoother = Smoother::new(&observations, 1.0, &End::Free).expect("a good problem");
    assert!(matches!(smoother.solve(&y[1..]), Err(Error::Shape { .. })));
}

#[test]
fn a_long_gap_is_bridged_by_a_straight_line() {
    // one unknown, seen at both ends of an axis of 4000 steps: y = 1 before, y = 3 behind
    let (steps, seen) = (4000, 10);
    let unit = [Complex::new(1.0, 0.0)];
    let mut observations = Observations::new(1);
    let inside = |t: usize| t < seen || t >= steps - seen;
    (0..steps).for_each(|t| observations.step(inside(t).then_some(&unit[..])));
    // data on one straight line: no penalty, no residual, whatever the smoothness
    let line = |t: usize| Complex::new(1.0 + 2.0 * t as f64 / steps as f64, -0.5);
    let y: Vec<Complex> = (0..steps).filter(|&t| inside(t)).map(line).collect();
    for smoothness in [1e-6, 1.0, 1e6] {
        let smoother = Smoother::new(&observations, smoothness, &End::Free).expect("a good problem");
        let estimate = smoother.solve(&y).expect("sizes agree");
        for t in 0..steps {
            assert!((estimate.values[t] - line(t)).norm() < 1e-8, "{smoothness}, {t}: {}", estimate.values[t]);
        }
    }
}
