//! What a periodic ARX model is worth: free run on groups of cycles that it did not see, beside predictions that need no model.
//!
//! Groups (runs, or stretches of one run) are left out one after the other; each of their segments is predicted in free
//! run by the fit to all others. Beside it stand the mean orbit of the other groups, and the same segment one
//! cycle before. Both are read at the interpolated phase, which knows when the segment will end: the comparison favours
//! them. A model that does not beat them says nothing about the machine that an average would not.
//!
//! Reference: T. Hastie, R. Tibshirani and J. Friedman, *The Elements of Statistical Learning*, 2nd ed., section 7.10.

use super::arx::{Options, Parts};
use super::orbit::resampled;
use super::phase::Phase;
use crate::error::{Error, Result};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;
use crate::signal::Recording;

/// Mean squared errors, segment by segment; arrays are row-major (segments, ny), in squared output units.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Group of each scored segment.
    pub group: Vec<usize>,
    /// Number of groups.
    pub groups: usize,
    /// Free run of the model, fitted to the other groups.
    pub model: Vec<f64>,
    /// Mean orbit of the other groups.
    pub orbit: Vec<f64>,
    /// The same segment one cycle before; NaN where there is none.
    pub previous: Vec<f64>,
    /// The free runs (n, ny) in the order of the recording, NaN where nothing is predicted.
    pub prediction: Vec<f64>,
}

/// Scores `options` by leaving out one group of cycles after the other.
///
/// # Errors
/// As [`super::arx::identify_arx`], for the data that remain when a group is left out.
pub fn held_out(recording: &Recording, phase: &Phase, options: &Options) -> Result<HeldOut> {
    let parts = Parts::new(recording, phase, options)?;
    let channels = parts.channels();
    let (of_cycle, groups) = phase.groups();
    let ny = options.outputs.len();
    let mut prediction = vec![f64::NAN; recording.len() * ny];
    for group in 0..groups {
        let model = parts.fit(recording, phase, Some(group))?;
        let inside = phase.segments().iter().filter(|s| of_cycle[s.cycle] == Some(group));
        inside.for_each(|segment| model.run(recording, channels, segment, &mut prediction));
    }
    let mut before = vec![None; phase.cycles().len()];
    phase.successors().iter().enumerate().for_each(|(i, next)| next.iter().for_each(|next| before[*next] = Some(i)));
    let mut score = HeldOut {
        outputs: options.outputs.clone(),
        group: Vec::new(),
        groups,
        model: Vec::new(),
        orbit: Vec::new(),
        previous: Vec::new(),
        prediction,
    };
    for segment in phase.segments() {
        let range = segment.rows(recording.t());
        let rows = range.start + options.start_up()..range.end;
        let Some(group) = of_cycle[segment.cycle].filter(|_| !rows.is_empty()) else { continue };
        score.group.push(group);
        let grid: Vec<f64> = rows.clone().map(|i| segment.interpolated(recording.t()[i])).collect();
        for (j, y) in channels.outputs.iter().enumerate() {
            let cycles = resampled(recording, phase, y, &grid);
            let means: Vec<Vec<f64>> = (0..groups)
                .filter(|g| *g != group)
                .map(|g| {
                    mean_of(
                        cycles.iter().filter(|(c, _)| of_cycle[*c] == Some(g)).map(|(_, v)| v.as_slice()),
                        grid.len(),
                    )
                })
                .collect();
            let orbit = mean_of(means.iter().map(Vec::as_slice), grid.len());
            let error = |f: &dyn Fn(usize) -> f64| {
                stats::mean(rows.clone().enumerate().map(|(k, i)| {
                    let e = y[i] - f(k);
                    e * e
                }))
            };
            score.model.push(error(&|k| score.prediction[(rows.start + k) * ny + j]));
            score.orbit.push(error(&|k| orbit[k]));
            let last = before[segment.cycle].and_then(|b| cycles.iter().find(|(c, _)| *c == b));
            score.previous.push(last.map_or(f64::NAN, |(_, v)| error(&|k| v[k])));
        }
    }
    Ok(score)
}

/// Mean of rows of equal length, NaN left out.
fn mean_of<'a>(rows: impl Iterator<Item = &'a [f64]>, length: usize) -> Vec<f64> {
    let rows: Vec<&[f64]> = rows.collect();
    (0..length).map(|i| stats::mean(rows.iter().map(|r| r[i]))).collect()
}

/// How many times larger one root mean square error is than another, with a 95 % interval over the groups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// rms of the first over rms of the second.
    pub value: f64,
    /// 2.5 % and 97.5 % quantiles over draws of groups.
    pub interval: (f64, f64),
}

impl HeldOut {
    /// Root mean square of the segments' errors (`self.model`, `self.orbit`, ...) in output `j`, each segment counting the same.
    pub fn rms(&self, errors: &[f64], j: usize) -> f64 {
        stats::mean(errors.iter().skip(j).step_by(self.outputs.len()).copied()).sqrt()
    }

    /// The same by group (groups).
    pub fn rms_by_group(&self, errors: &[f64], j: usize) -> Vec<f64> {
        let of = |g: usize| self.group.iter().enumerate().filter(move |(_, found)| **found == g);
        let value = |g: usize| stats::mean(of(g).map(|(s, _)| errors[s * self.outputs.len() + j])).sqrt();
        (0..self.groups).map(value).collect()
    }

    /// rms of `self.model` over rms of `errors` (of `self`, or the model of another score on the same segments) in output `j`,
    /// over the segments where both exist, with an interval from drawing groups with replacement.
    ///
    /// An interval below 1 says that the model predicts groups which it did not see better than the rival does.
    ///
    /// # Errors
    /// `Shape` when `errors` is not one value per segment and output.
    pub fn ratio(&self, errors: &[f64], j: usize, draws: usize, seed: u64) -> Result<Ratio> {
        if errors.len() != self.model.len() {
            let what = "errors of the rival, segments*ny".into();
            return Err(Error::Shape { what, expected: self.model.len(), found: errors.len() });
        }
        let mut sums = vec![(0.0, 0.0); self.groups];
        for (s, group) in self.group.iter().enumerate() {
            let (own, rival) = (self.model[s * self.outputs.len() + j], errors[s * self.outputs.len() + j]);
            if !(own.is_nan() || rival.is_nan()) {
                sums[*group].0 += own;
                sums[*group].1 += rival;
            }
        }
        Ok(ratio_of(&sums, draws, seed))
    }
}

/// Ratio of the roots of two sums over groups, with its interval.
pub(super) fn ratio_of(sums: &[(f64, f64)], draws: usize, seed: u64) -> Ratio {
    let ratio = |chosen: &mut dyn Iterator<Item = usize>| {
        let (a, b) = chosen.fold((0.0, 0.0), |(a, b), g| (a + sums[g].0, b + sums[g].1));
        (a / b).sqrt()
    };
    let mut random = SplitMix64::new(seed);
    let drawn: Vec<f64> = (0..draws).map(|_| ratio(&mut (0..sums.len()).map(|_| random.below(sums.len())))).collect();
    let interval = (stats::quantile(&drawn, 0.025), stats::quantile(&drawn, 0.975));
    Ratio { value: ratio(&mut (0..sums.len())), interval }
}

#[cfg(test)]
#[path = "held_out_tests.rs"]
mod tests;
