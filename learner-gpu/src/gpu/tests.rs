//! The device against the core and the CPU's kernels. Where there is no adapter these tests say so and test nothing.

use nalgebra::{UnitQuaternion, Vector3};
use sinew::math::{exp, sin_cos};
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, CommandEncoderDescriptor, ComputePassDescriptor,
    ComputePipelineDescriptor, PipelineCompilationOptions, ShaderModuleDescriptor, ShaderSource,
};

use super::*;
use crate::chain::{
    ChainDescription, JointDescription, KindDescription, LandmarkDescription, TransformDescription,
};
use crate::checkpoint::Keeper;
use crate::kernel::compose::compose;
use crate::kernel::philox::philox;
use crate::kernel::proposal::parameter;
use crate::kernel::score::Ready;
use crate::learn::{Backend, Progress, Search};
use crate::problem::{ModelKind, Settings, StepperKind};
use crate::sample;
use crate::task::{Arm, Task, facing};

const MODELS: [ModelKind; 4] = [ModelKind::A, ModelKind::B, ModelKind::C, ModelKind::D];

fn there_is_an_adapter() -> bool {
    let there = !adapters().is_empty();
    if !there {
        println!("skipped: no Vulkan adapter");
    }
    there
}

fn never() -> bool {
    false
}

/// One vector for each of these motions.
fn problem(tasks: Vec<Task>, stepper: StepperKind, model: ModelKind, clamped: bool) -> Problem {
    Problem {
        settings: Settings {
            stepper,
            model,
            lambda: stepper.rate(),
            rate_hz: 60.0,
            clamped,
        },
        sets: (0..tasks.len()).map(|task| vec![task]).collect(),
        tasks,
        islands: 2,
        seed: 0x1234_5678_9abc_def0,
    }
}

/// Reaches of the sample.
fn human(count: usize) -> Vec<Task> {
    let reaches = sample::shipped().unwrap();
    let arm = Arm::Human(facing(&reaches));
    let tasks = reaches.iter().take(count);
    tasks
        .map(|reach| Task::new(reach, &arm, 60.0).unwrap())
        .collect()
}

/// Two motions of arms as no person has them, with all that a chain can have: a slide, axes that point backwards, fixed
/// turns of any angle, offsets along one, two and three axes, of which the second arm lacks some.
fn general() -> Vec<Task> {
    let joint = |kind, translation, turn: [f64; 3], axis, lower, upper| JointDescription {
        name: "joint".to_owned(),
        kind,
        translation,
        rotation: UnitQuaternion::from_scaled_axis(Vector3::from(turn))
            .coords
            .into(),
        axis,
        lower,
        upper,
    };
    use KindDescription::{Prismatic, Revolute};
    let arm = |first: [f64; 3], last: [f64; 3]| ChainDescription {
        joints: vec![
            joint(
                Revolute,
                first,
                [0.3, -0.2, 0.5],
                [0.0, 0.0, 1.0],
                -2.0,
                2.0,
            ),
            joint(
                Revolute,
                [0.0, 0.1, -0.2],
                [0.0; 3],
                [-1.0, 0.0, 0.0],
                -2.5,
                2.5,
            ),
            joint(
                Prismatic,
                [0.2, 0.0, 0.1],
                [0.0; 3],
                [0.0, -1.0, 0.0],
                -0.1,
                0.3,
            ),
            joint(
                Revolute,
                [0.0, 0.0, 0.2],
                [0.0, 1.1, 0.0],
                [0.6, 0.0, 0.8],
                -1.5,
                1.5,
            ),
            joint(Revolute, last, [0.0; 3], [0.0, -1.0, 0.0], -1.0, 1.0),
        ],
        tip: TransformDescription {
            translation: [0.05, 0.1, 0.0],
            rotation: [0.0, 0.0, 0.0, 1.0],
        },
        landmarks: [1, 2, 4]
            .map(|joint| LandmarkDescription {
                name: format!("joint {joint}"),
                joint,
            })
            .to_vec(),
    };
    let task = |chain: ChainDescription| {
        let initial = vec![0.1, -0.4, 0.05, 0.3, 0.2];
        let built = chain.build::<5>().unwrap();
        let at = |share: f64| -> Vec<[f64; 3]> {
            let q = std::array::from_fn(|i| initial[i] + share * [0.5, -0.3, 0.1, 0.6, -0.4][i]);
            built.forward(&q).landmarks().collect()
        };
        let reference: Vec<_> = (0..40).map(|frame| at(f64::from(frame) / 39.0)).collect();
        Task {
            name: "general".to_owned(),
            target: reference[39][3],
            reference,
            initial,
            misfit: 0.0,
            chain,
        }
    };
    vec![
        task(arm([0.1, 0.2, 0.3], [0.1, 0.0, 0.0])),
        task(arm([0.0; 3], [0.0, 0.0, 0.15])),
    ]
}

fn fresh(problem: &Problem) -> Vec<Island> {
    Search::new(problem).islands
}

fn ran(problem: &Problem, cuts: &[u32]) -> Vec<Island> {
    let mut gpu = Gpu::new(problem, &fresh(problem), Which::Best).unwrap();
    let mut at = 0;
    for &to in cuts {
        at = gpu.advance(at, to, never).unwrap();
    }
    gpu.islands().unwrap()
}

/// The members' scores by the core, one by one in `f32`: the CPU's lanes are these, bit for bit.
fn by_the_core<const N: usize>(problem: &Problem, islands: &[Island]) -> Vec<f32> {
    let bounds = problem.settings.bounds(N);
    let tasks = problem.tasks.iter();
    let ready: Vec<_> = tasks
        .map(|task| Ready::<f32, N>::new(task).unwrap())
        .collect();
    let mut scores = Vec::new();
    for (number, island) in islands.iter().enumerate() {
        let set = &problem.sets[number / problem.islands];
        for member in 0..ISLAND {
            let genes = island.genes.iter().zip(&bounds);
            let parameters: Vec<f32> = genes
                .map(|(row, &bounds)| parameter(row[member], bounds))
                .collect();
            let sum = set.iter().fold(0.0, |sum, &task| {
                sum + ready[task].score(&problem.settings, &parameters)
            });
            scores.push(sum / set.len() as f32);
        }
    }
    scores
}

/// How near the median score is to the core's, as a share: in `f32` the CPU comes to 1e-7 to 3e-7, and a GPU's divisions may
/// be 2.5 units in the last place off (WGSL, section 15.7.4).
const CLOSE: f64 = 3e-6;

/// Prints how near the device's scores are to the core's, and returns the median relative difference.
fn compare<const N: usize>(what: &str, problem: &Problem) -> f64 {
    let mut gpu = Gpu::new(problem, &fresh(problem), Which::Best).unwrap();
    gpu.advance(0, 1, never).unwrap();
    let scores = gpu.scores().unwrap();
    let core = by_the_core::<N>(problem, &gpu.islands().unwrap());
    let pairs = scores.into_iter().flatten().zip(core);
    let mut differences: Vec<f64> = pairs
        .map(|(device, core)| f64::from((device - core) / core).abs())
        .collect();
    differences.sort_by(f64::total_cmp);
    let (median, worst) = (
        differences[differences.len() / 2],
        differences[differences.len() - 1],
    );
    let same = differences.iter().filter(|&&d| d == 0.0).count();
    println!(
        "{what}: of {} random members {same} score the same bits, median {median:e}, worst {worst:e}",
        differences.len()
    );
    assert!(!worst.is_nan());
    median
}

#[test]
fn every_stepper_and_model_scores_a_human_arm_as_the_core_does() {
    if !there_is_an_adapter() {
        return;
    }
    for stepper in StepperKind::ALL {
        for model in MODELS {
            let problem = problem(human(3), stepper, model, model == ModelKind::B);
            assert!(compare::<7>(&format!("{stepper:?}, S_{model:?}"), &problem) < CLOSE);
        }
    }
}

#[test]
fn every_stepper_scores_arms_with_turns_and_slides_as_the_core_does() {
    if !there_is_an_adapter() {
        return;
    }
    for stepper in StepperKind::ALL {
        for clamped in [false, true] {
            let problem = problem(general(), stepper, ModelKind::D, clamped);
            let what = format!("{stepper:?}, general arms, clamped {clamped}");
            assert!(compare::<5>(&what, &problem) < CLOSE);
        }
    }
}

#[test]
fn a_set_of_motions_scores_their_mean() {
    if !there_is_an_adapter() {
        return;
    }
    let mut problem = problem(human(4), StepperKind::Transpose, ModelKind::C, false);
    // One motion is in two sets.
    problem.sets = vec![vec![0, 1, 2], vec![3, 2]];
    assert!(compare::<7>("sets of 3 and 2", &problem) < CLOSE);
}

#[test]
fn motions_that_all_begin_singular_score_as_the_core_does() {
    if !there_is_an_adapter() {
        return;
    }
    // A straight arm's hand cannot come nearer: singular values decide the first tick of every member.
    let mut tasks = human(3);
    for task in &mut tasks {
        task.initial = vec![0.0; 7];
    }
    let mut problem = problem(tasks, StepperKind::PseudoInverse, ModelKind::C, false);
    problem.islands = 5;
    assert!(compare::<7>("singular", &problem) < CLOSE);
    // One vector for three motions, which are more than there are threads to score them once more.
    problem.sets = vec![vec![0, 1, 2]];
    assert!(problem.islands * 3 * ISLAND > 8 * ISLAND);
    assert!(compare::<7>("singular, a set", &problem) < CLOSE);
    // And none is left over from generation to generation.
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    gpu.advance(0, 3, never).unwrap();
    let whole = gpu.islands().unwrap();
    assert_eq!(ran(&problem, &[1, 2, 3]), whole);
    same_scores(&mut gpu, &problem, &[0, 4]);
}

#[test]
fn a_population_in_several_groups_and_rows_of_workgroups_ends_with_the_same_bits() {
    if !there_is_an_adapter() {
        return;
    }
    let mut problem = problem(human(3), StepperKind::Transpose, ModelKind::C, false);
    problem.sets = vec![vec![0, 1], vec![2], vec![1]];
    problem.islands = 3;
    // Room for a little more than two islands in a buffer, and for no window: the data are in a storage buffer, those of
    // the whole in a uniform one where the device is the CPU.
    let mut split = Gpu::within(&problem, &fresh(&problem), Which::Best, 14_000).unwrap();
    assert_eq!(split.groups.len(), 5);
    split.kernel.columns = 8;
    split.advance(0, 20, never).unwrap();
    let whole = ran(&problem, &[20]);
    assert_eq!(split.islands().unwrap(), whole);

    let summary: Vec<(f32, f32)> = whole
        .iter()
        .map(|island| {
            let sum = island.scores.iter().fold(0.0, |sum, score| sum + score);
            (island.best_score, sum / ISLAND as f32)
        })
        .collect();
    assert_eq!(split.summary().unwrap(), summary);
}

#[test]
fn a_stopped_search_goes_on_as_if_never_stopped() {
    if !there_is_an_adapter() {
        return;
    }
    let problem = problem(human(2), StepperKind::PseudoInverse, ModelKind::C, false);
    let whole = ran(&problem, &[30]);
    assert_eq!(ran(&problem, &[1, 13, 30]), whole);

    let mut gpu = Gpu::new(&problem, &ran(&problem, &[11]), Which::Best).unwrap();
    assert_eq!(gpu.advance(11, 30, || true).unwrap(), 11);
    assert_eq!(gpu.advance(11, 30, never).unwrap(), 30);
    assert_eq!(gpu.islands().unwrap(), whole);
}

#[test]
fn what_cannot_run_is_refused_with_a_reason() {
    let good = problem(human(2), StepperKind::Transpose, ModelKind::A, false);
    let refused = |problem: &Problem, islands: &[Island], limit| {
        let result = Gpu::within(problem, islands, Which::Best, limit);
        result
            .err()
            .map_or(String::new(), |error| error.to_string())
    };
    let fault = refused(&good, &fresh(&good)[1..], u64::MAX);
    assert!(
        fault.contains("the number of islands is 3, expected 4"),
        "{fault}"
    );

    let mut wrong = good.clone();
    wrong.tasks[1].reference[7].pop();
    let fault = refused(&wrong, &fresh(&wrong), u64::MAX);
    assert!(
        fault.contains("frame 7 has 3 points, expected 4"),
        "{fault}"
    );

    let mut wrong = good.clone();
    wrong.tasks[1].chain.joints[3].axis = [0.0, 1.0, 0.0];
    let fault = refused(&wrong, &fresh(&wrong), u64::MAX);
    assert!(fault.contains("the arm of motion 1 differs"), "{fault}");

    if !there_is_an_adapter() {
        return;
    }
    let fault = refused(&good, &fresh(&good), 700);
    assert!(fault.contains("the recordings takes"), "{fault}");
    let name = Which::Named("no such adapter".to_owned());
    let fault = Gpu::new(&good, &fresh(&good), name).err();
    assert!(matches!(fault, Some(GpuError::NoSuchAdapter { .. })));
}

#[test]
fn a_lost_device_is_an_error_and_no_more() {
    if !there_is_an_adapter() {
        return;
    }
    let problem = problem(human(1), StepperKind::Transpose, ModelKind::A, false);
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    gpu.advance(0, 2, never).unwrap();
    gpu.device.device.destroy();
    assert!(gpu.advance(2, 4, never).is_err());
    assert!(gpu.islands().is_err());
    assert!(gpu.replace(&problem, &fresh(&problem)).is_err());
    println!("{}", gpu.summary().unwrap_err());
}

#[test]
fn a_search_whose_device_is_lost_goes_on_with_the_cpu_from_what_was_read_back() {
    if !there_is_an_adapter() {
        return;
    }
    let problem = problem(human(2), StepperKind::Transpose, ModelKind::C, false);
    let mut lost = Search::new(&problem);
    let device = Gpu::new(&problem, &lost.islands, Which::Best).unwrap();
    let handle = device.device.device.clone();
    let mut backend = Backend::Gpu {
        device: Box::new(device),
        or_cpu: true,
    };
    let keeper = Keeper::default();
    let mut words = Vec::new();
    let mut told = |told: Result<Progress, String>| match told {
        Ok(progress) if progress.generation == 32 => handle.destroy(),
        Ok(_) => {}
        Err(text) => words.push(text),
    };
    lost.run(&problem, &mut backend, 64, &keeper, &mut told)
        .unwrap();
    assert!(matches!(backend, Backend::Cpu));
    assert!(
        words[0].contains("going on with the CPU from generation 32"),
        "{words:?}"
    );

    let mut whole = Search::new(&problem);
    whole
        .run(&problem, &mut Backend::Cpu, 64, &keeper, |_| {})
        .unwrap();
    assert_eq!(lost.generation, whole.generation);
    assert_eq!(lost.islands.len(), whole.islands.len());
}

/// Of some islands, the scores on the device and those of the lanes, which have to be near.
fn same_scores(gpu: &mut Gpu, problem: &Problem, islands: &[usize]) {
    let found = gpu.islands().unwrap();
    let scores = gpu.scores().unwrap();
    for &number in islands {
        // What the lanes make of members that propose themselves: an island of the same genes, scored anew.
        let (set, place) = (number / problem.islands, number % problem.islands);
        let bounds = problem.settings.bounds(7);
        let motions: Vec<Ready<f32, 7>> = problem.sets[set]
            .iter()
            .map(|&task| Ready::new(&problem.tasks[task]).unwrap())
            .collect();
        for member in [0, 17, 63] {
            let parameters: Vec<f32> = found[number]
                .genes
                .iter()
                .zip(&bounds)
                .map(|(row, &bounds)| parameter(row[member], bounds))
                .collect();
            let sum = motions.iter().fold(0.0, |sum, motion| {
                sum + motion.score(&problem.settings, &parameters)
            });
            let expected = sum / motions.len() as f32;
            let device = scores[number][member];
            assert!(
                (device / expected - 1.0).abs() < 1e-4,
                "set {set}, island {place}, member {member}: {device} and {expected}"
            );
        }
    }
}

#[test]
fn a_million_members_of_21_parameters_run_in_default_limits() {
    if !there_is_an_adapter() {
        return;
    }
    let mut task = human(1).remove(0);
    task.reference.truncate(8);
    let mut problem = problem(vec![task], StepperKind::Transpose, ModelKind::D, false);
    problem.islands = (1 << 20) / ISLAND;
    assert_eq!((problem.population(), problem.genes()), (1 << 20, 21));
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    gpu.advance(0, 2, never).unwrap();
    same_scores(&mut gpu, &problem, &[0, 1, 9_999, 16_383]);
    assert!(gpu.summary().unwrap().iter().all(|&(best, _)| best < 1.0));

    // Two sets of as many: above what one binding holds.
    problem.sets.push(vec![0]);
    gpu.replace(&problem, &fresh(&problem)).unwrap();
    assert!(gpu.groups.len() > 1);
    gpu.advance(0, 1, never).unwrap();
    same_scores(&mut gpu, &problem, &[16_383, 16_384, 32_767]);
}

#[test]
fn more_islands_than_workgroups_in_a_row_run_in_default_limits() {
    if !there_is_an_adapter() {
        return;
    }
    let mut task = human(1).remove(0);
    task.reference.truncate(2);
    let mut problem = problem(vec![task], StepperKind::Transpose, ModelKind::A, false);
    problem.islands = 66_000;
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    gpu.pace = Pace::fixed(u64::MAX);
    gpu.advance(0, 1, never).unwrap();
    same_scores(&mut gpu, &problem, &[0, 65_534, 65_535, 65_999]);
}

/// A reach that lasts so many frames: its last one is held.
fn lasting(mut task: Task, frames: usize) -> Task {
    let last = task.reference.last().cloned().unwrap();
    task.reference.resize(frames, last);
    task
}

#[test]
fn a_thousand_motions_of_200_frames_run_in_default_limits() {
    if !there_is_an_adapter() {
        return;
    }
    let reaches = human(14);
    let tasks: Vec<Task> = reaches.into_iter().cycle().take(1000).collect();
    let tasks = tasks.into_iter().map(|task| lasting(task, 200)).collect();
    let mut problem = problem(tasks, StepperKind::Transpose, ModelKind::C, false);
    problem.islands = 1;
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    let software = gpu.adapter().kind == AdapterKind::Software;
    assert_eq!(
        (gpu.kernel.window, gpu.groups.len() > 1),
        (software, software)
    );
    gpu.advance(0, 1, never).unwrap();
    same_scores(&mut gpu, &problem, &[0, 1, 500, 999]);

    // One vector for all of them: more than fit a window.
    problem.sets = vec![(0..1000).collect()];
    let mut gpu = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
    assert!(!gpu.kernel.window);
    gpu.advance(0, 1, never).unwrap();
    same_scores(&mut gpu, &problem, &[0]);
}

#[test]
fn a_set_whose_motions_are_scored_in_parts_ends_with_the_same_bits() {
    if !there_is_an_adapter() {
        return;
    }
    let mut problem = problem(human(5), StepperKind::Transpose, ModelKind::D, false);
    problem.sets = vec![vec![0, 1, 2, 3, 4], vec![3, 1]];
    let whole = ran(&problem, &[12]);
    for most in [1, 2, 4] {
        let mut split = Gpu::new(&problem, &fresh(&problem), Which::Best).unwrap();
        let islands = split.groups[0].islands.len();
        split.groups[0].slots = most * islands;
        split.advance(0, 12, never).unwrap();
        assert_eq!(split.islands().unwrap(), whole, "{most} at once");
        // The sums are the host's here, whose divisions may round otherwise.
        for (scored, island) in split.scores().unwrap().iter().zip(&whole) {
            for (again, score) in scored.iter().zip(&island.scores) {
                assert!((again / score - 1.0).abs() < 1e-6, "{again} {score}");
            }
        }
    }
}

#[test]
fn a_motion_too_long_for_a_dispatch_is_refused() {
    if !there_is_an_adapter() {
        return;
    }
    let long = lasting(human(1).remove(0), 20_000);
    let problem = problem(vec![long], StepperKind::PseudoInverse, ModelKind::A, false);
    let fault = Gpu::new(&problem, &fresh(&problem), Which::Best).err();
    assert!(matches!(
        fault,
        Some(GpuError::Frames { found: 20_000, .. })
    ));
}

/// Runs `probe`, which reads and writes these words, with the kernel's functions at hand.
fn probed(probe: &str, words: &[u32]) -> Vec<u32> {
    let problem = problem(human(1), StepperKind::Transpose, ModelKind::C, false);
    let motions = Motions::new(&problem).unwrap();
    let device = Device::open(&Which::Best).unwrap();
    let kernel = compose(&motions.structure, None).unwrap().source;
    let source = format!(
        "{kernel}
        @group(0) @binding(8) var<storage, read_write> words: array<u32>;
        @compute @workgroup_size(64)
        fn probe(@builtin(global_invocation_id) at: vec3u) {{ {probe} }}"
    );
    let module = device.device.create_shader_module(ShaderModuleDescriptor {
        label: None,
        source: ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device
        .device
        .create_compute_pipeline(&ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("probe"),
            compilation_options: PipelineCompilationOptions::default(),
            cache: None,
        });
    let buffer = device.storage("words", words.len());
    device.write(&buffer, words);
    let run = device.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: kernel::RUN_BYTES,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    device.write(&run, &[0; kernel::RUN_BYTES as usize / 4]);
    // A layout taken from the code has only what the code uses.
    let all = [(0, &run), (8, &buffer)];
    let used = if probe.contains("sin_cos") {
        &all[..]
    } else {
        &all[1..]
    };
    let entries: Vec<_> = used
        .iter()
        .map(|&(binding, buffer)| BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        })
        .collect();
    let bindings = device.device.create_bind_group(&BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let mut encoder = device
        .device
        .create_command_encoder(&CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups((words.len() / 4 / 64) as u32, 1, 1);
    }
    device.queue.submit([encoder.finish()]);
    device.wait().unwrap();
    device.read(&buffer).unwrap()
}

#[test]
fn philox_draws_the_same_bits() {
    if !there_is_an_adapter() {
        return;
    }
    let mut data = Vec::new();
    for n in 0..16_384u32 {
        data.extend([n, n.wrapping_mul(0x9e37_79b9), !n, n.rotate_right(9)]);
    }
    let drawn = probed(
        "let i = 4u * at.x;
        let draw = philox(vec4u(words[i], words[i + 1u], words[i + 2u], words[i + 3u]), vec2u(7u, 0xdeadbeefu));
        for (var k = 0u; k < 4u; k++) { words[i + k] = draw[k]; }",
        &data,
    );
    for (counter, draw) in data.chunks_exact(4).zip(drawn.chunks_exact(4)) {
        let counter = [counter[0], counter[1], counter[2], counter[3]];
        assert_eq!(draw, philox(counter, [7, 0xdead_beef]));
    }
}

#[test]
fn sine_cosine_and_exponential_are_the_cores() {
    if !there_is_an_adapter() {
        return;
    }
    // Angles: dense in ±10, then over all that a joint can have. Exponents: past both ends.
    let count = 1 << 18;
    let mut data = Vec::new();
    for n in 0..count {
        let share = 2.0 * f64::from(n) / f64::from(count - 1) - 1.0;
        let angle = share * if n % 2 == 0 { 10.0 } else { 8192.0 };
        data.extend([
            (angle as f32).to_bits(),
            0,
            ((share * 100.0) as f32).to_bits(),
            0,
        ]);
    }
    let found = probed(
        "nothing = run.nothing;
        let i = 4u * at.x;
        let turn = sin_cos_within(bitcast<f32>(words[i]));
        words[i] = bitcast<u32>(turn.sin);
        words[i + 1u] = bitcast<u32>(turn.cos);
        words[i + 2u] = bitcast<u32>(exponential(bitcast<f32>(words[i + 2u])));",
        &data,
    );
    let (mut other_bits, mut worst) = (0, 0.0f32);
    for (given, found) in data.chunks_exact(4).zip(found.chunks_exact(4)) {
        let (sin, cos) = sin_cos(f32::from_bits(given[0]));
        let power = exp(f32::from_bits(given[2]));
        let found = [found[0], found[1], found[2]].map(f32::from_bits);
        other_bits += usize::from(found.map(f32::to_bits) != [sin, cos, power].map(f32::to_bits));
        let off = (found[0] - sin).abs().max((found[1] - cos).abs());
        worst = worst.max(off).max(((found[2] - power) / power).abs());
    }
    println!(
        "sin, cos and exp: {other_bits} of {count} with other bits, worst difference {worst:e}"
    );
    // Half of the last digit, on a device that fuses multiplication and addition.
    assert!(worst < 5e-7);
}
