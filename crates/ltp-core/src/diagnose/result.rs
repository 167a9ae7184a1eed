//! The noun `Diagnosis`: what was found, with the numbers that show it. Its serialised form is the public JSON.

use indexmap::IndexMap;
use serde::Serialize;

use super::harmonic::{EventTime, HarmonicMap};

/// What ltp says about a mismatch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The model explains the recordings.
    Consistent,
    /// The structure is right; a nominal parameter is off by more than its stated uncertainty allows.
    Parameter,
    /// Physics was left out, and it has a name.
    Effect,
    /// Physics was left out; the recordings cannot tell some names apart.
    Ambiguous,
    /// Physics was left out that the library does not hold.
    Unknown,
}

/// A number with its standard deviation and unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard deviation; coloured residuals are accounted for.
    pub sd: Option<f64>,
    /// Unit.
    pub unit: String,
}

/// Physics that was left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedEffect {
    /// Name in the library.
    pub name: String,
    /// Place.
    pub at: String,
    /// Parameters.
    pub parameters: IndexMap<String, Estimate>,
    /// Share of the structural error that it removes.
    pub share: f64,
}

/// Where a mismatch acts, and on what it depends.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Location {
    /// `port`, `input`, `output`, `contact` or `parameter`.
    pub kind: String,
    /// Name of the place.
    pub at: String,
    /// Mode, where only one matters.
    pub mode: Option<String>,
    /// What the missing force, or what a sensor or an input is off by, depends on.
    pub variable: String,
    /// How far on it repeats, over position or over time, where it does; by the unit one knows which.
    pub repeats: Option<Estimate>,
    /// Phases of the cycle at which it acts; empty where there is no clock.
    pub phases: Vec<f64>,
    /// Probability that the dependence is chance, however many were tried.
    pub p_value: f64,
    /// Gain in log-likelihood over nothing missing.
    pub margin: f64,
    /// All of it in one sentence.
    pub sentence: String,
}

/// A nominal parameter that had soaked up missing physics before it was named.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Absorbed {
    /// Parameter.
    pub parameter: String,
    /// Refitted without the effect.
    pub before: f64,
    /// Refitted with it.
    pub after: f64,
    /// Their distance in standard deviations of the latter.
    pub sigmas: f64,
    /// Unit.
    pub unit: String,
    /// Why the absorbed value cannot be physics, where it cannot.
    pub forbidden: Option<String>,
}

/// A change of the experiment that would tell rivals apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Separating {
    /// What to do, with the gain it promises.
    pub sentence: String,
    /// `amplitude`, `sensor`, `slow`, `bandwidth` or `longer`.
    pub kind: String,
    /// The rivals that it tells apart.
    pub separates: Vec<String>,
    /// Predicted deviance between them; ten is decisive.
    pub gain: f64,
}

/// One candidate of the ranking: an effect added to those of `with`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Effect, or `nothing`.
    pub name: String,
    /// Place.
    pub at: String,
    /// `effect@place` of what was accepted before.
    pub with: Vec<String>,
    /// Distance to the winner in units of deviance: zero is best, ten is decisive.
    pub score: Option<f64>,
    /// Deviance of the held-out records less that of the nominal model; negative is better.
    pub held_out: Option<f64>,
    /// Whether the fit reached its goal.
    pub converged: bool,
    /// Fitted parameters.
    pub parameters: IndexMap<String, f64>,
    /// Why it is out of the race, where it is.
    pub note: Option<String>,
}

/// A nominal parameter before and after.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterReport {
    /// As stated.
    pub nominal: f64,
    /// Stated uncertainty.
    pub nominal_sd: f64,
    /// Refitted without the effect: what it absorbed.
    pub before: f64,
    /// Refitted with the effect; as before where none was named.
    pub after: f64,
    /// Standard deviation of the last value.
    pub sd: f64,
    /// How far the last value is from the stated one, in standard deviations of what the recordings can add to a true
    /// statement; above three the statement is wrong.
    pub away: f64,
    /// Unit.
    pub unit: String,
}

/// Errors of one output of one record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FitRow {
    /// Record.
    pub record: String,
    /// Output.
    pub output: String,
    /// Unit.
    pub unit: String,
    /// rms error over the output's standard deviation with parameters as stated.
    pub nominal: Option<f64>,
    /// With the nominal structure refitted.
    pub before: Option<f64>,
    /// With the effect; as before where none was named.
    pub after: Option<f64>,
    /// Noise.
    pub floor: f64,
    /// rms error before, in the output's unit.
    pub rms_before: Option<f64>,
    /// rms error after, in the output's unit.
    pub rms_after: Option<f64>,
}

/// Errors, train and held-out.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FitReport {
    /// Records that were fitted.
    pub train: Vec<FitRow>,
    /// Records that were predicted; only their initial state was fitted.
    pub test: Vec<FitRow>,
}

/// A force law over the variable it depends on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Law {
    /// Port.
    pub at: String,
    /// `velocity`, `position` or `time`.
    pub variable: String,
    /// Unit of the force.
    pub unit: String,
    /// Unit of the variable.
    pub variable_unit: String,
    /// Values of the variable.
    pub grid: Vec<f64>,
    /// Force.
    pub force: Vec<f64>,
    /// One standard deviation.
    pub sd: Vec<f64>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    /// Name of the model.
    pub model_name: String,
    /// The verdict.
    pub verdict: Verdict,
    /// The verdict in a sentence with numbers and units.
    pub sentence: String,
    /// Where, if anywhere: `null`, one place, or a list of them.
    #[serde(serialize_with = "none_one_or_many")]
    pub location: Vec<Location>,
    /// What was left out.
    pub effects: Vec<NamedEffect>,
    /// `name@port` of what the recordings cannot tell from it.
    pub ambiguous_with: Vec<String>,
    /// The whole ranking, best first.
    pub candidates: Vec<Candidate>,
    /// Nominal parameters before and after.
    pub parameters: IndexMap<String, ParameterReport>,
    /// Nominal parameters that had soaked up what was missing, the most first.
    pub absorbed: Vec<Absorbed>,
    /// Experiments that would tell the rivals of an ambiguous verdict apart, the best first.
    pub separate: Vec<Separating>,
    /// Times of events, measured minus predicted by the refitted nominal model: a touchdown 4 ms early is a residual too.
    pub events: Vec<EventTime>,
    /// Harmonic map of the refitted nominal model; `None` without a clock, and where no train record has an input that repeats on
    /// lines that tell the harmonics apart.
    pub harmonic: Option<HarmonicMap>,
    /// Mean square of the same map with what was named attached.
    pub harmonic_after: Option<f64>,
    /// Errors before and after.
    pub fit: FitReport,
    /// The augmented model as TOML.
    pub model: String,
    /// The law of what is not in the library, when the verdict is unknown.
    pub law: Option<Law>,
    /// What to keep in mind.
    pub warnings: Vec<String>,
    /// Time it took, s.
    pub seconds: f64,
    /// Series behind the pictures; not part of the JSON.
    #[serde(skip)]
    pub traces: Traces,
}

/// Series behind the pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traces {
    /// Outputs of each record.
    pub records: Vec<RecordTrace>,
    /// The missing force along the train records.
    pub force: Vec<Force>,
    /// The law of the named effect, or of the unknown one.
    pub law: Option<Law>,
}

/// Outputs of one record, measured and simulated; (n, ny), row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordTrace {
    /// Record.
    pub name: String,
    /// Whether it was held out.
    pub test: bool,
    /// Time, s.
    pub t: Vec<f64>,
    /// Outputs by name.
    pub output_names: Vec<String>,
    /// Measured.
    pub measured: Vec<f64>,
    /// With parameters as stated; empty where the run failed.
    pub nominal: Vec<f64>,
    /// Nominal structure refitted.
    pub before: Vec<f64>,
    /// With the effect; empty where none was named.
    pub after: Vec<f64>,
}

/// A missing force along one record; at an input or an output, what is added to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Force {
    /// `port`, `input` or `output`.
    pub kind: String,
    /// Record.
    pub record: String,
    /// Place.
    pub at: String,
    /// Unit of the force, or of what is added.
    pub unit: String,
    /// Unit of the position.
    pub position_unit: String,
    /// Unit of the velocity.
    pub velocity_unit: String,
    /// Time, s.
    pub t: Vec<f64>,
    /// Position of the port; the value of an input, or of an output as the model has it.
    pub position: Vec<f64>,
    /// Velocity of the port; the rate of that value.
    pub velocity: Vec<f64>,
    /// Force, or what is added.
    pub force: Vec<f64>,
    /// One standard deviation.
    pub sd: Vec<f64>,
    /// Names of the modes that were passed through, in the order of their first sample.
    pub modes: Vec<String>,
    /// Mode of each sample, as its place in `modes`.
    pub mode: Vec<usize>,
    /// Period of the clock, s.
    pub period: Option<f64>,
    /// Phase of the clock in [0, 1); empty where there is no clock.
    pub phase: Vec<f64>,
    /// Names of the model's inputs.
    pub input_names: Vec<String>,
    /// Values of each input.
    pub inputs: Vec<Vec<f64>>,
    /// Force that a unit change of each uncertain nominal parameter would look like.
    pub imitable: Vec<Vec<f64>>,
}

/// One place is written as an object, several as a list: most machines have one fault at a time.
fn none_one_or_many<S: serde::Serializer>(places: &[Location], to: S) -> Result<S::Ok, S::Error> {
    match places {
        [] => to.serialize_none(),
        [one] => one.serialize(to),
        many => many.serialize(to),
    }
}
