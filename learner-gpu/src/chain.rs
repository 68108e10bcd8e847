//! The description of a chain that files hold: what a person, a URDF file or a body's measures say of it, before the
//! core checks and folds it (SPEC section 1).
//!
//! ```json
//! {
//!   "joints": [{
//!     "name": "elbow flexion", "kind": "revolute",
//!     "translation": [0, 0, -0.29], "rotation": [0, 0, 0, 1],
//!     "axis": [1, 0, 0], "lower": 0, "upper": 2.6
//!   }],
//!   "tip": { "translation": [0, 0, -0.34], "rotation": [0, 0, 0, 1] },
//!   "landmarks": [{ "name": "elbow", "joint": 0 }]
//! }
//! ```
//!
//! Rotations are unit quaternions x, y, z, w; lengths metres, angles radians. There is no base transform: it is part of
//! the first joint's.

use nalgebra::{Isometry3, Quaternion, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sinew::chain::{Chain, HUMAN_ARM_LANDMARKS, HUMAN_ARM_NAMES, Joint, Kind, human_arm_joints};

/// A chain as files hold it. It may be wrong: [`check`](Self::check) and [`build`](Self::build) tell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChainDescription {
    /// The degrees of freedom (DoFs), base first.
    pub joints: Vec<JointDescription>,
    /// From the last DoF's frame to the tip's.
    pub tip: TransformDescription,
    /// The points of a posture that are compared, in chain order. The tip is one more, always, and not listed.
    pub landmarks: Vec<LandmarkDescription>,
}

/// One DoF: see [`Joint`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointDescription {
    /// What people call it.
    pub name: String,
    /// How it moves.
    pub kind: KindDescription,
    /// Where its frame lies in the frame before it, metres.
    pub translation: [f64; 3],
    /// How its frame is turned against the frame before it: a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Its axis in its own frame; any length but 0.
    pub axis: [f64; 3],
    /// The least value, radians or metres.
    pub lower: f64,
    /// The greatest value, radians or metres.
    pub upper: f64,
}

/// How a DoF moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KindDescription {
    /// It turns about its axis.
    Revolute,
    /// It slides along its axis.
    Prismatic,
}

/// A fixed transform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformDescription {
    /// Metres.
    pub translation: [f64; 3],
    /// A unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

/// A point of a posture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LandmarkDescription {
    /// What people call it.
    pub name: String,
    /// The DoF at whose origin it lies, counted from 0 at the base.
    pub joint: usize,
}

/// What is wrong with a chain's description.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChainError {
    /// There are not as many DoFs as the program asked for.
    #[error("the chain has {found} joints where {expected} are expected")]
    Size {
        /// How many there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A DoF's description.
    #[error("the joint \"{joint}\" is wrong: {source}")]
    Joint {
        /// The DoF's name.
        joint: String,
        /// What is wrong with it; it counts DoFs from 0.
        source: sinew::Error,
    },
    /// A landmark lies on a DoF that the chain does not have.
    #[error(
        "the landmark \"{landmark}\" lies on joint {joint}, but the joints are numbered 0 to {}",
        joints.saturating_sub(1)
    )]
    NoSuchJoint {
        /// The landmark's name.
        landmark: String,
        /// The DoF that it names.
        joint: usize,
        /// How many DoFs there are.
        joints: usize,
    },
    /// A landmark lies on a DoF that no DoF is called like.
    #[error(
        "the landmark \"{landmark}\" lies on a joint \"{joint}\" that the chain does not have; its joints are {joints}"
    )]
    NoJointOfThatName {
        /// The landmark's name.
        landmark: String,
        /// The DoF that it names.
        joint: String,
        /// The DoFs that there are.
        joints: String,
    },
    /// Two landmarks have the same name.
    #[error("there are two landmarks \"{landmark}\", expected one")]
    RepeatedLandmark {
        /// The name.
        landmark: String,
    },
    /// Landmarks are not in chain order, or two lie on the same DoF.
    #[error(
        "the landmark \"{landmark}\" must lie on a later joint than \"{before}\": landmarks are listed from the base to the tip"
    )]
    LandmarkOrder {
        /// The landmark's name.
        landmark: String,
        /// The one listed before it.
        before: String,
    },
    /// Anything else, such as the tip's transform.
    #[error("the chain is wrong: {0}")]
    Other(sinew::Error),
}

impl ChainDescription {
    /// The human arm of the SPEC ([`sinew::chain::human_arm`]): segment lengths in metres, and which way the person
    /// faces: `base_rotation` takes the arm's own frame (x to the person's right, y forward, z up) to the
    /// recordings'. Not checked yet.
    ///
    /// ```
    /// use nalgebra::UnitQuaternion;
    /// use sinew_learn::chain::ChainDescription;
    /// let arm = ChainDescription::human_arm(0.29, 0.25, 0.09, UnitQuaternion::identity());
    /// assert_eq!(arm.joints[3].name, "elbow flexion");
    /// let arm = arm.build::<7>()?;
    /// assert_eq!(arm.landmarks().collect::<Vec<_>>(), [0, 3, 5]); // shoulder, elbow, wrist
    /// # Ok::<(), sinew_learn::chain::ChainError>(())
    /// ```
    pub fn human_arm(
        upper_arm: f64,
        forearm: f64,
        hand: f64,
        base_rotation: UnitQuaternion<f64>,
    ) -> Self {
        let (joints, tip) = human_arm_joints::<f64>(upper_arm, forearm, hand);
        let joints = HUMAN_ARM_NAMES.iter().zip(&joints).enumerate();
        let joints = joints.map(|(i, (name, joint))| {
            let own = Isometry3::from_parts(joint.translation.into(), joint.rotation);
            let facing = match i {
                0 => base_rotation,
                _ => UnitQuaternion::identity(),
            };
            let at = TransformDescription::from(facing * own);
            JointDescription {
                name: (*name).to_owned(),
                kind: joint.kind.into(),
                translation: at.translation,
                rotation: at.rotation,
                axis: joint.axis.into(),
                lower: joint.lower,
                upper: joint.upper,
            }
        });
        let landmarks = ["shoulder", "elbow", "wrist"]
            .iter()
            .zip(HUMAN_ARM_LANDMARKS);
        ChainDescription {
            joints: joints.collect(),
            tip: tip.into(),
            landmarks: landmarks
                .map(|(name, joint)| LandmarkDescription {
                    name: (*name).to_owned(),
                    joint,
                })
                .collect(),
        }
    }

    /// The chain of N DoFs that this describes, checked and folded.
    ///
    /// # Errors
    /// Not N DoFs, or what [`check`](Self::check) finds.
    pub fn build<const N: usize>(&self) -> Result<Chain<f64, N>, ChainError> {
        if self.joints.len() != N {
            return Err(ChainError::Size {
                expected: N,
                found: self.joints.len(),
            });
        }
        self.check()?;
        let joints: Vec<_> = self.joints.iter().map(JointDescription::joint).collect();
        let landmarks: Vec<_> = self.landmarks.iter().map(|l| l.joint).collect();
        let tip = self.tip.isometry();
        Chain::new(&Isometry3::identity(), &joints, &tip, &landmarks).map_err(ChainError::Other)
    }

    /// Whether the chain can be built, for who does not know its number of DoFs yet.
    ///
    /// # Errors
    /// A number that the core refuses (see [`Chain::new`]), naming the DoF; a landmark on a DoF that is not there, or
    /// not in chain order.
    pub fn check(&self) -> Result<(), ChainError> {
        let origin = Isometry3::identity();
        for (i, description) in self.joints.iter().enumerate() {
            // Whatever the core refuses in a chain it refuses in this DoF alone.
            let alone = Chain::<f64, 1>::new(&origin, &[description.joint()], &origin, &[]);
            alone.map_err(|source| ChainError::Joint {
                joint: description.name.clone(),
                source: numbered(source, i),
            })?;
        }
        Chain::<f64, 0>::new(&origin, &[], &self.tip.isometry(), &[]).map_err(ChainError::Other)?;
        self.check_landmarks()
    }

    fn check_landmarks(&self) -> Result<(), ChainError> {
        let mut before: Option<&LandmarkDescription> = None;
        for (number, landmark) in self.landmarks.iter().enumerate() {
            let mut others = self.landmarks.iter().take(number);
            if others.any(|other| other.name == landmark.name) {
                return Err(ChainError::RepeatedLandmark {
                    landmark: landmark.name.clone(),
                });
            }
            if landmark.joint >= self.joints.len() {
                return Err(ChainError::NoSuchJoint {
                    landmark: landmark.name.clone(),
                    joint: landmark.joint,
                    joints: self.joints.len(),
                });
            }
            if let Some(before) = before
                && before.joint >= landmark.joint
            {
                return Err(ChainError::LandmarkOrder {
                    landmark: landmark.name.clone(),
                    before: before.name.clone(),
                });
            }
            before = Some(landmark);
        }
        Ok(())
    }

    /// The same chain with these landmarks instead: pairs of a landmark's name and the name of the DoF at whose origin
    /// it lies, in chain order.
    ///
    /// # Errors
    /// A DoF that is not there, or the wrong order.
    ///
    /// ```
    /// # use nalgebra::UnitQuaternion;
    /// # use sinew_learn::chain::ChainDescription;
    /// let arm = ChainDescription::human_arm(0.29, 0.25, 0.09, UnitQuaternion::identity());
    /// let arm = arm.with_landmarks(&[("elbow".into(), "elbow flexion".into())])?;
    /// assert_eq!(arm.landmarks[0].joint, 3);
    /// assert!(arm.with_landmarks(&[("knee".into(), "knee flexion".into())]).is_err());
    /// # Ok::<(), sinew_learn::chain::ChainError>(())
    /// ```
    pub fn with_landmarks(mut self, landmarks: &[(String, String)]) -> Result<Self, ChainError> {
        self.landmarks = landmarks
            .iter()
            .map(|(name, on)| {
                let joint = self.joints.iter().position(|joint| joint.name == *on);
                Ok(LandmarkDescription {
                    name: name.clone(),
                    joint: joint.ok_or_else(|| ChainError::NoJointOfThatName {
                        landmark: name.clone(),
                        joint: on.clone(),
                        joints: listed(self.joints.iter().map(|joint| joint.name.as_str())),
                    })?,
                })
            })
            .collect::<Result<_, _>>()?;
        self.check_landmarks()?;
        Ok(self)
    }
}

/// What the core says of its only DoF, said of DoF `i`.
fn numbered(error: sinew::Error, i: usize) -> sinew::Error {
    use sinew::Error;
    let joint = Some(i);
    match error {
        Error::NotFinite { what, .. } => Error::NotFinite { what, joint },
        Error::OutOfRange { what, .. } => Error::OutOfRange { what, joint },
        Error::ZeroAxis { .. } => Error::ZeroAxis { joint: i },
        Error::LimitsReversed { .. } => Error::LimitsReversed { joint: i },
        other => other,
    }
}

/// Names for an error message: in quotes, the first dozen of them.
pub(crate) fn listed<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> String {
    const MOST: usize = 12;
    let more = names.len().saturating_sub(MOST);
    let named: Vec<_> = names.take(MOST).map(|name| format!("\"{name}\"")).collect();
    match (named.is_empty(), more) {
        (true, _) => "none".to_owned(),
        (_, 0) => named.join(", "),
        _ => format!("{} and {more} more", named.join(", ")),
    }
}

impl JointDescription {
    /// As the core takes it, unchecked.
    pub fn joint(&self) -> Joint<f64> {
        Joint {
            kind: self.kind.into(),
            translation: self.translation.into(),
            rotation: unit(self.rotation),
            axis: self.axis.into(),
            lower: self.lower,
            upper: self.upper,
        }
    }
}

impl TransformDescription {
    /// As nalgebra takes it, unchecked.
    pub fn isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Vector3::from(self.translation).into(), unit(self.rotation))
    }
}

/// The core checks that the length is 1.
fn unit([x, y, z, w]: [f64; 4]) -> UnitQuaternion<f64> {
    Unit::new_unchecked(Quaternion::new(w, x, y, z))
}

impl From<Isometry3<f64>> for TransformDescription {
    fn from(from: Isometry3<f64>) -> Self {
        // Files need no -0.
        let plain = |x: f64| x + 0.0;
        TransformDescription {
            translation: <[f64; 3]>::from(from.translation.vector).map(plain),
            rotation: <[f64; 4]>::from(from.rotation.coords).map(plain),
        }
    }
}

impl From<Kind> for KindDescription {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Revolute => KindDescription::Revolute,
            Kind::Prismatic => KindDescription::Prismatic,
        }
    }
}

impl From<KindDescription> for Kind {
    fn from(kind: KindDescription) -> Self {
        match kind {
            KindDescription::Revolute => Kind::Revolute,
            KindDescription::Prismatic => Kind::Prismatic,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm() -> ChainDescription {
        ChainDescription::human_arm(0.29, 0.25, 0.09, UnitQuaternion::identity())
    }

    #[test]
    fn a_file_holds_the_keys_that_it_is_documented_to_hold() {
        let text = r#"{
            "joints": [{
                "name": "elbow flexion", "kind": "revolute",
                "translation": [0, 0, -0.29], "rotation": [0, 0, 0, 1],
                "axis": [1, 0, 0], "lower": 0, "upper": 2.6
            }, {
                "name": "slide", "kind": "prismatic",
                "translation": [0, 0, 0], "rotation": [0, 0, 0.6, 0.8],
                "axis": [0, 0, 2], "lower": -0.1, "upper": 0.1
            }],
            "tip": { "translation": [0, 0, -0.34], "rotation": [0, 0, 0, 1] },
            "landmarks": [{ "name": "elbow", "joint": 0 }]
        }"#;
        let chain: ChainDescription = serde_json::from_str(text).unwrap();
        assert_eq!(chain.joints[0].kind, KindDescription::Revolute);
        assert_eq!(chain.joints[1].rotation, [0.0, 0.0, 0.6, 0.8]);
        let built = chain.build::<2>().unwrap();
        assert_eq!(built.landmarks().collect::<Vec<_>>(), [0]);

        let again = serde_json::to_string(&chain).unwrap();
        assert_eq!(
            serde_json::from_str::<ChainDescription>(&again).unwrap(),
            chain
        );
        let misspelt = text.replace("\"upper\"", "\"uper\"");
        let error = serde_json::from_str::<ChainDescription>(&misspelt).unwrap_err();
        assert!(
            error.to_string().starts_with("unknown field `uper`"),
            "{error}"
        );
    }

    #[test]
    fn the_human_arm_is_the_cores_turned_to_face_the_way_it_faces() {
        let core = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
        let q = [0.3, -0.4, 0.5, 1.2, 0.2, -0.3, 0.1];
        assert_eq!(arm().build::<7>().unwrap(), core);

        let facing = UnitQuaternion::from_euler_angles(0.1, -0.2, 2.0);
        let turned = ChainDescription::human_arm(0.29, 0.25, 0.09, facing);
        let turned = turned.build::<7>().unwrap();
        let (here, there) = (core.forward(&q), turned.forward(&q));
        for (here, there) in here.landmarks().zip(there.landmarks()) {
            assert!((facing * Vector3::from(here) - Vector3::from(there)).norm() < 1e-12);
        }
        let names: Vec<_> = arm().landmarks.into_iter().map(|l| l.name).collect();
        assert_eq!(names, ["shoulder", "elbow", "wrist"]);
    }

    #[test]
    fn what_is_wrong_is_said_of_the_joint_by_name() {
        let said = |change: fn(&mut ChainDescription)| {
            let mut chain = arm();
            change(&mut chain);
            chain.build::<7>().unwrap_err().to_string()
        };
        assert_eq!(
            said(|c| c.joints[3].axis = [0.0; 3]),
            "the joint \"elbow flexion\" is wrong: the axis must not be zero (joint 3)"
        );
        assert_eq!(
            said(|c| c.joints[6].lower = f64::NAN),
            "the joint \"wrist deviation\" is wrong: a limit must be a finite number (joint 6)"
        );
        assert_eq!(
            said(|c| c.joints[0].rotation = [0.0; 4]),
            "the joint \"shoulder flexion\" is wrong: a rotation must be a quaternion of length 1 (joint 0)"
        );
        assert_eq!(
            said(|c| c.tip.translation[0] = f64::INFINITY),
            "the chain is wrong: the tip transform must be a finite number"
        );
        assert_eq!(
            said(|c| c.landmarks[2].joint = 7),
            "the landmark \"wrist\" lies on joint 7, but the joints are numbered 0 to 6"
        );
        assert_eq!(
            said(|c| c.landmarks.swap(0, 1)),
            "the landmark \"shoulder\" must lie on a later joint than \"elbow\": landmarks are listed from the base to the tip"
        );
        assert_eq!(
            said(|c| c.landmarks[1].name = "shoulder".to_owned()),
            "there are two landmarks \"shoulder\", expected one"
        );
        assert_eq!(
            said(|c| drop(c.joints.pop())),
            "the chain has 6 joints where 7 are expected"
        );
    }
}
