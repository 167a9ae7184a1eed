//! Newton's method on the period map, through events: single and multiple shooting, known and unknown period.
//!
//! The derivative of the map is the monodromy matrix with the saltation of every event, which the engine carries along.
//! Single shooting solves `phi_T(x) = x`; multiple shooting cuts the period into `m` arcs, which tames orbits whose
//! perturbations grow by orders of magnitude within one period. Where the period is unknown, it joins the unknowns, and the
//! start may not move along the flow.
//!
//! References: R. Seydel, *Practical Bifurcation and Stability Analysis*, 3rd ed., sections 7.3 to 7.5; H. B. Keller,
//! *Numerical Methods for Two-Point Boundary-Value Problems*, chapter 2.

use nalgebra::{DMatrix, DVector};

use crate::model::{Point, System};
use crate::simulate::engine::{Engine, Settings};
use crate::simulate::{Event, Inputs, Stop};

/// Steps that halve without success end the search.
const HALVINGS: i32 = 10;
/// Closure, relative to the size of the orbit, at which Newton's method has nothing left to gain.
const CLOSED: f64 = 1e-13;
/// Directions in which the period map minus identity is this flat, relative to its steepest, are left alone.
const SINGULAR: f64 = 1e-11;

/// A system with everything that its flow needs.
pub(super) struct Flow<'a> {
    pub system: &'a dyn System,
    pub p: &'a [f64],
    pub inputs: &'a Inputs,
    /// Integration steps in one period.
    pub steps: u64,
}

/// Where a motion has arrived.
pub(super) struct Arrival {
    pub x: Vec<f64>,
    pub mode: usize,
    /// d(x)/d(x at the start) (nx, nx); empty where not asked for.
    pub slope: Vec<f64>,
    pub events: Vec<Event>,
}

impl Flow<'_> {
    /// The motion from `x` at `t` over the time `span`, which is the fraction `share` of a period.
    pub fn go(&self, t: f64, span: f64, share: f64, x: &[f64], mode: usize, slope: bool) -> Result<Arrival, Stop> {
        let steps = ((self.steps as f64 * share).ceil() as u64).max(1);
        let settings =
            Settings { t0: t, step: span / steps as f64, max_steps: 100 * steps + 10_000, derivatives: slope };
        let mut engine = Engine::new(self.system, self.p, self.inputs, x, mode, settings)?;
        engine.advance(steps)?;
        let (nx, ns) = (x.len(), x.len() + self.system.free().len());
        let s = engine.sensitivities();
        let slope = if slope { (0..nx * nx).map(|i| s[i / nx * ns + i % nx]).collect() } else { Vec::new() };
        Ok(Arrival { x: engine.state().to_vec(), mode: engine.mode(), slope, events: engine.events().to_vec() })
    }

    /// Rates at a state.
    pub fn rates(&self, t: f64, x: &[f64], mode: usize) -> Vec<f64> {
        let mut u = vec![0.0; self.inputs.count()];
        self.inputs.eval(self.inputs.interval(t), t, &mut u);
        let mut rates = vec![0.0; x.len()];
        self.system.flow(mode, Point { t, x, u: &u, p: self.p }, &mut rates);
        rates
    }
}

/// What is sought and where the search stands: states at the arcs' starts, their modes, the period.
#[derive(Clone)]
pub(super) struct Orbit {
    pub t0: f64,
    pub period: f64,
    /// Whether the period is unknown.
    pub free: bool,
    pub starts: Vec<Vec<f64>>,
    pub modes: Vec<usize>,
}

/// How a search ended.
pub(super) struct Found {
    pub orbit: Orbit,
    pub iterations: usize,
    /// Largest gap of the closed orbit, relative to `scale`.
    pub residual: f64,
}

/// Why it did not.
pub(super) struct Lost {
    pub iterations: usize,
    pub residual: f64,
    pub why: String,
}

/// Residuals of all arcs and, where asked for, their derivatives.
struct Gaps {
    gaps: Vec<f64>,
    slopes: Vec<Vec<f64>>,
    /// Rates at the arcs' ends.
    rates: Vec<Vec<f64>>,
    size: f64,
}

/// Newton's method with step halving from an initial guess; `scale` (nx) are the sizes of the states.
pub(super) fn newton(flow: &Flow<'_>, guess: Orbit, scale: &[f64], most: usize, tolerance: f64) -> Result<Found, Lost> {
    let lost = |iterations, residual, why: String| Lost { iterations, residual, why };
    let mut orbit = guess;
    let mut now = gaps(flow, &orbit, scale, true).map_err(|why| lost(0, f64::INFINITY, why))?;
    for iteration in 0..most {
        if now.size <= CLOSED {
            return Ok(Found { orbit, iterations: iteration, residual: now.size });
        }
        let step = step(flow, &orbit, &now, scale);
        let mut why = String::new();
        let better = (0..HALVINGS).find_map(|halving| {
            let trial = moved(&orbit, &step, 0.5_f64.powi(halving));
            match gaps(flow, &trial, scale, true) {
                Ok(g) if g.size < now.size => Some((trial, g)),
                Ok(_) => None,
                Err(reason) => {
                    why = reason;
                    None
                }
            }
        });
        match better {
            Some((trial, g)) => (orbit, now) = (trial, g),
            // What rounding leaves is found when no step gains any more.
            None if now.size <= tolerance => return Ok(Found { orbit, iterations: iteration, residual: now.size }),
            None => {
                let why = if why.is_empty() {
                    "no step along Newton's direction closes the orbit further".into()
                } else {
                    why
                };
                return Err(lost(iteration, now.size, why));
            }
        }
    }
    if now.size <= tolerance {
        return Ok(Found { orbit, iterations: most, residual: now.size });
    }
    Err(lost(most, now.size, "the iterations were used up".into()))
}

fn gaps(flow: &Flow<'_>, orbit: &Orbit, scale: &[f64], slope: bool) -> Result<Gaps, String> {
    let arcs = orbit.starts.len();
    let span = orbit.period / arcs as f64;
    let mut out = Gaps { gaps: Vec::new(), slopes: Vec::new(), rates: Vec::new(), size: 0.0 };
    for j in 0..arcs {
        let t = orbit.t0 + j as f64 * span;
        let end = flow
            .go(t, span, 1.0 / arcs as f64, &orbit.starts[j], orbit.modes[j], slope)
            .map_err(|stop| stop.sentence())?;
        let next = (j + 1) % arcs;
        if end.mode != orbit.modes[next] {
            let name = |mode| flow.system.mode_name(mode);
            return Err(format!(
                "after one period the mode is `{}` instead of `{}`",
                name(end.mode),
                name(orbit.modes[next])
            ));
        }
        for (i, (a, b)) in end.x.iter().zip(&orbit.starts[next]).enumerate() {
            out.gaps.push(a - b);
            out.size = out.size.max((a - b).abs() / scale[i]);
        }
        if orbit.free {
            out.rates.push(flow.rates(t + span, &end.x, end.mode));
        }
        out.slopes.push(end.slope);
    }
    if out.size.is_finite() { Ok(out) } else { Err("the motion left the finite numbers".into()) }
}

/// Newton's step: changes of all starts, then of the period. The shortest one, measured by `scale`, where the derivative is
/// singular: a coordinate that no mode of the orbit moves stays where it is.
fn step(flow: &Flow<'_>, orbit: &Orbit, now: &Gaps, scale: &[f64]) -> Vec<f64> {
    let (arcs, nx) = (orbit.starts.len(), scale.len());
    let n = arcs * nx + usize::from(orbit.free);
    let mut matrix = DMatrix::<f64>::zeros(n, n);
    let mut right = DVector::<f64>::zeros(n);
    for j in 0..arcs {
        let next = (j + 1) % arcs;
        for r in 0..nx {
            for c in 0..nx {
                matrix[(j * nx + r, j * nx + c)] += now.slopes[j][r * nx + c] * scale[c] / scale[r];
            }
            matrix[(j * nx + r, next * nx + r)] -= 1.0;
            right[j * nx + r] = -now.gaps[j * nx + r] / scale[r];
            if orbit.free {
                matrix[(j * nx + r, n - 1)] = now.rates[j][r] / scale[r] * orbit.period / arcs as f64;
            }
        }
    }
    if orbit.free {
        for (c, rate) in flow.rates(orbit.t0, &orbit.starts[0], orbit.modes[0]).into_iter().enumerate() {
            matrix[(n - 1, c)] = rate / scale[c] * orbit.period;
        }
    }
    let svd = matrix.svd(true, true);
    let cut = SINGULAR * svd.singular_values.max();
    let step = svd.solve(&right, cut).expect("both sides of the decomposition were asked for");
    let unit = |i: usize| if i == arcs * nx { orbit.period } else { scale[i % nx] };
    step.iter().enumerate().map(|(i, v)| v * unit(i)).collect()
}

fn moved(orbit: &Orbit, step: &[f64], factor: f64) -> Orbit {
    let mut out = orbit.clone();
    let nx = out.starts[0].len();
    for (j, start) in out.starts.iter_mut().enumerate() {
        for (i, x) in start.iter_mut().enumerate() {
            *x += factor * step[j * nx + i];
        }
    }
    if orbit.free {
        out.period += factor * step[step.len() - 1];
    }
    out
}
