// NJᵀ: ΔΘ = λ·dt · JᵀΔX/‖JᵀΔX‖, never past the least ‖ΔX − J·δ‖. Mirror of core/src/stepper/normalised_transpose.rs.

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    let d = transposed_times(j, error);
    var square = d[0] * d[0];
    var moved = j[0] * d[0];
    //% for i in range(1, dofs)
    square = square + d[${i}] * d[${i}];
    moved = moved + j[${i}] * d[${i}];
    //% endfor
    let alpha = square / dot3(moved, moved);
    let bounded = least(gain / sqrt(square), alpha);
    // Directions shorter than this (squared) are no direction.
    return scaled(select(0.0, bounded, 1e-30 < square), d);
}
