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

/// The mean distance in metres between the recording and the motion synthesised with these parameters.
fn score_motion(motion: Motion, parameters: Parameters) -> f32 {
    let gain = run.gain;
    let arm = arm_of(motion.at);
    var q = start(arm);
    var rests = rests_of(parameters);
    let changes = changes_of(parameters);
    var sum = 0.0;
    var frame = 0u;
    // The tick after the last frame is for nothing, but a branch around it would cost more.
    while frame < motion.frames {
        //% if stepper == "pseudo_inverse"
        // lavapipe jumps over nothing but what is left of a loop: with singular values behind an `if` every tick pays
        // for them. So an inner loop runs until a tick needs them, and they are computed once for all threads that wait
        // there.
        var easy = true;
        while frame < motion.frames {
            let at = forward(arm, q);
            sum = sum + posture_distance(at, recorded(motion, frame));
            let optimised = optimise(columns(at), arm.target_at - at.tip, gain);
            easy = optimised.easy | (frame + 1u == motion.frames);
            if !easy {
                break;
            }
            q = tick(arm, parameters, q, optimised.step, rests);
            rests = later(rests, changes);
            frame++;
        }
        if !easy {
            let at = forward(arm, q);
            q = tick(arm, parameters, q, optimise_hard(columns(at), arm.target_at - at.tip, gain), rests);
            rests = later(rests, changes);
            frame++;
        }
        //% else
        let at = forward(arm, q);
        sum = sum + posture_distance(at, recorded(motion, frame));
        let optimised = optimise(columns(at), arm.target_at - at.tip, gain);
        q = tick(arm, parameters, q, optimised, rests);
        rests = later(rests, changes);
        frame++;
        //% endif
    }
    return sum / f32(max(motion.frames, 1u));
}
