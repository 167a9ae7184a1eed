//! How much of a series some regressors explain where they were not fitted, and whether that could be chance.
//!
//! Neighbouring samples of a mechanical record resemble each other, so that leaving out single samples flatters every
//! regressor; here whole blocks are left out. Chance is measured by shifting the regressors in time against the
//! series (circularly, all by the same amount): that keeps their spectra and destroys their alignment. Regressors
//! that are nearly periodic over the record survive a shift, and then the p-value is large: the test errs towards
//! doubt.
//!
//! References: T. Hastie, R. Tibshirani and J. Friedman, *The Elements of Statistical Learning*, 2nd ed., section
//! 7.10 (cross-validation); B. Phipson and G. K. Smyth, Stat. Appl. Genet. Mol. Biol. 9 (2010) 39 (why the p-value is
//! `(1 + b) / (1 + m)`).

use nalgebra::{DMatrix, DVector};

use super::rng::SplitMix64;
use super::rows::RowQr;
use super::stats;

/// Weight of the term that keeps collinear columns solvable, relative to the norm of each column.
const RIDGE: f64 = 1e-7;

/// Share of the variance of `y` `(n,)` that a linear combination of `columns` (each `(n,)`) explains on left-out
/// blocks.
///
/// The samples are cut into `blocks` runs of equal length; each run is predicted by the fit to all others. A constant
/// is always part of the fit. 1 is perfect, 0 no better than the mean, negative worse than the mean. Rows with a NaN
/// anywhere are left out. NaN when `y` does not vary, or when there are fewer than two blocks or fewer rows than
/// twice the unknowns.
pub fn explained(y: &[f64], columns: &[Vec<f64>], blocks: usize) -> f64 {
    let n = y.len();
    debug_assert!(columns.iter().all(|c| c.len() == n), "columns and series share their length");
    let unknowns = 1 + columns.len();
    let row = |i: usize, into: &mut Vec<f64>| {
        into.clear();
        into.push(1.0);
        into.extend(columns.iter().map(|c| c[i]));
        y[i].is_finite() && into.iter().all(|v| v.is_finite())
    };
    let rows_of = |block: usize| block * n / blocks..(block + 1) * n / blocks;
    if blocks < 2 || n < 2 * unknowns {
        return f64::NAN;
    }
    let mut regressors = Vec::with_capacity(unknowns);
    let mut norms = vec![0.0_f64; unknowns];
    let mut present = Vec::with_capacity(n);
    let mut parts = vec![RowQr::new(unknowns); blocks];
    for (block, part) in parts.iter_mut().enumerate() {
        for i in rows_of(block) {
            if row(i, &mut regressors) {
                part.push(&regressors, -y[i]);
                norms.iter_mut().zip(&regressors).for_each(|(norm, v)| *norm += v * v);
                present.push(y[i]);
            }
        }
    }
    let spread = stats::std(present.iter().copied());
    let total = present.len() as f64 * spread * spread;
    if present.len() < 2 * unknowns || total <= 0.0 {
        return f64::NAN;
    }
    // All blocks from each one on: with those before, what leaves one out costs two merges instead of one per block.
    let mut after = vec![RowQr::new(unknowns); blocks];
    for block in (1..blocks).rev() {
        after[block - 1] = after[block].clone();
        after[block - 1].merge(&parts[block]);
    }
    let mut before = RowQr::new(unknowns);
    let mut left = 0.0;
    for block in 0..blocks {
        let mut others = before.clone();
        others.merge(&after[block]);
        before.merge(&parts[block]);
        let mut ridge = vec![0.0; unknowns];
        for (j, norm) in norms.iter().enumerate() {
            ridge[j] = if *norm > 0.0 { RIDGE * norm.sqrt() } else { 1.0 };
            others.push(&ridge, 0.0);
            ridge[j] = 0.0;
        }
        let Some(weights) = others.minimiser() else {
            return f64::NAN;
        };
        for i in rows_of(block) {
            if row(i, &mut regressors) {
                let prediction: f64 = regressors.iter().zip(weights.iter()).map(|(v, w)| v * w).sum();
                left += (y[i] - prediction).powi(2);
            }
        }
    }
    1.0 - left / total
}

/// What a linear combination of `columns` and a constant leaves of `y` `(n,)`; `y` itself where they cannot be told apart.
pub fn residual(y: &[f64], columns: &[Vec<f64>]) -> Vec<f64> {
    let row = |i: usize| -> Vec<f64> { std::iter::once(1.0).chain(columns.iter().map(|c| c[i])).collect() };
    let mut rows = RowQr::new(1 + columns.len());
    for (i, y) in y.iter().enumerate() {
        rows.push(&row(i), -y);
    }
    let Some(fit) = rows.minimiser() else { return y.to_vec() };
    y.iter().enumerate().map(|(i, y)| y - row(i).iter().zip(fit.iter()).map(|(a, b)| a * b).sum::<f64>()).collect()
}

/// Probability that `columns`, beside `base`, explain as much of `y` as they do by chance: the p-value of circular shifts.
///
/// `columns` are shifted `shifts` times against `y` and `base` by amounts between a twentieth and nineteen twentieths of the
/// record, drawn from `seed`. A permutation may compare any statistic that it treats alike: here what is explained where it
/// was fitted, because shifted columns stay orthonormal and a draw costs a few products. The smallest possible value is
/// `1 / (1 + shifts)`. NaN when `base` leaves nothing of `y`.
pub fn shift_p_value(y: &[f64], base: &[Vec<f64>], columns: &[Vec<f64>], shifts: usize, seed: u64) -> f64 {
    let left = Left::new(y, base);
    let columns = orthonormal(columns);
    let margin = (y.len() / 20).max(1);
    let mut random = SplitMix64::new(seed);
    let mut draw = || margin + random.below(y.len().saturating_sub(2 * margin) + 1);
    left.p_value(left.share(&columns, 0), (0..shifts).map(|_| left.share(&columns, draw())))
}

/// As [`shift_p_value`] for columns that a shift leaves as good as they are, such as harmonics of a clock: against other
/// columns of the same kind and number, `strangers`, that have nothing to do with the series.
pub fn stranger_p_value(
    y: &[f64],
    base: &[Vec<f64>],
    columns: &[Vec<f64>],
    strangers: impl Iterator<Item = Vec<Vec<f64>>>,
) -> f64 {
    let left = Left::new(y, base);
    left.p_value(left.share(&orthonormal(columns), 0), strangers.map(|c| left.share(&orthonormal(&c), 0)))
}

/// What a constant and a base leave of a series; zero where either has a gap.
struct Left {
    y: Vec<f64>,
    /// The base without its mean, orthonormal.
    base: Vec<Vec<f64>>,
}

impl Left {
    fn new(y: &[f64], base: &[Vec<f64>]) -> Self {
        let present: Vec<usize> =
            (0..y.len()).filter(|&i| y[i].is_finite() && base.iter().all(|c| c[i].is_finite())).collect();
        let of = |x: &[f64]| -> Vec<f64> { present.iter().map(|&i| x[i]).collect() };
        let spread = |x: &[f64]| -> Vec<f64> {
            let mut all = vec![0.0; y.len()];
            present.iter().zip(x).for_each(|(&i, v)| all[i] = *v);
            all
        };
        let mut own = of(y);
        let mean = stats::mean(own.iter().copied());
        own.iter_mut().for_each(|v| *v -= mean);
        let base = orthonormal(&base.iter().map(|c| of(c)).collect::<Vec<_>>());
        for c in &base {
            let along = dot(&own, c);
            own.iter_mut().zip(c).for_each(|(v, c)| *v -= along * c);
        }
        Self { y: spread(&own), base: base.iter().map(|c| spread(c)).collect() }
    }

    /// Sum of squares that orthonormal columns, shifted by `by` samples, explain beside the base.
    fn share(&self, columns: &[Vec<f64>], by: usize) -> f64 {
        let shifted = |x: &[f64], c: &[f64]| {
            let (first, last) = x.split_at(x.len() - by);
            dot(first, &c[by..]) + dot(last, &c[..by])
        };
        let along = DVector::from_iterator(columns.len(), columns.iter().map(|c| shifted(&self.y, c)));
        let common = DMatrix::from_fn(self.base.len(), columns.len(), |i, j| shifted(&self.base[i], &columns[j]));
        // What the columns have beyond the base, kept solvable where that is nothing.
        let beyond = DMatrix::identity(columns.len(), columns.len()) * (1.0 + RIDGE) - common.transpose() * common;
        beyond.cholesky().map_or(f64::NAN, |c| along.dot(&c.solve(&along)))
    }

    /// `(1 + b) / (1 + m)` with `b` of `m` draws as good as what was reached.
    fn p_value(&self, reached: f64, draws: impl Iterator<Item = f64>) -> f64 {
        if dot(&self.y, &self.y) <= 0.0 || !reached.is_finite() {
            return f64::NAN;
        }
        // Rounding must not make a draw that is the very same look worse, nor one that cannot be solved a bad one.
        let as_good = |share: f64| share.is_nan() || share >= reached * (1.0 - 1e-9);
        let (chance, all) = draws.fold((0, 0), |(b, m), share| (b + u32::from(as_good(share)), m + 1));
        f64::from(1 + chance) / f64::from(1 + all)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Orthonormal columns without a mean that span what `columns` span beside a constant; gaps count as the mean.
fn orthonormal(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for column in columns {
        let mean = stats::mean(column.iter().copied());
        let mut c: Vec<f64> = column.iter().map(|v| if v.is_finite() { v - mean } else { 0.0 }).collect();
        let size = dot(&c, &c).sqrt();
        // Twice is enough (Parlett): what the first pass leaves by rounding, the second removes.
        for _ in 0..2 {
            for known in &out {
                let along = dot(&c, known);
                c.iter_mut().zip(known).for_each(|(v, k)| *v -= along * k);
            }
        }
        let left = dot(&c, &c).sqrt();
        if left > 1e-6 * size {
            c.iter_mut().for_each(|v| *v /= left);
            out.push(c);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth noise: a sum of sines with irregular frequencies and seeded phases.
    fn smooth(n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        let parts: Vec<(f64, f64)> = (0..12).map(|_| (0.01 + 0.2 * random.uniform(), 6.3 * random.uniform())).collect();
        (0..n).map(|i| parts.iter().map(|(w, p)| (w * i as f64 + p).sin()).sum()).collect()
    }

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        (0..n).map(|_| random.normal()).collect()
    }

    #[test]
    fn known_share_of_variance() {
        let (x, e) = (noise(4000, 1), noise(4000, 2));
        let y: Vec<f64> = x.iter().zip(&e).map(|(x, e)| 5.0 + 2.0 * x + e).collect();
        let share = explained(&y, std::slice::from_ref(&x), 5);
        assert!((share - 0.8).abs() < 0.02, "share {share}");
        assert!(explained(&y, &[e], 5) < 0.25);
        assert!(explained(&y, &[], 5).abs() < 0.01);
        let exact: Vec<f64> = x.iter().map(|x| 3.0 - x).collect();
        assert!(explained(&exact, &[x], 5) > 1.0 - 1e-10);
    }

    #[test]
    fn collinear_and_zero_columns_do_no_harm() {
        let x = smooth(600, 3);
        let y: Vec<f64> = x.iter().map(|x| 2.0 * x).collect();
        let share = explained(&y, &[x.clone(), x, vec![0.0; 600], vec![4.0; 600]], 5);
        assert!(share > 1.0 - 1e-9, "share {share}");
    }

    #[test]
    fn gaps_are_left_out_and_hopeless_cases_are_nan() {
        let x = smooth(600, 4);
        let mut y: Vec<f64> = x.iter().map(|x| 2.0 * x + 1.0).collect();
        y[100..180].fill(f64::NAN);
        assert!(explained(&y, std::slice::from_ref(&x), 5) > 1.0 - 1e-9);
        assert!(explained(&[1.0; 600], std::slice::from_ref(&x), 5).is_nan());
        assert!(explained(&y, &[x], 1).is_nan());
        assert!(explained(&[1.0, 2.0], &[vec![1.0, 2.0]], 2).is_nan());
    }

    #[test]
    fn shifts_tell_a_cause_from_a_stranger() {
        let (x, other, e) = (smooth(1500, 5), smooth(1500, 6), noise(1500, 7));
        let y: Vec<f64> = (0..1500).map(|i| other[i] + 0.5 * x[i] + 0.5 * e[i]).collect();
        let base = std::slice::from_ref(&other);
        assert_eq!(shift_p_value(&y, base, std::slice::from_ref(&x), 99, 1), 0.01);
        let strangers: Vec<f64> =
            (0..10).map(|seed| shift_p_value(&y, base, &[smooth(1500, 100 + seed)], 49, 1)).collect();
        let small = strangers.iter().filter(|p| **p <= 0.05).count();
        assert!(small <= 2, "{strangers:?}");
    }

    #[test]
    fn same_seed_same_value() {
        let (x, y) = (smooth(500, 8), smooth(500, 9));
        let columns = [x];
        assert_eq!(shift_p_value(&y, &[], &columns, 30, 4), shift_p_value(&y, &[], &columns, 30, 4));
    }
}
