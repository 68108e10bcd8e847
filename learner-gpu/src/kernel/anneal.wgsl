// A generation of one island: propose, score, accept (SPEC section 6). Mirror of anneal.rs.
//
// A generation is two dispatches. `attempt`, of a workgroup for each island and a thread for each member, proposes,
// scores, decides, and writes the members to where the next generation looks for them: what another member may still
// look at stays. `settle`, of a thread for each island, sums up. With a barrier between the two in one dispatch lavapipe
// takes twice as long: it keeps all that lives across a barrier in memory, the whole time.

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
    /// 0, which the compiler does not know: see `kept`.
    nothing: u32,
    /// The first of each set's motions that this dispatch scores, and how many: a part, where a set would take long.
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

/// The island that this workgroup is, counted from the dispatch's first; too large in the last row's rest.
fn number(workgroup: vec3u) -> u32 {
    return workgroup.y * run.columns + workgroup.x;
}

/// Whether a set has none of the motions that this dispatch scores.
fn is_done(place: Place) -> bool {
    return (run.first_motion > 0u) & (run.first_motion >= place.motions);
}

/// Whether a set's last motion is among those that this dispatch scores.
fn is_last(place: Place) -> bool {
    return place.motions <= run.first_motion + run.motions;
}

/// The mean over the set's motions; the sum so far, where some are left for later dispatches. `before` is the sum of
/// those of earlier ones.
fn score(place: Place, genes: Genes, before: f32) -> f32 {
    let parameters = Parameters(
        //% for bound in bounds
        parameter(genes[${loop.index0 // 4}][${loop.index0 % 4}], ${bound[0]}, ${bound[1]}),
        //% endfor
    );
    var sum = before;
    let end = min(run.first_motion + run.motions, place.motions);
    for (var k = run.first_motion; k < end; k++) {
        sum = sum + score_motion(motions[place.first_motion + k], parameters);
    }
    return select(sum, sum / f32(place.motions), is_last(place));
}

/// Proposes, scores and decides.
@compute @workgroup_size(${island})
fn attempt(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    let place = places[which];
    if is_done(place) {
        return;
    }
    let draws = Draws(run.seed, place.set_number, place.island * ISLAND + me, run.generation);
    let own = block(draws, 0u);
    var genes: Genes;
    var before = 0.0;
    if run.first_motion > 0u {
        // What earlier dispatches scored a part of.
        //% for four in range(gene_fours)
        genes[${four}] = next[which].genes[${four}][me];
        //% endfor
        before = next[which].scores[me];
    } else if run.generation == 0u {
        genes = first(draws);
    } else {
        genes = propose(draws, own, which, me, summaries[which].best & ((1u << BEST_BITS) - 1u));
    }
    var new_score = score(place, genes, before);
    let current = members[which].scores[me];
    if is_last(place) & !accepts(current, new_score, summaries[which].temperature, own[2]) {
        new_score = current;
        //% for four in range(gene_fours)
        genes[${four}] = members[which].genes[${four}][me];
        //% endfor
    }
    next[which].scores[me] = new_score;
    //% for four in range(gene_fours)
    next[which].genes[${four}][me] = genes[${four}];
    //% endfor
}

/// Sums an island up for the next generation: the best ever, the member with the least score (of those as good as each
/// other, the first), the mean, and the temperature: the mean less the least, over the number of parameters.
@compute @workgroup_size(${island})
fn settle(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    let island = number(workgroup) * ISLAND + me;
    if island >= run.islands {
        return;
    }
    let which = run.first_island + island;
    var best = 0u;
    var least_score = UNSCORED;
    var sum = 0.0;
    for (var member = 0u; member < ISLAND; member++) {
        let score = next[which].scores[member];
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

/// Scores the members as they are, and changes nothing of them.
@compute @workgroup_size(${island})
fn score_members(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    let place = places[which];
    if is_done(place) {
        return;
    }
    var genes: Genes;
    //% for four in range(gene_fours)
    genes[${four}] = members[which].genes[${four}][me];
    //% endfor
    var before = 0.0;
    if run.first_motion > 0u {
        before = next[which].scores[me];
    }
    next[which].scores[me] = score(place, genes, before);
}
