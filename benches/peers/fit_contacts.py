"""Searches the parameters of contacts (sim/src/physics/parameters.rs) for the best agreement with recorded motions.

Usage: `fit_contacts.py TRAJECTORIES [NAME=VALUE,VALUE,…]…`. Each round tries every listed value of every parameter alone and keeps the best
one, until none improves the score: the number of trajectories that succeed from six slightly shifted starts each, then the mean distance of
the TCPs. Single outcomes hang on fractions of a millimetre, so a score without shifts would be fitted to chance. Without values, it tries
the built-in ones. It needs no packages and about fifteen seconds per trial on two cores.
"""

import csv
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

VALUES = {
    "finger_friction": [1.0, 1.1, 1.2, 1.3, 1.4],
    "finger_stiffness": [0.2, 0.25, 0.3, 0.4],
    "contact_hz": [80, 100, 120, 140],
    "contact_damping": [3, 10],
    "prediction_m": [0.01, 0.015, 0.02],
    "static_contact_hz": [60, 80, 120, 240],
    "iterations": [3, 4, 6, 8],
    "relaxations": [2, 4, 6, 8],
}


def score(trajectories, choice):
    """Returns successes and the negative mean distance of the TCPs in mm."""
    with tempfile.NamedTemporaryFile(suffix=".csv") as file:
        command = ["cargo", "bench", "-q", "-p", "benches", "--bench", "agreement", "--"]
        command += ["--trajectories", str(Path(trajectories).resolve()), "--shifted", "6", "--csv", file.name]
        for name, value in choice.items():
            command += ["--set", f"{name}={value}"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=600)
        groups = defaultdict(dict)
        with open(file.name, newline="") as rows:
            for row in csv.DictReader(rows):
                group, figure = row["case"].rsplit("/", 1)
                groups[group][figure] = float(row["value"])
    successes = sum(figures["success_shifted"] for figures in groups.values())
    return successes, -sum(figures["tcp_mean"] for figures in groups.values()) / len(groups)


def main():
    """Searches parameter by parameter."""
    trajectories, *assignments = sys.argv[1:]
    values = VALUES
    if assignments:
        values = {name: listed.split(",") for name, listed in (it.split("=") for it in assignments)}
    choice = {}
    best = score(trajectories, choice)
    print(f"{best[0]:.0f} succeed, TCPs {-best[1]:.3f} mm apart: the default", flush=True)
    improved = True
    while improved:
        improved = False
        for name, candidates in values.items():
            for value in candidates:
                trial = {**choice, name: value}
                result = score(trajectories, trial)
                mark = "*" if result > best else " "
                print(f"{mark} {result[0]:.0f} succeed, TCPs {-result[1]:.3f} mm apart: {trial}", flush=True)
                if result > best:
                    best, choice, improved = result, trial, True


if __name__ == "__main__":
    main()
