//! The response of a linear time-periodic system to sampled inputs, jumps included: the second route beside [`Htf::predict`].
//!
//! [`Htf::predict`]: super::Htf::predict

use super::propagate::rate;
use super::system::{Entry, LtpSystem, NODES, Segment, Size};
use crate::error::{Error, Result};
use crate::numeric::tableau::{A, B, C, STAGES};

/// Angle (rad) that the fastest oscillation may turn by in one step of order 5: the error is 1e-8 of it per step.
const TURN: f64 = 0.15;
/// Steps in a segment at least, since its matrices vary on the scale of its nodes.
const FEWEST: f64 = NODES as f64;
/// A jump this near to a sample, in steps, happens before it.
const SLACK: f64 = 1e-9;

impl LtpSystem {
    /// Outputs (n, ny) at `t0 + i*dt` (s), from rest at `t0`, under inputs `u` (n, nu) with straight lines between samples.
    ///
    /// A sample at the instant of a jump sees the state after it.
    ///
    /// # Errors
    /// `OutOfRange` for a step that is not positive, `Shape` for inputs that do not fill their rows, `NotFinite`.
    pub fn simulate(&self, u: &[f64], t0: f64, dt: f64) -> Result<Vec<f64>> {
        let Size { nx, nu, .. } = self.size();
        for (what, found, good) in [("dt", dt, dt > 0.0 && dt.is_finite()), ("t0", t0, t0.is_finite())] {
            if !good {
                return Err(Error::OutOfRange {
                    what: what.into(),
                    found,
                    expected: "a finite time in s, dt positive".into(),
                });
            }
        }
        if nu == 0 || u.is_empty() || !u.len().is_multiple_of(nu) {
            return Err(Error::Shape { what: "input samples, n*nu".into(), expected: nu, found: u.len() });
        }
        if let Some(row) = u.iter().position(|v| !v.is_finite()) {
            let (what, column) = ("input".into(), format!("{}", row % nu));
            return Err(Error::NotFinite { what, row: row / nu, column, value: u[row] });
        }
        let n = u.len() / nu;
        let mut walk = Walk::new(self, u, t0, dt);
        let mut x = vec![0.0; nx];
        let mut outputs = Vec::with_capacity(n * self.size().ny);
        for i in 0..n {
            let t = t0 + i as f64 * dt;
            walk.advance(&mut x, t);
            walk.output(&x, t, &u[i * nu..(i + 1) * nu], &mut outputs);
        }
        Ok(outputs)
    }
}

/// Where the simulation is.
struct Walk<'a> {
    system: &'a LtpSystem,
    u: &'a [f64],
    t0: f64,
    dt: f64,
    /// Time reached, s.
    t: f64,
    /// Segment reached, and the time at which its period began less the system's start, s.
    segment: usize,
    base: f64,
    /// Longest step in each segment, s.
    steps: Vec<f64>,
    matrix: Vec<f64>,
    input: Vec<f64>,
    rates: [Vec<f64>; STAGES],
}

impl<'a> Walk<'a> {
    fn new(system: &'a LtpSystem, u: &'a [f64], t0: f64, dt: f64) -> Self {
        let Size { nx, nu, .. } = system.size();
        let base = ((t0 - system.start()) / system.period() + SLACK).floor() * system.period();
        let last = system.segments().len() - 1;
        let near = SLACK * dt;
        let segment = system.segments().partition_point(|s| base + s.end <= t0 + near).min(last);
        let steps = system.segments().iter().map(|s| {
            let fastest = (0..NODES).map(|i| rate(&s.a[i * nx * nx..], nx)).fold(0.0, f64::max);
            (TURN / fastest).min((s.end - s.start) / FEWEST)
        });
        let (matrix, input) = (Vec::new(), vec![0.0; nu]);
        let rates = std::array::from_fn(|_| vec![0.0; nx]);
        Self { system, u, t0, dt, t: t0, segment, base, steps: steps.collect(), matrix, input, rates }
    }

    /// Goes on to time `t`, through every jump on the way.
    fn advance(&mut self, x: &mut [f64], t: f64) {
        let system = self.system;
        loop {
            let segment = &system.segments()[self.segment];
            let end = self.base + segment.end;
            if end > t + SLACK * self.dt {
                self.smooth(x, segment, t);
                return;
            }
            self.smooth(x, segment, end);
            self.jumps(x, segment, end);
            self.segment += 1;
            if self.segment == system.segments().len() {
                (self.segment, self.base) = (0, self.base + system.period());
            }
        }
    }

    /// Integrates inside a segment.
    fn smooth(&mut self, x: &mut [f64], segment: &Segment, end: f64) {
        let span = end - self.t;
        if span <= 0.0 {
            return;
        }
        let count = (span / self.steps[self.segment]).ceil().max(1.0);
        let (start, h) = (self.t, span / count);
        let mut stage = x.to_vec();
        for step in 0..count as usize {
            let t = start + step as f64 * h;
            for s in 0..STAGES {
                for (i, value) in stage.iter_mut().enumerate() {
                    *value = x[i] + h * (0..s).map(|j| A[s][j] * self.rates[j][i]).sum::<f64>();
                }
                let mut rates = std::mem::take(&mut self.rates[s]);
                self.rate(&stage, segment, t + C[s] * h, &mut rates);
                self.rates[s] = rates;
            }
            for (i, value) in x.iter_mut().enumerate() {
                *value += h * (0..STAGES).map(|s| B[s] * self.rates[s][i]).sum::<f64>();
            }
        }
        self.t = end;
    }

    fn rate(&mut self, x: &[f64], segment: &Segment, t: f64, rates: &mut [f64]) {
        let theta = (t - self.base - segment.start) / (segment.end - segment.start);
        self.inputs_at(t);
        rates.fill(0.0);
        self.system.at(segment, theta, Entry::A, &mut self.matrix);
        add(&self.matrix, x, rates);
        self.system.at(segment, theta, Entry::B, &mut self.matrix);
        add(&self.matrix, &self.input, rates);
    }

    fn jumps(&mut self, x: &mut [f64], segment: &Segment, t: f64) {
        self.inputs_at(t);
        for jump in &segment.jumps {
            let before = x.to_vec();
            x.fill(0.0);
            add(&jump.state, &before, x);
            add(&jump.input, &self.input, x);
        }
        self.t = t;
    }

    fn output(&mut self, x: &[f64], t: f64, u: &[f64], outputs: &mut Vec<f64>) {
        let segment = &self.system.segments()[self.segment];
        let theta = (t - self.base - segment.start) / (segment.end - segment.start);
        let from = outputs.len();
        outputs.resize(from + self.system.size().ny, 0.0);
        self.system.at(segment, theta, Entry::C, &mut self.matrix);
        add(&self.matrix, x, &mut outputs[from..]);
        self.system.at(segment, theta, Entry::D, &mut self.matrix);
        add(&self.matrix, u, &mut outputs[from..]);
    }

    /// Inputs at time `t` on the straight line between their samples.
    fn inputs_at(&mut self, t: f64) {
        let nu = self.input.len();
        let last = self.u.len() / nu - 1;
        let place = ((t - self.t0) / self.dt).clamp(0.0, last as f64);
        let i = (place as usize).min(last.saturating_sub(1));
        let next = (i + 1).min(last);
        for (j, value) in self.input.iter_mut().enumerate() {
            let (a, b) = (self.u[i * nu + j], self.u[next * nu + j]);
            *value = a + (place - i as f64) * (b - a);
        }
    }
}

/// Adds `matrix * x` to `out`; the matrix is row-major.
fn add(matrix: &[f64], x: &[f64], out: &mut [f64]) {
    if x.is_empty() {
        return;
    }
    for (value, row) in out.iter_mut().zip(matrix.chunks(x.len())) {
        *value += row.iter().zip(x).map(|(m, x)| m * x).sum::<f64>();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::periodic::Jump;
    use std::f64::consts::TAU;

    /// A damped oscillator whose velocity is halved and kicked by the input once in each period.
    fn kicked() -> LtpSystem {
        let each = |matrix: &[f64]| matrix.repeat(NODES);
        let jump = Jump { name: "kick".into(), time: 0.7, state: vec![1.0, 0.0, 0.0, 0.5], input: vec![0.0, 0.3] };
        let segment = |start: f64, end: f64, jumps: Vec<Jump>| Segment {
            start,
            end,
            a: each(&[0.0, 1.0, -9.0, -0.6]),
            b: each(&[0.0, 1.0]),
            c: each(&[1.0, 0.2]),
            d: each(&[0.05]),
            jumps,
        };
        let segments = vec![segment(0.0, 0.7, vec![jump]), segment(0.7, 1.0, Vec::new())];
        LtpSystem::new(1.0, 0.0, Size { nx: 2, nu: 1, ny: 1 }, segments).expect("system")
    }

    #[test]
    fn settles_on_the_steady_state_of_the_transfer_functions() {
        let (system, omega, dt) = (kicked(), 1.9, 1e-3);
        let u: Vec<f64> = (0..60_000).map(|i| (omega * i as f64 * dt).cos()).collect();
        let y = system.simulate(&u, 0.0, dt).expect("response");
        let htf = system.htf(&[omega], 400).expect("transfer functions");
        // Between jumps: the output of this system is not continuous, and its Fourier series overshoots where it jumps.
        let late: Vec<usize> = (55_000..60_000).filter(|i| ((i % 1000) as f64 - 700.0).abs() > 100.0).collect();
        let t: Vec<f64> = late.iter().map(|&i| i as f64 * dt).collect();
        for (&i, expected) in late.iter().zip(htf.steady_state(omega, 1.0, 0.0, 0, &t)) {
            assert!((y[i] - expected).abs() < 2e-4, "sample {i}: {} {expected}", y[i]);
        }
    }

    #[test]
    fn free_motion_is_that_of_an_oscillator_until_the_jump() {
        let (dt, gain) = (1e-3, 0.3);
        let kick: Vec<f64> = (0..1700).map(|i| if i == 700 { 1.0 } else { 0.0 }).collect();
        let y = kicked().simulate(&kick, 0.0, dt).expect("response");
        assert!(y[..699].iter().all(|&y| y == 0.0), "nothing before the input");
        // The triangle of 1 ms adds its half before the jump, halved by it, and its half after: velocity 0.3 + 0.75e-3.
        let (decay, ring) = (0.3_f64, (9.0_f64 - 0.09).sqrt());
        for i in [800, 1100, 1699] {
            let t = (i - 700) as f64 * dt;
            let shape = (-decay * t).exp() * (ring * t).sin() / ring;
            let slope = (-decay * t).exp() * ((ring * t).cos() - decay / ring * (ring * t).sin());
            let expected = (gain + 0.75e-3) * (shape + 0.2 * slope);
            assert!((y[i] - expected).abs() < 1e-6, "sample {i}: {} {expected}", y[i]);
        }
    }

    #[test]
    fn a_later_start_sees_a_later_phase() {
        let u: Vec<f64> = (0..900).map(|i| (TAU * 0.4 * i as f64 * 1e-3).sin()).collect();
        let (a, b) = (kicked().simulate(&u, 0.25, 1e-3), kicked().simulate(&u, 3.25, 1e-3));
        for (a, b) in a.expect("first").iter().zip(b.expect("three periods later")) {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(matches!(kicked().simulate(&[1.0], 0.0, 0.0), Err(Error::OutOfRange { .. })));
        assert!(matches!(kicked().simulate(&[], 0.0, 1.0), Err(Error::Shape { .. })));
        assert!(matches!(kicked().simulate(&[f64::NAN], 0.0, 1.0), Err(Error::NotFinite { .. })));
    }
}
