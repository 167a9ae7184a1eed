//! The equations of the Floquet model: one row per output line, with the inputs that reach it.
//!
//! Row `w`: `D(w) Y(w) = sum_k N_k(w - k wp) U(w - k wp) + T(w)`. The lines of the inputs are prepared once: the delay of the
//! numerators is taken out, lines at the level of the noise are not regressed on (what they multiply would be drawn towards
//! zero), and the others are shortened to what is expected behind their noise.
//!
//! Reference: R. J. Carroll et al., *Measurement Error in Nonlinear Models*, chapter 4 (regression calibration).

use std::f64::consts::{LN_2, TAU};

use super::layout::{Channel, Layout, Place};
use crate::identify::Spectra;
use crate::identify::spectra::Record;
use crate::numeric::quartic::{self, BUMPS};
use crate::numeric::{Complex, stats};

/// A line of an input counts when its power is this many times that of the noise.
const ABOVE_NOISE: f64 = 8.0;
/// Share of an input's power that may be left out beyond the reach of the numerators.
const LEFT_OUT: f64 = 1e-7;
/// Pumping frequencies beyond the band to which the numerators reach at most.
const FARTHEST: f64 = 8.0;

/// One output line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub record: usize,
    pub line: usize,
    /// 1, or 1/2 for line 0, which is its own mirror image.
    pub share: f64,
    pub bumps: [f64; BUMPS],
    /// `e^{-j w T}`.
    pub turn: Complex,
}

/// The rows over one interval between knots.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    pub rows: Vec<Row>,
    /// Number of channels.
    pub channels: usize,
    /// What the channels multiply, (rows, channels).
    pub inputs: Vec<Complex>,
    /// Variance of the noise in them, (rows, channels).
    pub doubts: Vec<f64>,
    /// Places of the unknowns, (channels, 5).
    pub places: Vec<Place>,
}

/// Power of white noise on input `i` of `record`: the level of the upper half of its lines, where the excitation ends below.
pub(super) fn input_noise(spectra: &Spectra, record: &Record, i: usize) -> f64 {
    let half = record.lines() / 2;
    if spectra.excited(i) > 0.5 * record.spacing() * half as f64 {
        return 0.0;
    }
    let power: Vec<f64> = (half..record.lines()).map(|b| record.input(i, b as i64).norm_sqr()).collect();
    stats::median(&power) / LN_2
}

/// Input frequency (rad/s) up to which the numerators have to reach, for an estimate up to `band`.
pub(super) fn reach(spectra: &Spectra, band: f64) -> f64 {
    let width = spectra.window();
    let of_input = |i: usize| {
        let noise = spectra.records().iter().map(|r| input_noise(spectra, r, i)).fold(0.0, f64::max);
        let power: Vec<f64> = spectra
            .input_power(i)
            .into_iter()
            .map(|p| if p > spectra.above_noise(noise) { p - noise } else { 0.0 })
            .collect();
        let total: f64 = power.iter().sum();
        let mut rest = 0.0;
        let last = (0..power.len()).rev().find(|&at| {
            rest += power[at];
            rest > LEFT_OUT * total
        });
        last.map_or(0.0, |at| (at + 1) as f64 * width)
    };
    let wanted = (0..spectra.inputs()).map(of_input).fold(0.0, f64::max);
    wanted.clamp(band, band + FARTHEST * spectra.pumping())
}

/// All rows, interval by interval from zero upwards.
pub(super) fn cells(spectra: &Spectra, layout: &Layout) -> Vec<Cell> {
    let noise: Vec<Vec<f64>> = spectra
        .records()
        .iter()
        .map(|record| (0..layout.inputs).map(|i| input_noise(spectra, record, i)).collect())
        .collect();
    let cell_of = |cell: i64| {
        let channels = layout.channels_of_cell(cell);
        let splines = cell..cell + BUMPS as i64;
        let places = channels.iter().flat_map(|&c| splines.clone().filter_map(move |q| layout.place(c, q))).collect();
        let (mut rows, mut inputs, mut doubts) = (Vec::new(), Vec::new(), Vec::new());
        for (r, record) in spectra.records().iter().enumerate() {
            let periods = record.periods() as i64;
            // Line b stands at b / periods pumping frequencies, interval b knots / periods.
            let first = (cell * periods + layout.knots - 1).div_euclid(layout.knots);
            let end = ((cell + 1) * periods + layout.knots - 1).div_euclid(layout.knots).min(record.lines() as i64);
            for line in (first..end).filter(|&b| spectra.informative(record, b)) {
                let place = (line * layout.knots - cell * periods) as f64 / periods as f64;
                let turn = Complex::from_polar(1.0, -TAU * line.rem_euclid(periods) as f64 / periods as f64);
                let share = if line == 0 { 0.5 } else { 1.0 };
                rows.push(Row { record: r, line: line as usize, share, bumps: quartic::values(place), turn });
                let delayed = |b: i64| Complex::from_polar(1.0, -(b as f64) * record.spacing() * layout.delay);
                for channel in &channels {
                    let (value, doubt) = match *channel {
                        Channel::Harmonic { k, input } => {
                            let b = line - k * periods;
                            let (value, doubt) = calibrated(record.input(input, b), noise[r][input]);
                            (value * delayed(b), doubt)
                        }
                        Channel::Transient { record: own } if own == r => {
                            let begun = Complex::from_polar(1.0, -(line as f64) * record.spacing() * record.start());
                            (delayed(line) * begun, 0.0)
                        }
                        Channel::Transient { .. } => (Complex::new(0.0, 0.0), 0.0),
                    };
                    inputs.push(value);
                    doubts.push(doubt);
                }
            }
        }
        Cell { rows, channels: channels.len(), inputs, doubts, places }
    };
    (0..layout.cells).map(cell_of).collect()
}

/// What is expected behind a noisy line, and the variance of what is left.
fn calibrated(line: Complex, noise: f64) -> (Complex, f64) {
    let power = line.norm_sqr();
    let share = if power > ABOVE_NOISE * noise { 1.0 - noise / power } else { 0.0 };
    (line * share, noise * share)
}
