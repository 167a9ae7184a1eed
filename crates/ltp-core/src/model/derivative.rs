//! Exact derivatives of shared expressions, by forward accumulation over the graph (Griewank & Walther, *Evaluating
//! Derivatives*, 2nd ed. 2008, chapter 3). The result is made of the same shared nodes.

use std::collections::HashMap;

use super::graph::{Fun1, Fun2, Graph, Id, Node, Symbol, operands};

impl Graph {
    /// Exact derivatives of `roots` with respect to one leaf. Kinks (`abs`, `min`, `sign`, `if`) are differentiated on
    /// the side where they are evaluated.
    pub fn derivative(&mut self, roots: &[Id], leaf: Symbol) -> Vec<Id> {
        let zero = self.constant(0.0);
        let mut d: HashMap<Id, Id> = HashMap::new();
        for id in self.reachable(roots) {
            let of = |x: &Id| d.get(x).copied().unwrap_or(zero);
            let node = self.node(id);
            let moved = operands(node).into_iter().flatten().any(|o| of(&o) != zero);
            let dv = match node {
                Node::Leaf(s) if s == leaf => self.constant(1.0),
                _ if !moved => continue,
                Node::Const(_) | Node::Leaf(_) => continue,
                Node::One(f, a) => {
                    let da = of(&a);
                    self.derivative_one(f, a, da, id)
                }
                Node::Two(f, a, b) => {
                    let (da, db) = (of(&a), of(&b));
                    self.derivative_two(f, a, b, da, db, id)
                }
                Node::Select(c, a, b) => {
                    let (da, db) = (of(&a), of(&b));
                    self.select(c, da, db)
                }
            };
            if dv != zero {
                d.insert(id, dv);
            }
        }
        roots.iter().map(|r| d.get(r).copied().unwrap_or(zero)).collect()
    }

    fn derivative_one(&mut self, f: Fun1, a: Id, da: Id, value: Id) -> Id {
        let one = self.constant(1.0);
        let square = |g: &mut Self, x: Id| g.mul(x, x);
        match f {
            Fun1::Neg => self.neg(da),
            Fun1::Sin => {
                let c = self.one(Fun1::Cos, a);
                self.mul(c, da)
            }
            Fun1::Cos => {
                let s = self.one(Fun1::Sin, a);
                let p = self.mul(s, da);
                self.neg(p)
            }
            Fun1::Tan => {
                let s = square(self, value);
                let w = self.add(one, s);
                self.mul(w, da)
            }
            Fun1::Asin | Fun1::Acos => {
                let s = square(self, a);
                let w = self.sub(one, s);
                let r = self.one(Fun1::Sqrt, w);
                let q = self.div(da, r);
                if f == Fun1::Asin { q } else { self.neg(q) }
            }
            Fun1::Atan => {
                let s = square(self, a);
                let w = self.add(one, s);
                self.div(da, w)
            }
            Fun1::Sinh => {
                let c = self.one(Fun1::Cosh, a);
                self.mul(c, da)
            }
            Fun1::Cosh => {
                let s = self.one(Fun1::Sinh, a);
                self.mul(s, da)
            }
            Fun1::Tanh => {
                let s = square(self, value);
                let w = self.sub(one, s);
                self.mul(w, da)
            }
            Fun1::Exp => self.mul(value, da),
            Fun1::Log => self.div(da, a),
            Fun1::Sqrt => {
                let two = self.constant(2.0);
                let w = self.mul(two, value);
                self.div(da, w)
            }
            Fun1::Abs => {
                let s = self.one(Fun1::Sign, a);
                self.mul(s, da)
            }
            Fun1::Sign => self.constant(0.0),
        }
    }

    fn derivative_two(&mut self, f: Fun2, a: Id, b: Id, da: Id, db: Id, value: Id) -> Id {
        match f {
            Fun2::Add => self.add(da, db),
            Fun2::Sub => self.sub(da, db),
            Fun2::Mul => {
                let (l, r) = (self.mul(da, b), self.mul(a, db));
                self.add(l, r)
            }
            Fun2::Div => {
                // (da - value*db)/b reuses the quotient itself.
                let p = self.mul(value, db);
                let n = self.sub(da, p);
                self.div(n, b)
            }
            Fun2::Pow => {
                let one = self.constant(1.0);
                let e = self.sub(b, one);
                let p = self.two(Fun2::Pow, a, e);
                let bp = self.mul(b, p);
                let first = self.mul(bp, da);
                if self.is_zero(db) {
                    return first;
                }
                // 0^b stays zero when b moves, though log(0) does not say so.
                let (zero, log) = (self.constant(0.0), self.one(Fun1::Log, a));
                let away = self.two(Fun2::Ne, a, zero);
                let l = self.select(away, log, zero);
                let vl = self.mul(value, l);
                let second = self.mul(vl, db);
                self.add(first, second)
            }
            Fun2::Atan2 => {
                let (aa, bb) = (self.mul(a, a), self.mul(b, b));
                let w = self.add(aa, bb);
                let (l, r) = (self.mul(b, da), self.mul(a, db));
                let n = self.sub(l, r);
                self.div(n, w)
            }
            Fun2::Min | Fun2::Max => {
                let order = if f == Fun2::Min { Fun2::Lt } else { Fun2::Gt };
                let c = self.two(order, a, b);
                self.select(c, da, db)
            }
            Fun2::Lt | Fun2::Le | Fun2::Gt | Fun2::Ge | Fun2::Eq | Fun2::Ne => self.constant(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_integer_power_has_the_right_derivative() {
        let mut g = Graph::new();
        let x = g.leaf(Symbol::State(0));
        let n = g.constant(-2.0);
        let f = g.two(Fun2::Pow, x, n);
        let d = g.derivative(&[f], Symbol::State(0))[0];
        let two = g.constant(2.0);
        let at = g.substitute(&[d], |_| Some(two))[0];
        assert!((g.value(at).unwrap() + 0.25).abs() < 1e-15);
    }
}
