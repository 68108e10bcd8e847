// J⁺: ΔΘ = λ·dt · J⁺ΔX, singular values below 1e-4·σ_max dropped. Mirror of core/src/stepper/pseudo_inverse.rs.
//
// Where J is well conditioned `optimise` is exact enough; where it is not, `optimise_hard` is asked, and the caller sees
// to it that this is rare (see anneal.wgsl).

struct Optimised {
    step: Joints,
    /// Whether J was well conditioned, so that the step counts.
    easy: bool,
}

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Optimised {
    let normal = ldl(j, 0.0);
    return Optimised(
        scaled(gain, transposed_times(j, solve(normal, error))),
        is_well_conditioned(normal),
    );
}

/// Σₖ vₖ·(uₖᵀΔX)/σₖ over the singular values that count.
fn optimise_hard(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    let svd = orthogonal(j, error);
    var weights: vec3f;
    //% for k in ["x", "y", "z"]
    {
        let counts = does_count(svd, svd.squares.${k});
        let square = select(1.0, svd.squares.${k}, counts);
        weights.${k} = select(0.0, svd.error.${k} / square, counts);
    }
    //% endfor
    return scaled(gain, transposed_times(svd.rows, weights));
}
