//! The noun `Error`: everything the caller's input can have wrong, and the one way a method can fail outright.
//!
//! Each variant carries the numbers and names its message prints, so that Python and the command line can show them
//! without parsing text. A computation that ended early but left something valid is a result with a stop reason,
//! never an error. Rows are counted from 0, the first sample.

use thiserror::Error;

/// Result of every fallible function of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong, with the numbers and names that show it, and what to do next.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// Two sizes that must agree do not.
    #[error("{what}: found {found} values, expected {expected}; make the lengths agree")]
    Shape {
        /// The array or column, and the recording it belongs to.
        what: String,
        /// The length that would have been right.
        expected: usize,
        /// The length found.
        found: usize,
    },
    /// A value that must be finite is not.
    #[error(
        "{what}: row {row} (the first is 0), column `{column}`: found {value}, expected a finite number; \
         repair the value or remove the row (a missing output sample may be NaN and is kept as a gap)"
    )]
    NotFinite {
        /// The recording or array.
        what: String,
        /// Row of the value, counted from 0.
        row: usize,
        /// Column of the value.
        column: String,
        /// NaN or an infinity.
        value: f64,
    },
    /// Time stands still or runs back.
    #[error(
        "recording `{recording}`: time must increase strictly, but row {row} (the first is 0) has t = {found} s after \
         {previous} s; sort the rows, remove repeated ones, or split the file where the clock was restarted"
    )]
    TimeNotIncreasing {
        /// Name of the recording.
        recording: String,
        /// Row of the later sample, counted from 0.
        row: usize,
        /// Time of the row before, s.
        previous: f64,
        /// Time of this row, s.
        found: f64,
    },
    /// A pause so long that a uniform time grid through it would be almost empty.
    #[error(
        "recording `{recording}`: between rows {} and {row} (the first is 0) time jumps from {previous} s to \
         {found} s, while samples are {dt} s apart; split the recording there and give its parts separately",
        .row - 1
    )]
    LongPause {
        /// Name of the recording.
        recording: String,
        /// Row after the pause, counted from 0.
        row: usize,
        /// Time before the pause, s.
        previous: f64,
        /// Time after the pause, s.
        found: f64,
        /// Sampling step elsewhere, s.
        dt: f64,
    },
    /// Fewer samples than the method needs.
    #[error("{what}: found {found} samples, at least {needed} are needed; record longer or choose a wider interval")]
    TooShort {
        /// The recording, or the part of it.
        what: String,
        /// Smallest number that works.
        needed: usize,
        /// Number found.
        found: usize,
    },
    /// A name that does not exist.
    #[error("{context}: there is no {kind} `{name}`; {}", suggestion(.nearest))]
    UnknownName {
        /// What was looked for: parameter, state, column, effect.
        kind: String,
        /// The name as given.
        name: String,
        /// The nearest names that exist, best first.
        nearest: Vec<String>,
        /// Where the name stands.
        context: String,
    },
    /// A name given twice.
    #[error("{context}: the {kind} `{name}` appears twice; rename one of the two")]
    DuplicateName {
        /// What carries the name.
        kind: String,
        /// The name.
        name: String,
        /// Where it appears.
        context: String,
    },
    /// A number outside the range in which it means something.
    #[error("{what} = {found}: expected {expected}")]
    OutOfRange {
        /// The option, parameter or field.
        what: String,
        /// The value found.
        found: f64,
        /// The range in words, with its unit, and what to do.
        expected: String,
    },
    /// The caller asked long work to stop.
    #[error("interrupted before the work was done; nothing was written")]
    Interrupted,
    /// A formula of a model document that cannot be read.
    #[error(
        "{path}, line {line}, column {column}: {message}\n    {source_line}\n    {}^",
        caret(.source_line, *.column)
    )]
    Expression {
        /// Place in the document, such as `flow.v`.
        path: String,
        /// Line inside the formula, counted from 1.
        line: usize,
        /// Column inside the line, counted from 1, in characters.
        column: usize,
        /// What is wrong and what to do.
        message: String,
        /// The line, shown above the caret.
        source_line: String,
    },
    /// A model document whose form is wrong.
    #[error("{path}: {message}")]
    Document {
        /// Place in the document, or its file.
        path: String,
        /// What is wrong and what to do.
        message: String,
    },
    /// Units that cannot be read or do not fit each other.
    #[error("{path}: {message}")]
    Unit {
        /// Place in the document or option.
        path: String,
        /// Units found and expected, and what to do.
        message: String,
    },
    /// A document that reads well but describes no consistent model.
    #[error("{path}: {message}")]
    Model {
        /// Place in the document.
        path: String,
        /// What is inconsistent and what to do.
        message: String,
    },
    /// Recordings that read well but cannot answer the question: nothing moves, the sensor is at its end, the unit is wrong.
    #[error("{what}: {message}")]
    Data {
        /// The recording, or the output or input of it.
        what: String,
        /// What is wrong or missing, with numbers, and what to do.
        message: String,
    },
    /// A method that could not reach its goal and has nothing partial to show.
    #[error("{method} did not converge in {iterations} iterations (residual {residual:.3e}); {advice}")]
    NoConvergence {
        /// The method.
        method: String,
        /// Iterations spent.
        iterations: usize,
        /// What was left, in the method's own measure.
        residual: f64,
        /// What to try.
        advice: String,
    },
}

impl Error {
    /// True when the caller's input cannot be right, false when a method failed on input that may be, or was
    /// interrupted.
    ///
    /// Python raises `ltp.InputError` for the first and `ltp.ConvergenceError` for the second.
    pub fn is_input(&self) -> bool {
        !matches!(self, Error::NoConvergence { .. } | Error::Interrupted)
    }
}

/// Up to three of `candidates` that `name` may have been meant to be, best first.
///
/// The measure is the edit distance (insert, delete, replace: one each) without regard to case; a candidate is near
/// when at most a third of the longer word, and at least two letters, had to change. A candidate that contains the
/// name (or is contained in it) counts as near as well.
pub fn nearest<'a, S: AsRef<str> + ?Sized + 'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a S>,
) -> Vec<String> {
    let wanted = name.to_lowercase();
    let mut ranked: Vec<(usize, &str)> = candidates
        .into_iter()
        .filter_map(|candidate| {
            let candidate = candidate.as_ref();
            let lower = candidate.to_lowercase();
            let distance = edit_distance(&wanted, &lower);
            let longer = wanted.chars().count().max(lower.chars().count());
            let inside = wanted.len() > 1 && lower.len() > 1 && (lower.contains(&wanted) || wanted.contains(&lower));
            (inside || distance <= (longer / 3).max(2).min(longer.saturating_sub(1))).then_some((distance, candidate))
        })
        .collect();
    ranked.sort_by(|a, b| a.0.cmp(&b.0).then_with(|| a.1.cmp(b.1)));
    ranked.dedup();
    ranked.into_iter().take(3).map(|(_, candidate)| candidate.to_owned()).collect()
}

/// Levenshtein's distance by the usual two-row recursion.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut previous: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut current = vec![i + 1];
        for (j, &to) in b.iter().enumerate() {
            let replace = previous[j] + usize::from(from != to);
            current.push(replace.min(previous[j + 1] + 1).min(current[j] + 1));
        }
        previous = current;
    }
    previous[b.len()]
}

/// The last half of an unknown-name message.
fn suggestion(nearest: &[String]) -> String {
    match nearest {
        [] => "nothing that exists is spelled like it".to_owned(),
        names => format!("did you mean {}?", names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(" or ")),
    }
}

/// White space that puts a caret under `column` (from 1); tabs of the line are kept so that the two align.
fn caret(source_line: &str, column: usize) -> String {
    let filled = source_line.chars().map(|c| if c == '\t' { '\t' } else { ' ' });
    filled.chain(std::iter::repeat(' ')).take(column.saturating_sub(1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_finds_typing_errors_and_leaves_strangers_out() {
        let names = ["coulomb_friction", "viscous_friction", "constant_force", "M", "b"];
        assert_eq!(nearest("coulom_friction", names), ["coulomb_friction"]);
        assert_eq!(nearest("Coulomb", names), ["coulomb_friction"]);
        assert_eq!(nearest("m", names), ["M"]);
        assert!(nearest("backlash", names).is_empty());
    }

    #[test]
    fn edit_distance_counts_letters() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("omega_p", "omega_p"), 0);
    }

    #[test]
    fn caret_stands_under_the_column() {
        let error = Error::Expression {
            path: "flow.v".into(),
            line: 1,
            column: 5,
            message: "unexpected `)`".into(),
            source_line: "a + )".into(),
        };
        assert_eq!(error.to_string(), "flow.v, line 1, column 5: unexpected `)`\n    a + )\n        ^");
    }

    #[test]
    fn messages_carry_the_numbers() {
        let error = Error::TimeNotIncreasing { recording: "run1".into(), row: 7, previous: 0.35, found: 0.3 };
        let text = error.to_string();
        for part in ["run1", "row 7", "0.35 s", "0.3 s", "sort the rows"] {
            assert!(text.contains(part), "{text}");
        }
        assert!(error.is_input());
        let failed = Error::NoConvergence {
            method: "shooting".into(),
            iterations: 9,
            residual: 1.0,
            advice: "start closer".into(),
        };
        assert!(!failed.is_input());
    }
}
