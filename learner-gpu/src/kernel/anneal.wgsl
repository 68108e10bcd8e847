// A generation of one island: propose, score, accept (SPEC section 6). Mirror of anneal.rs.
//
// A workgroup is an island and a thread a member. A generation is two dispatches: `attempt` proposes, scores and
// decides, and changes nothing that another member may still look at; `settle` carries out what was decided. With a
// barrier between the two in one dispatch lavapipe takes twice as long: it keeps all that lives across a barrier in
// memory, the whole time.

/// The score of a member that has none yet.
const UNSCORED = 1e30;

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

/// An island's members, and the genes of its best ever.
struct Island {
    genes: array<array<u32, ${island}>, ${genes}>,
    scores: array<f32, ${island}>,
    best: Genes,
}

/// What is known of an island as a whole, as the generation begins.
struct Summary {
    /// The best score ever.
    best_score: f32,
    /// The members' mean score.
    mean: f32,
    temperature: f32,
    /// The member with the least score.
    best: u32,
}

/// What an island's members try.
struct Tried {
    genes: array<array<u32, ${island}>, ${genes}>,
    scores: array<f32, ${island}>,
    accepted: array<u32, ${island}>,
}

@group(0) @binding(0) var<uniform> run: Run;
@group(0) @binding(4) var<storage, read> places: array<Place>;
@group(0) @binding(5) var<storage, read_write> islands: array<Island>;
@group(0) @binding(6) var<storage, read_write> summaries: array<Summary>;
@group(0) @binding(7) var<storage, read_write> tried: array<Tried>;

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
        parameter(genes[${loop.index0}], ${bound[0]}, ${bound[1]}),
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
    var proposed: Genes;
    var before = 0.0;
    if run.first_motion > 0u {
        //% for k in range(genes)
        proposed[${k}] = tried[which].genes[${k}][me];
        //% endfor
        before = tried[which].scores[me];
    } else if run.generation == 0u {
        proposed = first(draws);
    } else {
        proposed = propose(draws, own, which, me, summaries[which].best);
    }
    let new_score = score(place, proposed, before);
    // Of a part it means nothing, and the last part decides again.
    let accepted = accepts(islands[which].scores[me], new_score, summaries[which].temperature, own[2]);
    //% for k in range(genes)
    tried[which].genes[${k}][me] = proposed[${k}];
    //% endfor
    tried[which].scores[me] = new_score;
    tried[which].accepted[me] = u32(accepted);
}

/// The scores after and in the generation, for one thread to look at all of them.
var<workgroup> scores: array<f32, ${island}>;
var<workgroup> new_scores: array<f32, ${island}>;

/// Carries out what was decided, keeps the best ever, and sums up the island for the next generation.
@compute @workgroup_size(${island})
fn settle(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    let accepted = tried[which].accepted[me] != 0u;
    // What is better than all before was accepted, so the rest need not be looked at.
    new_scores[me] = select(UNSCORED, tried[which].scores[me], accepted);
    if accepted {
        islands[which].scores[me] = new_scores[me];
        //% for k in range(genes)
        islands[which].genes[${k}][me] = tried[which].genes[${k}][me];
        //% endfor
    }
    scores[me] = islands[which].scores[me];
    workgroupBarrier();
    if me == 0u {
        record(which);
        sum_up(which);
    }
}

/// Keeps the best ever: of members as good as each other, the first.
fn record(which: u32) {
    var best_score = summaries[which].best_score;
    var winner = ISLAND;
    for (var member = 0u; member < ISLAND; member++) {
        let this_score = new_scores[member];
        if this_score < best_score {
            best_score = this_score;
            winner = member;
        }
    }
    if winner < ISLAND {
        summaries[which].best_score = best_score;
        //% for k in range(genes)
        islands[which].best[${k}] = tried[which].genes[${k}][winner];
        //% endfor
    }
}

/// The member with the least score, the mean, and the temperature: the mean less the least, over the number of
/// parameters.
fn sum_up(which: u32) {
    var best = 0u;
    var least_score = UNSCORED;
    var sum = 0.0;
    for (var member = 0u; member < ISLAND; member++) {
        let this_score = scores[member];
        sum = sum + this_score;
        if this_score < least_score {
            least_score = this_score;
            best = member;
        }
    }
    let mean = sum / f32(ISLAND);
    summaries[which].mean = mean;
    summaries[which].temperature = (mean - least_score) / ${genes}.0;
    summaries[which].best = best;
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
    //% for k in range(genes)
    genes[${k}] = islands[which].genes[${k}][me];
    //% endfor
    let before = select(0.0, tried[which].scores[me], run.first_motion > 0u);
    tried[which].scores[me] = score(place, genes, before);
}
