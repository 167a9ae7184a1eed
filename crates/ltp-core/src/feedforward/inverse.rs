//! The input that explains a given motion best.
//!
//! A motion that is no orbit leaves forces unbalanced whatever the input. Of all inputs the one is taken that makes their sum
//! of squares least, in the equations as the model states them: with the mass matrix `M` the residual is `M (v' - f_v)`, so
//! that an input which acts in one equation balances that one, and leaves the others as they are.

use super::{index, instants};
use crate::error::{Error, Result};
use crate::model::system::without_past;
use crate::model::{Compiled, Definition, Model, Point, System};
use crate::numeric::fourier_series::FourierSeries;

/// Iterations of the Gauss-Newton method; one is enough where the input acts linearly.
const ITERATIONS: usize = 30;

/// All inputs (nu) over one period, of which number `input` is solved and the others are constant.
pub(super) fn input_of(
    model: &Model,
    system: &Compiled,
    states: &FourierSeries,
    input: usize,
    held: &[f64],
) -> Result<FourierSeries> {
    let (nx, nu, ny) = (system.states(), system.inputs(), system.outputs());
    without_past(system, system.parameters(), "reference")?;
    index("input to solve for", input, nu)?;
    let held = if held.is_empty() { vec![0.0; nu] } else { held.to_vec() };
    if held.len() != nu {
        return Err(Error::Shape { what: "constant inputs".into(), expected: nu, found: held.len() });
    }
    if states.rows() != nx {
        return Err(Error::Shape { what: "rows of the reference's states".into(), expected: nx, found: states.rows() });
    }
    let mass = Mass::new(model)?;
    let (mode, p) = (system.initial_mode(), system.parameters().to_vec());
    let (n, slope) = (instants(states) | 1, states.derivative());
    let (mut rates, mut by_input) = (vec![0.0; nx], vec![0.0; (nx + ny) * nu]);
    let mut inputs = Vec::with_capacity(n * nu);
    for i in 0..n {
        let t = i as f64 * states.period() / n as f64;
        let (x, wanted) = (states.value(t), slope.value(t));
        let mut u = held.clone();
        let mut size = 0.0_f64;
        for _ in 0..ITERATIONS {
            let at = Point { t, x: &x, u: &u, p: &p };
            system.flow(mode, at, &mut rates);
            system.input_jacobian(mode, at, &mut by_input);
            let left = mass.forces(at, wanted.iter().zip(&rates).map(|(w, r)| w - r).collect());
            let acts = mass.forces(at, (0..nx).map(|r| by_input[r * nu + input]).collect());
            let square: f64 = acts.iter().map(|a| a * a).sum();
            if square == 0.0 {
                let message = format!("the input `{}` moves nothing at t = {t} s", model.inputs()[input]);
                return Err(Error::Model { path: "reference".into(), message });
            }
            let step = acts.iter().zip(&left).map(|(a, l)| a * l).sum::<f64>() / square;
            u[input] += step;
            size = size.max(u[input].abs());
            if step.abs() <= 1e-14 * size {
                break;
            }
        }
        inputs.extend_from_slice(&u);
    }
    FourierSeries::from_samples(states.period(), nu, &inputs)
}

/// The mass matrix of a model, ready to be evaluated; none where its equations are solved for the rates.
struct Mass {
    matrix: Option<(Compiled, Vec<usize>)>,
}

impl Mass {
    fn new(model: &Model) -> Result<Self> {
        let Some(mass) = &model.document().mass_matrix else { return Ok(Self { matrix: None }) };
        let mut document = model.document().clone();
        let entries = mass.matrix.iter().flatten().enumerate();
        document.outputs = entries.map(|(i, e)| (format!("mass {i}"), Definition::Plain(e.clone()))).collect();
        let place = |name: &String| model.states().iter().position(|state| state == name);
        let velocities = mass.velocities.iter().filter_map(place).collect();
        let shown = Model::new(document, model.library().clone(), model.name())?.compile();
        Ok(Self { matrix: Some((shown, velocities)) })
    }

    /// Rates (nx) as forces: those of velocities by the mass matrix.
    fn forces(&self, at: Point<'_>, mut rates: Vec<f64>) -> Vec<f64> {
        let Some((system, velocities)) = &self.matrix else { return rates };
        let n = velocities.len();
        let mut matrix = vec![0.0; n * n];
        system.output(system.initial_mode(), at, &mut matrix);
        let own: Vec<f64> = velocities.iter().map(|&v| rates[v]).collect();
        for (row, &v) in velocities.iter().enumerate() {
            rates[v] = (0..n).map(|c| matrix[row * n + c] * own[c]).sum();
        }
        rates
    }
}
