// What several steppers share. Mirror of core/src/stepper/mod.rs.

/// Jᵀ·v.
fn transposed_times(j: Jacobian, v: vec3f) -> Joints {
    return Joints(
        //% for i in range(dofs)
        dot3(j[${i}], v),
        //% endfor
    );
}

/// k·v.
fn scaled(k: f32, v: Joints) -> Joints {
    return Joints(
        //% for i in range(dofs)
        k * v[${i}],
        //% endfor
    );
}
