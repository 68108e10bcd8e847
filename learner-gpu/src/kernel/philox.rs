//! Philox4x32-10, counter-based random numbers (Salmon, Moraes, Dror and Shaw 2011, *Parallel random numbers: as easy
//! as 1, 2, 3*). Mirror of `philox.wgsl`.
//!
//! A draw is a function of key and counter alone: no state. So CPU and GPU draw the same bits, any member of a
//! population can be replayed alone, and a run that goes on after a stop draws as if it had never stopped.

/// A seed as a key: its low half, then the high one.
#[inline(always)]
pub fn key(seed: u64) -> [u32; 2] {
    [seed as u32, (seed >> 32) as u32]
}

/// The high half of a product.
#[inline(always)]
fn high_product(a: u32, b: u32) -> u32 {
    ((u64::from(a) * u64::from(b)) >> 32) as u32
}

/// Four draws of 32 bits.
#[inline(always)]
pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let [mut c0, mut c1, mut c2, mut c3] = counter;
    let [mut k0, mut k1] = key;
    for _round in 0..10 {
        // Both halves are asked for by themselves: a compiler that makes lanes of it then needs no 64-bit product's low half.
        let p0 = [c0.wrapping_mul(0xD251_1F53), high_product(c0, 0xD251_1F53)];
        let p1 = [c2.wrapping_mul(0xCD9E_8D57), high_product(c2, 0xCD9E_8D57)];
        (c0, c1, c2, c3) = (p1[1] ^ c1 ^ k0, p1[0], p0[1] ^ c3 ^ k1, p0[0]);
        k0 = k0.wrapping_add(0x9E37_79B9);
        k1 = k1.wrapping_add(0xBB67_AE85);
    }
    [c0, c1, c2, c3]
}

#[cfg(test)]
mod tests {
    use super::philox;

    #[test]
    fn the_published_vectors_come_out() {
        // Random123's kat_vectors, philox4x32 10.
        let known = [
            (
                [0; 4],
                [0; 2],
                [0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8],
            ),
            (
                [u32::MAX; 4],
                [u32::MAX; 2],
                [0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd],
            ),
            (
                [0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344],
                [0xa4093822, 0x299f31d0],
                [0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1],
            ),
        ];
        for (counter, key, draws) in known {
            assert_eq!(philox(counter, key), draws);
        }
    }

    #[test]
    fn another_program_draws_the_same() {
        for n in 0..1000u32 {
            let key = [n.wrapping_mul(0x1234_5677), !n];
            let counter = [n, n << 7, n ^ 0xdead_beef, n.rotate_left(13)];
            let other = rand_philox::philox4x32_10(counter, key);
            assert_eq!(philox(counter, key), other);
        }
    }
}
