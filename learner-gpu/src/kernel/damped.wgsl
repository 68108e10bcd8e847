// Damped least squares: ΔΘ = λ·dt · Jᵀ(JJᵀ + μ²I)⁻¹ΔX, μ = 0.05 m. Mirror of core/src/stepper/damped.rs.

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    return scaled(gain, transposed_times(j, solve(ldl(j, 0.05 * 0.05), error)));
}
