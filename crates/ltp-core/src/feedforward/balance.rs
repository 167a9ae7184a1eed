//! The motion of a system in which one coordinate is prescribed, by harmonic balance.
//!
//! All other states and one input are unknown: as many as there are equations. They are trigonometric polynomials of `K`
//! harmonics, given by their values at `2K + 1` even instants, and `z' = f(t, z, u)` holds there (Fourier collocation, which
//! converges faster than any power of `1/K`). Newton's method with exact derivatives takes the shortest step where the
//! equations leave a direction open, as they do the place of a cart.
//!
//! Reference: L. N. Trefethen, *Spectral Methods in MATLAB*, chapter 3 (differentiation of periodic samples).

use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};

use super::{ROUNDING, Reference, index};
use crate::error::{Error, Result};
use crate::model::system::without_past;
use crate::model::{Point, System};
use crate::numeric::fourier_series::FourierSeries;

/// Iterations of Newton's method.
const ITERATIONS: usize = 60;
/// Steps that halve without success end the search.
const HALVINGS: i32 = 12;
/// What is left of the equations relative to the rates when they count as solved.
const TOLERANCE: f64 = 1e-9;
/// Singular values below this share of the largest are directions that the equations leave open.
const SINGULAR: f64 = 1e-11;
/// Amplitudes, as shares of the one asked for, that are gone through when Newton's method fails at once.
const STAIRS: usize = 16;

/// How to solve for a reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Harmonics of the unknown states and of the input.
    pub harmonics: usize,
    /// Number of the input that is solved.
    pub input: usize,
    /// Constant values (nu) of the other inputs; zero where empty.
    pub inputs: Vec<f64>,
    /// States (nx) to start from; the system's initial state, at rest, where `None`.
    pub start: Option<FourierSeries>,
    /// Mode; the system's where `None`.
    pub mode: Option<usize>,
}

impl Default for Options {
    fn default() -> Self {
        Self { harmonics: 12, input: 0, inputs: Vec::new(), start: None, mode: None }
    }
}

/// The periodic motion whose state number `coordinate` is `prescribed` (one row), and the input that makes it.
///
/// # Errors
/// `OutOfRange` for a coordinate or input that does not exist and for fewer harmonics than are prescribed, `Shape` for values
/// of the wrong length, `NoConvergence` when no such motion is found, with the equation that cannot be balanced.
pub fn feedforward(
    system: &dyn System,
    p: &[f64],
    coordinate: usize,
    prescribed: &FourierSeries,
    options: &Options,
) -> Result<Reference> {
    without_past(system, p, "reference")?;
    let problem = Problem::new(system, p, coordinate, prescribed, options)?;
    let start = problem.start(options.start.as_ref());
    let mean = prescribed.coefficients()[0].re;
    let wanted = problem.samples(prescribed);
    let solution = problem.newton(start.clone(), &wanted).or_else(|first| {
        let mut y = start;
        for stair in 1..=STAIRS {
            let share = stair as f64 / STAIRS as f64;
            let part: Vec<f64> = wanted.iter().map(|v| mean + share * (v - mean)).collect();
            y = problem.newton(y, &part).map_err(|_| first.clone())?;
        }
        Ok::<_, Error>(y)
    })?;
    let (nx, nu, n) = (system.states(), system.inputs(), problem.n);
    let (mut states, mut inputs) = (vec![0.0; n * nx], vec![0.0; n * nu]);
    for i in 0..n {
        states[i * nx..][..nx].copy_from_slice(&solution.as_slice()[i * nx..][..nx]);
        states[i * nx + coordinate] = wanted[i];
        inputs[i * nu..][..nu].copy_from_slice(&problem.held);
        inputs[i * nu + options.input] = solution[i * nx + coordinate];
    }
    let period = prescribed.period();
    let states = FourierSeries::from_samples(period, nx, &states)?.trimmed(ROUNDING);
    let inputs = FourierSeries::from_samples(period, nu, &inputs)?.trimmed(ROUNDING);
    Reference::new(system, p, problem.mode, states, inputs)
}

struct Problem<'a> {
    system: &'a dyn System,
    p: &'a [f64],
    mode: usize,
    coordinate: usize,
    input: usize,
    held: Vec<f64>,
    /// Instants in a period.
    n: usize,
    period: f64,
    /// Differentiation of samples (n, n).
    slope: DMatrix<f64>,
}

/// Equations at a guess: what is left of them (n nx), and the size of the rates.
struct Left {
    left: DVector<f64>,
    size: f64,
}

impl<'a> Problem<'a> {
    fn new(
        system: &'a dyn System,
        p: &'a [f64],
        coordinate: usize,
        prescribed: &FourierSeries,
        options: &Options,
    ) -> Result<Self> {
        let shape = |what: &str, expected: usize, found: usize| {
            if expected == found { Ok(()) } else { Err(Error::Shape { what: what.into(), expected, found }) }
        };
        shape("parameters", system.parameters().len(), p.len())?;
        shape("rows of the prescribed coordinate", 1, prescribed.rows())?;
        index("prescribed state", coordinate, system.states())?;
        index("input to solve for", options.input, system.inputs())?;
        let held = if options.inputs.is_empty() { vec![0.0; system.inputs()] } else { options.inputs.clone() };
        shape("constant inputs", system.inputs(), held.len())?;
        if let Some(start) = &options.start {
            shape("rows of the start", system.states(), start.rows())?;
        }
        if options.harmonics < prescribed.harmonics().max(1) {
            let expected = format!("at least the {} of the prescribed coordinate", prescribed.harmonics().max(1));
            return Err(Error::OutOfRange { what: "harmonics".into(), found: options.harmonics as f64, expected });
        }
        let (n, period) = (2 * options.harmonics + 1, prescribed.period());
        let slope = DMatrix::from_fn(n, n, |i, j| {
            let apart = i as f64 - j as f64;
            let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
            if i == j { 0.0 } else { sign * 0.5 * TAU / period / (PI * apart / n as f64).sin() }
        });
        let mode = options.mode.unwrap_or_else(|| system.initial_mode());
        Ok(Self { system, p, mode, coordinate, input: options.input, held, n, period, slope })
    }

    fn time(&self, i: usize) -> f64 {
        i as f64 * self.period / self.n as f64
    }

    /// Values of the prescribed coordinate (n).
    fn samples(&self, prescribed: &FourierSeries) -> Vec<f64> {
        (0..self.n).map(|i| prescribed.value(self.time(i))[0]).collect()
    }

    /// Unknowns (n, nx): the states, with the input in the place of the prescribed one.
    fn start(&self, given: Option<&FourierSeries>) -> DVector<f64> {
        let nx = self.system.states();
        let rest = self.system.initial_state();
        let mut y = DVector::zeros(self.n * nx);
        for i in 0..self.n {
            let x = given.map_or_else(|| rest.clone(), |series| series.value(self.time(i)));
            y.as_mut_slice()[i * nx..][..nx].copy_from_slice(&x);
            y[i * nx + self.coordinate] = self.held[self.input];
        }
        y
    }

    /// State and inputs at an instant.
    fn at(&self, y: &DVector<f64>, wanted: &[f64], i: usize) -> (Vec<f64>, Vec<f64>) {
        let nx = self.system.states();
        let mut x = y.as_slice()[i * nx..][..nx].to_vec();
        let mut u = self.held.clone();
        u[self.input] = x[self.coordinate];
        x[self.coordinate] = wanted[i];
        (x, u)
    }

    fn left(&self, y: &DVector<f64>, wanted: &[f64]) -> Left {
        let nx = self.system.states();
        let mut left = DVector::zeros(self.n * nx);
        let mut rates = vec![0.0; nx];
        let mut size = 0.0_f64;
        for i in 0..self.n {
            let (x, u) = self.at(y, wanted, i);
            self.system.flow(self.mode, Point { t: self.time(i), x: &x, u: &u, p: self.p }, &mut rates);
            for r in 0..nx {
                left[i * nx + r] -= rates[r];
                size = size.max(rates[r].abs());
            }
            for j in 0..self.n {
                for r in 0..nx {
                    left[j * nx + r] += self.slope[(j, i)] * x[r];
                }
            }
        }
        Left { left, size: size.max(f64::MIN_POSITIVE) }
    }

    fn jacobian(&self, y: &DVector<f64>, wanted: &[f64]) -> DMatrix<f64> {
        let (nx, nu, ny) = (self.system.states(), self.system.inputs(), self.system.outputs());
        let mut matrix = DMatrix::zeros(self.n * nx, self.n * nx);
        let mut by_state = vec![0.0; nx + nx * nx + nx * self.system.free().len()];
        let mut by_input = vec![0.0; (nx + ny) * nu];
        for i in 0..self.n {
            let (x, u) = self.at(y, wanted, i);
            let at = Point { t: self.time(i), x: &x, u: &u, p: self.p };
            self.system.flow_jacobian(self.mode, at, &mut by_state);
            self.system.input_jacobian(self.mode, at, &mut by_input);
            for c in 0..nx {
                for r in 0..nx {
                    let rate =
                        if c == self.coordinate { by_input[r * nu + self.input] } else { by_state[nx + r * nx + c] };
                    matrix[(i * nx + r, i * nx + c)] -= rate;
                }
                if c != self.coordinate {
                    for j in 0..self.n {
                        matrix[(j * nx + c, i * nx + c)] += self.slope[(j, i)];
                    }
                }
            }
        }
        matrix
    }

    fn newton(&self, mut y: DVector<f64>, wanted: &[f64]) -> Result<DVector<f64>> {
        let mut now = self.left(&y, wanted);
        for iteration in 0..ITERATIONS {
            let svd = self.jacobian(&y, wanted).svd(true, true);
            let cut = SINGULAR * svd.singular_values.max();
            let step = svd.solve(&now.left, cut).expect("both sides of the decomposition were asked for");
            let better = (0..HALVINGS).find_map(|halving| {
                let trial = &y - &step * 0.5_f64.powi(halving);
                let left = self.left(&trial, wanted);
                (left.left.norm() < now.left.norm()).then_some((trial, left))
            });
            match better {
                Some((trial, left)) => (y, now) = (trial, left),
                // What rounding leaves is found when no step gains any more.
                None if now.left.amax() <= TOLERANCE * now.size => return Ok(y),
                None => return Err(self.lost(&now, iteration)),
            }
        }
        if now.left.amax() <= TOLERANCE * now.size { Ok(y) } else { Err(self.lost(&now, ITERATIONS)) }
    }

    /// Why no motion was found: the equation that is left unbalanced most.
    fn lost(&self, now: &Left, iterations: usize) -> Error {
        let nx = self.system.states();
        let mean = |r: usize| now.left.iter().skip(r).step_by(nx).sum::<f64>() / self.n as f64;
        let most = |r: &usize| now.left.iter().skip(*r).step_by(nx).fold(0.0_f64, |m, v| m.max(v.abs()));
        let worst = (0..nx).max_by(|a, b| most(a).total_cmp(&most(b))).unwrap_or(0);
        let name = self.system.state_name(worst);
        let advice = format!(
            "the equation of `{name}` is left with up to {:.2e} (mean {:.2e}) of rates up to {:.2e}: no periodic motion with \
             this `{}` was found near the start. Prescribe a smaller amplitude or another offset, start nearer to the motion \
             (start), or take more harmonics",
            most(&worst),
            mean(worst),
            now.size,
            self.system.state_name(self.coordinate),
        );
        let residual = now.left.amax() / now.size;
        Error::NoConvergence { method: "harmonic balance of the reference".into(), iterations, residual, advice }
    }
}
