// Selectively damped least squares (Buss and Kim 2005), γ_max = π/4. Mirror of core/src/stepper/selectively_damped.rs.

/// γ_max, radians.
const MOST_STEP = 0.7853981633974483;

fn optimise(j: Jacobian, error: vec3f, gain: f32) -> Joints {
    let svd = orthogonal(j, error);
    let reach = Joints(
        //% for i in range(dofs)
        sqrt(dot3(j[${i}], j[${i}])),
        //% endfor
    );
    var out: Joints;
    //% for k in ["x", "y", "z"]
    {
        let counts = does_count(svd, svd.squares.${k});
        let square = select(1.0, svd.squares.${k}, counts);
        let along = select(0.0, svd.error.${k} / square, counts);
        // rows = σ·v, so Σ|v|·ρ/σ = Σ|rows|·ρ/σ².
        var sum = abs(svd.rows[0].${k}) * reach[0];
        //% for i in range(1, dofs)
        sum = sum + abs(svd.rows[${i}].${k}) * reach[${i}];
        //% endfor
        let carried = select(1.0, sum / square, counts);
        let furthest = least(1.0 / carried, 1.0) * MOST_STEP;
        let part = held_below(Joints(
            //% for i in range(dofs)
            along * svd.rows[${i}].${k},
            //% endfor
        ), furthest);
        //% for i in range(dofs)
        out[${i}] = out[${i}] + part[${i}];
        //% endfor
    }
    //% endfor
    return scaled(gain, held_below(out, MOST_STEP));
}

/// A vector made shorter, where need be, so that its largest element is `furthest`.
fn held_below(v: Joints, furthest: f32) -> Joints {
    var largest = 0.0;
    //% for i in range(dofs)
    largest = most(abs(v[${i}]), largest);
    //% endfor
    let over = furthest < largest;
    return scaled(select(1.0, furthest / select(1.0, largest, over), over), v);
}
