//! Slip and stick of the truth integrator: a complementarity problem solved by trying every combination.
//!
//! An element of level `L` at port velocity `v` obeys `phi in -L Sgn(v)` (Filippov 1988). With the velocity's rate affine
//! in the forces, `vdot_i = r_i + sum_j C_ij phi_j`, elements at rest either hold (`vdot = 0`, `|phi| <= L`) or begin to
//! slip against their force; with a handful of elements all combinations are tried and the first consistent one is taken.

use crate::model::Point;
use crate::model::friction::Parts;

/// What one element does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// Holds.
    Stick,
    /// Moves with positive velocity.
    Forward,
    /// Moves with negative velocity.
    Backward,
}

/// A velocity below this, in SI units, is rest at the beginning of a mode.
const REST: f64 = 1e-12;

/// Numbers of all elements at one point.
pub struct Friction {
    /// Velocity, level, own coupling of each element.
    element: Vec<f64>,
    /// `r_i`, then `C_ij`.
    hold: Vec<f64>,
    phi: Vec<f64>,
}

impl Friction {
    /// Room for a number of elements.
    pub fn new(elements: usize) -> Self {
        Self { element: vec![0.0; 3 * elements], hold: vec![0.0; elements * (1 + elements)], phi: vec![0.0; elements] }
    }

    /// Evaluates the elements.
    pub fn load(&mut self, parts: &Parts, at: Point<'_>) {
        if parts.elements > 0 {
            parts.element.eval(at, &mut self.element);
            parts.hold.eval(at, &mut self.hold);
        }
    }

    fn velocity(&self, i: usize) -> f64 {
        self.element[3 * i]
    }

    fn level(&self, i: usize) -> f64 {
        self.element[3 * i + 1]
    }

    /// Whether the element's force moves its port in this mode.
    fn acts(&self, i: usize) -> bool {
        self.element[3 * i + 2] != 0.0
    }

    /// Force of an element, after [`Friction::solve`].
    pub fn force(&self, i: usize) -> f64 {
        self.phi[i]
    }

    /// A quantity from its value without friction and its change per unit of each force.
    pub fn affine(&self, values: &[f64]) -> f64 {
        values[0] + values[1..].iter().zip(&self.phi).map(|(s, f)| s * f).sum::<f64>()
    }

    fn rate(&self, i: usize) -> f64 {
        let row = &self.hold[i * (1 + self.phi.len())..(i + 1) * (1 + self.phi.len())];
        self.affine(row)
    }

    /// Positive while an element may go on as it does.
    pub fn margin(&self, i: usize, contact: Contact) -> f64 {
        match contact {
            _ if !self.acts(i) => 1.0,
            Contact::Forward => self.velocity(i),
            Contact::Backward => -self.velocity(i),
            Contact::Stick => self.level(i) - self.phi[i].abs(),
        }
    }

    /// Forces under given contacts.
    pub fn solve(&mut self, contacts: &[Contact]) {
        let n = contacts.len();
        let mut stuck = Vec::new();
        for (i, c) in contacts.iter().enumerate() {
            self.phi[i] = 0.0;
            if self.acts(i) {
                match c {
                    Contact::Forward => self.phi[i] = -self.level(i),
                    Contact::Backward => self.phi[i] = self.level(i),
                    Contact::Stick => stuck.push(i),
                }
            }
        }
        if stuck.is_empty() {
            return;
        }
        // Gauss's elimination with the largest pivot: the problems have one to six unknowns.
        let mut rows: Vec<Vec<f64>> = stuck
            .iter()
            .map(|&i| {
                let mut row: Vec<f64> = stuck.iter().map(|&j| self.hold[i * (1 + n) + 1 + j]).collect();
                row.push(-self.rate(i));
                row
            })
            .collect();
        let m = stuck.len();
        for c in 0..m {
            let pivot = (c..m).max_by(|&a, &b| rows[a][c].abs().total_cmp(&rows[b][c].abs())).unwrap_or(c);
            rows.swap(c, pivot);
            if rows[c][c] == 0.0 {
                continue;
            }
            for r in (0..m).filter(|&r| r != c) {
                let factor = rows[r][c] / rows[c][c];
                for k in c..=m {
                    rows[r][k] -= factor * rows[c][k];
                }
            }
        }
        for (c, &i) in stuck.iter().enumerate() {
            self.phi[i] = if rows[c][c] == 0.0 { 0.0 } else { rows[c][m] / rows[c][c] };
        }
    }

    /// The contacts that fit: by the sign of velocity, and where that is zero (`at_zero`, or by value) by trying.
    pub fn settle(&mut self, contacts: &mut [Contact], at_zero: &[usize]) {
        let mut resting = Vec::new();
        for i in 0..contacts.len() {
            let v = self.velocity(i);
            if at_zero.contains(&i) || v.abs() <= REST || (contacts[i] == Contact::Stick && v.abs() <= 1e3 * REST) {
                resting.push(i);
            } else {
                contacts[i] = if v > 0.0 { Contact::Forward } else { Contact::Backward };
            }
        }
        for number in 0..3usize.pow(resting.len() as u32) {
            let mut rest = number;
            for &i in &resting {
                contacts[i] = [Contact::Stick, Contact::Forward, Contact::Backward][rest % 3];
                rest /= 3;
            }
            self.solve(contacts);
            let fits = |&i: &usize| match contacts[i] {
                _ if !self.acts(i) => true,
                Contact::Stick => self.phi[i].abs() <= self.level(i) * (1.0 + 1e-12),
                Contact::Forward => self.rate(i) >= 0.0,
                Contact::Backward => self.rate(i) <= 0.0,
            };
            if resting.iter().all(fits) {
                return;
            }
        }
        // Without a consistent choice (a Painleve paradox) the elements go on holding.
        for &i in &resting {
            contacts[i] = Contact::Stick;
        }
        self.solve(contacts);
    }
}
