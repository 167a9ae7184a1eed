//! What was found in words: numbers with the digits they deserve, units with their prefixes, the verdict as a sentence.

use super::dependence::CONSTANT;
use super::result::{Diagnosis, Estimate, FitReport, Location, NamedEffect, Verdict};

/// Three significant digits, without a tail of zeros.
pub fn number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let digits = 3 - 1 - v.abs().log10().floor() as i32;
    if (-3..=6).contains(&digits) {
        let text = format!("{:.*}", digits.max(0) as usize, v);
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
    } else {
        format!("{v:.2e}")
    }
}

/// Units that take a prefix when their number is small.
const PREFIXED: [&str; 6] = ["m", "s", "N", "V", "A", "rad"];

/// A number with its unit, small ones with a prefix: `6.86 µm`.
pub fn quantity(v: f64, unit: &str) -> String {
    match unit {
        "1" => number(v),
        _ if PREFIXED.contains(&unit) && v != 0.0 && v.abs() < 0.1 => {
            let steps = [(1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p")];
            let (size, prefix) = steps.into_iter().find(|(size, _)| v.abs() >= *size).unwrap_or((1e-12, "p"));
            format!("{} {prefix}{unit}", number(v / size))
        }
        _ => format!("{} {unit}", number(v)),
    }
}

/// A value with its standard deviation: the latter to two digits, the former as far.
fn value(e: &Estimate) -> String {
    let unit = if e.unit == "1" { String::new() } else { format!(" {}", e.unit) };
    let Some(sd) = e.sd.filter(|sd| *sd > 0.0) else { return quantity(e.value, &e.unit) };
    let power = e.value.abs().max(sd).log10().floor() as i32;
    let scale = if (-3..6).contains(&power) { 0 } else { power };
    let (v, sd) = (e.value / 10f64.powi(scale), sd / 10f64.powi(scale));
    let digits = (1 - sd.log10().floor() as i32).clamp(0, 12) as usize;
    if scale == 0 {
        format!("{v:.digits$} ± {sd:.digits$}{unit}")
    } else {
        format!("({v:.digits$} ± {sd:.digits$})e{scale}{unit}")
    }
}

/// Remaining error, in noise floors, above which a reader must be told.
pub const DOUBTFUL: f64 = 1.5;

/// The largest remaining error in noise floors, over all train records.
pub fn remaining(fit: &FitReport) -> f64 {
    fit.train.iter().filter_map(|r| Some(r.after? / r.floor.max(f64::MIN_POSITIVE))).fold(0.0, f64::max)
}

fn parameters(e: &NamedEffect) -> String {
    e.parameters.iter().map(|(n, v)| format!("{n} = {}", value(v))).collect::<Vec<_>>().join(", ")
}

/// A variable as part of a sentence.
fn dependence(variable: &str) -> String {
    let article = ["sign", "mode", "phase", "rate", "time since"].iter().any(|w| variable.starts_with(w));
    if article { format!("the {variable}") } else { variable.to_string() }
}

/// Where something acts, in one sentence.
pub fn place(l: &Location, ports: &[&str]) -> String {
    let what = match l.kind.as_str() {
        "input" => "at the input",
        "output" => "at the sensor",
        "contact" => "at the contact",
        "parameter" => "in the parameter",
        _ => "at",
    };
    let mut text = format!("{what} `{}`", l.at);
    let on = match l.variable.as_str() {
        "" => String::new(),
        "sign of velocity" => ", where the velocity changes sign".into(),
        CONSTANT => ", constant".into(),
        v if v.starts_with("nothing") => String::new(),
        "mode" => ", different from mode to mode".into(),
        v => format!(", following {}", dependence(v)),
    };
    if l.p_value <= 0.05 {
        text.push_str(&on);
    }
    if let Some(step) = &l.repeats {
        text.push_str(&format!(", repeating every {}", quantity(step.value, &step.unit)));
    }
    if let Some(mode) = &l.mode {
        text.push_str(&format!(", in {mode}"));
    }
    if !l.phases.is_empty() {
        let list: Vec<String> = l.phases.iter().map(|p| format!("{p:.2}")).collect();
        text.push_str(&format!(", in every cycle at phase {}", list.join(" and ")));
    }
    let others: Vec<String> =
        ports.iter().filter(|p| l.kind != "port" || **p != l.at).map(|p| format!("`{p}`")).collect();
    if matches!(l.kind.as_str(), "port" | "output" | "input") && l.margin > 0.0 && !others.is_empty() {
        text.push_str(&format!("; a force at {} would explain less", others.join(" or ")));
    }
    text
}

/// The verdict in one sentence with numbers and units.
pub fn sentence(d: &Diagnosis, moved: &[(String, f64)]) -> String {
    let place = d.location.iter().find(|l| l.p_value <= 0.05).map_or(String::new(), |l| {
        let what = match l.kind.as_str() {
            "output" => format!("what the sensor `{}` is off by", l.at),
            "input" => format!("what is added to the input `{}`", l.at),
            _ => format!("the missing force acts at `{}` and", l.at),
        };
        format!("; {what} depends on {} (p = {})", dependence(&l.variable), number(l.p_value))
    });
    let named: Vec<String> =
        d.effects.iter().map(|e| format!("`{}` at `{}` ({})", e.name, e.at, parameters(e))).collect();
    let named = named.join(" and ");
    let rows = if d.fit.test.is_empty() { &d.fit.train } else { &d.fit.test };
    let which = if d.fit.test.is_empty() { "training" } else { "held-out" };
    let worst = rows
        .iter()
        .filter_map(|r| Some((r, r.rms_before?, r.rms_after?)))
        .max_by(|a, b| (a.0.before.unwrap_or(0.0)).total_cmp(&b.0.before.unwrap_or(0.0)));
    let errors = worst.map_or(String::new(), |(r, before, after)| {
        let floor = if r.before.unwrap_or(0.0) > 0.0 { before * r.floor / r.before.unwrap_or(1.0) } else { 0.0 };
        let [b, a, f] = [before, after, floor].map(|v| quantity(v, &r.unit));
        if before == after {
            format!("; {which} error of {} is {b} (noise {f})", r.output)
        } else {
            format!("; {which} error of {} falls from {b} to {a} (noise {f})", r.output)
        }
    });
    let beside = d.law.as_ref().filter(|_| !d.effects.is_empty()).map_or(String::new(), |l| {
        format!(
            "; what it leaves is unknown to the library and follows {} at `{}`, by the law in `law`",
            l.variable, l.at
        )
    });
    match d.verdict {
        Verdict::Consistent if remaining(&d.fit) > DOUBTFUL => {
            format!(
                "No physics of the library is missing as far as these recordings can tell{errors}; what is left above \
                     the noise stays unexplained."
            )
        }
        Verdict::Consistent => format!("The model explains the recordings: nothing needs to be added{errors}."),
        Verdict::Parameter if !d.effects.is_empty() => {
            format!("The structure is right, but a parameter that was stated as exact is off: {named}{errors}.")
        }
        Verdict::Parameter => {
            let list: Vec<String> = moved
                .iter()
                .filter_map(|(n, s)| {
                    let p = d.parameters.get(n)?;
                    let fitted = Estimate { value: p.after, sd: Some(p.sd), unit: p.unit.clone() };
                    let stated = quantity(p.nominal, &p.unit);
                    Some(format!("`{n}` is {}, not {stated} ({} stated sd away)", value(&fitted), number(*s)))
                })
                .collect();
            format!("The structure is right, but {}{errors}.", list.join(" and "))
        }
        Verdict::Effect => match d.effects.as_slice() {
            [e] => format!("`{}` at `{}` was left out: {}{place}{beside}{errors}.", e.name, e.at, parameters(e)),
            _ => format!("{named} were left out{place}{beside}{errors}."),
        },
        Verdict::Ambiguous => {
            let others = d.ambiguous_with.iter().map(|o| format!("`{o}`")).collect::<Vec<_>>().join(", ");
            format!(
                "Something was left out; {named} fits best, but these recordings cannot tell it from {others}{beside}{errors}."
            )
        }
        Verdict::Unknown => {
            format!("Physics was left out that no effect of the library explains{place}{errors}.")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_carry_the_digits_they_deserve() {
        let e = |value: f64, sd: f64, unit: &str| super::value(&Estimate { value, sd: Some(sd), unit: unit.into() });
        assert_eq!(e(20.045, 0.2297, "N"), "20.05 ± 0.23 N");
        assert_eq!(e(0.005_355_6, 3.1e-5, "N m"), "0.005356 ± 0.000031 N m");
        assert_eq!(e(1.4907e-6, 2.2e-8, "N"), "(1.491 ± 0.022)e-6 N");
        assert_eq!(quantity(6.857_8e-6, "m"), "6.86 µm");
        assert_eq!(quantity(12.0, "1"), "12");
    }
}
