// Forward kinematics and the Jacobian, written out for one chain. Mirror of core/src/kinematics.rs.

alias Joints = array<f32, ${dofs}>;
alias Jacobian = array<vec3f, ${dofs}>;

/// Numbers of every motion's own arm and task, in one row of `numbers` a motion.
@group(0) @binding(1) var<storage, read> numbers: array<f32>;

/// What differs from motion to motion: lengths, fixed turns, limits, first posture and target.
struct Arm {
    //% for number in numbers
    ${number.name}: ${number.type},
    //% endfor
}

fn arm_of(motion: u32) -> Arm {
    let at = motion * ${numbers_a_motion}u;
    return Arm(
        //% for number in numbers
        //% if number.type == "f32"
        numbers[at + ${number.at}u],
        //% else
        vec3f(numbers[at + ${number.at}u], numbers[at + ${number.at + 1}u], numbers[at + ${number.at + 2}u]),
        //% endif
        //% endfor
    );
}

/// Where everything is at one posture.
struct Kinematics {
    /// The axis of each DoF.
    axis: Jacobian,
    /// The origin of each DoF's frame.
    origin: Jacobian,
    /// The tip's position.
    tip: vec3f,
}

/// Axes, origins and tip at the joint vector q, in the base frame.
fn forward(arm: Arm, q: Joints) -> Kinematics {
    var out: Kinematics;
    //% if base
    var axes = array<vec3f, 3>(arm.base_x, arm.base_y, arm.base_z);
    var at = arm.base_at;
    //% else
    var axes = array<vec3f, 3>(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
    var at = vec3f(0.0);
    //% endif
    //% for link in links
    //% set i = loop.index0
    // DoF ${i}.
    //% if link.shift
    at = at + kept3(
        //% for k in link.shift
        ${"+ " if not loop.first else ""}axes[${k}] * arm.shift_${i}_${k}
        //% endfor
    );
    //% endif
    //% if link.turn
    axes = array<vec3f, 3>(
        //% for column in ["x", "y", "z"]
        axes[0] * arm.turn_${i}_${column}.x + axes[1] * arm.turn_${i}_${column}.y + axes[2] * arm.turn_${i}_${column}.z,
        //% endfor
    );
    //% endif
    out.axis[${i}] = ${"-" if link.flip else ""}axes[${link.axis}];
    //% if link.revolute
    {
        // Axis ${link.from} turns towards axis ${link.to}.
        let turn = sin_cos_within(q[${i}]);
        let a = axes[${link.from}];
        let b = axes[${link.to}];
        axes[${link.from}] = a * turn.cos + b * turn.sin;
        axes[${link.to}] = b * turn.cos - a * turn.sin;
    }
    //% else
    at = at + out.axis[${i}] * q[${i}];
    //% endif
    out.origin[${i}] = at;
    //% endfor
    //% if tip
    at = at + kept3(
        //% for k in tip
        ${"+ " if not loop.first else ""}axes[${k}] * arm.tip_${k}
        //% endfor
    );
    //% endif
    out.tip = kept3(at);
    return out;
}

/// The Jacobian's columns at the tip: how far the tip moves with each DoF.
fn columns(at: Kinematics) -> Jacobian {
    return Jacobian(
        //% for link in links
        //% if link.revolute
        cross3(at.axis[${loop.index0}], at.tip - at.origin[${loop.index0}]),
        //% else
        at.axis[${loop.index0}],
        //% endif
        //% endfor
    );
}
