// The singular value decomposition of a Jacobian of three rows, by one-sided Jacobi rotations of its rows. Mirror of
// core/src/stepper/orthogonal.rs.

/// Sweeps over all pairs of rows.
const MOST_SWEEPS = 10;

/// Uᵀ·J and Uᵀ·ΔX.
struct Orthogonal {
    /// Columns of Uᵀ·J: component k of `rows[i]` is σₖ·vₖ at DoF i.
    rows: Jacobian,
    /// Uᵀ·ΔX.
    error: vec3f,
    /// σₖ².
    squares: vec3f,
    /// The greatest σ².
    most: f32,
}

fn orthogonal(j: Jacobian, right: vec3f) -> Orthogonal {
    var rows = j;
    var error = right;
    // A thread that is done leaves; in the core, lanes that are done rotate by 0, which changes no bit.
    for (var sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        var turned = false;
        //% for p, q in [("x", "y"), ("x", "z"), ("y", "z")]
        {
            var a = rows[0].${p} * rows[0].${p};
            var b = rows[0].${q} * rows[0].${q};
            var c = rows[0].${p} * rows[0].${q};
            //% for i in range(1, dofs)
            a = a + rows[${i}].${p} * rows[${i}].${p};
            b = b + rows[${i}].${q} * rows[${i}].${q};
            c = c + rows[${i}].${p} * rows[${i}].${q};
            //% endfor
            // Rows whose cosine is below 8·2⁻²³ are orthogonal.
            let needed = kept(9.094947017729282e-13) * (a * b) < c * c;
            turned = turned | needed;
            // tan of the angle: the smaller root of t² + 2ζt − 1 = 0.
            let zeta = (b - a) / (2.0 * select(1.0, c, needed));
            let root = 1.0 / (abs(zeta) + sqrt(1.0 + zeta * zeta));
            let tangent = select(0.0, select(root, -root, zeta < 0.0), needed);
            let cos = 1.0 / sqrt(1.0 + tangent * tangent);
            let sin = cos * tangent;
            //% for i in range(dofs)
            {
                let x = rows[${i}].${p};
                let y = rows[${i}].${q};
                rows[${i}].${p} = cos * x - sin * y;
                rows[${i}].${q} = sin * x + cos * y;
            }
            //% endfor
            let x = error.${p};
            let y = error.${q};
            error.${p} = cos * x - sin * y;
            error.${q} = sin * x + cos * y;
        }
        //% endfor
        if !turned {
            break;
        }
    }
    var squares = rows[0] * rows[0];
    //% for i in range(1, dofs)
    squares = squares + rows[${i}] * rows[${i}];
    //% endfor
    var greatest = most(squares.x, 0.0);
    greatest = most(squares.y, greatest);
    greatest = most(squares.z, greatest);
    return Orthogonal(rows, error, squares, greatest);
}

/// Whether σₖ is not below 1e-4·σ_max.
fn does_count(svd: Orthogonal, square: f32) -> bool {
    return 1e-8 * svd.most < square;
}
