//! Wrong units: the stated model runs along a short stretch of the recording with one column taken in another unit, and a
//! unit is named when that alone makes it follow.

use std::sync::atomic::AtomicBool;

use super::super::experiment::{Control, Experiment, Run};
use super::super::fit::{self, Effort, Ground, Point, Subject};
use super::super::words::number;
use crate::error::{Error, Result};
use crate::model::{self, Backend, Compiled, Model, System};
use crate::numeric::stats;
use crate::simulate::{Hold, Inputs};

/// Samples that the stated model runs along.
const STRETCH: usize = 400;
/// Error over motion beyond which the stated model does not follow, and a unit is looked for.
const ASTRAY: f64 = 0.7;
/// Error over motion below which another unit makes it follow.
const FOLLOWS: f64 = 0.35;
/// By how much the error must fall for a unit to be the reason.
const BETTER: f64 = 0.4;
/// Enough to find an initial state.
const EFFORT: Effort = Effort { iterations: 12, ftol: 1e-4 };

/// What may be wrong: a column holds the unit on the right, `factor` of which make one of the unit of the model.
struct Guess {
    /// Output or input by number; time where both are `None`.
    output: Option<usize>,
    input: Option<usize>,
    factor: f64,
    looks_like: String,
}

/// Units that are taken for another, and how many of the second make one of the first.
fn mistaken(unit: &str) -> Vec<(f64, String)> {
    let words = |list: &[(f64, &str)]| list.iter().map(|(f, w)| (*f, (*w).to_string())).collect();
    let tau = std::f64::consts::TAU;
    match unit {
        "rad" => words(&[(360.0 / tau, "degrees"), (1e3, "mrad"), (1.0 / tau, "revolutions")]),
        "rad/s" => words(&[(360.0 / tau, "degrees/s"), (60.0 / tau, "revolutions/min"), (1.0 / tau, "Hz")]),
        "m" => words(&[(1e3, "mm"), (1e2, "cm"), (1e6, "um"), (1.0 / 0.0254, "inches")]),
        "m/s" => words(&[(1e3, "mm/s"), (1e2, "cm/s"), (3.6, "km/h")]),
        "N" => words(&[(1e3, "mN"), (1e-3, "kN"), (1.0 / 9.80665, "kgf")]),
        "N m" => words(&[(1e3, "N mm"), (1e2, "N cm"), (1e-3, "kN m")]),
        "1" => words(&[(1e2, "per cent")]),
        _ => vec![(1e3, format!("thousandths of {unit}")), (1e-3, format!("thousands of {unit}"))],
    }
}

/// Looks for one column in a wrong unit.
pub fn check(model: &Model, train: &[Experiment]) -> Result<()> {
    let system = &model.compile_for(Vec::new(), Backend::Native);
    let Some(e) = train.iter().max_by(|a, b| energy(a).total_cmp(&energy(b))) else { return Ok(()) };
    let short = e.part(0, e.len().min(STRETCH));
    let Some(error) = error(system, &short)? else { return Ok(()) };
    if error < ASTRAY {
        return Ok(());
    }
    let mut guesses = Vec::new();
    let unit = |name: &str| model.unit(name).unwrap_or("1").to_string();
    for (j, name) in model.outputs().iter().enumerate() {
        for (factor, looks_like) in mistaken(&unit(name)) {
            guesses.push(Guess { output: Some(j), input: None, factor, looks_like });
        }
    }
    for (i, name) in model.inputs().iter().enumerate() {
        for (factor, looks_like) in mistaken(&unit(name)) {
            guesses.push(Guess { output: None, input: Some(i), factor, looks_like });
        }
    }
    guesses.push(Guess { output: None, input: None, factor: 1e3, looks_like: "ms".into() });
    let mut best: Option<(f64, &Guess)> = None;
    for guess in &guesses {
        // What ranges over so little in the model's own unit that the guess would be absurd still fails by its error.
        let Some(found) = self::error(system, &guess.corrected(&short)?)? else { continue };
        if best.is_none_or(|(b, _)| found < b) {
            best = Some((found, guess));
        }
    }
    if let Some((_, guess)) = best.filter(|(f, g)| *f < FOLLOWS && g.is_time())
        && e.inputs.count() > 0
        && self::error(system, &unforced(&guess.corrected(&short)?)?)?.is_some_and(|alone| alone < FOLLOWS)
    {
        // In a thousandth of the time a start with enough speed passes along any smooth course, whatever drives the machine.
        return Ok(());
    }
    let Some((found, guess)) = best.filter(|(f, _)| *f < FOLLOWS && *f < BETTER * error) else { return Ok(()) };
    // A machine that stumbles can be followed by chance for a while: a wrong unit is wrong later on too.
    if e.len() >= 2 * STRETCH {
        let later = e.part(STRETCH, 2 * STRETCH);
        if self::error(system, &guess.corrected(&later)?)?.is_some_and(|error| error >= FOLLOWS) {
            return Ok(());
        }
    }
    let (column, stated) = match (guess.output, guess.input) {
        (Some(j), _) => (format!("output `{}`", model.outputs()[j]), unit(model.outputs()[j])),
        (_, Some(i)) => (format!("input `{}`", model.inputs()[i]), unit(model.inputs()[i])),
        _ => ("time".into(), "s".into()),
    };
    Err(Error::Data {
        what: format!("{column} of `{}`", e.name),
        message: format!(
            "it looks like {} and is taken for {stated}: divided by {} it follows the stated model (error over motion {} instead \
             of {}); convert the column",
            guess.looks_like,
            number(guess.factor),
            number(found),
            number(error)
        ),
    })
}

/// An experiment without what drives it.
fn unforced(e: &Experiment) -> Result<Experiment> {
    let columns: Vec<Vec<f64>> = (0..e.inputs.count()).map(|i| vec![0.0; super::input(e, i).len()]).collect();
    let mut out = e.clone();
    out.inputs = Inputs::samples(e.t0, e.dt, &columns, Hold::ZeroOrder)?;
    Ok(out)
}

impl Guess {
    fn is_time(&self) -> bool {
        self.output.is_none() && self.input.is_none()
    }

    /// The stretch as it would be in the model's unit.
    fn corrected(&self, e: &Experiment) -> Result<Experiment> {
        let mut out = e.clone();
        let ny = e.outputs();
        match (self.output, self.input) {
            (Some(j), _) => out.y.iter_mut().skip(j).step_by(ny).for_each(|v| *v /= self.factor),
            (None, which) => {
                let scale = |i: usize| if which == Some(i) { 1.0 / self.factor } else { 1.0 };
                let columns: Vec<Vec<f64>> = (0..e.inputs.count())
                    .map(|i| super::input(e, i).into_iter().map(|v| v * scale(i)).collect())
                    .collect();
                if which.is_none() {
                    out.t0 /= self.factor;
                    out.dt /= self.factor;
                }
                let hold = if e.inputs.jumps() { Hold::ZeroOrder } else { Hold::FirstOrder };
                out.inputs = Inputs::samples(out.t0, out.dt, &columns, hold)?;
            }
        }
        Ok(out)
    }
}

fn energy(e: &Experiment) -> f64 {
    (0..e.outputs()).map(|j| stats::std(e.output(j).take(STRETCH))).filter(|s| s.is_finite()).sum()
}

/// Error over motion of the worst output when the stated model runs freely from the best initial state; infinite where it
/// cannot, `None` where there is nothing to compare.
fn error(system: &Compiled, e: &Experiment) -> Result<Option<f64>> {
    let cancelled = AtomicBool::new(false);
    let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
    let spread: Vec<f64> = (0..e.outputs()).map(|j| stats::std(e.output(j))).collect();
    if spread.iter().all(|s| s.is_nan() || *s == 0.0) {
        return Ok(None);
    }
    let sigma: Vec<f64> = spread.iter().map(|s| if *s > 0.0 { *s } else { 1.0 }).collect();
    let start = seen(system, e);
    let size = sigma.iter().copied().fold(0.0, f64::max).max(start.iter().fold(0.0, |m: f64, v| m.max(v.abs())));
    // States that are not seen may be far from the document's: a wide prior, and faster motion for faster sampling.
    let scale = vec![size.max(1e-9) * (1.0 + 1.0 / (20.0 * e.dt)); start.len()];
    let stated = system.parameters();
    let subject = Subject { system, priors: &[], still: Some(stated), extra: &[] };
    let ground = Ground {
        experiments: std::slice::from_ref(e),
        sigma: &sigma,
        substeps: 1,
        state_scale: &scale,
        control: &control,
    };
    let from = Point { theta: Vec::new(), x0: vec![start.clone()] };
    let Some(fitted) = fit::stage(&subject, ground, &from, &[start], None, EFFORT) else {
        return Ok(Some(f64::INFINITY));
    };
    let run = Run {
        system,
        p: stated,
        x0: &fitted.point.x0[0],
        experiment: e,
        substeps: 1,
        observer: None,
        control: &control,
    };
    let Some(y) = run.outputs() else { return Ok(Some(f64::INFINITY)) };
    let ny = e.outputs();
    let of = |j: usize| stats::rms(y.iter().zip(&e.y).skip(j).step_by(ny).map(|(y, m)| y - m)) / spread[j];
    // The worst output: one that is astray must not hide behind others that are not.
    Ok(Some((0..ny).map(of).filter(|v| v.is_finite()).fold(0.0, f64::max)))
}

/// The document's initial state, with what outputs show of it set to the first measurement.
fn seen(system: &Compiled, e: &Experiment) -> Vec<f64> {
    let (nx, ny) = (system.states(), e.outputs());
    let mut x = system.initial_state();
    let mut u = vec![0.0; system.inputs()];
    e.inputs.eval(e.inputs.interval(e.t0 + 1e-6 * e.dt), e.t0, &mut u);
    let mut jacobian = vec![0.0; ny * (1 + nx + system.free().len())];
    for j in 0..ny {
        let at = model::Point { t: e.t0, x: &x, u: &u, p: system.parameters() };
        system.output_jacobian(system.initial_mode(), at, &mut jacobian);
        let Some(measured) = e.output(j).find(|v| v.is_finite()) else { continue };
        let row = &jacobian[ny + j * nx..ny + (j + 1) * nx];
        let power: f64 = row.iter().map(|c| c * c).sum();
        if power > 1e-12 {
            let move_by = (measured - jacobian[j]) / power;
            x.iter_mut().zip(row).for_each(|(x, c)| *x += move_by * c);
        }
    }
    x
}
