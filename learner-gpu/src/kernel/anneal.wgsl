// A generation of one island: propose, score, accept (SPEC section 6). Mirror of anneal.rs.
//
// A workgroup is an island and a thread a member. Islands do not know of each other, so a dispatch may run any of them,
// for any number of generations.

/// The score of a member that has none yet.
const UNSCORED = 1e30;

/// What a dispatch is to do.
struct Run {
    /// The run's seed, low and high half.
    seed: vec2u,
    /// The generations: from this one, until before that one.
    begin: u32,
    end: u32,
    /// The first island, and how many.
    first_island: u32,
    islands: u32,
    /// Workgroups in one row of the dispatch.
    columns: u32,
}

/// Which island of which set an island is, and the set's motions.
struct Place {
    set_number: u32,
    island: u32,
    first_motion: u32,
    motions: u32,
}

/// An island's members and its best.
struct Island {
    genes: array<array<u32, ${island}>, ${genes}>,
    scores: array<f32, ${island}>,
    best: Genes,
}

/// What the host wants to know often: the best score ever, and the mean.
struct Summary {
    best: f32,
    mean: f32,
}

@group(0) @binding(0) var<uniform> run: Run;
@group(0) @binding(4) var<storage, read> places: array<Place>;
@group(0) @binding(5) var<storage, read_write> islands: array<Island>;
@group(0) @binding(6) var<storage, read_write> summaries: array<Summary>;
/// Scores of the members as they are: what `score_members` writes.
@group(0) @binding(7) var<storage, read_write> scored: array<f32>;

/// The members' scores, and those of what they try.
var<workgroup> scores: array<f32, ${island}>;
var<workgroup> tried: array<f32, ${island}>;
/// What one thread finds out for all: see `spread` and `record`.
var<workgroup> now: Spread;
var<workgroup> best_score: f32;
var<workgroup> winner: u32;
/// The genes of the best ever.
var<workgroup> best: Genes;

/// The mean over the set's motions.
fn score(place: Place, genes: Genes) -> f32 {
    let parameters = Parameters(
        //% for bound in bounds
        parameter(genes[${loop.index0}], ${bound[0]}, ${bound[1]}),
        //% endfor
    );
    var sum = 0.0;
    for (var k = 0u; k < place.motions; k++) {
        sum = sum + score_motion(motions[place.first_motion + k], parameters);
    }
    return sum / f32(place.motions);
}

/// Of the island's scores: the member with the least, the mean, and the temperature: the mean less the least, over the
/// number of parameters.
struct Spread {
    best: u32,
    mean: f32,
    temperature: f32,
}

fn spread() -> Spread {
    var best_member = 0u;
    var least_score = UNSCORED;
    var sum = 0.0;
    for (var member = 0u; member < ISLAND; member++) {
        let this_score = scores[member];
        sum = sum + this_score;
        if this_score < least_score {
            least_score = this_score;
            best_member = member;
        }
    }
    let mean = sum / f32(ISLAND);
    return Spread(best_member, mean, (mean - least_score) / ${genes}.0);
}

/// Notes which member has just tried the best ever: the first of them, none where it is ISLAND.
fn record() {
    var found = ISLAND;
    var least_score = best_score;
    for (var member = 0u; member < ISLAND; member++) {
        let this_score = tried[member];
        if this_score < least_score {
            least_score = this_score;
            found = member;
        }
    }
    best_score = least_score;
    winner = found;
}

/// The island that this workgroup is, counted from the dispatch's first.
fn number(workgroup: vec3u) -> u32 {
    return workgroup.y * run.columns + workgroup.x;
}

@compute @workgroup_size(${island})
fn anneal(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    let place = places[which];
    //% for k in range(genes)
    island_genes[${k}][me] = islands[which].genes[${k}][me];
    //% endfor
    scores[me] = islands[which].scores[me];
    if me == 0u {
        best = islands[which].best;
        best_score = summaries[which].best;
    }
    workgroupBarrier();
    if me == 0u {
        now = spread();
    }
    workgroupBarrier();

    for (var generation = run.begin; generation < run.end; generation++) {
        let draws = Draws(run.seed, place.set_number, place.island * ISLAND + me, generation);
        let own = block(draws, 0u);
        var proposed: Genes;
        if generation == 0u {
            proposed = first(draws);
        } else {
            proposed = propose(draws, own, me, now.best);
        }
        let new_score = score(place, proposed);
        let accepted = accepts(scores[me], new_score, now.temperature, own[2]);

        // Everybody has read the island; now it changes.
        workgroupBarrier();
        tried[me] = new_score;
        if accepted {
            scores[me] = new_score;
            //% for k in range(genes)
            island_genes[${k}][me] = proposed[${k}];
            //% endfor
        }
        workgroupBarrier();
        // One thread looks at all members, in order as the CPU does: all of them doing so took longer than the motions.
        if me == 0u {
            now = spread();
            record();
        }
        workgroupBarrier();
        if winner == me {
            best = proposed;
        }
    }

    //% for k in range(genes)
    islands[which].genes[${k}][me] = island_genes[${k}][me];
    //% endfor
    islands[which].scores[me] = scores[me];
    workgroupBarrier();
    if me == 0u {
        islands[which].best = best;
        summaries[which] = Summary(best_score, now.mean);
    }
}

/// Scores the members as they are, and changes nothing of them.
@compute @workgroup_size(${island})
fn score_members(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) me: u32) {
    if number(workgroup) >= run.islands {
        return;
    }
    let which = run.first_island + number(workgroup);
    var genes: Genes;
    //% for k in range(genes)
    genes[${k}] = islands[which].genes[${k}][me];
    //% endfor
    scored[which * ISLAND + me] = score(places[which], genes);
}
