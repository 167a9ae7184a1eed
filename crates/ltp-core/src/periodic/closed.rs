//! A periodic state feedback around a linear time-periodic system: `u = -K(t) x + v`.

use super::propagate::product;
use super::system::{Jump, LtpSystem, Segment, Size};
use crate::error::{Error, Result};
use crate::numeric::fourier_series::FourierSeries;

impl LtpSystem {
    /// The system under `u = -K(t) x + v`: `A - B K`, `B`, `C - D K`, `D` from `v`, and `S - E K` at jumps.
    ///
    /// `gain` holds K(t), (nu, nx) row-major. Its period is the system's, or a whole part of it; a constant may carry any
    /// period.
    ///
    /// # Errors
    /// `Shape` for a gain that is not (nu, nx), `OutOfRange` for one whose period does not divide the system's, and what
    /// [`LtpSystem::new`] says.
    pub fn closed(&self, gain: &FourierSeries) -> Result<Self> {
        let size = self.size();
        let Size { nx, nu, .. } = size;
        if gain.rows() != nu * nx {
            let what = format!("gain, ({nu} inputs, {nx} states) row-major");
            return Err(Error::Shape { what, expected: nu * nx, found: gain.rows() });
        }
        let times = self.period() / gain.period();
        if gain.harmonics() > 0 && (times.round() < 1.0 || (times - times.round()).abs() > 1e-9 * times) {
            let expected =
                format!("the system's {} s, or a whole part of it: the loop has to be periodic", self.period());
            return Err(Error::OutOfRange { what: "period of the gain".into(), found: gain.period(), expected });
        }
        let after = |jump: &Jump| {
            let state = less(&jump.state, &jump.input, &gain.value(jump.time), nu);
            Jump { state, ..jump.clone() }
        };
        let jumps = |s: &Segment| s.jumps.iter().map(after).collect::<Vec<_>>();
        if gain.harmonics() == 0 {
            // A constant gain leaves every entry a polynomial of the same nodes.
            let k = gain.value(0.0);
            let closed = |m: &[f64], by: &[f64], rows: usize| -> Vec<f64> {
                let nodes = m.chunks((rows * nx).max(1)).zip(by.chunks((rows * nu).max(1)));
                nodes.flat_map(|(m, by)| less(m, by, &k, nu)).collect()
            };
            let one = |s: &Segment| {
                let (a, c) = (closed(&s.a, &s.b, nx), closed(&s.c, &s.d, size.ny));
                Segment { a, c, jumps: jumps(s), ..s.clone() }
            };
            return Self::new(self.period(), self.start(), size, self.segments().iter().map(one).collect());
        }
        self.rebuilt(size, jumps, |t, [a, b, c, d]| {
            let k = gain.value(t);
            [less(&a, &b, &k, nu), b, less(&c, &d, &k, nu), d]
        })
    }
}

/// `left - by K`, row-major, with K of `nu` rows.
fn less(left: &[f64], by: &[f64], gain: &[f64], nu: usize) -> Vec<f64> {
    let fed = product(by, gain, by.len() / nu, nu);
    left.iter().zip(&fed).map(|(l, f)| l - f).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Complex;
    use crate::periodic::Entry;
    use crate::periodic::system::NODES;
    use std::f64::consts::TAU;

    const SIZE: Size = Size { nx: 2, nu: 1, ny: 1 };

    fn open(t: f64, entry: Entry) -> Vec<f64> {
        match entry {
            Entry::A => vec![0.0, 1.0, 2.0 + (TAU * t).cos(), 0.0],
            Entry::B => vec![0.0, 1.0 + 0.2 * (TAU * t).sin()],
            Entry::C => vec![1.0, 0.0],
            Entry::D => vec![0.5],
        }
    }

    fn gain() -> FourierSeries {
        let c = |re, im| Complex::new(re, im);
        FourierSeries::new(1.0, 2, vec![c(6.0, 0.0), c(2.0, 0.0), c(0.3, 0.1), c(0.0, -0.4), c(0.0, 0.1), c(0.05, 0.0)])
            .expect("gain")
    }

    #[test]
    fn the_loop_is_that_of_the_functions() {
        let system = LtpSystem::smooth(1.0, SIZE, open).expect("open");
        for gain in [gain(), FourierSeries::constant(3.0, &[5.0, 1.0]).expect("constant")] {
            let closed = system.closed(&gain).expect("closed");
            let same = LtpSystem::smooth(1.0, SIZE, |t, entry| {
                let (m, k) = (open(t, entry), gain.value(if gain.harmonics() == 0 { 0.0 } else { t }));
                match entry {
                    Entry::A => less(&m, &open(t, Entry::B), &k, 1),
                    Entry::C => less(&m, &open(t, Entry::D), &k, 1),
                    _ => m,
                }
            })
            .expect("functions");
            for t in [0.0, 0.21, 0.77] {
                for entry in [Entry::A, Entry::B, Entry::C, Entry::D] {
                    for (x, y) in closed.matrix(entry, t).iter().zip(same.matrix(entry, t)) {
                        assert!((x - y).abs() < 1e-10, "{entry:?} {t}: {x} {y}");
                    }
                }
            }
            for (x, y) in closed.multipliers().iter().zip(same.multipliers()) {
                assert!((x - y).norm() < 1e-11);
            }
        }
    }

    #[test]
    fn a_jump_sees_the_gain_at_its_time() {
        let each = |m: &[f64]| m.repeat(NODES);
        let jump = Jump { name: "kick".into(), time: 1.0, state: vec![1.0, 0.0, 0.0, 0.5], input: vec![0.1, 0.2] };
        let segment = Segment {
            start: 0.0,
            end: 1.0,
            a: each(&[0.0, 1.0, -4.0, -0.4]),
            b: each(&[0.0, 1.0]),
            c: vec![],
            d: vec![],
            jumps: vec![jump],
        };
        let system = LtpSystem::new(1.0, 0.0, Size { nx: 2, nu: 1, ny: 0 }, vec![segment]).expect("system");
        let closed = system.closed(&gain()).expect("closed");
        let k = gain().value(1.0);
        let state = &closed.jumps().next().expect("jump").state;
        assert!((state[0] - (1.0 - 0.1 * k[0])).abs() < 1e-14 && (state[3] - (0.5 - 0.2 * k[1])).abs() < 1e-14);
        let constant = system.closed(&FourierSeries::constant(1.0, &[1.0, 2.0]).expect("constant")).expect("closed");
        assert!((constant.matrix(Entry::A, 0.3)[2] + 5.0).abs() < 1e-13);
    }

    #[test]
    fn gains_that_do_not_fit_are_refused() {
        let system = LtpSystem::smooth(1.0, SIZE, open).expect("open");
        let shape = system.closed(&FourierSeries::constant(1.0, &[1.0]).expect("constant")).expect_err("shape");
        assert!(matches!(shape, Error::Shape { expected: 2, found: 1, .. }), "{shape}");
        let other = FourierSeries::new(0.7, 2, gain().coefficients().to_vec()).expect("gain");
        assert!(matches!(system.closed(&other), Err(Error::OutOfRange { found, .. }) if found == 0.7));
        let half = FourierSeries::new(0.5, 2, gain().coefficients().to_vec()).expect("gain");
        assert!(system.closed(&half).is_ok());
    }
}
