"""Serves random actions under the name argv[1]. Each batch takes argv[2] seconds, and argv[3] more per env.

The time passes asleep, as for a policy on another machine or a GPU. Serves run after run until it is stopped. Needs
numpy, iceoryx2, and `python/` of this repository.
"""

import sys
import time
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "python"
sys.path.insert(0, str(PACKAGE))

try:
    import hypogeum
    import hypogeum.link  # needs iceoryx2
    import numpy as np
except ImportError as error:
    sys.exit(f"error: {error}; install numpy and iceoryx2 with: {sys.executable} -m pip install {PACKAGE}")

name, per_batch, per_env = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])


def policy(observation):
    time.sleep(per_batch + per_env * len(observation))
    chunks = []
    for env in observation:
        # The actions depend on the observation alone, so that rows are the same in any order.
        random = np.random.default_rng([int(env.policy_seed), env.query])
        chunks.append(np.tile(np.append(random.uniform(-0.3, 0.3, 6), 1.0), (env.execute, 1)))
    return chunks


hypogeum.serve(policy, name, forever=True)
