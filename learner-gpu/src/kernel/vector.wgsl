// Three numbers in space, each operation in the core's order. Mirror of core/src/vector.rs.
//
// WGSL's own dot, cross and distance leave the order to the driver.

/// The inner product, summed from the first row down.
fn dot3(a: vec3f, b: vec3f) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

/// Each of them kept (see math.wgsl).
fn kept3(v: vec3f) -> vec3f {
    return vec3f(kept(v.x), kept(v.y), kept(v.z));
}

fn cross3(a: vec3f, b: vec3f) -> vec3f {
    return vec3f(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/// The distance between two points.
fn distance3(a: vec3f, b: vec3f) -> f32 {
    let d = a - b;
    return sqrt(dot3(d, d));
}
