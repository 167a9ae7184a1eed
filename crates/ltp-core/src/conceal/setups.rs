//! How each machine is excited and recorded: inputs, lengths, controllers, and the check that it moves as it should.

use std::ops::RangeInclusive;

use super::machine::{Machine, Wave};
use super::truth::{Feedback, Motion, Run, TOLERANCE, run};
use crate::error::{Error, Result, nearest};
use crate::model::Model;
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;

/// Machines that cases are drawn from.
pub const SYSTEMS: [&str; 6] = ["cart_pendulum", "pendulum", "duffing", "two_mass", "drive", "hopper"];

/// Amplitudes of the records: two to train, one held out.
const AMPLITUDES: [f64; 3] = [1.0, 0.4, 0.7];
/// Clock periods in which the hopper settles before a record; a start is fitted, so a rest of it does no harm.
const SETTLING: usize = 15;
/// Proportional and derivative gain of the loop around the drive, N/m and N s/m.
const LOOP: (f64, f64) = (6000.0, 1000.0);

/// An experiment with a machine.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Zoo model.
    pub model: &'static str,
    /// Distance of samples, s.
    pub dt: f64,
    /// Samples of each record.
    pub samples: usize,
    /// Samples before each record in which the motion settles.
    pub lead: usize,
    /// Start of the states before the lead; the document's where empty.
    x0: Vec<f64>,
    /// Inputs of each record; for the drive, the reference that its loop tracks.
    waves: Vec<Wave>,
    /// Whether the input arises in a loop around the machine.
    pub looped: bool,
    /// Period of an input that repeats, s.
    pub repeats: Option<f64>,
    /// Samples of a clock period in which the machine must leave the ground once.
    hop: Option<usize>,
}

/// What one record shows: the input as recorded, and the motion.
pub struct Take {
    /// Input.
    pub wave: Wave,
    /// Motion.
    pub motion: Motion,
}

impl Setup {
    /// The experiment of a system; `repeated` makes its input repeat forty times and more.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn new(system: &str, repeated: bool, random: &mut SplitMix64) -> Result<Self> {
        let model = SYSTEMS.into_iter().find(|s| *s == system).ok_or_else(|| Error::UnknownName {
            kind: "system".into(),
            name: system.into(),
            nearest: nearest(system, SYSTEMS),
            context: "conceal".into(),
        })?;
        let tau = 2.0 * std::f64::consts::PI;
        // Step, samples, samples of a period of the input, last line, rms in the input's unit.
        let (dt, samples, period, lines, level) = match (model, repeated) {
            ("cart_pendulum", false) => (0.01, 1001, 600, 12, 4.0),
            ("cart_pendulum", true) => (0.02, 4000, 100, 8, 4.0),
            ("pendulum", false) => (0.01, 1501, 1500, 24, 0.15),
            ("pendulum", true) => (0.02, 8000, 200, 12, 0.15),
            ("duffing", false) => (0.04, 1501, 1500, 24, 0.4),
            ("duffing", true) => (tau / 1.2 / 64.0, 5120, 128, 6, 0.4),
            ("two_mass", false) => (0.005, 1601, 1600, 160, 0.5),
            ("two_mass", true) => (0.005, 8000, 200, 24, 0.5),
            ("drive", false) => (0.005, 2001, 0, 0, 0.4),
            ("drive", true) => (0.02, 8000, 200, 0, 0.4),
            (_, false) => (0.0025, 132 * (8 + random.below(5)) + 1, 264, 8, 1.6),
            (_, true) => (0.005, 66 * 80, 132, 6, 1.6),
        };
        let lead = match (model, repeated) {
            ("hopper", _) => SETTLING * if repeated { 66 } else { 132 },
            ("drive", _) | (_, false) => 0,
            (_, true) => 10 * period,
        };
        // Slow lines would turn both masses together by so much that their twist hides in the noise.
        let first = if model == "two_mass" && !repeated { 8 } else { 1 };
        let waves = AMPLITUDES
            .into_iter()
            .map(|a| match model {
                "drive" => trapezoid(samples, dt, a * level, if repeated { 4.0 } else { 5.0 }, random),
                _ => multisine(
                    (samples, if repeated { Some(period) } else { None }),
                    (dt, period),
                    (first..=lines, a * level),
                    random,
                ),
            })
            .collect();
        let repeats = (repeated && model != "drive").then_some(period as f64 * dt);
        let x0 = if model == "pendulum" { vec![0.0, 0.0] } else { Vec::new() };
        let hop = (model == "hopper").then_some(if repeated { 66 } else { 132 });
        Ok(Self { model, dt, samples, lead, x0, waves, looped: model == "drive", repeats, hop })
    }

    /// Number of records.
    pub fn records(&self) -> usize {
        self.waves.len()
    }

    /// Start of the states before the lead.
    fn start(&self, model: &Model) -> Vec<f64> {
        if self.x0.is_empty() { model.document().states.values().map(|s| s.value).collect() } else { self.x0.clone() }
    }

    /// Records a machine.
    ///
    /// # Errors
    /// [`Error::NoConvergence`] when its motion is none: it escapes, or a hopper does not hop.
    pub fn take(&self, nominal: &Model, machine: &Machine, record: usize) -> Result<Take> {
        let take = self.measure(nominal, machine, record)?;
        self.hops(&take.motion)?;
        Ok(take)
    }

    /// Records a machine, whatever its motion.
    ///
    /// # Errors
    /// [`Error::NoConvergence`] when its motion escapes.
    pub fn measure(&self, nominal: &Model, machine: &Machine, record: usize) -> Result<Take> {
        let x0 = self.start(nominal);
        let how = Run { x0: &x0, lead: self.lead, samples: self.samples, tolerance: TOLERANCE };
        let wave = &self.waves[record];
        if !self.looped {
            let mut wave = wave.clone();
            let motion = run(machine, &mut wave, &how, None)?;
            return Ok(Take { wave, motion });
        }
        // The controller looks at a sample and asks for a force at the next one; the amplifier goes there in a straight line.
        let mut driven = Wave { samples: vec![0.0], ..wave.clone() };
        let reference = |k: usize| wave.samples[k.min(wave.samples.len() - 1)];
        let dt = self.dt;
        let loops: Feedback<'_> = &mut |k, x| {
            let aim = (reference(k), (reference(k + 1) - reference(k)) / dt);
            vec![LOOP.0 * (aim.0 - x[0]) + LOOP.1 * (aim.1 - x[1])]
        };
        let motion = run(machine, &mut driven, &how, Some(loops))?;
        driven.samples.truncate(self.samples);
        Ok(Take { wave: driven, motion })
    }

    /// Runs a machine along a recorded input from a state at time zero.
    ///
    /// # Errors
    /// As [`Setup::take`].
    pub fn replay(&self, machine: &Machine, wave: &Wave, x0: &[f64]) -> Result<Motion> {
        let how = Run { x0, lead: 0, samples: self.samples, tolerance: TOLERANCE };
        run(machine, &mut wave.clone(), &how, None)
    }

    /// Whether a hopper leaves the ground in every period, near the height of the others.
    fn hops(&self, motion: &Motion) -> Result<()> {
        let Some(period) = self.hop else { return Ok(()) };
        let highest: Vec<f64> = motion
            .outputs
            .chunks(period)
            .filter(|c| c.len() == period)
            .map(|c| c.iter().copied().fold(0.0, f64::max))
            .collect();
        let middle = stats::median(&highest);
        let regular = highest.iter().all(|h| (h - middle).abs() < 0.02) && (0.26..0.33).contains(&middle);
        if regular {
            return Ok(());
        }
        Err(Error::NoConvergence {
            method: "hopping".into(),
            iterations: highest.len(),
            residual: middle,
            advice: "the hopper leaves its regular hop; take a smaller effect".into(),
        })
    }
}

/// A random-phase multisine. One that does not repeat begins smoothly from rest.
fn multisine(
    (samples, repeats): (usize, Option<usize>),
    (dt, period): (f64, usize),
    (lines, rms): (RangeInclusive<u32>, f64),
    random: &mut SplitMix64,
) -> Wave {
    let base = 2.0 * std::f64::consts::PI / (period as f64 * dt);
    let turn = 2.0 * std::f64::consts::PI;
    let phases: Vec<(u32, f64)> = lines.map(|k| (k, turn * random.uniform())).collect();
    let value = |t: f64| -> f64 {
        let sum: f64 = phases.iter().map(|(k, p)| (base * f64::from(*k) * t + p).sin()).sum();
        rms * sum * (2.0 / phases.len() as f64).sqrt()
    };
    let rise = 0.05 * samples as f64;
    let columns = (0..repeats.unwrap_or(samples)).map(|k| {
        let gate = if repeats.is_some() { 1.0 } else { (k as f64 / rise).min(1.0) };
        gate * value(k as f64 * dt)
    });
    let mut wave = Wave { dt, count: 1, samples: columns.collect(), periodic: repeats.is_some() };
    if repeats.is_some() {
        // Recorded over and over: what a logger writes is the same period again.
        let one = wave.samples.clone();
        wave.samples = (0..samples.div_ceil(one.len())).flat_map(|_| one.iter().copied()).collect();
    }
    wave
}

/// Positions of a carriage that goes out and back with trapezoidal speed and rests between, again and again.
fn trapezoid(samples: usize, dt: f64, speed: f64, period: f64, random: &mut SplitMix64) -> Wave {
    let stretch = 0.9 + 0.2 * random.uniform();
    let (rise, cruise, rest) = (0.12 * period * stretch, 0.16 * period * stretch, 0.05 * period);
    let leg = 2.0 * rise + cruise;
    let travelled = |s: f64| {
        let up = s.clamp(0.0, rise);
        let flat = (s - rise).clamp(0.0, cruise);
        let down = (s - rise - cruise).clamp(0.0, rise);
        speed * (up * up / (2.0 * rise) + flat + down - down * down / (2.0 * rise))
    };
    let position = |t: f64| {
        let s = t % period;
        travelled(s - rest) - travelled(s - 2.0 * rest - leg)
    };
    Wave { dt, count: 1, samples: (0..samples + 2).map(|k| position(k as f64 * dt)).collect(), periodic: false }
}
