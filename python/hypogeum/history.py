"""Memory of a policy that conditions on several observations, which LeRobot keeps for a single episode at a time."""

from collections import deque
from dataclasses import dataclass

# Maximum number of slots tracked at a time: bounds memory, and is far above what a simulator uses.
MAX_SLOTS = 4096


class HistoryError(ValueError):
    """A sequence of queries whose earlier observations are unknown."""


@dataclass
class Episode:
    """Episode in progress in one slot."""

    observations: deque
    """The last observations, oldest first."""
    next_query: int = 0
    rows: object = ()
    """Rows of the last chunk that have not been executed."""


class EpisodeMemory:
    """Recent observations, and planned actions, of the episode in each slot.

    Args:
        n_observations: Number of observations on which the policy conditions.
    """

    def __init__(self, n_observations):
        self.n_observations = n_observations
        self._episodes = {}

    def push(self, env, observation):
        """Append the observation of an env's query; the first one of an episode is repeated, as LeRobot does.

        Args:
            env: The `EnvObservation`.
            observation: What to remember of it. It must not share the simulator's memory.

        Raises:
            HistoryError: An earlier query of the episode was not seen.
        """
        episode = self._episodes.get(env.slot)
        expected = episode.next_query if episode else 0
        if env.query not in (0, expected):
            raise HistoryError(
                f"slot {env.slot}: query is {env.query}, expected {expected}, or 0 for a new episode; the policy "
                "conditions on earlier observations, which this host has not received"
            )
        if episode is None and len(self._episodes) == MAX_SLOTS:
            raise HistoryError(f"more than {MAX_SLOTS} slots")
        if env.query == 0:
            episode = Episode(deque([observation] * self.n_observations, maxlen=self.n_observations))
            self._episodes[env.slot] = episode
        else:
            episode.observations.append(observation)
        episode.next_query = env.query + 1

    def observations(self, slot):
        """Return the last `n_observations` observations, oldest first."""
        return list(self._episodes[slot].observations)

    def plan(self, slot, rows):
        """Store an action chunk, `[n_rows, action_dim]`, to be executed at this query and the next ones."""
        self._episodes[slot].rows = rows

    def has_plan(self, slot):
        """Return whether rows of the last chunk are left."""
        return len(self._episodes[slot].rows) > 0

    def next_rows(self, slot):
        """Return the rows that are left, of which the first one is executed now."""
        episode = self._episodes[slot]
        rows, episode.rows = episode.rows, episode.rows[1:]
        return rows
