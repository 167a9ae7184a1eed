//! Exact solutions of the zoo's models, the truth that simulators and their derivatives are measured against.
//!
//! Owns: closed forms in plain Rust, written from the equations and sharing no code with `ltp-core`. A test binary takes
//! them in with `#[path = "oracles/closed_forms.rs"] mod closed_forms;`. Symbols are those of the zoo documents; SI units
//! and radians. `oracles/self_check.rs` tests this file against published digits, conserved quantities and residuals.
#![allow(dead_code)] // each test binary uses its own part

use std::f64::consts::PI;

/// Root of `f` between `a` and `b`, where `f` changes sign: bisection until the interval has no float inside it.
pub fn bisect(f: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    let negative_at_a = f(a) < 0.0;
    loop {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b {
            return middle;
        }
        if (f(middle) < 0.0) == negative_at_a {
            a = middle;
        } else {
            b = middle;
        }
    }
}

/// Underdamped free motion of `m z'' + c z' + k z = 0` from `(z, v)` after time `t`: position and velocity.
pub fn damped_oscillator(m: f64, c: f64, k: f64, z: f64, v: f64, t: f64) -> (f64, f64) {
    let sigma = 0.5 * c / m;
    let omega_0_squared = k / m;
    let omega_d = (omega_0_squared - sigma * sigma).sqrt();
    let (sin, cos) = (omega_d * t).sin_cos();
    let decay = (-sigma * t).exp();
    (
        decay * (z * cos + (v + sigma * z) / omega_d * sin),
        decay * (v * cos - (sigma * v + omega_0_squared * z) / omega_d * sin),
    )
}

/// Zoo `three_mode_hopper`: parameters (kg, m/s^2, N/m, N s/m, m, m) and the height (m) it is dropped from at rest.
#[derive(Clone, Copy, Debug)]
pub struct ThreeModeHopper {
    pub m: f64,
    pub g: f64,
    pub k: f64,
    pub c: f64,
    pub l0: f64,
    pub l1: f64,
    pub y0: f64,
}

impl Default for ThreeModeHopper {
    /// The zoo's values.
    fn default() -> Self {
        Self { m: 1.0, g: 9.81, k: 400.0, c: 2.0, l0: 1.0, l1: 1.05, y0: 1.2 }
    }
}

/// State of the three-mode hopper and the events on the way to it.
#[derive(Clone, Debug)]
pub struct Hop {
    pub y: f64,
    pub v: f64,
    /// `flight`, `compression` or `thrust`
    pub mode: &'static str,
    /// `touchdown`, `bottom` or `liftoff`, with its time (s)
    pub events: Vec<(&'static str, f64)>,
}

impl ThreeModeHopper {
    /// Motion on the ground with rest length `rest`, `s` seconds after `(y, v)`.
    fn on_ground(&self, rest: f64, y: f64, v: f64, s: f64) -> (f64, f64) {
        let level = rest - self.m * self.g / self.k;
        let (z, v) = damped_oscillator(self.m, self.c, self.k, y - level, v, s);
        (level + z, v)
    }

    /// The exact state at time `t`, and every event up to it.
    ///
    /// Touchdown solves a quadratic, the bottom is a zero of a damped sine, liftoff is bisected on the closed form.
    pub fn at(&self, t: f64) -> Hop {
        let sigma = 0.5 * self.c / self.m;
        let omega_d = (self.k / self.m - sigma * sigma).sqrt();
        let (mut now, mut y, mut v) = (0.0, self.y0, 0.0);
        let mut events = Vec::new();
        loop {
            // flight: y + v s - g s^2/2 = l0, the later root
            let fall = (v + (v * v + 2.0 * self.g * (y - self.l0)).sqrt()) / self.g;
            if now + fall > t {
                let s = t - now;
                return Hop { y: y + v * s - 0.5 * self.g * s * s, v: v - self.g * s, mode: "flight", events };
            }
            (now, y, v) = (now + fall, self.l0, v - self.g * fall);
            events.push(("touchdown", now));

            // compression: v(s) = 0 where tan(omega_d s) = omega_d v / (sigma v + (k/m) z), with v < 0
            let z = y - (self.l0 - self.m * self.g / self.k);
            let squeeze = (-omega_d * v).atan2(-(sigma * v + self.k / self.m * z)).rem_euclid(PI) / omega_d;
            if now + squeeze > t {
                let (y, v) = self.on_ground(self.l0, y, v, t - now);
                return Hop { y, v, mode: "compression", events };
            }
            (now, y, v) = (now + squeeze, self.on_ground(self.l0, y, v, squeeze).0, 0.0);
            events.push(("bottom", now));

            // thrust: y rises until half a period after the bottom
            let top = PI / omega_d;
            assert!(self.on_ground(self.l1, y, v, top).0 > self.l1, "the hopper stays on the ground: no liftoff");
            let push = bisect(|s| self.on_ground(self.l1, y, v, s).0 - self.l1, 0.0, top);
            if now + push > t {
                let (y, v) = self.on_ground(self.l1, y, v, t - now);
                return Hop { y, v, mode: "thrust", events };
            }
            (now, y, v) = (now + push, self.l1, self.on_ground(self.l1, y, v, push).1);
            events.push(("liftoff", now));
        }
    }

    /// `d(y, v)/d(y0, k)` at time `t`: rows y, v; columns y0, k. Central differences of fourth order on the closed form.
    pub fn sensitivity(&self, t: f64) -> [[f64; 2]; 2] {
        let mut jacobian = [[0.0; 2]; 2];
        for (column, step) in [1e-5, 1e-2].into_iter().enumerate() {
            let shifted = |multiple: f64| {
                let mut model = *self;
                if column == 0 {
                    model.y0 += multiple * step;
                } else {
                    model.k += multiple * step;
                }
                let hop = model.at(t);
                [hop.y, hop.v]
            };
            let (pp, p, n, nn) = (shifted(2.0), shifted(1.0), shifted(-1.0), shifted(-2.0));
            for row in 0..2 {
                jacobian[row][column] = (8.0 * (p[row] - n[row]) - (pp[row] - nn[row])) / (12.0 * step);
            }
        }
        jacobian
    }
}

/// Zoo `bouncing_ball`, dropped at rest from `y0` (m) under `g` (m/s^2) with restitution `e`.
#[derive(Clone, Copy, Debug)]
pub struct BouncingBall {
    pub g: f64,
    pub e: f64,
    pub y0: f64,
}

impl BouncingBall {
    /// Time (s) of impact `n`, counted from 1.
    pub fn impact(&self, n: u32) -> f64 {
        let first = (2.0 * self.y0 / self.g).sqrt();
        first * (1.0 + 2.0 * (1..n).map(|j| self.e.powi(j as i32)).sum::<f64>())
    }

    /// Time (s) at which the impacts accumulate.
    pub fn zeno(&self) -> f64 {
        (2.0 * self.y0 / self.g).sqrt() * (1.0 + self.e) / (1.0 - self.e)
    }

    /// Height and velocity at time `t`; at rest on the floor from the accumulation on.
    pub fn at(&self, t: f64) -> (f64, f64) {
        let first = (2.0 * self.y0 / self.g).sqrt();
        if t < first {
            return (self.y0 - 0.5 * self.g * t * t, -self.g * t);
        }
        if t >= self.zeno() {
            return (0.0, 0.0);
        }
        let mut n = 1;
        while self.impact(n + 1) <= t {
            n += 1;
        }
        let (s, v) = (t - self.impact(n), self.e.powi(n as i32) * self.g * first);
        (v * s - 0.5 * self.g * s * s, v - self.g * s)
    }
}

/// Arithmetic-geometric mean.
pub fn agm(mut a: f64, mut b: f64) -> f64 {
    while (a - b).abs() > 4.0 * f64::EPSILON * a {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    0.5 * (a + b)
}

/// Complete elliptic integral of the first kind of modulus `kappa`.
pub fn elliptic_k(kappa: f64) -> f64 {
    PI / (2.0 * agm(1.0, (1.0 - kappa * kappa).sqrt()))
}

/// Jacobi's `sn, cn, dn` of modulus `kappa` (Abramowitz and Stegun 16.4: descend the mean, then climb the amplitude).
pub fn jacobi(u: f64, kappa: f64) -> (f64, f64, f64) {
    let (mut a, mut b, mut c) = (1.0, (1.0 - kappa * kappa).sqrt(), kappa);
    let mut ladder: Vec<(f64, f64)> = Vec::new();
    while c > f64::EPSILON {
        (a, b, c) = (0.5 * (a + b), (a * b).sqrt(), 0.5 * (a - b));
        ladder.push((a, c));
    }
    let mut phi = f64::powi(2.0, ladder.len() as i32) * a * u;
    for &(a, c) in ladder.iter().rev() {
        phi = 0.5 * (phi + (c / a * phi.sin()).asin());
    }
    let (sn, cn) = phi.sin_cos();
    (sn, cn, (1.0 - kappa * kappa * sn * sn).sqrt())
}

/// Zoo `pendulum` without damping and torque, at rest at `theta_0` (rad, below pi) at t = 0: period (s).
pub fn pendulum_period(g: f64, l: f64, theta_0: f64) -> f64 {
    2.0 * PI * (l / g).sqrt() / agm(1.0, (0.5 * theta_0).cos())
}

/// The same pendulum's angle (rad) and velocity (rad/s) at time `t`.
pub fn pendulum(g: f64, l: f64, theta_0: f64, t: f64) -> (f64, f64) {
    let (omega, kappa) = ((g / l).sqrt(), (0.5 * theta_0).sin());
    let (sn, cn, _) = jacobi(elliptic_k(kappa.abs()) + omega * t, kappa.abs());
    // d(sin(theta/2))/dt = kappa omega cn dn and cos(theta/2) = dn
    (2.0 * (kappa * sn).asin(), 2.0 * kappa * omega * cn)
}

/// Zoo `duffing` without damping and force (`k`, `k_3` not negative), at rest at `x_0` at t = 0: position, velocity.
pub fn duffing(m: f64, k: f64, k_3: f64, x_0: f64, t: f64) -> (f64, f64) {
    let (omega, kappa) = duffing_shape(m, k, k_3, x_0);
    let (sn, cn, dn) = jacobi(omega * t, kappa);
    (x_0 * cn, -x_0 * omega * sn * dn)
}

/// Period (s) of that motion.
pub fn duffing_period(m: f64, k: f64, k_3: f64, x_0: f64) -> f64 {
    let (omega, kappa) = duffing_shape(m, k, k_3, x_0);
    4.0 * elliptic_k(kappa) / omega
}

fn duffing_shape(m: f64, k: f64, k_3: f64, x_0: f64) -> (f64, f64) {
    let stiffness = k + k_3 * x_0 * x_0;
    ((stiffness / m).sqrt(), (0.5 * k_3 * x_0 * x_0 / stiffness).sqrt())
}

/// `(e^x - 1)/x`, also at zero.
fn phi_1(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.exp_m1() / x }
}

/// `(e^x - 1 - x)/x^2`; the series near zero, where the difference cancels.
fn phi_2(x: f64) -> f64 {
    if x.abs() > 0.5 {
        return (x.exp_m1() - x) / (x * x);
    }
    let (mut term, mut sum) = (0.5, 0.0);
    for n in 3..22 {
        sum += term;
        term *= x / f64::from(n);
    }
    sum
}

/// Zoo `drive` from `(q, v)` under the constant force `tau` for `t` seconds: position and velocity.
pub fn drive_step(m: f64, b: f64, tau: f64, q: f64, v: f64, t: f64) -> (f64, f64) {
    let x = -b * t / m;
    (q + v * t * phi_1(x) + tau / m * t * t * phi_2(x), v * x.exp() + tau / m * t * phi_1(x))
}

/// Zoo `two_mass` with `b = 0` from rest under the constant torque `tau` for `t` seconds:
/// `[theta_m, theta_l, omega_m, omega_l]`. The mean angle is a parabola, the twist a damped oscillator.
pub fn two_mass_step(j_m: f64, j_l: f64, k: f64, c: f64, tau: f64, t: f64) -> [f64; 4] {
    let (total, reduced) = (j_m + j_l, j_m * j_l / (j_m + j_l));
    let (mean, mean_rate) = (0.5 * tau / total * t * t, tau / total * t);
    let level = tau * reduced / (j_m * k);
    let (z, rate) = damped_oscillator(reduced, c, k, -level, 0.0, t);
    let twist = level + z;
    [
        mean + j_l / total * twist,
        mean - j_m / total * twist,
        mean_rate + j_l / total * rate,
        mean_rate - j_m / total * rate,
    ]
}

/// A mass `m` (kg) with viscous friction `b` (N s/m, may be 0) and set-valued Coulomb friction `coulomb` (N), at rest at
/// the origin at t = 0, under the force `amplitude * sin(omega t)` (N): `m v' + b v + coulomb sgn(v) = amplitude sin(omega t)`,
/// where `sgn(0)` is any number in [-1, 1].
#[derive(Clone, Copy, Debug)]
pub struct StickSlip {
    pub m: f64,
    pub b: f64,
    pub coulomb: f64,
    pub amplitude: f64,
    pub omega: f64,
}

/// State of the stick-slip block: `direction` is 0 in stick and the sign of `v` in slip; `switches` are the times (s)
/// at which it changed, with the new direction.
#[derive(Clone, Debug)]
pub struct Block {
    pub q: f64,
    pub v: f64,
    pub direction: i8,
    pub switches: Vec<(f64, i8)>,
}

impl StickSlip {
    /// Slip in `direction` from `(q, v)` at time `t0` until time `t`.
    fn slip(&self, direction: i8, t0: f64, q: f64, v: f64, t: f64) -> (f64, f64) {
        // particular solution of the sine, and its integral
        let scale = self.amplitude / (self.b * self.b + (self.m * self.omega).powi(2));
        let rate = |s: f64| scale * (self.b * (self.omega * s).sin() - self.m * self.omega * (self.omega * s).cos());
        let path = |s: f64| -scale * (self.b / self.omega * (self.omega * s).cos() + self.m * (self.omega * s).sin());
        let friction = -f64::from(direction) * self.coulomb;
        let (dq, dv) = drive_step(self.m, self.b, friction, 0.0, v - rate(t0), t - t0);
        (q + path(t) - path(t0) + dq, rate(t) + dv)
    }

    /// First time at or after `t0` at which the force leaves the friction cone, if it ever does, and in which direction.
    fn breakaway(&self, t0: f64) -> Option<(f64, i8)> {
        if self.amplitude <= self.coulomb {
            return None;
        }
        let half = PI / self.omega;
        let phase = (self.coulomb / self.amplitude).asin() / self.omega;
        let mut n = (t0 / half).floor();
        if n * half + phase < t0 {
            n += 1.0;
        }
        Some((n * half + phase, if n.rem_euclid(2.0) == 0.0 { 1 } else { -1 }))
    }

    /// First zero of `v` after a slip begun at `(t0, q, v)`; the scan step is 1/500 of the force's period.
    fn slip_end(&self, direction: i8, t0: f64, q: f64, v: f64) -> f64 {
        let step = 2.0 * PI / self.omega / 500.0;
        let speed = |s: f64| f64::from(direction) * self.slip(direction, t0, q, v, s).1;
        // a slip that starts from rest first gains speed
        let mut a = t0 + 1e-3 * step;
        while speed(a + step) > 0.0 {
            a += step;
        }
        bisect(speed, a, a + step)
    }

    /// The exact state at time `t`, and every switch up to it.
    pub fn at(&self, t: f64) -> Block {
        let (mut now, mut q, mut v, mut direction) = (0.0, 0.0, 0.0, 0_i8);
        let mut switches = Vec::new();
        loop {
            if direction == 0 {
                match self.breakaway(now) {
                    Some((time, way)) if time <= t => (now, direction) = (time, way),
                    _ => return Block { q, v: 0.0, direction, switches },
                }
            } else {
                let end = self.slip_end(direction, now, q, v);
                if end > t {
                    (q, v) = self.slip(direction, now, q, v, t);
                    return Block { q, v, direction, switches };
                }
                q = self.slip(direction, now, q, v, end).0;
                (now, v) = (end, 0.0);
                let force = self.amplitude * (self.omega * now).sin();
                direction = if force.abs() <= self.coulomb { 0 } else { force.signum() as i8 };
            }
            switches.push((now, direction));
        }
    }
}
