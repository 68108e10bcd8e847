// The distance between two postures (SPEC section 4). Mirror of `Kinematics::distance` in core/src/kinematics.rs.

/// The recorded landmarks, metres: x, y, z of each, frame after frame.
@group(0) @binding(2) var<storage, read> recorded: array<f32>;

fn recorded_point(frame: u32, k: u32) -> vec3f {
    let at = frame * ${3 * points}u + 3u * k;
    return vec3f(recorded[at], recorded[at + 1u], recorded[at + 2u]);
}

/// The mean distance of the landmarks from those of a recorded frame, metres.
fn posture_distance(at: Kinematics, frame: u32) -> f32 {
    var sum = 0.0;
    //% for joint in landmarks
    sum = sum + distance3(at.origin[${joint}], recorded_point(frame, ${loop.index0}u));
    //% endfor
    sum = sum + distance3(at.tip, recorded_point(frame, ${landmarks | length}u));
    return sum * (1.0 / ${points}.0);
}
