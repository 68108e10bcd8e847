// J⁺: ΔΘ = λ·dt · J⁺ΔX, singular values below 1e-4·σ_max dropped. Mirror of core/src/stepper/pseudo_inverse.rs.

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    let normal = ldl(j, 0.0);
    var out = transposed_times(j, solve(normal, error));
    if !is_well_conditioned(normal) {
        out = by_singular_values(j, error);
    }
    return scaled(gain, out);
}

/// Σₖ vₖ·(uₖᵀΔX)/σₖ over the singular values that count.
fn by_singular_values(j: Jacobian, error: vec3f) -> Joints {
    let svd = orthogonal(j, error);
    var weights: vec3f;
    //% for k in ["x", "y", "z"]
    {
        let counts = does_count(svd, svd.squares.${k});
        let square = select(1.0, svd.squares.${k}, counts);
        weights.${k} = select(0.0, svd.error.${k} / square, counts);
    }
    //% endfor
    return transposed_times(svd.rows, weights);
}
