// The distance between two postures (SPEC section 4). Mirror of `Kinematics::distance` in core/src/kinematics.rs.

/// The recorded landmarks, metres: x, y, z of each, then nothing up to a whole number of fours, frame after frame. Read
/// by fours: on lavapipe half of a tick's time went into reading them one by one.
@group(0) @binding(2) var<storage, read> recorded: array<vec4f>;

/// The mean distance of the landmarks from those of a recorded frame, metres.
fn posture_distance(at: Kinematics, frame: u32) -> f32 {
    //% for four in range(fours)
    let four_${four} = recorded[frame * ${fours}u + ${four}u];
    //% endfor
    var sum = 0.0;
    //% for k in range(points)
    sum = sum + distance3(
        at.${"origin[" ~ landmarks[k] ~ "]" if k < points - 1 else "tip"},
        vec3f(
            //% for r in range(3)
            four_${(3 * k + r) // 4}[${(3 * k + r) % 4}],
            //% endfor
        ),
    );
    //% endfor
    return sum * (1.0 / ${points}.0);
}
