//! Before any fit: how large things are, how fast they move, where each record starts, how noisy it is, and how fine the
//! steps must be.

use super::experiment::{Control, Experiment, Run};
use super::fit::Ground;
use super::kalman::{Filter, Noise, Smoothed};
use super::quality::quantisation;
use crate::error::{Error, Result};
use crate::model::{Attached, Compiled, Effect, Library, Model, Point, System, document, effects};
use crate::numeric::{spectrum, stats};

/// Share of a record from its beginning by which its start is judged.
const BEGINNING: f64 = 0.08;
/// Share of the values of a state that its size covers.
const MOST: f64 = 0.99;
/// Name of the effect that stands for a force nobody knows: a state of its own that only noise moves.
pub const UNKNOWN_FORCE: &str = "unknown_force";
/// Name of the effect that stands for what a sensor or an input is off by.
pub const UNKNOWN_BIAS: &str = "unknown_bias";
/// Intensity of noise below which a measurement is not believed to be better than this fraction of its motion.
const FINEST: f64 = 1e-9;

/// A model with something unknown at places of one kind, as states after the model's own: a force at ports, or what is added
/// to inputs or outputs.
///
/// # Errors
/// [`Error::UnknownName`] for a place that the model does not have.
pub fn with_unknown(model: &Model, on: &str, places: &[&str]) -> Result<Model> {
    let mut library = model.library().clone();
    let (name, law, unit) = match on {
        "port" => (UNKNOWN_FORCE, "w", "force"),
        _ => (UNKNOWN_BIAS, "value + w", on),
    };
    let mut effect = Effect {
        sentence: "something that nobody knows".into(),
        on: on.into(),
        law: Some(law.into()),
        reference: "random walk".into(),
        ..Effect::default()
    };
    let state = effects::EffectState { value: 0.0, start: None, unit: unit.into(), flow: "0".into() };
    effect.states.insert("w".into(), state);
    library.add(name, effect)?;
    let mut document = model.document().clone();
    for at in places {
        let parameters = document::Named::new();
        document.effects.push(Attached { name: name.into(), at: (*at).into(), parameters });
    }
    Model::new(document, library, "")
}

/// Sizes and speeds of the motion, read from the recordings.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Natural size of each state.
    pub state_scale: Vec<f64>,
    /// Noise of each output, one standard deviation.
    pub sigma: Vec<f64>,
    /// Natural speed of the motion, rad/s.
    pub speed: f64,
    /// Initial state of each train, then each test experiment.
    pub start: Vec<Vec<f64>>,
    /// State in the middle of each train experiment.
    pub middle: Vec<Vec<f64>>,
}

/// Noise of each output: the white part of what was measured, and no less than the steps of its sensor make.
pub fn floors(train: &[Experiment], residual: Option<&[Vec<f64>]>) -> Vec<f64> {
    let steps = quantisation(train);
    (0..train[0].outputs())
        .map(|j| {
            let ny = train[0].outputs();
            let series: Vec<Vec<f64>> = train
                .iter()
                .enumerate()
                .map(|(r, e)| match residual {
                    Some(res) => res[r].iter().skip(j).step_by(ny).copied().collect(),
                    None => e.output(j).collect(),
                })
                .collect();
            let runs: Vec<&[f64]> = series
                .iter()
                .flat_map(|s| stats::finite_runs(s.iter().copied()).into_iter().map(move |r| &s[r]))
                .collect();
            let spread = stats::std(train.iter().flat_map(|e| e.output(j)));
            let floor = spectrum::noise_floor_pooled(&runs);
            let least = if spread > 0.0 { FINEST * spread } else { 1.0 };
            if floor.is_finite() { floor.max(least) } else { least }.max(steps[j])
        })
        .collect()
}

/// Centre of the part of the outputs' spectra that stands above noise, rad/s.
fn speed(train: &[Experiment], sigma: &[f64]) -> f64 {
    let (mut power, mut moment, mut longest) = (0.0, 0.0, 0.0_f64);
    for e in train {
        longest = longest.max(e.len() as f64 * e.dt);
        for (j, sigma) in sigma.iter().enumerate() {
            let y: Vec<f64> = e.output(j).collect();
            let Some(run) = stats::finite_runs(y.iter().copied()).into_iter().max_by_key(std::ops::Range::len) else {
                continue;
            };
            let mean = stats::mean(y[run.clone()].iter().copied());
            let centred: Vec<f64> = y[run.clone()].iter().map(|v| v - mean).collect();
            let size = stats::std(centred.iter().copied()).powi(2).max(f64::MIN_POSITIVE) * run.len() as f64;
            for (k, p) in spectrum::periodogram(&centred).into_iter().enumerate().skip(1) {
                if p > 10.0 * sigma * sigma {
                    let omega = 2.0 * std::f64::consts::PI * k as f64 / (run.len() as f64 * e.dt);
                    power += p / size;
                    moment += p * omega / size;
                }
            }
        }
    }
    if power > 0.0 { moment / power } else { 2.0 * std::f64::consts::PI / longest.max(f64::MIN_POSITIVE) }
}

/// Gains that tie a run to its recording, from strong to weak, for each experiment.
pub type Ties = Vec<Vec<Vec<f64>>>;

/// The filter with white forces at all ports that follows the recordings.
pub struct Follower<'a> {
    probe: Compiled,
    p: Vec<f64>,
    states: usize,
    ports: usize,
    /// Period of the clock.
    period: Option<f64>,
    /// Where the states that the starting mode holds are.
    held: Vec<Option<f64>>,
    substeps: u64,
    control: &'a Control<'a>,
}

impl<'a> Follower<'a> {
    /// A follower of a model at given values of its parameters.
    ///
    /// # Errors
    /// None that a model which exists could cause.
    pub fn new(model: &Model, p: &[f64], substeps: u64, control: &'a Control<'a>) -> Result<Self> {
        let ports = model.ports();
        let probe = with_unknown(model, "port", &ports)?.compile_for(Vec::new(), crate::model::Backend::Native);
        let (states, ports, period) = (model.states().len(), ports.len(), probe.period(p));
        let stated = probe.initial_state();
        let held = model.held_at_start().into_iter().zip(stated).map(|(held, v)| held.then_some(v)).collect();
        Ok(Self { probe, p: p.to_vec(), states, ports, period, held, substeps, control })
    }

    /// Sizes of the states before anything else is known: outputs as they range, rates as their speed allows.
    fn rough_scale(&self, e: &[Experiment], speed: f64) -> Vec<f64> {
        let ny = e[0].outputs();
        let nx = self.probe.states();
        let x0 = self.probe.initial_state();
        let mut u = vec![0.0; self.probe.inputs()];
        e[0].inputs.eval(0, e[0].t0, &mut u);
        let mut jacobian = vec![0.0; ny + ny * nx];
        let at = Point { t: e[0].t0, x: &x0, u: &u, p: &self.p };
        self.probe.output_jacobian(self.probe.initial_mode(), at, &mut jacobian);
        let range = |j: usize| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for v in e.iter().flat_map(|e| e.output(j)).filter(|v| v.is_finite()) {
                (low, high) = (low.min(v), high.max(v));
            }
            (high - low).max(0.1 * high.abs().max(low.abs())).max(1e-12)
        };
        let widest = (0..ny).map(range).filter(|r| r.is_finite()).fold(0.0, f64::max).max(1e-9);
        (0..self.states)
            .map(|i| {
                let seen = (0..ny).filter_map(|j| {
                    let c = jacobian[ny + j * nx + i].abs();
                    (c > 1e-9).then(|| range(j) / c)
                });
                let direct = seen.fold(f64::INFINITY, f64::min);
                if direct.is_finite() { direct } else { widest * (1.0 + speed) }
            })
            .collect()
    }

    /// Intensity of a white force at each port that gives an observer the bandwidth `g`, rad/s.
    fn intensities(&self, e: &Experiment, x: &[f64], sigma: &[f64], g: f64) -> Vec<(usize, f64)> {
        let (nx, ny) = (self.probe.states(), e.outputs());
        let mut u = vec![0.0; self.probe.inputs()];
        e.inputs.eval(0, e.t0, &mut u);
        let mut state = x.to_vec();
        state.resize(nx, 0.0);
        let at = Point { t: e.t0, x: &state, u: &u, p: &self.p };
        let mode = self.probe.settle(self.probe.initial_mode(), at);
        let (mut flow, mut out) = (vec![0.0; nx + nx * nx], vec![0.0; ny + ny * nx]);
        self.probe.flow_jacobian(mode, at, &mut flow);
        self.probe.output_jacobian(mode, at, &mut out);
        let a = |i: usize, j: usize| flow[nx + i * nx + j];
        let column = |c: usize| -> Vec<f64> { (0..nx).map(|i| a(i, c)).collect() };
        let reach = |b: &[f64]| {
            let of = |j: usize| (0..nx).map(|i| out[ny + j * nx + i] * b[i]).sum::<f64>().abs() / sigma[j];
            (0..ny).map(of).fold(0.0, f64::max)
        };
        (self.states..nx)
            .map(|c| {
                let mut b = column(c);
                let (mut q, mut power) = (g * e.dt.sqrt(), reach(&b));
                // The first derivative of an output that the force reaches sets the order of the observer.
                for _ in 0..4 {
                    if power > 1e-12 {
                        break;
                    }
                    b = (0..nx).map(|i| (0..self.states).map(|k| a(i, k) * b[k]).sum()).collect();
                    power = reach(&b);
                    q *= g;
                }
                (c, if power > 1e-12 { q / power } else { 0.0 })
            })
            .collect()
    }

    fn filter(
        &self,
        e: &Experiment,
        start: (&[f64], &[f64]),
        sigma: &[f64],
        g: f64,
    ) -> Option<super::kalman::Filtered> {
        let nx = self.probe.states();
        let mut x0 = start.0.to_vec();
        let mut sd = start.1.to_vec();
        x0.resize(nx, 0.0);
        sd.resize(nx, 0.0);
        let forces = self.intensities(e, start.0, sigma, g);
        let spread: Vec<f64> = start.1.iter().map(|s| (0.1 * s * g).powi(2)).chain(vec![0.0; self.ports]).collect();
        let noise = if self.ports > 0 { Noise::Forces(&forces) } else { Noise::Diagonal(&spread) };
        let filter = Filter {
            system: &self.probe,
            p: &self.p,
            experiment: e,
            substeps: self.substeps,
            sigma,
            start: (&x0, &sd),
            noise,
            control: self.control,
        };
        filter.forward().ok()
    }

    /// Follows every experiment with an observer of bandwidth `g`, rad/s.
    fn smooth(&self, e: &Experiment, x0: &[f64], scale: &[f64], sigma: &[f64], g: f64) -> Option<Smoothed> {
        self.filter(e, (x0, scale), sigma, g).map(|f| f.smooth())
    }

    /// Gains of an observer of bandwidth `g` along every experiment.
    pub fn ties(&self, e: &[Experiment], scene: &Scene, start: &[Vec<f64>], g: f64) -> Option<Vec<Vec<f64>>> {
        let nx = self.probe.states();
        e.iter()
            .zip(start)
            .map(|(e, x0)| {
                let small: Vec<f64> = scene.state_scale.iter().map(|s| 1e-3 * s).collect();
                let f = self.filter(e, (x0, &small), &scene.sigma, g)?;
                let rows = f.gains.chunks(nx * e.outputs());
                Some(rows.flat_map(|k| k[..self.states * e.outputs()].to_vec()).collect())
            })
            .collect()
    }

    /// Reads sizes, speed and starting states from the recordings.
    pub fn scene(&self, train: &[Experiment], test: &[Experiment]) -> Scene {
        let sigma = floors(train, None);
        let speed = speed(train, &sigma);
        let rough = self.rough_scale(train, speed);
        let initial: Vec<f64> = self.probe.initial_state()[..self.states].to_vec();
        let nx = self.probe.states();
        let mut scene =
            Scene { state_scale: rough.clone(), sigma: sigma.clone(), speed, start: Vec::new(), middle: Vec::new() };
        let mut seen: Vec<Vec<f64>> = vec![Vec::new(); self.states];
        for (r, e) in train.iter().chain(test).enumerate() {
            let followed =
                [4.0, 16.0, 1.0].into_iter().find_map(|f| self.smooth(e, &initial, &rough, &sigma, f * speed));
            let at = |k: usize| -> Vec<f64> {
                followed.as_ref().map_or(initial.clone(), |s| s.x[k * nx..k * nx + self.states].to_vec())
            };
            if let Some(s) = &followed {
                for row in s.x.chunks(nx) {
                    seen.iter_mut().zip(row).for_each(|(seen, v)| seen.push(v.abs()));
                }
            }
            scene.start.push(self.begun(e, &sigma, at(0), &initial));
            if r < train.len() {
                scene.middle.push(at(cut(e, 0.5, self.period)));
            }
        }
        for (s, seen) in scene.state_scale.iter_mut().zip(seen) {
            // The first samples of a state that nobody measures may lie anywhere.
            let l = if seen.is_empty() { 0.0 } else { stats::quantile(&seen, MOST) };
            *s = if l > 0.0 && l.is_finite() { l } else { *s };
        }
        scene
    }

    /// Where a record starts: as the filter saw it, as the document has it, or what is measured from the one and the rest from
    /// the other, whichever meets the beginning of the record best in a free run.
    fn begun(&self, e: &Experiment, sigma: &[f64], followed: Vec<f64>, stated: &[f64]) -> Vec<f64> {
        let (nx, ny) = (self.probe.states(), e.outputs());
        let mut u = vec![0.0; self.probe.inputs()];
        e.inputs.eval(0, e.t0, &mut u);
        let padded =
            |x: &[f64]| -> Vec<f64> { x.iter().copied().chain(std::iter::repeat_n(0.0, nx - x.len())).collect() };
        let mut jacobian = vec![0.0; ny + ny * nx];
        let at = Point { t: e.t0, x: &padded(&followed), u: &u, p: &self.p };
        self.probe.output_jacobian(self.probe.initial_mode(), at, &mut jacobian);
        let measured = |i: usize| (0..ny).any(|j| jacobian[ny + j * nx + i].abs() > 1e-9);
        let mixed =
            followed.iter().zip(stated).enumerate().map(|(i, (f, s))| if measured(i) { *f } else { *s }).collect();
        let beginning = e.part(0, ((BEGINNING * e.len() as f64) as usize).clamp(e.len().min(20), e.len()));
        let misfit = |x: &Vec<f64>| -> f64 {
            let (x0, experiment) = (&padded(x), &beginning);
            let (system, p, substeps) = (&self.probe, &self.p, self.substeps);
            let run = Run { system, p, x0, experiment, substeps, observer: None, control: self.control };
            let Some(y) = run.outputs() else { return f64::INFINITY };
            let each = y.iter().zip(&beginning.y).enumerate().map(|(i, (y, m))| ((y - m) / sigma[i % ny]).powi(2));
            each.filter(|v| !v.is_nan()).sum()
        };
        let mut all: Vec<Vec<f64>> = vec![followed, mixed, stated.to_vec()];
        for x in &mut all {
            x.iter_mut().zip(&self.held).for_each(|(v, held)| *v = held.unwrap_or(*v));
        }
        let misfits: Vec<f64> = all.iter().map(misfit).collect();
        let best = (0..all.len()).min_by(|a, b| misfits[*a].total_cmp(&misfits[*b])).unwrap_or(0);
        all.swap_remove(best)
    }
}

/// Sample at which a record is cut after a share of it: under a clock, a whole number of periods after its beginning, so that
/// what follows begins alike.
pub fn cut(e: &Experiment, share: f64, period: Option<f64>) -> usize {
    let wanted = share * e.len() as f64;
    let whole = period.map(|t| t / e.dt).filter(|n| *n > 1.0 && *n <= wanted);
    whole.map_or(wanted, |n| ((wanted / n).round() * n).round()) as usize
}

/// Steps per sample that keep the engine's own error below a tenth of the noise, and that error per output.
pub fn substeps(system: &dyn System, p: &[f64], ground: Ground<'_>, start: &[Vec<f64>]) -> Result<(u64, Vec<f64>)> {
    let ny = ground.experiments[0].outputs();
    let runs = |substeps: u64| -> Result<Option<Vec<Vec<f64>>>> {
        ground.control.check()?;
        let one = |(e, x0): (&Experiment, &Vec<f64>)| {
            Run { system, p, x0, experiment: e, substeps, observer: None, control: ground.control }.outputs()
        };
        Ok(ground.experiments.iter().zip(start).map(one).collect())
    };
    let mut last = None;
    for n in [1, 2, 4, 8, 16, 32] {
        let (Some(coarse), Some(fine)) = (runs(n)?, runs(4 * n)?) else { continue };
        let error = |j: usize| {
            let each =
                coarse.iter().zip(&fine).flat_map(|(a, b)| a.iter().zip(b).skip(j).step_by(ny).map(|(a, b)| a - b));
            stats::rms(each)
        };
        let errors: Vec<f64> = (0..ny).map(error).collect();
        let good = errors.iter().zip(ground.sigma).all(|(e, s)| *e <= 0.1 * s);
        last = Some((n, errors));
        if good {
            break;
        }
    }
    last.ok_or_else(|| Error::NoConvergence {
        method: "simulation of the nominal model along the recordings".into(),
        iterations: 0,
        residual: f64::INFINITY,
        advice:
            "it leaves the finite numbers: check signs, units and starting values of the model, or put an unstable \
                 plant inside its control loop"
                .into(),
    })
}

/// The library without the unknown: names that are tried unless others are asked for.
pub fn candidates(library: &Library) -> Vec<String> {
    library.names().filter(|n| ![UNKNOWN_FORCE, UNKNOWN_BIAS].contains(n)).map(String::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::zoo;
    use crate::signal::Recording;
    use crate::simulate::Hold;

    #[test]
    fn records_are_cut_at_whole_periods_of_a_clock() {
        let n = 1000;
        let t: Vec<f64> = (0..n).map(|k| 0.01 * f64::from(k)).collect();
        let wave: Vec<f64> = t.iter().map(|t| t.sin()).collect();
        let (input, output) = (vec!["tau".to_string()], vec!["q".to_string()]);
        let r = Recording::new("run", t, vec![wave.clone()], vec![wave], input, output).unwrap();
        let e = Experiment::new(&zoo("drive").unwrap(), &r, Hold::FirstOrder).unwrap();
        assert_eq!(cut(&e, 0.5, None), 500);
        // Periods of 3.3 s end at samples 330, 660 and 990: the nearest to the share wanted.
        assert_eq!(cut(&e, 0.5, Some(3.3)), 660);
        assert_eq!(cut(&e, 0.4, Some(3.3)), 330);
        // A share that holds no whole period is cut where it ends, and so is a clock that is faster than the samples.
        assert_eq!(cut(&e, 0.3, Some(3.3)), 300);
        assert_eq!(cut(&e, 0.3, Some(0.005)), 300);
    }
}
