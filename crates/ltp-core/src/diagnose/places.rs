//! Where candidates may act, with the natural sizes there and the periods that stand out in the missing force.

use super::candidates::{Place, Waves};
use super::experiment::Experiment;
use super::prepare::Scene;
use super::result::Force;
use super::sizes::Sizes;
use crate::model::Model;
use crate::numeric::{regression, stats};

/// Periods that are followed.
const PERIODS: usize = 3;
/// Waves over the range of motion at most, and points per wave number.
const WAVES: usize = 120;
const FINENESS: usize = 4;
/// Samples kept for a periodogram.
const KEPT: usize = 2000;

/// Every place at which one of the effects may act.
pub struct Places<'a> {
    model: &'a Model,
    train: &'a [Experiment],
    scene: &'a Scene,
    ports: Vec<Place>,
}

impl<'a> Places<'a> {
    /// Sizes at the ports are read from the missing force there.
    pub fn new(model: &'a Model, train: &'a [Experiment], scene: &'a Scene, forces: &[(String, Vec<Force>)]) -> Self {
        let port = |(at, forces): &(String, Vec<Force>)| Place {
            at: at.clone(),
            sizes: Sizes::at_port(forces, scene),
            waves: waves(forces),
        };
        Self { model, train, scene, ports: forces.iter().map(port).collect() }
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

    fn place(&self, kind: &str, at: &str) -> Option<Place> {
        let plain = |sizes| Place { at: at.into(), sizes, waves: Waves::default() };
        match kind {
            "port" => self.ports.iter().find(|p| p.at == at).cloned(),
            "input" => {
                // A signal is as large as the inputs that enter it, as far as is known before it is run.
                let inputs: Vec<usize> = match self.model.document().inputs.get_index_of(at) {
                    Some(i) => vec![i],
                    None => (0..self.model.inputs().len()).collect(),
                };
                let mut u = vec![0.0; self.model.inputs().len()];
                let mut seen = Vec::new();
                for e in self.train {
                    for k in 0..e.len() {
                        let t = e.t0 + k as f64 * e.dt;
                        e.inputs.eval(e.inputs.interval(t + 1e-6 * e.dt), t, &mut u);
                        seen.push(inputs.iter().map(|i| u[*i].abs()).sum());
                    }
                }
                Some(plain(Sizes::of_input(seen.into_iter(), self.scene)))
            }
            "output" => {
                let j = self.model.outputs().iter().position(|o| *o == at)?;
                Some(plain(Sizes::of_output(self.train, j, self.scene)))
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

/// Wavelengths and angular frequencies at which a force repeats over position and over time.
fn waves(forces: &[Force]) -> Waves {
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
        let lines = ((0.25 * seconds / dt) as usize).clamp(8, 2000);
        peaks((1..=2 * lines).map(|i| 0.5 * tau / seconds * i as f64).collect(), &t)
    } else {
        Vec::new()
    };
    Waves { lengths, omegas }
}
