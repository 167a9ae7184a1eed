//! What the records of a machine show beside those of the nominal one, and what of it simpler explanations take up.

use super::Planted;
use super::machine::Machine;
use super::setups::{Setup, Take};
use super::trace::{Bench, Meeting};
use crate::error::Result;
use crate::model::Model;
use crate::numeric::stats;

/// Weight of a change in a trace: so fine that what parameters and starts can take up, they do.
const FINE: f64 = 1e-4;
/// An effect of which the nominal parameters remove all but this share (of the rms) is imitated.
pub const IMITATED: f64 = 2e-3;
/// Records: how many of the takes are for training.
pub const TRAIN: usize = 2;

/// What the records of a machine show, and how they differ from the nominal machine along the same inputs.
pub struct Shown {
    /// The machine's records.
    pub takes: Vec<Take>,
    /// Outputs of the nominal machine along the same inputs.
    nominal: Vec<Vec<f64>>,
    /// Where it starts.
    starts: Vec<Vec<f64>>,
}

impl Shown {
    /// Records of a machine with effects.
    ///
    /// # Errors
    /// When it or the nominal machine does not run.
    pub fn new(setup: &Setup, model: &Model, planted: &[Planted], plain: &[Take], records: usize) -> Result<Self> {
        let machine = Machine::new(model, planted)?;
        let bare = Machine::new(model, &[])?;
        let mut out = Self { takes: Vec::new(), nominal: Vec::new(), starts: Vec::new() };
        for r in 0..records {
            let take = setup.take(model, &machine, r)?;
            out.starts.push(plain[r].motion.start.clone());
            out.nominal.push(if setup.looped {
                setup.replay(&bare, &take.wave, &plain[r].motion.start)?.outputs
            } else {
                plain[r].motion.outputs.clone()
            });
            out.takes.push(take);
        }
        Ok(out)
    }

    /// rms change of an output over the records for training, and the spread of its motion.
    pub fn change(&self, j: usize, ny: usize, plain: &[Take]) -> (f64, f64) {
        let k = TRAIN.min(self.takes.len());
        let differences = (0..k).flat_map(|r| {
            let (a, b) = (&self.takes[r].motion.outputs, &self.nominal[r]);
            a.iter().zip(b).skip(j).step_by(ny).map(|(a, b)| a - b).collect::<Vec<_>>()
        });
        (stats::rms(differences), stats::std(plain[0].motion.outputs.iter().skip(j).step_by(ny).copied()))
    }

    /// The records for training, as the nominal machine meets them.
    pub fn meetings(&self) -> Vec<Meeting<'_>> {
        let k = TRAIN.min(self.takes.len());
        (0..k)
            .map(|r| Meeting {
                wave: &self.takes[r].wave,
                outputs: &self.takes[r].motion.outputs,
                start: self.starts[r].clone(),
            })
            .collect()
    }

    /// What the nominal parameters cannot imitate, in units of `size` by output: its rms over that of the change, its
    /// rms, its sum of squares. With a rival, what that one cannot imitate together with them.
    ///
    /// # Errors
    /// When the nominal machine does not run along the records.
    pub fn unlike(
        &self,
        setup: &Setup,
        model: &Model,
        rival: Option<Planted>,
        size: &[f64],
        steps: usize,
    ) -> Result<(f64, f64, f64)> {
        let meetings = self.meetings();
        let fine: Vec<f64> = size.iter().map(|s| FINE * s).collect();
        let (left, whole) =
            Bench { setup, records: &meetings, sigma: &fine }.left(model, rival, steps, IMITATED * IMITATED)?;
        let count = meetings.iter().map(|m| m.outputs.len()).sum::<usize>() as f64;
        Ok(((left / whole.max(f64::MIN_POSITIVE)).sqrt(), FINE * (left / count).sqrt(), FINE * FINE * left))
    }
}

/// The simpler law that an effect becomes when what sets it apart is small, about as large.
pub fn simpler(e: &Planted, setup: &Setup, nominal: &Model) -> Option<Planted> {
    let leg = || nominal.parameter("k").ok().map(|i| nominal.parameters()[i].value);
    let stiffness = if setup.model == "hopper" { leg() } else { None };
    let value = |name: &str| e.parameters.iter().find(|(n, _)| n == name).map(|(_, v)| *v);
    let (name, parameter, value) = match e.name.as_str() {
        "stribeck_friction" => ("coulomb_friction", "force", value("force")?),
        "hysteresis" => ("coulomb_friction", "force", value("stiffness")? * value("yield_displacement")?),
        "flexible_mode" => ("added_mass", "mass", value("mass")?),
        // The hopper's leg is short or long for whole phases: a gap that is passed in no time is a force in each.
        "backlash" => ("constant_force", "force", 0.5 * stiffness? * value("gap")?),
        "input_lag" => ("input_delay", "delay", value("time_constant")?),
        "output_lag" => ("output_delay", "delay", value("time_constant")?),
        _ => return None,
    };
    Some(Planted { name: name.into(), at: e.at.clone(), parameters: vec![(parameter.into(), value)] })
}
