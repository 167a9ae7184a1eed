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

/// Level of one record's noise, per cell and row: variance of a line.
///
/// `residuals` and `cells` as in [`super::rows::cells`], `leverage` per cell, `periods` per record; `floor` is the least level.
pub(super) fn levels(
    cells: &[Cell],
    residuals: &[Vec<f64>],
    leverage: &[f64],
    periods: &[usize],
    floor: f64,
) -> Vec<Vec<f64>> {
    let mut levels: Vec<Vec<f64>> = cells.iter().map(|cell| vec![floor; cell.rows.len()]).collect();
    for (record, &periods) in periods.iter().enumerate() {
        let half = LINES.max((WIDTH * periods as f64) as usize);
        // Along the record's lines: power, and the share of a line's variance that is left in its residual.
        let (mut places, mut power, mut left) = (Vec::new(), Vec::new(), Vec::new());
        for (c, cell) in cells.iter().enumerate() {
            let share = (1.0 - leverage[c] / (cell.rows.len() as f64).max(1.0)).max(LEFT);
            for r in (0..cell.rows.len()).filter(|&r| cell.rows[r].record == record) {
                places.push((c, r));
                power.push(residuals[c][r]);
                left.push(share);
            }
        }
        let n = power.len();
        if n == 0 {
            continue;
        }
        // Lines below zero are images of those above; at the far end the window is cut.
        for (i, &(c, r)) in places.iter().enumerate() {
            let below = (1..=half.saturating_sub(i)).filter(|&j| j < n);
            let window = below.chain(i.saturating_sub(half)..(i + half + 1).min(n));
            let (sum, share) = window.fold((0.0, 0.0), |(sum, share), j| (sum + power[j], share + left[j]));
            levels[c][r] = (sum / share).max(floor);
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
        let levels = levels(&cells, &residuals, &[25.0; 20], &[1000], 0.0);
        let mean = levels.iter().flatten().sum::<f64>() / 1000.0;
        assert!((mean - 3.0).abs() < 0.3, "{mean}");
        // 101 lines are averaged: a tenth of scatter.
        assert!(levels.iter().flatten().all(|l| (l - 3.0).abs() < 1.5));
    }

    #[test]
    fn a_step_in_the_level_is_seen_within_the_window() {
        let cells = cells(50);
        let residuals: Vec<Vec<f64>> = (0..20).map(|c| vec![if c < 10 { 1.0 } else { 9.0 }; 50]).collect();
        let levels = levels(&cells, &residuals, &[0.0; 20], &[400], 2.0);
        assert!((levels[8][20] - 2.0).abs() < 1e-12, "the floor");
        assert!((levels[11][0] - 9.0).abs() < 1e-9);
    }
}
