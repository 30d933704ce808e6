"""Closed-loop evaluation of a checkpoint that is being trained."""

import json
import subprocess
import sys
import tempfile


def success_rates(binary, policy, tasks, *, episodes, seed, threads, execute):
    """Evaluate a policy in the simulator and return {task: success_once}. Exits with the program's message if it fails.

    Args:
        binary: Path of the `hypogeum` binary.
        policy: Policy as the command line takes it, for example `act:FOLDER`.
        tasks: Task names.
        episodes: Episodes per task.
        seed: Suite seed.
        threads: Worker threads.
        execute: Rows of each action chunk to execute.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [
            binary, "run", "--policy", f"trained={policy}", "--tasks", ",".join(tasks), "--json", "--quiet",
            "--episodes", str(episodes), "--seed", str(seed), "--db", f"{folder}/results.db",
            "--threads", str(threads), "--execute", str(execute),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return {cell["task"]: cell["success_once"] for cell in json.loads(done.stdout)["cells"]}
