//! Composes the GPU's code from the `.wgsl` pieces beside this file, for one structure of arm, one stepper and one
//! synergy model.
//!
//! The pieces are templates: `${…}` is replaced, and lines that begin with `//%` unroll loops over DoFs, genes and
//! landmarks, or leave out what the arm does not have. What comes out is straight-line code without an indexed array
//! in the hot path (measured on lavapipe: 1.5 to 10 times faster than loops over arrays).
//!
//! The arm's *structure* is written into the code: which axis each DoF moves about, which of its offsets are not zero,
//! whether a fixed turn is left. Its *numbers*, which differ from motion to motion, are read from a buffer.
//!
//! The build script includes this file too, so it knows of nothing but the core and the proposals' constants.

use std::fmt;

use minijinja::syntax::SyntaxConfig;
use minijinja::{Environment, UndefinedBehavior, context};
use serde::Serialize;
use sinew::chain::{Chain, Kind, MOST_LENGTH, Shift, Turn};
use sinew::math::MOST_ANGLE;
use sinew::stepper::AnyStepper;
use sinew::synergy::Model;

use super::proposal::{GENE, ISLAND};

/// What every motion of a problem shares: all that is written into the code.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Structure {
    dofs: usize,
    genes: usize,
    stepper: &'static str,
    model: &'static str,
    /// Whether the base frame is anything but the origin and its axes.
    base: bool,
    links: Vec<Link>,
    /// The components of the tip's offset that there are.
    tip: Vec<usize>,
    /// The DoFs whose origins are landmarks.
    landmarks: Vec<usize>,
    /// Landmarks and the tip.
    points: usize,
    /// How many of them, from the first on, are not compared: see [`beyond`](Structure::beyond).
    still: usize,
    /// Fours of numbers that a recorded frame takes.
    frame_fours: usize,
    /// Whether ticks keep within the joint limits.
    clamped: bool,
    /// The bounds of each parameter, as WGSL.
    bounds: Vec<(String, String)>,
    /// The layout of a motion's own numbers.
    numbers: Vec<Number>,
    /// Fours that they take.
    arm_fours: usize,
}

/// A DoF.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Link {
    /// The axis it moves about or along, and whether that points the other way.
    axis: usize,
    flip: bool,
    revolute: bool,
    /// Its turn moves this axis towards that one.
    from: usize,
    to: usize,
    /// The components of its offset that there are.
    shift: Vec<usize>,
    /// Whether a fixed rotation comes before it.
    turn: bool,
    /// Its limits, as WGSL.
    lower: String,
    upper: String,
}

/// A number, or three, of a motion's own.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Number {
    name: String,
    r#type: &'static str,
    at: usize,
    count: usize,
}

/// How a member moves the arm: what is not the arm's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    /// The inverse kinematics. Its settings must be the defaults.
    pub stepper: AnyStepper<f32>,
    /// The synergy.
    pub model: Model,
    /// Whether ticks keep within the joint limits.
    pub clamped: bool,
}

impl Method {
    /// The piece that has the stepper, without its ending.
    pub fn stepper_name(&self) -> &'static str {
        match self.stepper {
            AnyStepper::Transpose(_) => "transpose",
            AnyStepper::NormalisedTranspose(_) => "normalised_transpose",
            AnyStepper::PseudoInverse(_) => "pseudo_inverse",
            AnyStepper::Damped(_) => "damped",
            AnyStepper::SelectivelyDamped(_) => "selectively_damped",
        }
    }

    /// The model's letter.
    pub fn model_name(&self) -> &'static str {
        match self.model {
            Model::A => "a",
            Model::B => "b",
            Model::C => "c",
            Model::D => "d",
        }
    }
}

/// Why no code came out.
#[derive(Debug)]
pub enum ComposeError {
    /// There is no motion.
    Empty,
    /// A motion's arm is not built like the first one's, so they cannot share code.
    Differs {
        /// The motion.
        motion: usize,
    },
    /// A piece is not a valid template.
    Template(minijinja::Error),
}

impl fmt::Display for ComposeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ComposeError::Empty => f.write_str("there is no motion to learn from"),
            ComposeError::Differs { motion } => write!(
                f,
                "the arm of motion {motion} differs from the first one's in its axes, kinds of joint or landmarks"
            ),
            // The alternate form shows the lines around the fault.
            ComposeError::Template(error) => write!(f, "{error:#}"),
        }
    }
}

impl std::error::Error for ComposeError {}

impl From<minijinja::Error> for ComposeError {
    fn from(error: minijinja::Error) -> Self {
        ComposeError::Template(error)
    }
}

impl Structure {
    /// What the chains of all motions share. A turn or an offset that only some have is there for all; it changes no
    /// result where it is none.
    ///
    /// # Errors
    /// No chain, or chains that differ in more than offsets and turns.
    pub fn new<const N: usize>(
        chains: &[Chain<f32, N>],
        method: &Method,
    ) -> Result<Self, ComposeError> {
        let first = chains.first().ok_or(ComposeError::Empty)?;
        let mut structure = Self::of(first, method);
        for (motion, chain) in chains.iter().enumerate().skip(1) {
            if !structure.take_in(Self::of(chain, method)) {
                return Err(ComposeError::Differs { motion });
            }
        }
        let mut at = 0;
        for (name, values) in structure.row(first, &[0.0; N], [0.0; 3]) {
            let r#type = if values.len() == 1 { "f32" } else { "vec3f" };
            let count = values.len();
            structure.numbers.push(Number {
                name,
                r#type,
                at,
                count,
            });
            at += count;
        }
        structure.arm_fours = at.div_ceil(4);
        Ok(structure)
    }

    fn of<const N: usize>(chain: &Chain<f32, N>, method: &Method) -> Self {
        let link = |(i, link): (usize, &sinew::chain::Link<f32>)| {
            let (next, after) = ((link.axis + 1) % 3, (link.axis + 2) % 3);
            let (from, to) = if link.flip {
                (after, next)
            } else {
                (next, after)
            };
            let most = match link.kind {
                Kind::Revolute => MOST_ANGLE,
                Kind::Prismatic => MOST_LENGTH,
            };
            let limit = |name: &str, free: f64| {
                if method.clamped {
                    format!("arm.{name}_{i}")
                } else {
                    literal(free as f32)
                }
            };
            Link {
                axis: link.axis,
                flip: link.flip,
                revolute: link.kind == Kind::Revolute,
                from,
                to,
                shift: components(&link.shift),
                turn: link.turn != Turn::None,
                lower: limit("lower", -most),
                upper: limit("upper", most),
            }
        };
        let bound = |k| {
            let (lower, upper) = method.model.bounds(N, k);
            (literal(lower as f32), literal(upper as f32))
        };
        let genes = method.model.parameters(N);
        let landmarks: Vec<usize> = chain.landmarks().collect();
        let origin = (
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [0.0; 3],
        );
        Structure {
            dofs: N,
            genes,
            stepper: method.stepper_name(),
            model: method.model_name(),
            base: chain.base() != origin,
            links: chain.links().iter().enumerate().map(link).collect(),
            tip: components(&chain.tip_transform().1),
            points: landmarks.len() + 1,
            still: 0,
            frame_fours: (3 * (landmarks.len() + 1)).div_ceil(4),
            landmarks,
            clamped: method.clamped,
            bounds: (0..genes).map(bound).collect(),
            numbers: Vec::new(),
            arm_fours: 0,
        }
    }

    /// Makes this the structure of another's motions too, if it can.
    fn take_in(&mut self, mut other: Structure) -> bool {
        self.base |= other.base;
        other.base = self.base;
        unite(&mut self.tip, &mut other.tip);
        for (own, others) in self.links.iter_mut().zip(&mut other.links) {
            own.turn |= others.turn;
            others.turn = own.turn;
            unite(&mut own.shift, &mut others.shift);
        }
        *self == other
    }

    /// A motion's own numbers, by name.
    fn row<const N: usize>(
        &self,
        chain: &Chain<f32, N>,
        initial: &[f32; N],
        target: [f32; 3],
    ) -> Vec<(String, Vec<f32>)> {
        let mut row = Vec::new();
        let mut put = |name: String, values: &[f32]| row.push((name, values.to_vec()));
        if self.base {
            let (axes, at) = chain.base();
            for (name, axis) in ["x", "y", "z"].iter().zip(&axes) {
                put(format!("base_{name}"), axis);
            }
            put("base_at".to_owned(), &at);
        }
        for (i, (link, own)) in self.links.iter().zip(chain.links()).enumerate() {
            let by = offset(&own.shift);
            for &k in &link.shift {
                put(format!("shift_{i}_{k}"), &[by[k]]);
            }
            if link.turn {
                let columns = match own.turn {
                    Turn::None => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                    Turn::General(columns) => columns,
                };
                for (name, column) in ["x", "y", "z"].iter().zip(&columns) {
                    put(format!("turn_{i}_{name}"), column);
                }
            }
            if self.clamped {
                put(format!("lower_{i}"), &[chain.lower()[i]]);
                put(format!("upper_{i}"), &[chain.upper()[i]]);
            }
        }
        let by = offset(&chain.tip_transform().1);
        for &k in &self.tip {
            put(format!("tip_{k}"), &[by[k]]);
        }
        for (i, &angle) in initial.iter().enumerate() {
            put(format!("initial_{i}"), &[angle]);
        }
        put("target_at".to_owned(), &target);
        row
    }

    /// A motion's own numbers as the buffer `data` has them: whole fours. The chain must be one that the structure was
    /// made from.
    pub fn numbers<const N: usize>(
        &self,
        chain: &Chain<f32, N>,
        initial: &[f32; N],
        target: [f32; 3],
    ) -> Vec<f32> {
        let row = self.row(chain, initial, target).into_iter();
        let mut numbers: Vec<f32> = row.flat_map(|(_, values)| values).collect();
        numbers.resize(4 * self.arm_fours, 0.0);
        numbers
    }

    /// The same, where the first `still` landmarks are where they were recorded, in all motions: there is nothing to
    /// compare.
    #[must_use]
    pub fn beyond(self, still: usize) -> Self {
        let frame_fours = (3 * (self.points - still)).div_ceil(4);
        Structure {
            still,
            frame_fours,
            ..self
        }
    }

    /// How many points a frame has: landmarks and the tip.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Whether the stepper has ticks that need more than others, rarely.
    pub fn has_hard(&self) -> bool {
        self.stepper == "pseudo_inverse"
    }

    /// Fours that a member's genes take.
    pub fn gene_fours(&self) -> usize {
        self.genes.div_ceil(4)
    }

    /// A recorded frame as the buffer `data` has it: whole fours.
    pub fn frame(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let compared = points.iter().skip(self.still);
        let mut frame: Vec<f32> = compared.flatten().copied().collect();
        frame.resize(4 * self.frame_fours, 0.0);
        frame
    }
}

/// Both, what either has.
fn unite(a: &mut Vec<usize>, b: &mut Vec<usize>) {
    let both: Vec<usize> = (0..3).filter(|k| a.contains(k) || b.contains(k)).collect();
    a.clone_from(&both);
    *b = both;
}

/// The components of an offset that there are.
fn components(shift: &Shift<f32>) -> Vec<usize> {
    match *shift {
        Shift::None => vec![],
        Shift::Along(k, _) => vec![k],
        Shift::General(by) => (0..3).filter(|&k| by[k] != 0.0).collect(),
    }
}

/// All components of an offset.
fn offset(shift: &Shift<f32>) -> [f32; 3] {
    match *shift {
        Shift::None => [0.0; 3],
        Shift::Along(k, by) => std::array::from_fn(|i| if i == k { by } else { 0.0 }),
        Shift::General(by) => by,
    }
}

/// A number as WGSL: the shortest that reads back as the same bits.
fn literal(x: f32) -> String {
    format!("{x:?}f")
}

/// The pieces that every kernel has, base first.
const ALWAYS: [(&str, &str); 11] = [
    ("math", include_str!("math.wgsl")),
    ("vector", include_str!("vector.wgsl")),
    ("philox", include_str!("philox.wgsl")),
    ("proposal", include_str!("proposal.wgsl")),
    ("kinematics", include_str!("kinematics.wgsl")),
    ("stepper", include_str!("stepper.wgsl")),
    ("synergy", include_str!("synergy.wgsl")),
    ("controller", include_str!("controller.wgsl")),
    ("metric", include_str!("metric.wgsl")),
    ("score", include_str!("score.wgsl")),
    ("anneal", include_str!("anneal.wgsl")),
];

/// The pieces of a stepper.
fn stepper_pieces(stepper: &str) -> &'static [(&'static str, &'static str)] {
    const LDL: (&str, &str) = ("ldl", include_str!("ldl.wgsl"));
    const ORTHOGONAL: (&str, &str) = ("orthogonal", include_str!("orthogonal.wgsl"));
    match stepper {
        "transpose" => &[("transpose", include_str!("transpose.wgsl"))],
        "normalised_transpose" => &[(
            "normalised_transpose",
            include_str!("normalised_transpose.wgsl"),
        )],
        "pseudo_inverse" => &[
            LDL,
            ORTHOGONAL,
            ("pseudo_inverse", include_str!("pseudo_inverse.wgsl")),
        ],
        "damped" => &[LDL, ("damped", include_str!("damped.wgsl"))],
        _ => &[
            ORTHOGONAL,
            (
                "selectively_damped",
                include_str!("selectively_damped.wgsl"),
            ),
        ],
    }
}

/// WGSL, and which piece each line comes from.
#[derive(Clone, Debug)]
pub struct Composed {
    /// The whole.
    pub source: String,
    /// Each piece's name and its first line in the whole, counted from 1.
    pieces: Vec<(&'static str, usize)>,
}

impl Composed {
    /// The piece that a line of the whole (counted from 1) belongs to, and the line's text.
    pub fn line(&self, line: usize) -> (&'static str, &str) {
        let piece = self.pieces.iter().rev().find(|(_, first)| *first <= line);
        let text = self.source.lines().nth(line.saturating_sub(1));
        (
            piece.map_or("", |&(name, _)| name),
            text.unwrap_or("").trim(),
        )
    }
}

/// The whole kernel of a structure. With a window, `data` is a uniform buffer of so many fours, else a storage buffer.
///
/// # Errors
/// A piece that is not a valid template.
pub fn compose(structure: &Structure, window: Option<usize>) -> Result<Composed, ComposeError> {
    let pieces: Vec<_> = ALWAYS
        .iter()
        .chain(stepper_pieces(structure.stepper))
        .copied()
        .collect();
    render(structure, window, &pieces)
}

fn render(
    structure: &Structure,
    window: Option<usize>,
    pieces: &[(&'static str, &'static str)],
) -> Result<Composed, ComposeError> {
    let mut templates = Environment::new();
    templates.set_syntax(
        SyntaxConfig::builder()
            .variable_delimiters("${", "}")
            .line_statement_prefix("//%")
            .build()?,
    );
    templates.set_undefined_behavior(UndefinedBehavior::Strict);
    templates.set_keep_trailing_newline(true);
    let about = context! {
        island => ISLAND,
        island_bits => ISLAND.ilog2(),
        window,
        gene_fours => structure.gene_fours(),
        has_hard => structure.has_hard(),
        gene => GENE,
        step => (0..=structure.genes).map(step).collect::<Vec<_>>(),
        ..minijinja::Value::from_serialize(structure)
    };
    let mut composed = Composed {
        source: String::new(),
        pieces: Vec::new(),
    };
    for &(name, template) in pieces {
        composed
            .pieces
            .push((name, composed.source.lines().count() + 1));
        composed
            .source
            .push_str(&templates.render_named_str(name, template, &about)?);
        composed.source.push('\n');
    }
    Ok(composed)
}

/// 64·2.38/√(2d) for d genes, to the nearest whole number; 0 for none.
fn step(genes: usize) -> i32 {
    match genes {
        0 => 0,
        _ => (64.0 * 2.38 / (2.0 * genes as f64).sqrt()).round() as i32,
    }
}
