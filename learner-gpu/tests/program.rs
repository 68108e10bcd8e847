//! The program as a person meets it: what it prints, what it writes, and how it ends.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;

fn sinew(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(arguments);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A small search: seconds, not minutes.
const QUICK: [&str; 8] = [
    "--backend",
    "cpu",
    "--population",
    "64",
    "--generations",
    "48",
    "--stepper",
    "normalised-transpose",
];

fn learn(out: &Path, more: &[&str]) -> Output {
    let mut arguments = vec!["learn", "--out", out.to_str().unwrap()];
    arguments.extend(QUICK);
    arguments.extend(more);
    sinew(&arguments)
}

/// Wrong input: exit code 2, and each of the words in the message.
fn refused(output: &Output, words: &[&str]) {
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

#[test]
fn with_no_recordings_named_it_learns_from_the_sample_and_the_file_scores_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    let output = learn(folder.path(), &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("the sample"));
    let path = folder.path().join("synergies.json");
    let written = json(&path);
    assert_eq!(written["version"], 1);
    assert_eq!(written["stepper"], "normalised-transpose");
    assert_eq!(written["limits"], "free");
    assert_eq!(written["backend"], "cpu");
    assert_eq!(written["population"], 64);
    assert_eq!(written["chain"]["joints"].as_array().unwrap().len(), 7);
    let motions = written["motions"].as_array().unwrap();
    assert_eq!(motions.len(), 14);
    // Nothing but the result is left.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);

    let again = sinew(&["evaluate", path.to_str().unwrap(), "--json"]);
    let again: Value = serde_json::from_slice(&again.stdout).unwrap();
    for (motion, again) in motions.iter().zip(again["motions"].as_array().unwrap()) {
        assert_eq!(motion["file"], again["file"]);
        assert_eq!(motion["distance_cm"], again["distance_cm"]);
        assert_eq!(motion["parameters"].as_array().unwrap().len(), 9);
    }
}

#[test]
fn the_same_seed_learns_the_same_and_another_does_not() {
    let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
    for (folder, seed) in folders.iter().zip(["3", "3", "4"]) {
        assert!(learn(folder.path(), &["--seed", seed]).status.success());
    }
    let [a, b, c] =
        folders.map(|folder| json(&folder.path().join("synergies.json"))["motions"].clone());
    assert_eq!(a, b);
    assert_ne!(a, c);
}

#[test]
fn one_parameter_vector_serves_a_set_of_motions() {
    let folder = tempfile::tempdir().unwrap();
    assert!(learn(folder.path(), &["--joint"]).status.success());
    let written = json(&folder.path().join("synergies.json"));
    let motions = written["motions"].as_array().unwrap();
    assert!(
        motions
            .iter()
            .all(|motion| motion["parameters"] == motions[0]["parameters"])
    );
}

#[test]
fn a_motion_to_a_new_target_is_a_recording_too() {
    let folder = tempfile::tempdir().unwrap();
    assert!(
        learn(folder.path(), &["--generations", "300"])
            .status
            .success()
    );
    let path = folder.path().join("synergies.json");
    let csv = folder.path().join("reach.csv");
    // A centimetre beside a learned target: how far a synergy carries is another question.
    let learned = json(&path)["motions"][4]["target"].clone();
    let [x, y, z] = [0, 1, 2].map(|r| learned[r].as_f64().unwrap());
    let target = format!("{},{y},{z}", x + 0.01);
    let output = sinew(&[
        "synthesize",
        path.to_str().unwrap(),
        "--target",
        &target,
        "--csv",
        csv.to_str().unwrap(),
    ]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let motion = sinew_learn::csv::read(&csv).unwrap();
    let hand = *motion.points().last().unwrap().last().unwrap();
    let left = (hand[0] - x - 0.01).hypot(hand[1] - y).hypot(hand[2] - z);
    assert!(left < 0.05, "the hand ends {left} m from the target");
    assert!(motion.outbound().is_ok());
    let relearned = tempfile::tempdir().unwrap();
    assert!(
        learn(relearned.path(), &[csv.to_str().unwrap()])
            .status
            .success()
    );
}

/// A recording of the sample with every point turned about the vertical: (x, y) to (−y, x).
fn facing_left(path: &str) -> String {
    let recording = std::fs::read_to_string(path).unwrap();
    let mut out = String::new();
    for (number, line) in recording.lines().enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        for point in cells[1..13].chunks_mut(3).filter(|_| number > 0) {
            let y: f64 = point[1].parse().unwrap();
            point[1] = std::mem::replace(&mut point[0], (-y).to_string());
        }
        out += &(cells.join(",") + "\n");
    }
    out
}

#[test]
fn another_persons_map_is_adapted_and_what_it_saves_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let few = ["--map", "--stepper", "pseudo-inverse"];
    assert!(learn(folder.path(), &few).status.success());
    let known = folder.path().join("synergies.json");
    let known = known.to_str().unwrap();

    let second = tempfile::tempdir().unwrap();
    let adapted = learn(second.path(), &[&few[..], &["--known", known]].concat());
    assert!(adapted.status.success(), "{}", text(&adapted.stderr));
    assert!(text(&adapted.stdout).contains("another's map, adapted"));

    // Somebody who does the same, but faces a quarter turn to the left.
    let turned: Vec<String> = (1..=14)
        .map(|number| {
            let name = format!("reach_{number:02}.csv");
            let path = folder.path().join(&name);
            std::fs::write(&path, facing_left(&format!("sample/{name}"))).unwrap();
            path.to_str().unwrap().to_owned()
        })
        .collect();
    let turned: Vec<&str> = turned.iter().map(String::as_str).collect();
    let left = tempfile::tempdir().unwrap();
    let output = learn(
        left.path(),
        &[&few[..], &turned, &["--known", known]].concat(),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let [before, after] = [&second, &left].map(|folder| {
        let map = json(&folder.path().join("synergies.json"))["map"].take();
        let trials = map["trials"].as_array().unwrap().clone();
        let cm = |trial: &Value| {
            let name = trial["name"].as_str().unwrap().to_owned();
            (name, trial["left_out_cm"].as_f64().unwrap_or(0.0))
        };
        trials.iter().map(cm).collect::<Vec<_>>()
    });
    assert_eq!(before.len(), after.len());
    for ((name, before), (_, after)) in before.into_iter().zip(after) {
        assert!(
            (before - after).abs() < 0.1 * before + 1e-9,
            "{name}: {before} {after}"
        );
    }

    let out = folder.path().to_str().unwrap();
    let transfer = |stepper| {
        sinew(&[
            "experiment",
            "transfer",
            "--known",
            known,
            "--most",
            "2",
            "--stepper",
            stepper,
            "--out",
            out,
        ])
    };
    let output = transfer("pseudo-inverse");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let written = std::fs::read_to_string(folder.path().join("transfer.csv")).unwrap();
    let rows: Vec<&str> = written.lines().collect();
    assert_eq!(
        rows[0],
        "reaches,predicted_cm,adapted_cm,predicted_alone_cm,affine_cm,constant_cm"
    );
    assert_eq!(rows.len(), 1 + 3);
    let cm = |row: usize, column: usize| -> f64 {
        rows[row].split(',').nth(column).unwrap().parse().unwrap()
    };
    // The same person's own map serves the person better than one or two reaches do, and predicted paths best.
    assert!(cm(2, 2) < cm(2, 4) && cm(2, 2) < cm(2, 5), "{written}");
    assert!(cm(1, 1) < cm(1, 2) && cm(2, 1) < cm(2, 2), "{written}");
    assert!(cm(3, 1) < cm(3, 3), "{written}");

    let refused = transfer("transpose");
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("expected Transpose"));
}

#[cfg(unix)]
#[test]
fn a_map_is_tried_on_reaches_left_out_and_serves_new_targets_with_its_confidence() {
    let folder = tempfile::tempdir().unwrap();
    let output = learn(folder.path(), &["--map", "--stepper", "pseudo-inverse"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for words in [
        "nearest learned target",
        "between 4 nearest",
        "constant map",
        "affine map for predicted paths",
        "quadratic map",
        "learned for a predicted path",
    ] {
        assert!(printed.contains(words), "{words:?} is not in: {printed}");
    }
    let path = folder.path().join("synergies.json");
    let written = json(&path);
    let map = &written["map"];
    let trials = map["trials"].as_array().unwrap();
    let of = |name: &str, what: &str| {
        let trial = trials.iter().find(|trial| trial["name"] == name).unwrap();
        trial[what].as_f64().unwrap()
    };
    // A richer map fits at least as well; a vector of its own fits each reach best.
    let fitted = |name| of(name, "fitted_cm");
    assert!(fitted("quadratic map") <= fitted("affine map"));
    assert!(fitted("affine map") <= fitted("constant map"));
    assert!(fitted("nearest learned target") <= fitted("quadratic map"));
    // Of the maps about as good as the best of those left out, the one is kept whose hands arrive most often.
    let kept = map["kept"].as_str().unwrap();
    assert_eq!(map["degree"], kept.split(' ').next().unwrap());
    let maps = trials.iter().map(|trial| trial["name"].as_str().unwrap());
    let maps: Vec<&str> = maps.filter(|name| name.contains("map")).collect();
    let least = maps.iter().map(|name| of(name, "left_out_cm"));
    let limit = least.fold(f64::INFINITY, f64::min) * 1.03;
    assert!(of(kept, "left_out_cm") <= limit);
    for name in maps {
        let as_good = of(name, "left_out_cm") <= limit;
        assert!(
            !as_good || of(name, "arrived") <= of(kept, "arrived"),
            "{name}"
        );
    }

    let csv = folder.path().join("reach.csv");
    let synthesize = |target: &str| {
        sinew(&[
            "synthesize",
            path.to_str().unwrap(),
            "--csv",
            csv.to_str().unwrap(),
            "--target",
            target,
        ])
    };
    let known: Vec<String> = map["targets"][0]
        .as_array()
        .unwrap()
        .iter()
        .map(Value::to_string)
        .collect();
    let near = synthesize(&known.join(","));
    assert!(
        text(&near.stdout).contains("confidence 1.00"),
        "{}",
        text(&near.stdout)
    );
    assert!(text(&near.stdout).contains("learned for a predicted path"));
    let far = synthesize("0,0,3");
    assert!(
        text(&far.stdout).contains("not to be trusted"),
        "{}",
        text(&far.stdout)
    );
    // On the way between learned targets the hand arrives, and in the same way on any number of threads.
    let targets = [0, 1].map(|k| map["targets"][k].as_array().unwrap());
    let middle: Vec<String> = (0..3)
        .map(|r| targets.map(|target| target[r].as_f64().unwrap() / 2.0))
        .map(|[a, b]| (a + b).to_string())
        .collect();
    let on_threads = |threads: &str| {
        let mut synthesize = command(&["synthesize", path.to_str().unwrap()]);
        synthesize.args([
            "--csv",
            csv.to_str().unwrap(),
            "--target",
            &middle.join(","),
        ]);
        let output = synthesize
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap();
        let printed = text(&output.stdout);
        let left = printed.split("ends ").nth(1).unwrap();
        let left: f64 = left.split(' ').next().unwrap().parse().unwrap();
        assert!(left <= 1.0, "{printed}");
        std::fs::read(&csv).unwrap()
    };
    assert!(on_threads("1") == on_threads("3"));
    // A motion that is named keeps its own parameters.
    let own = sinew(&[
        "synthesize",
        path.to_str().unwrap(),
        "--csv",
        csv.to_str().unwrap(),
        "--target",
        &known.join(","),
        "--motion",
        "reach_03",
    ]);
    assert!(
        text(&own.stdout).contains("the synergy of"),
        "{}",
        text(&own.stdout)
    );

    // A map that is none is refused with the file's name.
    let mut broken = written.clone();
    broken["map"]["radius"] = Value::from(-1.0);
    std::fs::write(&path, broken.to_string()).unwrap();
    refused(&synthesize("0.1,0.3,0"), &["synergies.json", "map"]);
    let with_reaches = |reaches: &Value| {
        let mut other = written.clone();
        other["map"]["reaches"] = reaches.clone();
        std::fs::write(&path, other.to_string()).unwrap();
        synthesize("0.1,0.3,0")
    };
    for (spoil, words) in [
        (
            (|reach| drop(reach["path"].as_array_mut().unwrap().pop())) as fn(&mut Value),
            "16 moments",
        ),
        (
            |reach| drop(reach["start"].as_array_mut().unwrap().pop()),
            "a start",
        ),
        (
            |reach| drop(reach["parameters"].as_array_mut().unwrap().pop()),
            "parameters, expected 9",
        ),
        (|reach| reach["seconds"] = Value::from(0.0), "takes 0 s"),
        (|reach| reach["path"][3][0][2] = Value::from(1e9), "metres"),
        (|reach| reach["target"][0] = Value::from(-1e9), "metres"),
    ] {
        let mut reaches = map["reaches"].clone();
        spoil(&mut reaches[2]);
        refused(&with_reaches(&reaches), &["reach 2", words]);
    }
    // Without reaches it is the map that serves, as with files from before there were any.
    let without = with_reaches(&Value::Array(Vec::new()));
    assert!(text(&without.stdout).contains("a synergy of the map"));

    // Of one reach none can be left out, and nothing is predicted.
    let one = csv.to_str().unwrap();
    assert!(learn(folder.path(), &["--map", one]).status.success());
    assert!(json(&path)["map"].get("reaches").is_none());
    // But with another's map it is, from the other's reaches and the one.
    let known = folder.path().join("known.json");
    std::fs::write(&known, written.to_string()).unwrap();
    let known = ["--known", known.to_str().unwrap()];
    let few = ["--map", "--stepper", "pseudo-inverse", one];
    let adapted = learn(folder.path(), &[&few[..], &known].concat());
    assert!(adapted.status.success(), "{}", text(&adapted.stderr));
    let reaches = json(&path)["map"]["reaches"].as_array().unwrap().len();
    assert_eq!(reaches, 1 + map["reaches"].as_array().unwrap().len());
    let near = synthesize(&middle.join(","));
    assert!(text(&near.stdout).contains("learned for a predicted path"));
}

/// Runs `sinew` until it tells a line that begins so, and for a while, then stops it as Ctrl-C does: what it tells then.
fn interrupted(arguments: &[&str], at: &str, after: Duration) -> Vec<String> {
    let mut running = command(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = BufReader::new(running.stderr.take().unwrap()).lines();
    assert!(told.any(|line| line.unwrap().starts_with(at)));
    std::thread::sleep(after);
    Command::new("kill")
        .args(["-INT", &running.id().to_string()])
        .status()
        .unwrap();
    let told = told.map(Result::unwrap).collect();
    assert_eq!(running.wait().unwrap().code(), Some(130));
    told
}

#[test]
fn stopped_while_it_makes_a_map_it_leaves_what_is_there_and_goes_on_from_there() {
    let [whole, stopped] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let folder = stopped.path();
    let mut arguments = vec!["learn", "--map", "--out", folder.to_str().unwrap()];
    arguments.extend(QUICK);
    let file = folder.join("synergies.json");
    std::fs::write(&file, "of before").unwrap();
    for step in [
        "map: one vector",
        "map: affine map for predicted paths, with",
        "map: learned for a predicted path",
    ] {
        interrupted(&arguments, step, Duration::from_millis(200));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "of before");
        assert!(folder.join("learning.checkpoint").exists());
    }
    let output = sinew(&arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("going on from generation"));
    assert!(!folder.join("learning.checkpoint").exists());
    assert!(learn(whole.path(), &["--map"]).status.success());
    let [whole, stopped] =
        [whole, stopped].map(|folder| json(&folder.path().join("synergies.json")));
    assert!(whole["map"]["trials"].is_array());
    for part in ["motions", "map", "evaluations"] {
        assert_eq!(whole[part], stopped[part], "{part}");
    }
}

#[test]
fn stopped_and_gone_on_with_it_learns_what_it_would_have_without_a_stop() {
    let [whole, stopped] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let long = [
        "--generations",
        "200",
        "--population",
        "8192",
        "--seed",
        "9",
    ];
    let mut arguments = vec!["learn", "--out", stopped.path().to_str().unwrap()];
    arguments.extend(QUICK);
    arguments.extend(long);
    // Long enough after it began for some generations, and seconds before it would end.
    interrupted(&arguments, "backend", Duration::from_millis(500));
    assert!(stopped.path().join("learning.checkpoint").exists());
    assert!(!stopped.path().join("synergies.json").exists());

    // Whatever is faster by now, it goes on where it began.
    let output = learn(
        stopped.path(),
        &[&long[..], &["--backend", "auto"]].concat(),
    );
    for words in ["(it began there)", "going on from generation"] {
        let told = text(&output.stderr);
        assert!(told.contains(words), "{told}");
    }
    assert!(learn(whole.path(), &long).status.success());
    let [whole, stopped] =
        [whole, stopped].map(|folder| json(&folder.path().join("synergies.json")));
    assert_eq!(whole["motions"], stopped["motions"]);
    assert_eq!(whole["generations"], stopped["generations"]);
}

/// An experiment on the shipped sample with a small search.
fn experiment(which: &str, out: &Path, more: &[&str]) -> Output {
    let mut arguments = vec!["experiment", which, "--out", out.to_str().unwrap()];
    arguments.extend(&QUICK[..6]);
    arguments.extend(more);
    sinew(&arguments)
}

/// The rows of a CSV file, by the names of their columns.
fn rows(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}

#[test]
fn an_experiment_writes_the_distances_that_learn_does() {
    let folder = tempfile::tempdir().unwrap();
    let same = ["--stepper", "pseudo-inverse", "--seed", "5"];
    let output = experiment("models", folder.path(), &same);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for words in ["S_A, pseudo-inverse", "S_D", "-55 %", "worse on"] {
        assert!(printed.contains(words), "{printed}");
    }
    let found = rows(&folder.path().join("models.csv"));
    assert_eq!(found.len(), 4 * 14);
    let whole = json(&folder.path().join("models.json"));
    assert_eq!(
        (&whole["version"], &whole["figure"]),
        (&1.into(), &3.into())
    );
    // The experiment's two files, and nothing else.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);

    for (index, model) in ["a", "b", "c", "d"].iter().enumerate() {
        let learned = tempfile::tempdir().unwrap();
        let output = learn(learned.path(), &[&same[..], &["--model", model]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let written = json(&learned.path().join("synergies.json"));
        let motions = written["motions"].as_array().unwrap();
        for (row, motion) in found.iter().skip(14 * index).zip(motions) {
            assert_eq!(row["recording"], motion["file"]);
            assert_eq!(row["model"], format!("S_{}", model.to_uppercase()));
            assert_eq!(row["stepper"], "pseudo-inverse");
            assert_eq!(row["frames"], motion["frames"].to_string());
            let distance: f64 = row["distance_cm"].parse().unwrap();
            assert_eq!(Some(distance), motion["distance_cm"].as_f64());
        }
        assert_eq!(whole["searches"][index]["motions"], written["motions"]);
        assert_eq!(whole["searches"][index]["seed"], 5);
        let distances = motions.iter().map(|m| m["distance_cm"].as_f64().unwrap());
        let mean = distances.sum::<f64>() / 14.0;
        assert_eq!(whole["results"][index]["mean_cm"].as_f64(), Some(mean));
    }
}

#[test]
fn each_inverse_kinematics_is_compared_with_and_without_a_synergy() {
    let folder = tempfile::tempdir().unwrap();
    assert!(experiment("steppers", folder.path(), &[]).status.success());
    let path = folder.path().join("steppers.csv");
    let steppers = |found: &[std::collections::HashMap<String, String>]| -> Vec<String> {
        found
            .iter()
            .step_by(2 * 14)
            .map(|row| row["stepper"].clone())
            .collect()
    };
    let paper = ["transpose", "pseudo-inverse", "normalised-transpose"];
    assert_eq!(steppers(&rows(&path)), paper);
    // Others on demand, each once.
    let ours = ["--stepper", "damped,selectively-damped,damped"];
    let output = experiment("steppers", folder.path(), &ours);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let found = rows(&path);
    assert_eq!(found.len(), 2 * 2 * 14);
    assert_eq!(steppers(&found), ["damped", "selectively-damped"]);
    let results = &json(&folder.path().join("steppers.json"))["results"];
    assert_eq!(results[1]["against"], "S_A");
    assert!(results[1]["gain"]["reduction"].as_f64().unwrap() > 0.0);
    assert_eq!(results[1]["paper"]["reduction"], Value::Null);
}

#[test]
fn the_hands_speed_is_a_bell_where_it_is_recorded_and_none_without_a_synergy() {
    let folder = tempfile::tempdir().unwrap();
    let output = experiment("speed", folder.path(), &["--generations", "200"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let whole = json(&folder.path().join("speed.json"));
    let means = whole["results"]["means"].as_array().unwrap();
    let bell = |k: usize| means[k]["minimum_jerk_correlation"].as_f64().unwrap();
    assert!(bell(0) > 0.9 && bell(1) < 0.5 && bell(2) > bell(1));
    let shapes = rows(&folder.path().join("shape.csv"));
    assert_eq!(shapes.len(), 3 * 14);
    let speeds = rows(&folder.path().join("speed.csv"));
    let first: Vec<_> = speeds
        .iter()
        .filter(|row| row["recording"] == shapes[0]["recording"] && row["curve"] == "recorded")
        .collect();
    let frames = whole["searches"][0]["motions"][0]["frames"].as_u64();
    assert_eq!(Some(first.len() as u64), frames);
    let greatest = first
        .iter()
        .map(|row| row["speed_m_s"].parse::<f64>().unwrap())
        .fold(0.0, f64::max);
    assert_eq!(shapes[0]["greatest_m_s"].parse::<f64>().unwrap(), greatest);
}

#[test]
fn an_experiment_refuses_what_learn_refuses_before_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for which in ["models", "steppers", "speed"] {
        refused(&experiment(which, &out, &["missing.csv"]), &["missing.csv"]);
        refused(&experiment(which, &out, &["--rate=0"]), &["--rate is 0"]);
        refused(
            &experiment(which, &out, &["--stepper=best"]),
            &["possible values"],
        );
        assert!(!out.exists());
        let file = format!("{which}.json");
        std::fs::create_dir_all(folder.path().join(&file)).unwrap();
        refused(&experiment(which, folder.path(), &[]), &[&file, "folder"]);
    }
    refused(
        &experiment("speed", &out, &["--lambda=-1"]),
        &["--lambda is -1"],
    );
    refused(&sinew(&["experiment"]), &["Usage"]);
    refused(&sinew(&["experiment", "figure-6"]), &["figure-6"]);
}

#[cfg(unix)]
#[test]
fn a_stopped_experiment_writes_no_result_and_goes_on_from_there() {
    let [whole, stopped] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let out = stopped.path().to_str().unwrap();
    let mut arguments = vec!["experiment", "models", "--out", out];
    arguments.extend(&QUICK[..6]);
    for (search, kept) in [("search 1 of 4", 1), ("search 3 of 4", 3)] {
        let told = interrupted(&arguments, search, Duration::from_millis(20));
        assert!(told.iter().any(|line| line.starts_with("stopped after")));
        let files = std::fs::read_dir(stopped.path()).unwrap();
        assert_eq!(files.count(), kept);
    }
    let output = sinew(&arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("going on from generation"));
    assert!(experiment("models", whole.path(), &[]).status.success());
    for file in ["models.csv", "models.json"] {
        assert!(stopped.path().join(file).exists());
    }
    assert_eq!(std::fs::read_dir(stopped.path()).unwrap().count(), 2);
    let [whole, stopped] = [whole, stopped]
        .map(|folder| std::fs::read_to_string(folder.path().join("models.csv")).unwrap());
    assert_eq!(whole, stopped);
}

#[test]
fn a_bench_prints_and_writes_what_it_measured() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bench.json");
    let few = [
        "--quick",
        "--paths",
        "f32",
        "--motions",
        "2",
        "--populations",
        "64",
    ];
    let few = [
        &few[..],
        &[
            "--steppers",
            "transpose",
            "--models",
            "c,d",
            "--rounds",
            "5",
        ],
    ]
    .concat();
    let output = sinew(&[&["bench", "--json", file.to_str().unwrap()], &few[..]].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("scalar f32, 1 thread"));
    let written = json(&file);
    assert_eq!(written["cases"].as_array().unwrap().len(), 2);
    let rates = &written["cases"][1]["rates"][0];
    assert_eq!(rates["rounds"].as_array().unwrap().len(), 5);
    assert!(rates["share"].as_f64().unwrap() > 0.0);
    refused(&sinew(&["bench", "--paths", "abacus"]), &["abacus", "f32"]);
}

#[test]
fn wrong_input_is_named_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let file = folder.path().join("broken.csv");
    std::fs::write(
        &file,
        "time,sx,sy,sz,ex,ey,ez,wx,wy,wz,hx,hy,hz\n0,0,0,0,0,0,-0.3,0,0.2,-0.3,0,0.3,x\n",
    )
    .unwrap();
    refused(
        &learn(&out, &[file.to_str().unwrap()]),
        &["broken.csv", "line 2", "hz", "x"],
    );
    refused(&learn(&out, &["missing.csv"]), &["missing.csv"]);
    refused(
        &learn(&out, &[folder.path().join("nowhere").to_str().unwrap()]),
        &["nowhere"],
    );
    let empty = tempfile::tempdir().unwrap();
    refused(
        &learn(&out, &[empty.path().to_str().unwrap()]),
        &["no recording"],
    );
    assert!(!out.exists());
}

#[test]
fn wrong_options_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (option, value, words) in [
        ("--rate", "0", "expected"),
        ("--rate", "NaN", "expected"),
        ("--lambda", "-1", "--lambda"),
        ("--model", "e", "possible values"),
        ("--population", "0", "0 is not in"),
        ("--chain", "arm.urdf", "--base"),
    ] {
        refused(&learn(&out, &[&format!("{option}={value}")]), &[words]);
    }
    refused(&sinew(&[]), &["Usage"]);
    assert!(!out.exists());
}

#[test]
fn a_broken_file_of_synergies_is_named_with_the_place() {
    let folder = tempfile::tempdir().unwrap();
    assert!(
        learn(folder.path(), &["--generations", "1"])
            .status
            .success()
    );
    let path = folder.path().join("synergies.json");
    let good = std::fs::read_to_string(&path).unwrap();
    let evaluate = |content: &str| {
        std::fs::write(&path, content).unwrap();
        sinew(&["evaluate", path.to_str().unwrap()])
    };
    let middle = good.char_indices().nth(good.len() / 2).unwrap().0;
    refused(
        &evaluate(&good[..middle]),
        &["synergies.json", "line", "column"],
    );
    refused(
        &evaluate(&good.replacen("\"version\": 1", "\"version\": 7", 1)),
        &["version 7", "expected 1"],
    );
    refused(
        &evaluate(&good.replace("reach_03", "reach_99")),
        &["reach_99"],
    );
    let mut wrong: Value = serde_json::from_str(&good).unwrap();
    wrong["motions"][2]["parameters"]
        .as_array_mut()
        .unwrap()
        .pop();
    refused(
        &evaluate(&wrong.to_string()),
        &["motion 2", "parameters has 8", "expected 9"],
    );
    wrong = serde_json::from_str(&good).unwrap();
    wrong["chain"]["joints"][3]["lower"] = 9.0.into();
    refused(&evaluate(&wrong.to_string()), &["elbow flexion", "limit"]);
    refused(
        &sinew(&[
            "synthesize",
            path.to_str().unwrap(),
            "--target",
            "1,2",
            "--csv",
            "x.csv",
        ]),
        &["three numbers"],
    );
}

#[test]
fn the_devices_are_listed_and_help_reads_well() {
    let devices = text(&sinew(&["devices"]).stdout);
    assert!(
        devices.contains("cpu") && devices.contains("lanes"),
        "{devices}"
    );
    for command in ["learn", "evaluate", "synthesize", "experiment", "devices"] {
        let output = sinew(&[command, "--help"]);
        assert!(output.status.success() && text(&output.stdout).contains("Usage: sinew"));
    }
}
