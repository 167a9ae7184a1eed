//! Natural sizes at the places where effects act: what their parameters are scaled by.

use super::experiment::Experiment;
use super::prepare::Scene;
use super::result::Force;
use crate::model::effects;
use crate::numeric::stats;

/// Natural sizes at one place, in SI units.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Force at a port.
    pub force: f64,
    /// Velocity at a port.
    pub velocity: f64,
    /// Position at a port.
    pub position: f64,
    /// Way at a port from end to end.
    pub travel: f64,
    /// Time in which the motion changes.
    pub time: f64,
    /// Input.
    pub input: f64,
    /// Output.
    pub output: f64,
    /// Value or uncertainty of a parameter.
    pub value: f64,
}

impl Sizes {
    /// Sizes where nothing but the speed of the motion is known.
    pub fn new(scene: &Scene) -> Self {
        let time = 1.0 / positive(scene.speed);
        Self { force: 1.0, velocity: 1.0, position: 1.0, travel: 1.0, time, input: 1.0, output: 1.0, value: 1.0 }
    }

    /// Sizes at a port, from what its force and motion did.
    pub fn at_port(forces: &[Force], scene: &Scene) -> Self {
        let all = |of: &dyn Fn(&Force) -> &Vec<f64>| stats::rms(forces.iter().flat_map(|f| of(f).iter().copied()));
        let velocity = forces.iter().flat_map(|f| f.velocity.iter()).fold(0.0_f64, |m, v| m.max(v.abs()));
        // How far it moves, wherever it is.
        let position = stats::std(forces.iter().flat_map(|f| f.position.iter().copied()));
        let ends = forces
            .iter()
            .flat_map(|f| &f.position)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(*q), b.max(*q)));
        let time = position / all(&|f| &f.velocity);
        let plain = Self::new(scene);
        Self {
            force: positive(all(&|f| &f.force)),
            velocity: positive(velocity),
            position: positive(position),
            travel: positive(ends.1 - ends.0),
            time: if time > 0.0 && time.is_finite() { time } else { plain.time },
            ..plain
        }
    }

    /// Sizes of an input (largest value along the records).
    pub fn of_input(values: impl Iterator<Item = f64>, scene: &Scene) -> Self {
        Self { input: positive(values.fold(0.0, |m, v| v.abs().max(m))), ..Self::new(scene) }
    }

    /// Sizes of an output: how far it moves.
    pub fn of_output(records: &[Experiment], j: usize, scene: &Scene) -> Self {
        Self { output: positive(stats::std(records.iter().flat_map(|e| e.output(j)))), ..Self::new(scene) }
    }

    /// Size of a quantity given in words, such as `force/velocity^2`; one where there are none.
    pub fn of(&self, words: &str) -> f64 {
        let size = |name: &str| match name {
            "force" => self.force,
            "velocity" => self.velocity,
            "position" => self.position,
            "time" => self.time,
            "input" => self.input,
            "output" => self.output,
            "value" => self.value,
            _ => 1.0,
        };
        effects::words(words).into_iter().map(|(name, power)| size(name).powf(power)).product()
    }
}

fn positive(v: f64) -> f64 {
    if v > 0.0 && v.is_finite() { v } else { 1.0 }
}
