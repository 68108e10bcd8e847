//! Every piece of the core alone, by Criterion: forward kinematics, Jacobian, steppers, ticks and the metric, in `f32`
//! and `f64`, and the same kinematics by the crate `k`.
//!
//! ```text
//! cargo bench -p sinew-benches
//! cargo bench -p sinew-benches -- tick
//! ```

use std::any::type_name;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use sinew::chain::Chain;
use sinew::metric::posture_distance;
use sinew::real::Real;
use sinew::stepper::{
    Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Stepper, Transpose,
};
use sinew::target::{Position, Target};
use sinew_benches::{
    START, TARGET, arm, controller, forward, forward_and_jacobian, k, panda, postures,
};

/// The Panda in `f64`, ours and k's.
fn kinematics(c: &mut Criterion) {
    let chain = panda();
    let theirs = k::Panda::new();
    let q = postures(&chain, 1)[0];
    let mut group = c.benchmark_group("panda f64");
    group.bench_function("forward", |b| b.iter(|| forward(&chain, black_box(&q))));
    group.bench_function("forward by k", |b| b.iter(|| theirs.forward(black_box(&q))));
    group.bench_function("forward and jacobian", |b| {
        b.iter(|| forward_and_jacobian(&chain, black_box(&q)))
    });
    group.bench_function("forward and jacobian by k", |b| {
        b.iter(|| theirs.forward_and_jacobian(black_box(&q)))
    });
}

/// The human arm in one scalar.
fn pieces<T: Real>(c: &mut Criterion) {
    let chain: Chain<T, 7> = arm().cast();
    let q = START.map(T::of);
    let at = chain.forward(&q);
    let target = Position::new(TARGET.map(T::of)).expect("it is a place");
    let scalar = type_name::<T>();

    let mut group = c.benchmark_group(format!("arm {scalar}"));
    group.bench_function("forward", |b| b.iter(|| chain.forward(black_box(&q)).tip()));
    group.bench_function("jacobian, 3 rows", |b| {
        b.iter(|| black_box(&at).columns::<3>())
    });
    group.bench_function("jacobian, 6 rows", |b| {
        b.iter(|| black_box(&at).columns::<6>())
    });
    group.bench_function("target", |b| b.iter(|| target.error(black_box(&at))));
    let here: Vec<[T; 3]> = at.landmarks().collect();
    let there: Vec<[T; 3]> = chain.forward(&[T::of(0.1); 7]).landmarks().collect();
    group.bench_function("metric", |b| {
        b.iter(|| posture_distance(black_box(&here), black_box(&there)))
    });
    group.finish();

    stepper::<T, _>(c, &chain, "transpose", Transpose);
    stepper::<T, _>(c, &chain, "normalised transpose", NormalisedTranspose);
    stepper::<T, _>(c, &chain, "pseudo-inverse", PseudoInverse);
    stepper::<T, _>(c, &chain, "damped", Damped::default());
    stepper::<T, _>(
        c,
        &chain,
        "selectively damped",
        SelectivelyDamped::default(),
    );
}

/// A stepper alone, and a whole tick with it and S_C.
fn stepper<T: Real, S: Stepper<T> + Copy>(
    c: &mut Criterion,
    chain: &Chain<T, 7>,
    name: &str,
    stepper: S,
) {
    let scalar = type_name::<T>();
    let target = Position::new(TARGET.map(T::of)).expect("it is a place");
    let at = chain.forward(&START.map(T::of));
    let (columns, error) = (at.columns::<3>(), target.error(&at));
    c.bench_function(&format!("step {scalar}, {name}"), |b| {
        b.iter(|| stepper.step(black_box(&columns), black_box(&error), T::of(0.1)))
    });
    let controller = controller(chain, stepper);
    let start = controller.start(START.map(T::of));
    c.bench_function(&format!("tick {scalar}, {name}"), |b| {
        b.iter(|| {
            let mut state = black_box(start);
            controller.tick(&mut state, black_box(&target));
            state
        })
    });
}

criterion_group!(benches, kinematics, pieces::<f32>, pieces::<f64>);
criterion_main!(benches);
