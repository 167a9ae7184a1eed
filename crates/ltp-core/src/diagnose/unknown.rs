//! Physics outside the library: a force law over what it depends on, without a name.

use super::locate::{BLOCKS, Located, splines};
use super::result::Law;
use super::trial::Trial;
use crate::numeric::rows::RowQr;
use crate::numeric::spline::BSplines;
use crate::numeric::{regression, stats};

/// Largest p-value of the dependence.
const P_VALUE: f64 = 0.01;
/// Smallest share of the missing force that the variable must explain on left-out blocks.
const EXPLAINED: f64 = 0.3;
/// Smallest residual, in units of noise, that calls for new physics.
const LARGE: f64 = 2.0;
/// Pieces of the cubic spline that are tried; the number that predicts left-out blocks best is drawn.
const PIECES: [usize; 4] = [8, 16, 32, 48];

/// Samples from which the number of pieces is chosen.
const KEPT: usize = 4000;

/// The law of a mismatch that is large, depends clearly on one variable, and has no name in the library.
pub fn law(located: &Located, nominal: &Trial) -> Option<Law> {
    let r = &nominal.residuals;
    let (s, n) = r.energy(&r.train, 0);
    let large = n > 0.0 && (s / n).sqrt() > LARGE;
    let clear = located.location.p_value <= P_VALUE && located.explained >= EXPLAINED;
    if !(large && clear) {
        return None;
    }
    let forces = &located.forces;
    let (variable, unit): (&str, String) = match located.location.variable.as_str() {
        "position" => ("position", forces.first()?.position_unit.clone()),
        "time" => ("time", "s".into()),
        _ => ("velocity", forces.first()?.velocity_unit.clone()),
    };
    let pairs: Vec<(f64, f64)> = forces
        .iter()
        .flat_map(|f| {
            let x = match variable {
                "position" => &f.position,
                "time" => &f.t,
                _ => &f.velocity,
            };
            x.iter().copied().zip(f.force.iter().copied()).collect::<Vec<_>>()
        })
        .collect();
    let xs: Vec<f64> = pairs.iter().map(|p| p.0).collect();
    let (low, high) = (stats::quantile(&xs, 0.01), stats::quantile(&xs, 0.99));
    let every = pairs.len().div_ceil(KEPT).max(1);
    let thin: Vec<f64> = xs.iter().copied().step_by(every).collect();
    let force: Vec<f64> = pairs.iter().map(|p| p.1).step_by(every).collect();
    let predicts = |pieces: usize| regression::explained(&force, &splines(&thin, pieces), BLOCKS);
    let pieces = PIECES.into_iter().max_by(|a, b| predicts(*a).total_cmp(&predicts(*b)))?;
    let basis = BSplines::new(low, high, pieces).ok()?;
    let mut rows = RowQr::new(basis.len());
    for (x, w) in &pairs {
        if (low..=high).contains(x) {
            rows.push(&basis.row(*x), -w);
        }
    }
    // A light curvature penalty keeps pieces without data tame.
    let scale = (pairs.len() as f64).sqrt() * 1e-2;
    for j in 1..basis.len() - 1 {
        let mut row = vec![0.0; basis.len()];
        (row[j - 1], row[j], row[j + 1]) = (scale, -2.0 * scale, scale);
        rows.push(&row, 0.0);
    }
    let coefficients = rows.minimiser()?;
    let value = |x: f64| basis.row(x).iter().zip(coefficients.iter()).map(|(b, c)| b * c).sum::<f64>();
    let left = stats::rms(pairs.iter().filter(|(x, _)| (low..=high).contains(x)).map(|(x, w)| w - value(*x)));
    let grid: Vec<f64> = (0..121).map(|i| low + (high - low) * f64::from(i) / 120.0).collect();
    Some(Law {
        at: located.location.at.clone(),
        variable: variable.into(),
        unit: forces.first()?.unit.clone(),
        variable_unit: unit,
        force: grid.iter().map(|&x| value(x)).collect(),
        sd: vec![left; grid.len()],
        grid,
    })
}
