// A generation of one island: propose, score, accept (SPEC section 6). Mirror of anneal.rs.
//
// A generation is three dispatches, of a thread for each member: `propose_members` writes what members may become to their
// other sides, while what another member may still look at stays; `score_members` scores that, with a workgroup for each
// island and each of its motions, so that a vector for many motions keeps a device as busy as many vectors; `settle` adds
// the motions' scores up in their order, decides, and sums the island up. Who accepts turns over, and no gene is copied.
// Where an island has one motion, `try_members` is the first two at once. The hot ones have no barrier: with one lavapipe
// takes twice as long, for it keeps all that lives across a barrier in memory, the whole time. And they have no code for
// ticks that need singular values: no more than one motion in a hundred has any, once a search is under way, but lavapipe
// jumps over nothing, and a GPU reserves registers. `score_hard` runs these motions again.

/// The score of a member that has none yet.
const UNSCORED = 1e30;
/// The least temperature: where all scores are alike, rounding may put their mean below the least of them.
const COLDEST = 1e-20;
/// Bits that a member's number in its island takes.
const BEST_BITS = ${island_bits}u;

/// What a dispatch is to do.
struct Run {
    /// The run's seed, low and high half.
    seed: vec2u,
    generation: u32,
    /// The first island, and how many.
    first_island: u32,
    islands: u32,
    /// λ·dt.
    gain: f32,
    /// The period, seconds.
    dt: f32,
    /// 0: see `kept`.
    nothing: u32,
    /// The first of each set's motions that are scored at once, and how many: a part, where a set would take long. None
    /// where members have come with their scores.
    first_motion: u32,
    motions: u32,
    /// 1 where what members may become is scored, 0 where they are themselves.
    other: u32,
}

/// Which island of which set an island is, and the set's motions.
struct Place {
    set_number: u32,
    island: u32,
    first_motion: u32,
    motions: u32,
}

/// An island's members. Each has two sides: its genes are on one, and what it may become is on the other.
struct Members {
    sides: array<array<array<vec4u, ${island}>, ${gene_fours}>, 2>,
    // One by one: members' threads store side by side, and a store to a vector's component may touch all of the vector.
    scores: array<f32, ${island}>,
    /// Of what it may become, the sum of the scores so far, and what draw decides.
    sums: array<f32, ${island}>,
    draws: array<u32, ${island}>,
}

/// What is known of an island as a whole, as the generation begins.
struct Summary {
    /// The best score ever.
    best_score: f32,
    /// The members' mean score.
    mean: f32,
    temperature: f32,
    /// The member with the least score, and above its bits which generation this is: a driver that says that it has run
    /// what it has not is found out.
    best: u32,
    /// The members' sides, a bit each.
    sides: vec2u,
    /// The genes of the best ever.
    best_genes: Genes,
}

@group(0) @binding(0) var<uniform> run: Run;
@group(0) @binding(3) var<storage, read> places: array<Place>;
@group(0) @binding(4) var<storage, read_write> members: array<Members>;
@group(0) @binding(5) var<storage, read_write> summaries: array<Summary>;
/// The scores of what is proposed, motion after motion of those that are scored at once: of each island, its members'.
@group(0) @binding(6) var<storage, read_write> scored: array<array<f32, ${island}>>;

//% if has_hard
/// The motions that have to be run again: places in `scored`, member by member.
struct Hard {
    count: atomic<u32>,
    members: array<u32>,
}

@group(0) @binding(7) var<storage, read_write> hard: Hard;
//% endif

/// The members' scores, for the thread that sums them up: negative (bit 31) of those that turned over.
var<workgroup> settled: array<u32, ${island}>;
const TURNED = 1u << 31u;

/// Which thread of which workgroup it is: `me` is its member's place in the island.
struct Thread {
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) me: u32,
}

/// What a workgroup of the dispatch works on, by number; there may be a few more of them than there is work.
///
/// The numbers' eighths take turns: lavapipe gives each of its threads one stretch of workgroups, and motions next to each
/// other are often as long.
fn number(thread: Thread) -> u32 {
    let nth = thread.workgroup.y * thread.workgroups.x + thread.workgroup.x;
    return (nth & 7u) * ((thread.workgroups.x * thread.workgroups.y) >> 3u) + (nth >> 3u);
}

/// The side on which a member's genes are.
fn side_of(sides: vec2u, member: u32) -> u32 {
    return (select(sides.x, sides.y, member >= 32u) >> (member & 31u)) & 1u;
}

/// Whether a set has none of the motions that are scored at once, though it has earlier ones.
fn is_done(place: Place) -> bool {
    return (run.first_motion > 0u) & (run.first_motion >= place.motions);
}

/// What this member draws in this generation.
fn draws_of(place: Place, me: u32) -> Draws {
    return Draws(run.seed, place.set_number, place.island * ISLAND + me, run.generation);
}

/// The parameters that genes stand for.
fn parameters_of(genes: Genes) -> Parameters {
    return Parameters(
        //% for bound in bounds
        parameter(genes[${loop.index0 // 4}][${loop.index0 % 4}], ${bound[0]}, ${bound[1]}),
        //% endfor
    );
}

/// What a member may become, which is also written to its other side.
fn proposal(which: u32, place: Place, me: u32) -> Genes {
    let draws = draws_of(place, me);
    let own = block(draws, 0u);
    let sides = summaries[which].sides;
    var genes: Genes;
    if run.generation == 0u {
        genes = first(draws);
    } else {
        genes = propose(draws, own, which, me, summaries[which].best & ((1u << BEST_BITS) - 1u), sides);
    }
    let other = 1u - side_of(sides, me);
    //% for four in range(gene_fours)
    members[which].sides[other][${four}][me] = genes[${four}];
    //% endfor
    members[which].draws[me] = own[2];
    return genes;
}

/// A member's genes that are to be scored.
fn genes_of(which: u32, me: u32) -> Genes {
    let side = side_of(summaries[which].sides, me) ^ run.other;
    return Genes(
        //% for four in range(gene_fours)
        members[which].sides[side][${four}][me],
        //% endfor
    );
}

/// Writes a score where `settle` looks for it.
fn note(at: u32, me: u32, score: Score) {
    scored[at][me] = score.mean;
    //% if has_hard
    if !score.easy {
        hard.members[atomicAdd(&hard.count, 1u)] = at * ISLAND + me;
    }
    //% endif
}

/// Proposes.
@compute @workgroup_size(${island})
fn propose_members(thread: Thread) {
    let number = number(thread);
    if number >= run.islands {
        return;
    }
    let which = run.first_island + number;
    _ = proposal(which, places[which], thread.me);
}

/// Proposes, and scores that, where islands have one motion.
@compute @workgroup_size(${island})
fn try_members(thread: Thread) {
    let number = number(thread);
    if number >= run.islands {
        return;
    }
    nothing = run.nothing;
    let which = run.first_island + number;
    let place = places[which];
    let parameters = parameters_of(proposal(which, place, thread.me));
    note(number, thread.me, score_motion(motions[place.first_motion], parameters, false));
}

/// Scores what is proposed, one of the motions.
@compute @workgroup_size(${island})
fn score_members(thread: Thread) {
    let number = number(thread);
    // Motion after motion, each of all islands.
    let motion = number / run.islands;
    if motion >= run.motions {
        return;
    }
    nothing = run.nothing;
    let which = run.first_island + number % run.islands;
    let place = places[which];
    if run.first_motion + motion >= place.motions {
        return;
    }
    let parameters = parameters_of(genes_of(which, thread.me));
    note(number, thread.me, score_motion(motions[place.first_motion + run.first_motion + motion], parameters, false));
}

//% if has_hard
/// Scores once more what needs it: a thread has one of these motions after the other.
@compute @workgroup_size(${island})
fn score_hard(thread: Thread) {
    nothing = run.nothing;
    let count = atomicLoad(&hard.count);
    let threads = thread.workgroups.x * thread.workgroups.y * ISLAND;
    for (var next = number(thread) * ISLAND + thread.me; next < count; next += threads) {
        let at = hard.members[next] / ISLAND;
        let member = hard.members[next] % ISLAND;
        let which = run.first_island + at % run.islands;
        let motion = places[which].first_motion + run.first_motion + at / run.islands;
        scored[at][member] = score_motion(motions[motion], parameters_of(genes_of(which, member)), true).mean;
    }
}
//% endif

/// Adds up what is scored. With a set's last motion it decides, and sums the island up for the next generation: the best
/// ever, the member with the least score (of those as good as each other, the first), the mean, and the temperature: the
/// mean less the least, over the number of parameters.
@compute @workgroup_size(${island})
fn settle(thread: Thread) {
    let number = number(thread);
    if number >= run.islands {
        return;
    }
    nothing = run.nothing;
    //% if has_hard
    if (number == 0u) & (thread.me == 0u) {
        atomicStore(&hard.count, 0u);
    }
    //% endif
    let which = run.first_island + number;
    let place = places[which];
    if is_done(place) {
        return;
    }
    var score = members[which].scores[thread.me];
    var turned = 0u;
    if run.motions > 0u {
        let current = score;
        score = 0.0;
        if run.first_motion > 0u {
            score = members[which].sums[thread.me];
        }
        let end = min(run.motions, place.motions - run.first_motion);
        for (var motion = 0u; motion < end; motion++) {
            score = score + scored[motion * run.islands + number][thread.me];
        }
        if run.first_motion + end < place.motions {
            members[which].sums[thread.me] = score;
            return;
        }
        score = score / f32(place.motions);
        if accepts(current, score, summaries[which].temperature, members[which].draws[thread.me]) {
            turned = TURNED;
            members[which].scores[thread.me] = score;
        } else {
            score = current;
        }
    }
    settled[thread.me] = bitcast<u32>(score) | turned;
    workgroupBarrier();
    if thread.me > 0u {
        return;
    }
    var best = 0u;
    var least_score = UNSCORED;
    var sum = 0.0;
    var sides = summaries[which].sides;
    for (var member = 0u; member < ISLAND; member++) {
        let turned = (settled[member] >> 31u) << (member & 31u);
        sides = sides ^ select(vec2u(turned, 0u), vec2u(0u, turned), member >= 32u);
        let score = bitcast<f32>(settled[member] & (TURNED - 1u));
        sum = sum + score;
        if score < least_score {
            least_score = score;
            best = member;
        }
    }
    let mean = sum / f32(ISLAND);
    summaries[which].mean = mean;
    summaries[which].temperature = max((mean - least_score) / ${genes}.0, COLDEST);
    summaries[which].best = best | (run.generation + 1u) << BEST_BITS;
    summaries[which].sides = sides;
    // Better than all before is none but what was accepted just now.
    if least_score < summaries[which].best_score {
        summaries[which].best_score = least_score;
        //% for four in range(gene_fours)
        summaries[which].best_genes[${four}] = members[which].sides[side_of(sides, best)][${four}][best];
        //% endfor
    }
}
