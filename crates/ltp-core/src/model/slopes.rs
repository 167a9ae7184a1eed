//! Rows of derivatives that a compiled model evaluates: values first, then their slopes, in the layouts of [`super::system`].

use super::assemble::Assembly;
use super::delay::PastEquation;
use super::graph::{Graph, Id, Symbol};
use super::program::Program;

/// Delays and operators with their derivatives by the free parameters, and the periods of pasts behind the delays.
pub(super) fn past_programs(a: &Assembly, free: &[usize]) -> (Program, Program) {
    let mut g = a.graph.clone();
    let row = |g: &mut Graph, id: Id| slopes(g, &[id], 0, free);
    let mut late: Vec<Id> = a.delays.iter().flat_map(|d| row(&mut g, d.delay)).collect();
    for d in &a.delays {
        late.push(if let PastEquation::Periodic(period) = d.past { period } else { g.constant(0.0) });
    }
    let operators: Vec<Id> = a.operators.iter().flat_map(|o| row(&mut g, o.value)).collect();
    (Program::plain(&g, &late), Program::plain(&g, &operators))
}

/// Rates of expressions along the flow, the rate of input `j` standing behind the inputs as input `nu + j`.
pub(super) fn along_flow(g: &mut Graph, values: &[Id], flow: &[Id], nu: usize) -> Vec<Id> {
    let mut rates = g.derivative(values, Symbol::Time);
    let mut add = |g: &mut Graph, by: Symbol, rate: Id| {
        for (sum, slope) in rates.iter_mut().zip(g.derivative(values, by)) {
            let term = g.mul(slope, rate);
            *sum = g.add(*sum, term);
        }
    };
    for (i, &rate) in flow.iter().enumerate() {
        add(g, Symbol::State(i), rate);
    }
    for j in 0..nu {
        let rate = g.leaf(Symbol::Input(nu + j));
        add(g, Symbol::Input(j), rate);
    }
    rates
}

/// Values, derivatives by state, derivatives by free parameter.
pub(super) fn slopes(g: &mut Graph, values: &[Id], nx: usize, free: &[usize]) -> Vec<Id> {
    let columns = |g: &mut Graph, leaves: Vec<Symbol>| -> Vec<Id> {
        let by: Vec<Vec<Id>> = leaves.into_iter().map(|s| g.derivative(values, s)).collect();
        (0..values.len()).flat_map(|i| by.iter().map(move |c| c[i])).collect()
    };
    let mut all = values.to_vec();
    all.extend(columns(g, (0..nx).map(Symbol::State).collect()));
    all.extend(columns(g, free.iter().map(|&k| Symbol::Parameter(k)).collect()));
    all
}

/// As [`slopes`], and derivatives by time and by input.
pub(super) fn all_slopes(g: &mut Graph, values: &[Id], nx: usize, free: &[usize], nu: usize) -> Vec<Id> {
    let mut all = slopes(g, values, nx, free);
    all.extend(g.derivative(values, Symbol::Time));
    let by: Vec<Vec<Id>> = (0..nu).map(|j| g.derivative(values, Symbol::Input(j))).collect();
    all.extend((0..values.len()).flat_map(|i| by.iter().map(move |c| c[i])));
    all
}
