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

/// e^(offset − slope·t) of each sigmoid at t = 0.
fn rests_of(p: Parameters) -> Sigmoids {
    return Sigmoids(
        //% if model == "c"
        exponential(p[${dofs}]),
        //% elif model == "d"
        //% for i in range(dofs)
        exponential(p[${dofs + i}]),
        //% endfor
        //% else
        0.0,
        //% endif
    );
}

/// By what share of itself a rest changes in a period.
fn changes_of(p: Parameters) -> Sigmoids {
    return Sigmoids(
        //% if model == "c"
        exponential_m1(-(p[${dofs + 1}] * run.dt)),
        //% elif model == "d"
        //% for i in range(dofs)
        exponential_m1(-(p[${2 * dofs + i}] * run.dt)),
        //% endfor
        //% else
        0.0,
        //% endif
    );
}

/// The rests a period later.
fn later(rests: Sigmoids, changes: Sigmoids) -> Sigmoids {
    return Sigmoids(
        //% for i in range(dofs if model == "d" else 1)
        rests[${i}] + rests[${i}] * changes[${i}],
        //% endfor
    );
}

/// eˣ − 1.
fn exponential_m1(x: f32) -> f32 {
    let xx = x * x;
    var sum = -8.267195767195768e-7 * xx + 3.306878306878307e-5;
    sum = sum * xx + -1.388888888888889e-3;
    sum = sum * xx + 8.333333333333333e-2;
    let near = x / (kept(sum * xx - 0.5 * x) + 1.0);
    return select(exponential(x) - 1.0, near, abs(x) < 0.25);
}
