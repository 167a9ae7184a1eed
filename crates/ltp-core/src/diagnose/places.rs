//! Where candidates may act, with the natural sizes there and the periods that stand out in the missing force.

use super::candidates::{Place, Waves};
use super::experiment::{Experiment, Run};
use super::fit::Ground;
use super::hypothesis::{Course, Hypothesis};
use super::prepare::Scene;
use super::result::Force;
use super::sizes::Sizes;
use super::trial::{Bench, Trial};
use crate::model::document::{Definition, FullDefinition};
use crate::model::{Backend, Model, System};
use crate::numeric::{Complex, fft, regression, stats};

/// Periods that are followed.
const PERIODS: usize = 3;
/// Frequencies of the residuals that are followed beside them.
const TONES: usize = 2;
/// Waves over the range of motion at most, and points per wave number.
const WAVES: usize = 120;
const FINENESS: usize = 4;
/// Multiples of a clock's frequency by which a response may be moved from its cause.
const SIDEBANDS: usize = 3;
/// Highest frequency of a periodogram, in samples.
const BAND: f64 = 0.45;
/// Samples kept for a periodogram.
const KEPT: usize = 4000;

/// Every place at which one of the effects may act.
pub struct Places<'a> {
    model: &'a Model,
    train: Ground<'a>,
    scene: &'a Scene,
    nominal: &'a Trial,
    ports: Vec<Place>,
}

impl<'a> Places<'a> {
    /// Sizes at the ports are read from the missing force there, those of signals from the refitted nominal model.
    pub fn new(bench: &Bench<'a>, scene: &'a Scene, nominal: &'a Trial, forces: &[(String, Vec<Force>)]) -> Self {
        let clock = nominal.made.system.period(&nominal.parameters());
        let heard = tones(nominal, bench.train);
        let port = |(at, forces): &(String, Vec<Force>)| Place {
            at: at.clone(),
            sizes: Sizes::at_port(forces, scene),
            waves: waves(forces, clock).and(&heard),
        };
        let ports = forces.iter().map(port).collect();
        Self { model: bench.model, train: bench.train, scene, nominal, ports }
    }

    /// The ports.
    pub fn ports(&self) -> &[Place] {
        &self.ports
    }

    /// Effects with the places at which they may act.
    ///
    /// # Errors
    /// [`crate::Error::UnknownName`] for an effect that is not in the model's library.
    pub fn jobs(&self, names: &[String]) -> crate::Result<Vec<(String, Place)>> {
        let mut out = Vec::new();
        for name in names {
            let kind = self.model.library().get(name)?.on.clone();
            for at in self.model.places(name)? {
                // Times of ticks are not differentiated: what sets them cannot be fitted.
                if kind == "parameter" && self.schedules(&at) {
                    continue;
                }
                if let Some(place) = self.place(&kind, &at) {
                    out.push((name.clone(), place));
                }
            }
        }
        Ok(out)
    }

    /// Whether a parameter sets the times of sampled updates.
    fn schedules(&self, parameter: &str) -> bool {
        let names = |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == parameter);
        self.model.document().ticks.iter().any(|t| names(&t.every) || t.offset.as_deref().is_some_and(names))
    }

    /// Values of an input along the records.
    fn entering(&self, input: usize) -> Vec<f64> {
        let mut u = vec![0.0; self.model.inputs().len()];
        let mut seen = Vec::new();
        for e in self.train.experiments {
            for k in 0..e.len() {
                let t = e.t0 + k as f64 * e.dt;
                e.inputs.eval(e.inputs.interval(t + 1e-6 * e.dt), t, &mut u);
                seen.push(u[input]);
            }
        }
        seen
    }

    /// Values of a signal of the document along the records, as an output of the nominal model.
    fn signal(&self, name: &str) -> Option<Vec<f64>> {
        let mut document = self.model.document().clone();
        document.outputs.clear();
        let shown = FullDefinition { value: name.into(), unit: None, column: None };
        document.outputs.insert("shown".into(), Definition::Full(shown));
        document.effects.retain(|e| self.model.library().get(&e.name).is_ok_and(|effect| effect.on != "output"));
        let system =
            Model::new(document, self.model.library().clone(), "").ok()?.compile_for(Vec::new(), Backend::Native);
        let p = self.nominal.parameters();
        let Ground { experiments, substeps, control, .. } = self.train;
        let mut seen = Vec::new();
        for (experiment, x0) in experiments.iter().zip(&self.nominal.fit.point.x0) {
            seen.extend(Run { system: &system, p: &p, x0, experiment, substeps, observer: None, control }.outputs()?);
        }
        Some(seen)
    }

    fn place(&self, kind: &str, at: &str) -> Option<Place> {
        let plain = |sizes| Place { at: at.into(), sizes, waves: Waves::default() };
        match kind {
            "port" => self.ports.iter().find(|p| p.at == at).cloned(),
            "input" => {
                let seen = match self.model.document().inputs.get_index_of(at) {
                    Some(i) => self.entering(i),
                    None => self.signal(at)?,
                };
                Some(plain(Sizes::of_input(seen.into_iter(), self.scene)))
            }
            "output" => {
                let j = self.model.outputs().iter().position(|o| *o == at)?;
                Some(plain(Sizes::of_output(self.train.experiments, j, self.scene)))
            }
            "contact" => {
                let port = self.model.document().contacts.get(at)?.port.as_ref();
                let sizes = port.and_then(|p| self.ports.iter().find(|q| q.at == *p)).map(|p| p.sizes);
                Some(plain(sizes.unwrap_or_else(|| Sizes::new(self.scene))))
            }
            "parameter" => {
                let info = self.model.parameters().iter().find(|p| p.name == at)?;
                let value = if info.value == 0.0 { info.sd.unwrap_or(1.0) } else { info.value.abs() };
                Some(plain(Sizes { value, ..Sizes::new(self.scene) }))
            }
            _ => None,
        }
    }
}

/// Effects that may be added to a hypothesis, with the periods that stand out in what is still missing beside it.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn beside(
    bench: &Bench<'_>,
    scene: &Scene,
    trial: &Trial,
    jobs: &[(String, Place)],
) -> crate::Result<Vec<(String, Place)>> {
    let taken =
        |(name, place): &&(String, Place)| !trial.made.effects.iter().any(|(e, at)| e == name && *at == place.at);
    let mut open: Vec<(String, Place)> = jobs.iter().filter(taken).cloned().collect();
    if trial.made.effects.is_empty() {
        return Ok(open);
    }
    let (model, p) = (&trial.made.model, trial.parameters());
    let state_scale = scene.state_scale.iter().chain(&trial.made.extra).copied().collect();
    let scene = Scene { state_scale, ..scene.clone() };
    let course = Course { model, p: &p, ground: bench.train, scene: &scene };
    let clock = trial.made.system.period(&p);
    let heard = tones(trial, bench.train);
    for port in model.ports() {
        bench.train.control.check()?;
        let force = Hypothesis::port(course, port)?;
        let Some(walk) = force.walk()? else { continue };
        let seen = waves(&force.smoothed(&walk)?, clock).and(&heard);
        for (_, place) in open.iter_mut().filter(|(_, place)| place.at == port) {
            place.waves = seen.clone();
        }
    }
    Ok(open)
}

/// Wavelengths and angular frequencies at which a force repeats over position and over time, the strongest first. Along a
/// machine with a clock of a period the response to one frequency stands at all those that lie multiples of the clock's
/// beside it: each of them may be the one, and they follow.
pub fn waves(forces: &[Force], clock: Option<f64>) -> Waves {
    let total: usize = forces.iter().map(|f| f.t.len()).sum();
    let every = total.div_ceil(KEPT).max(1);
    let pick = |of: &dyn Fn(&Force) -> &Vec<f64>| -> Vec<f64> {
        forces.iter().flat_map(|f| of(f).iter().step_by(every).copied().collect::<Vec<_>>()).collect()
    };
    let (w, q, v, t) = (pick(&|f| &f.force), pick(&|f| &f.position), pick(&|f| &f.velocity), pick(&|f| &f.t));
    if w.len() < 64 {
        return Waves::default();
    }
    // What has no period: a constant, a spring, dry and viscous friction.
    let sign: Vec<f64> = v.iter().map(|v| v.signum()).collect();
    let w = regression::residual(&w, &[q.clone(), v, sign]);
    let span = |x: &[f64]| stats::quantile(x, 0.995) - stats::quantile(x, 0.005);
    let (range, seconds) = (span(&q), span(&t));
    let dt = forces.iter().find(|f| f.t.len() > 1).map_or(1.0, |f| f.t[1] - f.t[0]) * every as f64;
    let tau = 2.0 * std::f64::consts::PI;
    let over = |x: &[f64], k: f64| {
        let (mut s, mut c) = (0.0, 0.0);
        for (x, w) in x.iter().zip(&w) {
            let (sin, cos) = (k * x).sin_cos();
            s += w * sin;
            c += w * cos;
        }
        s * s + c * c
    };
    let peaks = |numbers: Vec<f64>, x: &[f64]| -> Vec<f64> {
        let power: Vec<f64> = numbers.iter().map(|k| over(x, *k)).collect();
        let mut tops: Vec<usize> = (1..power.len().saturating_sub(1))
            .filter(|&i| power[i] > power[i - 1] && power[i] >= power[i + 1])
            .collect();
        tops.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
        tops.into_iter().take(PERIODS).map(|i| numbers[i]).collect()
    };
    let lengths = if range > 0.0 {
        let numbers = (FINENESS / 2..=FINENESS * WAVES).map(|i| tau / range * i as f64 / FINENESS as f64).collect();
        peaks(numbers, &q).into_iter().map(|k| tau / k).collect()
    } else {
        Vec::new()
    };
    let omegas = if seconds > 0.0 {
        let lines = ((BAND * seconds / dt) as usize).clamp(8, 2000);
        peaks((1..=2 * lines).map(|i| 0.5 * tau / seconds * i as f64).collect(), &t)
    } else {
        Vec::new()
    };
    let omegas = match clock.map(|period| tau / period) {
        Some(pump) => sidebands(&omegas, pump, std::f64::consts::PI / dt),
        None => omegas,
    };
    Waves { lengths, omegas }
}

/// Angular frequencies at which the residuals of the train records repeat, the strongest first: what a smoother spreads over
/// a missing force stands out there.
fn tones(trial: &Trial, ground: Ground<'_>) -> Vec<f64> {
    let Some(first) = ground.experiments.first() else { return Vec::new() };
    let (dt, ny) = (first.dt, ground.sigma.len());
    let longest = ground.experiments.iter().map(Experiment::len).max().unwrap_or(0);
    if longest < 64 || ground.experiments.iter().any(|e| (e.dt - dt).abs() > 1e-9 * dt) {
        return Vec::new();
    }
    // Twice as many lines as a record has, so that none falls between two.
    let n = 2 * longest;
    let line = std::f64::consts::TAU / (n as f64 * dt);
    let mut power = vec![0.0; (2.0 * BAND * longest as f64) as usize];
    for j in 0..ny {
        let mut sum = vec![Complex::default(); n];
        for (e, residual) in ground.experiments.iter().zip(&trial.residuals.train) {
            let kept = |v: &f64| if v.is_finite() { *v } else { 0.0 };
            let mut padded: Vec<f64> = residual.iter().skip(j).step_by(ny).map(kept).collect();
            padded.resize(n, 0.0);
            for (k, (s, x)) in sum.iter_mut().zip(fft::forward(&padded)).enumerate() {
                *s += x * Complex::from_polar(1.0, -line * k as f64 * e.t0);
            }
        }
        power.iter_mut().zip(&sum).for_each(|(p, s)| *p += s.norm_sqr());
    }
    let mut tops: Vec<usize> =
        (1..power.len().saturating_sub(1)).filter(|&i| power[i] > power[i - 1] && power[i] >= power[i + 1]).collect();
    tops.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
    tops.into_iter().take(TONES).map(|i| line * i as f64).collect()
}

/// Angular frequencies with their neighbours up to [`SIDEBANDS`] multiples of a clock's away, each once, below a limit.
fn sidebands(omegas: &[f64], pump: f64, limit: f64) -> Vec<f64> {
    let mut out: Vec<f64> = omegas.to_vec();
    for k in 1..=SIDEBANDS {
        for w in omegas {
            for other in [w + k as f64 * pump, (w - k as f64 * pump).abs()] {
                if other > 0.0 && other < limit && out.iter().all(|o| (o - other).abs() > 0.02 * pump) {
                    out.push(other);
                }
            }
        }
    }
    out
}
