// How a member of the population is varied (SPEC section 6). Mirror of proposal.rs: whole-number arithmetic on genes
// and draws, so that both propose the same bits.

/// Members of an island: one workgroup.
const ISLAND = ${island}u;
/// A gene at its upper bound.
const GENE = ${gene}u;

/// A member's genes by fours, the last of which may have some that nothing reads.
alias Genes = array<vec4u, ${gene_fours}>;

/// What the draws of one member in one generation depend on.
struct Draws {
    /// The run's seed, low and high half.
    seed: vec2u,
    /// The set of motions that the population is for.
    set_number: u32,
    /// The member, counted over all islands of the set.
    member: u32,
    generation: u32,
}

/// The `number`th four draws.
fn block(draws: Draws, number: u32) -> vec4u {
    return philox(vec4u(number, draws.generation, draws.member, draws.set_number), draws.seed);
}

/// 64·2.38/√(2d) for d genes, to the nearest whole number.
const STEP = array<i32, ${genes + 1}>(
    //% for d in range(genes + 1)
    ${step[d]},
    //% endfor
);

/// A member's genes in generation 0: uniform in the bounds.
fn first(draws: Draws) -> Genes {
    return Genes(
        //% for four in range(gene_fours)
        block(draws, ${1 + four}u) >> vec4u(8u),
        //% endfor
    );
}

/// Whether four genes, of which this is the first, take part, by their noise; one is sure to.
fn take_part(first: u32, noise: vec4u, share: u32, sure: u32) -> vec4<bool> {
    return ((noise & vec4u(255u)) < vec4u(share)) | (vec4u(first, first + 1u, first + 2u, first + 3u) == vec4u(sure));
}

/// x / 2^bits, rounded towards 0. No division: lavapipe does those one by one.
fn without_last_bits(x: vec4i, bits: u32) -> vec4i {
    let below = vec4i((1i << bits) - 1i);
    return (x + ((x >> vec4u(31u)) & below)) >> vec4u(bits);
}

/// A member's genes to be tried in a later generation: `which` is its island, `me` its place there, `best` that of the
/// best, and the members' genes are on these sides. `own` is the first block of draws, whose third decides acceptance.
fn propose(draws: Draws, own: vec4u, which: u32, me: u32, best: u32, sides: vec2u) -> Genes {
    const OTHERS = ISLAND - 1u;
    let first = own[0] % OTHERS;
    let other = (own[0] / OTHERS) % (OTHERS - 1u);
    let second = select(other, other + 1u, other >= first);
    let a = (me + 1u + first) % ISLAND;
    let b = (me + 1u + second) % ISLAND;
    let side = side_of(sides, me);
    let side_a = side_of(sides, a);
    let side_b = side_of(sides, b);
    let side_best = side_of(sides, best);

    // Which kind of step, what share of the genes, and how large a jitter.
    let kind = own[1] & 3u;
    let leap = ((own[1] >> 2u) & 7u) == 0u;
    let share = min(64u << ((own[1] >> 5u) & 3u), 256u);
    let jitter = 1u + (own[1] >> 7u) % 22u;

    // At least one gene takes part.
    let sure = own[3] % ${genes}u;
    var count = 0u;
    //% for four in range(gene_fours)
    let noise_${four} = block(draws, ${1 + four}u);
    let part_${four} = take_part(${4 * four}u, noise_${four}, share, sure);
    //% for k in range(4 * four, [4 * four + 4, genes] | min)
    count = count + u32(part_${four}[${k % 4}]);
    //% endfor
    //% endfor
    var steps = STEP;
    let step = select(steps[count], 64i, leap & (kind < 2u));

    var out: Genes;
    //% for four in range(gene_fours)
    {
        let x = vec4i(members[which].sides[side][${four}][me]);
        // A uniform draw in ±2²³.
        let uniform = vec4i(noise_${four} >> vec4u(8u)) - vec4i(1i << 23u);
        var delta = without_last_bits(uniform, select(jitter, 19u, kind < 2u));
        // Threads that need no other member do not wait for one.
        if kind < 3u {
            let difference = vec4i(members[which].sides[side_a][${four}][a]) - vec4i(members[which].sides[side_b][${four}][b]);
            delta = select(vec4i(0i), delta, kind < 2u) + without_last_bits(difference * step, 6u);
        }
        if kind == 2u {
            delta = delta + without_last_bits((vec4i(members[which].sides[side_best][${four}][best]) - x) * 32i, 6u);
        }
        let moved = clamp(x + delta, vec4i(0i), vec4i(i32(GENE)));
        out[${four}] = vec4u(select(x, moved, part_${four}));
    }
    //% endfor
    return out;
}

/// The parameter that a gene stands for.
fn parameter(gene: u32, lower: f32, upper: f32) -> f32 {
    return lower + (upper - lower) * (f32(gene) * (1.0 / f32(GENE)));
}

/// Whether annealing accepts a change of score, by a draw (Metropolis et al. 1953).
fn accepts(current: f32, proposed: f32, temperature: f32, draw: u32) -> bool {
    let rise = proposed - current;
    return (rise <= 0.0) | (exponential(-rise / temperature) > f32(draw >> 8u) * (1.0 / 16777216.0));
}
