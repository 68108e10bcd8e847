// One control tick (SPEC section 2): optimise, apply the synergy, integrate, clamp. Mirror of core/src/controller.rs.

/// The joint vector at a motion's beginning.
fn start(arm: Arm) -> Joints {
    return Joints(
        //% for i in range(dofs)
        within(arm.initial_${i}, ${links[i].lower}, ${links[i].upper}),
        //% endfor
    );
}

/// The joint vector one period later, by a step of inverse kinematics.
fn tick(arm: Arm, parameters: Parameters, q: Joints, optimised: Joints, rests: Sigmoids) -> Joints {
    let step = apply(parameters, optimised, rests);
    return Joints(
        // A step that is no number moves nothing.
        //% for i in range(dofs)
        within(q[${i}] + select(0.0, step[${i}], is_sane(step[${i}])), ${links[i].lower}, ${links[i].upper}),
        //% endfor
    );
}
