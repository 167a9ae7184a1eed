//! Owns: derivatives through events. Closed forms are differenced where there is one; elsewhere the simulator itself,
//! whose values other tests certify.

#[path = "oracles/closed_forms.rs"]
mod closed_forms;

use closed_forms::{BouncingBall, StickSlip, ThreeModeHopper};
use ltp_core::model::{Backend, Compiled, Model, System, zoo};
use ltp_core::simulate::{Inputs, Plan, simulate};

/// Central difference of fourth order.
fn slope<const N: usize>(f: impl Fn(f64) -> [f64; N], h: f64) -> [f64; N] {
    let (pp, p, n, nn) = (f(2.0 * h), f(h), f(-h), f(-2.0 * h));
    std::array::from_fn(|i| (8.0 * (p[i] - n[i]) - (pp[i] - nn[i])) / (12.0 * h))
}

fn all(model: &Model) -> Compiled {
    model.compile_for((0..model.parameters().len()).collect(), Backend::Native)
}

/// Last state and its sensitivities.
fn end(
    system: &Compiled,
    p: &[f64],
    x0: &[f64],
    u: &[f64],
    t: f64,
    step: f64,
    derivatives: bool,
) -> (Vec<f64>, Vec<f64>) {
    let mut plan = Plan::new(t, t).unwrap().with_step(step).from(x0);
    plan.derivatives = derivatives;
    let found = simulate(system, p, &Inputs::constant(u), &plan).unwrap();
    assert!(found.stop.is_finished(), "{}", found.stop.sentence());
    let (nx, ns) = (x0.len(), found.sensitivities.len() / 2);
    (found.states[nx..].to_vec(), found.sensitivities[ns..].to_vec())
}

/// Compares with central differences of the simulator, column by column, for the states and parameters in `columns`.
fn against_differences(system: &Compiled, u: &[f64], t: f64, step: f64, columns: &[usize], tolerance: f64) {
    let (nx, p) = (system.states(), system.parameters().to_vec());
    let x0 = system.initial_state();
    let ns = nx + p.len();
    let (_, s) = end(system, &p, &x0, u, t, step, true);
    for &c in columns {
        let base = if c < nx { x0[c] } else { p[c - nx] };
        let h = 1e-5 * base.abs().max(0.1);
        let value = |d: f64| {
            let (mut x, mut q) = (x0.clone(), p.clone());
            if c < nx {
                x[c] += d;
            } else {
                q[c - nx] += d;
            }
            end(system, &q, &x, u, t, step, false).0
        };
        let (pp, pl, mi, mm) = (value(2.0 * h), value(h), value(-h), value(-2.0 * h));
        let expected: Vec<f64> = (0..nx).map(|r| (8.0 * (pl[r] - mi[r]) - (pp[r] - mm[r])) / (12.0 * h)).collect();
        let size = expected.iter().fold(0.0f64, |m, v| m.max(v.abs())).max(1e-2);
        for (r, e) in expected.iter().enumerate() {
            let found = s[r * ns + c];
            assert!((found - e).abs() <= tolerance * size, "t {t}, row {r}, column {c}: found {found}, expected {e}");
        }
    }
}

#[test]
fn three_mode_hopper_has_the_jacobian_of_its_closed_form() {
    let system = all(&zoo("three_mode_hopper").unwrap());
    let (_, s) = end(&system, system.parameters(), &[1.2, 0.0], &[], 10.0, 1e-3, true);
    let base = ThreeModeHopper::default();
    // the apex of a start with speed v is higher by v^2/2g and was passed v/g earlier or later
    let at = |m: ThreeModeHopper, v: f64| {
        let hop = ThreeModeHopper { y0: m.y0 + 0.5 * v * v / m.g, ..m }.at(10.0 - v / m.g);
        [hop.y, hop.v]
    };
    type Column<'a> = (&'a str, f64, &'a dyn Fn(f64) -> [f64; 2]);
    let columns: [Column<'_>; 8] = [
        ("y0", 1e-5, &|d| at(ThreeModeHopper { y0: base.y0 + d, ..base }, 0.0)),
        ("v0", 1e-4, &|d| at(base, d)),
        ("m", 1e-5, &|d| at(ThreeModeHopper { m: base.m + d, ..base }, 0.0)),
        ("g", 1e-4, &|d| at(ThreeModeHopper { g: base.g + d, ..base }, 0.0)),
        ("k", 1e-2, &|d| at(ThreeModeHopper { k: base.k + d, ..base }, 0.0)),
        ("c", 1e-4, &|d| at(ThreeModeHopper { c: base.c + d, ..base }, 0.0)),
        ("l0", 1e-6, &|d| at(ThreeModeHopper { l0: base.l0 + d, ..base }, 0.0)),
        ("l1", 1e-6, &|d| at(ThreeModeHopper { l1: base.l1 + d, ..base }, 0.0)),
    ];
    for (column, (name, step, f)) in columns.into_iter().enumerate() {
        let expected = slope(f, step);
        for (row, e) in expected.iter().enumerate() {
            let found = s[row * 8 + column];
            assert!((found / e - 1.0).abs() <= 1e-6, "d({row})/d{name}: found {found}, expected {e}");
        }
    }
}

#[test]
fn bouncing_ball_has_the_jacobian_of_its_closed_form() {
    let system = all(&zoo("bouncing_ball").unwrap());
    let ball = BouncingBall { g: 9.81, e: 0.8, y0: 1.0 };
    for t in [0.3, 1.0, 2.0, 3.0] {
        let (_, s) = end(&system, system.parameters(), &[1.0, 0.0], &[], t, 1e-3, true);
        let pair = |b: BouncingBall| [b.at(t).0, b.at(t).1];
        let by_y0 = slope(|d| pair(BouncingBall { y0: ball.y0 + d, ..ball }), 1e-5);
        let by_g = slope(|d| pair(BouncingBall { g: ball.g + d, ..ball }), 1e-4);
        let by_e = slope(|d| pair(BouncingBall { e: ball.e + d, ..ball }), 1e-6);
        for row in 0..2 {
            // columns y, v, m, g, e
            for (column, expected) in [(0, by_y0[row]), (2, 0.0), (3, by_g[row]), (4, by_e[row])] {
                let found = s[row * 5 + column];
                assert!(
                    (found - expected).abs() <= 1e-7 * expected.abs().max(1.0),
                    "{t} {row} {column}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn hopper_in_every_mode() {
    let model = zoo("hopper").unwrap();
    let system = all(&model);
    // h, hd and every parameter; the toe is held at the start. Stance, flight, stance again, flight again.
    let columns: Vec<usize> = [0, 2].into_iter().chain(4..4 + model.parameters().len()).collect();
    for t in [0.005, 0.15, 0.3, 0.62] {
        against_differences(&system, &[0.7], t, 2e-4, &columns, 1e-6);
    }
}

#[test]
fn sampled_controller() {
    let text = r#"
name = "servo"
[states]
q = { value = 1.0 }
v = {}
u = {}
q_old = { value = 1.0 }
[parameters]
M = { value = 2.0, sd = 0.1 }
b = { value = 0.5, sd = 0.1 }
kp = { value = 40.0, sd = 1.0 }
kd = { value = 6.0, sd = 1.0 }
Ts = { value = 0.02 }
[flow]
q = "v"
v = "(u - b*v)/M"
u = "0"
q_old = "0"
[[ticks]]
name = "controller"
every = "Ts"
update = { u = "-kp*q - kd*(q - q_old)/Ts", q_old = "q" }
[outputs]
q = "q"
"#;
    let model = Model::from_toml(text, "servo.toml").unwrap();
    let system = all(&model);
    for t in [0.01, 0.5, 1.0] {
        // the period itself is not differentiated: its ticks stay where they are
        against_differences(&system, &[], t, 5e-3, &[0, 1, 2, 3, 4, 5, 6, 7], 1e-7);
    }
}

/// A block under `A sin(w t)`.
const BLOCK: &str = include_str!("oracles/block.toml");

#[test]
fn stick_slip() {
    let block = Model::from_toml(BLOCK, "block.toml").unwrap();
    let system = all(&block.attach("coulomb_friction", "block", &[("force", 0.6)]).unwrap());
    let rig = StickSlip { m: 1.0, b: 0.3, coulomb: 0.6, amplitude: 1.0, omega: 2.0 };
    for t in [0.2, 1.0, 5.0, 20.3] {
        let (_, s) = end(&system, system.parameters(), &[0.0, 0.0], &[], t, 2e-3, true);
        let pair = |r: StickSlip| [r.at(t).q, r.at(t).v];
        let expected = [
            slope(|d| pair(StickSlip { m: rig.m + d, ..rig }), 1e-4),
            slope(|d| pair(StickSlip { b: rig.b + d, ..rig }), 1e-4),
            slope(|d| pair(StickSlip { amplitude: rig.amplitude + d, ..rig }), 1e-4),
            slope(|d| pair(StickSlip { omega: rig.omega + d, ..rig }), 1e-5),
            slope(|d| pair(StickSlip { coulomb: rig.coulomb + d, ..rig }), 1e-4),
        ];
        for (column, expected) in expected.iter().enumerate() {
            for (row, e) in expected.iter().enumerate() {
                let found = s[row * 7 + 2 + column];
                assert!((found - e).abs() <= 1e-7 * e.abs().max(1.0), "{t} {row} {column}: {found} {e}");
            }
        }
    }
}
