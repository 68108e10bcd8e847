"""What a call to optik takes from Python, beside an empty call: the difference is its kinematics and the making of
Python lists, so an upper bound. Started by `run`."""

import pathlib
import statistics
import time

import optik

TURNS, CALLS = 300, 128
LIMITS = ([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
          [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])

urdf = pathlib.Path(__file__).parent.parent / "panda.urdf"
robot = optik.Robot.from_urdf_file(str(urdf), "link0", "flange")
# The postures of benches/lib.rs.
postures = [[lo + (n * p**0.5 % 1.0) * (hi - lo) for p, lo, hi in zip((2, 3, 5, 7, 11, 13, 17), *LIMITS)]
            for n in range(1, CALLS + 1)]
tasks = {
    "an empty call": lambda q: robot.num_positions(),
    "forward kinematics": robot.fk,
    "forward kinematics and Jacobian": robot.joint_jacobian,
}
times = {name: [] for name in tasks}
for _ in range(TURNS):
    for name, task in tasks.items():
        began = time.perf_counter_ns()
        for q in postures:
            task(q)
        times[name].append((time.perf_counter_ns() - began) / CALLS)
print("\noptik, called from Python            ns a call")
for name, taken in times.items():
    print(f"  {name:<32}{statistics.median(taken):>12.1f}")
