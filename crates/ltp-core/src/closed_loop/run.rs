//! A closed loop simulated from a deviation: when it settles, how far it strays, what the feedback asks of the inputs.

use crate::error::Result;
use crate::feedforward::Reference;
use crate::model::System;
use crate::numeric::fourier_series::FourierSeries;
use crate::simulate::{Inputs, Plan, simulate};

/// Error as a share of the reference's amplitude within which a state counts as settled.
pub const SETTLED: f64 = 0.02;
/// Samples in one period.
pub(super) const SAMPLES: usize = 100;
/// A closed loop that turns by less than this in one integration step is resolved, rad.
const TURN: f64 = 0.2;

/// A closed loop simulated from a deviation.
#[derive(Clone, Debug)]
pub struct Run {
    /// Deviation (nx) from the reference at the start.
    pub deviation: Vec<f64>,
    /// Time simulated, s.
    pub horizon: f64,
    /// Per state, the last time (s) at which its error is larger than 2 % of the reference's amplitude; `None` where it still
    /// is in the last period.
    pub settled: Vec<Option<f64>>,
    /// Per state, the largest error in the last period, as a share of the reference's amplitude.
    pub steady: Vec<f64>,
    /// Per input, the largest `|K (z - z_ref)|`.
    pub feedback: Vec<f64>,
    /// Largest distance from the closed loop's orbit, as a multiple of the one at the start; both in amplitudes.
    pub growth: f64,
    /// Whether the motion comes back to the closed loop's orbit, or was still approaching it at the end.
    pub returns: bool,
    /// Why the simulation ended early; `None` where it did not.
    pub ended: Option<String>,
}

/// A closed loop with what its runs are measured against.
pub(super) struct Loop<'a> {
    /// The closed system.
    pub system: &'a dyn System,
    pub p: &'a [f64],
    pub reference: &'a Reference,
    pub gain: &'a FourierSeries,
    /// The orbit to come back to; the reference where `None`.
    pub orbit: Option<&'a FourierSeries>,
    /// Fastest exponent of the loop, rad/s.
    pub fastest: f64,
}

/// Amplitudes of the reference's states; one where a state rests.
pub(super) fn shares(reference: &Reference) -> Vec<f64> {
    reference.amplitudes().into_iter().map(|a| if a > 0.0 { a } else { 1.0 }).collect()
}

/// Integration steps from sample to sample that resolve a loop, `dt` (s) apart.
pub(super) fn substeps(dt: f64, fastest: f64) -> u64 {
    ((dt * fastest / TURN).ceil() as u64).clamp(2, 1000)
}

/// `K(t) (z - z_ref)` (nu).
pub(super) fn feedback(gain: &[f64], x: &[f64], wanted: &[f64]) -> Vec<f64> {
    let entry = |row: &[f64]| row.iter().zip(x.iter().zip(wanted)).map(|(k, (x, w))| k * (x - w)).sum();
    gain.chunks_exact(x.len()).map(entry).collect()
}

impl Loop<'_> {
    /// A run over about `horizon` seconds, whole periods of it.
    pub fn run(&self, deviation: &[f64], horizon: f64) -> Result<Run> {
        let (period, nx) = (self.reference.period(), deviation.len());
        let periods = (horizon / period).ceil().max(4.0) as usize;
        let dt = period / SAMPLES as f64;
        let start: Vec<f64> = self.reference.states.value(0.0).iter().zip(deviation).map(|(z, d)| z + d).collect();
        let mut plan = Plan::new(period, dt)?.from(&start);
        plan.samples = periods * SAMPLES + 1;
        plan.substeps = substeps(dt, self.fastest);
        let inputs = Inputs::constant(&vec![0.0; self.system.inputs()]);
        let run = simulate(self.system, self.p, &inputs, &plan)?;
        let table = |series: &FourierSeries| series.samples(SAMPLES);
        let (wanted, gains) = (table(&self.reference.states), table(self.gain));
        let orbit = self.orbit.map_or_else(|| wanted.clone(), table);
        let amplitudes = shares(self.reference);
        let n = run.t.len();
        let mut settled = vec![Some(0.0); nx];
        let mut steady = vec![0.0_f64; nx];
        let mut asked = vec![0.0_f64; self.gain.rows() / nx];
        let mut distance = Vec::with_capacity(n);
        for (i, x) in run.states.chunks_exact(nx).enumerate() {
            let at = i % SAMPLES;
            let wanted = &wanted[at * nx..][..nx];
            let last = i + SAMPLES >= plan.samples;
            for r in 0..nx {
                let error = (x[r] - wanted[r]).abs() / amplitudes[r];
                if error > SETTLED {
                    settled[r] = (!last).then_some(run.t[i]);
                }
                if last {
                    steady[r] = steady[r].max(error);
                }
            }
            let gain = &gains[at * self.gain.rows()..][..self.gain.rows()];
            for (most, u) in asked.iter_mut().zip(feedback(gain, x, wanted)) {
                *most = most.max(u.abs());
            }
            let near = &orbit[at * nx..][..nx];
            distance.push((0..nx).map(|r| (x[r] - near[r]).abs() / amplitudes[r]).fold(0.0, f64::max));
        }
        let ended = (!run.stop.is_finished()).then(|| run.stop.sentence());
        if ended.is_some() {
            settled.fill(None);
            steady.fill(f64::INFINITY);
        }
        let largest = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
        let first = distance.first().copied().unwrap_or(0.0);
        let growth = if first > 0.0 { largest(&distance) / first } else { 1.0 };
        let quarter = (periods / 4).max(1) * SAMPLES;
        let returns = ended.is_none() && {
            let (late, before) = (&distance[n - quarter..], &distance[n - 2 * quarter..n - quarter]);
            largest(&distance[n - SAMPLES..]) <= SETTLED || largest(late) < largest(before)
        };
        let horizon = periods as f64 * period;
        Ok(Run { deviation: deviation.to_vec(), horizon, settled, steady, feedback: asked, growth, returns, ended })
    }
}
