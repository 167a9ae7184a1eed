//! The greatest common divisor: what lines, harmonics and periods repeat together with.

use std::ops::Rem;

/// Greatest common divisor by Euclid's algorithm, with the sign the remainders leave; `gcd(0, b) = b`.
pub fn gcd<T: Copy + Default + PartialEq + Rem<Output = T>>(a: T, b: T) -> T {
    if b == T::default() { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::gcd;

    #[test]
    fn it_divides_both_and_nothing_larger_does() {
        for (a, b) in (0..40_usize).flat_map(|a| (0..40).map(move |b| (a, b))).filter(|&(a, b)| a + b > 0) {
            let found = gcd(a, b);
            assert!(a % found == 0 && b % found == 0, "{a}, {b}");
            assert!((found + 1..=a.max(b)).all(|d| a % d != 0 || b % d != 0), "{a}, {b}");
        }
        assert_eq!(gcd(12_i64, -8).abs(), 4);
    }
}
