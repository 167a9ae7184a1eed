//! `M(q) d(velocities)/dt = forces`, solved symbolically once, so that every derivative of the rates stays exact.

use super::document::Document;
use super::graph::{Graph, Id};
use super::scope::Scope;
use crate::error::{Error, Result};

/// Rows of the equations of motion.
pub struct Rows {
    /// State of each row.
    pub velocities: Vec<usize>,
    matrix: Vec<Vec<Id>>,
    forces: Vec<Id>,
}

impl Rows {
    /// Reads the document's mass matrix, if it has one.
    ///
    /// # Errors
    /// [`Error::Model`] when the shapes do not fit, and the errors of expressions.
    pub fn read(g: &mut Graph, scope: &mut Scope<'_>, doc: &Document) -> Result<Option<Self>> {
        let Some(m) = &doc.mass_matrix else { return Ok(None) };
        let n = m.velocities.len();
        let path = super::assemble::place(scope.source, "mass_matrix");
        if m.forces.len() != n || m.matrix.len() != n || m.matrix.iter().any(|r| r.len() != n) {
            let rows: Vec<usize> = m.matrix.iter().map(Vec::len).collect();
            let message = format!(
                "{n} velocities need a {n} x {n} matrix and {n} forces; found rows of lengths {rows:?} and {} forces",
                m.forces.len()
            );
            return Err(Error::Model { path, message });
        }
        let velocities = m.velocities.iter().map(|v| scope.names.state(v, &path)).collect::<Result<Vec<_>>>()?;
        let mut matrix = Vec::new();
        for (i, row) in m.matrix.iter().enumerate() {
            let read = |(j, e): (usize, &String)| scope.expression(g, e, &format!("mass_matrix.matrix[{i}][{j}]"));
            matrix.push(row.iter().enumerate().map(read).collect::<Result<Vec<_>>>()?);
        }
        let mut forces = Vec::new();
        for (i, e) in m.forces.iter().enumerate() {
            forces.push(scope.expression(g, e, &format!("mass_matrix.forces[{i}]"))?);
        }
        Ok(Some(Self { velocities, matrix, forces }))
    }

    /// The force of the row of a state, to add to.
    pub fn force_of(&mut self, state: usize) -> Option<&mut Id> {
        let row = self.velocities.iter().position(|&v| v == state)?;
        Some(&mut self.forces[row])
    }

    /// Rates of the velocities.
    pub fn solve(self, g: &mut Graph) -> Vec<(usize, Id)> {
        let x = solve(g, self.matrix, self.forces);
        self.velocities.into_iter().zip(x).collect()
    }
}

/// Gaussian elimination on expressions, without pivoting: meant for the small positive definite matrices of mechanics.
pub fn solve(g: &mut Graph, mut a: Vec<Vec<Id>>, mut b: Vec<Id>) -> Vec<Id> {
    let n = b.len();
    for k in 0..n {
        for i in k + 1..n {
            if g.is_zero(a[i][k]) {
                continue;
            }
            let factor = g.div(a[i][k], a[k][k]);
            for j in k + 1..n {
                let p = g.mul(factor, a[k][j]);
                a[i][j] = g.sub(a[i][j], p);
            }
            let p = g.mul(factor, b[k]);
            b[i] = g.sub(b[i], p);
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            let p = g.mul(a[k][j], b[j]);
            b[k] = g.sub(b[k], p);
        }
        b[k] = g.div(b[k], a[k][k]);
    }
    b
}
