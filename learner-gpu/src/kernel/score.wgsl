// A member's score: its motions synthesised and compared with the recordings (SPEC sections 4 to 6). Mirror of score.rs.

/// One motion of a set.
struct Motion {
    /// Its row in `numbers`.
    numbers: u32,
    /// Where its frames begin in `recorded`, in frames.
    first_frame: u32,
    frames: u32,
}

/// The motions, set after set.
@group(0) @binding(3) var<storage, read> motions: array<Motion>;

/// The mean distance in metres between the recording and the motion synthesised with these parameters.
fn score_motion(motion: Motion, parameters: Parameters) -> f32 {
    let arm = arm_of(motion.numbers);
    var q = start(arm);
    var sum = 0.0;
    for (var frame = 0u; frame < motion.frames; frame++) {
        let at = forward(arm, q);
        sum = sum + posture_distance(at, motion.first_frame + frame);
        // The tick after the last frame is for nothing, but a branch around it would cost more.
        q = tick(arm, parameters, q, at, frame);
    }
    return sum / f32(max(motion.frames, 1u));
}
