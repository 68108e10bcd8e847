// Synergies: how much, and when, each DoF takes part (SPEC section 3). Mirror of core/src/synergy.rs.
//
// Parameters lie within the model's bounds, so there is nothing to refuse here.

alias Parameters = array<f32, ${genes}>;

/// ΔΘ′ = φ(t) ∘ (M·ΔΘ), t in seconds since the motion began.
fn apply(p: Parameters, step: Joints, t: f32) -> Joints {
    //% if model == "c"
    let phi = sigmoid(p[${dofs}], p[${dofs + 1}], t);
    //% endif
    return Joints(
        //% for i in range(dofs)
        //% if model == "a"
        p[0] * step[${i}],
        //% elif model == "b"
        p[${i}] * step[${i}],
        //% elif model == "c"
        phi * (p[${i}] * step[${i}]),
        //% else
        sigmoid(p[${dofs + i}], p[${2 * dofs + i}], t) * (p[${i}] * step[${i}]),
        //% endif
        //% endfor
    );
}

/// 1/(1 + e^(−slope·t + offset)).
fn sigmoid(offset: f32, slope: f32, t: f32) -> f32 {
    return 1.0 / (1.0 + exponential(offset - slope * t));
}
