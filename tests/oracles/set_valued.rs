//! Owns: an adaptive integration of the cart-pendulum with Coulomb friction on the cart, the law taken as the set it is.
//!
//! Hand-written equations; Richardson-extrapolated Runge-Kutta steps with local error control; slip and stick decided
//! from forces, switching instants bisected. It shares neither equations nor method with the crate.

/// The cart-pendulum of the zoo, with its numbers, under `volts * sin(omega t)`.
#[derive(Clone, Copy)]
pub struct Cart {
    /// Coulomb friction on the cart, N.
    pub friction: f64,
    /// Amplitude of the motor voltage, V.
    pub volts: f64,
    /// Its angular frequency, rad/s.
    pub omega: f64,
}

type State = [f64; 4]; // x, theta, v, omega

#[derive(Clone, Copy, PartialEq)]
enum Phase {
    Slip(f64),
    Stick,
}

impl Cart {
    /// Entries of the equations of motion: mass matrix (a, b, c) and forces without friction (f, g).
    fn forces(&self, t: f64, s: &State) -> (f64, f64, f64, f64, f64) {
        let (mc, mp, l, b_eq, b_p, g) = (0.57, 0.21, 0.3, 4.3, 0.05, 9.8);
        let (kg, kt, km, r, rad) = (3.71, 0.00767, 0.00767, 2.6, 0.00635);
        let [_, th, v, w] = *s;
        let motor = kg * kt / (r * rad) * self.volts * (self.omega * t).sin() - kg * kg * kt * km / (r * rad * rad) * v;
        let inertia = mp * l * l / 3.0 + mp * l * l;
        let f = motor - b_eq * v + mp * l * th.sin() * w * w;
        (mc + mp, mp * l * th.cos(), inertia, f, -b_p * w - mp * g * l * th.sin())
    }

    fn rates(&self, t: f64, s: &State, phase: Phase) -> State {
        let (a, b, c, f, g) = self.forces(t, s);
        match phase {
            Phase::Slip(sign) => {
                let f = f - sign * self.friction;
                let det = a * c - b * b;
                [s[2], s[3], (c * f - b * g) / det, (a * g - b * f) / det]
            }
            Phase::Stick => [0.0, s[3], 0.0, g / c],
        }
    }

    /// Friction force that keeps the cart at rest.
    fn holding(&self, t: f64, s: &State) -> f64 {
        let (_, b, c, f, g) = self.forces(t, s);
        b * g / c - f
    }

    fn classical(&self, t: f64, s: &State, h: f64, phase: Phase) -> State {
        let step = |k: &State, c: f64| -> State { std::array::from_fn(|i| s[i] + c * h * k[i]) };
        let k1 = self.rates(t, s, phase);
        let k2 = self.rates(t + 0.5 * h, &step(&k1, 0.5), phase);
        let k3 = self.rates(t + 0.5 * h, &step(&k2, 0.5), phase);
        let k4 = self.rates(t + h, &step(&k3, 1.0), phase);
        std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    }

    /// Two half steps, extrapolated, and the estimate of their error.
    fn step(&self, t: f64, s: &State, h: f64, phase: Phase) -> (State, f64) {
        let whole = self.classical(t, s, h, phase);
        let half = self.classical(t, s, 0.5 * h, phase);
        let two = self.classical(t + 0.5 * h, &half, 0.5 * h, phase);
        let error = (0..4).map(|i| (two[i] - whole[i]).abs() / 15.0).fold(0.0, f64::max);
        (std::array::from_fn(|i| two[i] + (two[i] - whole[i]) / 15.0), error)
    }

    /// Whether a phase has ended at a state: the cart has stopped, or is pushed harder than friction holds.
    fn ended(&self, t: f64, s: &State, phase: Phase) -> bool {
        match phase {
            Phase::Slip(sign) => sign * s[2] < 0.0,
            Phase::Stick => self.holding(t, s).abs() > self.friction,
        }
    }

    /// Position and angle at the given times, from rest; and how often the cart stopped or broke away.
    pub fn motion(&self, times: &[f64], tolerance: f64) -> (Vec<[f64; 2]>, usize) {
        let (mut t, mut s, mut phase, mut h) = (0.0_f64, [0.0; 4], Phase::Stick, 1e-3_f64);
        let (mut out, mut switches) = (Vec::new(), 0);
        for &until in times {
            while t < until {
                let trial = h.min(until - t);
                let (next, error) = self.step(t, &s, trial, phase);
                if error > tolerance {
                    h = 0.5 * trial;
                    continue;
                }
                if !self.ended(t + trial, &next, phase) {
                    (t, s) = (t + trial, next);
                    if error < 0.02 * tolerance {
                        h = 2.0 * trial.max(0.5 * h);
                    }
                    continue;
                }
                let (mut before, mut after) = (0.0, trial);
                while after - before > 1e-15 {
                    let middle = 0.5 * (before + after);
                    let at = self.step(t, &s, middle, phase).0;
                    if self.ended(t + middle, &at, phase) {
                        after = middle
                    } else {
                        before = middle
                    }
                    if middle == 0.5 * (before + after) {
                        break;
                    }
                }
                s = self.step(t, &s, after, phase).0;
                t += after;
                switches += 1;
                s[2] = 0.0;
                let needed = self.holding(t, &s);
                phase = match phase {
                    Phase::Slip(_) if needed.abs() <= self.friction => Phase::Stick,
                    // friction would have to push forward beyond its limit: the cart is driven backward
                    _ => Phase::Slip(-needed.signum()),
                };
                h = 1e-4;
            }
            out.push([s[0], s[1]]);
        }
        (out, switches)
    }
}
