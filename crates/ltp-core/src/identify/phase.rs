//! Phase from events: where in its cycle an unclocked machine is, when nothing but its own events tells the time.
//!
//! A walker has no clock; a cycle begins where a foot lands. Phase runs from 0 at the event that starts a cycle to 1 at the
//! next one, and the events between them (the other foot) are pinned at their median phases, so that the same phase
//! means the same part of the motion in a slow cycle and in a fast one. Within a segment between two events, phase is
//! linear in time, in two readings: *interpolated* knows when the segment ends; *elapsed* divides by the usual duration
//! and so uses the past only, which is what a prediction may know.
//!
//! Cycles that contain a join of two runs, lack an event, have a gap, or last much longer or shorter than the other
//! cycles of their run are kept in the list with the reason, and used for nothing.
//!
//! References: S. Revzen and J. M. Guckenheimer, Phys. Rev. E 78 (2008) 051907 (phase of recorded rhythms, and what
//! events alone can give); M. M. Ankarali and N. J. Cowan, IEEE Conf. Decision and Control 2014, 1017-1022
//! (identification of hybrid rhythmic systems whose phase is known).

use crate::error::{Error, Result, nearest};
use crate::numeric::stats;
use crate::signal::Recording;

/// Instants at which something recognisable happens, in time order, each of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Events {
    times: Vec<f64>,
    kinds: Vec<usize>,
}

impl Events {
    /// Events at `times` (s, increasing) of `kinds` (any numbers; the same number is the same kind of event).
    ///
    /// # Errors
    /// `Shape`, `NotFinite`, and `OutOfRange` where a time is not after the one before.
    pub fn new(times: Vec<f64>, kinds: Vec<usize>) -> Result<Self> {
        if times.len() != kinds.len() {
            return Err(Error::Shape { what: "kinds of the events".into(), expected: times.len(), found: kinds.len() });
        }
        if let Some(row) = times.iter().position(|t| !t.is_finite()) {
            let (what, column) = ("events".into(), "times".into());
            return Err(Error::NotFinite { what, row, column, value: times[row] });
        }
        if let Some(i) = (1..times.len()).find(|&i| times[i] <= times[i - 1]) {
            let expected = format!("a time after {} s; sort the events and remove doubled ones", times[i - 1]);
            return Err(Error::OutOfRange { what: format!("time of event {i}"), found: times[i], expected });
        }
        Ok(Self { times, kinds })
    }

    /// Switches of a `channel` (an input or output of the recording): kind 0 where it rises through `level`, kind 1 where
    /// it falls.
    ///
    /// `level` is halfway between the smallest and the largest sample unless given. A switch counts once the channel
    /// has passed the level by a tenth of its range, so that noise around the level does not count; its time is
    /// interpolated between the samples on both sides, for a channel of two values halfway. Gaps are passed over.
    ///
    /// # Errors
    /// `UnknownName`; `OutOfRange` for a channel that never changes or a level outside its range.
    pub fn from_switch(recording: &Recording, channel: &str, level: Option<f64>) -> Result<Self> {
        let (t, x) = (recording.t(), samples_of(recording, channel)?);
        let finite = || x.iter().copied().filter(|v| v.is_finite());
        let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        let level = level.unwrap_or(0.5 * (low + high));
        if !(low < level && level < high) {
            let what = format!("level of the switch `{channel}` of `{}`", recording.name());
            let expected =
                format!("a value strictly between its extremes {low} and {high}; choose a channel that switches");
            return Err(Error::OutOfRange { what, found: level, expected });
        }
        let margin = 0.1 * (high - low);
        let margin = margin.min(0.9 * (high - level)).min(0.9 * (level - low));
        let (mut times, mut kinds) = (Vec::new(), Vec::new());
        // The last sample, the side on which the channel was last seen clearly, and its last way through the level.
        let (mut last, mut above, mut crossing) = (None::<usize>, None::<bool>, None::<f64>);
        for i in (0..x.len()).filter(|&i| x[i].is_finite()) {
            if let Some(p) = last.filter(|&p| (x[p] > level) != (x[i] > level)) {
                crossing = Some(t[p] + (t[i] - t[p]) * (level - x[p]) / (x[i] - x[p]));
            }
            let clear = if x[i] > level + margin {
                Some(true)
            } else if x[i] < level - margin {
                Some(false)
            } else {
                None
            };
            if let (Some(now), Some(before), Some(time)) = (clear, above, crossing)
                && now != before
            {
                times.push(time);
                kinds.push(usize::from(before));
            }
            above = clear.or(above);
            last = Some(i);
        }
        Self::new(times, kinds)
    }

    /// Times, s, increasing.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Kinds, one per event.
    pub fn kinds(&self) -> &[usize] {
        &self.kinds
    }
}

/// How phase is made from events.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Kind of the events that start a cycle.
    pub start: usize,
    /// Times at which one run ends and another, recorded separately, begins, s; no motion passes through them.
    pub joins: Vec<f64>,
    /// Largest deviation of the logarithm of a cycle's duration from that of the median of its run.
    pub tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { start: 0, joins: Vec::new(), tolerance: 0.25 }
    }
}

/// Why a cycle is used for nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum Trouble {
    /// Two separate runs are joined inside it, at this time, s.
    Join(f64),
    /// It holds this many events between its start and its end, other cycles hold `expected`.
    Events {
        /// Events between start and end.
        found: usize,
        /// What most cycles have.
        expected: usize,
    },
    /// An output has a gap in it.
    Gap,
    /// It lasts much longer or shorter than `usual`, the median of its run, s.
    Duration {
        /// Median duration of the cycles of its run, s.
        usual: f64,
    },
}

impl Trouble {
    /// One word: `"join"`, `"events"`, `"gap"`, `"duration"`.
    pub fn word(&self) -> &'static str {
        match self {
            Trouble::Join(_) => "join",
            Trouble::Events { .. } => "events",
            Trouble::Gap => "gap",
            Trouble::Duration { .. } => "duration",
        }
    }
}

/// One cycle, from an event that starts cycles to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Cycle {
    /// Times of the start, of the events inside, and of the end, s.
    pub times: Vec<f64>,
    /// Number of joins before it: the run it belongs to.
    pub run: usize,
    /// Why it is not used; `None` for a good one.
    pub trouble: Option<Trouble>,
}

impl Cycle {
    /// Start, s.
    pub fn start(&self) -> f64 {
        self.times[0]
    }
    /// End, s.
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }
    /// Duration, s.
    pub fn duration(&self) -> f64 {
        self.end() - self.start()
    }
}

/// A good cycle's stretch between two neighbouring events, where the motion is smooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Index into the cycles.
    pub cycle: usize,
    /// Which of the cycle's segments.
    pub part: usize,
    /// Start and end, s.
    pub times: (f64, f64),
    /// Phase at the start and at the end.
    pub phases: (f64, f64),
    /// Median duration of this part over the good cycles, s.
    pub usual: f64,
}

impl Segment {
    /// Phase at `t` (s), linear between the two events: it knows when the segment ends.
    pub fn interpolated(&self, t: f64) -> f64 {
        self.along((t - self.times.0) / (self.times.1 - self.times.0))
    }

    /// Phase at `t` (s) from the time since the segment began over its usual duration; stays at the end once there.
    pub fn elapsed(&self, t: f64) -> f64 {
        self.along(((t - self.times.0) / self.usual).min(1.0))
    }

    fn along(&self, share: f64) -> f64 {
        self.phases.0 + share * (self.phases.1 - self.phases.0)
    }

    /// Rows of the recording inside: from the first sample at or after the start to the last before the end.
    pub fn rows(&self, t: &[f64]) -> std::ops::Range<usize> {
        t.partition_point(|v| *v < self.times.0)..t.partition_point(|v| *v < self.times.1)
    }
}

/// The cycles of a recording, and the phase of every instant in the good ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    cycles: Vec<Cycle>,
    segments: Vec<Segment>,
    marks: Vec<f64>,
    period: f64,
    /// What was left out, with numbers.
    pub warnings: Vec<String>,
}

/// Phase of a recording from `events`.
///
/// # Errors
/// `TooShort` with fewer than three good cycles; `OutOfRange` for a tolerance that is not positive, a join that is not
/// finite, or a recording shorter than its events say.
pub fn phase_from_events(recording: &Recording, events: &Events, options: &Options) -> Result<Phase> {
    if options.tolerance.is_nan() || options.tolerance <= 0.0 {
        let expected = "a positive number; 0.25 lets durations differ by a quarter".into();
        return Err(Error::OutOfRange { what: "tolerance".into(), found: options.tolerance, expected });
    }
    if let Some(bad) = options.joins.iter().find(|j| !j.is_finite()) {
        return Err(Error::OutOfRange {
            what: "time of a join".into(),
            found: *bad,
            expected: "a finite time, s".into(),
        });
    }
    let mut cycles = split(recording, events, options);
    let inside = usual_count(&cycles);
    let gaps: Vec<f64> = gap_times(recording);
    for cycle in &mut cycles {
        let (start, end) = (cycle.start(), cycle.end());
        let slack = recording.dt() * (1.0 + 1e-6);
        if let Some(join) = options.joins.iter().find(|j| start + slack < **j && **j < end - slack) {
            cycle.trouble = Some(Trouble::Join(*join));
        } else if cycle.times.len() - 2 != inside {
            cycle.trouble = Some(Trouble::Events { found: cycle.times.len() - 2, expected: inside });
        } else if gaps.iter().any(|t| (start..end).contains(t)) {
            cycle.trouble = Some(Trouble::Gap);
        }
    }
    judge_durations(&mut cycles, options.tolerance);
    let good: Vec<&Cycle> = cycles.iter().filter(|c| c.trouble.is_none()).collect();
    if good.len() < 3 {
        let what = format!("good cycles of `{}` ({} cycles in all, {})", recording.name(), cycles.len(), told(&cycles));
        return Err(Error::TooShort { what, needed: 3, found: good.len() });
    }
    let period = stats::median(&good.iter().map(|c| c.duration()).collect::<Vec<_>>());
    let share = |c: &Cycle, k: usize| (c.times[k] - c.start()) / c.duration();
    let marks: Vec<f64> =
        (0..inside + 2).map(|k| stats::median(&good.iter().map(|c| share(c, k)).collect::<Vec<_>>())).collect();
    let usual: Vec<f64> = (0..=inside)
        .map(|k| stats::median(&good.iter().map(|c| c.times[k + 1] - c.times[k]).collect::<Vec<_>>()))
        .collect();
    let mut segments = Vec::new();
    for (cycle, c) in cycles.iter().enumerate().filter(|(_, c)| c.trouble.is_none()) {
        segments.extend((0..=inside).map(|part| Segment {
            cycle,
            part,
            times: (c.times[part], c.times[part + 1]),
            phases: (marks[part], marks[part + 1]),
            usual: usual[part],
        }));
    }
    let mut warnings = Vec::new();
    if good.len() < cycles.len() {
        let left = cycles.len() - good.len();
        warnings.push(format!(
            "{left} of {} cycles are left out: {}; see their `trouble`",
            cycles.len(),
            told(&cycles)
        ));
    }
    Ok(Phase { cycles, segments, marks, period, warnings })
}

impl Phase {
    /// All cycles, good and bad, in time order.
    pub fn cycles(&self) -> &[Cycle] {
        &self.cycles
    }
    /// Segments of the good cycles, in time order.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }
    /// Phases of the events of a cycle: 0, the medians of those inside, 1.
    pub fn marks(&self) -> &[f64] {
        &self.marks
    }
    /// Median duration of the good cycles, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Number of good cycles.
    pub fn good(&self) -> usize {
        self.segments.len() / (self.marks.len() - 1)
    }

    /// Interpolated phase in [0, 1) at `t` (s); `None` outside the good cycles.
    pub fn at(&self, t: f64) -> Option<f64> {
        let i = self.segments.partition_point(|s| s.times.0 <= t).checked_sub(1)?;
        let segment = &self.segments[i];
        (t < segment.times.1).then(|| segment.interpolated(t))
    }

    /// For each cycle the index of the good one that follows it at once, in the same run.
    pub fn successors(&self) -> Vec<Option<usize>> {
        let follows = |i: usize| {
            let (a, b) = (&self.cycles[i], self.cycles.get(i + 1)?);
            (a.trouble.is_none() && b.trouble.is_none() && a.run == b.run && a.end() == b.start()).then_some(i + 1)
        };
        (0..self.cycles.len()).map(follows).collect()
    }

    /// Groups of cycles to leave out or to draw together, because cycles within a group resemble each other: the runs,
    /// if at least five have good cycles; otherwise up to ten stretches of neighbouring good cycles. `None` for bad cycles.
    pub fn groups(&self) -> (Vec<Option<usize>>, usize) {
        let good: Vec<usize> = (0..self.cycles.len()).filter(|&i| self.cycles[i].trouble.is_none()).collect();
        let mut runs: Vec<usize> = good.iter().map(|&i| self.cycles[i].run).collect();
        runs.dedup();
        let mut groups = vec![None; self.cycles.len()];
        let count = if runs.len() >= 5 { runs.len() } else { good.len().min(10) };
        for (place, &i) in good.iter().enumerate() {
            let by_run = || runs.iter().position(|r| *r == self.cycles[i].run);
            groups[i] = if runs.len() >= 5 { by_run() } else { Some(place * count / good.len()) };
        }
        (groups, count)
    }
}

/// Samples of the input or output called `name`.
///
/// # Errors
/// `UnknownName`.
pub(super) fn samples_of(recording: &Recording, name: &str) -> Result<Vec<f64>> {
    if let Some(i) = recording.input_names().iter().position(|n| n == name) {
        return Ok(recording.input(i).collect());
    }
    if let Some(i) = recording.output_names().iter().position(|n| n == name) {
        return Ok(recording.output(i).collect());
    }
    let names = recording.input_names().iter().chain(recording.output_names());
    let (kind, context) = ("channel".into(), format!("recording `{}`", recording.name()));
    Err(Error::UnknownName { kind, name: name.into(), nearest: nearest(name, names), context })
}

/// Cycles between the events that start them, without any judgement.
fn split(recording: &Recording, events: &Events, options: &Options) -> Vec<Cycle> {
    let starts: Vec<usize> = (0..events.times.len()).filter(|&i| events.kinds[i] == options.start).collect();
    let run = |t: f64| options.joins.iter().filter(|j| **j <= t + recording.dt() * (1.0 + 1e-6)).count();
    let cycle =
        |w: &[usize]| Cycle { times: events.times[w[0]..=w[1]].to_vec(), run: run(events.times[w[0]]), trouble: None };
    starts.windows(2).map(cycle).collect()
}

/// The number of events inside that most cycles have.
fn usual_count(cycles: &[Cycle]) -> usize {
    let counts: Vec<usize> = cycles.iter().map(|c| c.times.len() - 2).collect();
    let votes = |k: usize| counts.iter().filter(|c| **c == k).count();
    // The smallest of the most frequent, so that the answer does not depend on order.
    counts.iter().copied().max_by_key(|&k| (votes(k), usize::MAX - k)).unwrap_or(0)
}

/// Times of samples where any output has a gap.
fn gap_times(recording: &Recording) -> Vec<f64> {
    let width = recording.output_names().len().max(1);
    let rows = recording.outputs().chunks(width).zip(recording.t());
    rows.filter(|(row, _)| row.iter().any(|v| v.is_nan())).map(|(_, t)| *t).collect()
}

/// Marks cycles whose duration is far from the median of their run, or of all where a run has fewer than three.
fn judge_durations(cycles: &mut [Cycle], tolerance: f64) {
    let durations = |run: Option<usize>| {
        let of = cycles.iter().filter(|c| c.trouble.is_none() && run.is_none_or(|r| c.run == r));
        of.map(Cycle::duration).collect::<Vec<_>>()
    };
    let all = stats::median(&durations(None));
    let usual: Vec<f64> = cycles
        .iter()
        .map(|c| Some(durations(Some(c.run))).filter(|d| d.len() >= 3).map_or(all, |d| stats::median(&d)))
        .collect();
    for (cycle, usual) in cycles.iter_mut().zip(usual) {
        if cycle.trouble.is_none() && (cycle.duration() / usual).ln().abs() > tolerance {
            cycle.trouble = Some(Trouble::Duration { usual });
        }
    }
}

/// Counts of troubles in words.
fn told(cycles: &[Cycle]) -> String {
    let count = |word: &str| cycles.iter().filter(|c| c.trouble.as_ref().is_some_and(|t| t.word() == word)).count();
    let parts = [
        ("join", "across a join"),
        ("events", "with events missing or doubled"),
        ("gap", "with a gap"),
        ("duration", "of unusual duration"),
    ];
    let told: Vec<String> = parts
        .iter()
        .map(|(word, text)| (count(word), text))
        .filter(|(n, _)| *n > 0)
        .map(|(n, text)| format!("{n} {text}"))
        .collect();
    if told.is_empty() { "none left out".into() } else { told.join(", ") }
}

#[cfg(test)]
#[path = "phase_tests.rs"]
mod tests;
