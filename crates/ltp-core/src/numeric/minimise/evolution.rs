//! Differential evolution: a population that moves by differences of its members, for valleys far apart.
//!
//! Strategy rand-to-best/1/bin with weights drawn anew for each generation. Members start inside the box and may leave it:
//! constraints, not the box, say where the minimum may be. A generation is evaluated in parallel from the one before, so the
//! result does not depend on the number of threads.
//!
//! Reference: R. Storn, K. Price, *Differential evolution*, J. Global Optim. 11 (1997), 341-359.

use rayon::prelude::*;

use super::{Best, Evaluation, Problem};
use crate::numeric::rng::SplitMix64;

/// How the population is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Evaluations at most.
    pub budget: usize,
    /// Members, at least 4.
    pub members: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
}

/// A member: where, objective, violation.
pub type Member = (Vec<f64>, f64, f64);

/// Evolves members that start in the box `|x_i| <= scale_i` (n), the first ones at `start`. The final population, best first.
pub fn evolve(problem: &impl Problem, scale: &[f64], start: &[Vec<f64>], options: &Options) -> Vec<Member> {
    let (n, members) = (problem.unknowns(), options.members.max(4));
    let mut random = SplitMix64::new(options.seed);
    let drawn = |random: &mut SplitMix64| scale.iter().map(|s| s * (2.0 * random.uniform() - 1.0)).collect();
    let first: Vec<Vec<f64>> =
        (0..members).map(|k| start.get(k).cloned().unwrap_or_else(|| drawn(&mut random))).collect();
    let mut population = rate(problem, first);
    let mut spent = members;
    while spent + members <= options.budget {
        let best = leader(&population);
        let (weight, crossover) = (0.5 + 0.5 * random.uniform(), 0.5 + 0.5 * random.uniform());
        let trials: Vec<Vec<f64>> = (0..members)
            .map(|k| {
                let [a, b] = [random.below(members), random.below(members)];
                let lead = random.uniform() * 0.5;
                let kept = random.below(n);
                let own = &population[k].0;
                let value = |i: usize, draw: f64| {
                    let difference = population[a].0[i] - population[b].0[i];
                    let moved = own[i] + lead * (population[best].0[i] - own[i]) + weight * difference;
                    if i == kept || draw < crossover { moved } else { own[i] }
                };
                (0..n).map(|i| value(i, random.uniform())).collect()
            })
            .collect();
        spent += members;
        for (old, new) in population.iter_mut().zip(rate(problem, trials)) {
            if beats(&new, old) {
                *old = new;
            }
        }
    }
    population.sort_by(|a, b| a.2.total_cmp(&b.2).then(a.1.total_cmp(&b.1)));
    population
}

/// The best member as a [`Best`] point, with the evaluations that the population took.
pub fn best(population: &[Member], evaluations: usize) -> Best {
    let (x, value, violation) = &population[leader(population)];
    Best { x: x.clone(), value: *value, violation: *violation, evaluations }
}

/// Objective and violation of many points, in parallel.
pub(super) fn rate(problem: &impl Problem, points: Vec<Vec<f64>>) -> Vec<Member> {
    let one = |e: &mut Evaluation, x: Vec<f64>| {
        problem.evaluate(&x, false, e);
        let violation = e.violation();
        (x, if e.value.is_nan() { f64::INFINITY } else { e.value }, violation)
    };
    points.into_par_iter().map_init(Evaluation::default, one).collect()
}

fn beats(new: &Member, old: &Member) -> bool {
    if new.2 == old.2 { new.1 < old.1 } else { new.2 < old.2 }
}

fn leader(population: &[Member]) -> usize {
    (1..population.len()).fold(0, |best, k| if beats(&population[k], &population[best]) { k } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::minimise::testing::Kink;

    #[test]
    fn the_kink_is_found_from_anywhere() {
        for seed in 0..5 {
            let options = Options { budget: 6000, members: 24, seed };
            let population = evolve(&Kink { weight: 8.0, limit: 9.0 }, &[100.0, 100.0], &[], &options);
            let best = best(&population, 6000);
            assert!(best.violation == 0.0 && best.value < 1e-4, "{seed}: {best:?}");
        }
    }

    #[test]
    fn one_seed_gives_the_same_bits() {
        let options = Options { budget: 500, members: 10, seed: 3 };
        let run = || evolve(&Kink { weight: 8.0, limit: 9.0 }, &[5.0, 5.0], &[], &options);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        assert_eq!(one.install(run), run());
    }
}
