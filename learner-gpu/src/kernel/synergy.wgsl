// Synergies: how much, and when, each DoF takes part (SPEC section 3). Mirror of core/src/synergy.rs.
//
// Parameters lie within the model's bounds, so there is nothing to refuse here.

alias Parameters = array<f32, ${genes}>;

/// A number for each sigmoid; one that nobody asks for where there is none.
alias Sigmoids = array<f32, ${dofs if model == "d" else 1}>;

/// ΔΘ′ = φ(t) ∘ (M·ΔΘ), with the sigmoids' rests at t.
fn apply(p: Parameters, step: Joints, rests: Sigmoids) -> Joints {
    //% if model == "c"
    let phi = sigmoid(rests[0]);
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
        sigmoid(rests[${i}]) * (p[${i}] * step[${i}]),
        //% endif
        //% endfor
    );
}

/// 1/(1 + e^(offset − slope·t)), of its rest.
fn sigmoid(rest: f32) -> f32 {
    return 1.0 / (1.0 + rest);
}

/// After so many ticks the rests are computed anew.
const FRESH = 64u;

/// e^(offset − slope·t) of each sigmoid.
fn rests_at(p: Parameters, t: f32) -> Sigmoids {
    return Sigmoids(
        //% if model == "c"
        exponential(p[${dofs}] - p[${dofs + 1}] * t),
        //% elif model == "d"
        //% for i in range(dofs)
        exponential(p[${dofs + i}] - p[${2 * dofs + i}] * t),
        //% endfor
        //% else
        0.0,
        //% endif
    );
}

/// What the rests fall by in a period.
fn falls_of(p: Parameters) -> Sigmoids {
    return Sigmoids(
        //% if model == "c"
        exponential(-(p[${dofs + 1}] * run.dt)),
        //% elif model == "d"
        //% for i in range(dofs)
        exponential(-(p[${2 * dofs + i}] * run.dt)),
        //% endfor
        //% else
        0.0,
        //% endif
    );
}

/// The rests a period later.
fn fallen(rests: Sigmoids, falls: Sigmoids) -> Sigmoids {
    return Sigmoids(
        //% for i in range(dofs if model == "d" else 1)
        rests[${i}] * falls[${i}],
        //% endfor
    );
}
