//! Natural sizes at the places where effects may act, from the nominal model's own motion, and the reference size of effects.

use indexmap::IndexMap;

use super::super::prepare;
use crate::error::Result;
use crate::model::document::{Definition, Parameter, State};
use crate::model::{Backend, Document, Effect, Model, Point, System, effects};
use crate::numeric::stats;
use crate::simulate::Trajectory;

/// Share of the free steps of finite differences.
const NUDGE: f64 = 1e-4;

/// Natural sizes of the words in which an effect's parameters are given.
#[derive(Clone, Debug, Default)]
pub struct Sizes(Vec<(&'static str, f64)>);

impl Sizes {
    /// Size of a quantity given in words, such as `force/velocity^2`; 1 for a word without a size.
    pub fn of(&self, words: &str) -> f64 {
        let size = |name: &str| self.0.iter().find(|(n, _)| *n == name).map_or(1.0, |(_, v)| *v);
        effects::words(words).into_iter().map(|(name, power)| size(name).powf(power)).product()
    }
}

fn or_one(v: f64) -> f64 {
    if v > 0.0 && v.is_finite() { v } else { 1.0 }
}

/// Sizes at a place for an effect: position, speed and time as the nominal motion has them, force as it takes to accelerate
/// the port as it moves.
///
/// # Errors
/// [`crate::Error::UnknownName`] for a place that does not exist.
pub fn at(model: &Model, effect: &Effect, place: &str, runs: &[Trajectory]) -> Result<Sizes> {
    match effect.on.as_str() {
        "port" => port(model, place, runs),
        "contact" => match model.document().contacts.get(place).and_then(|c| c.port.clone()) {
            Some(of) => port(model, &of, runs),
            None => Ok(Sizes::default()),
        },
        "input" => Ok(signal("input", model.inputs().iter().position(|i| *i == place), runs, |r| (&r.inputs, 0.0))),
        "output" => Ok(signal("output", model.outputs().iter().position(|o| *o == place), runs, |r| (&r.outputs, 1.0))),
        _ => {
            let value = model.parameter(place).map_or(1.0, |i| model.parameters()[i].value.abs());
            let long = runs.iter().map(|r| r.t.last().unwrap_or(&0.0) - r.t[0]).fold(0.0, f64::max);
            Ok(Sizes(vec![("value", or_one(value)), ("time", or_one(long))]))
        }
    }
}

/// Size and time of one sampled column: its spread about the mean where `centre` is one, its largest value where it is zero.
fn signal(
    word: &'static str,
    column: Option<usize>,
    runs: &[Trajectory],
    of: impl Fn(&Trajectory) -> (&Vec<f64>, f64),
) -> Sizes {
    let Some(j) = column else { return Sizes::default() };
    let (mut size, mut rate) = (0.0_f64, 0.0_f64);
    for r in runs {
        let (values, centre) = of(r);
        let width = values.len() / r.t.len().max(1);
        let v: Vec<f64> = values.iter().skip(j).step_by(width.max(1)).copied().collect();
        let mean = centre * stats::mean(v.iter().copied());
        let largest = v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        size = size.max(if centre > 0.0 { stats::rms(v.iter().map(|v| v - mean)) } else { largest });
        let dt = if r.t.len() > 1 { r.t[1] - r.t[0] } else { 1.0 };
        rate = rate.max(stats::rms(v.windows(2).map(|w| (w[1] - w[0]) / dt)));
    }
    Sizes(vec![(word, or_one(size)), ("time", or_one(or_one(size) / or_one(rate)))])
}

fn port(model: &Model, port: &str, runs: &[Trajectory]) -> Result<Sizes> {
    let probe = prepare::with_unknown(model, "port", &[port])?.compile_for(Vec::new(), Backend::Plain);
    let motion = model.port_motion(port)?;
    let (nx, own) = (probe.states(), model.states().len());
    let p = probe.parameters().to_vec();
    let mut jacobian = vec![0.0; nx + nx * nx];
    let (mut positions, mut speeds, mut rates, mut forces) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for r in runs {
        let nu = r.inputs.len() / r.t.len().max(1);
        for (k, t) in r.t.iter().enumerate() {
            let mut x = r.states[k * own..(k + 1) * own].to_vec();
            let u = &r.inputs[k * nu..(k + 1) * nu];
            let see = |x: &[f64]| {
                let mut out = [0.0; 2];
                motion.eval(Point { t: *t, x, u, p: &p }, &mut out);
                out
            };
            let [q, v] = see(&x);
            x.resize(nx, 0.0);
            let mode = r.mode[k];
            probe.flow_jacobian(mode, Point { t: *t, x: &x, u, p: &p }, &mut jacobian);
            let along = |d: &[f64]| {
                let largest = d.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                if largest == 0.0 {
                    return 0.0;
                }
                let h = NUDGE / largest;
                let moved: Vec<f64> = x[..own].iter().zip(d).map(|(x, d)| x + h * d).collect();
                (see(&moved)[1] - v) / h
            };
            let rate = along(&jacobian[..own]);
            let mobility = along(&(0..own).map(|i| jacobian[nx + i * nx + own]).collect::<Vec<_>>());
            positions.push(q);
            speeds.push(v);
            rates.push(rate);
            if mobility.abs() > 1e-12 {
                forces.push(rate / mobility);
            }
        }
    }
    let [position, velocity, rate, force] = [positions, speeds, rates, forces].map(|v| or_one(stats::rms(v)));
    Ok(Sizes(vec![("position", position), ("velocity", velocity), ("force", force), ("time", velocity / rate)]))
}

/// The parameters of an effect at a share of its natural size: amplitudes that far from where the effect is absent, shapes in
/// the middle of their range, others at their usual value.
///
/// # Errors
/// What an expression that gives a starting value may have wrong.
pub fn reference(model: &Model, effect: &Effect, sizes: &Sizes, share: f64) -> Result<Vec<(String, f64)>> {
    let mut out: Vec<(String, f64)> = Vec::new();
    for (name, p) in &effect.parameters {
        let size = sizes.of(&p.scale);
        let value = match (&p.start, p.sd) {
            _ if !p.shape.is_empty() => p.shape[p.shape.len() / 2] * size,
            (Some(start), _) => evaluated(model, start, &out)?,
            (None, Some(_)) => p.default_value(),
            (None, None) => p.neutral + share * size,
        };
        let value = value.max(p.min.unwrap_or(f64::NEG_INFINITY)).min(p.max.unwrap_or(f64::INFINITY));
        out.push((name.clone(), value));
    }
    Ok(out)
}

/// An expression of parameters that are known already.
fn evaluated(model: &Model, text: &str, known: &[(String, f64)]) -> Result<f64> {
    let parameter = |v: f64| Parameter { value: v, ..Parameter::default() };
    let document = Document {
        name: "start".into(),
        states: IndexMap::from([("rest_".to_string(), State { value: 0.0, unit: None })]),
        parameters: known.iter().map(|(n, v)| (n.clone(), parameter(*v))).collect(),
        flow: IndexMap::from([("rest_".to_string(), "0".to_string())]),
        outputs: IndexMap::from([("value_".to_string(), Definition::Plain(text.into()))]),
        ..Document::default()
    };
    let system = Model::new(document, model.library().clone(), "start")?.compile_for(Vec::new(), Backend::Plain);
    let mut out = [0.0];
    system.output(0, Point { t: 0.0, x: &[0.0], u: &[], p: system.parameters() }, &mut out);
    Ok(out[0])
}

/// Whether the outputs' change is in proportion to the effect's only parameter, so that a derivative says it all.
pub fn linear(effect: &Effect) -> bool {
    let alone =
        effect.parameters.len() == 1 && effect.parameters.values().all(|p| p.shape.is_empty() && p.neutral == 0.0);
    effect.on == "port" && effect.law.is_some() && effect.states.is_empty() && alone
}
