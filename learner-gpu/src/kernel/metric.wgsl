// The distance between two postures (SPEC section 4). Mirror of `Kinematics::distance_beyond` in core/src/kinematics.rs.

/// The mean distance of the landmarks from those of the recorded frame that begins there in `data`, metres: x, y, z of
/// each.
fn posture_distance(at: Kinematics, frame: u32) -> f32 {
    //% for four in range(frame_fours)
    let four_${four} = data[frame + ${four}u];
    //% endfor
    var sum = 0.0;
    //% for k in range(still, points)
    sum = sum + distance3(
        at.${"origin[" ~ landmarks[k] ~ "]" if k < points - 1 else "tip"},
        vec3f(
            //% for r in range(3)
            four_${(3 * (k - still) + r) // 4}[${(3 * (k - still) + r) % 4}],
            //% endfor
        ),
    );
    //% endfor
    return sum * (1.0 / ${points}.0);
}
