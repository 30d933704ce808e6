//! The order of a sweep's episodes, from which shards are cut as ranges.

use std::ops::Range;

/// The numbers of a sweep that fix the order of its episodes.
///
/// One policy follows the other, so that a shard loads few checkpoints. The episodes of a policy have the
/// conditions vary fastest, so that every shard has some of each: if one is lost, no cell is. Two policies
/// whose comparison ends cells early keep each cell together, because it ends by the results of both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EpisodeOrder {
    pub(crate) n_policies: usize,
    pub(crate) n_conditions: usize,
    /// Episodes of each policy under each condition.
    pub(crate) n_episodes: u32,
    /// The two policies that keep their cells together.
    pub(crate) pair: Option<[usize; 2]>,
}

/// Policies whose episodes lie next to each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PolicyGroup {
    /// One policy, or two that keep their cells together.
    pub(crate) policies: Vec<usize>,
    /// Positions of their episodes.
    pub(crate) positions: Range<u64>,
}

impl EpisodeOrder {
    /// Returns the number of episodes of all policies.
    pub(crate) fn len(&self) -> u64 {
        self.n_policies as u64 * self.per_policy()
    }

    /// Returns the number of episodes of one policy.
    pub(crate) fn per_policy(&self) -> u64 {
        self.n_conditions as u64 * u64::from(self.n_episodes)
    }

    /// Returns the groups of policies in their order. A pair takes the place of its first policy.
    pub(crate) fn groups(&self) -> Vec<PolicyGroup> {
        let mut groups: Vec<PolicyGroup> = Vec::new();
        for policy_idx in 0..self.n_policies {
            let policies = match self.pair {
                Some(pair) if policy_idx == *pair.iter().min().unwrap_or(&0) => pair.to_vec(),
                Some(pair) if pair.contains(&policy_idx) => continue,
                _ => vec![policy_idx],
            };
            let first = groups.last().map_or(0, |group| group.positions.end);
            let end = first + policies.len() as u64 * self.per_policy();
            groups.push(PolicyGroup { policies, positions: first..end });
        }
        groups
    }

    /// Returns the position of an episode of a group.
    pub(crate) fn position(&self, group: &PolicyGroup, (policy, condition, episode): EpisodeIdx) -> u64 {
        let episode = u64::from(episode);
        let within = match group.policies.iter().position(|idx| *idx == policy) {
            Some(side) if group.is_pair() => {
                (condition as u64 * 2 + side as u64) * u64::from(self.n_episodes) + episode
            }
            _ => episode * self.n_conditions as u64 + condition as u64,
        };
        group.positions.start + within
    }
}

impl PolicyGroup {
    /// Returns `true` if the group keeps its cells together.
    pub(crate) fn is_pair(&self) -> bool {
        self.policies.len() == 2
    }
}

/// Indices of policy and condition, and the index of an episode.
pub(crate) type EpisodeIdx = (usize, usize, u32);
