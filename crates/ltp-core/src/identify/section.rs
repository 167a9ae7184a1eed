//! The section map: how a deviation from the orbit at one phase becomes the deviation one cycle later, and its multipliers.
//!
//! The state at a chosen phase of each good cycle, `z[n]`, is read from the recording (values, and rates by a local
//! parabola inside the segment), and `z[n+1] = c + A z[n] + e` is fitted to pairs of neighbouring cycles of one run. The
//! eigenvalues of `A` estimate the Floquet multipliers of the motion as it was recorded, controller and all.
//!
//! Short runs make this delicate, and the options say which error one prefers. With one intercept for all runs
//! ([`Intercept::Common`]), lasting differences between runs look like slow decay, and the multipliers are pushed towards
//! one. With an intercept per run ([`Intercept::PerRun`]), the mean of a short run follows its own noise, and
//! multipliers are pushed down by about `(1 + multiplier) / pairs per run` (Nickell). Neither is asked to be believed:
//! groups are held out, and [`SectionMap::claims`] says whether the map predicts them better than their mean and than the
//! cycle before.
//!
//! References: Y. Hürmüzlü and C. Basdogan, J. Biomech. Eng. 116 (1994) 30 (multipliers of human gait from sections);
//! Y. Wang and M. Srinivasan, Biol. Lett. 10 (2014) 20140405 (step-to-step maps of walking by regression); S. Nickell,
//! Econometrica 49 (1981) 1417 (bias of the intercept per run).

use std::ops::Range;

use nalgebra::DMatrix;

use super::held_out::{Ratio, ratio_of};
use super::phase::{Phase, samples_of};
use crate::error::{Error, Result};
use crate::numeric::rng::SplitMix64;
use crate::numeric::rows::RowQr;
use crate::numeric::{Complex, stats};
use crate::signal::Recording;

/// Share of a coordinate that is not in the others, below which it counts as following from them.
const DEPENDENT: f64 = 1e-9;

/// One coordinate of the section: a channel, or its rate of change.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinate {
    /// Name of an input or output.
    pub channel: String,
    /// Whether its time derivative is meant.
    pub rate: bool,
}

/// Whether runs share their fixed point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intercept {
    /// One for all runs.
    Common,
    /// One for each run.
    PerRun,
}

/// How the map is estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Phase of the section in [0, 1).
    pub phase: f64,
    /// Coordinates of the state there.
    pub coordinates: Vec<Coordinate>,
    /// Samples on each side of the section in the parabola that gives values and rates.
    pub window: usize,
    /// Whether runs share their fixed point.
    pub intercept: Intercept,
    /// Bootstrap draws.
    pub draws: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Options {
    /// The map of `coordinates` at `phase`: window of 5 samples, common intercept, 1000 draws.
    pub fn new(phase: f64, coordinates: Vec<Coordinate>) -> Self {
        Self { phase, coordinates, window: 5, intercept: Intercept::Common, draws: 1000, seed: 0 }
    }
}

/// An estimated section map of `d` coordinates.
#[derive(Clone, Debug)]
pub struct SectionMap {
    /// States on the section (cycles, d), row-major, NaN for bad cycles.
    pub states: Vec<f64>,
    /// The matrix `A` (d, d), row-major.
    pub matrix: Vec<f64>,
    /// Standard deviations of its entries over the draws.
    pub matrix_sd: Vec<f64>,
    /// Eigenvalues of `A`, largest magnitude first.
    pub multipliers: Vec<Complex>,
    /// 95 % interval of the magnitude of each, by rank, over the draws.
    pub magnitude: Vec<(f64, f64)>,
    /// Pairs of neighbouring cycles.
    pub pairs: usize,
    /// Groups that were drawn and held out.
    pub groups: usize,
    /// rms of held-out predictions over rms around the mean of the other groups, coordinates in units of their spread.
    pub against_mean: Ratio,
    /// rms of held-out predictions over rms around the state one cycle before.
    pub against_previous: Ratio,
    /// What is doubtful, with numbers and advice.
    pub warnings: Vec<String>,
}

impl SectionMap {
    /// Whether the held-out predictions beat both the mean and the cycle before, each with 95 % confidence.
    pub fn claims(&self) -> bool {
        self.against_mean.interval.1 < 1.0 && self.against_previous.interval.1 < 1.0
    }
}

/// Two neighbouring cycles of one run.
struct Pair {
    from: usize,
    to: usize,
    run: usize,
    group: usize,
}

/// Estimates the section map.
///
/// # Errors
/// `UnknownName`; `OutOfRange` for a phase outside [0, 1), no coordinate or a window without two samples a side;
/// `TooShort` with fewer than three pairs per unknown; `NoConvergence` when the coordinates depend on each other.
pub fn identify_map(recording: &Recording, phase: &Phase, options: &Options) -> Result<SectionMap> {
    let d = options.coordinates.len();
    let bad = |what: &str, found: f64, expected: &str| Error::OutOfRange {
        what: what.into(),
        found,
        expected: expected.into(),
    };
    if d == 0 {
        return Err(bad("coordinates", 0.0, "at least one coordinate of the section"));
    }
    if options.window < 2 {
        return Err(bad("window", options.window as f64, "at least 2 samples on each side, for a parabola"));
    }
    if !(0.0..1.0).contains(&options.phase) {
        return Err(bad("phase of the section", options.phase, "a phase in [0, 1)"));
    }
    let states = states(recording, phase, options)?;
    let state = |i: usize| &states[i * d..(i + 1) * d];
    let (of_cycle, groups) = phase.groups();
    let mut pairs = Vec::new();
    for (from, to) in phase.successors().into_iter().enumerate().filter_map(|(i, next)| Some((i, next?))) {
        let finite = state(from).iter().chain(state(to)).all(|v| v.is_finite());
        if let Some(group) = of_cycle[from].filter(|_| finite) {
            pairs.push(Pair { from, to, run: phase.cycles()[from].run, group });
        }
    }
    let mut runs: Vec<usize> = pairs.iter().map(|p| p.run).collect();
    runs.dedup();
    let intercepts = if options.intercept == Intercept::PerRun { runs.len() } else { 1 };
    if pairs.len() < 3 * (d + intercepts) {
        let what = format!(
            "pairs of neighbouring cycles of `{}` for a map of {d} coordinates and {intercepts} intercepts",
            recording.name()
        );
        return Err(Error::TooShort { what, needed: 3 * (d + intercepts), found: pairs.len() });
    }
    // Unit spread for every coordinate: the errors of all of them are then summed in one currency.
    let scale: Vec<f64> = (0..d).map(|j| stats::std(pairs.iter().map(|p| state(p.to)[j]))).collect();
    let scaled: Vec<f64> = states.iter().enumerate().map(|(i, v)| v / scale[i % d]).collect();
    let fit = |chosen: &[&Pair]| solve(chosen, &scaled, d, options.intercept);
    let singular = || Error::NoConvergence {
        method: "section map by least squares".into(),
        iterations: 1,
        residual: f64::NAN,
        advice: "the coordinates depend on each other at this phase; leave one out".into(),
    };
    let map = fit(&pairs.iter().collect::<Vec<_>>()).ok_or_else(singular)?;
    let drawn = draw(&pairs, groups, options, fit);
    let spectra: Vec<Vec<Complex>> = drawn.iter().map(eigenvalues).collect();
    let band = |rank: usize| {
        let sizes: Vec<f64> = spectra.iter().map(|s| s[rank].norm()).collect();
        (stats::quantile(&sizes, 0.025), stats::quantile(&sizes, 0.975))
    };
    let unscaled = |m: &DMatrix<f64>, i: usize, j: usize| m[(i, j)] * scale[i] / scale[j];
    let entries = || (0..d * d).map(|at| (at / d, at % d));
    let (against_mean, against_previous) = judge(&pairs, &scaled, d, groups, options);
    let multipliers = eigenvalues(&map);
    let warnings = doubts(&multipliers, pairs.len(), runs.len(), options.intercept);
    Ok(SectionMap {
        matrix: entries().map(|(i, j)| unscaled(&map, i, j)).collect(),
        matrix_sd: entries().map(|(i, j)| stats::std(drawn.iter().map(|m| unscaled(m, i, j)))).collect(),
        magnitude: (0..d).map(band).collect(),
        multipliers,
        pairs: pairs.len(),
        groups,
        against_mean,
        against_previous,
        warnings,
        states,
    })
}

/// States on the section (cycles, d): value or slope of the parabola through the samples around it, inside its segment.
fn states(recording: &Recording, phase: &Phase, options: &Options) -> Result<Vec<f64>> {
    let d = options.coordinates.len();
    let mut states = vec![f64::NAN; phase.cycles().len() * d];
    for (j, coordinate) in options.coordinates.iter().enumerate() {
        let samples = samples_of(recording, &coordinate.channel)?;
        for segment in phase.segments().iter().filter(|s| (s.phases.0..s.phases.1).contains(&options.phase)) {
            let share = (options.phase - segment.phases.0) / (segment.phases.1 - segment.phases.0);
            let time = segment.times.0 + share * (segment.times.1 - segment.times.0);
            let rows = segment.rows(recording.t());
            let nearest = recording.t().partition_point(|t| *t < time);
            let window = rows.start.max(nearest.saturating_sub(options.window))..rows.end.min(nearest + options.window);
            if let Some((value, rate)) = parabola(recording, &samples, window, time) {
                states[segment.cycle * d + j] = if coordinate.rate { rate } else { value };
            }
        }
    }
    Ok(states)
}

/// Value and slope at `time` of the least-squares parabola through the samples of `window`; `None` below four samples.
fn parabola(recording: &Recording, samples: &[f64], window: Range<usize>, time: f64) -> Option<(f64, f64)> {
    if window.len() < 4 {
        return None;
    }
    let mut rows = RowQr::new(3);
    for i in window {
        let x = (recording.t()[i] - time) / recording.dt();
        rows.push(&[1.0, x, x * x], -samples[i]);
    }
    let c = rows.minimiser()?;
    Some((c[0], c[1] / recording.dt()))
}

/// `A` of the pairs by least squares; with an intercept per run, from deviations from the run's means.
fn solve(pairs: &[&Pair], states: &[f64], d: usize, intercept: Intercept) -> Option<DMatrix<f64>> {
    let key = |p: &Pair| if intercept == Intercept::PerRun { p.run } else { 0 };
    let mut keys: Vec<usize> = pairs.iter().map(|p| key(p)).collect();
    keys.sort_unstable();
    keys.dedup();
    let mut rows = vec![RowQr::new(d); d];
    for k in keys {
        let of: Vec<&&Pair> = pairs.iter().filter(|p| key(p) == k).collect();
        let mean = |at: fn(&Pair) -> usize, j: usize| stats::mean(of.iter().map(|p| states[at(p) * d + j]));
        let from: Vec<f64> = (0..d).map(|j| mean(|p| p.from, j)).collect();
        let to: Vec<f64> = (0..d).map(|j| mean(|p| p.to, j)).collect();
        for p in of {
            let x: Vec<f64> = (0..d).map(|j| states[p.from * d + j] - from[j]).collect();
            for (j, row) in rows.iter_mut().enumerate() {
                row.push(&x, to[j] - states[p.to * d + j]);
            }
        }
    }
    // Beyond the fit of the parabolas' digits, a coordinate that follows from the others carries nothing but rounding.
    if rows[0].independence().is_nan() || rows[0].independence() < DEPENDENT {
        return None;
    }
    let mut map = DMatrix::zeros(d, d);
    for (i, row) in rows.iter_mut().enumerate() {
        map.row_mut(i).copy_from(&row.minimiser()?.transpose());
    }
    map.iter().all(|v| v.is_finite()).then_some(map)
}

/// Maps of drawn data: whole runs where they are the groups, single pairs where one long run was cut.
fn draw(
    pairs: &[Pair],
    groups: usize,
    options: &Options,
    fit: impl Fn(&[&Pair]) -> Option<DMatrix<f64>>,
) -> Vec<DMatrix<f64>> {
    let mut random = SplitMix64::new(options.seed);
    let by_run = pairs.windows(2).all(|w| (w[0].run == w[1].run) == (w[0].group == w[1].group));
    let mut members: Vec<Vec<&Pair>> = vec![Vec::new(); groups];
    pairs.iter().for_each(|p| members[p.group].push(p));
    let one = |random: &mut SplitMix64| -> Vec<&Pair> {
        if by_run {
            (0..groups).flat_map(|_| members[random.below(groups)].iter().copied()).collect()
        } else {
            (0..pairs.len()).map(|_| &pairs[random.below(pairs.len())]).collect()
        }
    };
    (0..options.draws).filter_map(|_| fit(&one(&mut random))).collect()
}

/// Eigenvalues, largest magnitude first.
fn eigenvalues(map: &DMatrix<f64>) -> Vec<Complex> {
    let mut values: Vec<Complex> = map.complex_eigenvalues().iter().copied().collect();
    values.sort_by(|a, b| b.norm().total_cmp(&a.norm()).then(b.im.total_cmp(&a.im)));
    values
}

/// Held-out errors of the map over those of the mean, and over those of the cycle before, all groups left out in turn.
///
/// The map predicts `to + A (z - from)`. With a common intercept, `from` and `to` are the means of the other groups. With
/// one per run they are the mean of the held-out run's own states so far, all that can be known of its fixed point
/// then. Either way `A = 0` is the mean, and `A = 1` per run is the cycle before: the rivals are special cases.
fn judge(pairs: &[Pair], states: &[f64], d: usize, groups: usize, options: &Options) -> (Ratio, Ratio) {
    let (mut mean_sums, mut previous_sums) = (vec![(0.0, 0.0); groups], vec![(0.0, 0.0); groups]);
    for group in 0..groups {
        let others: Vec<&Pair> = pairs.iter().filter(|p| p.group != group).collect();
        let Some(map) = solve(&others, states, d, options.intercept) else { continue };
        let mean = |at: fn(&Pair) -> usize, j: usize| stats::mean(others.iter().map(|p| states[at(p) * d + j]));
        let common: (Vec<f64>, Vec<f64>) = (0..d).map(|j| (mean(|p| p.from, j), mean(|p| p.to, j))).unzip();
        for p in pairs.iter().filter(|p| p.group == group) {
            let so_far: Vec<usize> =
                pairs.iter().filter(|q| q.run == p.run && q.from <= p.from).map(|q| q.from).collect();
            let own = |j: usize| stats::mean(so_far.iter().map(|from| states[from * d + j]));
            let (from, to) = match options.intercept {
                Intercept::Common => common.clone(),
                Intercept::PerRun if so_far.len() < 2 => continue,
                Intercept::PerRun => (0..d).map(|j| (own(j), own(j))).unzip(),
            };
            for i in 0..d {
                let truth = states[p.to * d + i];
                let predicted = to[i] + (0..d).map(|j| map[(i, j)] * (states[p.from * d + j] - from[j])).sum::<f64>();
                let square = |e: f64| e * e;
                mean_sums[group].0 += square(truth - predicted);
                mean_sums[group].1 += square(truth - to[i]);
                previous_sums[group].1 += square(truth - states[p.from * d + i]);
            }
        }
        previous_sums[group].0 = mean_sums[group].0;
    }
    (ratio_of(&mean_sums, options.draws, options.seed), ratio_of(&previous_sums, options.draws, options.seed))
}

/// What short runs do to the multipliers, in numbers.
fn doubts(multipliers: &[Complex], pairs: usize, runs: usize, intercept: Intercept) -> Vec<String> {
    let (largest, each) = (multipliers[0].norm(), pairs as f64 / runs as f64);
    match intercept {
        Intercept::PerRun if each < 20.0 => vec![format!(
            "an intercept per run of {each:.1} pairs pushes multipliers down by about {:.2} (Nickell's bias); compare with \
             a common intercept, and record longer runs",
            (1.0 + largest) / each
        )],
        Intercept::Common if runs > 1 => vec![format!(
            "one intercept for {runs} runs: lasting differences between runs push multipliers towards one; compare with \
             an intercept per run"
        )],
        _ => Vec::new(),
    }
}

#[cfg(test)]
#[path = "section_tests.rs"]
mod tests;
