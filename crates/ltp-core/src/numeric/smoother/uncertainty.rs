//! What the data leave open: leverages and variances, from one backward pass over 2n x 2n matrices.

use super::Smoother;
use super::blocks::{Blocks, Vector, add, inner};
use crate::numeric::Complex;

/// The share of a predicted variance below which what remains of it is rounding.
const VOUCHED: f64 = 1e-10;

/// What the data leave open, whatever their values.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// One minus the leverage, of each row: the share of noise in it that stays in its residual.
    pub remaining: Vec<f64>,
    /// Steps at which the variances stand, increasing.
    pub steps: Vec<usize>,
    /// Variance of each unknown for unit noise, `E |estimate - truth|^2`, (steps of the field above, n).
    pub variances: Vec<f64>,
}

impl Smoother<'_> {
    /// Leverages of all rows, and variances at the checkpoints, from one backward pass.
    ///
    /// They are those of the finite [`Self::prior`], which is felt only where the data say next to nothing.
    pub fn uncertainty(&self) -> Uncertainty {
        let obs = self.observations;
        let (n, open) = (obs.n, self.open_steps());
        let mut remaining = vec![0.0; obs.rows()];
        let (mut steps, mut variances) = (Vec::new(), Vec::new());
        let mut information = Blocks::zero(n);
        if let Some((state, closing)) = &self.closing {
            let (added, left) = closing.information();
            obs.at(open).zip(left).for_each(|(r, left)| remaining[r] = left);
            steps.push(open);
            variances.push(smoothed(n, state, &added));
            information = added;
        }
        let [mut to_level, mut to_slope, mut h] = [Vector::zero(n), Vector::zero(n), Vector::zero(n)];
        let [mut level, mut slope] = [Vector::zero(n), Vector::zero(n)];
        for t in (0..open).rev() {
            if t + 1 < obs.steps() {
                information.retreat();
            }
            for r in obs.at(t).rev() {
                let gain = self.gain(r);
                to_level.fill(gain.0);
                to_slope.fill(gain.1);
                h.fill(obs.row(r));
                information.times(&to_level, &to_slope, &mut level, &mut slope);
                let answered = inner(gain.0, &level.data).re + inner(gain.1, &slope.data).re;
                remaining[r] = 1.0 / self.variances[r] + answered;
                add(&mut level.data, Complex::new(-0.5 * remaining[r], 0.0), &h.data);
                information.subtract_level_pair(&h, &level, &slope);
            }
            if t % self.every == 0 {
                information.symmetrise();
                steps.push(t);
                variances.push(smoothed(n, &self.checkpoints[t / self.every], &information));
            }
        }
        steps.reverse();
        variances.reverse();
        Uncertainty { remaining, steps, variances: variances.concat() }
    }
}

/// Variances of the levels, `P - P N P`.
fn smoothed(n: usize, covariance: &Blocks, information: &Blocks) -> Vec<f64> {
    let [mut x, mut y, mut level, mut slope] = [(); 4].map(|()| Vector::zero(n));
    let variance = |i: usize| {
        for j in 0..n {
            x.set(j, covariance.get((0, j), (0, i)));
            y.set(j, covariance.get((1, j), (0, i)));
        }
        information.times(&x, &y, &mut level, &mut slope);
        let known = inner(&x.data, &level.data).re + inner(&y.data, &slope.data).re;
        let predicted = covariance.get((0, i), (0, i)).re;
        // a difference of rounded numbers cannot vouch for less
        (predicted - known).max(VOUCHED * predicted)
    };
    (0..n).map(variance).collect()
}
