//! What the demonstration conceals: one effect at a port of a smooth model, sized by the forces there.

use super::draw::off;
use super::strang::{Walker, motion};
use super::{Case, Label};
use crate::error::{Error, Result};
use crate::model::{Model, Point, zoo};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;
use crate::signal::Recording;
use crate::simulate::{Hold, Inputs};

/// What to conceal, and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Zoo model with inputs.
    pub model: String,
    /// Effect and port; drawn from the seed where `None`, nothing where the effect is `nothing`.
    pub effect: Option<(String, String)>,
    /// Size of the effect relative to the forces at its port.
    pub size: f64,
    /// rms change of the outputs by the effect over rms noise.
    pub snr: f64,
    /// Duration of each recording, s, and distance of samples, s.
    pub duration: (f64, f64),
    /// Amplitude of the train inputs, in units of the input.
    pub amplitude: f64,
    /// Seed.
    pub seed: u64,
}

impl Recipe {
    /// The cart-pendulum of the demo: ten seconds at 100 Hz, noise a hundredth of what the effect changes.
    pub fn demo(seed: u64) -> Self {
        Self {
            model: "cart_pendulum".into(),
            effect: None,
            size: 0.15,
            snr: 100.0,
            duration: (10.0, 0.01),
            amplitude: 4.0,
            seed,
        }
    }

    fn check(&self) -> Result<()> {
        let positive = |what: &str, found: f64, unit: &str| {
            if found > 0.0 && found < 1e6 {
                return Ok(());
            }
            let expected = format!("a positive number below 1e6{unit}");
            Err(Error::OutOfRange { what: what.into(), found, expected })
        };
        let (duration, dt) = self.duration;
        positive("size", self.size, "")?;
        positive("snr", self.snr, "")?;
        positive("amplitude", self.amplitude, " in the unit of the input")?;
        positive("duration", duration, " s")?;
        positive("dt", dt, " s")?;
        let samples = duration / dt;
        if !(64.0..=1e6).contains(&samples) {
            let expected = "between 64 and 1e6 samples; choose duration and dt accordingly".into();
            return Err(Error::OutOfRange { what: "duration/dt".into(), found: samples, expected });
        }
        Ok(())
    }
}

/// Draws a case.
///
/// # Errors
/// [`Error::UnknownName`] for a model, effect or port that does not exist.
pub fn conceal(recipe: &Recipe) -> Result<Case> {
    recipe.check()?;
    let nominal = zoo(&recipe.model)?;
    let mut random = SplitMix64::new(recipe.seed);
    let (duration, dt) = recipe.duration;
    let samples = (duration / dt).round() as usize + 1;
    // Laws of motion at a port; the rest of the vocabulary needs more than this integrator knows.
    let names: Vec<String> = nominal.library().names().take(7).map(String::from).collect();
    let ports: Vec<String> = nominal.ports().into_iter().map(String::from).collect();
    let drawn = (names[random.below(names.len())].clone(), ports[random.below(ports.len())].clone());
    let (effect, port) = recipe.effect.clone().unwrap_or(drawn);
    let excitation: Vec<Inputs> = [1.0, 0.4, 0.7]
        .into_iter()
        .map(|a| multisine(nominal.inputs().len(), samples, dt, a * recipe.amplitude, &mut random))
        .collect::<Result<_>>()?;
    let x0 = vec![0.0; nominal.states().len()];
    let clean: Vec<Vec<f64>> =
        excitation.iter().map(|u| motion(&nominal, u, &x0, samples, dt)).collect::<Result<_>>()?;

    let (truth, label) = if effect == "nothing" {
        (nominal.clone(), Label { effect, at: String::new(), parameters: Vec::new(), seed: recipe.seed })
    } else {
        let parameters = sized(&nominal, &effect, &port, recipe, &excitation[0], (samples, dt), &mut random)?;
        let borrowed: Vec<(&str, f64)> = parameters.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        (nominal.attach(&effect, &port, &borrowed)?, Label { effect, at: port, parameters, seed: recipe.seed })
    };
    let changed: Vec<Vec<f64>> =
        excitation.iter().map(|u| motion(&truth, u, &x0, samples, dt)).collect::<Result<_>>()?;
    let ny = nominal.outputs().len();
    let sigma: Vec<f64> = (0..ny)
        .map(|j| {
            let change = stats::rms(changed[0].iter().zip(&clean[0]).skip(j).step_by(ny).map(|(a, b)| a - b));
            let motion = stats::std(clean[0].iter().skip(j).step_by(ny).copied());
            if change > 0.0 { change / recipe.snr } else { 1e-2 * motion }
        })
        .collect();
    let record = |k: usize, name: &str, random: &mut SplitMix64| -> Result<Recording> {
        let t: Vec<f64> = (0..samples).map(|i| i as f64 * dt).collect();
        let mut u = vec![0.0; nominal.inputs().len()];
        let mut inputs = vec![Vec::with_capacity(samples); u.len()];
        for &t in &t {
            excitation[k].eval(excitation[k].interval(t + 1e-6 * dt), t, &mut u);
            inputs.iter_mut().zip(&u).for_each(|(column, u)| column.push(*u));
        }
        let outputs: Vec<Vec<f64>> = (0..ny)
            .map(|j| changed[k].iter().skip(j).step_by(ny).map(|y| y + sigma[j] * random.normal()).collect())
            .collect();
        let own = |names: Vec<&str>| names.into_iter().map(String::from).collect();
        Recording::new(name, t, inputs, outputs, own(nominal.inputs()), own(nominal.outputs()))
    };
    let train = vec![record(0, "train A", &mut random)?, record(1, "train B", &mut random)?];
    let test = vec![record(2, "held out", &mut random)?];
    Ok(Case { label, model: off(&nominal, &mut random)?, train, test })
}

/// A random-phase multisine on a first-order hold: 12 lines up to 2 Hz, rms amplitude as asked.
fn multisine(inputs: usize, samples: usize, dt: f64, amplitude: f64, random: &mut SplitMix64) -> Result<Inputs> {
    let columns: Vec<Vec<f64>> = (0..inputs)
        .map(|_| {
            let lines: Vec<(f64, f64)> = (1..=12)
                .map(|k| {
                    (2.0 * std::f64::consts::PI * f64::from(k) / 6.0, 2.0 * std::f64::consts::PI * random.uniform())
                })
                .collect();
            let wave = |t: f64| lines.iter().map(|(w, phase)| (w * t + phase).sin()).sum::<f64>();
            (0..samples).map(|i| amplitude * wave(i as f64 * dt) / 6f64.sqrt()).collect()
        })
        .collect();
    Inputs::samples(0.0, dt, &columns, Hold::FirstOrder)
}

/// Parameters of an effect so that its force is about `size` of the forces at its port.
fn sized(
    nominal: &Model,
    effect: &str,
    port: &str,
    recipe: &Recipe,
    inputs: &Inputs,
    (samples, dt): (usize, f64),
    random: &mut SplitMix64,
) -> Result<Vec<(String, f64)>> {
    // The force that a port would need to hold still is a fair measure of the forces that act there.
    let probe = nominal.attach("coulomb_friction", port, &[])?;
    let parts = probe.parts().ok_or_else(|| Error::Model { path: port.into(), message: "no smooth part".into() })?;
    let p: Vec<f64> = probe.parameters().iter().map(|p| p.value).collect();
    let motion_of = nominal.port_motion(port)?;
    let x0 = vec![0.0; nominal.states().len()];
    let mut walker = Walker::new(&parts, &p, inputs, &x0);
    let (mut force, mut position, mut velocity) = (Vec::new(), Vec::new(), Vec::new());
    let (mut before, mut element, mut pv) = (0.0, vec![0.0; 3], [0.0; 2]);
    for k in 0..samples {
        let at = Point { t: k as f64 * dt, x: &walker.x, u: &walker.u, p: &p };
        parts.element.eval(at, &mut element);
        motion_of.eval(at, &mut pv);
        force.push((element[0] - before) / dt / element[2]);
        before = element[0];
        position.push(pv[0]);
        velocity.push(pv[1]);
        for i in 0..10 {
            walker.smooth((k as f64 + 0.1 * f64::from(i)) * dt, 0.1 * dt);
        }
    }
    let (f, q, v) = (stats::rms(force[1..].iter().copied()), stats::rms(position), stats::rms(velocity));
    let spread = 0.7 + 0.6 * random.uniform();
    let document = nominal.library().get(effect)?;
    let mut out: Vec<(String, f64)> = Vec::new();
    for (name, parameter) in &document.parameters {
        let value = match parameter.scale.as_str() {
            "force" if name == "static_force" => 1.8 * out.first().map_or(0.0, |o| o.1),
            "force" => recipe.size * spread * f,
            "velocity" => 0.1 * v,
            "force/velocity" => recipe.size * spread * f / v,
            "force/velocity^2" => recipe.size * spread * f / (v * v),
            "force/position" => recipe.size * spread * f / q,
            "force/position^3" => recipe.size * spread * f / (q * q * q),
            _ => recipe.size * spread,
        };
        out.push((name.clone(), value));
    }
    Ok(out)
}
