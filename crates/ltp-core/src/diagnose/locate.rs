//! Where the mismatch acts, and on what it depends.
//!
//! A force that nobody knows (a random walk) is put at one port at a time; an extended Kalman filter with the exact
//! transitions of the hybrid engine gives the likelihood of that single-port hypothesis, a smoother the force itself. The
//! force is then regressed on what it may depend on, judged on left-out blocks beyond what nominal parameters explain.

use super::experiment::{Control, Experiment};
use super::fit::Ground;
use super::kalman::{Filter, Noise};
use super::occasions;
use super::prepare::{Scene, with_unknown_forces};
use super::result::{Force, Location};
use super::trial::{Bench, Trial};
use rayon::prelude::*;

use crate::error::Result;
use crate::model::{Backend, Model, Point, System};
use crate::numeric::spline::BSplines;
use crate::numeric::{regression, stats};

/// Shifts of the permutation test; the smallest p-value is one over this plus one.
const SHIFTS: usize = 199;
/// Speed below which a port counts as at rest, relative to its rms speed.
const REST: f64 = 0.05;
/// Pieces of the splines for laws that are smooth over the range of motion, for laws that repeat within it (a cogging
/// motor, a gear), and for drift in time.
const SMOOTH: usize = 8;
const RIPPLED: usize = 40;
const DRIFT: usize = 3;
/// Blocks that are left out in turn: long against the memory of the motion, short against the time in which it comes back to
/// the same positions and speeds, since a law cannot be judged where it was never seen.
const BLOCKS: usize = 25;
/// Share of what a simpler group leaves that a richer one must explain to be named instead.
const RICHER: f64 = 0.5;
/// What a force depends on that never changes.
pub const CONSTANT: &str = "nothing: it is constant";
/// Samples kept for the regression.
const KEPT: usize = 2000;

/// A port with the force that the model misses there, along each train experiment.
pub type PortForces = (String, Vec<Force>);

/// A located mismatch.
pub struct Located {
    /// Public description.
    pub location: Location,
    /// Gain in log-likelihood over no force at all.
    pub gain: f64,
    /// The force along each train experiment.
    pub forces: Vec<Force>,
}

/// The force that the nominal equations miss at a port when their parameters are `p`, labelled with units.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn missing(bench: &Bench<'_>, scene: &Scene, p: &[f64], port: &str) -> Result<Vec<Force>> {
    let Ground { experiments, substeps, control, .. } = bench.train;
    let found = at_port(bench.model, p, port, experiments, scene, substeps, control)?;
    let mut forces = found.map_or(Vec::new(), |(_, forces)| forces);
    for f in &mut forces {
        [f.unit, f.position_unit, f.velocity_unit] = bench.model.port_units(port)?;
    }
    Ok(forces)
}

/// Every port in turn: the force that the refitted model misses there, and the port at which such a force explains best what
/// is left.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn everywhere(
    bench: &Bench<'_>,
    scene: &Scene,
    nominal: &Trial,
    seed: u64,
    warnings: &mut Vec<String>,
) -> Result<(Vec<PortForces>, Option<Located>)> {
    let (model, ground) = (bench.model, bench.train);
    let refitted = nominal.parameters();
    let ports = model.ports();
    let found: Vec<Option<(f64, Vec<Force>)>> = ports
        .par_iter()
        .map(|port| {
            ground.control.check()?;
            at_port(model, &refitted, port, ground.experiments, scene, ground.substeps, ground.control)
        })
        .collect::<Result<_>>()?;
    let mut all = Vec::new();
    let mut best: Option<(f64, usize)> = None;
    for (port, found) in ports.iter().zip(found) {
        let Some((gain, mut forces)) = found else {
            warnings.push(format!("port `{port}`: no force there can be estimated from these recordings"));
            continue;
        };
        for f in &mut forces {
            [f.unit, f.position_unit, f.velocity_unit] = model.port_units(port)?;
        }
        if best.is_none_or(|(g, _)| gain > g) {
            best = Some((gain, all.len()));
        }
        all.push(((*port).to_string(), forces));
    }
    let located = best.map(|(gain, i)| {
        let (port, forces) = &all[i];
        let (variable, p_value) = depends_on(forces, seed);
        let location = Location {
            kind: "port".into(),
            at: port.clone(),
            mode: occasions::mode(forces),
            variable: variable.into(),
            phases: occasions::phases(forces),
            p_value,
            margin: gain,
            sentence: String::new(),
        };
        Located { location, gain, forces: forces.clone() }
    });
    Ok((all, located))
}

/// The force at a port that explains the recordings best, and its gain in log-likelihood over none.
fn at_port(
    model: &Model,
    p: &[f64],
    port: &str,
    train: &[Experiment],
    scene: &Scene,
    substeps: u64,
    control: &Control<'_>,
) -> Result<Option<(f64, Vec<Force>)>> {
    let probe = with_unknown_forces(model, &[port])?;
    let system = probe.compile_for(Vec::new(), Backend::Native);
    let sensed = probe.compile_for(model.uncertain(), Backend::Native);
    let nx = system.states();
    let reach = reach(&system, p, train, scene);
    let run = |intensity: f64, smooth: bool| -> Result<Option<(f64, Vec<Force>)>> {
        let mut noise = vec![0.0; nx];
        noise[nx - 1] = intensity * intensity;
        let (mut total, mut forces) = (0.0, Vec::new());
        for (r, e) in train.iter().enumerate() {
            control.check()?;
            let mut x0 = scene.start[r].clone();
            let mut sd: Vec<f64> = scene.state_scale.iter().map(|s| 0.3 * s).collect();
            x0.push(0.0);
            sd.push(if intensity > 0.0 { reach } else { 0.0 });
            let filter = Filter {
                system: &system,
                p,
                experiment: e,
                substeps,
                sigma: &scene.sigma,
                start: (&x0, &sd),
                noise: Noise::Diagonal(&noise),
                control,
            };
            let Ok(f) = filter.forward() else { return Ok(None) };
            total += f.log_likelihood;
            if smooth {
                forces.push(force(&probe, &sensed, p, port, e, &f.smooth())?);
            }
        }
        Ok(Some((total, forces)))
    };
    let Some((without, _)) = run(0.0, false)? else { return Ok(None) };
    // A walk over decades from the middle is enough: the likelihood is flat around its top.
    let seconds: f64 = train.iter().map(|e| e.len() as f64 * e.dt).fold(0.0, f64::max);
    let intensity = |n: i32| reach * 10f64.powf(0.75 * f64::from(n)) / (0.05 * seconds).sqrt();
    let likelihood = |n: i32| run(intensity(n), false).map(|r| r.map(|(l, _)| l));
    let mut best: Option<(f64, f64)> = None;
    let (mut at, mut tried) = (-2, Vec::new());
    loop {
        let mut higher = at;
        for n in [at, at - 1, at + 1] {
            if (-5..=2).contains(&n) && !tried.contains(&n) {
                tried.push(n);
                if let Some(l) = likelihood(n)?
                    && best.is_none_or(|(b, _)| l > b)
                {
                    best = Some((l, intensity(n)));
                    higher = n;
                }
            }
        }
        if higher == at {
            break;
        }
        at = higher;
    }
    let Some((likelihood, intensity)) = best else { return Ok(None) };
    Ok(run(intensity, true)?.map(|(_, forces)| (likelihood - without, forces)))
}

/// Size of a force at the last state's port that would matter: what moves a state by its size at the motion's speed.
fn reach(system: &dyn System, p: &[f64], train: &[Experiment], scene: &Scene) -> f64 {
    let nx = system.states();
    let mut x = scene.start[0].clone();
    x.push(0.0);
    let mut u = vec![0.0; system.inputs()];
    train[0].inputs.eval(0, train[0].t0, &mut u);
    let mut flow = vec![0.0; nx + nx * nx];
    let at = Point { t: train[0].t0, x: &x, u: &u, p };
    let mode = system.settle(system.initial_mode(), at);
    system.flow_jacobian(mode, at, &mut flow);
    let of = |i: usize| {
        let b = flow[nx + i * nx + nx - 1].abs();
        if b > 0.0 { scene.state_scale[i] * scene.speed / b } else { f64::INFINITY }
    };
    let r = (0..nx - 1).map(of).fold(f64::INFINITY, f64::min);
    if r.is_finite() { r } else { 1.0 }
}

/// The smoothed force with position and velocity of its port, and the forces that nominal parameters could imitate.
fn force(
    probe: &Model,
    system: &dyn System,
    p: &[f64],
    port: &str,
    e: &Experiment,
    s: &super::kalman::Smoothed,
) -> Result<Force> {
    let nx = system.states();
    let motion = probe.port_motion(port)?;
    let mut u = vec![0.0; system.inputs()];
    let mut out = Force { record: e.name.clone(), at: port.to_string(), ..Force::default() };
    let mut pv = [0.0; 2];
    let nf = system.free().len();
    let mut flow = vec![0.0; nx + nx * nx + nx * nf];
    out.imitable = vec![Vec::new(); nf];
    let period = system.period(p);
    let mut x = vec![0.0; nx];
    for k in 0..e.len() {
        let t = e.t0 + k as f64 * e.dt;
        e.inputs.eval(e.inputs.interval(t + 1e-6 * e.dt), t, &mut u);
        motion.eval(Point { t, x: &s.x[k * nx..(k + 1) * nx], u: &u, p }, &mut pv);
        out.t.push(t);
        out.position.push(pv[0]);
        out.velocity.push(pv[1]);
        out.force.push(s.x[(k + 1) * nx - 1]);
        out.sd.push(s.sd[(k + 1) * nx - 1]);
        // A mode of the document, whether or not its friction sticks.
        let name = system.mode_name(s.mode[k]);
        let name = name.split(", ").next().unwrap_or_default();
        let known = out.modes.iter().position(|m| m == name);
        out.mode.push(known.unwrap_or(out.modes.len()));
        if known.is_none() {
            out.modes.push(name.to_owned());
        }
        out.phase.extend(period.map(|period| (t / period).rem_euclid(1.0)));
        // A parameter's change moves the rates; what of that lies along the port's action is a force there. The missing
        // force itself stays out: with it, the common scale of all forces would be a parameter that explains anything.
        x.copy_from_slice(&s.x[k * nx..(k + 1) * nx]);
        x[nx - 1] = 0.0;
        system.flow_jacobian(s.mode[k], Point { t, x: &x, u: &u, p }, &mut flow);
        let action = |i: usize| flow[nx + i * nx + nx - 1];
        let own: f64 = (0..nx).map(|i| action(i).powi(2)).sum();
        for (c, column) in out.imitable.iter_mut().enumerate() {
            let along: f64 = (0..nx).map(|i| action(i) * flow[nx + nx * nx + i * nf + c]).sum();
            column.push(if own > 0.0 { along / own } else { 0.0 });
        }
    }
    Ok(out)
}

/// On what a force depends: the variable that explains most on left-out blocks, and its p-value.
fn depends_on(forces: &[Force], seed: u64) -> (&'static str, f64) {
    let total: usize = forces.iter().map(|f| f.t.len()).sum();
    let every = total.div_ceil(KEPT).max(1);
    let pick = |of: &dyn Fn(&Force) -> &Vec<f64>| -> Vec<f64> {
        forces.iter().flat_map(|f| of(f).iter().step_by(every).copied().collect::<Vec<_>>()).collect()
    };
    let w = pick(&|f| &f.force);
    let (q, v, t) = (pick(&|f| &f.position), pick(&|f| &f.velocity), pick(&|f| &f.t));
    let scaled = |x: &[f64]| -> Vec<f64> {
        let s = stats::rms(x.iter().copied()).max(f64::MIN_POSITIVE);
        x.iter().map(|x| x / s).collect()
    };
    let (q, v) = (scaled(&q), scaled(&v));
    // At rest dry friction takes whatever value holds: those samples say nothing about the law.
    let w: Vec<f64> = w.iter().zip(&v).map(|(w, v)| if v.abs() < REST { f64::NAN } else { *w }).collect();
    let sign: Vec<f64> = v.iter().map(|v| v.signum()).collect();
    let drag: Vec<f64> = v.iter().map(|v| v * v.abs()).collect();
    // What nominal parameters could still explain.
    let free = forces.first().map_or(0, |f| f.imitable.len());
    let base: Vec<Vec<f64>> = (0..free)
        .map(|c| scaled(&pick(&|f| &f.imitable[c])))
        .filter(|column| stats::std(column.iter().copied()) > 1e-9)
        .collect();
    let groups: [(&'static str, Vec<Vec<f64>>); 5] = [
        ("sign of velocity", vec![sign]),
        ("velocity", [vec![v.clone(), drag], splines(&v, SMOOTH)].concat()),
        ("position", [vec![q.clone()], splines(&q, SMOOTH)].concat()),
        ("position", splines(&q, RIPPLED)),
        ("time", splines(&t, DRIFT)),
    ];
    let level = stats::mean(w.iter().copied()).abs();
    let doubt = stats::median(&pick(&|f| &f.sd));
    if level > stats::std(w.iter().copied()).max(3.0 * doubt) {
        return (CONSTANT, 1.0 / f64::from(SHIFTS as u32 + 1));
    }
    let beyond = strongest(&w, &base, &groups, seed);
    // Where nominal parameters could say it all, what the force follows is still worth knowing.
    let (variable, _, p) = if beyond.1 > 0.0 { beyond } else { strongest(&w, &[], &groups, seed) };
    (variable, p)
}

/// A smooth function of a series: its cubic B-splines between the one-percent quantiles, the first left out because a
/// constant is always part of a regression.
fn splines(x: &[f64], pieces: usize) -> Vec<Vec<f64>> {
    let (low, high) = (stats::quantile(x, 0.01), stats::quantile(x, 0.99));
    let Ok(basis) = BSplines::new(low, high, pieces) else { return Vec::new() };
    let rows: Vec<Vec<f64>> = x.iter().map(|&x| basis.row(x.clamp(low, high))).collect();
    (1..basis.len()).map(|j| rows.iter().map(|r| r[j]).collect()).collect()
}

/// The group of columns that explains most of a series beyond a base.
fn strongest(
    w: &[f64],
    base: &[Vec<f64>],
    groups: &[(&'static str, Vec<Vec<f64>>)],
    seed: u64,
) -> (&'static str, f64, f64) {
    let own = if base.is_empty() { 0.0 } else { regression::explained(w, base, BLOCKS).max(0.0) };
    let mut best = ("nothing it was tested against", 0.0, 1.0);
    for (name, columns) in groups {
        let mut all = base.to_vec();
        all.extend(columns.iter().cloned());
        let share = regression::explained(w, &all, BLOCKS) - own;
        // A later, richer group must explain a good part of what a simpler one leaves.
        let left = if best.1 > 0.0 { RICHER * (1.0 - own - best.1) } else { 0.0 };
        if share > best.1 + left.max(0.02) {
            let p = regression::shift_p_value(w, base, columns, BLOCKS, SHIFTS, seed);
            best = (*name, share, if p.is_finite() { p } else { 1.0 });
        }
    }
    best
}
