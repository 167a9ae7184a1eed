//! Bracketed roots by bisection, for functions of which nothing but a sign can be trusted.
//!
//! Event guards may be flat, kinked or steep; bisection takes the same number of steps for all of them, never leaves
//! its bracket, and gives the same bits on every machine.

/// The last point before a change of sign and the first after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bracket {
    /// Where the function still has the sign it had at `a`.
    pub before: f64,
    /// Where it has changed; a value of exactly zero counts as changed.
    pub after: f64,
    /// Evaluations made.
    pub evaluations: usize,
}

/// Halves `[a, b]` around the change of sign of `f` until it is no wider than `tol`, or than two neighbouring
/// numbers.
///
/// `fa = f(a)` gives the sign to leave; `f(b)` is taken to have left it and is not evaluated. `b < a` searches
/// backwards. Where `f` is NaN the sign counts as changed, so that the bracket ends before the trouble. If `fa` is
/// zero the bracket is `a` itself.
pub fn bisect(mut f: impl FnMut(f64) -> f64, a: f64, b: f64, fa: f64, tol: f64) -> Bracket {
    let (mut before, mut after, mut evaluations) = (a, b, 0);
    if fa == 0.0 {
        return Bracket { before: a, after: a, evaluations };
    }
    while (after - before).abs() > tol {
        let middle = before + 0.5 * (after - before);
        if middle == before || middle == after {
            break;
        }
        evaluations += 1;
        let value = f(middle);
        if value != 0.0 && !value.is_nan() && value.is_sign_positive() == fa.is_sign_positive() {
            before = middle;
        } else {
            after = middle;
        }
    }
    Bracket { before, after, evaluations }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn root_of_two_to_the_last_digit() {
        let root = bisect(|x| x * x - 2.0, 0.0, 2.0, -2.0, 0.0);
        assert!(root.before < root.after && root.after - root.before <= 2.0 * f64::EPSILON);
        assert!(root.before * root.before < 2.0 && root.after * root.after >= 2.0);
        assert!(root.evaluations <= 54);
    }

    #[test]
    fn tolerance_sets_the_number_of_evaluations() {
        let root = bisect(|x| 0.3 - x, 0.0, 1.0, 0.3, 1e-3);
        assert_eq!(root.evaluations, 10);
        assert!((root.after - 0.3).abs() <= 1e-3);
    }

    #[test]
    fn jumps_zeros_nan_and_backward_search() {
        let jump = bisect(|x| if x < 0.7 { -1.0 } else { 5.0 }, 0.0, 1.0, -1.0, 1e-12);
        assert!(jump.before < 0.7 && jump.after >= 0.7);
        assert_eq!(bisect(|x| x, 0.0, 1.0, 0.0, 1e-12), Bracket { before: 0.0, after: 0.0, evaluations: 0 });
        let undefined = bisect(|x: f64| if x > 0.4 { f64::NAN } else { 1.0 }, 0.0, 1.0, 1.0, 1e-9);
        assert!(undefined.before <= 0.4);
        let backward = bisect(|x| x - 0.25, 1.0, 0.0, 0.75, 1e-12);
        assert!((backward.after - 0.25).abs() <= 1e-12 && backward.after <= backward.before);
    }

    proptest! {
        #[test]
        fn bracket_holds_the_change(root in -0.999..0.999_f64, power in 1..4_i32) {
            let f = |x: f64| (x - root).powi(2 * power - 1);
            let found = bisect(f, -1.0, 1.0, f(-1.0), 1e-9);
            prop_assert!(found.before <= root && found.after >= root - 1e-12);
            prop_assert!(found.after - found.before <= 1e-9);
        }
    }
}
