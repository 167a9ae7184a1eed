//! The Floquet fit for a given order: from nothing to converged coefficients, noise levels and scales.
//!
//! Nothing is tuned by hand. The scale of every harmonic's kernel and the level of the noise along frequency are those under
//! which the data are most probable (empirical Bayes, by the fixed point of D. J. C. MacKay, *Bayesian interpolation*, Neural
//! Computation 4 (1992) 415-447), so without noise the prior steps back, and with noise it holds what the data leave open.
//!
//! References: K. Steiglitz and L. E. McBride, IEEE Transactions on Automatic Control 10 (1965) 461-464, for the first
//! denominator; G. H. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10 (1973) 413-432, for projecting the
//! numerators out.

use nalgebra::DMatrix;

use super::layout::{Channel, Layout};
use super::posterior::{self, Data, Posterior, Step, denominator};
use super::rows::{self, Cell};
use super::{Options, noise};
use crate::error::Result;
use crate::identify::Spectra;
use crate::numeric::Complex;

/// Steps of Steiglitz and McBride before the output error is linearised.
const FIRST_STEPS: usize = 3;
/// First noise level, relative to the power of the output.
const FIRST_NOISE: f64 = 1e-2;
/// First scale of the coefficients, relative to the quotient of output and input power.
const FIRST_SCALE: f64 = 1e3;
/// Least noise level, relative to the power of the output: below a hundred thousandth of its amplitude, normal equations in
/// double precision no longer tell noise from rounding.
const LEAST_NOISE: f64 = 1e-10;
/// Least scale, relative to the first.
const LEAST_SCALE: f64 = 1e-20;
/// Halvings of a step that does not lower what is minimised, before it is given up.
const HALVINGS: usize = 8;
/// Noise of the inputs is looked at where it may be more than this share of the level.
const NOTICED: f64 = 0.02;
/// Converged when the denominator moves by less than this many of its standard deviations, squared ...
const STILL: f64 = 1e-3;
/// ... and the number of determined coefficients by less than this share.
const SETTLED: f64 = 1e-2;

/// A fit of one order.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub layout: Layout,
    pub cells: Vec<Cell>,
    /// Coefficients of the denominator.
    pub a: Vec<f64>,
    /// Their precision matrix.
    pub precision: DMatrix<f64>,
    /// Per output.
    pub outputs: Vec<Output>,
    pub iterations: usize,
    /// Lines of the outputs, per output, cell and row.
    measured: Vec<Vec<Vec<Complex>>>,
    /// Logarithm of the determinant of the prior precision at unit scales, of one output.
    prior: f64,
}

/// Coefficients and what was found with them.
struct State {
    a: Vec<f64>,
    precision: DMatrix<f64>,
    outputs: Vec<Output>,
}

/// What one output says.
#[derive(Clone, Debug)]
pub(super) struct Output {
    pub posterior: Posterior,
    pub coefficients: Vec<Vec<Complex>>,
    /// Power of the residuals, per cell and row.
    pub residuals: Vec<Vec<f64>>,
    /// Power of what was measured, per cell and row.
    pub power: Vec<Vec<f64>>,
    /// Number of coefficients that the data determine.
    pub determined: f64,
    /// Noise and scales under which this was found.
    pub setting: Setting,
    predicted: Vec<Vec<Complex>>,
    /// Variance that noise of the inputs adds, per cell and row.
    doubts: Vec<Vec<f64>>,
    /// Per group: size of the coefficients in the prior's measure at unit scale, and how many the data determine.
    sizes: Vec<(f64, f64)>,
}

/// What a fit is made under.
#[derive(Clone, Debug)]
pub(super) struct Setting {
    /// Variance of a line, per cell and row.
    pub levels: Vec<Vec<f64>>,
    /// Prior variance of the coefficients, per group.
    pub scales: Vec<f64>,
    /// Variance that noise of the inputs is taken to add, per cell and row; part of the levels.
    doubts: Vec<Vec<f64>>,
    least_level: f64,
    least_scales: Vec<f64>,
}

/// Fits `order` multipliers; numerators reach to `reach` (rad/s), rows to `highest` (rad/s).
///
/// # Errors
/// `NoConvergence` when the normal equations cannot be solved.
pub(super) fn fit(spectra: &Spectra, order: usize, reach: f64, highest: f64, options: &Options) -> Result<Fit> {
    let mut fit = Fit::begin(spectra, order, reach, highest, options)?;
    let most = options.iterations.max(FIRST_STEPS + 1);
    fit.iterate(spectra, most)?;
    Ok(fit)
}

/// As [`fit`], and then once more with the noise of the inputs where it comes out.
///
/// That noise needs the transfer functions to be known: while they are not, weights that follow them lead astray.
///
/// # Errors
/// As [`fit`].
pub(super) fn fit_and_refine(
    spectra: &Spectra,
    order: usize,
    reach: f64,
    highest: f64,
    options: &Options,
) -> Result<Fit> {
    let mut fit = fit(spectra, order, reach, highest, options)?;
    let matters = fit.outputs.iter().any(|output| {
        let pairs = output.doubts.iter().flatten().zip(output.setting.levels.iter().flatten());
        pairs.into_iter().any(|(doubt, level)| *doubt > NOTICED * level)
    });
    if matters {
        for output in &mut fit.outputs {
            // From here on the levels are the smooth part and the doubts.
            for (levels, doubts) in output.setting.levels.iter_mut().zip(&output.doubts) {
                levels.iter_mut().zip(doubts).for_each(|(level, doubt)| *level += doubt);
            }
            output.setting.doubts.clone_from(&output.doubts);
        }
        fit.iterate(spectra, fit.iterations + options.iterations)?;
    }
    Ok(fit)
}

impl Fit {
    /// The unknowns and equations, and nothing known.
    fn begin(spectra: &Spectra, order: usize, reach: f64, highest: f64, options: &Options) -> Result<Self> {
        let memory = order.max(1) as f64 * spectra.period();
        let knots = options.knots * order.max(1);
        let width = spectra.pumping() / knots as f64;
        let intervals = |omega: f64| ((omega / width * (1.0 - 1e-9)).ceil() as usize).max(1);
        let transients = if options.transients { spectra.records().len() } else { 0 };
        let channels = (spectra.inputs(), transients);
        let layout = Layout::new(spectra.pumping(), knots, memory, intervals(reach), intervals(highest), channels);
        let cells = rows::cells(spectra, &layout);
        let measured = (0..spectra.outputs()).map(|j| measured(spectra, &cells, j)).collect();
        let (precision, outputs) = (DMatrix::zeros(0, 0), Vec::new());
        let scales = vec![1.0; layout.groups()];
        let prior = posterior::prior(&layout, &scales).factor(&layout.mirror())?.log_determinant();
        Ok(Fit { layout, cells, a: vec![0.0; order], precision, outputs, iterations: 0, measured, prior })
    }

    /// Iterates until nothing moves, or `most` iterations were made: then the one under which the data are most probable
    /// stands.
    fn iterate(&mut self, spectra: &Spectra, most: usize) -> Result<()> {
        let periods: Vec<usize> = spectra.records().iter().map(|r| r.periods()).collect();
        let least = self.iterations + 2;
        let mut best: (f64, Option<State>) = (f64::NEG_INFINITY, None);
        loop {
            let first_steps = self.iterations < FIRST_STEPS;
            let settings: Vec<Setting> = if self.outputs.is_empty() {
                self.measured.iter().map(|y| Setting::first(spectra, &self.layout, &self.cells, y)).collect()
            } else {
                self.outputs.iter().map(|output| output.adapted(&self.cells, &periods, !first_steps)).collect()
            };
            let determined: f64 = self.outputs.iter().map(|o| o.determined).sum();
            let (state, moved) =
                self.step(settings, if first_steps { Step::SteiglitzMcBride } else { Step::GaussNewton })?;
            let before = self.swap(state);
            self.iterations += 1;
            let now: f64 = self.outputs.iter().map(|o| o.determined).sum();
            let still = moved < STILL && (now - determined).abs() <= SETTLED * now;
            if still && self.iterations > FIRST_STEPS && self.iterations >= least {
                return Ok(());
            }
            let evidence = self.evidence();
            if evidence > best.0 {
                best = (evidence, None);
            } else if best.1.is_none() {
                best.1 = Some(before);
            }
            if self.iterations >= most {
                if let Some(state) = best.1 {
                    self.swap(state);
                }
                return Ok(());
            }
        }
    }

    /// Puts `state` in place of the present one, which is returned.
    fn swap(&mut self, state: State) -> State {
        State {
            a: std::mem::replace(&mut self.a, state.a),
            precision: std::mem::replace(&mut self.precision, state.precision),
            outputs: std::mem::replace(&mut self.outputs, state.outputs),
        }
    }

    /// One step under given settings; returns where it leads, and how far the denominator moves, squared, in standard
    /// deviations.
    fn step(&self, settings: Vec<Setting>, step: Step) -> Result<(State, f64)> {
        let mut posteriors = Vec::with_capacity(settings.len());
        for (j, setting) in settings.iter().enumerate() {
            let measured = &self.measured[j];
            let explained = if step == Step::SteiglitzMcBride { measured } else { &self.outputs[j].predicted };
            let weights: Vec<Vec<f64>> =
                setting.levels.iter().map(|levels| levels.iter().map(|l| 1.0 / l).collect()).collect();
            posteriors.push(posterior::posterior(&Data {
                layout: &self.layout,
                cells: &self.cells,
                weights: &weights,
                columns: &columns(&self.cells, measured, explained, &self.a, step),
                scales: &setting.scales,
                denominator: &self.a,
            })?);
        }
        let reduced = posteriors.iter().skip(1).fold(posteriors[0].reduced.clone(), |sum, p| sum + &p.reduced);
        let (wanted, precision) = posterior::denominator_change(&reduced);
        let start = if step == Step::SteiglitzMcBride { vec![0.0; self.a.len()] } else { self.a.clone() };
        let full: Vec<f64> = inside(&start, &wanted).iter().zip(&start).map(|(new, old)| new - old).collect();
        let change = match step {
            Step::SteiglitzMcBride => full,
            Step::GaussNewton => self.descent(&posteriors, &settings, full),
        };
        let order = change.len();
        let moved = (0..order * order)
            .map(|i| change[i / order] * precision[(i / order, i % order)] * change[i % order])
            .sum::<f64>();
        let a: Vec<f64> = start.iter().zip(&change).map(|(a, d)| a + d).collect();
        let outputs = posteriors.into_iter().zip(settings).zip(&self.measured);
        let outputs =
            outputs.map(|((posterior, setting), y)| Output::new(self, &a, y, posterior, setting, &change)).collect();
        Ok((State { a, precision, outputs }, moved))
    }

    /// The share of a change of the denominator that lowers what is minimised under these settings: the linearised output
    /// error holds for small changes, and multipliers near the unit circle make small what is small.
    fn descent(&self, posteriors: &[Posterior], settings: &[Setting], full: Vec<f64>) -> Vec<f64> {
        let cost = |change: &[f64]| -> f64 {
            let a: Vec<f64> = self.a.iter().zip(change).map(|(a, d)| a + d).collect();
            let outputs = posteriors.iter().zip(settings).zip(&self.measured);
            outputs.map(|((posterior, setting), measured)| self.cost(&a, change, posterior, setting, measured)).sum()
        };
        let standing = cost(&vec![0.0; full.len()]);
        let mut change = full;
        for _ in 0..HALVINGS {
            if change.is_empty() || cost(&change) <= standing {
                return change;
            }
            change.iter_mut().for_each(|d| *d *= 0.5);
        }
        vec![0.0; change.len()]
    }

    /// What one output's fit minimises: residuals by their variances and coefficients by theirs.
    fn cost(
        &self,
        a: &[f64],
        change: &[f64],
        posterior: &Posterior,
        setting: &Setting,
        measured: &[Vec<Complex>],
    ) -> f64 {
        let coefficients = posterior.coefficients(change);
        let (predicted, _) = posterior::predict(&self.cells, a, &coefficients);
        let mut cost = 0.0;
        for (c, cell) in self.cells.iter().enumerate() {
            for (r, row) in cell.rows.iter().enumerate() {
                cost += 2.0 * row.share * (measured[c][r] - predicted[c][r]).norm_sqr() / setting.levels[c][r];
            }
        }
        let sizes = posterior.sizes(&self.layout, &coefficients, &setting.scales);
        cost + sizes.iter().zip(&setting.scales).map(|((size, _), scale)| size / scale).sum::<f64>()
    }

    /// Logarithm of the probability of the data, up to a constant of theirs: compares orders.
    pub fn evidence(&self) -> f64 {
        let half_log =
            |m: &DMatrix<f64>| m.clone().cholesky().map_or(0.0, |f| f.l().diagonal().iter().map(|d| d.ln()).sum());
        let mut evidence = if self.a.is_empty() { 0.0 } else { -half_log(&self.precision) };
        for output in &self.outputs {
            let setting = &output.setting;
            for (c, cell) in self.cells.iter().enumerate() {
                for (r, row) in cell.rows.iter().enumerate() {
                    let level = setting.levels[c][r];
                    evidence -= row.share * (level.ln() + output.residuals[c][r] / level);
                }
            }
            let sizes: f64 = output.sizes.iter().zip(&setting.scales).map(|((size, _), scale)| size / scale).sum();
            let counts = self.layout.counts();
            let prior = self.prior - counts.iter().zip(&setting.scales).map(|(n, scale)| n * scale.ln()).sum::<f64>();
            evidence += 0.5 * (prior - output.posterior.log_determinant - sizes);
        }
        evidence
    }
}

impl Output {
    fn new(
        fit: &Fit,
        a: &[f64],
        measured: &[Vec<Complex>],
        posterior: Posterior,
        setting: Setting,
        change: &[f64],
    ) -> Self {
        let coefficients = posterior.coefficients(change);
        let (predicted, doubts) = posterior::predict(&fit.cells, a, &coefficients);
        let rest = |(y, p): (&Vec<Complex>, &Vec<Complex>)| y.iter().zip(p).map(|(y, p)| (y - p).norm_sqr()).collect();
        let residuals = measured.iter().zip(&predicted).map(rest).collect();
        let power = measured.iter().map(|y| y.iter().map(Complex::norm_sqr).collect()).collect();
        let sizes = posterior.sizes(&fit.layout, &coefficients, &setting.scales);
        let determined = sizes.iter().map(|(_, determined)| determined).sum();
        Output { posterior, coefficients, residuals, power, determined, setting, predicted, doubts, sizes }
    }

    /// The smooth part of the noise levels.
    fn smooth(&self) -> Vec<Vec<f64>> {
        let pairs = self.setting.levels.iter().zip(&self.setting.doubts);
        pairs.map(|(levels, doubts)| levels.iter().zip(doubts).map(|(l, d)| l - d).collect()).collect()
    }

    /// Scales, and with `noise` levels, under which what was found is most probable.
    fn adapted(&self, cells: &[Cell], periods: &[usize], noise: bool) -> Setting {
        let mut setting = self.setting.clone();
        let news = self.sizes.iter().map(|(size, determined)| size / determined.max(0.5));
        setting.scales = news.zip(&setting.least_scales).map(|(new, &least)| new.max(least)).collect();
        if noise {
            let given = noise::Residuals {
                cells,
                power: &self.residuals,
                doubts: &setting.doubts,
                levels: &self.smooth(),
                leverage: &self.posterior.leverage,
            };
            setting.levels = noise::levels(&given, periods, setting.least_level);
        }
        setting
    }
}

impl Setting {
    /// Before anything is known: much noise, wide scales.
    fn first(spectra: &Spectra, layout: &Layout, cells: &[Cell], measured: &[Vec<Complex>]) -> Self {
        let rows: usize = cells.iter().map(|c| c.rows.len()).sum();
        let power = measured.iter().flatten().map(Complex::norm_sqr).sum::<f64>() / rows.max(1) as f64;
        let lines = (layout.reach as f64 * layout.width() / spectra.window()).ceil() as usize;
        let gain = |i: usize| {
            let windows = spectra.input_power(i);
            let inside = &windows[..lines.clamp(1, windows.len())];
            power * inside.len() as f64 / inside.iter().sum::<f64>().max(f64::MIN_POSITIVE)
        };
        let gains: Vec<f64> = (0..layout.inputs).map(gain).collect();
        let mut scales = vec![FIRST_SCALE * power; layout.groups()];
        for channel in layout.channels() {
            if let Channel::Harmonic { input, .. } = channel {
                scales[layout.group(channel)] = FIRST_SCALE * gains[input];
            }
        }
        Setting {
            levels: cells.iter().map(|c| vec![FIRST_NOISE * power; c.rows.len()]).collect(),
            doubts: cells.iter().map(|c| vec![0.0; c.rows.len()]).collect(),
            least_level: LEAST_NOISE * power,
            least_scales: scales.iter().map(|s| LEAST_SCALE * s).collect(),
            scales,
        }
    }
}

/// Lines of output `j`, per cell and row.
fn measured(spectra: &Spectra, cells: &[Cell], j: usize) -> Vec<Vec<Complex>> {
    let of_cell =
        |cell: &Cell| cell.rows.iter().map(|row| spectra.records()[row.record].output(j, row.line as i64)).collect();
    cells.iter().map(of_cell).collect()
}

/// The output, and what moves with each coefficient of the denominator, per cell, (rows, 1 + order).
fn columns(
    cells: &[Cell],
    measured: &[Vec<Complex>],
    explained: &[Vec<Complex>],
    a: &[f64],
    step: Step,
) -> Vec<Vec<Complex>> {
    let of_row = |turn: Complex, y: Complex, x: Complex| {
        let inverse = 1.0 / denominator(a, turn);
        let mut column = vec![if step == Step::SteiglitzMcBride { y * inverse } else { y }];
        let mut power = inverse;
        for _ in a {
            power *= turn;
            column.push(power * x);
        }
        column
    };
    let of_cell = |(c, cell): (usize, &Cell)| {
        let rows = cell.rows.iter().enumerate();
        rows.flat_map(|(r, row)| of_row(row.turn, measured[c][r], explained[c][r])).collect()
    };
    cells.iter().enumerate().map(of_cell).collect()
}

/// `start + change`, drawn back until all multipliers are inside the unit circle.
fn inside(start: &[f64], change: &[f64]) -> Vec<f64> {
    let mut share = 1.0;
    for _ in 0..20 {
        let moved: Vec<f64> = start.iter().zip(change).map(|(a, d)| a + share * d).collect();
        if stable(&moved) {
            return moved;
        }
        share *= 0.7;
    }
    start.to_vec()
}

/// Whether all roots of `z^p - a_1 z^{p-1} - ... - a_p` are inside the unit circle (recursion of Schur and Cohn).
fn stable(a: &[f64]) -> bool {
    let mut c: Vec<f64> = a.iter().map(|a| -a).collect();
    while let Some(&last) = c.last() {
        if last.is_nan() || last.abs() >= 1.0 {
            return false;
        }
        let n = c.len() - 1;
        c = (0..n).map(|i| (c[i] - last * c[n - 1 - i]) / (1.0 - last * last)).collect();
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stability_is_that_of_the_roots() {
        let mut random = crate::numeric::rng::SplitMix64::new(8);
        for _ in 0..200 {
            let a: Vec<f64> = (0..4).map(|_| random.normal()).collect();
            let companion = DMatrix::from_fn(4, 4, |r, c| if r == 0 { a[c] } else { f64::from(u8::from(r == c + 1)) });
            let largest = companion.complex_eigenvalues().iter().map(|l| l.norm()).fold(0.0, f64::max);
            assert_eq!(stable(&a), largest < 1.0, "{a:?} {largest}");
            let pulled = inside(&[0.0; 4], &a);
            assert!(stable(&pulled));
        }
    }
}
