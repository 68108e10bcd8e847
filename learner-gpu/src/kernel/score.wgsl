// A member's score: its motions synthesised and compared with the recordings (SPEC sections 4 to 6). Mirror of score.rs.

/// One motion of a set.
struct Motion {
    /// Where it begins in `data`.
    at: u32,
    frames: u32,
}

/// Where a frame of it begins in `data`.
fn recorded(motion: Motion, frame: u32) -> u32 {
    return motion.at + ${arm_fours}u + frame * ${frame_fours}u;
}

/// The motions, set after set.
@group(0) @binding(2) var<storage, read> motions: array<Motion>;

/// What a motion scores.
struct Score {
    /// The mean distance in metres between the recording and the motion synthesised with the parameters.
    mean: f32,
    /// Whether `optimise` was exact enough in every tick, so that it counts.
    easy: bool,
}

/// Runs a motion with these parameters. A tick that `optimise` is not exact enough for is only told, or done `exactly`.
fn score_motion(motion: Motion, parameters: Parameters, exactly: bool) -> Score {
    let gain = run.gain;
    let arm = arm_of(motion.at);
    var q = start(arm);
    var rests = rests_of(parameters);
    let changes = changes_of(parameters);
    var sum = 0.0;
    var easy = true;
    var frame = 0u;
    // The tick after the last frame is for nothing, but a branch around it would cost more.
    while frame < motion.frames {
        let at = forward(arm, q);
        sum = sum + posture_distance(at, recorded(motion, frame));
        //% if has_hard
        let optimised = optimise(columns(at), arm.target_at - at.tip, gain);
        var step = optimised.step;
        easy = easy & (optimised.easy | (frame + 1u == motion.frames));
        if exactly & !optimised.easy {
            step = optimise_hard(columns(at), arm.target_at - at.tip, gain);
        }
        //% else
        let step = optimise(columns(at), arm.target_at - at.tip, gain);
        //% endif
        q = tick(arm, parameters, q, step, rests);
        rests = later(rests, changes);
        frame++;
    }
    return Score(sum / f32(max(motion.frames, 1u)), easy);
}
