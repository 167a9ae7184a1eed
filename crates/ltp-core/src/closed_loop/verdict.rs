//! What the witnesses add up to, in words that name the reason.

use std::fmt;

use super::certify::Certificate;
use super::orbit::{Orbit, slowest};
use crate::model::Model;

/// Defect of a reference beyond which it is no orbit.
const DEFECT: f64 = 1e-3;
/// Relative difference of two decay rates that is worth a word.
const DIFFERENT: f64 = 0.1;
/// Growth of a deviation before it decays that is worth a word: it doubles.
const GROWTH: f64 = 2.0;
/// Real parts within this share of the pumping frequency of zero are zero.
const NEUTRAL: f64 = 1e-8;

/// Whether a closed loop is stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Every witness says so.
    Stable,
    /// Neither decays nor grows: an exponent is zero both along the reference and around the orbit of the loop, and none is
    /// positive, as without feedback on the place of a cart.
    Neutral,
    /// Exponents are positive both along the reference and around the orbit of the loop (or there is no such orbit).
    Unstable,
    /// They contradict each other; the reasons say why.
    Disagree,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stable => "stable",
            Self::Neutral => "neutral",
            Self::Unstable => "unstable",
            Self::Disagree => "disagree",
        })
    }
}

impl Certificate {
    /// Fills in verdict, sentence and reasons; `pumping` is the pumping frequency, rad/s.
    pub(super) fn judge(&mut self, model: &Model, pumping: f64) {
        let sign = |rate: f64| if rate.abs() <= NEUTRAL * pumping { 0.0 } else { rate.signum() };
        let along = slowest(&self.exponents);
        let around = self.orbit.as_ref().map(Orbit::slowest);
        let worst = self.spread.as_ref().and_then(|s| s.worst());
        let robust = worst.is_none_or(|case| case.slowest.is_some_and(|s| sign(s) < 0.0));
        let lifts = self.lifted.iter().all(|l| sign(l.all) == sign(along));
        let back = self.runs.iter().all(|run| run.returns);
        self.verdict = match (sign(along), around.map(sign)) {
            (s, Some(o)) if s < 0.0 && o < 0.0 && lifts && back && robust => Verdict::Stable,
            (s, o) if s > 0.0 && o.is_none_or(|o| o > 0.0) => Verdict::Unstable,
            (0.0, Some(0.0)) => Verdict::Neutral,
            _ => Verdict::Disagree,
        };
        let mut reasons = Vec::new();
        reasons.extend(self.of_reference(model, along, around));
        if let Some(why) = &self.no_orbit {
            reasons.push(format!("no orbit of the closed loop was found near the reference: {why}"));
        }
        reasons.extend(self.of_truncation(along, NEUTRAL * pumping));
        for (k, run) in self.runs.iter().enumerate() {
            let which = if self.runs.len() > 1 { format!("deviation {k}") } else { "the deviation".to_owned() };
            if let Some(ended) = &run.ended {
                reasons.push(format!("basin: from {which} the motion ends: {ended}"));
            } else if !run.returns {
                let share = self.tolerated.get(k).filter(|t| t.multiple > 0.0);
                let share = share.map_or(String::new(), |t| format!("; {:.3} of it comes back", t.multiple));
                reasons.push(format!("basin: {which} does not come back to the orbit within {} s{share}", run.horizon));
            } else if run.growth > GROWTH {
                reasons.push(format!(
                    "transient growth: {which} grows to {:.1} times its size (in amplitudes) before it decays",
                    run.growth
                ));
            }
        }
        if !robust {
            reasons.extend(self.of_parameters(model));
        }
        let around = around.map_or("none was found".to_owned(), |s| format!("{s:.4} 1/s"));
        let slow =
            format!("largest real part {along:.4} 1/s along the reference, {around} around the orbit of the loop");
        self.sentence = match self.verdict {
            Verdict::Disagree => format!("the witnesses disagree: {slow}"),
            agreed => format!("{agreed}: {slow}"),
        };
        if !reasons.is_empty() {
            self.sentence += &format!("; {}", reasons.join("; "));
        }
        self.reasons = reasons;
    }

    /// What the reference lacks of an orbit, and what that does to the loop.
    fn of_reference(&self, model: &Model, along: f64, around: Option<f64>) -> Option<String> {
        let names = model.states();
        let (row, defect) = largest(&self.defect);
        if defect <= DEFECT {
            return None;
        }
        let unbalanced = 100.0 * defect;
        let name = &names[row];
        let mut text =
            format!("the reference is not an orbit: it leaves {unbalanced:.2} % of the rate of `{name}` unbalanced");
        if let Some(around) = around.filter(|a| (a - along).abs() > DIFFERENT * a.abs().max(along.abs())) {
            text += &format!(", so that the loop has another orbit, with {around:.4} 1/s instead of {along:.4} 1/s");
        }
        if let Some(orbit) = &self.orbit {
            let (row, error) = largest(&orbit.error);
            text += &format!(" and a steady error of {:.2} % of the amplitude of `{}`", 100.0 * error, names[row]);
        }
        Some(text)
    }

    /// Lifts whose edge says something else than the exact exponents.
    fn of_truncation(&self, along: f64, neutral: f64) -> Option<String> {
        let off = |rate: f64| (rate - along).abs() > (DIFFERENT * along.abs()).max(neutral);
        let text = self.lifted.iter().filter(|l| off(l.all)).map(|l| {
            format!("N = {}: {:.4} 1/s over all, {:.4} over the central ones", l.truncation, l.all, l.central)
        });
        let text: Vec<String> = text.collect();
        let what = "truncation: eigenvalues at the cut edge of the lift do not converge";
        (!text.is_empty()).then(|| format!("{what} ({}); exact is {along:.4} 1/s", text.join("; ")))
    }

    /// The worst of the other parameters.
    fn of_parameters(&self, model: &Model) -> Option<String> {
        let spread = self.spread.as_ref()?;
        let case = spread.worst()?;
        let change = |((number, _), c): (&(usize, f64), &f64)| {
            format!("{} {:+.1} %", model.parameters()[*number].name, 100.0 * c)
        };
        let changes: Vec<String> = spread.parameters.iter().zip(&case.changes).map(change).collect();
        let rate =
            case.slowest.map_or("no orbit is found".to_owned(), |s| format!("the largest real part is {s:+.4} 1/s"));
        Some(format!("not robust: with {} {rate}", changes.join(", ")))
    }
}

fn largest(values: &[f64]) -> (usize, f64) {
    let at = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    (at, values.get(at).copied().unwrap_or(0.0))
}
