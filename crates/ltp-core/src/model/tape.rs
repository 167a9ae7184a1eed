//! The plain evaluator: a list of instructions, one per node. It serves platforms without a native compiler and is the
//! oracle that the native code is tested against, bit for bit.

use super::graph::{Fun1, Fun2, Graph, Id, Node, Symbol, apply1, apply2};

/// Where a model is evaluated; slices have the model's lengths.
#[derive(Clone, Copy, Debug)]
pub struct Point<'a> {
    /// Time, s.
    pub t: f64,
    /// State.
    pub x: &'a [f64],
    /// Input.
    pub u: &'a [f64],
    /// Parameters.
    pub p: &'a [f64],
}

/// One instruction; operands are positions on the tape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instruction {
    /// A number.
    Const(f64),
    /// Time.
    Time,
    /// A state.
    State(usize),
    /// An input.
    Input(usize),
    /// A parameter.
    Parameter(usize),
    /// A function of one value.
    One(Fun1, usize),
    /// A function of two values.
    Two(Fun2, usize, usize),
    /// The second value where the first is not zero, else the third.
    Select(usize, usize, usize),
}

/// Instructions in an order in which operands come first, and where the results stand.
#[derive(Clone, Debug)]
pub struct Tape {
    /// Instructions.
    pub code: Vec<Instruction>,
    /// Position of each result.
    pub results: Vec<usize>,
}

impl Tape {
    /// The instructions that compute `results`.
    pub fn new(graph: &Graph, results: &[Id]) -> Self {
        let order = graph.reachable(results);
        let at = |id: Id| order.binary_search(&id).expect("operands are reachable");
        let code = order
            .iter()
            .map(|&id| match graph.node(id) {
                Node::Const(bits) => Instruction::Const(f64::from_bits(bits)),
                Node::Leaf(Symbol::Time) => Instruction::Time,
                Node::Leaf(Symbol::State(i)) => Instruction::State(i),
                Node::Leaf(Symbol::Input(i)) => Instruction::Input(i),
                Node::Leaf(Symbol::Parameter(i)) => Instruction::Parameter(i),
                // Placeholders are replaced before anything is compiled; left over, they would be zero forces.
                Node::Leaf(Symbol::Port(_) | Symbol::Dry(_)) => Instruction::Const(0.0),
                Node::One(f, a) => Instruction::One(f, at(a)),
                Node::Two(f, a, b) => Instruction::Two(f, at(a), at(b)),
                Node::Select(c, a, b) => Instruction::Select(at(c), at(a), at(b)),
            })
            .collect();
        Self { code, results: results.iter().map(|&r| at(r)).collect() }
    }

    /// Evaluates into `out`, one value per result.
    pub fn eval(&self, at: Point<'_>, out: &mut [f64]) {
        let mut v: Vec<f64> = Vec::with_capacity(self.code.len());
        for i in &self.code {
            v.push(match *i {
                Instruction::Const(c) => c,
                Instruction::Time => at.t,
                Instruction::State(i) => at.x[i],
                Instruction::Input(i) => at.u[i],
                Instruction::Parameter(i) => at.p[i],
                Instruction::One(f, a) => apply1(f, v[a]),
                Instruction::Two(f, a, b) => apply2(f, v[a], v[b]),
                Instruction::Select(c, a, b) => {
                    if v[c] != 0.0 {
                        v[a]
                    } else {
                        v[b]
                    }
                }
            });
        }
        for (o, &r) in out.iter_mut().zip(&self.results) {
            *o = v[r];
        }
    }
}
