//! Geometry of small changes: what is left of a change of the outputs when others may imitate it.

/// A column that keeps less than this share of its length beside the others adds no dimension.
const COLLINEAR: f64 = 1e-9;
/// Relative size of a direction of a rival that counts as none.
const FLAT: f64 = 1e-12;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// An orthonormal basis of the span of columns, each taken at unit length first: parameters differ by many orders of magnitude.
pub fn basis(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for column in columns {
        let length = dot(column, column).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            continue;
        }
        let mut v: Vec<f64> = column.iter().map(|c| c / length).collect();
        remove(&basis, &mut v);
        let left = dot(&v, &v).sqrt();
        if left > COLLINEAR {
            v.iter_mut().for_each(|v| *v /= left);
            basis.push(v);
        }
    }
    basis
}

/// Takes the span of an orthonormal basis out of a vector; twice, for the digits.
pub fn remove(basis: &[Vec<f64>], v: &mut [f64]) {
    for _ in 0..2 {
        for q in basis {
            let share = dot(q, v);
            v.iter_mut().zip(q).for_each(|(v, q)| *v -= share * q);
        }
    }
}

/// Square of the distance of `truth` from the span of `rival`: the deviance that telling them apart would gain.
pub fn distance(truth: &[f64], rival: &[Vec<f64>]) -> f64 {
    let longest = rival.iter().map(|r| dot(r, r)).fold(0.0, f64::max);
    let kept: Vec<Vec<f64>> = rival.iter().filter(|r| dot(r, r) > FLAT * longest).cloned().collect();
    let mut left = truth.to_vec();
    remove(&basis(&kept), &mut left);
    dot(&left, &left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_span_cannot_imitate() {
        let plane = [vec![1.0, 0.0, 0.0], vec![1e4, 1e4, 0.0], vec![2.0, 0.0, 0.0]];
        assert_eq!(basis(&plane).len(), 2);
        assert!((distance(&[3.0, -4.0, 5.0], &plane) - 25.0).abs() < 1e-9);
        assert_eq!(distance(&[3.0, 4.0], &[vec![0.0, 0.0]]), 25.0);
    }
}
