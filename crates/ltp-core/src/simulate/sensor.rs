//! Outputs along a run: as the model gives them, and through the delays and the play that effects put on them.
//!
//! Delay and play need what was shown before. They work on the grid of the engine's steps. A delayed output is the polynomial
//! through the [`NODES`] grid points around the instant looked at, with the exact derivative of that interpolation; where
//! it looks to before the run, the output goes on along the straight line of its first step. Play
//! `w = clamp(w, y - gap/2, y + gap/2)` begins at the first output and sees the extremes between grid points, on parabolas.

use super::engine::{Engine, Settings};
use super::inputs::Inputs;
use super::stop::Stop;
use crate::model::delay::OperatorKind;
use crate::model::{Operator, System};

/// Grid points through which a delayed output is interpolated.
pub const NODES: usize = 6;

/// What shows the outputs of an engine.
pub struct Sensor {
    nx: usize,
    nf: usize,
    ny: usize,
    derivatives: bool,
    jacobian: Vec<f64>,
    chain: Vec<Element>,
    /// Grid points shown so far.
    shown: u64,
    /// The first outputs of the run, at grid points that a delay looks at before the engine is there.
    scouted: Vec<Row>,
}

/// Outputs and their derivatives by initial state and free parameter.
#[derive(Clone)]
struct Row {
    y: Vec<f64>,
    dy: Vec<f64>,
}

/// An operator with its memory.
struct Element {
    operator: Operator,
    /// The newest values it was given and their derivatives, the oldest first.
    past: Vec<(f64, Vec<f64>)>,
    /// Grid point of the oldest.
    oldest: u64,
    /// Play: what is shown.
    play: Option<(f64, Vec<f64>)>,
}

impl Sensor {
    /// The outputs of a system along a run that an [`Engine`] with the same arguments will make.
    ///
    /// # Errors
    /// The reason why not even its first steps can be made.
    pub fn new(
        system: &dyn System,
        p: &[f64],
        inputs: &Inputs,
        x0: &[f64],
        mode: usize,
        settings: Settings,
    ) -> Result<Self, Stop> {
        let (nx, nf, ny) = (system.states(), system.free().len(), system.outputs());
        let element = |mut operator: Operator| {
            if operator.kind == OperatorKind::Delay {
                // counted in steps from here on
                operator.value /= settings.step;
                operator.slope.iter_mut().for_each(|s| *s /= settings.step);
            }
            Element { operator, past: Vec::new(), oldest: 0, play: None }
        };
        let mut sensor = Self {
            nx,
            nf,
            ny,
            derivatives: settings.derivatives,
            jacobian: vec![0.0; ny * (1 + nx + nf)],
            chain: system.operators(p).into_iter().map(element).collect(),
            shown: 0,
            scouted: Vec::new(),
        };
        if sensor.chain.iter().any(|e| e.operator.kind == OperatorKind::Delay) {
            let mut scout = Engine::new(system, p, inputs, x0, mode, settings)?;
            let mut rows = Vec::new();
            for k in 0..NODES as u64 {
                // A run that ends here is told so by the engine itself.
                if scout.advance(k).is_err() {
                    break;
                }
                let mut row = sensor.blank();
                sensor.plain(&mut scout, &mut row.y, &mut row.dy);
                rows.push(row);
            }
            sensor.scouted = rows;
        }
        Ok(sensor)
    }

    /// Advances the engine to a grid point and gives the outputs `y` (ny) there, with their derivatives `dy`
    /// (ny, nx + nf) where the engine has any.
    ///
    /// # Errors
    /// The reason why the engine could not.
    pub fn advance(&mut self, engine: &mut Engine<'_>, target: u64, y: &mut [f64], dy: &mut [f64]) -> Result<(), Stop> {
        if self.chain.is_empty() {
            engine.advance(target)?;
            self.plain(engine, y, dy);
            return Ok(());
        }
        while self.shown <= target {
            engine.advance(self.shown)?;
            self.plain(engine, y, dy);
            self.show(y, dy);
            self.shown += 1;
        }
        Ok(())
    }

    fn blank(&self) -> Row {
        Row { y: vec![0.0; self.ny], dy: vec![0.0; if self.derivatives { self.ny * (self.nx + self.nf) } else { 0 }] }
    }

    /// Outputs as the model gives them.
    fn plain(&mut self, engine: &mut Engine<'_>, y: &mut [f64], dy: &mut [f64]) {
        if self.derivatives {
            engine.output_jacobian(&mut self.jacobian);
            y.copy_from_slice(&self.jacobian[..self.ny]);
            chain(&self.jacobian[self.ny..], engine.sensitivities(), (self.ny, self.nx, self.nf), dy);
        } else {
            engine.output(y);
        }
    }

    /// Passes the outputs of the next grid point through the operators.
    fn show(&mut self, y: &mut [f64], dy: &mut [f64]) {
        let ns = if self.derivatives { self.nx + self.nf } else { 0 };
        for k in 0..self.chain.len() {
            let j = self.chain[k].operator.output;
            // A delay behind another operator of its output has no scouts: its first values are that operator's.
            let first = !self.chain[..k].iter().any(|e| e.operator.output == j);
            let element = &mut self.chain[k];
            if self.shown == 0 && first && element.operator.kind == OperatorKind::Delay {
                element.past = self.scouted.iter().map(|r| (r.y[j], r.dy[j * ns..(j + 1) * ns].to_vec())).collect();
            }
            element.pass(self.shown, self.nx, &mut y[j], &mut dy[j * ns..(j + 1) * ns]);
        }
    }
}

impl Element {
    fn pass(&mut self, n: u64, nx: usize, y: &mut f64, dy: &mut [f64]) {
        match self.operator.kind {
            OperatorKind::Delay => self.delay(n, nx, y, dy),
            OperatorKind::Play => self.loose(nx, y, dy),
        }
    }

    fn loose(&mut self, nx: usize, y: &mut f64, dy: &mut [f64]) {
        if self.play.is_none() {
            self.play = Some((*y, dy.to_vec()));
        }
        // What turned round between grid points went further than they show.
        self.past.push((*y, dy.to_vec()));
        if self.past.len() > 3 {
            self.past.remove(0);
        }
        if let Some((v, slopes)) = vertex(&self.past) {
            self.pull(nx, v, &slopes);
        }
        self.pull(nx, *y, dy);
        if let Some((shown, slopes)) = &self.play {
            *y = *shown;
            dy.copy_from_slice(slopes);
        }
    }

    /// Takes along what is shown where a value leaves the gap on either side.
    fn pull(&mut self, nx: usize, y: f64, dy: &[f64]) {
        let Some((shown, slopes)) = &mut self.play else { return };
        let half = 0.5 * self.operator.value;
        let side = if *shown < y - half {
            -1.0
        } else if *shown > y + half {
            1.0
        } else {
            return;
        };
        *shown = y + side * half;
        slopes.copy_from_slice(dy);
        for (s, by) in slopes.iter_mut().skip(nx).zip(&self.operator.slope) {
            *s += 0.5 * side * by;
        }
    }

    fn delay(&mut self, n: u64, nx: usize, y: &mut f64, dy: &mut [f64]) {
        // What the engine says replaces what the scouts foresaw: a correction may have come between.
        let place = (n - self.oldest) as usize;
        let now = (*y, dy.to_vec());
        if place < self.past.len() {
            self.past[place] = now;
        } else {
            self.past.push(now);
        }
        let at = n as f64 - self.operator.value;
        let keep = (at.floor() - NODES as f64).max(0.0) as u64;
        if keep > self.oldest + 256 {
            self.past.drain(..(keep - self.oldest) as usize);
            self.oldest = keep;
        }
        let count = self.past.len();
        let at = at - self.oldest as f64;
        let (from, nodes) = if at < 0.0 {
            (0, count.min(2))
        } else {
            let nodes = count.min(NODES);
            ((at.floor() as usize).saturating_sub(nodes / 2 - usize::from(nodes > 1)).min(count - nodes), nodes)
        };
        let (weights, slopes) = lagrange(nodes, at - from as f64);
        let points = &self.past[from..from + nodes];
        *y = points.iter().zip(&weights).map(|(p, w)| p.0 * w).sum();
        let rate: f64 = points.iter().zip(&slopes).map(|(p, w)| p.0 * w).sum();
        dy.fill(0.0);
        for (p, w) in points.iter().zip(&weights) {
            for (d, by) in dy.iter_mut().zip(&p.1) {
                *d += w * by;
            }
        }
        for (d, by) in dy.iter_mut().skip(nx).zip(&self.operator.slope) {
            *d -= rate * by;
        }
    }
}

/// The extreme of the parabola through the last three values, where the middle one is the highest or the lowest, with its
/// derivatives: where it lies moves too, but there the parabola is level.
fn vertex(past: &[(f64, Vec<f64>)]) -> Option<(f64, Vec<f64>)> {
    let [(a, da), (b, db), (c, dc)] = past else { return None };
    let curve = a - 2.0 * b + c;
    if (b - a) * (c - b) >= 0.0 || curve == 0.0 {
        return None;
    }
    let (w, _) = lagrange(3, 1.0 + 0.5 * (a - c) / curve);
    let mixed = |x: f64, y: f64, z: f64| w[0] * x + w[1] * y + w[2] * z;
    Some((mixed(*a, *b, *c), da.iter().zip(db).zip(dc).map(|((x, y), z)| mixed(*x, *y, *z)).collect()))
}

/// Weights of the values at `0, 1, .., nodes - 1` in the polynomial through them at `x`, and in its derivative.
fn lagrange(nodes: usize, x: f64) -> ([f64; NODES], [f64; NODES]) {
    let (mut weights, mut slopes) = ([0.0; NODES], [0.0; NODES]);
    for i in 0..nodes {
        let (mut value, mut slope) = (1.0, 0.0);
        for j in (0..nodes).filter(|j| *j != i) {
            let scale = 1.0 / (i as f64 - j as f64);
            slope = (slope * (x - j as f64) + value) * scale;
            value *= (x - j as f64) * scale;
        }
        (weights[i], slopes[i]) = (value, slope);
    }
    (weights, slopes)
}

/// `C S + [0 | Y_p]`: output derivatives by initial state and free parameter.
fn chain(jacobian: &[f64], s: &[f64], (ny, nx, nf): (usize, usize, usize), dy: &mut [f64]) {
    let ns = nx + nf;
    let (c, yp) = jacobian.split_at(ny * nx);
    for j in 0..ny {
        let row = &mut dy[j * ns..(j + 1) * ns];
        row[..nx].fill(0.0);
        row[nx..].copy_from_slice(&yp[j * nf..(j + 1) * nf]);
        for i in 0..nx {
            let w = c[j * nx + i];
            if w != 0.0 {
                for (r, v) in row.iter_mut().zip(&s[i * ns..(i + 1) * ns]) {
                    *r += w * v;
                }
            }
        }
    }
}
