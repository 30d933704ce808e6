"""Serves random actions under the name argv[1]. Each batch takes argv[2] seconds, and argv[3] more per env.

The time passes asleep, as for a policy on another machine or a GPU. Needs numpy, and `python/` of this repository.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "python"))

import hypogeum  # noqa: E402
import numpy as np  # noqa: E402

name, per_batch, per_env = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])


def policy(observation):
    time.sleep(per_batch + per_env * len(observation))
    chunks = []
    for env in observation:
        # The actions depend on the observation alone, so that rows are the same in any order.
        random = np.random.default_rng([int(env.policy_seed), env.query])
        chunks.append(np.tile(np.append(random.uniform(-0.3, 0.3, 6), 1.0), (env.execute, 1)))
    return chunks


hypogeum.serve(policy, name)
