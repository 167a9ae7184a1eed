//! Uniform quartic B-splines: five bumps over every interval, three times continuously differentiable.
//!
//! Bump `q` lives on the intervals `q - 4 ..= q`; over interval `c` the bumps `c ..= c + 4` are not zero, and they sum to
//! one.
//!
//! Reference: C. de Boor, *A Practical Guide to Splines*, revised edition, chapter IX (the recursion on the degree).

/// Bumps over one interval.
pub const BUMPS: usize = 5;

/// The five bumps at the place `x` of their interval, from 0 to 1.
pub fn values(x: f64) -> [f64; BUMPS] {
    let mut bumps = [0.0; BUMPS];
    bumps[0] = 1.0;
    for degree in 1..BUMPS {
        let mut carried = 0.0;
        for i in 0..degree {
            // Bump i of the degree below starts `degree - 1 - i` intervals before this one.
            let begun = x + (degree - 1 - i) as f64;
            let share = bumps[i] / degree as f64;
            bumps[i] = carried + share * (degree as f64 - begun);
            carried = share * begun;
        }
        bumps[degree] = carried;
    }
    bumps
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_at_a_knot_are_the_known_ones() {
        let expected = [1.0, 11.0, 11.0, 1.0, 0.0].map(|v| v / 24.0);
        values(0.0).iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-15));
    }

    proptest! {
        #[test]
        fn they_sum_to_one_reproduce_lines_and_join(x in 0.0..1.0_f64) {
            let bumps = values(x);
            prop_assert!((bumps.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            // Bump i is centred at i - 1.5: coefficients there give back the line.
            let line: f64 = bumps.iter().enumerate().map(|(i, v)| v * (i as f64 - 1.5)).sum();
            prop_assert!((line - x).abs() < 1e-14);
            let mirrored = values(1.0 - x);
            for i in 0..BUMPS {
                prop_assert!((bumps[i] - mirrored[BUMPS - 1 - i]).abs() < 1e-14);
            }
            // The third derivative is continuous: the jump of a difference over the knot falls as the fourth power.
            let step = 1e-2;
            let ahead = values(step);
            let behind = values(1.0 - step);
            for i in 1..BUMPS {
                let fourth = ahead[i - 1] - 2.0 * values(0.0)[i - 1] + behind[i];
                let second = if i == 1 || i == 4 { 0.5 } else { -0.5 };
                prop_assert!((fourth - second * step * step).abs() < 2.0 * step.powi(4) + 1e-15);
            }
        }
    }
}
