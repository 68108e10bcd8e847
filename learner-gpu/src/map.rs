//! A map from reaches to parameters, fitted to many reaches at once, and chosen by what it does on reaches left out
//! ([`sinew::map`] is the map itself).
//!
//! The score of reach m with the parameters pₘ = W·φ(xₘ) is a function of the coefficients W, and its slopes follow from
//! those in the parameters ([`crate::refine`]) by the chain rule: gradient Σₘ gₘφₘᵀ, curvature Σₘ Hₘ ⊗ φₘφₘᵀ. So a map is
//! fitted by the same Levenberg and Marquardt's method as a reach, from one vector for all reaches up: first that vector
//! alone, then an affine map from it, then a quadratic one.
//!
//! Each degree is fitted to the recordings, and to the paths that are predicted from them ([`predict::around`]), for these
//! reaches and for others made up around them: what was so by chance in a recording is no map's business. There it costs
//! that a hand does not arrive. Of the maps about as good as the best on reaches left out, the one whose hands arrive most
//! often is kept.
//!
//! Another person's map, where one is given, is adapted by the same fit, with its coefficients drawn to what they were:
//! the fewer reaches there are, the stronger.
//!
//! Beside the maps, parameters are learned anew for the path that a reach is predicted to take ([`predict`]), from another
//! person's reaches, too, where they are given. Where that does better, the file keeps what it takes.
//!
//! Reaches that a step throws off course say little about where to go: a score beyond 10 cm counts a fifth, and a
//! slope far steeper than the others' is turned down. A small ridge keeps coefficients that nothing decides near 0.

use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{DMatrix, DVector, UnitQuaternion};
use serde::{Deserialize, Serialize};
use sinew::map::{INPUTS, MOST_TARGETS, Reach, SynergyMap, TERMS, standardised, terms};
use sinew::real::Real;
use sinew_protocol::frame::CHECK;

use crate::checkpoint::Keeper;
use crate::kernel::philox::{key, philox};
use crate::kernel::score::Ready;
use crate::learn::{Backend, Ended, GENERATIONS_A_ROUND, Inner, LearnError, Search, bests};
use crate::motion::{Point, distance};
use crate::predict::{self, Known, NEAR, same};
use crate::problem::{ModelKind, Problem, mean, with_dofs};
use crate::refine::{self, Landscape, Slope};
use crate::task::{Task, TaskError};

/// Of a score beyond this, metres, only a fifth of the rest counts while fitting.
const FAR: f64 = 0.1;
/// The weight of the squared coefficients, metres.
const RIDGE: f64 = 1e-5;
/// And of the squared differences from another person's, with one reach, metres; with n reaches, less by n³. One reach says
/// little about a map, and is not to bend it; with many, their own say more.
const KNOWN: f64 = 27.0;
/// What a metre costs that the hand does not arrive by, in fits to predicted paths.
const ARRIVAL: f32 = 1.0;
/// Of ways whose distances differ by less than this share, the one whose hands arrive most often is kept.
const AS_GOOD: f64 = 0.03;
/// Reaches' own vectors that a fold's fit begins with, to go on with the best.
const BEGINNINGS: usize = 3;
/// Steps of a fit, at most.
const MOST_STEPS: usize = 60;
/// Up to so many reaches are left out one by one; of more, in as many groups.
const MOST_FOLDS: usize = 256;
/// Learned targets that parameters are interpolated between.
const NEIGHBOURS: usize = 4;
/// The name of the trial of parameters learned for a predicted path.
const PREDICTED: &str = "learned for a predicted path";
/// Rounds of the search for one vector for all reaches.
const ROUNDS: u32 = 2;
/// Reaches that are predicted in one piece of work, where nothing is left out.
const AT_ONCE: usize = 16;

/// How a parameter depends on a reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Degree {
    /// Not at all: one vector for all.
    Constant,
    /// Affinely.
    Affine,
    /// By all products of two inputs.
    Quadratic,
}

impl Degree {
    /// All of them, the simplest first.
    pub const ALL: [Degree; 3] = [Degree::Constant, Degree::Affine, Degree::Quadratic];

    /// How many of [`terms`] there are.
    fn terms(self) -> usize {
        match self {
            Degree::Constant => 1,
            Degree::Affine => 1 + INPUTS,
            Degree::Quadratic => TERMS,
        }
    }
}

/// A learned map, as the file has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedMap {
    /// The synergy model.
    pub model: ModelKind,
    /// How parameters depend on reaches.
    pub degree: Degree,
    /// The middle of each input: the target's x, y and z in metres, and the time in seconds.
    pub centre: Vec<f64>,
    /// What each input is divided by.
    pub scale: Vec<f64>,
    /// For each parameter, the coefficients of [`sinew::map::terms`].
    pub coefficients: Vec<Vec<f64>>,
    /// Targets it was learned from: all, or as many as a map holds, spread out.
    pub targets: Vec<Point>,
    /// How far from these it is trusted, metres: as far as it was tried.
    pub radius: f64,
    /// What was tried.
    pub trials: Vec<Trial>,
    /// The name of the trial whose map this is.
    #[serde(default)]
    pub kept: String,
    /// The reaches that paths are predicted from, where parameters learned for a predicted path ([`predict`]) did better
    /// than the map: what there is time to compute for is planned so. With another person's map also the other's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reaches: Vec<predict::Reach>,
}

/// A way to find the parameters of a new reach, tried on reaches left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// In words.
    pub name: String,
    /// The mean distance on the reaches it was learned from, all of them, cm.
    pub fitted_cm: f64,
    /// The mean distance on reaches that were left out with their neighbours, cm; none where none could be left out.
    pub left_out_cm: Option<f64>,
    /// The share of these where the hand ends within 1 cm of the target.
    pub arrived: Option<f64>,
}

impl LearnedMap {
    /// The map for N DoFs, in `f64` or with each number rounded to `f32`.
    ///
    /// # Errors
    /// What the core refuses.
    pub fn build<T: Real, const N: usize>(&self) -> Result<SynergyMap<T, N>, sinew::Error> {
        let wrong = |what, expected, found| sinew::Error::WrongCount {
            what,
            expected,
            found,
        };
        let inputs = |values: &[f64]| {
            <[f64; INPUTS]>::try_from(values)
                .map(|values| values.map(T::of))
                .map_err(|_| wrong("inputs", INPUTS, values.len()))
        };
        let row = |row: &Vec<f64>| {
            <[f64; TERMS]>::try_from(row.as_slice())
                .map(|row| row.map(T::of))
                .map_err(|_| wrong("coefficients", TERMS, row.len()))
        };
        let rows = self.coefficients.iter().map(row);
        let targets = self.targets.iter().map(|target| target.map(T::of));
        SynergyMap::new(
            self.model.into(),
            inputs(&self.centre)?,
            inputs(&self.scale)?,
            &rows.collect::<Result<Vec<_>, _>>()?,
            &targets.collect::<Vec<_>>(),
            T::of(self.radius),
        )
    }

    /// Centre and scale of the inputs.
    fn standard(&self) -> ([f64; INPUTS], [f64; INPUTS]) {
        let values =
            |values: &[f64], other| std::array::from_fn(|i| *values.get(i).unwrap_or(&other));
        (values(&self.centre, 0.0), values(&self.scale, 1.0))
    }

    /// The map of people who do the same, but face another way: whatever lies in the recordings' frame is turned. A turn that
    /// does not put axes on axes has none, for terms would not stay terms.
    pub fn turned(&self, turn: &UnitQuaternion<f64>) -> Option<LearnedMap> {
        let matrix = turn.to_rotation_matrix();
        // Where each input comes from, and whether it is turned over. Time stays time.
        let mut origin = [(3, 1.0); INPUTS];
        for (r, origin) in origin.iter_mut().enumerate().take(3) {
            let on_axis = |&c: &usize| matrix[(r, c)].abs() > 1.0 - 1e-6;
            let from = (0..3).find(on_axis)?;
            *origin = (from, matrix[(r, from)].signum());
        }
        let point = |point: Point| {
            std::array::from_fn(|r| {
                let (from, sign) = origin[r];
                sign * point[from]
            })
        };
        let (centre, scale) = self.standard();
        // Which term is the product of two inputs: see `sinew::map::terms`.
        let product = |a: usize, b: usize| {
            let (more, less) = (a.max(b), a.min(b));
            1 + INPUTS + more * (more + 1) / 2 + less
        };
        let row = |row: &Vec<f64>| {
            let mut out = row.clone();
            let mut put = |to: usize, from: usize, sign: f64| {
                if let (Some(to), Some(from)) = (out.get_mut(to), row.get(from)) {
                    *to = sign * from;
                }
            };
            for (i, &(a, sign)) in origin.iter().enumerate() {
                put(1 + i, 1 + a, sign);
                for (j, &(b, other)) in origin.iter().enumerate().take(i + 1) {
                    put(product(i, j), product(a, b), sign * other);
                }
            }
            out
        };
        Some(LearnedMap {
            centre: origin.map(|(from, sign)| sign * centre[from]).to_vec(),
            scale: origin.map(|(from, _)| scale[from]).to_vec(),
            coefficients: self.coefficients.iter().map(row).collect(),
            targets: self.targets.iter().copied().map(point).collect(),
            reaches: self
                .reaches
                .iter()
                .map(|reach| reach.turned(point))
                .collect(),
            ..self.clone()
        })
    }

    /// The parameters for a reach of an arm with so many DoFs, and how far to trust them, from 0 to 1.
    ///
    /// # Errors
    /// What the core refuses.
    pub fn plan(
        &self,
        dofs: usize,
        target: Point,
        seconds: f64,
    ) -> Result<(Vec<f64>, f64), sinew::Error> {
        with_dofs!(dofs, N => {
            let planned = self.build::<f64, N>()?.plan(&Reach { target, seconds })?;
            Ok((planned.parameters.to_vec(), planned.confidence))
        }, else Err(sinew::Error::WrongCount { what: "DoFs", expected: 7, found: dofs }))
    }
}

/// Learns a map from a problem with one set a motion, of which the best parameters are known (`own`) by a `search`, and
/// tries it; with another person's map of the same model (`known`) tries that too, adapted. None where it was told to stop
/// meanwhile: the `keeper` keeps with the search what is done, and it goes on from there.
///
/// # Errors
/// A task that the core refuses.
pub fn learn(
    search: &mut Search,
    problem: &Problem,
    own: &[Vec<f64>],
    known: Option<&LearnedMap>,
    keeper: &Keeper<'_>,
) -> Result<Option<LearnedMap>, LearnError> {
    let (centre, scale) = match known {
        Some(known) => known.standard(),
        None => spread(problem),
    };
    search.work(format!("a map, {}", checksum(&(own, known))));
    let landscape = Landscape::new(problem)?;
    let fit = Fit::new(problem, &landscape, (&centre, &scale), keeper.stop);

    // The fits begin with one vector for all.
    let all: Vec<usize> = (0..problem.tasks.len()).collect();
    let jointly = jointly(problem, &all);
    let told = keeper.after("one vector for all reaches");
    let one = |search: &mut Search, keeper: &Keeper<'_>| {
        one_vector(search, &jointly, &keeper.telling(&told))
    };
    let Some(one) = search.inside(Inner::Jointly, &jointly, keeper, one)? else {
        return Ok(None);
    };
    let folds = folds(problem);
    let Some(beginnings) = fit.beginnings(search, problem, own, &folds, keeper)? else {
        return Ok(None);
    };
    let reaches = predict::reaches(problem, own)?;
    let others = known.map_or(&[][..], |known| &known.reaches);
    let seen = Known {
        own: &reaches,
        others,
    };
    let mut trials = vec![
        neighbours(problem, &landscape, own, 1)?,
        neighbours(problem, &landscape, own, NEIGHBOURS)?,
    ];
    let mut candidates: Vec<Candidate> = Vec::new();
    // Fits that begin with some weights, and how they do. False where it was told to stop.
    let mut attempt = |fit: &Fit, to: &Paths, name: String, degree: Degree, from: &mut Weights| {
        let words = format!("{name}, with {} groups left out", folds.len());
        let wider =
            |weights: &DMatrix<f64>| weights.clone().resize_horizontally(degree.terms(), 0.0);
        let matrix = |values: Vec<f64>| DMatrix::from_vec(problem.genes(), degree.terms(), values);
        let part = |fold: usize| {
            let (_, kept) = &folds[fold];
            let begin = wider(&from.parts[fold]);
            let part = fit.to(to, kept, |fit, kept| fit.descend(begin, kept))?;
            Ok(part.map(|part| part.as_slice().to_vec()))
        };
        let parts = search.pieces(keeper, &words, folds.len(), part)?;
        let Some(parts) = parts else {
            return Ok(false);
        };
        let parts: Vec<DMatrix<f64>> = parts.into_iter().map(matrix).collect();
        // Fits end in different valleys: that to all goes on from the best of the folds' if that is better.
        let whole = |_| {
            let whole = fit.to(to, &all, |fit, all| {
                let whole = fit.descend(wider(&from.whole), all)?;
                let others = parts.iter().map(|part| (fit.cost(part, all), part));
                match others.min_by(|a, b| a.0.total_cmp(&b.0)) {
                    Some((cost, part)) if cost < fit.cost(&whole, all) => {
                        fit.descend(part.clone(), all)
                    }
                    _ => Some(whole),
                }
            })?;
            Ok(whole.map(|whole| whole.as_slice().to_vec()))
        };
        let whole = search.pieces(keeper, &format!("{name}, of all"), 1, whole)?;
        let Some(whole) = whole.and_then(|all| all.into_iter().next()) else {
            return Ok(false);
        };
        from.whole = matrix(whole);
        from.parts = parts;
        let mut scored = Vec::new();
        for ((left_out, _), part) in folds.iter().zip(&from.parts) {
            scored.extend(fit.points(part, left_out));
        }
        let fitted = fit.points(&from.whole, &all);
        candidates.push(Candidate {
            trial: trial(problem, &landscape, name, &fitted, &scored)?,
            degree,
            weights: from.whole.clone(),
            adapted: fit.known.is_some(),
        });
        Ok::<bool, LearnError>(true)
    };
    if let Some(known) = known {
        let weights = weights(problem, known);
        let with = fit.drawn_to(weights.clone());
        let degree = known.degree.max(Degree::Affine);
        let mut from = Weights {
            parts: vec![weights.clone(); folds.len()],
            whole: weights,
        };
        let name = "another's map, adapted".to_owned();
        if !attempt(&with, &Paths::Recorded, name, degree, &mut from)? {
            return Ok(None);
        }
    }
    // Each degree's fits go on from those of the degree before.
    let mut from = Weights {
        whole: one,
        parts: beginnings,
    };
    let mut from_predicted = from.clone();
    for degree in Degree::ALL {
        // What cannot be tried is kept simple.
        if folds.is_empty() && (known.is_some() || degree > Degree::Constant) {
            break;
        }
        let name = format!("{degree:?} map").to_lowercase();
        let name_predicted = format!("{name} for predicted paths");
        let predicted = Paths::Predicted { problem, seen };
        if !attempt(&fit, &Paths::Recorded, name, degree, &mut from)?
            || !folds.is_empty()
                && !attempt(
                    &fit,
                    &predicted,
                    name_predicted,
                    degree,
                    &mut from_predicted,
                )?
        {
            return Ok(None);
        }
    }
    trials.extend(candidates.iter().map(|candidate| candidate.trial.clone()));
    let at_once = all.chunks(AT_ONCE);
    let whole: Vec<Fold> = at_once.map(|some| (some.to_vec(), all.clone())).collect();
    let fitted = predicted(search, problem, seen, PREDICTED, &whole, keeper)?;
    let part = format!("{PREDICTED}, with {} groups left out", folds.len());
    let scored = predicted(search, problem, seen, &part, &folds, keeper)?;
    let (Some(fitted), Some(scored)) = (fitted, scored) else {
        return Ok(None);
    };
    let name = PREDICTED.to_owned();
    let predicted = trial(problem, &landscape, name, &fitted, &scored)?;
    trials.push(predicted.clone());
    let Some(Candidate {
        trial: kept,
        degree,
        weights,
        adapted,
        ..
    }) = chosen(candidates)
    else {
        return Ok(None);
    };
    // Where another's map serves best, these recordings alone say nothing of a path; the other's may.
    let predicts = match (predicted.left_out_cm, kept.left_out_cm) {
        (Some(predicted), Some(kept)) => predicted < kept && !(adapted && others.is_empty()),
        _ => !others.is_empty(),
    };
    let own = problem.tasks.iter().map(|task| task.target);
    let mut targets = spread_out(own.collect());
    let mut radius = gap(problem, &folds).max(NEAR);
    if let Some(known) = known.filter(|_| adapted) {
        // It is still good where it was.
        let room = MOST_TARGETS - targets.len();
        targets.extend(known.targets.iter().take(room));
        radius = radius.max(known.radius);
    }

    let bounds = problem.settings.bounds(problem.dofs());
    let row = |(k, &(lower, upper)): (usize, &(f32, f32))| {
        let (lower, width) = (f64::from(lower), f64::from(upper - lower));
        let coefficient = |j: usize| match j {
            0 => lower + width * weights[(k, 0)],
            j if j < weights.ncols() => width * weights[(k, j)],
            _ => 0.0,
        };
        (0..TERMS).map(coefficient).collect()
    };
    Ok(Some(LearnedMap {
        model: problem.settings.model,
        degree,
        centre: centre.to_vec(),
        scale: scale.to_vec(),
        coefficients: bounds.iter().enumerate().map(row).collect(),
        targets,
        radius,
        trials,
        kept: kept.name,
        reaches: match predicts {
            true => [&reaches[..], others].concat(),
            false => Vec::new(),
        },
    }))
}

/// What a map is fitted to.
enum Paths<'a> {
    /// The recordings.
    Recorded,
    /// The paths predicted from them.
    Predicted {
        problem: &'a Problem,
        seen: Known<'a>,
    },
}

/// A fitted map, and how it does.
struct Candidate {
    trial: Trial,
    degree: Degree,
    weights: DMatrix<f64>,
    /// Whether it is another's, adapted.
    adapted: bool,
}

/// The candidate that is kept: of those within [`AS_GOOD`] of the least distance, the one whose hands arrive most often.
fn chosen(candidates: Vec<Candidate>) -> Option<Candidate> {
    // Where none could be left out, what was fitted has to do.
    let score = |candidate: &Candidate| {
        candidate
            .trial
            .left_out_cm
            .unwrap_or(candidate.trial.fitted_cm)
    };
    let scores = candidates.iter().map(score);
    let limit = scores.fold(f64::INFINITY, f64::min) * (1.0 + AS_GOOD);
    let good = candidates
        .into_iter()
        .filter(|candidate| score(candidate) <= limit);
    good.min_by(|a, b| {
        let arrived = |candidate: &Candidate| candidate.trial.arrived.unwrap_or_default();
        let by_score = score(a).total_cmp(&score(b));
        arrived(b).total_cmp(&arrived(a)).then(by_score)
    })
}

/// Weights fitted to all reaches, and for each fold to those that it keeps.
#[derive(Clone)]
struct Weights {
    whole: DMatrix<f64>,
    parts: Vec<DMatrix<f64>>,
}

/// What tells one thing from another: Debug prints every number with all its digits.
fn checksum(of: &impl Debug) -> u32 {
    CHECK.checksum(format!("{of:?}").as_bytes())
}

/// The search for one vector for some reaches together.
fn jointly(problem: &Problem, reaches: &[usize]) -> Problem {
    let tasks = reaches.iter().map(|&reach| problem.tasks[reach].clone());
    Problem {
        tasks: tasks.collect(),
        sets: vec![(0..reaches.len()).collect()],
        islands: 1,
        ..problem.clone()
    }
}

/// The best vector that some rounds of a search find for reaches together, as weights of the first term. Fits go on from
/// there: the search's end has no part in it.
fn one_vector(
    search: &mut Search,
    jointly: &Problem,
    keeper: &Keeper<'_>,
) -> Result<Option<DMatrix<f64>>, LearnError> {
    let most = ROUNDS * GENERATIONS_A_ROUND;
    if search.run(jointly, &mut Backend::Cpu, most, keeper, |_| {})? == Ended::Stopped {
        return Ok(None);
    }
    let best = bests(&search.islands, jointly.islands);
    let best = best.first().map(|(genes, _)| refine::shares(genes));
    let best = best.unwrap_or_else(|| vec![0.0; jointly.genes()]);
    let best = best.into_iter().map(f64::from);
    Ok(Some(DMatrix::from_iterator(jointly.genes(), 1, best)))
}

/// What so many of a person's reaches are good for, with another person's map and without: mean distances of the reaches
/// that were not used, cm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transfer {
    /// How many reaches were learned from.
    pub reaches: usize,
    /// Learned for paths predicted from the other person's reaches and these, where the other's file has its reaches.
    pub predicted_cm: Option<f64>,
    /// The other person's map, adapted to them.
    pub adapted_cm: f64,
    /// From them alone: one vector, an affine map, and learned for predicted paths.
    pub alone_cm: Option<[f64; 3]>,
}

impl Transfer {
    /// The distances in the order of a table's columns: with the other person's, predicted and adapted, then alone,
    /// predicted, affine and one vector.
    pub fn columns(&self) -> [Option<f64>; 5] {
        let [one, affine, predicted] = self.alone_cm.map_or([None; 3], |cm| cm.map(Some));
        let adapted = Some(self.adapted_cm);
        [self.predicted_cm, adapted, predicted, affine, one]
    }
}

/// Times that reaches are chosen to learn from.
const CHOICES: u32 = 6;

/// Learns from 1, 2, … up to `most` reaches of a person, with the `known` map of another and without it, and tries what
/// was learned on the person's other reaches, also beyond where it is to be trusted; means over a few choices of reaches.
/// With 0 reaches: the known map's polynomial as it is. The `search` for each reach's own parameters, which predictions
/// begin with, runs so many `generations` at most. None where it was told to stop meanwhile: the `keeper` keeps with the
/// search what is done, and it goes on from there.
///
/// # Errors
/// A task that the core refuses.
pub fn transfer(
    search: &mut Search,
    problem: &Problem,
    known: &LearnedMap,
    most: usize,
    generations: u32,
    keeper: &Keeper<'_>,
) -> Result<Option<Vec<Transfer>>, LearnError> {
    let stop = keeper.stop;
    let (centre, scale) = known.standard();
    let weights = weights(problem, known);
    let landscape = Landscape::new(problem)?;
    let alone = Fit::new(problem, &landscape, (&centre, &scale), stop);
    let with = alone.drawn_to(weights.clone());
    let count = problem.tasks.len();
    let all: Vec<usize> = (0..count).collect();
    let most = most.min(count.saturating_sub(1));
    let told = keeper.after("each reach by itself");
    let Some(winners) = search.end(problem, generations, &keeper.telling(&told))? else {
        return Ok(None);
    };
    let own: Vec<Vec<f64>> = winners.into_iter().map(|one| one.parameters).collect();
    search.work(format!("a transfer, {}", checksum(&(&own, known))));
    let reaches = predict::reaches(problem, &own)?;
    // A choice is a shuffle by draws, of which the first reaches are used.
    let folds = |used: usize| -> Vec<Fold> {
        let choice = |choice: u32| {
            let mut order = all.clone();
            order.sort_by_key(|&reach| philox([reach as u32, choice, 0, !0], key(problem.seed)));
            let others = order.split_off(used);
            (others, order)
        };
        (0..CHOICES).map(choice).collect()
    };
    let mut out = Vec::new();
    for used in 0..=most {
        let folds = match used {
            0 => folds(0)[..1].to_vec(),
            used => folds(used),
        };
        // The mean distance of what is predicted for the reaches left out of each choice.
        let mut mean_predicted = |part: &str, others: &[predict::Reach]| {
            let seen = Known {
                own: &reaches,
                others,
            };
            let part = format!("{used} reaches, predicted {part}");
            let points = predicted(search, problem, seen, &part, &folds, keeper)?;
            Ok::<_, LearnError>(points.map(|points| 100.0 * mean_at(&landscape, &points)))
        };
        let predicted_cm = match known.reaches[..] {
            [] => None,
            _ => match mean_predicted("with others", &known.reaches)? {
                Some(cm) => Some(cm),
                None => return Ok(None),
            },
        };
        if used == 0 {
            out.push(Transfer {
                reaches: 0,
                predicted_cm,
                adapted_cm: 100.0 * with.mean(&weights, &all),
                alone_cm: None,
            });
            continue;
        }
        let Some(predicted_alone) = mean_predicted("alone", &[])? else {
            return Ok(None);
        };
        // Adapted, affine, and one vector.
        let fitted = |choice: usize| {
            let (others, used) = &folds[choice];
            let jointly = jointly(problem, used);
            let mut search = Search::new(&jointly);
            let one = one_vector(&mut search, &jointly, &Keeper::new(stop, None))?;
            let Some(one) = one else {
                return Ok(None);
            };
            let wider = one.clone().resize_horizontally(1 + INPUTS, 0.0);
            let affine = alone.descend(wider, used);
            let degree = known.degree.max(Degree::Affine);
            let wider = weights.clone().resize_horizontally(degree.terms(), 0.0);
            let adapted = with.descend(wider, used);
            Ok(affine.zip(adapted).map(|(affine, adapted)| {
                let adapted = with.mean(&adapted, others);
                let [affine, one] = [&affine, &one].map(|weights| alone.mean(weights, others));
                [adapted, affine, one]
            }))
        };
        let part = format!("{used} reaches, fitted");
        let Some(fitted) = search.pieces(keeper, &part, folds.len(), fitted)? else {
            return Ok(None);
        };
        let mean_cm = |k: usize| 100.0 * mean(fitted.iter().map(|fitted: &[f64; 3]| fitted[k]));
        out.push(Transfer {
            reaches: used,
            predicted_cm,
            adapted_cm: mean_cm(0),
            alone_cm: Some([mean_cm(2), mean_cm(1), predicted_alone]),
        });
    }
    Ok(Some(out))
}

/// A map's coefficients as shares of the bounds.
fn weights(problem: &Problem, map: &LearnedMap) -> DMatrix<f64> {
    let bounds = problem.settings.bounds(problem.dofs());
    DMatrix::from_fn(bounds.len(), map.degree.terms(), |k, j| {
        let (lower, upper) = bounds[k];
        let written = map.coefficients.get(k).and_then(|row| row.get(j));
        let coefficient =
            written.copied().unwrap_or_default() - if j == 0 { f64::from(lower) } else { 0.0 };
        coefficient / f64::from(upper - lower)
    })
}

/// What a map looks at.
fn inputs(problem: &Problem, task: &Task) -> [f64; INPUTS] {
    let [x, y, z] = task.target;
    [x, y, z, problem.seconds(task)]
}

/// Mean and standard deviation of each input; 1 where an input is always the same.
fn spread(problem: &Problem) -> ([f64; INPUTS], [f64; INPUTS]) {
    let each = problem.tasks.iter().map(|task| inputs(problem, task));
    let inputs: Vec<[f64; INPUTS]> = each.collect();
    let count = inputs.len().max(1) as f64;
    let mean: [f64; INPUTS] =
        std::array::from_fn(|i| inputs.iter().map(|x| x[i]).sum::<f64>() / count);
    let deviation = std::array::from_fn(|i| {
        let square: f64 = inputs.iter().map(|x| (x[i] - mean[i]).powi(2)).sum();
        let deviation = (square / count).sqrt();
        if deviation > 1e-6 { deviation } else { 1.0 }
    });
    (mean, deviation)
}

/// Parameters as shares of their bounds.
fn shares(problem: &Problem, parameters: &[f64]) -> Vec<f64> {
    let bounds = problem.settings.bounds(problem.dofs());
    let share = |(&p, (lower, upper)): (&f64, (f32, f32))| {
        (p - f64::from(lower)) / f64::from(upper - lower)
    };
    parameters.iter().zip(bounds).map(share).collect()
}

/// What a score counts while fitting.
fn counted(score: f32) -> f64 {
    let score = f64::from(score);
    score.min(FAR) + 0.2 * (score - FAR).max(0.0)
}

/// A reach, and parameters that are tried on it, as shares of their bounds.
type Tried = (usize, Vec<f32>);

/// A group of reaches that is left out, and the reaches that are kept: those far from all of the group's targets.
type Fold = (Vec<usize>, Vec<usize>);

fn folds(problem: &Problem) -> Vec<Fold> {
    let count = problem.tasks.len();
    let groups = count.min(MOST_FOLDS);
    let group = |g: usize| {
        let left_out: Vec<usize> = (g..count).step_by(groups.max(1)).collect();
        let target = |reach: usize| problem.tasks[reach].target;
        let far = |&reach: &usize| {
            left_out
                .iter()
                .all(|&other| !same(target(reach), target(other)))
        };
        let kept: Vec<usize> = (0..count).filter(far).collect();
        (left_out, kept)
    };
    let folds = (0..groups).map(group);
    folds.filter(|(_, kept)| !kept.is_empty()).collect()
}

/// The furthest that a reach left out was from all that were kept, metres.
fn gap(problem: &Problem, folds: &[Fold]) -> f64 {
    let target = |reach: usize| problem.tasks[reach].target;
    let gaps = folds.iter().flat_map(|(left_out, kept)| {
        left_out.iter().map(move |&reach| {
            let away = kept
                .iter()
                .map(|&other| distance(target(reach), target(other)));
            away.fold(f64::INFINITY, f64::min)
        })
    });
    gaps.fold(0.0, f64::max)
}

/// The parameters of the nearest learned targets, of those that are not [`same`]: of so many, each weighted by the
/// inverse square of how far it is (Shepard 1968).
fn neighbours(
    problem: &Problem,
    landscape: &Landscape<'_>,
    own: &[Vec<f64>],
    most: usize,
) -> Result<Trial, TaskError> {
    let count = problem.tasks.len();
    let target = |reach: usize| problem.tasks[reach].target;
    let away = |a: usize, b: usize| distance(target(a), target(b));
    let own: Vec<Vec<f64>> = own.iter().map(|own| shares(problem, own)).collect();
    let point = |values: &[f64]| values.iter().map(|&share| share as f32).collect();
    let between = |reach: usize| {
        let mut others: Vec<usize> = (0..count)
            .filter(|&other| !same(target(reach), target(other)))
            .collect();
        others.sort_by(|&a, &b| away(reach, a).total_cmp(&away(reach, b)));
        others.truncate(most);
        let weight = |other: usize| away(reach, other).powi(-2);
        let total: f64 = others.iter().map(|&other| weight(other)).sum();
        let mut sum = vec![0.0; problem.genes()];
        for &other in &others {
            for (sum, share) in sum.iter_mut().zip(&own[other]) {
                *sum += share * weight(other) / total;
            }
        }
        (!others.is_empty()).then(|| (reach, point(&sum)))
    };
    let fitted: Vec<Tried> = (0..count).map(|m| (m, point(&own[m]))).collect();
    let scored: Vec<Tried> = (0..count).filter_map(between).collect();
    let name = match most {
        1 => "nearest learned target".to_owned(),
        _ => format!("between {most} nearest"),
    };
    trial(problem, landscape, name, &fitted, &scored)
}

/// Parameters learned for paths predicted from the other reaches, for the reaches that each fold leaves out: a part of the
/// search's work. None where it was told to stop meanwhile.
fn predicted(
    search: &mut Search,
    problem: &Problem,
    seen: Known<'_>,
    part: &str,
    folds: &[Fold],
    keeper: &Keeper<'_>,
) -> Result<Option<Vec<Tried>>, LearnError> {
    let stop = keeper.stop;
    let left_out = |fold: usize| {
        let (left_out, kept) = &folds[fold];
        Ok(predict::left_out(problem, seen, left_out, kept, stop)?)
    };
    let found = search.pieces(keeper, part, folds.len(), left_out)?;
    let reaches = folds.iter().flat_map(|(left_out, _)| left_out.clone());
    let point = |(reach, parameters): (usize, Vec<f64>)| {
        let shares = shares(problem, &parameters);
        (reach, shares.iter().map(|&share| share as f32).collect())
    };
    Ok(found.map(|found| reaches.zip(found.concat()).map(point).collect()))
}

/// How a way does: the points of all reaches as they were learned, and of those left out.
fn trial(
    problem: &Problem,
    landscape: &Landscape<'_>,
    name: String,
    fitted: &[Tried],
    scored: &[Tried],
) -> Result<Trial, TaskError> {
    let bounds = problem.settings.bounds(problem.dofs());
    let mut arrived = 0;
    for (reach, point) in scored {
        let task = &problem.tasks[*reach];
        let parameters: Vec<f64> = point
            .iter()
            .zip(&bounds)
            .map(|(&share, &(lower, upper))| f64::from(lower + (upper - lower) * share))
            .collect();
        let dofs = problem.dofs();
        let tip = with_dofs!(dofs, N => {
            let ready = Ready::<f64, N>::new(task)?;
            let frames = task.reference.len();
            // Refused parameters do not arrive.
            ready.synthesise(&problem.settings, &parameters, frames, |_, _, _| {}).unwrap_or([f64::INFINITY; 3])
        }, else return Err(TaskError::Dofs { found: dofs }));
        arrived += usize::from(distance(tip, task.target) <= 0.01);
    }
    let left_out = (!scored.is_empty()).then_some(scored);
    Ok(Trial {
        name,
        fitted_cm: 100.0 * mean_at(landscape, fitted),
        left_out_cm: left_out.map(|scored| 100.0 * mean_at(landscape, scored)),
        arrived: left_out.map(|scored| arrived as f64 / scored.len() as f64),
    })
}

/// The mean distance at some points, metres.
fn mean_at(landscape: &Landscape<'_>, points: &[Tried]) -> f64 {
    let scores = landscape.scores_at(points);
    mean(scores.into_iter().map(f64::from))
}

/// The targets, or as many as a map holds, each as far from those before it as can be.
fn spread_out(targets: Vec<Point>) -> Vec<Point> {
    let mut left = targets;
    let mut out = Vec::new();
    while out.len() < MOST_TARGETS && !left.is_empty() {
        let away = |point: &Point| {
            let each = out.iter().map(|&known| distance(known, *point));
            each.fold(f64::INFINITY, f64::min)
        };
        let furthest = (0..left.len())
            .max_by(|&a, &b| away(&left[a]).total_cmp(&away(&left[b])))
            .unwrap_or(0);
        let point = left.swap_remove(furthest);
        out.push(point);
    }
    out
}

/// The reaches that maps are fitted to.
#[derive(Clone)]
struct Fit<'a> {
    landscape: &'a Landscape<'a>,
    /// The inputs' centre and scale.
    centre: &'a [f64; INPUTS],
    scale: &'a [f64; INPUTS],
    /// Each reach's terms.
    terms: Vec<Vec<f64>>,
    /// What coefficients are drawn to, where it is not to 0.
    known: Option<DMatrix<f64>>,
    stop: &'a AtomicBool,
}

impl<'a> Fit<'a> {
    fn new(
        problem: &Problem,
        landscape: &'a Landscape<'a>,
        (centre, scale): (&'a [f64; INPUTS], &'a [f64; INPUTS]),
        stop: &'a AtomicBool,
    ) -> Self {
        let terms = |task| terms(&standardised(&inputs(problem, task), centre, scale)).to_vec();
        Fit {
            landscape,
            centre,
            scale,
            terms: problem.tasks.iter().map(terms).collect(),
            known: None,
            stop,
        }
    }

    /// Calls `with` with this fit to some reaches, or one to the paths predicted from these, and with their numbers there.
    ///
    /// # Errors
    /// A task that the core refuses.
    fn to<R>(
        &self,
        paths: &Paths<'_>,
        reaches: &[usize],
        with: impl FnOnce(&Fit<'_>, &[usize]) -> R,
    ) -> Result<R, TaskError> {
        match paths {
            Paths::Predicted { problem, seen } => {
                let made = predict::around(problem, *seen, reaches);
                let landscape = Landscape::arriving(&made, ARRIVAL)?;
                let all: Vec<usize> = (0..made.tasks.len()).collect();
                let fit = Fit::new(&made, &landscape, (self.centre, self.scale), self.stop);
                Ok(with(&fit, &all))
            }
            Paths::Recorded => Ok(with(self, reaches)),
        }
    }

    /// For each fold a vector for the reaches that it keeps, which has seen no other: the best of their own vectors that
    /// serve them all best, descended from. A part of the search's work; none where it was told to stop meanwhile.
    fn beginnings(
        &self,
        search: &mut Search,
        problem: &Problem,
        own: &[Vec<f64>],
        folds: &[Fold],
        keeper: &Keeper<'_>,
    ) -> Result<Option<Vec<DMatrix<f64>>>, LearnError> {
        let count = problem.tasks.len();
        let vectors: Vec<Vec<f64>> = own.iter().map(|own| shares(problem, own)).collect();
        let pairs = (0..count).flat_map(|reach| (0..count).map(move |vector| (vector, reach)));
        let asked: Vec<Tried> = pairs
            .map(|(vector, reach)| {
                let point = vectors[vector].iter().map(|&share| share as f32);
                (reach, point.collect())
            })
            .collect();
        let scores = self.landscape.scores_at(&asked);
        let beginning = |fold: usize| {
            let (_, kept) = &folds[fold];
            let all = |vector: usize| -> f64 {
                let each = kept
                    .iter()
                    .map(|&reach| counted(scores[reach * count + vector]));
                each.sum()
            };
            let mut order: Vec<(f64, usize)> = kept.iter().map(|&v| (all(v), v)).collect();
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
            let descended = order.iter().take(BEGINNINGS).map(|&(_, vector)| {
                let start = DMatrix::from_column_slice(vectors[vector].len(), 1, &vectors[vector]);
                let found = self.descend(start, kept)?;
                Some((self.cost(&found, kept), found))
            });
            let descended: Option<Vec<_>> = descended.collect();
            let best = |all: Vec<(f64, DMatrix<f64>)>| {
                let best = all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
                best.map_or(vec![0.0; problem.genes()], |(_, found)| {
                    found.as_slice().to_vec()
                })
            };
            Ok(descended.map(best))
        };
        let found = search.pieces(keeper, "where fits begin", folds.len(), beginning)?;
        let matrix = |values: Vec<f64>| DMatrix::from_vec(problem.genes(), 1, values);
        Ok(found.map(|found| found.into_iter().map(matrix).collect()))
    }

    /// The same with coefficients drawn to these.
    fn drawn_to(&self, known: DMatrix<f64>) -> Self {
        Fit {
            known: Some(known),
            ..self.clone()
        }
    }

    /// The parameters of a reach, as shares of their bounds.
    fn at(&self, weights: &DMatrix<f64>, reach: usize) -> Vec<f32> {
        let terms = DVector::from_column_slice(&self.terms[reach][..weights.ncols()]);
        let shares = weights * terms;
        shares
            .iter()
            .map(|share| share.clamp(0.0, 1.0) as f32)
            .collect()
    }

    fn points(&self, weights: &DMatrix<f64>, reaches: &[usize]) -> Vec<Tried> {
        let point = |&reach: &usize| (reach, self.at(weights, reach));
        reaches.iter().map(point).collect()
    }

    /// The mean distance, metres.
    fn mean(&self, weights: &DMatrix<f64>, reaches: &[usize]) -> f64 {
        mean_at(self.landscape, &self.points(weights, reaches))
    }

    /// What is made small.
    fn cost(&self, weights: &DMatrix<f64>, reaches: &[usize]) -> f64 {
        let scores = self.landscape.scores_at(&self.points(weights, reaches));
        let (pull, first) = self.pull(reaches);
        let away = weights - self.known(weights.shape());
        mean(scores.into_iter().map(counted)) + pull * away.columns_range(first..).norm_squared()
    }

    /// The weight of squared coefficients (of their differences from what is known, where something is), and the first
    /// column that it is on.
    fn pull(&self, reaches: &[usize]) -> (f64, usize) {
        match self.known {
            Some(_) => (KNOWN / (reaches.len().max(1) as f64).powi(3), 0),
            None => (RIDGE, 1),
        }
    }

    fn known(&self, (rows, columns): (usize, usize)) -> DMatrix<f64> {
        match &self.known {
            Some(known) => known.clone().resize_horizontally(columns, 0.0),
            None => DMatrix::zeros(rows, columns),
        }
    }

    /// Levenberg and Marquardt's steps from these weights, until they gain nothing. None where `stop` was set meanwhile.
    fn descend(&self, weights: DMatrix<f64>, reaches: &[usize]) -> Option<DMatrix<f64>> {
        let (rows, columns) = weights.shape();
        let mut weights = weights;
        let mut least = self.cost(&weights, reaches);
        let mut damping = 1e-2;
        let mut idle = 0;
        for _ in 0..MOST_STEPS {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            if idle > 3 {
                break;
            }
            let slope = self.slope(&weights, reaches);
            let before = least;
            for _ in 0..8 {
                let mut matrix = slope.curvature.clone();
                for a in 0..rows * columns {
                    matrix[(a, a)] += damping * slope.scale[a].max(1e-7);
                }
                if let Some(factors) = matrix.cholesky() {
                    let step = factors.solve(&-&slope.gradient);
                    let next = DMatrix::from_fn(rows, columns, |k, j| {
                        weights[(k, j)] + step[k * columns + j]
                    });
                    let cost = self.cost(&next, reaches);
                    if cost < least {
                        (weights, least) = (next, cost);
                        damping = (damping * 0.3).max(1e-6);
                        break;
                    }
                }
                damping *= 5.0;
            }
            idle = if before - least > 1e-4 * least {
                0
            } else {
                idle + 1
            };
        }
        Some(weights)
    }

    /// The slope of the cost; row k's coefficient j is number k·columns + j.
    fn slope(&self, weights: &DMatrix<f64>, reaches: &[usize]) -> Slope {
        let (rows, columns) = weights.shape();
        let size = rows * columns;
        let points = self.points(weights, reaches);
        let slopes = self.landscape.slopes_at(&points);
        let mut steep: Vec<f64> = slopes.iter().map(|slope| slope.scale.sum()).collect();
        let each = steep.clone();
        steep.sort_by(f64::total_cmp);
        let usual = steep.get(steep.len() / 2).copied().unwrap_or(1.0);
        let mut curvature = DMatrix::zeros(size, size);
        let (mut gradient, mut scale) = (DVector::zeros(size), DVector::zeros(size));
        for (((reach, point), slope), steepness) in points.iter().zip(&slopes).zip(&each) {
            let share = (3.0 * usual / steepness.max(1e-12)).min(1.0) / points.len().max(1) as f64;
            let terms = &self.terms[*reach][..columns];
            // A parameter on its bound that is pushed further has no slope.
            let free: Vec<usize> = (0..rows)
                .filter(|&k| {
                    let (at, slope) = (point[k], slope.gradient[k]);
                    !((at <= 0.0 && slope > 0.0) || (at >= 1.0 && slope < 0.0))
                })
                .collect();
            for &k in &free {
                for (j, term) in terms.iter().enumerate() {
                    let a = k * columns + j;
                    gradient[a] += share * slope.gradient[k] * term;
                    scale[a] += share * slope.scale[k] * term * term;
                    for &l in &free {
                        let bend = share * slope.curvature[(k, l)] * term;
                        for (i, other) in terms.iter().enumerate() {
                            curvature[(a, l * columns + i)] += bend * other;
                        }
                    }
                }
            }
        }
        let ((pull, first), known) = (self.pull(reaches), self.known((rows, columns)));
        for k in 0..rows {
            for j in first..columns {
                let a = k * columns + j;
                gradient[a] += 2.0 * pull * (weights[(k, j)] - known[(k, j)]);
                curvature[(a, a)] += 2.0 * pull;
            }
        }
        Slope {
            gradient,
            curvature,
            scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::{Checkpoint, Kept, stopped_often};
    use crate::problem::StepperKind;
    use nalgebra::Vector3;
    use std::time::Instant;

    #[test]
    fn however_often_it_is_stopped_a_map_ends_as_if_it_never_was() {
        let problem = Problem {
            islands: 1,
            ..Problem::of_sample(&[0, 3, 6, 9, 12], StepperKind::PseudoInverse, ModelKind::A)
        };
        let map = |search: &mut Search, keeper: &Keeper<'_>| {
            // All of it, as the program does when it goes on.
            let won = search.end(&problem, 64, keeper).unwrap()?;
            let own: Vec<Vec<f64>> = won.into_iter().map(|one| one.parameters).collect();
            learn(search, &problem, &own, None, keeper).unwrap()
        };
        let began = Instant::now();
        let mut search = Search::new(&problem);
        let whole = map(&mut search, &Keeper::default()).unwrap();
        let took = began.elapsed();

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("learning.checkpoint");
        let checkpoint = Checkpoint::new(file, &problem, "cpu");
        let mut search = Search::new(&problem);
        let (found, stops) = stopped_often(&mut search, took, |search, stop| {
            if let Kept::Search(kept) = checkpoint.read() {
                *search = *kept;
            }
            map(search, &Keeper::new(stop, Some(&checkpoint)))
        });
        assert!(stops > 5, "{stops}");
        assert_eq!(found, whole);
    }

    #[test]
    fn a_turned_map_plans_for_a_turned_target_what_the_map_does_for_the_target() {
        let number = |k: usize| (7.3 * k as f64 + 0.4).sin();
        let target = [0.1, 0.4, -0.2];
        let map = LearnedMap {
            model: ModelKind::B,
            degree: Degree::Quadratic,
            centre: vec![0.1, 0.3, -0.1, 0.9],
            scale: vec![0.1, 0.2, 0.15, 0.1],
            coefficients: (0..7)
                .map(|row| (0..TERMS).map(|k| 0.1 * number(20 * row + k)).collect())
                .collect(),
            targets: vec![target],
            radius: 0.3,
            trials: Vec::new(),
            kept: String::new(),
            reaches: vec![predict::Reach {
                outset: predict::Outset {
                    start: vec![[0.0; 3], target],
                    target,
                    seconds: 1.0,
                },
                path: vec![vec![[1.0, 2.0, 3.0]]],
                parameters: vec![1.0; 7],
            }],
        };
        let asked = [0.15, 0.35, -0.1];
        let expected = map.plan(7, asked, 0.95).unwrap();
        for quarters in 0..4 {
            let angle = f64::from(quarters) * std::f64::consts::FRAC_PI_2;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let turned = map.turned(&turn).unwrap();
            let there: Point = (turn * Vector3::from(asked)).into();
            let planned = turned.plan(7, there, 0.95).unwrap();
            for (a, b) in planned.0.iter().zip(&expected.0) {
                assert!((a - b).abs() < 1e-9, "{a} {b}");
            }
            assert!((planned.1 - expected.1).abs() < 1e-9);
            let reach = &turned.reaches[0];
            for (found, point) in [
                (reach.path[0][0], [1.0, 2.0, 3.0]),
                (reach.outset.target, target),
                (reach.outset.start[1], target),
                (turned.targets[0], target),
            ] {
                assert!((Vector3::from(found) - turn * Vector3::from(point)).norm() < 1e-9);
            }
        }
        assert_eq!(map.turned(&UnitQuaternion::identity()), Some(map.clone()));
        let odd = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
        assert_eq!(map.turned(&odd), None);
    }
}
