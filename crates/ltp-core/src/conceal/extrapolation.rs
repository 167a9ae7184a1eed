//! One step of the truth integrator: Gragg's modified midpoint rule, extrapolated (Bulirsch & Stoer 1966; Hairer,
//! Norsett & Wanner, *Solving Ordinary Differential Equations I*, section II.9).
//!
//! The error of the midpoint rule has even powers of the substep only, so each column of the extrapolation gains two
//! orders. Columns are added until two neighbours agree; nothing of it is shared with the engine's Runge-Kutta pair.

/// Substeps of each column.
const SUBSTEPS: [usize; 9] = [2, 4, 6, 8, 10, 12, 14, 16, 18];

/// Rates from time and state, written into the last argument.
pub type Flow<'a> = &'a mut dyn FnMut(f64, &[f64], &mut [f64]);

/// The table of one step, kept between steps.
pub struct Extrapolation {
    table: Vec<Vec<f64>>,
    before: Vec<f64>,
    now: Vec<f64>,
    next: Vec<f64>,
    rate: Vec<f64>,
}

impl Extrapolation {
    /// Room for `n` states.
    pub fn new(n: usize) -> Self {
        let row = || vec![0.0; n];
        let table = (0..SUBSTEPS.len()).map(|_| row()).collect();
        Self { table, before: row(), now: row(), next: row(), rate: row() }
    }

    /// A step of length `h` from `x` with rates `rate` there; the number of columns it took, `None` where they do not agree
    /// within `scale` (one tolerance per state). The result is in `out` either way.
    pub fn step(
        &mut self,
        flow: Flow<'_>,
        (t, h): (f64, f64),
        (x, rate): (&[f64], &[f64]),
        scale: &[f64],
        out: &mut [f64],
    ) -> Option<usize> {
        for j in 0..SUBSTEPS.len() {
            self.midpoint(flow, (t, h), (x, rate), SUBSTEPS[j]);
            std::mem::swap(&mut self.next, &mut self.now);
            // Neville's scheme in place: table[i] holds T(j, j - i) after column j.
            let mut fresh = std::mem::take(&mut self.next);
            let mut error = 0.0f64;
            for i in 0..=j {
                let ratio = if i == 0 { 1.0 } else { SUBSTEPS[j] as f64 / SUBSTEPS[j - i] as f64 };
                for n in 0..x.len() {
                    // T(j, i) from T(j, i-1), held in `now`, and T(j-1, i-1), held in the table's entry i-1.
                    let value = if i == 0 {
                        self.now[n]
                    } else {
                        self.now[n] + (self.now[n] - self.table[i - 1][n]) / (ratio * ratio - 1.0)
                    };
                    if i == j && i > 0 {
                        error = error.max((value - self.now[n]).abs() / scale[n]);
                        if !value.is_finite() {
                            error = f64::INFINITY;
                        }
                    }
                    fresh[n] = value;
                }
                if i > 0 {
                    self.table[i - 1].copy_from_slice(&self.now);
                }
                self.now.copy_from_slice(&fresh);
            }
            self.table[j].copy_from_slice(&self.now);
            self.next = fresh;
            out.copy_from_slice(&self.now);
            if j >= 2 && error <= 1.0 {
                return Some(j);
            }
            if !error.is_finite() {
                return None;
            }
        }
        None
    }

    /// Gragg's rule with `n` substeps, its result in `next`.
    fn midpoint(&mut self, flow: Flow<'_>, (t, h): (f64, f64), (x, rate): (&[f64], &[f64]), n: usize) {
        let s = h / n as f64;
        self.before.copy_from_slice(x);
        for (now, (x, f)) in self.now.iter_mut().zip(x.iter().zip(rate)) {
            *now = x + s * f;
        }
        for k in 1..n {
            flow(t + k as f64 * s, &self.now, &mut self.rate);
            for i in 0..x.len() {
                self.next[i] = self.before[i] + 2.0 * s * self.rate[i];
            }
            std::mem::swap(&mut self.before, &mut self.now);
            std::mem::swap(&mut self.now, &mut self.next);
        }
        self.next.copy_from_slice(&self.now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_column_gains_two_orders() {
        // x' = x from 1 over h: the error of the accepted column falls below the tolerance, and tightening it adds columns.
        let mut columns = Vec::new();
        for tolerance in [1e-4, 1e-7, 1e-10, 1e-13] {
            let mut table = Extrapolation::new(1);
            let mut out = [0.0];
            let took = table.step(&mut |_, x, f| f[0] = x[0], (0.0, 0.5), (&[1.0], &[1.0]), &[tolerance], &mut out);
            columns.push(took.unwrap());
            assert!((out[0] - 0.5f64.exp()).abs() < tolerance, "{} at {tolerance}", out[0]);
        }
        assert!(columns.windows(2).all(|w| w[0] <= w[1]) && columns[0] < columns[3], "{columns:?}");
    }

    #[test]
    fn what_cannot_converge_says_so() {
        let mut table = Extrapolation::new(1);
        let mut out = [0.0];
        let jump = &mut |t: f64, _: &[f64], f: &mut [f64]| f[0] = if t < 0.3 { 0.0 } else { 1.0 };
        assert_eq!(table.step(jump, (0.0, 1.0), (&[0.0], &[0.0]), &[1e-10], &mut out), None);
    }
}
