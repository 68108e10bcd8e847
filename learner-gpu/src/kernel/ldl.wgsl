// The symmetric system (JJᵀ + μ²I)·y = ΔX by LDLᵀ, for the three rows of a position. Mirror of core/src/stepper/ldl.rs.

/// L (below the diagonal) and 1/D (on it) of JJᵀ + μ²I.
struct Ldl {
    inverses: vec3f,
    l10: f32,
    l20: f32,
    l21: f32,
    /// The sum of the diagonal before it was factored.
    trace: f32,
}

fn ldl(j: Jacobian, damping: f32) -> Ldl {
    var f00 = j[0].x * j[0].x;
    var f10 = j[0].y * j[0].x;
    var f11 = j[0].y * j[0].y;
    var f20 = j[0].z * j[0].x;
    var f21 = j[0].z * j[0].y;
    var f22 = j[0].z * j[0].z;
    //% for i in range(1, dofs)
    f00 = f00 + j[${i}].x * j[${i}].x;
    f10 = f10 + j[${i}].y * j[${i}].x;
    f11 = f11 + j[${i}].y * j[${i}].y;
    f20 = f20 + j[${i}].z * j[${i}].x;
    f21 = f21 + j[${i}].z * j[${i}].y;
    f22 = f22 + j[${i}].z * j[${i}].z;
    //% endfor
    f00 = kept(f00) + damping;
    f11 = kept(f11) + damping;
    f22 = kept(f22) + damping;
    let trace = f00 + f11 + f22;
    let by0 = 1.0 / f00;
    let l10 = f10 * by0;
    f11 = f11 - l10 * f10;
    let l20 = f20 * by0;
    f21 = f21 - l20 * f10;
    f22 = f22 - l20 * f20;
    let by1 = 1.0 / f11;
    let l21 = f21 * by1;
    f22 = f22 - l21 * f21;
    return Ldl(vec3f(by0, by1, 1.0 / f22), l10, l20, l21, trace);
}

/// Whether the matrix is far enough from singular for this factorisation to be exact enough: true only where
/// σ_min/σ_max > 0.017. False where anything is NaN.
fn is_well_conditioned(f: Ldl) -> bool {
    let by = 0.5 * f.trace;
    let inverse = (f.inverses.x * by) * (f.inverses.y * by) * (f.inverses.z * by);
    return abs(inverse) < 1666.6666666666667;
}

/// y.
fn solve(f: Ldl, right: vec3f) -> vec3f {
    var y = right;
    y.y = y.y - f.l10 * y.x;
    y.z = y.z - f.l20 * y.x;
    y.z = y.z - f.l21 * y.y;
    y = y * f.inverses;
    y.y = y.y - f.l21 * y.z;
    y.x = y.x - f.l10 * y.y;
    y.x = y.x - f.l20 * y.z;
    return y;
}
