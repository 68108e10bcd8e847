//! Chains from URDF files (<http://wiki.ros.org/urdf/XML>): the moving joints between two links.
//!
//! Joints are followed from the tip's link up to the base's and taken in the order from base to tip. Fixed ones are
//! folded into the next moving one's place, or into the tip's transform. Revolute and prismatic joints keep their
//! limits; a continuous one, which has none, gets ±2π: a turn either way. `<limit>`'s lower and upper are 0 where they
//! are left out, so a joint with both at 0 counts as having none, and is refused.
//!
//! Only the file is read: no mesh is opened, no `package://` looked up and no xacro run. The XML and its schema are
//! the crate `urdf-rs`'s business; its line numbers are passed on where it has them.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::{fs, io, thread};

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use urdf_rs::JointType;

use crate::chain::{
    ChainDescription, ChainError, JointDescription, KindDescription, TransformDescription, listed,
};

/// A URDF file that no chain could be made of.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct UrdfError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    #[source]
    pub problem: UrdfProblem,
}

/// What is wrong with a URDF document, or with what is asked of it.
#[derive(Debug, thiserror::Error)]
pub enum UrdfProblem {
    /// The file cannot be opened or is not text.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// It is not XML, or not a URDF robot.
    #[error("is not a valid URDF document: {0}")]
    Invalid(String),
    /// More elements than any robot has.
    #[error("has {found} XML elements; at most {MOST_ELEMENTS} are read")]
    TooLarge {
        /// How many it has.
        found: usize,
    },
    /// A link that is not there.
    #[error("has no link \"{link}\"; its links are {links}")]
    NoSuchLink {
        /// The link asked for.
        link: String,
        /// Those that there are, a dozen at most.
        links: String,
    },
    /// The base is not on the way from the tip to the root.
    #[error("the link \"{base}\" is not before \"{tip}\"; the links before it are {before}")]
    NotBefore {
        /// The base asked for.
        base: String,
        /// The tip asked for.
        tip: String,
        /// The links on the way from the tip to the root, a dozen at most.
        before: String,
    },
    /// Two joints carry the same link, or joints form a ring: it is no tree.
    #[error("the joints \"{first}\" and \"{second}\" both carry the link \"{link}\"")]
    TwoParents {
        /// The link.
        link: String,
        /// The joint listed first.
        first: String,
        /// The other one.
        second: String,
    },
    /// Two joints of one name.
    #[error("two joints are called \"{joint}\"")]
    SameName {
        /// The name.
        joint: String,
    },
    /// A kind of joint that a chain of single DoFs does not have.
    #[error(
        "the joint \"{joint}\" is {kind}; revolute, continuous, prismatic and fixed joints are supported"
    )]
    Unsupported {
        /// The joint.
        joint: String,
        /// Its kind.
        kind: &'static str,
    },
    /// A joint that follows another one.
    #[error(
        "the joint \"{joint}\" mimics \"{of}\"; only joints that move by themselves are supported"
    )]
    Mimic {
        /// The joint.
        joint: String,
        /// The one that it follows.
        of: String,
    },
    /// A revolute or prismatic joint without limits.
    #[error(
        "the joint \"{joint}\" needs a <limit> with a lower and an upper value that are not both 0"
    )]
    NoLimits {
        /// The joint.
        joint: String,
    },
    /// A joint's place is not a finite number.
    #[error("the joint \"{joint}\" has an <origin> that is not of finite numbers")]
    NotFinite {
        /// The joint.
        joint: String,
    },
    /// Nothing moves between base and tip.
    #[error("no joint moves between \"{base}\" and \"{tip}\"")]
    NothingMoves {
        /// The base asked for.
        base: String,
        /// The tip asked for.
        tip: String,
    },
    /// A joint, or the tip, that the core refuses.
    #[error(transparent)]
    Chain(#[from] ChainError),
}

/// The chain of the moving joints between the links `base` and `tip` of a URDF file; its tip is the frame of `tip`. It
/// has no landmarks yet: see [`ChainDescription::with_landmarks`].
///
/// # Errors
/// See [`UrdfProblem`]; the error names the file.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let panda = sinew_learn::urdf::read("panda.urdf".as_ref(), "panda_link0", "panda_hand_tcp")?;
/// let chain = panda.build::<7>()?;
/// # Ok(())
/// # }
/// ```
pub fn read(path: &Path, base: &str, tip: &str) -> Result<ChainDescription, UrdfError> {
    let text = fs::read_to_string(path).map_err(UrdfProblem::Unreadable);
    text.and_then(|text| parse(text, base, tip))
        .map_err(|problem| UrdfError {
            path: path.to_owned(),
            problem,
        })
}

/// [`read`] of a document at hand.
///
/// # Errors
/// See [`UrdfProblem`].
pub fn parse(text: String, base: &str, tip: &str) -> Result<ChainDescription, UrdfProblem> {
    let robot = robot(text)?;
    let path = joints_between(&robot, base, tip)?;
    let mut joints: Vec<JointDescription> = Vec::new();
    // The fixed transforms since the last moving joint.
    let mut fixed = Isometry3::identity();
    for joint in path {
        fixed *= origin(joint)?;
        let Some((kind, lower, upper)) = motion(joint)? else {
            continue;
        };
        if joints.iter().any(|other| other.name == joint.name) {
            return Err(UrdfProblem::SameName {
                joint: joint.name.clone(),
            });
        }
        let place = TransformDescription::from(fixed);
        fixed = Isometry3::identity();
        joints.push(JointDescription {
            name: joint.name.clone(),
            kind,
            translation: place.translation,
            rotation: place.rotation,
            axis: *joint.axis.xyz,
            lower,
            upper,
        });
    }
    if joints.is_empty() {
        return Err(UrdfProblem::NothingMoves {
            base: base.to_owned(),
            tip: tip.to_owned(),
        });
    }
    let chain = ChainDescription {
        joints,
        tip: fixed.into(),
        landmarks: Vec::new(),
    };
    chain.check()?;
    Ok(chain)
}

/// Elements that a document may have; the largest humanoids have a few thousand.
const MOST_ELEMENTS: usize = 20_000;

/// Stack for each level that elements are nested: twice what a build without optimisation needs.
const STACK_PER_LEVEL: usize = 4 << 10;

/// What `urdf-rs` makes of the text.
///
/// It recurses for every level that elements are nested, so it runs on a thread with stack for as many levels as there
/// are elements. Should it panic on some document, it is that thread's end, and an error here.
fn robot(text: String) -> Result<urdf_rs::Robot, UrdfProblem> {
    let found = elements(&text);
    if found > MOST_ELEMENTS {
        return Err(UrdfProblem::TooLarge { found });
    }
    let parser = thread::Builder::new()
        .name("urdf".to_owned())
        .stack_size((2 << 20) + found * STACK_PER_LEVEL)
        .spawn(move || urdf_rs::read_from_string(&text))
        .map_err(UrdfProblem::Unreadable)?;
    match parser.join() {
        Ok(Ok(robot)) => Ok(robot),
        Ok(Err(error)) => Err(UrdfProblem::Invalid(reason(&error.to_string()))),
        Err(_panic) => Err(UrdfProblem::Invalid("its XML is malformed".to_owned())),
    }
}

/// What `urdf-rs` says, in a line for people.
fn reason(said: &str) -> String {
    const MOST: usize = 200;
    let reason = if let Some(at) = said.strip_prefix("Syntax: ") {
        // A position in a text that `urdf-rs` made in between, of no use to anyone.
        at.split_once(' ').map_or(at, |(_position, reason)| reason)
    } else if said == "No elements found" {
        "no element is complete; it may be cut off, or no XML"
    } else {
        said.strip_prefix("custom: ").unwrap_or(said)
    };
    reason.chars().take(MOST).collect()
}

/// How many elements open, at most: every `<` but those of `</`, `<!` and `<?`.
fn elements(text: &str) -> usize {
    let bytes = text.as_bytes().windows(2);
    bytes
        .filter(|pair| pair[0] == b'<' && !matches!(pair[1], b'/' | b'!' | b'?'))
        .count()
}

/// The joints from the link `base` to the link `tip`, in that order.
fn joints_between<'a>(
    robot: &'a urdf_rs::Robot,
    base: &str,
    tip: &str,
) -> Result<Vec<&'a urdf_rs::Joint>, UrdfProblem> {
    for link in [base, tip] {
        if !robot.links.iter().any(|known| known.name == link) {
            return Err(UrdfProblem::NoSuchLink {
                link: link.to_owned(),
                links: listed(robot.links.iter().map(|link| link.name.as_str())),
            });
        }
    }
    let carriers = carriers(robot)?;
    let mut path: Vec<&urdf_rs::Joint> = Vec::new();
    let mut link = tip;
    while link != base {
        // A ring has no end; a path has no more joints than there are.
        let carrier = carriers.get(link).filter(|_| path.len() < carriers.len());
        let Some(&joint) = carrier else {
            return Err(UrdfProblem::NotBefore {
                base: base.to_owned(),
                tip: tip.to_owned(),
                before: listed(path.iter().map(|joint| joint.parent.link.as_str())),
            });
        };
        path.push(joint);
        link = &joint.parent.link;
    }
    path.reverse();
    Ok(path)
}

/// For each link the joint that carries it.
fn carriers(robot: &urdf_rs::Robot) -> Result<HashMap<&str, &urdf_rs::Joint>, UrdfProblem> {
    let mut carriers = HashMap::new();
    for joint in &robot.joints {
        if let Some(first) = carriers.insert(joint.child.link.as_str(), joint) {
            return Err(UrdfProblem::TwoParents {
                link: joint.child.link.clone(),
                first: first.name.clone(),
                second: joint.name.clone(),
            });
        }
    }
    Ok(carriers)
}

/// A joint's place in its parent link: roll, pitch and yaw about the fixed x, y and z.
fn origin(joint: &urdf_rs::Joint) -> Result<Isometry3<f64>, UrdfProblem> {
    let (xyz, [roll, pitch, yaw]) = (*joint.origin.xyz, *joint.origin.rpy);
    if !xyz.iter().chain(&[roll, pitch, yaw]).all(|x| x.is_finite()) {
        return Err(UrdfProblem::NotFinite {
            joint: joint.name.clone(),
        });
    }
    Ok(Isometry3::from_parts(
        Vector3::from(xyz).into(),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}

/// How a joint moves and its limits; nothing of a fixed one.
fn motion(joint: &urdf_rs::Joint) -> Result<Option<(KindDescription, f64, f64)>, UrdfProblem> {
    let name = || joint.name.clone();
    let unsupported = |kind| {
        Err(UrdfProblem::Unsupported {
            joint: name(),
            kind,
        })
    };
    let kind = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Revolute | JointType::Continuous => KindDescription::Revolute,
        JointType::Prismatic => KindDescription::Prismatic,
        JointType::Floating => return unsupported("floating"),
        JointType::Planar => return unsupported("planar"),
        JointType::Spherical => return unsupported("spherical"),
    };
    if let Some(mimic) = &joint.mimic {
        return Err(UrdfProblem::Mimic {
            joint: name(),
            of: mimic.joint.clone(),
        });
    }
    let (lower, upper) = match joint.joint_type {
        JointType::Continuous => (-TAU, TAU),
        _ => (joint.limit.lower, joint.limit.upper),
    };
    if lower == 0.0 && upper == 0.0 {
        return Err(UrdfProblem::NoLimits { joint: name() });
    }
    Ok(Some((kind, lower, upper)))
}
