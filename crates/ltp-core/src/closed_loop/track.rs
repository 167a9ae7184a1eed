//! A motion through stages, each with its reference and gain: steps of position, amplitude and phase.

use super::close::{acted, check, close};
use super::run::{SAMPLES, SETTLED, feedback, shares, substeps};
use crate::error::{Error, Result};
use crate::feedforward::Reference;
use crate::linearize::along;
use crate::model::{Model, System};
use crate::numeric::fourier_series::FourierSeries;
use crate::simulate::{Inputs, Plan, simulate};

/// One stage of a motion: a reference, followed under a gain until a time.
#[derive(Clone, Debug)]
pub struct Stage {
    /// What to follow.
    pub reference: Reference,
    /// Gain (nu, nx), constant or of the reference's period.
    pub gain: FourierSeries,
    /// End, s.
    pub until: f64,
}

/// What came of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Start, s.
    pub from: f64,
    /// End, s.
    pub until: f64,
    /// Per state, the last time (s, from the start of the stage) at which its error is larger than 2 % of the reference's
    /// amplitude; `None` where it still is in the last period.
    pub settled: Vec<Option<f64>>,
    /// Per state, the largest error in the last period, as a share of the reference's amplitude.
    pub steady: Vec<f64>,
    /// Per input, the largest `|K (z - z_ref)|`.
    pub feedback: Vec<f64>,
}

/// A motion through stages. Matrices are row-major, one row per sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// Time (n), s.
    pub t: Vec<f64>,
    /// States (n, nx).
    pub states: Vec<f64>,
    /// What was to be followed (n, nx).
    pub references: Vec<f64>,
    /// Inputs (n, nu).
    pub inputs: Vec<f64>,
    /// One per stage.
    pub stages: Vec<Outcome>,
    /// Why the motion ended early; `None` where it did not.
    pub ended: Option<String>,
}

/// Runs through stages one after another, from the first reference with `deviation` (nx) added, at time zero. Samples lie
/// a hundredth of a period apart.
///
/// # Errors
/// What [`close`] says of a reference or gain; `Shape` for a deviation of another length, `OutOfRange` for stages that end
/// before they start, `TooShort` without stages.
pub fn track(model: &Model, stages: &[Stage], deviation: &[f64]) -> Result<Tracked> {
    let (nx, nu) = (model.states().len(), model.inputs().len());
    let Some(first) = stages.first() else {
        return Err(Error::TooShort { what: "stages".into(), needed: 1, found: 0 });
    };
    if deviation.len() != nx {
        return Err(Error::Shape { what: "deviation".into(), expected: nx, found: deviation.len() });
    }
    check(model, &first.reference, &first.gain)?;
    let mut x: Vec<f64> = first.reference.states.value(0.0).iter().zip(deviation).map(|(z, d)| z + d).collect();
    let mut out =
        Tracked { t: vec![], states: vec![], references: vec![], inputs: vec![], stages: vec![], ended: None };
    let mut from = 0.0;
    for stage in stages {
        let (reference, period) = (&stage.reference, stage.reference.period());
        let count = (stage.until - from) / (period / SAMPLES as f64);
        if !(1.0..1e8).contains(&count) {
            let expected = format!("a time after {from} s, where the stage begins");
            return Err(Error::OutOfRange { what: "until".into(), found: stage.until, expected });
        }
        let count = count.round().max(1.0) as usize;
        let dt = (stage.until - from) / count as f64;
        let system = close(model, reference, &stage.gain)?.compile();
        let p = system.parameters().to_vec();
        let rest = FourierSeries::constant(period, &vec![0.0; system.inputs().max(1)])?;
        let linear = along(&system, &p, system.initial_mode(), &reference.states, &rest)?;
        let rates = linear.exponents()?;
        let fastest = rates.iter().fold(linear.pumping(), |m, e| m.max(e.norm()));
        let mut plan = Plan::new(dt, dt)?.from(&x);
        (plan.t0, plan.samples, plan.substeps) = (from, count + 1, substeps(dt, fastest));
        let run = simulate(&system, &p, &Inputs::constant(&vec![0.0; system.inputs()]), &plan)?;
        let ny = system.outputs();
        let moved = acted(model, reference, &stage.gain);
        let window = stage.until - period;
        let amplitudes = shares(reference);
        let mut outcome = Outcome {
            from,
            until: stage.until,
            settled: vec![Some(0.0); nx],
            steady: vec![0.0; nx],
            feedback: vec![0.0; nu],
        };
        for (i, state) in run.states.chunks_exact(nx).enumerate() {
            let t = run.t[i];
            let wanted = reference.states.value(t);
            for r in 0..nx {
                let error = (state[r] - wanted[r]).abs() / amplitudes[r];
                if error > SETTLED {
                    outcome.settled[r] = (t < window).then_some(t - from);
                }
                if t >= window {
                    outcome.steady[r] = outcome.steady[r].max(error);
                }
            }
            for (most, u) in outcome.feedback.iter_mut().zip(feedback(&stage.gain.value(t), state, &wanted)) {
                *most = most.max(u.abs());
            }
            // The end of a stage is shown as the start of the next one.
            if i < count || stage.until == stages[stages.len() - 1].until {
                out.t.push(t);
                out.states.extend_from_slice(state);
                out.references.extend_from_slice(&wanted);
                let mut inputs = vec![0.0; nu];
                for (k, (input, _)) in moved.iter().enumerate() {
                    inputs[*input] = run.outputs[i * ny + ny - moved.len() + k];
                }
                out.inputs.extend_from_slice(&inputs);
            }
        }
        if !run.stop.is_finished() {
            outcome.settled.fill(None);
            outcome.steady.fill(f64::INFINITY);
            out.stages.push(outcome);
            out.ended = Some(run.stop.sentence());
            break;
        }
        out.stages.push(outcome);
        x.copy_from_slice(&run.states[count * nx..]);
        from = stage.until;
    }
    Ok(out)
}
