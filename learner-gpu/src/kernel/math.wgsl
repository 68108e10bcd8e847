// sin, cos and exp: the hot path of a control tick. Mirror of core/src/math.rs and of the selects of core/src/real.rs.
//
// WGSL's own are not used: their errors differ from device to device, and one of them would not do for both backends.

/// Adding this to a small whole number puts it, modulo 2²², into the sum's last bits.
const SHIFTER = 12582912.0; // 1.5 · 2²³

/// 0, which the compiler does not know: entry points take it from `run`. Each lookup there costs lavapipe some.
var<private> nothing: u32;

/// x, hidden from the compiler, so that what is made of it stays in the order in which it is written.
///
/// A driver may reorder sums and products: it takes constants to the front, adds the products of a sum last, and makes
/// (p + d) − p into d. That is not less exact, but other bits than the CPU's. What it cannot see through stops it.
fn kept(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) | nothing);
}

/// The smaller; b where a is NaN.
fn least(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

/// The greater; b where a is NaN.
fn most(a: f32, b: f32) -> f32 {
    return select(b, a, b < a);
}

/// x moved into [lo, hi]; lo where it is NaN.
fn within(x: f32, lo: f32, hi: f32) -> f32 {
    return least(most(x, lo), hi);
}

/// Whether the magnitude is below 1e30 (false for NaN).
fn is_sane(x: f32) -> bool {
    return abs(x) < 1e30;
}

struct SinCos {
    sin: f32,
    cos: f32,
}

/// Sine and cosine of an angle that lies within ±8192 rad.
///
/// `round` where the core adds and subtracts the shifter: a driver that reassociates would undo that.
fn sin_cos_within(x: f32) -> SinCos {
    let k = round(x * 0.6366197723675814);
    let r1 = x - k * 1.5703125;
    let r2 = r1 - k * 4.837512969970703e-4;
    let r = r2 - k * 7.549789948768648e-8;
    let rr = r * r;
    let s = ((-1.9515295891e-4 * rr + 8.3321608736e-3) * rr + -1.6666654611e-1) * rr * r + r;
    let c = kept(((2.443315711809948e-5 * rr + -1.388731625493765e-3) * rr + 4.166664568298827e-2) * rr * rr - 0.5 * rr) + 1.0;
    let quarter = bitcast<u32>(k + SHIFTER);
    let odd = (quarter & 1u) != 0u;
    // k mod 4:   0       1        2        3
    // sin, cos:  s, c    c, -s    -s, -c   -c, s
    let sin = bitcast<u32>(select(s, c, odd)) ^ ((quarter & 2u) << 30u);
    let cos = bitcast<u32>(select(c, s, odd)) ^ (((quarter + 1u) & 2u) << 30u);
    return SinCos(bitcast<f32>(sin), bitcast<f32>(cos));
}

/// The exponential, saturated so that it is positive, normal and finite.
fn exponential(x: f32) -> f32 {
    let y = within(x, -87.0, 88.0);
    let k = round(y * 1.4426950408889634);
    let r1 = y - k * 0.693359375;
    let r = r1 - k * -2.1219444e-4;
    var p = 1.98756915e-4 * r + 1.3981999507e-3;
    p = p * r + 8.3334519073e-3;
    p = p * r + 4.1665795894e-2;
    p = p * r + 1.6666665459e-1;
    p = p * r + 5.0000001201e-1;
    let power = bitcast<f32>((bitcast<u32>(k + SHIFTER) + 127u) << 23u);
    return (kept(p * (r * r) + r) + 1.0) * power;
}
