// Jᵀ: ΔΘ = λ·dt · Jᵀ ΔX. Mirror of core/src/stepper/transpose.rs.

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    return scaled(gain, transposed_times(j, error));
}
