// How a member of the population is varied (SPEC section 6). Mirror of proposal.rs: whole-number arithmetic on genes
// and draws, so that both propose the same bits.

/// Members of an island: one workgroup.
const ISLAND = ${island}u;
/// A gene at its upper bound.
const GENE = ${gene}u;

alias Genes = array<u32, ${genes}>;

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
    var out: Genes;
    //% for four in range((genes + 3) // 4)
    {
        let draw = block(draws, ${1 + four}u);
        //% for lane in range(4)
        //% if 4 * four + lane < genes
        out[${4 * four + lane}] = draw[${lane}] >> 8u;
        //% endif
        //% endfor
    }
    //% endfor
    return out;
}

/// Whether a gene takes part, by its noise; one is sure to.
fn takes_part(k: u32, noise: u32, share: u32, sure: u32) -> bool {
    return ((noise & 255u) < share) | (k == sure);
}

/// A member's genes to be tried in a later generation: `which` is its island, `me` its place there, `best` that of the
/// best. `own` is the first block of draws, whose third decides acceptance.
fn propose(draws: Draws, own: vec4u, which: u32, me: u32, best: u32) -> Genes {
    const OTHERS = ISLAND - 1u;
    let first = own[0] % OTHERS;
    let other = (own[0] / OTHERS) % (OTHERS - 1u);
    let second = select(other, other + 1u, other >= first);
    let a = (me + 1u + first) % ISLAND;
    let b = (me + 1u + second) % ISLAND;

    // Which kind of step, what share of the genes, and how large a jitter.
    let kind = own[1] & 3u;
    let leap = ((own[1] >> 2u) & 7u) == 0u;
    let share = min(64u << ((own[1] >> 5u) & 3u), 256u);
    let jitter = 1u + (own[1] >> 7u) % 22u;

    var noise: Genes;
    //% for four in range((genes + 3) // 4)
    {
        let draw = block(draws, ${1 + four}u);
        //% for lane in range(4)
        //% if 4 * four + lane < genes
        noise[${4 * four + lane}] = draw[${lane}];
        //% endif
        //% endfor
    }
    //% endfor
    // At least one gene takes part.
    let sure = own[3] % ${genes}u;
    var count = 0u;
    //% for k in range(genes)
    count = count + u32(takes_part(${k}u, noise[${k}], share, sure));
    //% endfor
    var steps = STEP;
    let step = select(steps[count], 64i, leap & (kind < 2u));

    var out: Genes;
    //% for k in range(genes)
    {
        let x = i32(islands[which].genes[${k}][me]);
        let difference = (i32(islands[which].genes[${k}][a]) - i32(islands[which].genes[${k}][b])) * step / 64i;
        // A uniform draw in ±2²³.
        let uniform = i32(noise[${k}] >> 8u) - (1i << 23u);
        let towards = difference + (i32(islands[which].genes[${k}][best]) - x) * 32i / 64i;
        var delta = select(uniform / (1i << jitter), towards, kind == 2u);
        delta = select(delta, difference + uniform / (1i << 19u), kind < 2u);
        let moved = clamp(x + delta, 0i, i32(GENE));
        out[${k}] = u32(select(x, moved, takes_part(${k}u, noise[${k}], share, sure)));
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
