// Chains of multiplications and additions that do not wait for each other: the most that a device computes. Four links a
// turn of the loop, for turns cost operations, too.

@group(0) @binding(0) var<storage, read_write> data: array<vec4f>;

@compute @workgroup_size(64)
fn fused(@builtin(global_invocation_id) at: vec3u) {
    let by = data[at.x].x;
    let plus = data[at.x].y;
    var a = data[at.x];
    var b = a.yzwx;
    var c = a.zwxy;
    for (var link = 0u; link < 4096u; link += 4u) {
        a = fma(a, vec4f(by), vec4f(plus));
        b = fma(b, vec4f(by), vec4f(plus));
        c = fma(c, vec4f(by), vec4f(plus));
        a = fma(a, vec4f(by), vec4f(plus));
        b = fma(b, vec4f(by), vec4f(plus));
        c = fma(c, vec4f(by), vec4f(plus));
        a = fma(a, vec4f(by), vec4f(plus));
        b = fma(b, vec4f(by), vec4f(plus));
        c = fma(c, vec4f(by), vec4f(plus));
        a = fma(a, vec4f(by), vec4f(plus));
        b = fma(b, vec4f(by), vec4f(plus));
        c = fma(c, vec4f(by), vec4f(plus));
    }
    data[at.x] = a + b + c;
}

@compute @workgroup_size(64)
fn separate(@builtin(global_invocation_id) at: vec3u) {
    let by = data[at.x].x;
    let plus = data[at.x].y;
    var a = data[at.x];
    var b = a.yzwx;
    var c = a.zwxy;
    for (var link = 0u; link < 4096u; link += 4u) {
        a = a * by + plus;
        b = b * by + plus;
        c = c * by + plus;
        a = a * by + plus;
        b = b * by + plus;
        c = c * by + plus;
        a = a * by + plus;
        b = b * by + plus;
        c = c * by + plus;
        a = a * by + plus;
        b = b * by + plus;
        c = c * by + plus;
    }
    data[at.x] = a + b + c;
}
