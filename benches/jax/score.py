"""What the learner scores, written in JAX: jit + vmap + lax.scan, f32. Started by `run`, with the file that `population`
wrote and the program itself; checks the scores against its, then both are timed in turns.

It is written for speed, as ours is: the arm's structure (axes along x, y or z, offsets along z) is known when it is
traced, so no general transform is multiplied; each number of a posture is an array over candidates and motions. (Arrays
of 3 and 7 numbers, general transforms, or one motion after the other are slower.) JAX loses more than ours does to
whatever else the machine is doing: the medians are of the turns as they came, the bests of the quietest."""

import json
import statistics
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

ROUNDS = 7
AXES = [0, 1, 2, 0, 2, 0, 1]  # that the arm's DoFs turn about

with open(sys.argv[1]) as file:
    workload = json.load(file)
settings, tasks = workload["settings"], workload["tasks"]
assert settings["stepper"] == "transpose" and settings["model"] == "c" and not settings["clamped"]
for task in tasks:
    joints, landmarks = task["chain"]["joints"], [mark["joint"] for mark in task["chain"]["landmarks"]]
    assert [joint["axis"].index(1.0) for joint in joints] == AXES and landmarks == [0, 3, 5]
    assert all(joint["rotation"][3] == 1.0 for joint in joints[1:])
    assert all(joint["translation"][:2] == [0.0, 0.0] for joint in joints)
GAIN, DT = np.float32(settings["lambda"] / settings["rate_hz"]), np.float32(1.0 / settings["rate_hz"])


def matrix(quaternion):
    x, y, z, w = quaternion
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


f32 = lambda rows: jnp.array(np.array(rows), jnp.float32)
motions = {
    "base": f32([matrix(task["chain"]["joints"][0]["rotation"]).T for task in tasks]),  # its axes, one a row
    "offset": f32([[joint["translation"][2] for joint in task["chain"]["joints"]]
                   + [task["chain"]["tip"]["translation"][2]] for task in tasks]),
    "initial": f32([task["initial"] for task in tasks]),
    "target": f32([task["target"] for task in tasks]),
    "reference": f32([task["reference"] for task in tasks]),
}
parameters = f32([candidate["parameters"] for candidate in workload["candidates"]])
expected = np.array([candidate["score"] for candidate in workload["candidates"]])

add = lambda a, b: [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
sub = lambda a, b: [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
scale = lambda a, k: [a[0] * k, a[1] * k, a[2] * k]
dot = lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def forward(motion, q):
    """The DoFs' axes and origins, and the tip."""
    frame = [[motion["base"][k][r] for r in range(3)] for k in range(3)]
    at = [0.0, 0.0, 0.0]
    axes, origins = [], []
    for i, k in enumerate(AXES):
        if i in (0, 3, 5):  # the others' offsets are 0
            at = add(at, scale(frame[2], motion["offset"][i]))
        axes.append(frame[k])
        origins.append(at)
        a, b = (k + 1) % 3, (k + 2) % 3
        sine, cosine = jnp.sin(q[i]), jnp.cos(q[i])
        frame = list(frame)
        frame[a], frame[b] = (add(scale(frame[a], cosine), scale(frame[b], sine)),
                              sub(scale(frame[b], cosine), scale(frame[a], sine)))
    return axes, origins, add(at, scale(frame[2], motion["offset"][7]))


def score(motion, parameters):
    """The mean distance of one motion with one candidate's parameters."""
    o, s = parameters[7], parameters[8]

    def frame(state, step):
        q, total = state
        reference, time = step
        axes, origins, tip = forward(motion, q)
        landmarks = [origins[0], origins[3], origins[5], tip]
        for mark, point in enumerate(landmarks):
            gap = sub(point, [reference[mark][r] for r in range(3)])
            total = total + 0.25 * jnp.sqrt(dot(gap, gap))
        error = sub([motion["target"][r] for r in range(3)], tip)
        rise = 1.0 / (1.0 + jnp.exp(o - s * time))
        q = [q[i] + parameters[i] * (GAIN * dot(cross(axes[i], sub(tip, origins[i])), error)) * rise for i in range(7)]
        return (q, total), None

    frames = motion["reference"].shape[0]
    times = jnp.arange(frames, dtype=jnp.float32) * DT
    start = ([motion["initial"][i] for i in range(7)], jnp.float32(0.0))
    (_, total), _ = jax.lax.scan(frame, start, (motion["reference"], times))
    return total / frames


over_motions = jax.vmap(score, in_axes=(0, None))
population = jax.jit(jax.vmap(lambda p: over_motions(motions, p).mean()))

found = np.asarray(population(parameters))
worst = np.abs(found - expected).max()
print(f"JAX {jax.__version__} on {jax.devices()[0].platform}: scores of {len(expected)} candidates agree to {worst:.1e} m")
assert worst < 1e-5, "the two do not compute the same"

count = parameters.shape[0] * motions["reference"].shape[0] * motions["reference"].shape[1] / 1e6
rates = {}
for _ in range(ROUNDS):
    for _ in range(3):
        began = time.perf_counter()
        population(parameters).block_until_ready()
        rates.setdefault("JAX", []).append(count / (time.perf_counter() - began))
    for line in subprocess.run([sys.argv[2]], capture_output=True, text=True, check=True).stdout.splitlines():
        rate, place = line.split(maxsplit=1)
        rates.setdefault(f"sinew: {place}", []).append(float(rate))
print(f"{'million candidate-motion-frames a second':<50}{'median':>8}{'best':>8}{'to JAX':>9}")
for place, found in rates.items():
    ratio = statistics.median(found) / statistics.median(rates["JAX"])
    print(f"  {place:<48}{statistics.median(found):>8.2f}{max(found):>8.2f}{ratio:>8.2f}×")
