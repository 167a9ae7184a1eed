//! Runs of the nominal model and of every candidate along all records once, and their comparison on any choice of records and
//! sensors.

use indexmap::IndexMap;

use super::super::experiment::{Control, Experiment, Run};
use super::super::fit::Ground;
use super::super::fit::full;
use super::super::prepare;
use super::super::trial::short;
use super::geometry::{basis, distance, remove};
use super::variation::Start;
use super::{Size, sizes};
use crate::error::{Error, Result};
use crate::model::{Compiled, Model, System};
use crate::numeric::stats;

/// Outputs (n, ny) of a run, row-major, and their derivatives (n, ny, nx + nf).
pub struct Response {
    /// Outputs.
    pub y: Vec<f64>,
    /// Derivatives by initial state and free parameter.
    pub d: Vec<f64>,
}

/// Runs a system along a record with derivatives; `None` where it ends early or leaves the finite numbers.
pub fn respond(system: &Compiled, p: &[f64], start: &Start, substeps: u64, control: &Control<'_>) -> Option<Response> {
    let experiment = &start.experiment;
    let mut x0 = start.x0.clone();
    x0.extend_from_slice(system.initial_state().get(x0.len()..).unwrap_or(&[]));
    let run = Run { system, p, x0: &x0, experiment, substeps, observer: None, control };
    let mut out = Response { y: Vec::with_capacity(experiment.y.len()), d: Vec::new() };
    run.go(true, &mut |_, y, dy| {
        out.y.extend_from_slice(y);
        out.d.extend_from_slice(dy);
    })
    .ok()?;
    out.y.iter().chain(&out.d).all(|v| v.is_finite()).then_some(out)
}

/// Steps per sample fine enough for the noise.
pub fn substeps(system: &Compiled, records: &[Start], sigma: &[f64], control: &Control<'_>) -> Result<u64> {
    let experiments: Vec<Experiment> = records.iter().map(|r| r.experiment.clone()).collect();
    let start: Vec<Vec<f64>> = records.iter().map(|r| r.x0.clone()).collect();
    let scale = vec![1.0; system.states()];
    let ground = Ground { experiments: &experiments, sigma, substeps: 1, state_scale: &scale, control };
    Ok(prepare::substeps(system, system.parameters(), ground, &start)?.0)
}

/// An effect at its reference size with the changes that it makes along every record.
pub struct Candidate {
    /// Name in the library.
    pub effect: String,
    /// Where it acts.
    pub at: String,
    /// Its parameters at the reference size.
    pub parameters: IndexMap<String, Size>,
    /// For each record: the change of the outputs (n, ny), then its derivatives by each own parameter.
    columns: Vec<Vec<Vec<f64>>>,
}

/// The nominal model along every record.
pub struct Records<'a> {
    starts: &'a [&'a Start],
    substeps: u64,
    outputs: usize,
    states: usize,
    /// Inverse of the stated uncertainty of each free parameter; zero where nothing is stated.
    stiffness: Vec<f64>,
    responses: Vec<Response>,
}

/// What a set-up shows of the candidates.
pub struct Shown {
    /// rms change over all measured outputs, in units of noise.
    pub raw: Vec<f64>,
    /// Square of what nominal parameters and initial states leave of the change.
    pub own: Vec<f64>,
    /// The free parameter whose effect is most alike, and the cosine between the two; `None` where a state is.
    pub alike: Vec<Option<(usize, f64)>>,
    /// Square of what the effect of the column leaves of that of the row.
    pub matrix: Vec<Vec<f64>>,
}

impl<'a> Records<'a> {
    /// Runs the nominal model along all records.
    ///
    /// # Errors
    /// [`Error::NoConvergence`] where it cannot.
    pub fn new(
        model: &Model,
        system: &Compiled,
        starts: &'a [&'a Start],
        substeps: u64,
        control: &Control<'_>,
    ) -> Result<Self> {
        let sd = |i: &usize| model.parameters()[*i].sd.map_or(0.0, |s| 1.0 / s);
        let responses = starts
            .iter()
            .map(|s| {
                control.check()?;
                respond(system, system.parameters(), s, substeps, control).ok_or_else(|| Error::NoConvergence {
                    method: format!("simulation of the model along a variation of `{}`", s.experiment.name),
                    iterations: 0,
                    residual: f64::INFINITY,
                    advice:
                        "it leaves the finite numbers: plan smaller inputs, or close the loop around an unstable plant"
                            .into(),
                })
            })
            .collect::<Result<_>>()?;
        let stiffness = system.free().iter().map(sd).collect();
        Ok(Self { starts, substeps, outputs: system.outputs(), states: system.states(), stiffness, responses })
    }

    /// Compares the candidates on some of the records; `sigma` is infinite for an output that is not measured.
    pub fn compare(&self, candidates: &[Candidate], records: &[usize], sigma: &[f64]) -> Shown {
        let rows = |r: usize| self.starts[r].experiment.len();
        // Later samples of a long record tell what earlier ones did not: every sample is used.
        let stacked = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            let mut out = Vec::new();
            for &r in records {
                for i in 0..rows(r) * self.outputs {
                    let s = sigma[i % self.outputs];
                    if s.is_finite() {
                        out.push(of(r, i) / s);
                    }
                }
            }
            out
        };
        let np = self.stiffness.len();
        let ns = self.states + np;
        let mut nominal = Vec::new();
        for (k, stiffness) in self.stiffness.iter().enumerate() {
            let mut column = stacked(&|r, i| self.responses[r].d[i * ns + self.states + k]);
            column.extend((0..np).map(|j| if j == k { *stiffness } else { 0.0 }));
            nominal.push(column);
        }
        for own in records {
            for k in 0..self.states {
                let mut column = stacked(&|r, i| if r == *own { self.responses[r].d[i * ns + k] } else { 0.0 });
                column.extend(vec![0.0; np]);
                nominal.push(column);
            }
        }
        let (mut raw, mut alike) = (Vec::new(), Vec::new());
        let columns = nominal;
        let nominal = basis(&columns);
        let projected: Vec<Vec<Vec<f64>>> = candidates
            .iter()
            .map(|c| {
                (0..c.columns[0].len())
                    .map(|j| {
                        let mut column = stacked(&|r, i| c.columns[r][j][i]);
                        if j == 0 {
                            raw.push(stats::rms(column.iter().copied()));
                        }
                        column.extend(vec![0.0; np]);
                        if j == 0 {
                            alike.push(most_alike(&columns, &column).filter(|(k, _)| *k < np));
                        }
                        remove(&nominal, &mut column);
                        column
                    })
                    .collect()
            })
            .collect();
        let own: Vec<f64> = projected.iter().map(|c| c[0].iter().map(|v| v * v).sum()).collect();
        let matrix = (0..projected.len())
            .map(|k| {
                (0..projected.len())
                    .map(|l| if k == l { 0.0 } else { distance(&projected[k][0], &projected[l]) })
                    .collect()
            })
            .collect();
        Shown { raw, own, alike, matrix }
    }
}

/// The column that points most in the direction of another, and the magnitude of their cosine.
fn most_alike(columns: &[Vec<f64>], to: &[f64]) -> Option<(usize, f64)> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let own = dot(to, to);
    let cosine = |c: &Vec<f64>| dot(c, to).abs() / (dot(c, c) * own).sqrt();
    let all = columns.iter().map(cosine).enumerate().filter(|(_, c)| c.is_finite());
    all.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// An effect at its reference size; `None` where it cannot be simulated along some record.
///
/// # Errors
/// What attaching it may say.
pub fn candidate(
    model: &Model,
    name: &str,
    at: &str,
    reference: &[(String, f64)],
    records: &Records<'_>,
    control: &Control<'_>,
) -> Result<Option<Candidate>> {
    let effect = model.library().get(name)?;
    let linear = sizes::linear(effect);
    let values: Vec<(&str, f64)> = reference.iter().map(|(n, v)| (n.as_str(), *v)).collect();
    // A law in proportion to its parameter is differentiated where the parameter is zero; others are tried at their size.
    let attached = model.attach(name, at, if linear { &[] } else { &values })?;
    let system = attached.compile();
    let (nx, np) = (system.states(), system.free().len());
    let ns = nx + np;
    let own: Vec<usize> = (records.stiffness.len()..np).collect();
    let p = full(&system, &system.free().iter().map(|&i| system.parameters()[i]).collect::<Vec<_>>());
    let sizes: Vec<f64> = reference.iter().map(|(_, v)| *v).collect();
    let mut columns = Vec::new();
    for (start, nominal) in records.starts.iter().zip(&records.responses) {
        control.check()?;
        let Some(found) = respond(&system, &p, start, records.substeps, control) else { return Ok(None) };
        let derivative = |k: usize, size: f64| -> Vec<f64> {
            found.d.chunks(ns).map(|row| row[nx + k] * if size != 0.0 { size } else { 1.0 }).collect()
        };
        let tangents = own.iter().zip(&sizes).map(|(&k, &size)| derivative(k, size));
        columns.push(if linear {
            tangents.collect()
        } else {
            let change = found.y.iter().zip(&nominal.y).map(|(a, b)| a - b).collect();
            std::iter::once(change).chain(tangents).collect()
        });
    }
    let infos = attached.parameters();
    let unit = |name: &str| {
        let own = infos.iter().rev().find(|p| p.effect.is_some() && short(&p.name) == name);
        own.and_then(|p| p.unit.clone()).unwrap_or_else(|| "1".into())
    };
    let parameters = reference.iter().map(|(n, v)| (n.clone(), Size { value: *v, unit: unit(n) })).collect();
    Ok(Some(Candidate { effect: name.into(), at: at.into(), parameters, columns }))
}
