// Philox4x32-10, counter-based random numbers (Salmon et al. 2011). Mirror of philox.rs.

/// The high half of a product of 32-bit numbers, which WGSL has no word for: from products of halves of 16 bits.
fn high_product(a: u32, b: u32) -> u32 {
    let a0 = a & 0xFFFFu;
    let a1 = a >> 16u;
    let b0 = b & 0xFFFFu;
    let b1 = b >> 16u;
    let middle = a1 * b0 + ((a0 * b0) >> 16u);
    let carried = a0 * b1 + (middle & 0xFFFFu);
    return a1 * b1 + (middle >> 16u) + (carried >> 16u);
}

/// Four draws of 32 bits.
fn philox(counter: vec4u, key: vec2u) -> vec4u {
    var c = counter;
    var k = key;
    //% for round in range(10)
    {
        let p0 = vec2u(c.x * 0xD2511F53u, high_product(c.x, 0xD2511F53u));
        let p1 = vec2u(c.z * 0xCD9E8D57u, high_product(c.z, 0xCD9E8D57u));
        c = vec4u(p1.y ^ c.y ^ k.x, p1.x, p0.y ^ c.w ^ k.y, p0.x);
        k = k + vec2u(0x9E3779B9u, 0xBB67AE85u);
    }
    //% endfor
    return c;
}
