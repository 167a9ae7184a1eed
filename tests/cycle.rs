//! Periodic orbits and their linearization: closed forms, published values, two routes, several orbits, refusals.

use ltp_core::cycle::{LimitCycle, Options, cycle, survey};
use ltp_core::error::Error;
use ltp_core::linearize::linearize;
use ltp_core::model::{Backend, Compiled, Model, Point, System, zoo};
use ltp_core::numeric::Complex;

fn compiled(name: &str) -> Compiled {
    zoo(name).unwrap().compile_for(Vec::new(), Backend::Native)
}

fn found(system: &Compiled) -> LimitCycle {
    cycle(system, system.parameters(), &Options::default()).unwrap()
}

/// Event phases and multipliers of the hopper by closed-form flows and Newton's method, for both liftoff guards.
#[test]
fn the_hopper_has_its_closed_form_orbit() {
    let printed = zoo("hopper").unwrap();
    let text = printed.to_toml().unwrap().replace("guard = \"f\"", "guard = \"f + m*g\"");
    let weighted = Model::from_toml(&text, "hopper with the toe's weight in the guard").unwrap();
    let expected = [
        (&printed, 0.024890445, 0.825119006, Complex::new(0.160353154, 0.832614057)),
        (&weighted, 0.025065644, 0.825120932, Complex::new(0.160349014, 0.832614856)),
    ];
    for (model, liftoff, touchdown, multiplier) in expected {
        let system = model.compile_for(Vec::new(), Backend::Native);
        let orbit = found(&system);
        let phases: Vec<(&str, f64)> = orbit.events.iter().map(|e| (e.name.as_str(), e.phase)).collect();
        assert_eq!(phases.len(), 2, "{phases:?}");
        assert!(phases[0].0 == "liftoff" && (phases[0].1 - liftoff).abs() < 1e-8, "{phases:?}");
        assert!(phases[1].0 == "touchdown" && (phases[1].1 - touchdown).abs() < 1e-8, "{phases:?}");
        for (found, expected) in orbit.multipliers.iter().zip([multiplier, multiplier.conj(), 0.0.into(), 0.0.into()]) {
            assert!((found - expected).norm() < 1e-8, "{found} {expected}");
        }
        assert!(orbit.stable && !orbit.autonomous && orbit.held.is_empty());
        assert!(orbit.integration_error < 1e-10, "{}", orbit.integration_error);
        assert!(orbit.residual < 1e-10, "{}", orbit.residual);
    }
}

/// The engine's own sensitivities and collocation with saltation written out: they share no formula.
#[test]
fn two_routes_to_the_monodromy_agree() {
    for name in ["hopper", "mathieu", "duffing", "van_der_pol", "three_mode_hopper"] {
        let system = compiled(name);
        let orbit = found(&system);
        let lin = linearize(&system, system.parameters(), &orbit).unwrap();
        let size = orbit.monodromy.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for (a, b) in orbit.monodromy.iter().zip(lin.monodromy()) {
            assert!((a - b).abs() < 1e-9 * size, "{name}: {a} {b}");
        }
        for (a, b) in orbit.multipliers.iter().zip(lin.multipliers()) {
            assert!((a - b).norm() < 1e-9, "{name}: {a} {b}");
        }
    }
}

/// Liouville: without jumps the multipliers' product is the exponential of the integrated trace.
#[test]
fn the_determinant_is_the_integral_of_the_divergence() {
    for name in ["mathieu", "duffing", "van_der_pol"] {
        let system = compiled(name);
        let orbit = found(&system);
        let lin = linearize(&system, system.parameters(), &orbit).unwrap();
        let trace = lin.fourier(ltp_core::periodic::Entry::A, 0)[0].iter().step_by(3).sum::<Complex>();
        let product: Complex = lin.multipliers().iter().product();
        assert!((product - (trace * orbit.period).exp()).norm() < 1e-11, "{name}: {product}");
    }
}

/// The period of van der Pol's oscillator at mu = 1 is known to many digits (Urabe 1960); one multiplier is one.
#[test]
fn van_der_pol_without_a_clock() {
    let model = zoo("van_der_pol").unwrap().with_parameters(&[("mu", 1.0, None)]).unwrap();
    let system = model.compile_for(Vec::new(), Backend::Native);
    let orbit = found(&system);
    assert!((orbit.period - 6.66328685932).abs() < 1e-9, "{}", orbit.period);
    assert!((orbit.multipliers[0] - 1.0).norm() < 1e-9 && orbit.stable && orbit.autonomous);
    // Its amplitude is 2.00861986087484 (Shampine, Gladwell, Thompson 2003): the orbit's largest x.
    let largest = orbit.trajectory.states.iter().step_by(2).fold(0.0_f64, |m, x| m.max(x.abs()));
    // A sample misses the top by at most |x''| dt^2 / 8, with |x''| = |x| there.
    let dt = orbit.period / 500.0;
    assert!(largest < 2.00861986088 && largest > 2.00861986087 * (1.0 - dt * dt / 8.0), "{largest}");
}

/// Backward in time the limit cycle repels: settling would leave it, Newton's method from nearby does not.
#[test]
fn an_unstable_orbit_is_found_from_nearby() {
    let text = "name = \"reversed\"\n[states]\nx = { value = 2.0, unit = \"1\" }\nv = { value = 0.1, unit = \"1\" }\n\
                [parameters]\nr = { value = 1.0, unit = \"1/s\" }\nmu = { value = 0.3, unit = \"1\" }\n\
                [flow]\nx = \"-r*v\"\nv = \"-r*(mu*(1 - x^2)*v - x)\"\n[outputs]\nx = { value = \"x\", unit = \"1\" }\n";
    let model = Model::from_toml(text, "reversed").unwrap();
    let system = model.compile_for(Vec::new(), Backend::Native);
    let options = Options { settle: Some(0), period: Some(6.2), ..Options::default() };
    let orbit = cycle(&system, system.parameters(), &options).unwrap();
    assert!(!orbit.stable && orbit.autonomous);
    // What contracts forward in time expands backward by the inverse, in the same period.
    let forward = found(&zoo("van_der_pol").unwrap().with_parameters(&[("mu", 0.3, None)]).unwrap().compile());
    assert!((orbit.period - forward.period).abs() < 1e-9, "{} {}", orbit.period, forward.period);
    assert!((orbit.multipliers[0].re * forward.multipliers[1].re - 1.0).abs() < 1e-6, "{:?}", orbit.multipliers);
}

/// One period multiplies perturbations by 5e5: single shooting from this start fails, arcs do not.
#[test]
fn multiple_shooting_reaches_what_single_shooting_loses() {
    let text = "name = \"steep\"\n[states]\nx = { value = 1.0, unit = \"1\" }\n[parameters]\nr = { value = 13.0, unit = \"1/s\" }\n\
                w = { value = 6.283185307179586, unit = \"rad/s\" }\n[clock]\nperiod = \"2*pi/w\"\n\
                [flow]\nx = \"r*(x - cos(w*t) + x^3/130)\"\n\
                [outputs]\nx = { value = \"x\", unit = \"1\" }\n";
    let model = Model::from_toml(text, "steep").unwrap();
    let system = model.compile_for(Vec::new(), Backend::Native);
    let options = Options { settle: Some(0), ..Options::default() };
    let orbit = cycle(&system, system.parameters(), &options).unwrap();
    assert!(orbit.multipliers[0].re > 1e5 && !orbit.stable, "{:?}", orbit.multipliers);
    // The orbit solves its equation: the derivative of the samples agrees with the flow.
    let (dt, x) = (orbit.trajectory.t[1], &orbit.trajectory.states);
    for k in (2..x.len() - 2).step_by(50) {
        let slope = (8.0 * (x[k + 1] - x[k - 1]) - (x[k + 2] - x[k - 2])) / (12.0 * dt);
        let mut rate = [0.0];
        system.flow(0, Point { t: orbit.trajectory.t[k], x: &x[k..=k], u: &[], p: system.parameters() }, &mut rate);
        assert!((slope - rate[0]).abs() < 1e-5 * (1.0 + rate[0].abs()), "{slope} {}", rate[0]);
    }
}

/// Research knows two attractors of the hopper; from the zoo's start the hopping one is found, and the other is reported.
#[test]
fn the_second_attractor_is_reported_not_fallen_into() {
    let system = compiled("hopper");
    let orbit = found(&system);
    assert_eq!(orbit.events.len(), 2);
    let around = survey(&system, system.parameters(), &orbit, 16, 1).unwrap();
    assert!(around.returned > 0 && around.radius > 0.0 && around.radius < 2.0, "{around:?}");
    assert_eq!(around.others.len(), 1);
    let (other, count) = &around.others[0];
    assert_eq!(around.returned + count + around.lost.len(), around.probes);
    assert!(other.events.is_empty() && other.stable && !other.held.is_empty(), "{:?}", other.multipliers);
    let nx = other.start.len();
    let heights = other.trajectory.states.iter().step_by(nx);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
    assert!((low - 0.1824).abs() < 5e-5 && (high - 0.2095).abs() < 5e-5, "{low} {high}");
    // Chosen by the start, it is found directly.
    let flight = zoo("hopper").unwrap().mode("flight").unwrap();
    let start = Some(vec![0.24, 0.04, 0.0, 0.0]);
    let options = Options { start, mode: Some(flight), ..Options::default() };
    let chosen = cycle(&system, system.parameters(), &options).unwrap();
    assert!(chosen.events.is_empty() && chosen.settled > 0, "{:?}", chosen.events);
}

/// A sampled controller is a jump at a fixed time: the discrete closed form of a sampled integrator.
#[test]
fn sampled_updates_are_jumps() {
    let text = "name = \"sampled\"\n[states]\nx = { value = 0.3, unit = \"1\" }\nz = { value = 0.0, unit = \"1\" }\n\
                [parameters]\nr = { value = 1.0, unit = \"1/s\" }\nw = { value = 6.283185307179586, unit = \"rad/s\" }\n\
                [clock]\nperiod = \"2*pi/w\"\n[flow]\nx = \"r*(z + cos(w*t))\"\nz = \"0\"\n\
                [[ticks]]\nname = \"control\"\nevery = \"pi/w\"\nupdate = { z = \"-0.4*x\" }\n\
                [outputs]\nx = { value = \"x\", unit = \"1\" }\n";
    let model = Model::from_toml(text, "sampled").unwrap();
    let system = model.compile_for(Vec::new(), Backend::Native);
    let orbit = found(&system);
    let lin = linearize(&system, system.parameters(), &orbit).unwrap();
    // x+ = x - 0.4*0.5*x at each tick, twice in a period; z is overwritten.
    assert!((lin.multipliers()[0] - 0.64).norm() < 1e-12, "{:?}", lin.multipliers());
    for (a, b) in orbit.multipliers.iter().zip(lin.multipliers()) {
        assert!((a - b).norm() < 1e-10, "{:?} {:?}", orbit.multipliers, lin.multipliers());
    }
}

#[test]
fn refusals_say_why() {
    let system = compiled("hopper");
    let p = system.parameters();
    let fails = |options: Options| cycle(&system, p, &options).unwrap_err();
    let short = fails(Options { start: Some(vec![0.2]), ..Options::default() });
    assert!(matches!(short, Error::Shape { expected: 4, found: 1, .. }), "{short}");
    let nan = fails(Options { start: Some(vec![f64::NAN, 0.0, 0.0, 0.0]), ..Options::default() });
    assert!(matches!(nan, Error::NotFinite { .. }), "{nan}");
    let period = fails(Options { period: Some(-1.0), ..Options::default() });
    assert!(period.to_string().contains("period = -1"), "{period}");
    let ball = compiled("bouncing_ball");
    let zeno = cycle(&ball, ball.parameters(), &Options::default()).unwrap_err();
    assert!(matches!(zeno, Error::NoConvergence { .. }) && zeno.to_string().contains("impact"), "{zeno}");
    let other = compiled("duffing");
    let orbit = found(&other);
    assert!(matches!(linearize(&system, p, &orbit).unwrap_err(), Error::Shape { .. }));
}
