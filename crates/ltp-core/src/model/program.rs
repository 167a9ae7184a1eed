//! A program: expressions ready to be evaluated, natively where the machine allows.

use super::graph::{Graph, Id};
use super::native::{self, Native};
use super::tape::{Point, Tape};

/// Which evaluator to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// Machine code where possible.
    #[default]
    Native,
    /// The plain evaluator: the oracle.
    Plain,
}

/// Expressions compiled together.
#[derive(Clone)]
pub struct Program {
    tape: Tape,
    native: Option<Native>,
}

impl Program {
    /// Compiles groups of expressions, each into a program of its own.
    pub fn compile(graph: &Graph, groups: &[&[Id]], backend: Backend) -> Vec<Program> {
        let tapes: Vec<Tape> = groups.iter().map(|ids| Tape::new(graph, ids)).collect();
        let native = match backend {
            Backend::Native => native::compile(&tapes.iter().collect::<Vec<_>>()),
            Backend::Plain => None,
        };
        let mut native = native.unwrap_or_default().into_iter();
        tapes.into_iter().map(|tape| Program { tape, native: native.next() }).collect()
    }

    /// One program for the plain evaluator: for what is evaluated rarely.
    pub fn plain(graph: &Graph, ids: &[Id]) -> Program {
        Program { tape: Tape::new(graph, ids), native: None }
    }

    /// Number of results.
    pub fn len(&self) -> usize {
        self.tape.results.len()
    }

    /// Whether there is nothing to compute.
    pub fn is_empty(&self) -> bool {
        self.tape.results.is_empty()
    }

    /// Whether machine code serves.
    pub fn is_native(&self) -> bool {
        self.native.is_some()
    }

    /// Evaluates into `out`, one value per expression.
    #[inline]
    pub fn eval(&self, at: Point<'_>, out: &mut [f64]) {
        match &self.native {
            Some(n) => n.eval(at, out),
            None => self.tape.eval(at, out),
        }
    }
}
