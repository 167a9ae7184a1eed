//! Rest: what outputs show where the input has long been zero, and what that says about a bias.
//!
//! A deviation from a stable orbit dies away once the input rests. What stays is not the answer to any input: a constant is a
//! bias of the sensor or of the orbit that was subtracted, something that repeats with the clock is an orbit subtracted
//! wrongly. Both are periodic outputs, and so they fall on the lines `k w_p`, where the answers to inputs at zero and at
//! multiples of the pumping frequency stand: an estimate that believes them is wrong at exactly these inputs and nowhere else
//! (Uyanik et al. 2015 see their worst errors there, for a step and near the pumping frequency).

use crate::numeric::stats;
use crate::signal::Recording;

/// Input below this share of its largest value counts as rest.
const STILL: f64 = 1e-9;
/// Periods of rest needed, of which the first half may be decay.
const PERIODS: usize = 20;
/// Standard errors beyond which a bias is believed.
const SIGNIFICANT: f64 = 5.0;
/// Share of the output's rms below which a bias is not worth a word.
const NEGLIGIBLE: f64 = 1e-3;

/// What an output shows at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Rest {
    /// Name of the recording.
    pub recording: String,
    /// Name of the output.
    pub output: String,
    /// Mean over whole periods, in the output's unit.
    pub bias: f64,
    /// Standard error of the mean, from the spread of the periods.
    pub bias_sd: f64,
    /// Rms of what repeats with the clock, the mean taken off.
    pub periodic: f64,
    /// Rms of the output over the whole recording.
    pub rms: f64,
    /// Whole periods averaged.
    pub periods: usize,
}

impl Rest {
    /// Whether the bias stands out of its own spread and matters to the output.
    pub fn is_biased(&self) -> bool {
        self.bias.abs() > SIGNIFICANT * self.bias_sd && self.bias.abs() > NEGLIGIBLE * self.rms
    }

    /// What was found and what to do, in a sentence.
    pub fn sentence(&self) -> String {
        format!(
            "recording `{}`: over {} periods in which the input rested, output `{}` keeps the mean {:.3e} +- {:.1e} ({:.2} % of \
             its rms) that no input explains: an output_bias, or an error of the orbit that was subtracted. It spoils exactly \
             the answers to a constant and to inputs at multiples of the pumping frequency; subtract it, or leave these lines \
             out (orbit = \"removed\")",
            self.recording,
            self.periods,
            self.output,
            self.bias,
            self.bias_sd,
            100.0 * self.bias.abs() / self.rms
        )
    }
}

/// What every output shows in the longest rest of each recording; nothing where the input never rests for 20 periods.
pub fn rests(recordings: &[Recording], period: f64) -> Vec<Rest> {
    recordings.iter().flat_map(|r| of_one(r, period)).collect()
}

fn of_one(recording: &Recording, period: f64) -> Vec<Rest> {
    let per_period = period / recording.dt();
    let still = longest_rest(recording);
    if (still.len() as f64) < PERIODS as f64 * per_period {
        return Vec::new();
    }
    let half = still.start + still.len() / 2;
    let periods = ((still.end - half) as f64 / per_period).floor() as usize;
    let (ny, outputs) = (recording.output_names().len(), recording.outputs());
    let one = |y: usize| {
        let column = || outputs.iter().skip(y).step_by(ny).copied();
        let rms = stats::rms(column());
        // Period by period from the end of the rest, each to the nearest sample.
        let samples: Vec<f64> = column().collect();
        let bound = |k: usize| still.end - ((periods - k) as f64 * per_period).round() as usize;
        let means: Vec<f64> =
            (0..periods).map(|k| stats::mean(samples[bound(k)..bound(k + 1)].iter().copied())).collect();
        let bias = stats::mean(means.iter().copied());
        let bias_sd = stats::std(means.iter().copied()) / (periods as f64).sqrt();
        let length = per_period.floor() as usize;
        let shape = (0..length).map(|i| stats::mean((0..periods).map(|k| samples[bound(k) + i])) - bias);
        Rest {
            recording: recording.name().to_owned(),
            output: recording.output_names()[y].clone(),
            bias,
            bias_sd,
            periodic: stats::rms(shape),
            rms,
            periods,
        }
    };
    (0..ny).map(one).collect()
}

/// The longest run of samples at which every input is still.
fn longest_rest(recording: &Recording) -> std::ops::Range<usize> {
    let (nu, inputs) = (recording.input_names().len(), recording.inputs());
    if nu == 0 {
        return 0..0;
    }
    let largest: Vec<f64> =
        (0..nu).map(|j| inputs.iter().skip(j).step_by(nu).fold(0.0_f64, |m, u| m.max(u.abs()))).collect();
    let (mut best, mut start) = (0..0, 0);
    for (i, row) in inputs.chunks_exact(nu).enumerate() {
        if row.iter().zip(&largest).any(|(u, m)| u.abs() > STILL * m) {
            start = i + 1;
        } else if i + 1 - start > best.len() {
            best = start..i + 1;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;

    /// A first-order answer to a sine that stops at half time; a bias, a periodic rest, noise.
    fn recording(bias: f64, periodic: f64, noise: f64, stop: bool) -> Recording {
        let (n, dt) = (8000, 0.01);
        let mut random = SplitMix64::new(2);
        let t: Vec<f64> = (0..n).map(|i| i as f64 * dt).collect();
        let u: Vec<f64> = t.iter().map(|t| if *t < 40.0 || !stop { (3.0 * t).sin() } else { 0.0 }).collect();
        let (mut x, mut y) = (0.0, Vec::new());
        for i in 0..n {
            y.push(x + bias + periodic * (std::f64::consts::TAU * t[i] / 0.5).cos() + noise * random.normal());
            x += dt * (u[i] - 2.0 * x);
        }
        Recording::new("run", t, vec![u], vec![y], vec!["u".into()], vec!["y".into()]).unwrap()
    }

    #[test]
    fn a_planted_bias_is_found_with_its_uncertainty() {
        let noise = 0.02;
        let found = rests(&[recording(0.005, 0.0, noise, true)], 0.5).remove(0);
        assert!(found.is_biased(), "{found:?}");
        assert!((found.bias - 0.005).abs() < 4.0 * found.bias_sd, "{found:?}");
        // 40 periods of 50 samples
        assert_eq!(found.periods, 40);
        assert!((found.bias_sd / (noise / 2000.0_f64.sqrt()) - 1.0).abs() < 0.4, "{found:?}");
        assert!(found.sentence().contains("output_bias"));
    }

    #[test]
    fn nothing_planted_nothing_claimed() {
        for noise in [0.0, 0.02] {
            let found = rests(&[recording(0.0, 0.0, noise, true)], 0.5).remove(0);
            assert!(!found.is_biased(), "{found:?}");
        }
    }

    #[test]
    fn an_orbit_left_in_the_output_is_periodic_and_no_bias() {
        let found = rests(&[recording(0.0, 0.01, 0.0, true)], 0.5).remove(0);
        assert!(!found.is_biased(), "{found:?}");
        assert!((found.periodic - 0.01 / 2.0_f64.sqrt()).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn an_input_that_never_rests_says_nothing() {
        assert!(rests(&[recording(0.005, 0.0, 0.0, false)], 0.5).is_empty());
    }
}
