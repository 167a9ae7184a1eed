//! Which effects are concealed, and their numbers: shapes relative to the natural sizes of the place, one strength that is
//! then adjusted until the output changes as much as was asked for.

use super::Planted;
use super::machine::Machine;
use super::setups::Setup;
use crate::error::{Error, Result};
use crate::model::document::{Definition, FullDefinition};
use crate::model::parse::parse;
use crate::model::{Model, Point};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;

/// How the names of laws begin that the library does not hold.
const BEYOND: &str = "outside_";

/// Laws that the library does not hold, for the difficulty `outside`: name and document.
pub const OUTSIDE: [(&str, &str); 6] = [
    (
        "outside_velocity_position_squared",
        r#"sentence = "a damping that pushes near the middle and brakes far from it"
on = "port"
law = "-damping*velocity*((position/width)^2 - 1)"
reference = "van der Pol 1926"
[parameters]
damping = { unit = "force/velocity" }
width = { unit = "position", min = 0.0 }
"#,
    ),
    (
        "outside_ripple_damping",
        r#"sentence = "a damping that alternates along the way"
on = "port"
law = "-damping*sin(position/length)*velocity"
reference = "made for the proof"
[parameters]
damping = { unit = "force/velocity" }
length = { unit = "position", min = 0.0 }
"#,
    ),
    (
        "outside_cubic_drag",
        r#"sentence = "a drag with the third power of speed"
on = "port"
law = "-drag*velocity^3"
reference = "made for the proof"
[parameters]
drag = { unit = "force/velocity^3" }
"#,
    ),
    (
        "outside_soft_wall",
        r#"sentence = "a wall on one side whose force grows exponentially"
on = "port"
law = "-force*exp(position/length)"
reference = "made for the proof"
[parameters]
force = { unit = "force" }
length = { unit = "position", min = 0.0 }
"#,
    ),
    (
        "outside_quadratic_stiffness",
        r#"sentence = "a spring whose force grows with the square of its stretch"
on = "port"
law = "-stiffness*position*abs(position)"
reference = "made for the proof"
[parameters]
stiffness = { unit = "force/position^2" }
"#,
    ),
    (
        "outside_one_sided_drag",
        r#"sentence = "a drag that acts in one direction only, with the square of speed"
on = "port"
law = "-drag*max(velocity, 0)^2"
reference = "made for the proof"
[parameters]
drag = { unit = "force/velocity^2" }
"#,
    ),
];

/// Sizes of what happens at one place.
#[derive(Clone, Copy, Debug, Default)]
pub struct Natural {
    /// rms of the force that its motion takes, of an input or of an output.
    pub force: f64,
    /// Spread of a position, an input or an output.
    pub position: f64,
    /// rms of its rate.
    pub velocity: f64,
    /// Largest magnitude.
    pub peak: f64,
    /// Smallest and largest value.
    pub range: (f64, f64),
    /// Change of a velocity's rate per unit of force.
    pub authority: f64,
    /// Length of the record, s.
    pub time: f64,
}

impl Natural {
    /// Sizes at a place of a model: a port, an input, a signal or an output.
    ///
    /// # Errors
    /// When the nominal machine does not run.
    pub fn of(model: &Model, setup: &Setup, at: &str) -> Result<Self> {
        let mut document = model.document().clone();
        let port = document.ports.get(at).cloned();
        let expressions = match &port {
            Some(p) => vec![p.position.clone(), p.velocity.clone()],
            None => vec![document.outputs.get(at).map_or_else(|| at.to_string(), |o| o.expression().to_string())],
        };
        // What is measured stays first: the check of the motion looks at it.
        for (k, value) in expressions.into_iter().enumerate() {
            let full = FullDefinition { value, unit: None, column: None };
            document.outputs.insert(format!("natural {k}"), Definition::Full(full));
        }
        let shown = Model::new(document, model.library().clone(), "")?;
        let machine = Machine::new(&shown, &[])?;
        let ny = shown.outputs().len();
        let take = setup.measure(model, &machine, 0)?;
        let column = |j: usize| -> Vec<f64> { take.motion.outputs.iter().skip(j).step_by(ny).copied().collect() };
        let rate = |v: &[f64]| stats::rms(v.windows(2).map(|w| (w[1] - w[0]) / setup.dt));
        let first = model.outputs().len();
        let position = column(first);
        let mut out = Self {
            position: stats::std(position.iter().copied()),
            range: position.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v))),
            peak: position.iter().map(|v| v.abs()).fold(0.0, f64::max),
            velocity: rate(&position),
            time: setup.dt * setup.samples as f64,
            ..Self::default()
        };
        out.force = stats::rms(position.iter().copied());
        if port.is_some() {
            let velocity = column(first + 1);
            out.velocity = stats::rms(velocity.iter().copied());
            out.authority = authority(model, at)?;
            // Events make jumps of velocity that no force explains: the middle of the rates is what counts.
            let rates: Vec<f64> = velocity.windows(2).map(|w| ((w[1] - w[0]) / setup.dt).abs()).collect();
            out.force = 1.5 * stats::median(&rates) / out.authority.max(f64::MIN_POSITIVE);
        }
        Ok(out)
    }

    /// Typical angular frequency, rad/s.
    fn omega(&self) -> f64 {
        self.velocity / self.position.max(f64::MIN_POSITIVE)
    }
}

/// Change of the port's acceleration per unit of its force, the largest of all modes.
fn authority(model: &Model, port: &str) -> Result<f64> {
    let probe = model.attach("coulomb_friction", port, &[])?;
    let x: Vec<f64> = probe.document().states.values().map(|s| s.value).collect();
    let p: Vec<f64> = probe.parameters().iter().map(|p| p.value).collect();
    let u = vec![0.0; probe.inputs().len()];
    let (modes, _, _) = probe.all_parts().unwrap_or_default();
    let mut element = [0.0; 3];
    let each = modes.iter().map(|m| {
        m.element.eval(Point { t: 0.0, x: &x, u: &u, p: &p }, &mut element);
        element[2]
    });
    Ok(each.fold(0.0, f64::max))
}

/// An effect whose shape is drawn and whose strength is still open.
#[derive(Clone, Debug)]
pub struct Sketch {
    name: String,
    at: String,
    natural: Natural,
    /// Four numbers in [0, 1) for the shape, and a sign.
    dice: [f64; 4],
    sign: f64,
    /// Value and stated uncertainty, for effects on a parameter.
    stated: (f64, f64),
}

impl Sketch {
    /// Draws the shape.
    ///
    /// # Errors
    /// When the nominal machine does not run.
    pub fn new(model: &Model, setup: &Setup, name: &str, at: &str, random: &mut SplitMix64) -> Result<Self> {
        let dice = std::array::from_fn(|_| random.uniform());
        let sign = if random.uniform() < 0.5 { -1.0 } else { 1.0 };
        let mut stated = (0.0, 0.0);
        let natural = if name.starts_with("parameter") {
            let p = &model.parameters()[model.parameter(at)?];
            stated = (p.value, p.sd.unwrap_or(0.0));
            Natural { time: setup.dt * setup.samples as f64, ..Natural::default() }
        } else {
            let place = model.document().contacts.get(at).and_then(|c| c.port.clone());
            Natural::of(model, setup, place.as_deref().unwrap_or(at))?
        };
        let (low, high) = natural.range;
        // A gap in the middle of a spring that never passes its middle is a constant force.
        if name == "backlash" && !(low < -0.2 * natural.position && high > 0.2 * natural.position) {
            return Err(Error::OutOfRange {
                what: format!("least position of `{at}`"),
                found: low,
                expected: "a motion through the middle of the gap".into(),
            });
        }
        Ok(Self { name: name.into(), at: at.into(), natural, dice, sign, stated })
    }

    /// The effect at a strength; about one where it rivals what acts there already.
    pub fn at_strength(&self, s: f64) -> Planted {
        let n = &self.natural;
        let [a, b, c, d] = self.dice;
        let between = |x: f64, low: f64, high: f64| low * (high / low).powf(x);
        let (f, q, v, omega) = (n.force, n.position, n.velocity, n.omega());
        let sign = self.sign;
        let turn = 2.0 * std::f64::consts::PI;
        let list: Vec<(&str, f64)> = match self.name.as_str() {
            "viscous_friction" => vec![("damping", s * f / v)],
            "coulomb_friction" => vec![("force", s * f)],
            "stribeck_friction" => vec![
                ("force", s * f),
                ("static_force", s * f * between(a, 1.4, 2.2)),
                ("stribeck_velocity", v * between(b, 0.05, 0.4)),
            ],
            "quadratic_drag" => vec![("drag", s * f / (v * v))],
            "linear_stiffness" => vec![("stiffness", s * f / q)],
            "cubic_stiffness" => vec![("cubic_stiffness", s * f / (q * q * q))],
            "constant_force" => vec![("force", sign * s * f)],
            "backlash" => vec![("gap", s * q)],
            "hysteresis" => {
                let width = q * between(a, 0.1, 0.6);
                let sharpness = 1.4 + 1.2 * b;
                vec![("stiffness", s * f / width), ("yield_displacement", width), ("sharpness", sharpness)]
            }
            "position_periodic_force" => {
                vec![("amplitude", s * f), ("wavelength", q * between(a, 0.3, 2.0)), ("phase", turn * b)]
            }
            "time_periodic_force" => {
                vec![("amplitude", s * f), ("omega", omega * between(a, 0.5, 2.0)), ("phase", turn * b)]
            }
            "added_mass" => vec![("mass", s / n.authority)],
            "flexible_mode" => {
                let (mass, w) = (s / n.authority, omega * between(a, 1.2, 4.0));
                vec![("mass", mass), ("stiffness", mass * w * w), ("damping", 2.0 * between(b, 0.03, 0.2) * mass * w)]
            }
            "input_gain" | "output_gain" => vec![("gain", 1.0 + sign * s.min(0.9))],
            "input_bias" | "output_bias" => vec![("bias", sign * s * q)],
            "input_delay" | "output_delay" => vec![("delay", s / omega)],
            "input_lag" | "output_lag" => vec![("time_constant", s / omega)],
            "input_saturation" => vec![("limit", n.peak / (1.0 + s))],
            "input_dead_zone" => vec![("width", s * q)],
            "output_backlash" => vec![("gap", s * q)],
            "compliant_ground" => {
                let stiffness = f / q / (0.1 * s);
                vec![("stiffness", stiffness), ("damping", between(a, 0.05, 0.5) * (stiffness / n.authority).sqrt())]
            }
            "restitution" => vec![("coefficient", s.min(0.7))],
            "ground_height" => vec![("height", sign * s * q)],
            // A parameter with an uncertainty is off by five to fifteen of them, an exact one by as much as shows.
            "parameter_error" if self.stated.1 > 0.0 => vec![("offset", sign * (5.0 + 10.0 * c) * self.stated.1)],
            "parameter_error" => vec![("offset", sign * s * self.stated.0)],
            "parameter_drift" => vec![("rate", sign * s * self.stated.0 / n.time)],
            "outside_velocity_position_squared" => {
                vec![("damping", s * f / v), ("width", q * between(a, 0.5, 1.2))]
            }
            "outside_ripple_damping" => vec![("damping", s * f / v), ("length", q * between(a, 0.1, 0.3))],
            "outside_cubic_drag" => vec![("drag", s * f / (v * v * v))],
            "outside_soft_wall" => vec![("force", s * f * 0.1), ("length", q * between(d, 0.3, 0.6))],
            "outside_quadratic_stiffness" => vec![("stiffness", s * f / (q * q))],
            "outside_one_sided_drag" => vec![("drag", s * f / (v * v))],
            _ => Vec::new(),
        };
        let parameters = list.into_iter().map(|(n, v)| (n.to_string(), v)).collect();
        Planted { name: self.name.clone(), at: self.at.clone(), parameters }
    }

    /// Whether the strength is open; a parameter's error is drawn in its own uncertainty.
    pub fn adjustable(&self) -> bool {
        self.name != "parameter_error" || self.stated.1 == 0.0
    }
}

/// Whether an input, or a signal that depends on time, inputs and parameters only: what an actuator is told.
fn drives(model: &Model, at: &str) -> bool {
    let d = model.document();
    let tree = d.signals.get(at).and_then(|s| parse(s.expression(), "").ok());
    tree.is_none_or(|t| !d.states.keys().chain(d.signals.keys()).any(|n| t.mentions(n)))
}

/// Everything that may be concealed in a model: effect and place.
///
/// # Errors
/// Never for names of the library.
pub fn places(model: &Model, outside: bool) -> Result<Vec<(String, String)>> {
    let mut out = Vec::new();
    let library: Vec<&str> = model.library().names().collect();
    for name in library.into_iter().filter(|n| n.starts_with(BEYOND) == outside) {
        let mut here = model.places(name)?;
        if name == "parameter_error" {
            here.extend(model.parameters().iter().filter(|p| p.sd.is_some()).map(|p| p.name.clone()));
        }
        if name.starts_with("input_") {
            here.retain(|at| drives(model, at));
        }
        out.extend(here.into_iter().map(|at| (name.to_string(), at)));
    }
    Ok(out)
}
