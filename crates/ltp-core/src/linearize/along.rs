//! The linear time-periodic system of a model along a reference that need not be an orbit.
//!
//! Deviations `d` from a reference `z` under its inputs `u` obey `d' = A(t) d + B(t) du - (z' - f(z, u))`: the matrices are the
//! derivatives of flow and outputs on the reference, and what the reference lacks of an orbit is a forcing, which neither
//! exponents nor transfer functions see. So the thesis linearises around fitted sinusoids (Duyul 2018, eqs 3.10-3.12).

use super::{RESOLVED, SMALLEST};
use crate::error::{Error, Result};
use crate::model::system::without_past;
use crate::model::{Point, System};
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;
use crate::periodic::system::{LtpSystem, NODES, Segment, Size};

/// An entry this much smaller than the largest of its matrix need not be resolved to its own rounding.
const SMALL: f64 = 1e-4;

/// Linearizes a system in one mode along `states` (nx) under `inputs` (nu), from its inputs to its outputs.
///
/// # Errors
/// `Shape` for rows that do not fit the system, `OutOfRange` for two periods, `NotFinite` where the derivatives do not exist,
/// `NoConvergence` where they are not smooth.
pub fn along(
    system: &dyn System,
    p: &[f64],
    mode: usize,
    states: &FourierSeries,
    inputs: &FourierSeries,
) -> Result<LtpSystem> {
    let size = Size { nx: system.states(), nu: system.inputs(), ny: system.outputs() };
    without_past(system, p, "linearize")?;
    let rows = [("rows of the states", size.nx, states), ("rows of the inputs", size.nu, inputs)];
    for (what, expected, series) in rows {
        // A system without inputs has a series of one row that nothing reads.
        if series.rows() != expected && expected > 0 {
            return Err(Error::Shape { what: what.into(), expected, found: series.rows() });
        }
    }
    let period = states.period();
    if (inputs.period() - period).abs() > 1e-9 * period {
        let expected = format!("{period} s, that of the states");
        return Err(Error::OutOfRange { what: "period of the inputs".into(), found: inputs.period(), expected });
    }
    let gauss = Gauss::new(NODES);
    let (mut t, mut h) = (0.0, period / 16.0);
    let mut segments = Vec::new();
    while period - t > 1e-13 * period {
        let left = period - t;
        let step = if left <= h { left } else { h.min(0.5 * left) };
        let (segment, worst) = segment(system, p, mode, states, inputs, &gauss, t, step);
        if worst <= RESOLVED {
            t = if step == left { period } else { t + step };
            segments.push(Segment { end: t, ..segment });
            h = if worst < 1e-3 * RESOLVED { (1.5 * step).min(period / 8.0) } else { step };
        } else if step > SMALLEST * period {
            h = 0.5 * step;
        } else {
            let advice = format!(
                "in mode `{}` at t = {t:.9} s the derivatives along the reference are not smooth: a kink inside a mode (abs, \
                 sign, min, max, a table) has to become an event of its own",
                system.mode_name(mode)
            );
            let method = "linearization along the reference".into();
            return Err(Error::NoConvergence { method, iterations: segments.len(), residual: worst, advice });
        }
    }
    LtpSystem::new(period, 0.0, size, segments)
}

/// One segment, and how far its entries are from what the nodes resolve; entries that are not finite count as resolved, for
/// the system to refuse them.
#[expect(clippy::too_many_arguments, reason = "one call, from the loop above")]
fn segment(
    system: &dyn System,
    p: &[f64],
    mode: usize,
    states: &FourierSeries,
    inputs: &FourierSeries,
    gauss: &Gauss,
    start: f64,
    h: f64,
) -> (Segment, f64) {
    let (nx, nu, ny, nf) = (system.states(), system.inputs(), system.outputs(), system.free().len());
    let mut out = Segment { start, end: start + h, a: vec![], b: vec![], c: vec![], d: vec![], jumps: vec![] };
    let mut by_state = vec![0.0; nx + nx * nx + nx * nf];
    let mut by_input = vec![0.0; (nx + ny) * nu];
    let mut outputs = vec![0.0; ny + ny * nx + ny * nf];
    for node in &gauss.nodes {
        let t = start + node * h;
        let (x, mut u) = (states.value(t), inputs.value(t));
        u.truncate(nu);
        let at = Point { t, x: &x, u: &u, p };
        system.flow_jacobian(mode, at, &mut by_state);
        system.input_jacobian(mode, at, &mut by_input);
        system.output_jacobian(mode, at, &mut outputs);
        out.a.extend_from_slice(&by_state[nx..nx + nx * nx]);
        out.b.extend_from_slice(&by_input[..nx * nu]);
        out.d.extend_from_slice(&by_input[nx * nu..]);
        out.c.extend_from_slice(&outputs[ny..ny + ny * nx]);
    }
    let blocks = [(&out.a, nx * nx), (&out.b, nx * nu), (&out.c, ny * nx), (&out.d, ny * nu)];
    let worst = blocks.into_iter().map(|(block, each)| unresolved(gauss, block, each)).fold(0.0, f64::max);
    (out, worst)
}

/// The largest unresolved part of a matrix (q, each), relative to its entries.
fn unresolved(gauss: &Gauss, block: &[f64], each: usize) -> f64 {
    let size = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let least = SMALL * size(block);
    let entry = |k: usize| {
        let values: Vec<f64> = block.iter().skip(k).step_by(each).copied().collect();
        let own = size(&values);
        if own > 0.0 { gauss.tail(&values) * own / own.max(least) } else { 0.0 }
    };
    (0..each).map(entry).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::{Options, cycle};
    use crate::linearize::linearize;
    use crate::model::zoo;

    #[test]
    fn along_an_orbit_it_is_the_linearization_around_it() {
        let model = zoo("duffing").expect("zoo");
        let system = model.compile();
        let p = system.parameters().to_vec();
        let orbit = cycle(&system, &p, &Options { steps: 4000, ..Options::default() }).expect("an orbit");
        let around = linearize(&system, &p, &orbit).expect("linear");
        let nx = orbit.start.len();
        let samples = &orbit.trajectory.states[..(orbit.trajectory.t.len() - 1) * nx];
        let states = FourierSeries::from_samples(orbit.period, nx, samples).expect("states");
        let inputs = FourierSeries::constant(orbit.period, &vec![0.0; system.inputs().max(1)]).expect("inputs");
        let found = along(&system, &p, orbit.mode, &states, &inputs).expect("linear");
        for (a, b) in found.monodromy().iter().zip(around.monodromy()) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }

    #[test]
    fn a_reference_of_another_period_or_shape_is_refused() {
        let system = zoo("cart_pendulum").expect("zoo").compile();
        let p = system.parameters().to_vec();
        let series = |period, rows: usize| FourierSeries::constant(period, &vec![0.0; rows]).expect("a series");
        assert!(matches!(along(&system, &p, 0, &series(1.0, 3), &series(1.0, 1)), Err(Error::Shape { .. })));
        assert!(matches!(along(&system, &p, 0, &series(1.0, 4), &series(2.0, 1)), Err(Error::OutOfRange { .. })));
        assert!(along(&system, &p, 0, &series(1.0, 4), &series(1.0, 1)).is_ok());
    }
}
