//! The shared expression graph: every subexpression of a model stands here once.
//!
//! Nodes are hash-consed, so that common subexpressions are computed once whatever the number of equations and
//! derivatives that use them; constructors fold constants and drop neutral elements. Derivatives are in
//! `derivative`. The graph knows no names: it works on [`Symbol`]s.

use std::collections::HashMap;

/// A leaf of the graph: what an expression may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Symbol {
    /// Time, s.
    Time,
    /// State number.
    State(usize),
    /// Input number; behind the inputs those that are seen late, each followed by its rate.
    Input(usize),
    /// Parameter number.
    Parameter(usize),
    /// Generalised force of a port, a placeholder that assembly replaces by the laws attached there.
    Port(usize),
    /// Set-valued friction force of a dry element, a placeholder that each slip or stick mode replaces.
    Dry(usize),
}

/// Functions of one argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum Fun1 {
    Neg,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Log,
    Sqrt,
    Abs,
    Sign,
}

/// Functions of two arguments; comparisons give one or zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum Fun2 {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
    Atan2,
    Min,
    Max,
    Lt,
    Le,
    Gt,
    Ge,
    Eq,
    Ne,
}

/// Handle of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(u32);

impl Id {
    /// Position of the node in its graph.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One node; operands always stand before their node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number, by its bits.
    Const(u64),
    /// A leaf.
    Leaf(Symbol),
    /// A function of one node.
    One(Fun1, Id),
    /// A function of two nodes.
    Two(Fun2, Id, Id),
    /// `if(condition, then, otherwise)`; the condition holds when it is not zero.
    Select(Id, Id, Id),
}

/// Applies a function of one argument; the one definition that all evaluators share.
pub fn apply1(f: Fun1, a: f64) -> f64 {
    match f {
        Fun1::Neg => -a,
        Fun1::Sin => a.sin(),
        Fun1::Cos => a.cos(),
        Fun1::Tan => a.tan(),
        Fun1::Asin => a.asin(),
        Fun1::Acos => a.acos(),
        Fun1::Atan => a.atan(),
        Fun1::Sinh => a.sinh(),
        Fun1::Cosh => a.cosh(),
        Fun1::Tanh => a.tanh(),
        Fun1::Exp => a.exp(),
        Fun1::Log => a.ln(),
        Fun1::Sqrt => a.sqrt(),
        Fun1::Abs => a.abs(),
        Fun1::Sign => sign(a),
    }
}

/// Applies a function of two arguments; the one definition that all evaluators share.
pub fn apply2(f: Fun2, a: f64, b: f64) -> f64 {
    let truth = |c: bool| if c { 1.0 } else { 0.0 };
    match f {
        Fun2::Add => a + b,
        Fun2::Sub => a - b,
        Fun2::Mul => a * b,
        Fun2::Div => a / b,
        Fun2::Pow => a.powf(b),
        Fun2::Atan2 => a.atan2(b),
        Fun2::Min => {
            if a < b {
                a
            } else {
                b
            }
        }
        Fun2::Max => {
            if a > b {
                a
            } else {
                b
            }
        }
        Fun2::Lt => truth(a < b),
        Fun2::Le => truth(a <= b),
        Fun2::Gt => truth(a > b),
        Fun2::Ge => truth(a >= b),
        Fun2::Eq => truth(a == b),
        Fun2::Ne => truth(a != b),
    }
}

/// Sign with `sign(0) = 0`.
fn sign(a: f64) -> f64 {
    f64::from(i8::from(a > 0.0) - i8::from(a < 0.0))
}

/// A growing set of shared expressions.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    index: HashMap<Node, Id>,
    /// Number of inputs that are seen as they are.
    inputs: usize,
    /// Inputs that are seen late, with their delays.
    late: Vec<(usize, Id)>,
}

impl Graph {
    /// An empty graph.
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty graph over a number of inputs, of which it may be asked for earlier values.
    pub fn over_inputs(inputs: usize) -> Self {
        Self { inputs, ..Self::default() }
    }

    /// Inputs that are seen late, with their delays (`delay`).
    pub fn late(&self) -> &[(usize, Id)] {
        &self.late
    }

    /// An input, or one that is late already, as it was `delay` seconds ago.
    pub fn late_input(&mut self, channel: usize, delay: Id) -> Id {
        let (input, delay) = match channel.checked_sub(self.inputs) {
            None => (channel, delay),
            Some(k) => {
                let (input, before) = self.late[k / 2];
                (input, self.add(before, delay))
            }
        };
        let known = self.late.iter().position(|l| *l == (input, delay));
        let k = known.unwrap_or_else(|| {
            self.late.push((input, delay));
            self.late.len() - 1
        });
        self.leaf(Symbol::Input(self.inputs + 2 * k))
    }

    /// Derivative of a late input by a parameter, `-rate * d(delay)`; zero for everything else.
    pub(super) fn late_slope(&mut self, channel: usize, by: Symbol) -> Option<Id> {
        let k = channel.checked_sub(self.inputs).filter(|k| k % 2 == 0 && matches!(by, Symbol::Parameter(_)))?;
        let delay = self.late.get(k / 2)?.1;
        let slope = self.derivative(&[delay], by)[0];
        if self.is_zero(slope) {
            return None;
        }
        let rate = self.leaf(Symbol::Input(channel + 1));
        let change = self.mul(rate, slope);
        Some(self.neg(change))
    }

    /// The node behind a handle.
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id.index()]
    }

    fn intern(&mut self, node: Node) -> Id {
        if let Some(&id) = self.index.get(&node) {
            return id;
        }
        let id = Id(self.nodes.len() as u32);
        self.nodes.push(node);
        self.index.insert(node, id);
        id
    }

    /// A number.
    pub fn constant(&mut self, value: f64) -> Id {
        let value = if value == 0.0 { 0.0 } else { value }; // one zero, not two
        self.intern(Node::Const(value.to_bits()))
    }

    /// A leaf.
    pub fn leaf(&mut self, symbol: Symbol) -> Id {
        self.intern(Node::Leaf(symbol))
    }

    /// The number that a node is, if it is one.
    pub fn value(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Const(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Whether the node is the number zero.
    pub fn is_zero(&self, id: Id) -> bool {
        self.value(id) == Some(0.0)
    }

    /// A function of one argument, folded where its argument is a number.
    pub fn one(&mut self, f: Fun1, a: Id) -> Id {
        if let Some(v) = self.value(a) {
            return self.constant(apply1(f, v));
        }
        if let (Fun1::Neg, Node::One(Fun1::Neg, inner)) = (f, self.node(a)) {
            return inner;
        }
        self.intern(Node::One(f, a))
    }

    /// A function of two arguments, folded and freed of neutral elements.
    pub fn two(&mut self, f: Fun2, a: Id, b: Id) -> Id {
        let (va, vb) = (self.value(a), self.value(b));
        if let (Some(x), Some(y)) = (va, vb) {
            return self.constant(apply2(f, x, y));
        }
        match f {
            Fun2::Add if va == Some(0.0) => return b,
            Fun2::Add | Fun2::Sub if vb == Some(0.0) => return a,
            Fun2::Sub if va == Some(0.0) => return self.one(Fun1::Neg, b),
            Fun2::Sub if a == b => return self.constant(0.0),
            Fun2::Mul if va == Some(0.0) || vb == Some(0.0) => return self.constant(0.0),
            Fun2::Mul if va == Some(1.0) => return b,
            Fun2::Mul | Fun2::Div | Fun2::Pow if vb == Some(1.0) => return a,
            Fun2::Mul if va == Some(-1.0) => return self.one(Fun1::Neg, b),
            Fun2::Mul | Fun2::Div if vb == Some(-1.0) => return self.one(Fun1::Neg, a),
            Fun2::Div if va == Some(0.0) => return a,
            Fun2::Pow if vb == Some(0.0) => return self.constant(1.0),
            Fun2::Pow if vb == Some(0.5) => return self.one(Fun1::Sqrt, a),
            Fun2::Pow => {
                if let Some(n) = vb.filter(|n| n.fract() == 0.0 && n.abs() <= 16.0) {
                    return self.integer_power(a, n as i32);
                }
            }
            _ => {}
        }
        // Commutative operands in one order, so that a*b and b*a are one node.
        let (a, b) = match f {
            Fun2::Add | Fun2::Mul if b < a => (b, a),
            _ => (a, b),
        };
        self.intern(Node::Two(f, a, b))
    }

    fn integer_power(&mut self, base: Id, n: i32) -> Id {
        let mut result = self.constant(1.0);
        let (mut square, mut rest) = (base, n.unsigned_abs());
        while rest > 0 {
            if rest & 1 == 1 {
                result = self.mul(result, square);
            }
            rest >>= 1;
            if rest > 0 {
                square = self.mul(square, square);
            }
        }
        if n < 0 {
            let one = self.constant(1.0);
            return self.div(one, result);
        }
        result
    }

    /// `if(condition, then, otherwise)`.
    pub fn select(&mut self, condition: Id, then: Id, otherwise: Id) -> Id {
        match self.value(condition) {
            Some(c) if c != 0.0 => then,
            Some(_) => otherwise,
            None if then == otherwise => then,
            None => self.intern(Node::Select(condition, then, otherwise)),
        }
    }

    /// Sum.
    pub fn add(&mut self, a: Id, b: Id) -> Id {
        self.two(Fun2::Add, a, b)
    }
    /// Difference.
    pub fn sub(&mut self, a: Id, b: Id) -> Id {
        self.two(Fun2::Sub, a, b)
    }
    /// Product.
    pub fn mul(&mut self, a: Id, b: Id) -> Id {
        self.two(Fun2::Mul, a, b)
    }
    /// Quotient.
    pub fn div(&mut self, a: Id, b: Id) -> Id {
        self.two(Fun2::Div, a, b)
    }
    /// Negation.
    pub fn neg(&mut self, a: Id) -> Id {
        self.one(Fun1::Neg, a)
    }

    /// Handles of all nodes that `roots` need, operands first.
    pub fn reachable(&self, roots: &[Id]) -> Vec<Id> {
        let mut seen = vec![false; self.nodes.len()];
        for r in roots {
            seen[r.index()] = true;
        }
        for i in (0..self.nodes.len()).rev() {
            if seen[i] {
                for o in operands(self.nodes[i]).into_iter().flatten() {
                    seen[o.index()] = true;
                }
            }
        }
        (0..self.nodes.len()).filter(|&i| seen[i]).map(|i| Id(i as u32)).collect()
    }

    /// Every leaf that `roots` depend on, in order.
    pub fn leaves(&self, roots: &[Id]) -> Vec<Symbol> {
        let leaf = |id: Id| if let Node::Leaf(s) = self.node(id) { Some(s) } else { None };
        let mut found: Vec<Symbol> = self.reachable(roots).into_iter().filter_map(leaf).collect();
        found.sort();
        found
    }

    /// The expressions with leaves replaced; `replace` gives the new node of a leaf, or `None` to keep it.
    pub fn substitute(&mut self, roots: &[Id], replace: impl Fn(Symbol) -> Option<Id>) -> Vec<Id> {
        let mut new: HashMap<Id, Id> = HashMap::new();
        for id in self.reachable(roots) {
            let to = match self.node(id) {
                Node::Const(_) => id,
                Node::Leaf(s) => replace(s).unwrap_or(id),
                Node::One(f, a) => self.one(f, new[&a]),
                Node::Two(f, a, b) => self.two(f, new[&a], new[&b]),
                Node::Select(c, a, b) => self.select(new[&c], new[&a], new[&b]),
            };
            new.insert(id, to);
        }
        roots.iter().map(|r| new[r]).collect()
    }
}

/// Operands of a node.
pub fn operands(node: Node) -> [Option<Id>; 3] {
    match node {
        Node::Const(_) | Node::Leaf(_) => [None; 3],
        Node::One(_, a) => [Some(a), None, None],
        Node::Two(_, a, b) => [Some(a), Some(b), None],
        Node::Select(c, a, b) => [Some(c), Some(a), Some(b)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_and_folded() {
        let mut g = Graph::new();
        let (x, y, zero) = (g.leaf(Symbol::State(0)), g.leaf(Symbol::State(1)), g.constant(0.0));
        assert_eq!(g.mul(x, y), g.mul(y, x));
        assert_eq!(g.add(x, zero), x);
    }
}
