//! Chains from URDF files: what is folded, what is refused and how that is said, and that no text makes the reader
//! panic.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fs;

use proptest::prelude::*;
use sinew_learn::chain::{ChainDescription, ChainError, KindDescription};
use sinew_learn::urdf::{self, UrdfProblem};
use sinew_tests::shared;

/// A robot of links base, upper, plate, lower, tool, with its joints between them: a revolute, a fixed, a prismatic
/// and a fixed one.
const ROBOT: &str = r#"<?xml version="1.0"?>
<robot name="robot">
  <link name="base"/> <link name="upper"/> <link name="plate"/> <link name="lower"/> <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.5" rpy="0 0 0"/> <parent link="base"/> <child link="upper"/>
    <axis xyz="0 0 1"/> <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="bolt" type="fixed">
    <origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/> <parent link="upper"/> <child link="plate"/>
  </joint>
  <joint name="slide" type="prismatic">
    <origin xyz="1 0 0" rpy="0 0 0"/> <parent link="plate"/> <child link="lower"/>
    <axis xyz="1 0 0"/> <limit lower="0" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="screw" type="fixed">
    <origin xyz="0 0 0.25" rpy="0 0 0"/> <parent link="lower"/> <child link="tool"/>
  </joint>
</robot>"#;

fn parsed(text: &str) -> Result<ChainDescription, UrdfProblem> {
    urdf::parse(text.to_owned(), "base", "tool")
}

/// What is said of the robot with one part of its text changed.
fn said(from: &str, to: &str) -> String {
    assert!(ROBOT.contains(from), "{from}");
    parsed(&ROBOT.replacen(from, to, 1))
        .unwrap_err()
        .to_string()
}

#[test]
fn fixed_joints_are_folded_into_the_next_moving_one_and_the_tip() {
    let chain = parsed(ROBOT).unwrap();
    let names: Vec<_> = chain
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    assert_eq!(names, ["shoulder", "slide"]);
    let [shoulder, slide] = chain.joints.as_slice() else {
        unreachable!()
    };
    assert_eq!(
        (shoulder.kind, slide.kind),
        (KindDescription::Revolute, KindDescription::Prismatic)
    );
    assert_eq!(
        (shoulder.lower, shoulder.upper, slide.upper),
        (-1.0, 2.0, 0.5)
    );
    // The bolt turns the plate by a quarter, so a metre along the plate's x is one along the upper link's y.
    let [x, y, z] = slide.translation;
    assert!((x - 1.0).abs() < 1e-15 && (y - 1.0).abs() < 1e-15 && z == 0.0);
    let [.., z, w] = slide.rotation;
    assert!((z - 0.5f64.sqrt()).abs() < 1e-15 && (w - 0.5f64.sqrt()).abs() < 1e-15);
    assert_eq!(chain.tip.translation, [0.0, 0.0, 0.25]);

    let tip = chain.build::<2>().unwrap().forward(&[FRAC_PI_2, 0.5]).tip();
    for (found, expected) in tip.iter().zip([-1.5, 1.0, 0.75]) {
        assert!((found - expected).abs() < 1e-12, "{tip:?}");
    }
}

#[test]
fn a_continuous_joint_turns_once_either_way() {
    let chain = parsed(&ROBOT.replacen("revolute", "continuous", 1)).unwrap();
    let shoulder = &chain.joints[0];
    assert_eq!(shoulder.kind, KindDescription::Revolute);
    assert_eq!((shoulder.lower, shoulder.upper), (-TAU, TAU));
}

#[test]
fn landmarks_lie_on_joints_by_name() {
    let landmarks = [
        ("first".to_owned(), "shoulder".to_owned()),
        ("second".to_owned(), "slide".to_owned()),
    ];
    let chain = parsed(ROBOT).unwrap();
    assert!(chain.landmarks.is_empty());
    let with = chain.clone().with_landmarks(&landmarks).unwrap();
    assert_eq!(
        with.build::<2>().unwrap().landmarks().collect::<Vec<_>>(),
        [0, 1]
    );

    let [first, second] = landmarks;
    let turned_round = chain
        .clone()
        .with_landmarks(&[second, first.clone()])
        .unwrap_err();
    assert_eq!(
        turned_round.to_string(),
        "the landmark \"first\" must lie on a later joint than \"second\": landmarks are listed from the base to the tip"
    );
    let unknown = chain
        .with_landmarks(&[(first.0, "bolt".to_owned())])
        .unwrap_err();
    assert_eq!(
        unknown.to_string(),
        "the landmark \"first\" lies on a joint \"bolt\" that the chain does not have; its joints are \"shoulder\", \"slide\""
    );
}

#[test]
fn part_of_a_robot_can_be_read() {
    let part = urdf::parse(ROBOT.to_owned(), "plate", "lower").unwrap();
    assert_eq!(part.joints.len(), 1);
    assert_eq!(part.joints[0].translation, [1.0, 0.0, 0.0]);
    let nothing = urdf::parse(ROBOT.to_owned(), "upper", "plate").unwrap_err();
    assert_eq!(
        nothing.to_string(),
        "no joint moves between \"upper\" and \"plate\""
    );
    let same = urdf::parse(ROBOT.to_owned(), "tool", "tool").unwrap_err();
    assert!(matches!(same, UrdfProblem::NothingMoves { .. }));
}

#[test]
fn links_that_are_not_there_are_named_beside_those_that_are() {
    let unknown = urdf::parse(ROBOT.to_owned(), "base", "hand").unwrap_err();
    assert_eq!(
        unknown.to_string(),
        "has no link \"hand\"; its links are \"base\", \"upper\", \"plate\", \"lower\", \"tool\""
    );
    let links: String = (0..20).map(|i| format!("<link name='l{i}'/>")).collect();
    let many = urdf::parse(format!("<robot name='r'>{links}</robot>"), "a", "b").unwrap_err();
    assert!(
        many.to_string().ends_with("\"l10\", \"l11\" and 8 more"),
        "{many}"
    );
    let none = urdf::parse("<robot name='r'/>".to_owned(), "a", "b").unwrap_err();
    assert_eq!(none.to_string(), "has no link \"a\"; its links are none");
}

#[test]
fn the_base_must_come_before_the_tip() {
    let swapped = urdf::parse(ROBOT.to_owned(), "lower", "plate").unwrap_err();
    assert_eq!(
        swapped.to_string(),
        "the link \"lower\" is not before \"plate\"; the links before it are \"upper\", \"base\""
    );
    // A ring: the base hangs on the tool.
    let ring = ROBOT.replacen(
        "</robot>",
        "<joint name='knot' type='fixed'><parent link='tool'/><child link='base'/></joint><link name='aside'/></robot>",
        1,
    );
    let ring = urdf::parse(ring, "aside", "tool").unwrap_err();
    assert!(matches!(ring, UrdfProblem::NotBefore { .. }), "{ring}");
}

#[test]
fn joints_that_no_chain_has_are_refused_by_name() {
    for kind in ["floating", "planar", "spherical"] {
        assert_eq!(
            said("revolute", kind),
            format!(
                "the joint \"shoulder\" is {kind}; revolute, continuous, prismatic and fixed joints are supported"
            )
        );
    }
    assert_eq!(
        said("<axis xyz=\"0 0 1\"/>", "<mimic joint=\"slide\"/>"),
        "the joint \"shoulder\" mimics \"slide\"; only joints that move by themselves are supported"
    );
    assert_eq!(
        said("slide", "shoulder"),
        "two joints are called \"shoulder\""
    );
    assert_eq!(
        said("child link=\"lower\"", "child link=\"plate\""),
        "the joints \"bolt\" and \"slide\" both carry the link \"plate\""
    );
}

#[test]
fn limits_and_numbers_are_checked_and_the_joint_named() {
    let no_limits = "the joint \"shoulder\" needs a <limit> with a lower and an upper value that are not both 0";
    assert_eq!(
        said(
            "<limit lower=\"-1\" upper=\"2\" effort=\"1\" velocity=\"1\"/>",
            ""
        ),
        no_limits
    );
    assert_eq!(said("lower=\"-1\" upper=\"2\"", ""), no_limits);
    let wrong = |what| format!("the joint \"shoulder\" is wrong: {what} (joint 0)");
    assert_eq!(
        said("lower=\"-1\"", "lower=\"3\""),
        wrong("the lower limit must not be above the upper one")
    );
    assert_eq!(
        said("lower=\"-1\"", "lower=\"-inf\""),
        wrong("a limit must be a finite number")
    );
    assert_eq!(
        said("lower=\"-1\"", "lower=\"NaN\""),
        wrong("a limit must be a finite number")
    );
    assert_eq!(
        said("upper=\"2\"", "upper=\"1e9\""),
        wrong("a limit must lie within ±8192 rad or ±10 km")
    );
    assert_eq!(
        said("axis xyz=\"0 0 1\"", "axis xyz=\"0 0 0\""),
        wrong("the axis must not be zero")
    );
    assert_eq!(
        said("axis xyz=\"0 0 1\"", "axis xyz=\"0 NaN 1\""),
        wrong("the axis must be a finite number")
    );
    assert_eq!(
        said("0 0 0.5", "0 0 1e5"),
        wrong("no length may be above 10 km")
    );
    assert_eq!(
        said("axis xyz=\"1 0 0\"", "axis xyz=\"0 0 0\""),
        "the joint \"slide\" is wrong: the axis must not be zero (joint 1)"
    );
    assert_eq!(
        said("0 0 0.5", "0 inf 0"),
        "the joint \"shoulder\" has an <origin> that is not of finite numbers"
    );
    assert_eq!(
        said("0 0 1.57", "0 NaN 1.57"),
        "the joint \"bolt\" has an <origin> that is not of finite numbers"
    );
    assert_eq!(
        said("0 0 0.25", "0 0 1e300"),
        "the chain is wrong: no length may be above 10 km"
    );
}

#[test]
fn malformed_documents_are_refused_with_the_reason() {
    let invalid = "is not a valid URDF document: ";
    assert_eq!(
        said("\"bolt\"", "\"bo\0lt\""),
        format!("{invalid}Invalid character U+0000")
    );
    assert_eq!(
        said("name=\"bolt\"", "name=bolt"),
        format!(
            "{invalid}Parse error; Line: 8, Column: 15, Reason: Attribute value not enclosed in ' or \""
        )
    );
    assert_eq!(
        said("revolute", "resolute"),
        format!(
            "{invalid}unknown variant `resolute`, expected one of `revolute`, `continuous`, `prismatic`, `fixed`, `floating`, `planar`, `spherical`"
        )
    );
    assert_eq!(
        said("0 0 0.5", "0 0"),
        format!("{invalid}Wrong vector element count, expected 3 found 2 for [0 0]")
    );
    assert_eq!(
        said("lower=\"-1\"", "lower=\"low\""),
        format!("{invalid}invalid float literal")
    );
    assert_eq!(
        said("</joint>", ""),
        format!("{invalid}Elements not properly nested")
    );
    let cut_off = parsed(&ROBOT[..ROBOT.len() / 2]).unwrap_err();
    assert_eq!(
        cut_off.to_string(),
        format!("{invalid}no element is complete; it may be cut off, or no XML")
    );
    for text in ["", "hello", "{}", "<", "<robot"] {
        assert!(
            matches!(parsed(text), Err(UrdfProblem::Invalid(_))),
            "{text}"
        );
    }
}

#[test]
fn the_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arm.urdf");
    let missing = urdf::read(&path, "base", "tool").unwrap_err();
    assert!(
        missing
            .to_string()
            .starts_with(&format!("{}: cannot be read: ", path.display())),
        "{missing}"
    );
    fs::write(&path, b"\xff\xfe\x00").unwrap();
    let binary = urdf::read(&path, "base", "tool").unwrap_err();
    assert!(
        matches!(binary.problem, UrdfProblem::Unreadable(_)),
        "{binary}"
    );
    fs::write(&path, ROBOT.replace("-1", "3")).unwrap();
    let reversed = urdf::read(&path, "base", "tool").unwrap_err();
    assert!(matches!(
        &reversed.problem,
        UrdfProblem::Chain(ChainError::Joint { joint, .. }) if joint == "shoulder"
    ));
    assert!(
        reversed
            .to_string()
            .starts_with(&path.display().to_string())
    );
    fs::write(&path, format!("\u{feff}{ROBOT}")).unwrap();
    assert!(
        urdf::read(&path, "base", "tool").is_ok(),
        "a byte order mark is no reason to refuse"
    );
}

#[test]
fn deeply_nested_elements_cost_no_stack_overflow() {
    let nested = |levels: usize| {
        let (open, close) = ("<x>".repeat(levels), "</x>".repeat(levels));
        ROBOT.replacen(
            "<link name=\"base\"/>",
            &format!("<link name=\"base\"><visual>{open}{close}</visual></link>"),
            1,
        )
    };
    assert!(matches!(
        parsed(&nested(5_000)),
        Err(UrdfProblem::Invalid(_))
    ));
    assert!(matches!(
        parsed(&nested(20_000)),
        Err(UrdfProblem::TooLarge { .. })
    ));
}

/// One change to a text: what to do where, with what.
fn change() -> impl Strategy<Value = (u8, prop::sample::Index, prop::sample::Index, &'static str)> {
    let bits = prop::sample::select(vec![
        "<",
        ">",
        "/>",
        "</",
        "\"",
        "=",
        " ",
        "&",
        "<!--",
        "-->",
        "<![CDATA[",
        "]]>",
        "<?",
        "<!",
        "xmlns=\"a\"",
        "a:",
        "\0",
        "é",
        "<link>",
        "</link>",
        "<joint>",
        "</joint>",
        "inf",
        "NaN",
        "1e999",
        "-",
        "revolute",
        "fixed",
        "<mimic joint='a'/>",
        "<type>fixed</type>",
        "$value",
    ]);
    (
        0u8..5,
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        bits,
    )
}

fn changed(text: &str, changes: &[(u8, prop::sample::Index, prop::sample::Index, &str)]) -> String {
    let mut text: Vec<char> = text.chars().collect();
    for &(what, at, length, bit) in changes {
        let at = at.index(text.len().max(1)).min(text.len());
        let end = (at + length.index(60)).min(text.len());
        match what {
            0 => drop(text.drain(at..end)),
            1 => drop(text.splice(at..end, bit.chars())),
            2 => drop(text.splice(at..at, bit.chars())),
            3 => {
                let part = text[at..end].to_vec();
                let to = length.index(text.len().max(1)).min(text.len());
                drop(text.splice(to..to, part));
            }
            _ if length.index(10) == 0 => text.truncate(at),
            _ => {}
        }
    }
    text.into_iter().collect()
}

/// Whatever is read is a chain that can be built.
fn is_sound(read: Result<ChainDescription, UrdfProblem>) {
    match read {
        Ok(chain) => {
            chain.check().unwrap();
            assert!(!chain.joints.is_empty());
        }
        Err(problem) => assert!(!problem.to_string().is_empty()),
    }
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in ".{0,200}") {
        is_sound(parsed(&text));
    }

    #[test]
    fn no_nonsense_of_xml_makes_the_reader_panic(text in "(<|>|/>|</|=|'|robot|link|joint|name|type|fixed|a| ){0,60}") {
        is_sound(parsed(&format!("<robot name='r'>{text}</robot>")));
    }

    #[test]
    fn no_damage_to_a_document_makes_the_reader_panic(changes in prop::collection::vec(change(), 1..6)) {
        is_sound(parsed(&changed(ROBOT, &changes)));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn no_damage_to_a_real_robot_makes_the_reader_panic(
        (name, base, tip) in prop::sample::select(vec![
            ("panda", "panda_link0", "panda_hand_tcp"),
            ("ur5", "base_link", "tool0"),
            ("so101", "base_link", "gripper_frame_link"),
            ("iiwa7", "iiwa_link_0", "iiwa_link_ee"),
        ]),
        changes in prop::collection::vec(change(), 1..4),
    ) {
        if let Some(model) = shared(&format!("models/urdf/{name}.urdf")) {
            let text = fs::read_to_string(model).unwrap();
            is_sound(urdf::parse(changed(&text, &changes), base, tip));
        }
    }
}
