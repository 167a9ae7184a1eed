//! A whole Dormand-Prince step as one program: seven stages, solution, error estimate and guards, inlined.
//!
//! A step of a small model costs more in calls and loops than in arithmetic. Here the flow is substituted into itself
//! stage by stage on the expression graph, so that what the stages share (parameters, constant factors) is computed once
//! and nothing is called. The operations are those of the loop over [`super::System::flow`] in the same order: results are
//! equal bit for bit, and the loop is the oracle.

use super::graph::{Graph, Id, Symbol};
use super::program::{Backend, Program};
use super::tape::Point;
use crate::numeric::tableau::{A, B, C, E, STAGES};

/// Instructions beyond which a step is left to the loop: compiling would cost more than it saves.
const LARGEST: usize = 8000;

/// One step as a program.
pub struct Stepper {
    program: Program,
}

impl Stepper {
    /// Number of distinct instants, after the start, at which a step wants its inputs: the nodes `C[1..]`.
    pub const NODES: usize = STAGES - 1;

    /// Compiles the step of a flow with its guards; `None` where machine code is not to be had or not worth while.
    pub fn compile(g: &mut Graph, flow: &[Id], guards: &[Id], nu: usize, backend: Backend) -> Option<Self> {
        let nx = flow.len();
        if backend == Backend::Plain || STAGES * g.reachable(flow).len() > LARGEST {
            return None;
        }
        let leaves = |g: &mut Graph, from: usize| (from..from + nx).map(|i| g.leaf(Symbol::State(i))).collect();
        let start: Vec<Id> = leaves(g, 0);
        let mut k: Vec<Vec<Id>> = vec![leaves(g, nx)];
        let h = g.leaf(Symbol::State(2 * nx));
        let time = g.leaf(Symbol::Time);
        let (mut end, mut at_end) = (Vec::new(), Vec::new());
        for i in 1..=STAGES {
            let (weights, node) = if i < STAGES { (&A[i][..i], i) } else { (&B[..], STAGES - 1) };
            // The newest stage enters last and alone: what depends on it is short, and so is the wait for it.
            let (newest, older) = weights.split_last()?;
            let newest = g.constant(*newest);
            let newest = g.mul(h, newest);
            let x: Vec<Id> = (0..nx)
                .map(|n| {
                    let sum = weighted(g, older, &k, n);
                    let move_by = g.mul(h, sum);
                    let before = g.add(start[n], move_by);
                    let last = g.mul(newest, k[i - 1][n]);
                    g.add(before, last)
                })
                .collect();
            let c = g.constant(C[node]);
            let later = g.mul(c, h);
            let t = g.add(time, later);
            let u: Vec<Id> = (0..nu).map(|j| g.leaf(Symbol::Input((node - 1) * nu + j))).collect();
            let replace = |s: Symbol| match s {
                Symbol::Time => Some(t),
                Symbol::State(n) => Some(x[n]),
                Symbol::Input(j) => Some(u[j]),
                _ => None,
            };
            let rates = g.substitute(flow, replace);
            if i == STAGES {
                at_end = g.substitute(guards, replace);
                end = x.clone();
            }
            k.push(rates);
        }
        let error: Vec<Id> = (0..nx)
            .map(|n| {
                let sum = weighted(g, &E, &k, n);
                g.mul(h, sum)
            })
            .collect();
        let results: Vec<Id> = k[1..].iter().flatten().chain(&end).chain(&error).chain(&at_end).copied().collect();
        let program = Program::compile(g, &[&results], backend).pop()?;
        program.is_native().then_some(Self { program })
    }

    /// Steps from `(t, start)`, where `start` holds the state, its rates and the length of the step, and `u` the inputs at
    /// the nodes. Writes the rates of stages 2 to 7, the state at the end, its error estimate and the guards there.
    #[inline]
    pub fn step(&self, t: f64, start: &[f64], u: &[f64], p: &[f64], out: &mut [f64]) {
        self.program.eval(Point { t, x: start, u, p }, out);
    }
}

/// `sum_j weights[j] k[j][n]`, in that order, without the terms of weight zero.
fn weighted(g: &mut Graph, weights: &[f64], k: &[Vec<Id>], n: usize) -> Id {
    let mut sum = g.constant(0.0);
    for (&w, k) in weights.iter().zip(k) {
        let w = g.constant(w);
        let term = g.mul(w, k[n]);
        sum = g.add(sum, term);
    }
    sum
}
