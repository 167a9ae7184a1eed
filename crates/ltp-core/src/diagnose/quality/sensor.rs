//! Sensors at their end (clipped plateaus) and sensors of few steps (quantised outputs).

use super::super::experiment::Experiment;
use super::super::words::{number, quantity};
use crate::error::{Error, Result};
use crate::model::{Backend, Model, Point, System};
use crate::numeric::stats;

/// Samples in a row at one extreme that are a plateau, not a turning point.
const PLATEAU: usize = 4;
/// A plateau is cut off, not reached at leisure, when the signal runs into it at this share of its speed while it moves. (A
/// sine that is cut at nine tenths of its amplitude does at 0.62.)
const ABRUPT: f64 = 0.6;
/// Share of clipped samples worth a warning.
const SOME: f64 = 0.005;
/// Share of clipped samples that leaves too little to see.
const MOST: f64 = 0.4;
/// Steps over the range of an output below which a reader must be told.
const COARSE: f64 = 200.0;
/// Distinct levels beyond which a signal counts as continuous for the purpose of finding its step.
const LEVELS: usize = 20_000;

/// Rows of one output at which its sensor is at its end: plateaus exactly at the largest or smallest value, into which the
/// signal runs at speed. A machine that comes to rest, even at an extreme, arrives slowly and is not meant.
fn clipped(y: &[f64]) -> Vec<usize> {
    let finite = y.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if high <= low {
        return Vec::new();
    }
    // Speeds over three samples: a single difference is mostly noise, or a step of the sensor.
    const BASE: usize = 3;
    // What stands still for most of a record is slow on average and fast where it moves.
    let speed = stats::rms(y.windows(BASE + 1).map(|w| w[BASE] - w[0]).filter(|v| v.is_finite() && *v != 0.0));
    let mut rows = Vec::new();
    for end in [low, high] {
        let (mut plateaus, mut arrivals) = (Vec::new(), Vec::new());
        let mut k = 0;
        while k < y.len() {
            let run = y[k..].iter().take_while(|v| **v == end).count();
            if run >= PLATEAU {
                plateaus.push(k..k + run);
                let outside = [k.checked_sub(BASE), Some(k + run + BASE - 1).filter(|&i| i < y.len())];
                arrivals.extend(outside.into_iter().flatten().map(|i| (y[i] - end).abs()).filter(|v| v.is_finite()));
            }
            k += run.max(1);
        }
        // Of a shaft that dry friction holds for most of the record, one step of the encoder is many times the usual speed.
        if stats::median(&arrivals) > (ABRUPT * speed).max(2.5 * step(y)) {
            rows.extend(plateaus.into_iter().flatten());
        }
    }
    rows.sort_unstable();
    rows
}

/// Which outputs a mode of the model holds still, as the ground holds a toe: they stop at an extreme without any sensor's fault.
fn rests(model: &Model) -> Vec<bool> {
    let system = model.compile_for(Vec::new(), Backend::Plain);
    let (nx, ny) = (system.states(), system.outputs());
    // Away from rest, where a rate that vanishes does so for every state.
    let x: Vec<f64> = system.initial_state().iter().map(|x| x + 0.1 * (1.0 + x.abs())).collect();
    let u = vec![0.0; system.inputs()];
    let at = Point { t: 0.0, x: &x, u: &u, p: system.parameters() };
    let mut out = vec![false; ny];
    if model.modes().len() < 2 {
        return out;
    }
    let (mut rates, mut jacobian) = (vec![0.0; nx], vec![0.0; ny * (1 + nx)]);
    for mode in model.modes().iter().filter_map(|m| model.mode(m).ok()) {
        system.flow(mode, at, &mut rates);
        system.output_jacobian(mode, at, &mut jacobian);
        for (j, held) in out.iter_mut().enumerate() {
            let row = &jacobian[ny + j * nx..ny + (j + 1) * nx];
            *held |= row.iter().any(|c| *c != 0.0) && row.iter().zip(&rates).all(|(c, f)| c * f == 0.0);
        }
    }
    out
}

/// Step of a quantised output: the one distance of which all distances between its levels are multiples; 0 where it has none.
fn step(y: &[f64]) -> f64 {
    let mut levels: Vec<f64> = y.iter().copied().filter(|v| v.is_finite()).collect();
    let samples = levels.len();
    levels.sort_unstable_by(f64::total_cmp);
    levels.dedup();
    // A continuous signal repeats no value; a quantised one is full of repetitions.
    if levels.len() < 2 || levels.len() > LEVELS || 2 * levels.len() > samples {
        return 0.0;
    }
    let range = levels[levels.len() - 1] - levels[0];
    let rounding = 1e-9 * range.max(levels[0].abs()).max(levels[levels.len() - 1].abs());
    let gaps: Vec<f64> = levels.windows(2).map(|w| w[1] - w[0]).filter(|g| *g > rounding).collect();
    let smallest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
    let whole = |g: &&f64| (*g / smallest - (*g / smallest).round()).abs() < 0.05;
    let share = gaps.iter().filter(whole).count() as f64 / gaps.len().max(1) as f64;
    if smallest.is_finite() && share > 0.95 { smallest } else { 0.0 }
}

/// Noise that the steps of each output's sensor make, one standard deviation: step over the square root of 12, in the
/// output's unit; 0 for an output that is not quantised. A noise floor can be no lower.
pub fn quantisation(train: &[Experiment]) -> Vec<f64> {
    let steps = |j: usize| train.iter().map(|e| step(&e.output(j).collect::<Vec<_>>())).fold(0.0, f64::max);
    (0..train[0].outputs()).map(|j| steps(j) / 12.0_f64.sqrt()).collect()
}

/// Makes gaps of the samples at which a sensor is at its end: they say only that the truth is beyond. Returns the number of
/// samples that became gaps.
pub fn clipped_to_gaps(model: &Model, experiments: &mut [Experiment]) -> usize {
    let (mut count, rests) = (0, rests(model));
    for e in experiments {
        let ny = e.outputs();
        for j in (0..ny).filter(|j| !rests[*j]) {
            let y: Vec<f64> = e.output(j).collect();
            for k in clipped(&y) {
                e.y[k * ny + j] = f64::NAN;
                count += 1;
            }
        }
    }
    count
}

/// Ends and steps of the sensors of all outputs.
pub fn check(model: &Model, train: &[Experiment], test: &[Experiment], warnings: &mut Vec<String>) -> Result<()> {
    let rests = rests(model);
    for (j, name) in model.outputs().iter().enumerate().filter(|(j, _)| !rests[*j]) {
        let unit = model.unit(name).unwrap_or("1");
        for e in train.iter().chain(test) {
            let y: Vec<f64> = e.output(j).collect();
            let rows = clipped(&y);
            let share = rows.len() as f64 / y.iter().filter(|v| v.is_finite()).count().max(1) as f64;
            let Some(&first) = rows.first().filter(|_| share > SOME) else { continue };
            let at = quantity(y[first], unit);
            let facts = format!("{} % of its samples are exactly at an end of its range ({at})", number(100.0 * share));
            if share > MOST {
                return Err(Error::Data {
                    what: format!("output `{name}` of `{}`", e.name),
                    message: format!(
                        "the sensor is saturated: {facts}, and it runs into them at speed; what is beyond cannot be recovered: \
                         widen its range or drive less"
                    ),
                });
            }
            warnings.push(format!(
                "output `{name}` of `{}`: {facts}; the sensor is saturated there, or the machine is against a stop",
                e.name
            ));
        }
    }
    for ((j, name), floor) in model.outputs().iter().enumerate().zip(quantisation(train)) {
        let step = floor * 12.0_f64.sqrt();
        let values: Vec<f64> = train.iter().flat_map(|e| e.output(j)).collect();
        let range = stats::quantile(&values, 1.0) - stats::quantile(&values, 0.0);
        if step > 0.0 && range / step < COARSE {
            let unit = model.unit(name).unwrap_or("1");
            warnings.push(format!(
                "output `{name}` is quantised in steps of {}: {} steps over its whole range; its noise is at least step/sqrt(12) \
                 = {}",
                quantity(step, unit),
                number((range / step).round()),
                quantity(floor, unit)
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize) -> Vec<f64> {
        (0..n).map(|k| (0.05 * k as f64).sin() + 0.4 * (0.13 * k as f64).cos()).collect()
    }

    #[test]
    fn a_cut_wave_is_clipped_and_a_machine_at_rest_is_not() {
        let whole = wave(1000);
        assert!(clipped(&whole).is_empty());
        let cut: Vec<f64> = whole.iter().map(|v| v.clamp(-0.8, 0.8)).collect();
        // A plateau that is reached slowly may as well be a turning point, and is left.
        let beyond = whole.iter().filter(|v| v.abs() >= 0.8).count();
        let found = clipped(&cut);
        assert!(found.iter().all(|k| whole[*k].abs() >= 0.8));
        assert!(found.len() > beyond * 9 / 10, "{} of {beyond}", found.len());
        // From rest at one end to rest at the other, as a carriage under a smooth profile, read by an encoder.
        let carriage: Vec<f64> = (0..2000)
            .map(|k| {
                let s = ((k as f64 / 500.0) % 2.0 - 0.5).clamp(0.0, 1.0);
                ((s - (std::f64::consts::TAU * s).sin() / std::f64::consts::TAU) * 1e4).round() / 1e4
            })
            .collect();
        assert!(clipped(&carriage).is_empty());
    }

    #[test]
    fn a_toe_on_the_ground_is_no_saturated_sensor() {
        let hopper = crate::model::zoo("hopper").unwrap();
        let held: Vec<&str> =
            hopper.outputs().into_iter().zip(rests(&hopper)).filter(|(_, r)| *r).map(|(o, _)| o).collect();
        assert!(!held.contains(&"h"), "{held:?}");
        assert!(held.contains(&"ht") || !hopper.outputs().contains(&"ht"), "{held:?}");
        assert!(rests(&crate::model::zoo("drive").unwrap()).iter().all(|r| !r));
    }

    #[test]
    fn steps_are_found_and_a_continuous_signal_has_none() {
        let whole = wave(1000);
        assert_eq!(step(&whole), 0.0);
        let coarse: Vec<f64> = whole.iter().map(|v| (v / 0.01).round() * 0.01).collect();
        assert!((step(&coarse) - 0.01).abs() < 1e-12);
        assert_eq!(step(&[1.0; 20]), 0.0);
    }
}
