//! Quality of the data, before any fit: hopeless recordings end in a sentence that says what is wrong or missing, doubtful
//! ones in a warning.
//!
//! `sensor` sees ends and steps of a sensor, `scale` a wrong unit, `shorten` cuts what is too long to be fitted whole. Every
//! check looks at the samples alone, except that of units, which runs the stated model along a short stretch.

mod scale;
mod sensor;
mod shorten;

pub use sensor::{clipped_to_gaps, quantisation};
pub use shorten::{LONGEST, shorten};

use super::experiment::Experiment;
use super::words::number;
use crate::error::{Error, Result};
use crate::model::{Model, System};
use crate::numeric::{spectrum, stats};

/// Samples per unknown below which nothing can be fitted.
const HOPELESS: usize = 2;
/// Samples per unknown below which intervals are wide.
const THIN: usize = 10;
/// Periods of the clock below which what repeats cannot be told from how it started.
const FEWEST_PERIODS: f64 = 1.5;
/// Periods of the clock below which there is little to average over.
const FEW_PERIODS: f64 = 4.0;
/// A line of white noise exceeds its mean by `ln(lines)` plus this once in e^12 records.
const LUCK: f64 = 12.0;
/// Relative difference of sampling steps that is more than rounding.
const UNEQUAL: f64 = 1e-3;
/// Error over motion at which a constant would predict as well.
const NOTHING_EXPLAINED: f64 = 0.9;

/// Looks at recordings before any fit. The result are doubts, in sentences.
///
/// # Errors
/// [`Error::Data`] when nothing moves, a sensor is at its end most of the time, a unit is wrong, or a held-out record is one
/// of the train records; [`Error::TooShort`] with fewer samples than unknowns can be found from, or less than about one
/// period of the model's clock.
pub fn check(model: &Model, train: &[Experiment], test: &[Experiment]) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    let system = model.compile();
    alive(model, train)?;
    length(model, &system, train, &mut warnings)?;
    leaks(train, test, &mut warnings)?;
    sampling(train, test, &mut warnings);
    sensor::check(model, train, test, &mut warnings)?;
    scale::check(model, train)?;
    Ok(warnings)
}

/// Whether nothing that the model and its refit can do explains any output of any train record: a record of another
/// machine, or inputs and outputs that do not belong together. To be called after the refit of the nominal model, with the
/// residuals of whatever else was fitted since in `others`; all residuals (n, ny) in units of the noise `sigma`.
pub fn stranger(
    model: &Model,
    train: &[Experiment],
    sigma: &[f64],
    nominal: &[Vec<f64>],
    others: &[&[Vec<f64>]],
) -> Option<Error> {
    let least = |residuals: &[Vec<f64>]| {
        let mut least = f64::INFINITY;
        for (e, r) in train.iter().zip(residuals) {
            for (j, s) in sigma.iter().enumerate() {
                let motion = stats::std(e.output(j)) / s;
                let error = stats::rms(r.iter().skip(j).step_by(sigma.len()).copied());
                // An output that is noise cannot be explained, and is no evidence.
                if motion > 3.0 && error.is_finite() {
                    least = least.min(error / motion);
                }
            }
        }
        least
    };
    let best = others.iter().map(|r| least(r)).fold(least(nominal), f64::min);
    (best.is_finite() && best > NOTHING_EXPLAINED).then(|| {
        let names: Vec<String> = train.iter().map(|e| format!("`{}`", e.name)).collect();
        Error::Data {
            what: names.join(", "),
            message: format!(
                "`{}` explains nothing of what was measured: after its parameters were refitted the error is still {} times \
                 the motion, for the best output of the best record; check that the recording is of this machine, that \
                 columns have their right names and signs, and that inputs and outputs share one clock",
                model.name(),
                number(best)
            ),
        }
    })
}

/// At least one output of one train record must move.
fn alive(model: &Model, train: &[Experiment]) -> Result<()> {
    let mut found = Vec::new();
    for e in train {
        for (j, name) in model.outputs().iter().enumerate() {
            let y: Vec<f64> = e.output(j).collect();
            let spread = stats::std(y.iter().copied());
            if spread.is_nan() {
                continue;
            }
            if spread > 0.0 && !is_noise(&y) {
                return Ok(());
            }
            let unit = model.unit(name).unwrap_or("1");
            found.push(if spread > 0.0 {
                format!("`{name}` of `{}` is white noise of {} {unit}", e.name, number(spread))
            } else {
                format!("`{name}` of `{}` is constant", e.name)
            });
        }
    }
    let still = (0..model.inputs().len()).all(|i| train.iter().all(|e| input_spread(e, i) == 0.0));
    let advice = match (model.inputs().is_empty(), still) {
        (true, _) => "start from a state that moves",
        (false, true) => {
            "no input changes either: drive the system with a multisine or steps that stand above the noise"
        }
        (false, false) => "although the input does: check the sensor and its column, or drive harder",
    };
    found.truncate(4);
    Err(Error::Data {
        what: "train recordings".into(),
        message: format!("nothing moves: {}; {advice}", found.join(", ")),
    })
}

/// Whether a series is indistinguishable from white noise about a constant: no line of its spectrum stands out.
fn is_noise(y: &[f64]) -> bool {
    let Some(run) = stats::finite_runs(y.iter().copied()).into_iter().max_by_key(std::ops::Range::len) else {
        return true;
    };
    if run.len() < 32 {
        return false;
    }
    let mean = stats::mean(y[run.clone()].iter().copied());
    let centred: Vec<f64> = y[run].iter().map(|v| v - mean).collect();
    let floor = spectrum::noise_floor(&centred);
    let lines = spectrum::periodogram(&centred);
    let limit = floor * floor * ((lines.len() as f64).ln() + LUCK);
    floor > 0.0 && lines.iter().skip(1).all(|p| *p <= limit)
}

/// Standard deviation of an input at the samples of a record.
fn input_spread(e: &Experiment, i: usize) -> f64 {
    stats::std(input(e, i))
}

/// Input `i` at the samples of a record (n).
pub fn input(e: &Experiment, i: usize) -> Vec<f64> {
    let mut u = vec![0.0; e.inputs.count()];
    (0..e.len())
        .map(|k| {
            let t = e.t0 + k as f64 * e.dt;
            e.inputs.eval(e.inputs.interval(t + 1e-6 * e.dt), t, &mut u);
            u[i]
        })
        .collect()
}

/// Enough samples for the unknowns, enough periods of the clock.
fn length(model: &Model, system: &dyn System, train: &[Experiment], warnings: &mut Vec<String>) -> Result<()> {
    let unknowns = system.free().len() + train.len() * system.states();
    let found = train.iter().flat_map(|e| &e.y).filter(|v| v.is_finite()).count();
    if found < HOPELESS * unknowns {
        let what = format!(
            "train recordings for {} uncertain parameters and {} initial states of `{}`",
            system.free().len(),
            train.len() * system.states(),
            model.name()
        );
        return Err(Error::TooShort { what, needed: HOPELESS * unknowns, found });
    }
    if found < THIN * unknowns {
        warnings.push(format!(
            "{found} samples for {unknowns} unknowns (parameters and initial states): intervals will be wide, and little can be \
             told apart; record longer"
        ));
    }
    let longest = train.iter().map(|e| e.len() as f64 * e.dt).fold(0.0, f64::max);
    if let Some(period) = system.period(system.parameters()) {
        let periods = longest / period;
        if periods < FEWEST_PERIODS {
            return Err(Error::Data {
                what: "train recordings".into(),
                message: format!(
                    "the longest covers {} periods of the clock of `{}` (T = {} s): what repeats cannot be told from how it \
                     started; record at least {FEW_PERIODS} periods",
                    number(periods),
                    model.name(),
                    number(period)
                ),
            });
        }
        if periods < FEW_PERIODS {
            warnings.push(format!(
                "the longest train record covers {} periods of the clock (T = {} s); a dozen would say more",
                number(periods),
                number(period)
            ));
        }
    }
    Ok(())
}

/// A record that is in two places at once judges itself.
fn leaks(train: &[Experiment], test: &[Experiment], warnings: &mut Vec<String>) -> Result<()> {
    for held in test {
        for e in train {
            if let Some(at) = contained(held, e).or_else(|| contained(e, held)) {
                let where_ = if at == 0 { String::new() } else { format!(", from sample {at} on") };
                return Err(Error::Data {
                    what: format!("held-out recording `{}`", held.name),
                    message: format!(
                        "its samples are those of the train recording `{}`{where_}: what was fitted cannot judge the fit; give \
                         a record of its own, or none (then the end of every train record is held out)",
                        e.name
                    ),
                });
            }
        }
    }
    for (k, e) in train.iter().enumerate() {
        for other in &train[..k] {
            if contained(e, other).or_else(|| contained(other, e)).is_some() {
                warnings.push(format!(
                    "train recordings `{}` and `{}` hold the same samples: they are counted twice, and intervals are too narrow",
                    other.name, e.name
                ));
            }
        }
    }
    Ok(())
}

/// The sample at which the outputs of `part` stand in `whole`, bit for bit; `None` where they do not, or do not move.
fn contained(part: &Experiment, whole: &Experiment) -> Option<usize> {
    let ny = part.outputs();
    if part.len() > whole.len() || part.len() < 16 || whole.outputs() != ny {
        return None;
    }
    let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
    let changes = |y: &[f64]| y.chunks(ny).zip(y.chunks(ny).skip(1)).filter(|(a, b)| a != b).count();
    // Records at rest are alike without being the same.
    if changes(&part.y) < part.len() / 2 {
        return None;
    }
    // A row in the middle, rare enough to look for.
    let probe = (part.len() / 2) * ny;
    (0..=whole.len() - part.len()).find(|&at| {
        let shifted = &whole.y[at * ny..(at + part.len()) * ny];
        same(shifted[probe], part.y[probe]) && shifted.iter().zip(&part.y).all(|(a, b)| same(*a, *b))
    })
}

fn sampling(train: &[Experiment], test: &[Experiment], warnings: &mut Vec<String>) {
    let first = &train[0];
    for e in train.iter().chain(test).filter(|e| (e.dt / first.dt - 1.0).abs() > UNEQUAL) {
        warnings.push(format!(
            "recording `{}` is sampled every {} s, `{}` every {} s: noise floors and the colour of residuals are judged per \
             sample, so resample them alike if you can",
            e.name,
            number(e.dt),
            first.name,
            number(first.dt)
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::zoo;
    use crate::simulate::Inputs;

    #[test]
    fn a_record_of_another_machine_is_a_stranger() {
        let model = zoo("drive").unwrap();
        let mut e = Experiment::planned("run", (0.0, 0.01), 500, 1, Inputs::constant(&[0.0]));
        e.y = (0..500).map(|k| (0.02 * f64::from(k)).sin()).collect();
        let train = [e.clone()];
        let residual = |share: f64| vec![e.y.iter().map(|y| share * y / 1e-3).collect::<Vec<f64>>()];
        let all = stranger(&model, &train, &[1e-3], &residual(1.1), &[]);
        assert!(all.unwrap().to_string().contains("explains nothing"));
        assert!(stranger(&model, &train, &[1e-3], &residual(0.5), &[]).is_none());
        // An effect that explains it makes it no stranger.
        assert!(stranger(&model, &train, &[1e-3], &residual(1.1), &[&residual(0.1)]).is_none());
        // Motion at the noise level is no evidence.
        assert!(stranger(&model, &train, &[0.5], &residual(1.1), &[]).is_none());
    }
}
