//! The cycle average: the periodic orbit of an unclocked recording, phase by phase, with two honest bands.
//!
//! Every good cycle is read at the same phases and averaged. The spread says how far single cycles lie from the average;
//! the standard error says how well the average itself is known. Cycles of one run resemble each other more than cycles
//! of two, so that the standard error counts runs (groups), not cycles: with 12 runs of five cycles there are 12
//! independent looks at the orbit, not 60. No value is carried across an event, where velocities jump.
//!
//! References: S. Revzen and J. M. Guckenheimer, Phys. Rev. E 78 (2008) 051907; S.-Y. Liang and S. L. Zeger,
//! Biometrika 73 (1986) 13-22 (standard errors from independent groups).

use super::phase::{Phase, Segment, samples_of};
use crate::error::{Error, Result};
use crate::numeric::stats;
use crate::signal::Recording;

/// The orbit at `m` phases in `c` channels; arrays are row-major (m, c).
#[derive(Clone, Debug, PartialEq)]
pub struct CycleAverage {
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Phases (m), at the middles of equal bins of [0, 1).
    pub phase: Vec<f64>,
    /// Mean over the groups of the means of their cycles, in the channels' units.
    pub mean: Vec<f64>,
    /// Standard deviation of single cycles around the mean.
    pub spread: Vec<f64>,
    /// Standard deviation of single cycles around the mean of their own group; NaN where no group has two cycles.
    pub within: Vec<f64>,
    /// Standard error of the mean, from the scatter of the groups.
    pub standard_error: Vec<f64>,
    /// Number of cycles averaged.
    pub cycles: usize,
    /// Number of groups: runs, or stretches of one run.
    pub groups: usize,
}

/// Averages `channels` (inputs or outputs) of the good cycles at `points` phases.
///
/// # Errors
/// `UnknownName`, `OutOfRange` for fewer than two points.
pub fn cycle_average(recording: &Recording, phase: &Phase, channels: &[String], points: usize) -> Result<CycleAverage> {
    if points < 2 {
        let expected = "at least 2 phases; 100 draw well".into();
        return Err(Error::OutOfRange { what: "points".into(), found: points as f64, expected });
    }
    let grid: Vec<f64> = (0..points).map(|i| (i as f64 + 0.5) / points as f64).collect();
    let (of_cycle, groups) = phase.groups();
    let width = channels.len();
    let empty = || vec![f64::NAN; points * width];
    let mut average = CycleAverage {
        channels: channels.to_vec(),
        phase: grid.clone(),
        mean: empty(),
        spread: empty(),
        within: empty(),
        standard_error: empty(),
        cycles: phase.good(),
        groups,
    };
    for (column, name) in channels.iter().enumerate() {
        let cycles = resampled(recording, phase, &samples_of(recording, name)?, &grid);
        for i in 0..points {
            let mut members: Vec<Vec<f64>> = vec![Vec::new(); groups];
            for (cycle, values) in cycles.iter().filter(|(_, values)| !values[i].is_nan()) {
                of_cycle[*cycle].into_iter().for_each(|g| members[g].push(values[i]));
            }
            let means: Vec<f64> = members.iter().map(|m| stats::mean(m.iter().copied())).collect();
            let mean = stats::mean(means.iter().copied());
            let residuals = members.iter().zip(&means).flat_map(|(m, centre)| m.iter().map(move |v| v - centre));
            let squares: f64 = residuals.map(|r| r * r).sum();
            let freedom: f64 = members.iter().map(|m| (m.len() as f64 - 1.0).max(0.0)).sum();
            let independent = means.iter().filter(|m| !m.is_nan()).count() as f64;
            let at = i * width + column;
            average.mean[at] = mean;
            average.spread[at] = stats::rms(cycles.iter().map(|(_, v)| v[i] - mean));
            average.within[at] = (squares / freedom).sqrt();
            average.standard_error[at] = stats::std(means) / (independent - 1.0).sqrt();
        }
    }
    Ok(average)
}

/// Each good cycle (its index) at the phases of `grid`; NaN where a segment has fewer than two samples.
pub(super) fn resampled(recording: &Recording, phase: &Phase, samples: &[f64], grid: &[f64]) -> Vec<(usize, Vec<f64>)> {
    let mut cycles: Vec<(usize, Vec<f64>)> = Vec::new();
    for segment in phase.segments() {
        if segment.part == 0 {
            cycles.push((segment.cycle, vec![f64::NAN; grid.len()]));
        }
        let Some((_, values)) = cycles.last_mut() else { continue };
        for (value, phi) in values.iter_mut().zip(grid) {
            if (segment.phases.0..segment.phases.1).contains(phi) {
                *value = read(recording, segment, samples, *phi);
            }
        }
    }
    cycles
}

/// The segment's samples at one phase: linear between them, and on to the events beyond the first and the last.
fn read(recording: &Recording, segment: &Segment, samples: &[f64], phi: f64) -> f64 {
    let rows = segment.rows(recording.t());
    if rows.len() < 2 {
        return f64::NAN;
    }
    let share = (phi - segment.phases.0) / (segment.phases.1 - segment.phases.0);
    let time = segment.times.0 + share * (segment.times.1 - segment.times.0);
    let place = (time - recording.t()[rows.start]) / recording.dt();
    let low = (place.floor().max(0.0) as usize).min(rows.len() - 2);
    let (a, b) = (samples[rows.start + low], samples[rows.start + low + 1]);
    a + (place - low as f64) * (b - a)
}

#[cfg(test)]
#[path = "orbit_tests.rs"]
mod tests;
