//! Particle swarm with a local solver inside: Algorithm 1 of Duyul's thesis, as published.
//!
//! Particles start at `1000 randn` and are descended at once; a velocity is the one before, plus normal multiples of the ways
//! to the particle's own best and to the best of all, with no damping of the velocity and one draw for each unknown; after
//! every move the particle is descended again. Normals stand where other swarms have uniforms.
//!
//! What is not as published: particles of one round move together, from the best of the round before, so that they can run in
//! parallel; and the evaluations are limited. The local solver is [`super::nonsmooth`], since the published one (a smooth
//! sequential quadratic program) stalls on kinks.
//!
//! References: A. D. Duyul, M.Sc. thesis, METU 2018, Algorithm 1; J. Kennedy, R. Eberhart, ICNN 1995, 1942-1948.

use rayon::prelude::*;

use super::nonsmooth::{self, descend};
use super::{Best, Problem};
use crate::numeric::rng::SplitMix64;

/// How the swarm is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Evaluations at most, those of the local solver included (it may end the last round early).
    pub budget: usize,
    /// Particles.
    pub particles: usize,
    /// Rounds after the first.
    pub rounds: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
    /// Evaluations of one descent; 0 leaves the local solver out.
    pub descent: usize,
}

/// The best point of a swarm that starts normally distributed with standard deviations `scale` (n); the thesis has 1000.
pub fn swarm(problem: &impl Problem, scale: &[f64], options: &Options) -> Best {
    let (n, mut random) = (problem.unknowns(), SplitMix64::new(options.seed));
    let mut normal = move |scale: f64| scale * random.normal();
    let starts: Vec<Vec<f64>> =
        (0..options.particles.max(1)).map(|_| scale.iter().map(|&s| normal(s)).collect()).collect();
    let mut speeds: Vec<Vec<f64>> = starts.iter().map(|_| (0..n).map(|_| normal(1.0)).collect()).collect();
    let mut spent = 0;
    let mut places = settle(problem, starts, options, &mut spent);
    let mut own = places.clone();
    for _ in 0..options.rounds {
        if spent >= options.budget {
            break;
        }
        let all = leader(&own);
        let moved = places.iter().zip(&mut speeds).zip(&own).map(|((place, speed), own)| {
            for i in 0..n {
                speed[i] += normal(1.0) * (own.x[i] - place.x[i]) + normal(1.0) * (all.x[i] - place.x[i]);
            }
            place.x.iter().zip(speed).map(|(x, v)| x + *v).collect()
        });
        let moved = moved.collect();
        places = settle(problem, moved, options, &mut spent);
        for (own, place) in own.iter_mut().zip(&places) {
            if own.is_beaten_by(place.value, place.violation) {
                own.clone_from(place);
            }
        }
    }
    Best { evaluations: spent, ..leader(&own) }
}

fn settle(problem: &impl Problem, starts: Vec<Vec<f64>>, options: &Options, spent: &mut usize) -> Vec<Best> {
    let share = options.budget.saturating_sub(*spent) / starts.len().max(1);
    let budget = options.descent.min(share).max(1);
    let local = nonsmooth::Options { budget, ..nonsmooth::Options::default() };
    let found: Vec<Best> = starts.into_par_iter().map(|start| descend(problem, &start, &local)).collect();
    *spent += found.iter().map(|b| b.evaluations).sum::<usize>();
    found
}

fn leader(places: &[Best]) -> Best {
    let better = |a: &Best, b: &Best| if a.is_beaten_by(b.value, b.violation) { b.clone() } else { a.clone() };
    places[1..].iter().fold(places[0].clone(), |best, place| better(&best, place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::minimise::testing::Kink;

    #[test]
    fn the_kink_is_found_with_and_without_descent() {
        let problem = Kink { weight: 8.0, limit: 9.0 };
        let options = Options { budget: 20_000, particles: 10, rounds: 10, seed: 1, descent: 300 };
        let best = swarm(&problem, &[1000.0; 2], &options);
        assert!(best.violation == 0.0 && best.value < 1e-7, "{best:?}");
        let alone = swarm(&problem, &[3.0; 2], &Options { descent: 0, rounds: 50, ..options });
        assert!(alone.violation == 0.0 && alone.value < 8.0 && alone.value > best.value, "{alone:?}");
    }

    #[test]
    fn one_seed_gives_the_same_bits() {
        let options = Options { budget: 3000, particles: 6, rounds: 3, seed: 5, descent: 100 };
        let run = || swarm(&Kink { weight: 8.0, limit: 9.0 }, &[10.0; 2], &options);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        assert_eq!(one.install(run), run());
    }
}
