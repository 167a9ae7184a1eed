//! Level 3: reference motions and the inputs that go with them. The noun is [`Reference`].
//!
//! Three ways lead to one: [`feedforward`] solves the motion for one prescribed coordinate, so that nothing is left over;
//! [`Reference::of_states`] takes a motion as it is and finds the input that explains it best, as the thesis does
//! (eqs 3.7-3.9); [`Reference::new`] takes both as they are. All say how far the motion is from an orbit: its defect.
//!
//! Reference: A. D. Duyul, *Control of an underactuated system around a periodic orbit*, METU 2018, section 3.2.

mod balance;
mod inverse;

use crate::error::{Error, Result, nearest};
use crate::model::system::without_past;
use crate::model::{Model, Point, System};
use crate::numeric::rng::SplitMix64;
use crate::numeric::{Complex, fourier_series::FourierSeries};
use std::f64::consts::TAU;

pub use balance::{Options, feedforward};

/// Instants at which a defect is measured, at least.
const INSTANTS: usize = 128;
/// Harmonics of an input below this share of its largest are rounding.
const ROUNDING: f64 = 1e-13;

/// A periodic motion to be followed, with the inputs that go with it. It need not be an orbit.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// States (nx).
    pub states: FourierSeries,
    /// Inputs (nu).
    pub inputs: FourierSeries,
    /// Per state, the rms over one period of `z' - f(t, z, u)` relative to that of `z'` (absolute where the state rests):
    /// zero for an orbit.
    pub defect: Vec<f64>,
}

/// `offset + amplitude sin(omega t + phase)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sinusoid {
    /// Amplitude, in the unit of the state.
    pub amplitude: f64,
    /// Phase, rad.
    pub phase: f64,
    /// Mean, in the unit of the state.
    pub offset: f64,
}

impl Sinusoid {
    /// The Fourier coefficients `c_0`, `c_1`.
    pub fn coefficients(&self) -> [Complex; 2] {
        [Complex::from(self.offset), Complex::from_polar(0.5 * self.amplitude, self.phase) * Complex::new(0.0, -1.0)]
    }

    /// The signal of one row at the angular frequency `omega`, rad/s.
    ///
    /// # Errors
    /// `OutOfRange`, `NotFinite` as [`FourierSeries::new`].
    pub fn series(&self, omega: f64) -> Result<FourierSeries> {
        FourierSeries::new(TAU / omega, 1, self.coefficients().to_vec())
    }
}

impl Reference {
    /// States and inputs as they are, with their defect in the given mode.
    ///
    /// # Errors
    /// `Shape` for rows that do not fit the system, `OutOfRange` for two periods.
    pub fn new(
        system: &dyn System,
        p: &[f64],
        mode: usize,
        states: FourierSeries,
        inputs: FourierSeries,
    ) -> Result<Self> {
        let defect = defect(system, p, mode, &states, &inputs)?;
        Ok(Self { states, inputs, defect })
    }

    /// A motion as it is, with the one input that leaves the smallest force unbalanced: for a model with a mass matrix that
    /// is the input which balances the equations it acts in, so for the cart-pendulum eqs (3.1) and (3.4). The other inputs
    /// are held at `inputs` (nu), zero where empty.
    ///
    /// # Errors
    /// As [`Reference::new`]; `OutOfRange` for an input that does not exist, `Model` for one that moves nothing.
    pub fn of_states(model: &Model, states: FourierSeries, input: usize, inputs: &[f64]) -> Result<Self> {
        let system = model.compile();
        let p = system.parameters().to_vec();
        let inputs = inverse::input_of(model, &system, &states, input, inputs)?;
        Self::new(&system, &p, system.initial_mode(), states, inputs.trimmed(ROUNDING))
    }

    /// The motion in which each given state is a [`Sinusoid`] of `omega` (rad/s), with its input as [`Reference::of_states`]
    /// finds it. A state that is the rate of a given one need not be given.
    ///
    /// # Errors
    /// `Model` for a state that is neither given nor the rate of one that is, and what [`Reference::of_states`] says.
    pub fn of_sinusoids(
        model: &Model,
        omega: f64,
        given: &[(usize, Sinusoid)],
        input: usize,
        inputs: &[f64],
    ) -> Result<Self> {
        Self::of_states(model, sinusoids(model, omega, given)?, input, inputs)
    }

    /// Period, s.
    pub fn period(&self) -> f64 {
        self.states.period()
    }

    /// The reference ahead by `time`, s: `z(t + time)`, `u(t + time)`.
    #[must_use]
    pub fn ahead(&self, time: f64) -> Self {
        Self { states: self.states.ahead(time), inputs: self.inputs.ahead(time), defect: self.defect.clone() }
    }

    /// The reference with `amount` added to one state; its defect stays what it is for a state that no equation contains.
    ///
    /// # Errors
    /// `OutOfRange` for a state that does not exist; `NotFinite`.
    pub fn shifted(&self, state: usize, amount: f64) -> Result<Self> {
        index("state", state, self.states.rows())?;
        let mut coefficients = self.states.coefficients().to_vec();
        coefficients[state] += amount;
        let states = FourierSeries::new(self.period(), self.states.rows(), coefficients)?;
        Ok(Self { states, ..self.clone() })
    }

    /// Half the peak-to-peak range of each state over one period.
    pub fn amplitudes(&self) -> Vec<f64> {
        let nx = self.states.rows();
        let samples = self.states.samples(instants(&self.states));
        let range = |row: usize| {
            let column = || samples.iter().skip(row).step_by(nx).copied();
            0.5 * (column().fold(f64::MIN, f64::max) - column().fold(f64::MAX, f64::min))
        };
        (0..nx).map(range).collect()
    }
}

/// Sinusoidal states, and the states that are their rates.
fn sinusoids(model: &Model, omega: f64, given: &[(usize, Sinusoid)]) -> Result<FourierSeries> {
    if !(omega > 0.0 && omega.is_finite()) {
        let expected = "a positive angular frequency in rad/s".into();
        return Err(Error::OutOfRange { what: "omega".into(), found: omega, expected });
    }
    let nx = model.states().len();
    let system = model.compile();
    let mut rows: Vec<Option<FourierSeries>> = vec![None; nx];
    for (state, sinusoid) in given {
        index("state", *state, nx)?;
        rows[*state] = Some(sinusoid.series(omega)?);
    }
    for (state, _) in given {
        let Some(rate) = rate_of(&system, *state) else { continue };
        if rows[rate].is_none() {
            rows[rate] = rows[*state].as_ref().map(FourierSeries::derivative);
        }
    }
    if let Some(missing) = rows.iter().position(Option::is_none) {
        let message = format!(
            "`{}` is neither given nor the rate of a state that is; give its sinusoid too",
            model.states()[missing]
        );
        return Err(Error::Model { path: "reference of sinusoids".into(), message });
    }
    let zero = Complex::new(0.0, 0.0);
    let line = |row: &Option<FourierSeries>, k: usize| row.as_ref().map_or(zero, |s| s.coefficients()[k]);
    let coefficients = (0..2).flat_map(|k| rows.iter().map(move |row| line(row, k))).collect();
    FourierSeries::new(TAU / omega, nx, coefficients)
}

/// The state that is the rate of this one whatever the state of the system.
fn rate_of(system: &dyn System, state: usize) -> Option<usize> {
    let nx = system.states();
    let mut rng = SplitMix64::new(1);
    let mut candidates: Vec<usize> = (0..nx).filter(|&c| c != state).collect();
    let (p, u) = (system.parameters(), vec![0.0; system.inputs()]);
    let (start, mut rates) = (system.initial_state(), vec![0.0; nx]);
    for _ in 0..3 {
        let x: Vec<f64> = start.iter().map(|v| v + rng.normal()).collect();
        system.flow(system.initial_mode(), Point { t: 0.0, x: &x, u: &u, p }, &mut rates);
        candidates.retain(|&c| rates[state] == x[c]);
    }
    candidates.first().copied()
}

/// Per state, the rms over one period of `z' - f(t, z, u)` relative to that of `z'`; absolute where the state rests.
///
/// # Errors
/// `Shape` for rows that do not fit the system, `OutOfRange` for two periods.
pub fn defect(
    system: &dyn System,
    p: &[f64],
    mode: usize,
    states: &FourierSeries,
    inputs: &FourierSeries,
) -> Result<Vec<f64>> {
    fits(system, p, states, inputs)?;
    let (nx, n, slope) = (states.rows(), instants(states).max(instants(inputs)), states.derivative());
    let (mut left, mut moved) = (vec![0.0; nx], vec![0.0; nx]);
    let (mut x, mut u, mut rates, mut wanted) = (vec![0.0; nx], vec![0.0; inputs.rows()], vec![0.0; nx], vec![0.0; nx]);
    for i in 0..n {
        let t = i as f64 * states.period() / n as f64;
        states.at(t, &mut x);
        inputs.at(t, &mut u);
        slope.at(t, &mut wanted);
        system.flow(mode, Point { t, x: &x, u: &u, p }, &mut rates);
        for r in 0..nx {
            left[r] += (wanted[r] - rates[r]).powi(2) / n as f64;
            moved[r] += wanted[r].powi(2) / n as f64;
        }
    }
    Ok(left.iter().zip(&moved).map(|(l, m)| if *m > 0.0 { (l / m).sqrt() } else { l.sqrt() }).collect())
}

/// Refuses a motion that is not one of the system.
pub(crate) fn fits(system: &dyn System, p: &[f64], states: &FourierSeries, inputs: &FourierSeries) -> Result<()> {
    without_past(system, p, "reference")?;
    for (what, expected, found) in [
        ("parameters", system.parameters().len(), p.len()),
        ("rows of the reference's states", system.states(), states.rows()),
        ("rows of the reference's inputs", system.inputs(), inputs.rows()),
    ] {
        // A system without inputs has a series of one row that nothing reads.
        if expected != found && !(expected == 0 && what.ends_with("inputs")) {
            return Err(Error::Shape { what: what.into(), expected, found });
        }
    }
    if (states.period() - inputs.period()).abs() > 1e-9 * states.period() {
        let expected = format!("{} s, that of the states", states.period());
        return Err(Error::OutOfRange {
            what: "period of the reference's inputs".into(),
            found: inputs.period(),
            expected,
        });
    }
    Ok(())
}

fn instants(series: &FourierSeries) -> usize {
    INSTANTS.max(8 * series.harmonics() + 1)
}

fn index(what: &str, found: usize, count: usize) -> Result<()> {
    if found < count {
        return Ok(());
    }
    let expected = format!("a number below {count}");
    Err(Error::OutOfRange { what: format!("number of the {what}"), found: found as f64, expected })
}

/// The number of a state or input by its name.
///
/// # Errors
/// `UnknownName` with the nearest names.
pub fn number(kind: &str, name: &str, known: &[&str]) -> Result<usize> {
    known.iter().position(|k| *k == name).ok_or_else(|| Error::UnknownName {
        kind: kind.into(),
        name: name.into(),
        nearest: nearest(name, known.iter().copied()),
        context: "reference".into(),
    })
}

#[cfg(test)]
mod tests;
