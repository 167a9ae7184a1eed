//! Units: text such as `N s/m` or `kg m^2/s` as a product of symbols, with its SI dimensions and factor.
//!
//! Inside ltp everything is coherent SI with radians; other units (`deg`, `mm`, `Hz`) live at the rim, in recordings
//! and outputs. A [`Unit`] keeps the symbols as written, so that derived units read as an engineer would write them.

use crate::error::{Error, Result, nearest};

/// Exponents of m, kg, s, A, K.
pub type Dimensions = [f64; 5];

/// Dimensionless.
pub const DIMENSIONLESS: Dimensions = [0.0; 5];

/// Symbol, factor to SI, dimensions. Angles are dimensionless, as in SI.
const SYMBOLS: [(&str, f64, Dimensions); 25] = [
    ("m", 1.0, [1.0, 0.0, 0.0, 0.0, 0.0]),
    ("kg", 1.0, [0.0, 1.0, 0.0, 0.0, 0.0]),
    ("s", 1.0, [0.0, 0.0, 1.0, 0.0, 0.0]),
    ("A", 1.0, [0.0, 0.0, 0.0, 1.0, 0.0]),
    ("K", 1.0, [0.0, 0.0, 0.0, 0.0, 1.0]),
    ("rad", 1.0, DIMENSIONLESS),
    ("N", 1.0, [1.0, 1.0, -2.0, 0.0, 0.0]),
    ("J", 1.0, [2.0, 1.0, -2.0, 0.0, 0.0]),
    ("W", 1.0, [2.0, 1.0, -3.0, 0.0, 0.0]),
    ("V", 1.0, [2.0, 1.0, -3.0, -1.0, 0.0]),
    ("ohm", 1.0, [2.0, 1.0, -3.0, -2.0, 0.0]),
    ("H", 1.0, [2.0, 1.0, -2.0, -2.0, 0.0]),
    ("Wb", 1.0, [2.0, 1.0, -2.0, -1.0, 0.0]),
    ("Pa", 1.0, [-1.0, 1.0, -2.0, 0.0, 0.0]),
    ("deg", std::f64::consts::PI / 180.0, DIMENSIONLESS),
    ("rev", 2.0 * std::f64::consts::PI, DIMENSIONLESS),
    ("rpm", std::f64::consts::PI / 30.0, [0.0, 0.0, -1.0, 0.0, 0.0]),
    ("Hz", 2.0 * std::f64::consts::PI, [0.0, 0.0, -1.0, 0.0, 0.0]),
    ("mm", 1e-3, [1.0, 0.0, 0.0, 0.0, 0.0]),
    ("cm", 1e-2, [1.0, 0.0, 0.0, 0.0, 0.0]),
    ("um", 1e-6, [1.0, 0.0, 0.0, 0.0, 0.0]),
    ("ms", 1e-3, [0.0, 0.0, 1.0, 0.0, 0.0]),
    ("us", 1e-6, [0.0, 0.0, 1.0, 0.0, 0.0]),
    ("g", 1e-3, [0.0, 1.0, 0.0, 0.0, 0.0]),
    ("%", 1e-2, DIMENSIONLESS),
];

/// A unit as written.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Unit {
    parts: Vec<(&'static str, f64)>,
}

impl Unit {
    /// The unit of a pure number.
    pub fn one() -> Self {
        Self::default()
    }

    /// Reads `N s/m`, `kg*m^2`, `1/s`, `m/s^2`, `1`. Everything after a slash up to the next space-free slash divides one
    /// symbol; a bracket divides all it holds: `N/(m/s)`.
    ///
    /// # Errors
    /// [`Error::Unit`] naming the symbol that is not known, with the nearest ones.
    pub fn parse(text: &str, path: &str) -> Result<Self> {
        let mut unit = Self::one();
        let mut sign = 1.0;
        let mut stack = Vec::new();
        let mut rest = text.trim();
        let fault = |message: String| Error::Unit { path: path.to_string(), message };
        while let Some(c) = rest.chars().next() {
            match c {
                ' ' | '*' | '·' => rest = &rest[c.len_utf8()..],
                '/' => {
                    sign = -sign;
                    rest = &rest[1..];
                    continue;
                }
                '(' => {
                    stack.push(sign);
                    rest = &rest[1..];
                    continue;
                }
                ')' => {
                    let opened =
                        stack.pop().ok_or_else(|| fault(format!("unit `{text}`: a bracket closes nothing")))?;
                    sign = outer(opened, &stack);
                    rest = &rest[1..];
                }
                '1' => rest = &rest[1..],
                _ => {
                    let end = rest.find(|c: char| !(c.is_alphabetic() || c == '%')).unwrap_or(rest.len());
                    if end == 0 {
                        return Err(fault(format!("unit `{text}`: `{c}` is not a unit symbol")));
                    }
                    let name = match &rest[..end] {
                        "Ω" => "ohm",
                        "µm" => "um",
                        "µs" => "us",
                        other => other,
                    };
                    let Some((symbol, ..)) = SYMBOLS.iter().find(|(s, ..)| *s == name) else {
                        let near = nearest(name, SYMBOLS.iter().map(|(s, ..)| *s));
                        let hint = super::parse::suggestion(&near);
                        return Err(fault(format!("unit `{text}`: `{name}` is not a known unit{hint}")));
                    };
                    rest = &rest[end..];
                    let mut exponent = 1.0;
                    if let Some(after) = rest.strip_prefix('^') {
                        let end =
                            after.find(|c: char| !(c.is_ascii_digit() || "-.".contains(c))).unwrap_or(after.len());
                        exponent = after[..end].parse().map_err(|_| {
                            fault(format!("unit `{text}`: the power after `{symbol}^` is not a number"))
                        })?;
                        rest = &after[end..];
                    }
                    unit.multiply_symbol(symbol, sign * exponent);
                }
            }
            if rest.starts_with([' ', '*', '·']) || rest.is_empty() || rest.starts_with('/') {
                sign = outer(1.0, &stack); // a slash divides one symbol only
            }
        }
        if stack.is_empty() { Ok(unit) } else { Err(fault(format!("unit `{text}`: a bracket is not closed"))) }
    }

    fn multiply_symbol(&mut self, symbol: &'static str, exponent: f64) {
        if let Some(p) = self.parts.iter_mut().find(|(s, _)| *s == symbol) {
            p.1 += exponent;
        } else {
            self.parts.push((symbol, exponent));
        }
        self.parts.retain(|(_, e)| *e != 0.0);
    }

    /// `self * other^power`.
    pub fn times(&self, other: &Unit, power: f64) -> Unit {
        let mut result = self.clone();
        for (s, e) in &other.parts {
            result.multiply_symbol(s, e * power);
        }
        result
    }

    /// SI dimensions.
    pub fn dimensions(&self) -> Dimensions {
        let mut d = DIMENSIONLESS;
        for (symbol, exponent) in &self.parts {
            if let Some((_, _, dims)) = SYMBOLS.iter().find(|(s, ..)| s == symbol) {
                for (a, b) in d.iter_mut().zip(dims) {
                    *a += exponent * b;
                }
            }
        }
        d
    }

    /// Multiply a value in this unit by the factor to have it in coherent SI with radians.
    pub fn factor(&self) -> f64 {
        self.parts
            .iter()
            .filter_map(|(symbol, e)| SYMBOLS.iter().find(|(s, ..)| s == symbol).map(|(_, f, _)| f.powf(*e)))
            .product()
    }

    /// The coherent SI unit of given dimensions, in the words of mechanics.
    pub fn of_dimensions(d: &Dimensions) -> Unit {
        let mut unit = Unit::one();
        for (symbol, e) in ["m", "kg", "s", "A", "K"].into_iter().zip(d) {
            if *e != 0.0 {
                unit.multiply_symbol(symbol, *e);
            }
        }
        unit
    }
}

/// Sign outside all open brackets times a sign of its own.
fn outer(own: f64, stack: &[f64]) -> f64 {
    if stack.is_empty() { own.signum() } else { stack.iter().product::<f64>() * own.signum() }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let one = |(s, e): &(&str, f64)| if e.abs() == 1.0 { (*s).to_string() } else { format!("{s}^{}", e.abs()) };
        let join = |positive: bool| -> Vec<String> {
            self.parts.iter().filter(|(_, e)| (*e > 0.0) == positive).map(one).collect()
        };
        let (over, under) = (join(true), join(false));
        let head = if over.is_empty() { "1".to_string() } else { over.join(" ") };
        match under.len() {
            0 => write!(f, "{head}"),
            1 => write!(f, "{head}/{}", under[0]),
            _ => write!(f, "{head}/({})", under.join(" ")),
        }
    }
}

/// Factor by which a value in the unit `found` becomes a value in the unit `wanted`.
///
/// # Errors
/// [`Error::Unit`] when a unit is unknown or the dimensions clash.
pub fn conversion(found: &str, wanted: &str, path: &str) -> Result<f64> {
    let (a, b) = (Unit::parse(found, path)?, Unit::parse(wanted, path)?);
    if !same(&a.dimensions(), &b.dimensions()) {
        let message = format!("`{found}` cannot be converted to `{wanted}`: they measure different things");
        return Err(Error::Unit { path: path.to_string(), message });
    }
    Ok(a.factor() / b.factor())
}

/// Whether two dimensions agree.
pub fn same(a: &Dimensions, b: &Dimensions) -> bool {
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dims(t: &str) -> Dimensions {
        Unit::parse(t, "p").unwrap().dimensions()
    }

    #[test]
    fn reads_what_engineers_write() {
        assert_eq!(dims("N"), dims("kg m/s^2"));
        assert_eq!(dims("N s/m"), dims("N/(m/s)"));
        assert_eq!(dims("N m s/rad"), dims("N m s"));
        assert_eq!(dims("1/s"), dims("rad/s"));
        assert_eq!(dims("kg m^2"), dims("N m/(rad/s^2)"));
        assert_eq!(dims("1"), DIMENSIONLESS);
        assert!(Unit::parse("Nm", "p").is_err());
    }

    #[test]
    fn derived_units_read_well() {
        let (n, v) = (Unit::parse("N", "p").unwrap(), Unit::parse("m/s", "p").unwrap());
        assert_eq!(n.times(&v, -1.0).to_string(), "N s/m");
        assert_eq!(n.times(&v, -2.0).to_string(), "N s^2/m^2");
    }

    #[test]
    fn conversions() {
        assert!((conversion("deg", "rad", "p").unwrap() - 0.017_453_292_519_943_295).abs() < 1e-17);
        assert!((conversion("mm", "m", "p").unwrap() - 1e-3).abs() < 1e-18);
        assert!(conversion("V", "m", "p").is_err());
    }
}
