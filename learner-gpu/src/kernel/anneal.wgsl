// A generation of one island: propose, score, accept (SPEC section 6). Mirror of anneal.rs.
//
// A generation is three dispatches, of a thread for each member: `propose_members` writes what members are to become to
// where the next generation looks for them, while what another member may still look at stays; `score_members` scores
// that, with a workgroup for each island and each of its motions, so that a vector for many motions keeps a device as busy
// as many vectors; `settle` adds the motions' scores up in their order, decides, and sums the island up. The hot one has no
// barrier: with one lavapipe takes twice as long, for it keeps all that lives across a barrier in memory, the whole time.

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
    /// Workgroups in one row of the dispatch.
    columns: u32,
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
}

/// Which island of which set an island is, and the set's motions.
struct Place {
    set_number: u32,
    island: u32,
    first_motion: u32,
    motions: u32,
}

/// An island's members.
struct Members {
    genes: array<array<vec4u, ${island}>, ${gene_fours}>,
    // One by one: members' threads store side by side, and a store to a vector's component may touch all of the vector.
    scores: array<f32, ${island}>,
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
    /// The genes of the best ever.
    best_genes: Genes,
}

@group(0) @binding(0) var<uniform> run: Run;
@group(0) @binding(3) var<storage, read> places: array<Place>;
/// The islands as the generation begins, and as the next one does.
@group(0) @binding(4) var<storage, read> members: array<Members>;
@group(0) @binding(5) var<storage, read_write> next: array<Members>;
@group(0) @binding(6) var<storage, read_write> summaries: array<Summary>;
/// The scores of what is proposed, motion after motion of those that are scored at once: of each island, its members'.
@group(0) @binding(7) var<storage, read_write> scored: array<array<f32, ${island}>>;

/// The members' scores, for the thread that sums them up.
var<workgroup> settled: array<f32, ${island}>;

/// Which workgroup of the dispatch this is; too large in the last row's rest.
fn number(workgroup: vec3u) -> u32 {
    return workgroup.y * run.columns + workgroup.x;
}

/// Whether a set has none of the motions that are scored at once, though it has earlier ones.
fn is_done(place: Place) -> bool {
    return (run.first_motion > 0u) & (run.first_motion >= place.motions);
}

/// What this member draws in this generation.
fn draws_of(place: Place, me: u32) -> Draws {
    return Draws(run.seed, place.set_number, place.island * ISLAND + me, run.generation);
}

/// Proposes.
@compute @workgroup_size(${island})
fn propose_members(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    let draws = draws_of(places[which], me);
    var genes: Genes;
    if run.generation == 0u {
        genes = first(draws);
    } else {
        genes = propose(draws, block(draws, 0u), which, me, summaries[which].best & ((1u << BEST_BITS) - 1u));
    }
    //% for four in range(gene_fours)
    next[which].genes[${four}][me] = genes[${four}];
    //% endfor
}

/// Scores what is proposed, one of the motions.
@compute @workgroup_size(${island})
fn score_members(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    // Islands next to each other run the same motion, or one as long.
    let motion = number(workgroup) / run.islands;
    if motion >= run.motions {
        return;
    }
    nothing = run.nothing;
    let which = run.first_island + number(workgroup) % run.islands;
    let place = places[which];
    if run.first_motion + motion >= place.motions {
        return;
    }
    //% for four in range(gene_fours)
    let four_${four} = next[which].genes[${four}][me];
    //% endfor
    let parameters = Parameters(
        //% for bound in bounds
        parameter(four_${loop.index0 // 4}[${loop.index0 % 4}], ${bound[0]}, ${bound[1]}),
        //% endfor
    );
    scored[number(workgroup)][me] = score_motion(motions[place.first_motion + run.first_motion + motion], parameters);
}

/// Adds up what is scored. With a set's last motion it decides, and sums the island up for the next generation: the best
/// ever, the member with the least score (of those as good as each other, the first), the mean, and the temperature: the
/// mean less the least, over the number of parameters.
@compute @workgroup_size(${island})
fn settle(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    nothing = run.nothing;
    let which = run.first_island + number(workgroup);
    let place = places[which];
    if is_done(place) {
        return;
    }
    var score = next[which].scores[me];
    if run.motions > 0u {
        if run.first_motion == 0u {
            score = 0.0;
        }
        let end = min(run.motions, place.motions - run.first_motion);
        for (var motion = 0u; motion < end; motion++) {
            score = score + scored[motion * run.islands + number(workgroup)][me];
        }
        if run.first_motion + end < place.motions {
            next[which].scores[me] = score;
            return;
        }
        score = score / f32(place.motions);
        let current = members[which].scores[me];
        let draw = block(draws_of(place, me), 0u)[2];
        if !accepts(current, score, summaries[which].temperature, draw) {
            score = current;
            //% for four in range(gene_fours)
            next[which].genes[${four}][me] = members[which].genes[${four}][me];
            //% endfor
        }
        next[which].scores[me] = score;
    }
    settled[me] = score;
    workgroupBarrier();
    if me > 0u {
        return;
    }
    var best = 0u;
    var least_score = UNSCORED;
    var sum = 0.0;
    for (var member = 0u; member < ISLAND; member++) {
        let score = settled[member];
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
    // Better than all before is none but what was accepted just now.
    if least_score < summaries[which].best_score {
        summaries[which].best_score = least_score;
        //% for four in range(gene_fours)
        summaries[which].best_genes[${four}] = next[which].genes[${four}][best];
        //% endfor
    }
}
