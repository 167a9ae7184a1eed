//! The noun `LtpSystem`: a linear time-periodic system with jumps.
//!
//! Between jumps `x' = A(t) x + B(t) u`, `y = C(t) x + D(t) u`; at a jump `x+ = S x- + E u`. Matrices are periodic with the
//! period `T` and smooth within a segment, where they are known at Gauss nodes and interpolated to rounding. The jump of the
//! state is the saltation matrix of the event; `E` is what the input does by moving the event (a guard that contains the
//! input) or through the reset.
//!
//! References: M. A. Aizerman, F. R. Gantmacher, Quart. J. Mech. Appl. Math. 11 (1958) (saltation); Uyanik et al. 2015,
//! equations (1) to (4).

use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::eigen::eigenvalues;
use crate::numeric::gauss::Gauss;

use super::propagate::{self, Propagation, product};

/// What happens at the end of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Jump {
    /// Name of the event.
    pub name: String,
    /// When, s, within the period.
    pub time: f64,
    /// S (nx, nx): saltation matrix.
    pub state: Vec<f64>,
    /// E (nx, nu): the input's own entry.
    pub input: Vec<f64>,
}

/// A stretch of time in which the matrices are smooth.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Start, s, within the period.
    pub start: f64,
    /// End, s.
    pub end: f64,
    /// A (q, nx, nx) at the Gauss nodes of the segment.
    pub a: Vec<f64>,
    /// B (q, nx, nu).
    pub b: Vec<f64>,
    /// C (q, ny, nx).
    pub c: Vec<f64>,
    /// D (q, ny, nu).
    pub d: Vec<f64>,
    /// Jumps at its end, in the order in which they happen.
    pub jumps: Vec<Jump>,
}

/// Lengths of a linear system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// States.
    pub nx: usize,
    /// Inputs.
    pub nu: usize,
    /// Outputs.
    pub ny: usize,
}

/// Which matrix of the state space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// Dynamics (nx, nx).
    A,
    /// Input (nx, nu).
    B,
    /// Output (ny, nx).
    C,
    /// Feedthrough (ny, nu).
    D,
}

/// Largest rate times period that is propagated, rad.
const MOST_TURNED: f64 = 1e5;

/// Nodes in a segment.
pub const NODES: usize = 12;

/// A linear time-periodic system with jumps.
#[derive(Clone, Debug)]
pub struct LtpSystem {
    period: f64,
    start: f64,
    size: Size,
    segments: Vec<Segment>,
    gauss: Gauss,
    monodromy: Vec<f64>,
    multipliers: Vec<Complex>,
}

impl LtpSystem {
    /// A system of one period from `start` (s), from segments that follow each other without a gap, each with [`NODES`] nodes.
    ///
    /// # Errors
    /// `Shape` for matrices of the wrong length, `OutOfRange` for segments that do not fill the period, `NotFinite`.
    pub fn new(period: f64, start: f64, size: Size, segments: Vec<Segment>) -> Result<Self> {
        let end = segments.last().map_or(start, |s| s.end);
        let mut at = start;
        for (k, s) in segments.iter().enumerate() {
            if (s.start - at).abs() > 1e-12 * period || s.end <= s.start {
                let expected = format!("{at} s, the end of the one before; segments fill the period in order");
                return Err(Error::OutOfRange { what: format!("segment {k}: start"), found: s.start, expected });
            }
            at = s.end;
            let Size { nx, nu, ny } = size;
            let blocks = [("A", &s.a, nx * nx), ("B", &s.b, nx * nu), ("C", &s.c, ny * nx), ("D", &s.d, ny * nu)];
            for (name, values, each) in blocks {
                check(&format!("segment {k}: {name}, {NODES} nodes"), values, NODES * each)?;
            }
            for jump in &s.jumps {
                check(&format!("jump `{}`: S", jump.name), &jump.state, nx * nx)?;
                check(&format!("jump `{}`: E", jump.name), &jump.input, nx * nu)?;
            }
        }
        if period.is_nan() || period <= 0.0 || (end - start - period).abs() > 1e-9 * period {
            let expected = format!("the period {period} s; segments fill the period in order");
            return Err(Error::OutOfRange { what: "length of all segments".into(), found: end - start, expected });
        }
        let gauss = Gauss::new(NODES);
        let mut system = Self { period, start, size, segments, gauss, monodromy: Vec::new(), multipliers: Vec::new() };
        let turned = propagate::turned(&system);
        if turned.is_nan() || turned > MOST_TURNED {
            return Err(Error::OutOfRange {
                what: "largest rate of A times the period".into(),
                found: turned,
                expected: format!(
                    "at most {MOST_TURNED:.0e}: such a system is stiff beyond what can be propagated; a gain this large is of no use"
                ),
            });
        }
        system.monodromy = Propagation::new(&system, 0.0).monodromy();
        system.multipliers = eigenvalues(&system.monodromy, size.nx)?;
        Ok(system)
    }

    /// Period T, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Where the first segment starts, s.
    pub fn start(&self) -> f64 {
        self.start
    }
    /// Lengths.
    pub fn size(&self) -> Size {
        self.size
    }
    /// Segments in order.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }
    /// Jumps in order.
    pub fn jumps(&self) -> impl Iterator<Item = &Jump> {
        self.segments.iter().flat_map(|s| &s.jumps)
    }
    /// Monodromy matrix (nx, nx) over one period from the start, jumps included.
    pub fn monodromy(&self) -> &[f64] {
        &self.monodromy
    }
    /// Floquet multipliers, largest magnitude first.
    pub fn multipliers(&self) -> &[Complex] {
        &self.multipliers
    }

    /// One of the matrices at time `t` (s), row-major; at a jump, its value just after.
    pub fn matrix(&self, entry: Entry, t: f64) -> Vec<f64> {
        let phase = self.start + (t - self.start).rem_euclid(self.period);
        let k = self.segments.partition_point(|s| s.end <= phase).min(self.segments.len() - 1);
        let s = &self.segments[k];
        let mut out = Vec::new();
        self.at(s, (phase - s.start) / (s.end - s.start), entry, &mut out);
        out
    }

    /// A matrix at the fraction `theta` of a segment.
    pub(super) fn at(&self, segment: &Segment, theta: f64, entry: Entry, out: &mut Vec<f64>) {
        let values = match entry {
            Entry::A => &segment.a,
            Entry::B => &segment.b,
            Entry::C => &segment.c,
            Entry::D => &segment.d,
        };
        let mut basis = [0.0; NODES];
        self.gauss.basis(theta, &mut basis);
        let each = values.len() / NODES;
        out.clear();
        out.resize(each, 0.0);
        for (w, block) in basis.iter().zip(values.chunks_exact(each.max(1))) {
            for (o, v) in out.iter_mut().zip(block) {
                *o += w * v;
            }
        }
    }

    /// The Gauss rule of the segments.
    pub(super) fn gauss(&self) -> &Gauss {
        &self.gauss
    }

    /// State transition matrix (nx, nx) of the jumps at the end of a segment, in order.
    pub(super) fn jump_product(&self, segment: &Segment) -> Option<Vec<f64>> {
        let nx = self.size.nx;
        segment.jumps.iter().map(|j| j.state.clone()).reduce(|first, next| product(&next, &first, nx, nx))
    }
}

fn check(what: &str, values: &[f64], expected: usize) -> Result<()> {
    if values.len() != expected {
        return Err(Error::Shape { what: what.into(), expected, found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(row) => Err(Error::NotFinite { what: what.into(), row, column: what.into(), value: values[row] }),
        None => Ok(()),
    }
}
