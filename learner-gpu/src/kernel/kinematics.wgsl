// Forward kinematics and the Jacobian, written out for one chain. Mirror of core/src/kinematics.rs.

alias Joints = array<f32, ${dofs}>;
alias Jacobian = array<vec3f, ${dofs}>;

/// Motion after motion: the numbers of its arm and task, then its recorded frames, each a whole number of fours.
///
/// Read by fours: on lavapipe half of a tick's time went into reading them one by one. A uniform buffer, where they fit
/// in one and the device is the CPU: lavapipe looks numbers up in a storage buffer in a loop over its eight lanes, which
/// took two fifths of a tick, and in a uniform one without.
//% if window
@group(0) @binding(1) var<uniform> data: array<vec4f, ${window}>;
//% else
@group(0) @binding(1) var<storage, read> data: array<vec4f>;
//% endif

/// What differs from motion to motion: lengths, fixed turns, limits, first posture and target.
struct Arm {
    //% for number in numbers
    ${number.name}: ${number.type},
    //% endfor
}

/// The arm of the motion whose data begin there.
fn arm_of(at: u32) -> Arm {
    //% for four in range(arm_fours)
    let four_${four} = data[at + ${four}u];
    //% endfor
    return Arm(
        //% for number in numbers
        ${number.type}(
            //% for k in range(number.at, number.at + number.count)
            four_${k // 4}[${k % 4}],
            //% endfor
        ),
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
