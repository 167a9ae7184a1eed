//! Exact harmonic transfer functions of a linear time-periodic system with jumps, from its periodic steady state.
//!
//! The input `u = e^{j w t}` has the response `x(t) = e^{j w t} p(t)` with `p` of period `T`, so
//! `(e^{j w T} I - M) x_0 = q(w)` with the monodromy `M` and the forced response `q` over one period from rest. Then
//! `H_k(j w) = 1/T int_0^T e^{-j (w + k w_p) t} y(t) dt` by Gauss quadrature. The state is not truncated: harmonics asked for
//! do not change the values of the others.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::htf::Htf;
use super::propagate::Propagation;
use super::system::{LtpSystem, NODES, Size};
use crate::error::{Error, Result};
use crate::numeric::Complex;

/// A multiplier this close to `e^{j w T}` leaves no periodic response, relative to one.
const SINGULAR: f64 = 1e-9;
/// A multiplier this close is worth a warning: values are as uncertain as the multiplier.
const NEAR: f64 = 1e-4;

impl LtpSystem {
    /// Exact harmonic transfer functions with harmonics -K..=K at input frequencies `omega`, rad/s.
    ///
    /// # Errors
    /// `OutOfRange` at a frequency where a Floquet multiplier of modulus one resonates, so that no periodic response exists
    /// (an autonomous orbit at multiples of its own frequency, for one), and what [`Htf::new`] says of the frequencies.
    pub fn htf(&self, omega: &[f64], harmonics: usize) -> Result<Htf> {
        let Size { nu, ny, .. } = self.size();
        let pumping = std::f64::consts::TAU / self.period();
        let largest = omega.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
        let mut warnings = Vec::new();
        for &w in omega {
            let turn = Complex::from_polar(1.0, w * self.period());
            let nearest = self.multipliers().iter().min_by(|a, b| (turn - **a).norm().total_cmp(&(turn - **b).norm()));
            let Some(nearest) = nearest else { continue };
            let distance = (turn - nearest).norm();
            if distance < SINGULAR {
                let expected = format!(
                    "a frequency away from the Floquet multiplier {:.9} {:+.9}j, which stands at e^(j omega T): the \
                     response to a sine there grows without end, so no transfer function exists",
                    nearest.re, nearest.im
                );
                return Err(Error::OutOfRange { what: "omega".into(), found: w, expected });
            }
            if distance < NEAR {
                warnings.push(format!(
                    "at omega = {w} rad/s a Floquet multiplier is {distance:.1e} from e^(j omega T): values there are as \
                     uncertain as the multiplier, relative error about {:.0e}",
                    1e-12 / distance
                ));
            }
        }
        if let Some(outside) = self.multipliers().first().filter(|m| m.norm() > 1.0 + 1e-9) {
            warnings.push(format!(
                "the periodic motion is unstable (largest multiplier of modulus {:.6}): the transfer functions describe a \
                 response that exists, but that no experiment without feedback shows",
                outside.norm()
            ));
        }

        let propagation = Propagation::new(self, largest + harmonics as f64 * pumping);
        let times: Vec<f64> = propagation.times(&self.gauss().nodes).collect();
        let turns: Vec<Complex> = times.iter().map(|t| Complex::from_polar(1.0, -pumping * t)).collect();
        let of_one = |&w: &f64| -> Result<Vec<Complex>> {
            let mut sums = Vec::with_capacity(ny * nu * (2 * harmonics + 1));
            for input in 0..nu {
                let outputs = self.steady_outputs(&propagation, &times, w, input)?;
                (0..ny).for_each(|y| sums.extend(fourier(&outputs, y, ny, &turns, harmonics)));
            }
            Ok(sums)
        };
        let columns: Vec<Vec<Complex>> = omega.par_iter().map(of_one).collect::<Result<_>>()?;
        let rows = 2 * harmonics + 1;
        let mut values = Vec::with_capacity(rows * omega.len() * ny * nu);
        for row in 0..rows {
            for column in &columns {
                for y in 0..ny {
                    values.extend((0..nu).map(|u| column[(u * ny + y) * rows + row] / self.period()));
                }
            }
        }
        let mut htf =
            Htf::new(self.period(), harmonics, omega.to_vec(), (ny, nu), values, "exact periodic steady state")?;
        htf.warnings = warnings;
        Ok(htf)
    }

    /// `w_n e^{-j w t_n} y(t_n)` at all nodes `n` of the period, (nodes, ny), in the steady state under `e^{j w t}` on one
    /// input; `w_n` are the quadrature weights.
    fn steady_outputs(&self, propagation: &Propagation, times: &[f64], w: f64, input: usize) -> Result<Vec<Complex>> {
        let Size { nx, nu, ny } = self.size();
        let zero = Complex::new(0.0, 0.0);
        let push: Vec<Complex> = times.iter().map(|t| Complex::from_polar(1.0, w * t)).collect();
        // Only one input moves: its column of the maps is enough.
        let dot_input = |row: &[f64], push: &[Complex]| -> Complex {
            row.iter().skip(input).step_by(nu).zip(push).map(|(a, u)| u * *a).sum()
        };
        let wide = NODES * nu;
        let step = |index: usize, x: &mut Vec<Complex>| {
            let part = &propagation.parts[index];
            let push = &push[index * NODES..(index + 1) * NODES];
            let row = |r: usize| {
                dot(&part.end_state[r * nx..(r + 1) * nx], x)
                    + dot_input(&part.end_input[r * wide..(r + 1) * wide], push)
            };
            let mut next: Vec<Complex> = (0..nx).map(row).collect();
            for jump in part.jumps.map_or(&[][..], |k| &self.segments()[k].jumps) {
                let push = Complex::from_polar(1.0, w * jump.time);
                let row = |r: usize| dot(&jump.state[r * nx..(r + 1) * nx], &next) + jump.input[r * nu + input] * push;
                next = (0..nx).map(row).collect();
            }
            *x = next;
        };
        let mut forced = vec![zero; nx];
        (0..propagation.parts.len()).for_each(|i| step(i, &mut forced));
        let turn = Complex::from_polar(1.0, w * self.period());
        let matrix = DMatrix::from_fn(nx, nx, |i, j| {
            let own = if i == j { turn } else { zero };
            own - self.monodromy()[i * nx + j]
        });
        let start = matrix.lu().solve(&DVector::from_vec(forced)).ok_or_else(|| Error::OutOfRange {
            what: "omega".into(),
            found: w,
            expected: "a frequency at which the periodic response exists; this one resonates without damping".into(),
        })?;
        let mut x: Vec<Complex> = start.iter().copied().collect();
        let mut out = Vec::with_capacity(times.len() * ny);
        for (index, part) in propagation.parts.iter().enumerate() {
            let push = &push[index * NODES..(index + 1) * NODES];
            for i in 0..NODES {
                let weight = self.gauss().weights[i] * part.length * push[i].conj();
                for r in i * ny..(i + 1) * ny {
                    let value = dot(&part.output_state[r * nx..(r + 1) * nx], &x)
                        + dot_input(&part.output_input[r * wide..(r + 1) * wide], push);
                    out.push(weight * value);
                }
            }
            step(index, &mut x);
        }
        Ok(out)
    }
}

fn dot(row: &[f64], x: &[Complex]) -> Complex {
    row.iter().zip(x).map(|(a, x)| x * *a).sum()
}

/// `sum_n z_n e^{-j k w_p t_n}` for k = -K..=K, by powers of the turns: K of them lose about K rounding errors.
fn fourier(z: &[Complex], y: usize, ny: usize, turns: &[Complex], harmonics: usize) -> Vec<Complex> {
    let mut sums = vec![Complex::new(0.0, 0.0); 2 * harmonics + 1];
    let mut up: Vec<Complex> = z.iter().skip(y).step_by(ny).copied().collect();
    let mut down = up.clone();
    sums[harmonics] = up.iter().sum();
    for k in 1..=harmonics {
        let (mut plus, mut minus) = (Complex::new(0.0, 0.0), Complex::new(0.0, 0.0));
        for ((u, d), turn) in up.iter_mut().zip(&mut down).zip(turns) {
            *u *= turn;
            *d *= turn.conj();
            plus += *u;
            minus += *d;
        }
        sums[harmonics + k] = plus;
        sums[harmonics - k] = minus;
    }
    sums
}
