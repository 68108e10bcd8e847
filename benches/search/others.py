"""CMA-ES (the package cma, with its BIPOP restarts: Hansen 2009) and differential evolution (SciPy's, begun again when
it has converged), each with ten times the evaluations of the learner, on the learner's own score. Started by `run`."""

import json
import multiprocessing
import struct
import subprocess
import sys
import warnings

warnings.simplefilter("ignore")
import cma
import numpy as np
import scipy.optimize

PROGRAM, STEPPER, MODEL = sys.argv[1:4]
TIMES = float(sys.argv[4]) if len(sys.argv) > 4 else 10.0
MOTIONS = [int(number) for number in sys.argv[5:]]


class Spent(Exception):
    """The evaluations are used up."""


class Objective:
    """The score of a motion, through the learner's lanes; keeps the best."""

    def __init__(self, motion, genes):
        self.genes = genes
        self.program = subprocess.Popen(
            [PROGRAM, "objective", STEPPER, MODEL, str(motion)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={"RAYON_NUM_THREADS": "1"})

    def begin(self, budget):
        self.left, self.least, self.best = budget, np.inf, None
        return self

    def ask(self, points, exactly):
        points = np.ascontiguousarray(points, "<f8")
        self.program.stdin.write(struct.pack("<II", len(points), exactly) + points.tobytes())
        self.program.stdin.flush()
        return np.frombuffer(self.program.stdout.read(8 * len(points)), "<f8")

    def __call__(self, points):
        """Scores of rows in [0, 1], in cm."""
        if self.left <= 0:
            raise Spent
        points = np.asarray(points)
        self.left -= len(points)
        scores = 100 * self.ask(points, 0)
        first = scores.argmin()
        if scores[first] < self.least:
            self.least, self.best = scores[first], points[first].copy()
        return scores

    def exact(self):
        """The best, scored again in f64."""
        return 100 * self.ask(self.best[None], 1)[0]


def cma_es(objective, seed):
    options = {"bounds": [0, 1], "seed": seed, "verbose": -9, "verb_log": 0, "maxfevals": objective.left}
    draw = np.random.default_rng(seed)
    try:
        while True:
            cma.fmin2(None, lambda: draw.uniform(size=objective.genes), 0.3, options, restarts=1000, bipop=True,
                      parallel_objective=lambda points: list(objective(points)))
    except Spent:
        pass


def differential_evolution(objective, seed):
    try:
        while True:
            scipy.optimize.differential_evolution(
                lambda columns: objective(columns.T), [(0, 1)] * objective.genes, vectorized=True, updating="deferred",
                maxiter=10**9, polish=False, rng=seed)
            seed += 1
    except Spent:
        pass


def compare(task):
    motion, genes, budget = task
    objective = Objective(motion, genes)
    found = []
    for method in (cma_es, differential_evolution):
        method(objective.begin(budget), 1)
        found.append(objective.exact())
    objective.program.stdin.close()
    return motion, found


def main():
    ours = json.loads(subprocess.check_output([PROGRAM, "ours", STEPPER, MODEL]))
    budget = int(TIMES * ours["evaluations"])
    print(f"{STEPPER}, S_{MODEL.upper()}: {ours['evaluations']} evaluations a motion, {ours['seconds']:.1f} s, "
          f"for the others {budget}; cm", flush=True)
    print(f"{'motion':40} {'sinew':>8} {'CMA-ES':>8} {'DE':>8} {'sinew / least':>14}")
    rows = []
    tasks = [(motion, ours["genes"], budget) for motion in MOTIONS or range(len(ours["motions"]))]
    with multiprocessing.Pool() as pool:
        for motion, found in pool.imap(compare, tasks):
            row = [100 * ours["motions"][motion]["distance"], *found]
            rows.append(row)
            name = ours["motions"][motion]["name"]
            print(f"{name:40} " + " ".join(f"{x:8.4f}" for x in row) + f" {row[0] / min(row):14.4f}", flush=True)
    rows = np.array(rows)
    mean = rows.mean(axis=0)
    print(f"{'mean':40} " + " ".join(f"{x:8.4f}" for x in mean) + f" {mean[0] / rows.min(axis=1).mean():14.4f}")


if __name__ == "__main__":
    main()
