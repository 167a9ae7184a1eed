//! The cart-pendulum of Duyul's thesis in closed formulas, around given motions: what the tests of this module share.

use std::f64::consts::{PI, TAU};

use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;
use crate::periodic::system::NODES;
use crate::periodic::{LtpSystem, Segment, Size};

const MASS: f64 = 0.57 + 0.21;
const GRAVITY: f64 = 9.8;

/// Parameters that variants change.
#[derive(Clone, Copy)]
pub struct Plant {
    /// Pivot to centre of mass, m.
    pub length: f64,
    /// Damping of the pivot, N m s/rad.
    pub damping: f64,
    /// Spring at the pivot, N m/rad.
    pub spring: f64,
}

pub const DOWN: Plant = Plant { length: 0.3, damping: 0.05, spring: 0.0 };
pub const UP: Plant = Plant { length: 0.3, damping: 0.05, spring: 0.74 };

/// A sinusoid `offset + amplitude sin(w t + phase)` at its first two derivatives.
pub fn sinusoid(w: f64, (amplitude, phase, offset): (f64, f64, f64)) -> impl Fn(f64) -> [f64; 3] {
    move |t| {
        let (sin, cos) = (w * t + phase).sin_cos();
        [offset + amplitude * sin, amplitude * w * cos, -amplitude * w * w * sin]
    }
}

/// The system linearised along x(t), theta(t), with the voltage that (3.1) and (3.4) need for them; states x, theta, v, omega.
pub fn along(
    plant: Plant,
    period: f64,
    cart: impl Fn(f64) -> [f64; 3],
    pendulum: impl Fn(f64) -> [f64; 3],
) -> LtpSystem {
    let gauss = Gauss::new(NODES);
    let (count, size) = (16, Size { nx: 4, nu: 1, ny: 0 });
    let segment = |k: usize| {
        let (start, end) = (period * k as f64 / count as f64, period * (k + 1) as f64 / count as f64);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for node in &gauss.nodes {
            let t = start + node * (end - start);
            let (one, two) = matrices(plant, cart(t), pendulum(t));
            a.extend(one);
            b.extend(two);
        }
        Segment { start, end, a, b, c: vec![], d: vec![], jumps: vec![] }
    };
    LtpSystem::new(period, 0.0, size, (0..count).map(segment).collect()).expect("a system")
}

/// A and B where the motion passes; (3.1) to (3.4), with F = 1.72354 V - 7.72356 v.
fn matrices(plant: Plant, [_, _, a]: [f64; 3], [theta, omega, alpha]: [f64; 3]) -> ([f64; 16], [f64; 4]) {
    let m = 0.21 * plant.length;
    let inertia = 4.0 / 3.0 * m * plant.length;
    let (kg, kt, rm, r) = (3.71, 0.00767, 2.6, 0.00635);
    let (volt, drag) = (kg * kt / (rm * r), kg * kg * kt * kt / (rm * r * r) + 4.3);
    let (sin, cos) = theta.sin_cos();
    // the force that makes the cart move as it does, (3.1)
    let force = MASS * a + m * cos * alpha - m * sin * omega * omega;
    // accelerations under that force
    let det = MASS * inertia - m * m * cos * cos;
    let solve = |x: f64, y: f64| [(inertia * x - m * cos * y) / det, (MASS * y - m * cos * x) / det];
    let torque = -m * GRAVITY * sin - plant.damping * omega - plant.spring * (theta - PI);
    let [ca, pa] = solve(force + m * sin * omega * omega, torque);
    let by_theta = solve(m * cos * omega * omega + m * sin * pa, -m * GRAVITY * cos - plant.spring + m * sin * ca);
    let by_v = solve(-drag, 0.0);
    let by_omega = solve(2.0 * m * sin * omega, -plant.damping);
    let by_volt = solve(volt, 0.0);
    let a = [
        0.0,
        0.0,
        1.0,
        0.0, //
        0.0,
        0.0,
        0.0,
        1.0, //
        0.0,
        by_theta[0],
        by_v[0],
        by_omega[0], //
        0.0,
        by_theta[1],
        by_v[1],
        by_omega[1],
    ];
    (a, [0.0, 0.0, by_volt[0], by_volt[1]])
}

/// Section 4.1: the hanging pendulum along (4.1), as printed.
pub fn downward() -> LtpSystem {
    along(DOWN, 1.0, sinusoid(TAU, (0.05, 0.0, 0.0)), sinusoid(TAU, (-0.2472, 0.6809, 0.0)))
}

/// Section 4.2: the inverted one along (4.5), as printed but for the last digit of x.
pub fn inverted_printed() -> LtpSystem {
    let w = 10.0 * PI;
    along(UP, 0.2, sinusoid(w, (0.03752, -0.0769, 0.0)), sinusoid(w, (0.1, 0.0, PI)))
}

/// The inverted one along the true orbit with `theta = pi + amplitude sin(10 pi t)` of the plant `of`, seen by the plant
/// `plant`.
pub fn inverted(plant: Plant, of: Plant, amplitude: f64) -> LtpSystem {
    let (w, n) = (10.0 * PI, 256);
    let theta = sinusoid(w, (amplitude, 0.0, PI));
    let m = 0.21 * of.length;
    let inertia = 4.0 / 3.0 * m * of.length;
    let acceleration: Vec<f64> = (0..n)
        .map(|i| {
            let [angle, omega, alpha] = theta(0.2 * i as f64 / n as f64);
            let torque = inertia * alpha + m * GRAVITY * angle.sin() + of.damping * omega + of.spring * (angle - PI);
            -torque / (m * angle.cos())
        })
        .collect();
    let a = FourierSeries::from_samples(0.2, 1, &acceleration).expect("samples").trimmed(1e-13);
    let integral = |c: &FourierSeries| {
        let divide =
            |k: usize, c: &Complex| if k == 0 { Complex::from(0.0) } else { c / Complex::new(0.0, k as f64 * w) };
        let coefficients = c.coefficients().iter().enumerate().map(|(k, c)| divide(k, c)).collect();
        FourierSeries::new(0.2, 1, coefficients).expect("a series")
    };
    let v = integral(&a);
    let x = integral(&v);
    along(plant, 0.2, move |t| [x.value(t)[0], v.value(t)[0], a.value(t)[0]], theta)
}

#[test]
fn the_orbit_of_the_inverted_pendulum_is_that_of_section_3() {
    // theta = pi + 0.1 sin(10 pi t): exponents of the open loop 0 (the cart) and -0.0065; at 0.102 rad +0.088
    let slowest = |amplitude: f64| {
        let system = inverted(UP, UP, amplitude);
        let mut re: Vec<f64> = system.multipliers().iter().map(|m| m.norm().ln() / 0.2).collect();
        re.sort_by(|a, b| b.total_cmp(a));
        re
    };
    let at = slowest(0.1);
    assert!(at[0].abs() < 1e-9 && (at[1] + 0.0065).abs() < 1e-4, "{at:?}");
    assert!((slowest(0.102)[0] - 0.088).abs() < 1e-3 && (slowest(0.105)[0] - 0.22).abs() < 5e-3);
}
