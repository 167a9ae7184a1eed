//! Owns: one conformance test over every effect of the library at every place of every reference model. Attached with its
//! defaults an effect is absent; attached with a size that matters its derivatives agree with central differences.

use ltp_core::model::effects::{Effect, words};
use ltp_core::model::{Backend, Compiled, Model, Point, System, ZOO, zoo};
use ltp_core::simulate::{Hold, Inputs, Plan, Trajectory, simulate};

/// Duration of every run, s: the hopper takes off and lands in it.
const SPAN: f64 = 0.32;
/// Step, s.
const STEP: f64 = 2e-4;

/// Amplitude of the input that moves a model.
fn amplitude(model: &str) -> f64 {
    match model {
        "drive" => 100.0,
        "pendulum" => 0.5,
        "cart_pendulum" => 4.0,
        "hopper" => 5.0,
        "mathieu" => 10.0,
        _ => 1.0,
    }
}

fn inputs(model: &Model) -> Inputs {
    let a = amplitude(model.name());
    let wave = |t: f64| a * ((9.0 * t).sin() + 0.5 * (23.0 * t).cos());
    let columns = vec![(0..=40).map(|k| wave(0.01 * f64::from(k))).collect(); model.inputs().len()];
    Inputs::samples(0.0, 0.01, &columns, Hold::FirstOrder).unwrap()
}

fn run(label: &str, system: &dyn System, p: &[f64], x0: &[f64], u: &Inputs, derivatives: bool) -> Trajectory {
    let mut plan = Plan::new(SPAN, 0.02).unwrap().with_step(STEP).from(x0);
    plan.derivatives = derivatives;
    let found = simulate(system, p, u, &plan).unwrap();
    assert!(found.stop.is_finished(), "{label}: {}", found.stop.sentence());
    found
}

/// Sizes at a place, by the words that effects use.
struct Sizes {
    force: f64,
    position: f64,
    velocity: f64,
    input: f64,
    output: f64,
    value: f64,
}

impl Sizes {
    fn of(&self, text: &str) -> f64 {
        let size = |word: &str| match word {
            "force" => self.force,
            "position" => self.position,
            "velocity" => self.velocity,
            "time" => 0.1,
            "input" => self.input,
            "output" => self.output,
            "value" => self.value,
            _ => 1.0,
        };
        words(text).into_iter().map(|(word, power)| size(word).powf(power)).product()
    }
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    (values.map(|v| v * v).sum::<f64>() / n).sqrt().max(1e-6)
}

/// Motion of a port along a run, and the force that would change its velocity within a tenth of a second.
fn port_sizes(model: &Model, port: &str, run: &Trajectory) -> [f64; 3] {
    let motion = model.port_motion(port).unwrap();
    let (nx, nu) = (model.states().len(), model.inputs().len());
    let p: Vec<f64> = model.parameters().iter().map(|p| p.value).collect();
    let at = |t: f64, x: &[f64], u: &[f64]| {
        let mut out = [0.0; 2];
        motion.eval(Point { t, x, u, p: &p }, &mut out);
        out
    };
    let rows: Vec<[f64; 2]> = (0..run.t.len())
        .map(|k| at(run.t[k], &run.states[k * nx..(k + 1) * nx], &run.inputs[k * nu..(k + 1) * nu]))
        .collect();
    let probe = model.attach("constant_force", port, &[]).unwrap();
    let pushed = probe.compile_for(vec![probe.parameters().len() - 1], Backend::Plain);
    let mut jacobian = vec![0.0; nx + nx * nx + nx];
    let k = run.t.len() * 3 / 4; // in flight, for the hopper
    let x = &run.states[k * nx..(k + 1) * nx];
    let u = &run.inputs[k * nu..(k + 1) * nu];
    let with = [p.as_slice(), &[0.0]].concat();
    let mode = if model.modes().contains(&"compression") { 1 } else { 0 };
    pushed.flow_jacobian(mode, Point { t: run.t[k], x, u, p: &with }, &mut jacobian);
    let moved: Vec<f64> = x.iter().zip(&jacobian[nx + nx * nx..]).map(|(x, d)| x + 1e-3 * d).collect();
    let mobility = (at(run.t[k], &moved, u)[1] - at(run.t[k], x, u)[1]) / 1e-3;
    let velocity = rms(rows.iter().map(|r| r[1]));
    [velocity / mobility.abs().max(1e-9) / 0.1, rms(rows.iter().map(|r| r[0])), velocity]
}

fn sizes(model: &Model, on: &str, at: &str, base: &Trajectory) -> Sizes {
    let port = match on {
        "port" => Some(at.to_string()),
        "contact" => model.document().contacts[at].port.clone(),
        _ => None,
    };
    let [force, position, velocity] = port.map_or([1.0; 3], |p| port_sizes(model, &p, base));
    let output = model
        .outputs()
        .iter()
        .position(|o| *o == at)
        .map_or(1.0, |j| rms(base.outputs.iter().skip(j).step_by(model.outputs().len()).copied()));
    let value = model.document().parameters.get(at).map_or(1.0, |p| p.value.abs().max(1e-3));
    Sizes { force, position, velocity, input: amplitude(model.name()), output, value }
}

/// Values that make an effect matter.
fn matters(effect: &Effect, sizes: &Sizes) -> Vec<(String, f64)> {
    let value = |name: &str| {
        let p = &effect.parameters[name];
        let scale = sizes.of(&p.scale);
        match name {
            "gain" => 1.1,
            "sharpness" => 2.0,
            "phase" => 0.3,
            "static_force" => 0.2 * scale,
            "rate" => 0.02 * scale,
            _ => p.shape.get(1).map_or(0.1, |s| *s) * scale,
        }
    };
    effect.parameters.keys().map(|name| (name.clone(), value(name))).collect()
}

/// Laws with a kink: the step that holds it is accurate to first order only, and so is its derivative.
const KINKED: [&str; 4] = ["backlash", "hysteresis", "input_saturation", "input_dead_zone"];

/// Derivatives of the states by the effect's parameters, one nominal parameter and the initial states.
fn derivatives_agree(label: &str, model: &Model, u: &Inputs, faults: &mut Vec<String>) {
    let own = |i: usize| model.parameters()[i].effect.is_some();
    let mut free: Vec<usize> = (0..model.parameters().len()).filter(|&i| own(i)).collect();
    free.extend(model.uncertain().into_iter().find(|&i| !own(i)));
    let system: Compiled = model.compile_for(free.clone(), Backend::Native);
    let (nx, nf) = (system.states(), free.len());
    let (p, x0) = (system.parameters().to_vec(), system.initial_state());
    let found = run(label, &system, &p, &x0, u, true);
    let last = found.t.len() - 1;
    let s = &found.sensitivities[last * nx * (nx + nf)..];
    let scale: Vec<f64> = (0..nx).map(|i| rms(found.states.iter().skip(i).step_by(nx).copied())).collect();
    // A start at rest is a kink where friction holds.
    let columns = (0..nf).chain((nf..nf + nx).filter(|&c| x0[c - nf] != 0.0));
    for c in columns {
        let (base, name) = if c < nf {
            (p[free[c]], model.parameters()[free[c]].name.clone())
        } else {
            (x0[c - nf], format!("x0[{}]", c - nf))
        };
        let h = 1e-5 * if base == 0.0 { 0.1 } else { base.abs() };
        let value = |d: f64| {
            let (mut p, mut x) = (p.clone(), x0.clone());
            if c < nf {
                p[free[c]] += d;
            } else {
                x[c - nf] += d;
            }
            let run = run(label, &system, &p, &x, u, false);
            run.states[last * nx..].to_vec()
        };
        let (pp, pl, mi, mm) = (value(2.0 * h), value(h), value(-h), value(-2.0 * h));
        for i in 0..nx {
            let expected = (8.0 * (pl[i] - mi[i]) - (pp[i] - mm[i])) / (12.0 * h);
            let found = s[i * (nx + nf) + if c < nf { nx + c } else { c - nf }];
            let size = expected.abs().max(1e-3 * scale[i] / base.abs().max(0.1)).max(1e-9);
            let kinked = KINKED.iter().any(|k| label.contains(k));
            if (found - expected).abs() > if kinked { 5e-3 } else { 1e-5 } * size + 1e-12 * scale[i] / h {
                let state = &model.states()[i];
                faults.push(format!("{label}: d {state}/d {name}: found {found}, expected {expected}"));
            }
        }
    }
}

#[test]
fn every_effect_at_every_place() {
    let (mut seen, mut faults) = (Vec::new(), Vec::new());
    for (name, _) in ZOO {
        let model = zoo(name).unwrap();
        let u = inputs(&model);
        let plain = model.compile();
        let base = run(name, &plain, plain.parameters(), &plain.initial_state(), &u, false);
        let library = model.library().clone();
        for effect in library.names() {
            for at in model.places(effect).unwrap().into_iter().filter(|a| a != "f" && a != "F") {
                let label = format!("{name}: {effect}@{at}");
                seen.push(effect.to_string());
                if effect != "compliant_ground" {
                    let absent = model.attach(effect, &at, &[]).unwrap();
                    let system = absent.compile();
                    let same = run(&label, &system, system.parameters(), &system.initial_state(), &u, false);
                    for (k, (a, b)) in same.outputs.iter().zip(&base.outputs).enumerate() {
                        let size = base.outputs.iter().fold(0.0f64, |m, v| m.max(v.abs()));
                        assert!((a - b).abs() <= 1e-10 * size, "{label}: sample {k} is {a} instead of {b}");
                    }
                }
                let document = library.get(effect).unwrap();
                let values = matters(document, &sizes(&model, &document.on, &at, &base));
                let values: Vec<(&str, f64)> = values.iter().map(|(n, v)| (n.as_str(), *v)).collect();
                let attached = model.attach(effect, &at, &values).unwrap();
                let again = Model::from_toml(&attached.to_toml().unwrap(), "again").unwrap();
                assert_eq!(again.document(), attached.document(), "{label}");
                derivatives_agree(&format!("{label} {values:?}"), &attached, &u, &mut faults);
            }
        }
    }
    assert!(faults.is_empty(), "{} wrong:\n{}", faults.len(), faults.join("\n"));
    for effect in zoo("drive").unwrap().library().names() {
        assert!(seen.iter().any(|s| s == effect), "{effect} has no place in any reference model");
    }
}
