//! What the witnesses add up to, in words that name the reason.

use std::fmt;

use super::certify::Certificate;
use super::exponents::slowest;
use super::orbit::Orbit;
use crate::model::Model;

/// Defect of a reference beyond which it is no orbit.
const DEFECT: f64 = 1e-3;
/// Relative difference of two decay rates that is worth a word.
const DIFFERENT: f64 = 0.1;
/// Growth of a deviation before it decays that is worth a word.
const GROWTH: f64 = 3.0;

/// Whether a closed loop is stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Every witness says so.
    Stable,
    /// Neither the exponents along the reference nor the orbit of the loop are stable.
    Unstable,
    /// They contradict each other; the reasons say why.
    Disagree,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stable => "stable",
            Self::Unstable => "unstable",
            Self::Disagree => "disagree",
        })
    }
}

impl Certificate {
    /// Fills in verdict, sentence and reasons.
    pub(super) fn judge(&mut self, model: &Model) {
        let names = model.states();
        let along = slowest(&self.exponents);
        let around = self.orbit.as_ref().map(Orbit::slowest);
        let worst = self.spread.as_ref().and_then(|s| s.worst());
        let robust = worst.is_none_or(|case| case.slowest.is_some_and(|s| s < 0.0));
        let lifts = self.lifted.iter().all(|l| (l.all < 0.0) == (along < 0.0));
        let back = self.runs.iter().all(|run| run.returns);
        let stable = along < 0.0 && around.is_some_and(|s| s < 0.0);
        let unstable = along >= 0.0 && around.is_none_or(|s| s >= 0.0);
        self.verdict = match () {
            () if stable && lifts && back && robust => Verdict::Stable,
            () if unstable => Verdict::Unstable,
            () => Verdict::Disagree,
        };
        let mut reasons = Vec::new();
        let (row, defect) = largest(&self.defect);
        let bad = defect > DEFECT;
        if bad {
            let mut text = format!(
                "the reference is not an orbit: it leaves {:.2} % of the rate of `{}` unbalanced",
                100.0 * defect,
                names[row]
            );
            if let Some(around) = around.filter(|a| (a - along).abs() > DIFFERENT * a.abs().max(along.abs())) {
                text +=
                    &format!(", so that the loop has another orbit, with {around:.4} 1/s instead of {along:.4} 1/s");
            }
            if let Some(orbit) = &self.orbit {
                let (row, error) = largest(&orbit.error);
                text += &format!(" and a steady error of {:.2} % of the amplitude of `{}`", 100.0 * error, names[row]);
            }
            reasons.push(text);
        }
        if let Some(why) = &self.no_orbit {
            reasons.push(format!("no orbit of the closed loop was found near the reference: {why}"));
        }
        for lifted in &self.lifted {
            if (lifted.all < 0.0) != (along < 0.0) || (lifted.all - along).abs() > DIFFERENT * along.abs() {
                reasons.push(format!(
                    "truncation: the lift at N = {} says {:.4} 1/s over all its eigenvalues, whose edge is cut, {:.4} 1/s over \
                     the central ones; exact is {along:.4} 1/s",
                    lifted.truncation, lifted.all, lifted.central
                ));
            }
        }
        for (k, run) in self.runs.iter().enumerate() {
            let which = if self.runs.len() > 1 { format!("deviation {k}") } else { "the deviation".to_owned() };
            if let Some(ended) = &run.ended {
                reasons.push(format!("basin: from {which} the motion ends: {ended}"));
            } else if !run.returns {
                let share = self.tolerated.get(k).filter(|t| t.multiple > 0.0);
                let share = share.map_or(String::new(), |t| format!("; {:.3} of it comes back", t.multiple));
                reasons.push(format!("basin: {which} does not come back to the orbit within {} s{share}", run.horizon));
            }
            if run.growth > GROWTH {
                reasons.push(format!(
                    "transient growth: {which} grows to {:.1} times its size (in amplitudes) before it decays",
                    run.growth
                ));
            }
        }
        if !robust {
            let case = worst.map(|case| {
                let number = |k: usize| self.spread.as_ref().map_or(0, |s| s.parameters[k].0);
                let change =
                    |(k, c): (usize, &f64)| format!("{} {:+.1} %", model.parameters()[number(k)].name, 100.0 * c);
                let changes: Vec<String> = case.changes.iter().enumerate().map(change).collect();
                let rate = case.slowest.map_or("no orbit is found".to_owned(), |s| format!("{s:+.4} 1/s"));
                format!("not robust: with {} {rate}", changes.join(", "))
            });
            reasons.extend(case);
        }
        let around = around.map_or("none was found".to_owned(), |s| format!("{s:.4} 1/s"));
        let slow =
            format!("largest real part {along:.4} 1/s along the reference, {around} around the orbit of the loop");
        self.sentence = match self.verdict {
            Verdict::Stable => format!("stable: {slow}"),
            Verdict::Unstable => format!("unstable: {slow}"),
            Verdict::Disagree => format!("the witnesses disagree: {slow}"),
        };
        if !reasons.is_empty() {
            self.sentence += &format!("; {}", reasons.join("; "));
        }
        self.reasons = reasons;
    }
}

fn largest(values: &[f64]) -> (usize, f64) {
    let at = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    (at, values.get(at).copied().unwrap_or(0.0))
}
