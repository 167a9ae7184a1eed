//! The level of the noise along output frequency, from what the fit leaves.
//!
//! Noise is coloured: a noisy input comes out most where the system resonates. The level at a line is the mean power of the
//! residuals around it, with what the fit took out of them by its own freedom put back.

use super::rows::Cell;

/// Least lines on either side that are averaged.
const LINES: usize = 20;
/// Width on either side, in pumping frequencies.
const WIDTH: f64 = 0.05;
/// However free the fit, this share of the residuals' power is taken to be left.
const LEFT: f64 = 0.02;
/// The smooth part is at least this share of what is left: doubts may be overestimated.
const LEAST_SMOOTH: f64 = 0.1;

/// What is known before the levels are.
pub(super) struct Residuals<'a> {
    pub cells: &'a [Cell],
    /// Power left, per cell and row.
    pub power: &'a [Vec<f64>],
    /// Variance known row by row, per cell and row: the noise of an input comes out only where the input is believed, on the
    /// lines of a multisine and not between them. The rest is taken to be smooth.
    pub doubts: &'a [Vec<f64>],
    /// Levels of the step before, per cell and row.
    pub levels: &'a [Vec<f64>],
    /// Values spent on the coefficients, per cell.
    pub leverage: &'a [f64],
}

/// Level of the noise, per cell and row: variance of a line.
///
/// `periods` per record; `floor` is the least level. Rows count by the information they hold on the smooth part, the inverse
/// square of their variance.
pub(super) fn levels(residuals: &Residuals, periods: &[usize], floor: f64) -> Vec<Vec<f64>> {
    let cells = residuals.cells;
    let mut levels: Vec<Vec<f64>> = cells.iter().map(|cell| vec![floor; cell.rows.len()]).collect();
    for (record, &periods) in periods.iter().enumerate() {
        let half = LINES.max((WIDTH * periods as f64) as usize);
        // Along the record's lines: place; power, doubt and share of the variance that is left in it; variance.
        let mut lines = Vec::new();
        for (c, cell) in cells.iter().enumerate() {
            let share = (1.0 - residuals.leverage[c] / (cell.rows.len() as f64).max(1.0)).max(LEFT);
            for r in (0..cell.rows.len()).filter(|&r| cell.rows[r].record == record) {
                let (power, doubt) = (residuals.power[c][r], residuals.doubts[c][r]);
                lines.push(((c, r), power, doubt, share, residuals.levels[c][r].max(floor) + doubt));
            }
        }
        let n = lines.len();
        // Lines below zero are images of those above; at the far end the window is cut.
        for (i, &((c, r), _, known, _, _)) in lines.iter().enumerate() {
            let below = (1..=half.saturating_sub(i)).filter(|&j| j < n);
            let window = below.chain(i.saturating_sub(half)..(i + half + 1).min(n));
            let (mut all, mut known_part, mut left) = (0.0, 0.0, 0.0);
            let typical = lines[i].4;
            for (_, power, doubt, share, variance) in window.map(|j| lines[j]) {
                let weight = (typical / variance).powi(2);
                all += weight * power;
                known_part += weight * share * doubt;
                left += weight * share;
            }
            levels[c][r] = ((all - known_part).max(LEAST_SMOOTH * all) / left).max(floor) + known;
        }
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::floquet::rows::Row;
    use crate::numeric::{Complex, rng::SplitMix64};

    fn cells(rows: usize) -> Vec<Cell> {
        let row = |line| Row { record: 0, line, share: 1.0, bumps: [0.2; 5], turn: Complex::new(1.0, 0.0) };
        let cell = |c: usize| Cell {
            rows: (c * rows..(c + 1) * rows).map(row).collect(),
            channels: 0,
            inputs: Vec::new(),
            doubts: Vec::new(),
            places: Vec::new(),
        };
        (0..20).map(cell).collect()
    }

    #[test]
    fn white_residuals_have_their_level_and_leverage_is_put_back() {
        let mut random = SplitMix64::new(4);
        let cells = cells(50);
        let mut draw = || (random.normal().powi(2) + random.normal().powi(2)) * 0.5 * 3.0;
        // Half of every residual's power went into the fit.
        let residuals: Vec<Vec<f64>> = (0..20).map(|_| (0..50).map(|_| 0.5 * draw()).collect()).collect();
        let (none, flat) = (vec![vec![0.0; 50]; 20], vec![vec![1.0; 50]; 20]);
        let given = Residuals { cells: &cells, power: &residuals, doubts: &none, levels: &flat, leverage: &[25.0; 20] };
        let levels = levels(&given, &[1000], 0.0);
        let mean = levels.iter().flatten().sum::<f64>() / 1000.0;
        assert!((mean - 3.0).abs() < 0.3, "{mean}");
        // 101 lines are averaged: a tenth of scatter.
        assert!(levels.iter().flatten().all(|l| (l - 3.0).abs() < 1.5));
    }

    #[test]
    fn a_step_in_the_level_is_seen_within_the_window() {
        let cells = cells(50);
        let residuals: Vec<Vec<f64>> = (0..20).map(|c| vec![if c < 10 { 1.0 } else { 9.0 }; 50]).collect();
        let (none, flat) = (vec![vec![0.0; 50]; 20], vec![vec![3.0; 50]; 20]);
        let given = Residuals { cells: &cells, power: &residuals, doubts: &none, levels: &flat, leverage: &[0.0; 20] };
        let levels = levels(&given, &[400], 2.0);
        assert!((levels[8][20] - 2.0).abs() < 1e-12, "the floor");
        assert!((levels[11][0] - 9.0).abs() < 1e-9);
    }

    #[test]
    fn rows_whose_noise_is_known_do_not_raise_their_neighbours() {
        let mut random = SplitMix64::new(5);
        let cells = cells(50);
        // Every tenth row holds a hundred times the noise of the others, and is known to.
        let doubts = vec![(0..50).map(|r| if r % 10 == 0 { 100.0 } else { 0.0 }).collect::<Vec<f64>>(); 20];
        let mut draw = |d: f64| (random.normal().powi(2) + random.normal().powi(2)) * 0.5 * (1.0 + d);
        let power: Vec<Vec<f64>> = doubts.iter().map(|row| row.iter().map(|&d| draw(d)).collect()).collect();
        let flat = vec![vec![10.0; 50]; 20];
        let given = Residuals { cells: &cells, power: &power, doubts: &doubts, levels: &flat, leverage: &[0.0; 20] };
        let levels = levels(&given, &[2000], 0.0);
        for (level, doubt) in levels.iter().flatten().zip(doubts.iter().flatten()) {
            assert!((level - doubt - 1.0).abs() < 0.5, "{level} {doubt}");
        }
    }
}
