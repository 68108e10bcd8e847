//! Down a rugged valley, from the best that descents have found: the covariance matrix adaptation evolution strategy
//! (Hansen 2016, *The CMA Evolution Strategy: A Tutorial*, arXiv:1604.00772).
//!
//! Where gains leave the inverse kinematics just so stable the distance is rugged: a hundredth of the bounds aside it may
//! be ten times as great, and ripples along the valley's floor hold a descent, which sees slopes. Offspring drawn around a
//! mean learn the valley's shape from nothing but which of them are better, and stride over ripples: with S_D and Jᵀ they end
//! up to a tenth below the descents. Where the distance is smooth they gain nothing. The more rugged it is, the more offspring
//! a generation needs: ripples even out over them (Hansen and Kern 2004, *Evaluating the CMA Evolution Strategy on Multimodal
//! Test Functions*).
//!
//! As in the tutorial, but that offspring beyond the bounds are put on them, which the covariance learns too; that its
//! Cholesky factor does for its root (Krause, Arbonès and Igel 2016, *CMA-ES with Optimal Covariance Update and Storage
//! Complexity*); and that the worse half does not count (the tutorial's negative weights are 0).

use fearless_simd::{Level, Simd};
use nalgebra::{Cholesky, DMatrix, DVector};
use sinew::real::Real;

use crate::kernel::proposal::{Draws, GENE, MOST_GENES};
use crate::lanes::{Instructions, dispatch};

/// Offspring of a generation, or, where it is the more rugged, of each half of one. The better half of a generation are the
/// parents of the next.
const OFFSPRING: usize = 32;
/// The first generation's standard deviation, as a share of the bounds.
const FIRST_STEP: f64 = 0.02;
/// It has arrived when so many generations have gained less than this share of the score,
const PATIENCE: usize = 200;
const WORTH: f64 = 3e-4;
/// or when a generation's scores differ by less than this share: its valley is smooth,
const EVEN: f64 = 3e-5;
/// or when offspring differ by less than genes can.
const FINEST: f64 = 1.0 / GENE as f64;
/// After so many generations, and from then on, a goal is out of reach
const FIRST_LOOK: usize = 50;
/// when the best is further from it than this share of it, over the number of generations.
const HOPE: f64 = 30.0;
/// It ends at the latest after so many generations.
const MOST_GENERATIONS: usize = 3000;
/// 1 / √((2¹⁶ − 1)/3): what makes a variance of 1 out of that of a sum of four bytes.
const SCALE: f64 = 0.006_765_875_086_793_228;
/// The first of its blocks of draws: what else is drawn with the same [`Draws`] takes blocks before it.
const FIRST_BLOCK: u32 = 1 << 16;

/// The best point found from `from`, which is not among them, with its score. `scores` has some points' scores, in order.
/// Points are shares of the bounds, of those that genes stand for. Where `rugged`, generations are twice as large. It gives
/// up once it will hardly become better than `goal`, a score; infinity is no goal.
///
/// # Errors
/// The first that `scores` ends with.
pub fn adapt<E>(
    from: &[f32],
    draws: &Draws,
    rugged: bool,
    goal: f64,
    mut scores: impl FnMut(&[Vec<f32>]) -> Result<Vec<f64>, E>,
) -> Result<(Vec<f32>, f64), E> {
    let size = if rugged { 2 * OFFSPRING } else { OFFSPRING };
    let mut cloud = Cloud::new(from, size / 2);
    let mut offspring = vec![from.to_vec(); size];
    let mut best = (from.to_vec(), f64::INFINITY);
    let mut bests = Vec::new();
    for generation in 0..MOST_GENERATIONS {
        let Some(root) = cloud.root() else {
            break;
        };
        cloud.draw(&root, draws, generation, &mut offspring);
        let scored = scores(&offspring)?;
        let mut order: Vec<(f64, &Vec<f32>)> = scored.into_iter().zip(&offspring).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(&(least, point)), Some(&(most, _))) = (order.first(), order.last()) else {
            break;
        };
        if least < best.1 {
            best.0.clone_from(point);
            best.1 = least;
        }
        let even = most - least < EVEN * least;
        let earlier = bests.len().checked_sub(PATIENCE).map(|at| bests[at]);
        let idle = earlier.is_some_and(|earlier: f64| earlier - best.1 < WORTH * best.1);
        bests.push(best.1);
        let hope = goal * (1.0 + HOPE / bests.len() as f64);
        let hopeless = bests.len() >= FIRST_LOOK && best.1 > hope;
        let parents = order.iter().take(size / 2).map(|&(_, point)| &point[..]);
        if even || idle || hopeless || !cloud.learn(&root, parents) || cloud.reach() < FINEST {
            break;
        }
    }
    Ok(best)
}

/// What offspring are drawn from: a normal distribution over the bounds, as shares of them. Symbols are the tutorial's: its
/// appendix A has the algorithm, its table 1 the numbers.
struct Cloud {
    /// m.
    mean: DVector<f64>,
    /// σ, the step size.
    step: f64,
    /// C, of which only the lower half counts.
    covariance: DMatrix<f64>,
    /// p_c and p_σ, the paths that the mean has gone.
    path: Column,
    step_path: DVector<f64>,
    /// What each parent counts, the best first: 1 together.
    weights: Vec<f64>,
    generation: i32,
}

/// A number of each parameter, then zeros: loops over all of it run on SIMD lanes without a rest.
type Column = [f64; MOST_GENES];

impl Cloud {
    /// Around a point, with so many parents in each generation.
    fn new(from: &[f32], parents: usize) -> Self {
        let n = from.len();
        let half = (2 * parents + 1) as f64 / 2.0;
        let weight = |rank| (half / rank as f64).ln();
        let weights: Vec<f64> = (1..=parents).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        Cloud {
            mean: DVector::from_iterator(n, from.iter().map(|&share| share.into())),
            step: FIRST_STEP,
            covariance: DMatrix::identity(n, n),
            path: [0.0; MOST_GENES],
            step_path: DVector::zeros(n),
            weights: weights.iter().map(|weight| weight / sum).collect(),
            generation: 0,
        }
    }

    /// A with A·Aᵀ = C, as long as there is one.
    fn root(&self) -> Option<DMatrix<f64>> {
        Cholesky::new(self.covariance.clone()).map(Cholesky::unpack)
    }

    /// A generation's points at m + σ·A·z, or the nearest that genes within the bounds stand for.
    fn draw(
        &self,
        root: &DMatrix<f64>,
        draws: &Draws,
        generation: usize,
        offspring: &mut [Vec<f32>],
    ) {
        // Loops over the offspring, so that they run on SIMD lanes.
        dispatch!(Level::new(), S => S::proof().vectorize(
            #[inline(always)]
            || {
                let halves = offspring.len() / OFFSPRING;
                for (half, offspring) in offspring.chunks_mut(OFFSPRING).enumerate() {
                    let normal = normal(draws, generation * halves + half, self.mean.len());
                    let mut points = [[0.0; OFFSPRING]; MOST_GENES];
                    for (k, (mean, points)) in self.mean.iter().zip(&mut points).enumerate() {
                        let mut shares = [*mean; OFFSPRING];
                        // A has nothing above its diagonal.
                        for (normal, root) in normal.iter().zip(root.row(k).iter()).take(k + 1) {
                            for (share, normal) in shares.iter_mut().zip(normal) {
                                *share += self.step * root * normal;
                            }
                        }
                        for (point, share) in points.iter_mut().zip(shares) {
                            let gene = share * f64::from(GENE) + 0.5;
                            let gene = gene.clamp(0.0, f64::from(GENE)) as i32;
                            // Exact: f32 holds every gene.
                            *point = gene as f32 * (1.0 / GENE as f32);
                        }
                    }
                    for (member, point) in offspring.iter_mut().enumerate() {
                        for (share, row) in point.iter_mut().zip(&points) {
                            *share = row[member];
                        }
                    }
                }
            },
        ));
    }

    /// The greatest standard deviation of a parameter.
    fn reach(&self) -> f64 {
        self.step * self.covariance.diagonal().max().sqrt()
    }

    /// Moves to the parents, ordered from the best on, and learns from where they lie. False where that comes to no number.
    fn learn<'a>(&mut self, root: &DMatrix<f64>, parents: impl Iterator<Item = &'a [f32]>) -> bool {
        // The numbers.
        let n = self.mean.len() as f64;
        let mu = 1.0 / self.weights.iter().map(|w| w * w).sum::<f64>();
        let c_c = (4.0 + mu / n) / (n + 4.0 + 2.0 * mu / n);
        let c_sigma = (mu + 2.0) / (n + mu + 5.0);
        let c_1 = 2.0 / ((n + 1.3).powi(2) + mu);
        let c_mu = 2.0 * (mu - 1.75 + 1.0 / mu) / ((n + 2.0).powi(2) + mu);
        let c_mu = c_mu.min(1.0 - c_1);
        let d_sigma = 1.0 + 2.0 * (((mu - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let expected = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));

        // Steps from the mean, and the mean's own.
        let mut moved = DVector::zeros(self.mean.len());
        let steps = self.steps(parents);
        for (weight, step) in self.weights.iter().zip(&steps) {
            for (moved, step) in moved.iter_mut().zip(step) {
                *moved += weight * step;
            }
        }
        self.mean.axpy(self.step, &moved, 1.0);
        // The step size.
        let Some(straight) = root.solve_lower_triangular(&moved) else {
            return false;
        };
        let taken = (c_sigma * (2.0 - c_sigma) * mu).sqrt();
        self.step_path.axpy(taken, &straight, 1.0 - c_sigma);
        self.generation += 1;
        let begun = (1.0 - (1.0 - c_sigma).powi(2 * self.generation)).sqrt();
        let length = self.step_path.norm();
        self.step *= Real::exp((c_sigma / d_sigma * (length / expected - 1.0)).min(1.0));
        // The covariance. A path that is long because the steps are still too small does not count.
        let (taken, lost) = if length / begun < (1.4 + 2.0 / (n + 1.0)) * expected {
            ((c_c * (2.0 - c_c) * mu).sqrt(), 0.0)
        } else {
            (0.0, c_1 * c_c * (2.0 - c_c))
        };
        for (path, moved) in self.path.iter_mut().zip(&moved) {
            *path = taken * moved + (1.0 - c_c) * *path;
        }
        self.spread(1.0 - c_1 - c_mu + lost, c_1, c_mu, &steps);
        self.step.is_finite()
    }

    /// The steps that lead from the mean to the parents, as shares of the step size.
    fn steps<'a>(&self, parents: impl Iterator<Item = &'a [f32]>) -> Vec<Column> {
        let mut mean = [0.0; MOST_GENES];
        mean[..self.mean.len()].copy_from_slice(self.mean.as_slice());
        let mut steps = Vec::with_capacity(self.weights.len());
        dispatch!(Level::new(), S => S::proof().vectorize(
            #[inline(always)]
            || {
                for point in parents {
                    let mut shares = [0.0; MOST_GENES];
                    shares[..point.len()].copy_from_slice(point);
                    let step = |row: usize| (f64::from(shares[row]) - mean[row]) / self.step;
                    steps.push(std::array::from_fn(step));
                }
            },
        ));
        steps
    }

    /// C := kept·C + c_1·p_c·p_cᵀ + c_μ·Σ w·y·yᵀ, for the parents' steps y.
    fn spread(&mut self, kept: f64, c_1: f64, c_mu: f64, steps: &[Column]) {
        let n = self.mean.len().max(1);
        dispatch!(Level::new(), S => S::proof().vectorize(
            #[inline(always)]
            || {
                // Column by column, whose sums stay in registers.
                for (k, column) in self.covariance.as_mut_slice().chunks_exact_mut(n).enumerate() {
                    let mut before = [0.0; MOST_GENES];
                    before[..n].copy_from_slice(column);
                    let share = c_1 * self.path[k];
                    let mut sums: Column =
                        std::array::from_fn(|row| kept * before[row] + share * self.path[row]);
                    for (weight, step) in self.weights.iter().zip(steps) {
                        let share = c_mu * weight * step[k];
                        for (sum, step) in sums.iter_mut().zip(step) {
                            *sum += share * step;
                        }
                    }
                    column.copy_from_slice(&sums[..n]);
                }
            },
        ));
    }
}

/// A number of each of some offspring.
type Row = [f64; OFFSPRING];

/// Some offspring's independent numbers of mean 0 and variance 1, nearly normal, for `rows` parameters: sums of four uniform
/// ones of 8 bits. `number` counts those that are drawn so.
#[inline(always)]
fn normal(draws: &Draws, number: usize, rows: usize) -> [Row; MOST_GENES] {
    const FOUR: usize = 4;
    let mut out = [[0.0; OFFSPRING]; MOST_GENES];
    let first = FIRST_BLOCK + (number * OFFSPRING * MOST_GENES / FOUR) as u32;
    let fours = out.chunks_mut(FOUR).take(rows.div_ceil(FOUR));
    for (four, rows) in fours.enumerate() {
        for member in 0..OFFSPRING {
            let block = draws.block(first + (four * OFFSPRING + member) as u32);
            for (row, draw) in rows.iter_mut().zip(block) {
                let sum: u32 = draw.to_le_bytes().map(u32::from).iter().sum();
                // Of four with mean 255/2 and variance (2¹⁶ − 1)/12 each.
                row[member] = (f64::from(sum) - 510.0) * SCALE;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    const DRAWS: Draws = Draws {
        seed: [1, 2],
        set: 3,
        member: 4,
        generation: 5,
    };

    /// From the middle, a score of shares of the bounds.
    fn found(rugged: bool, score: impl Fn(&DVector<f64>) -> f64) -> (Vec<f32>, f64) {
        let scores = |points: &[Vec<f32>]| {
            let each = points.iter().map(|point| {
                let point = point.iter().map(|&share| f64::from(share));
                score(&DVector::from_iterator(10, point))
            });
            Ok::<_, Infallible>(each.collect())
        };
        adapt(&[0.5; 10], &DRAWS, rugged, f64::INFINITY, scores).unwrap()
    }

    #[test]
    fn a_narrow_valley_across_all_parameters_is_followed_to_its_end() {
        // A hundred times as steep across as along, turned out of the axes; ripples along it are steeper than it is.
        let score = |at: &DVector<f64>| {
            let from_end = at.add_scalar(-0.8);
            let along = from_end.sum() / 10.0;
            let across = from_end.add_scalar(-along).norm();
            let ripple = 1e-4 * (3e4 * along).sin().powi(2);
            (along * along + 1e4 * across * across).sqrt() + ripple
        };
        let middle = score(&DVector::from_element(10, 0.5));
        assert!(middle > 0.3);
        for rugged in [false, true] {
            let (point, least) = found(rugged, score);
            assert!(least < 0.005, "{least}");
            assert!(point.iter().all(|&share| share > 0.78));
        }
    }

    #[test]
    fn a_best_beyond_the_bounds_is_found_on_them() {
        let (point, least) = found(false, |at| {
            let beyond = at.add_scalar(-2.0);
            beyond.norm()
        });
        assert!((least - 10.0_f64.sqrt()).abs() < 1e-3, "{least}");
        assert!(point.iter().all(|&share| share > 0.999));
    }

    #[test]
    fn where_nothing_is_better_it_ends_soon_and_an_error_ends_it_at_once() {
        let mut asked = 0;
        let scores = |points: &[Vec<f32>]| {
            asked += points.len();
            Ok::<_, Infallible>(vec![1.0; points.len()])
        };
        let from = [0.25; 3];
        assert_eq!(
            adapt(&from, &DRAWS, false, f64::INFINITY, scores)
                .unwrap()
                .1,
            1.0
        );
        assert_eq!(asked, OFFSPRING);
        assert_eq!(
            adapt(&from, &DRAWS, false, f64::INFINITY, |_| Err("stop")),
            Err("stop")
        );
        // Scores that are no numbers.
        let scores = |points: &[Vec<f32>]| Ok::<_, Infallible>(vec![f64::NAN; points.len()]);
        assert_eq!(
            adapt(&from, &DRAWS, false, f64::INFINITY, scores)
                .unwrap()
                .0,
            from
        );
    }

    #[test]
    fn a_goal_out_of_reach_is_given_up_and_one_within_reach_is_met() {
        let from = [0.5; 4];
        let ends = |goal| {
            let mut asked = 0;
            let scores = |points: &[Vec<f32>]| {
                asked += points.len();
                let far = |point: &Vec<f32>| point.iter().map(|&x| f64::from(x - 0.9).abs()).sum();
                let far = points.iter().map(far);
                Ok::<_, Infallible>(far.map(|far: f64| far + 0.1).collect())
            };
            let (_, least) = adapt(&from, &DRAWS, false, goal, scores).unwrap();
            (least, asked)
        };
        let (least, asked) = ends(f64::INFINITY);
        assert!((least - 0.1).abs() < 1e-3);
        assert_eq!(ends(0.1), (least, asked));
        assert_eq!(ends(0.01).1, FIRST_LOOK * OFFSPRING);
    }

    #[test]
    fn normal_numbers_have_mean_0_and_variance_1_and_are_independent() {
        let columns = |number| {
            let rows = normal(&DRAWS, number, 5);
            std::array::from_fn::<_, OFFSPRING, _>(|member| rows.map(|row| row[member]))
        };
        let draws: Vec<_> = (0..625).flat_map(columns).collect();
        let mean = |f: &dyn Fn(&[f64; MOST_GENES]) -> f64| {
            draws.iter().map(f).sum::<f64>() / draws.len() as f64
        };
        for a in 0..5 {
            assert!(mean(&|z| z[a]).abs() < 0.03);
            for b in 0..5 {
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((mean(&|z| z[a] * z[b]) - expected).abs() < 0.04);
            }
        }
        assert_ne!(draws[0], draws[1]);
    }
}
