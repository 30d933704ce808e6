//! The partition of a sweep into shards: which episodes each of them runs.
//!
//! It depends on the plan, the number of shards, expected costs and the share of audited episodes alone, so
//! every node computes the same one. Which shard runs an episode never changes the episode.

mod costs;
mod order;
mod shard;

use std::cell::OnceCell;
use std::rc::Rc;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

pub(crate) use self::costs::EpisodeCosts;
pub(crate) use self::order::EpisodeOrder;
use self::order::{EpisodeIdx, PolicyGroup};
pub(crate) use self::shard::{MAX_SHARDS, ShardRequest, SweepShard};
use crate::store::results::StoredPlan;

/// The partition of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Partition {
    order: EpisodeOrder,
    groups: Vec<PolicyGroup>,
    /// Hash of the name of each policy, and of each condition.
    names: [Vec<u64>; 2],
    pub(crate) cuts: Cuts,
}

/// The cuts between shards, and the share of audited episodes. Every shard's results file has them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Cuts {
    /// Position of the first episode of each shard.
    pub(crate) first: Vec<u64>,
    /// Share of the episodes that a second shard runs as well.
    pub(crate) audit: f64,
}

/// The description of a shard in its results file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredShard {
    /// Its index.
    pub(crate) shard: u32,
    #[serde(flatten)]
    pub(crate) cuts: Cuts,
    /// Number of its episodes that are another shard's and audited.
    pub(crate) n_second: u64,
    /// Machines that ran its tasks: names, CPUs, and extensions of the instruction set.
    #[serde(default)]
    pub(crate) machines: Vec<String>,
    /// Words of the command of the latest task, without the program.
    #[serde(default)]
    pub(crate) command: Vec<String>,
}

/// The episodes of one shard.
#[derive(Clone, Debug)]
pub(crate) struct ShardPart {
    partition: Rc<Partition>,
    pub(crate) shard: SweepShard,
    /// Number of episodes that are not in its range but audited.
    n_second: OnceCell<u64>,
}

impl Partition {
    /// Cuts a plan into shards of equal expected cost. There are at least as many episodes as shards.
    pub(crate) fn new(
        plan: &StoredPlan,
        pair: Option<&[String; 2]>,
        costs: &EpisodeCosts,
        count: u32,
        audit: f64,
    ) -> Self {
        let order = order(plan, pair);
        let groups = order.groups();
        let total: f64 = groups.iter().map(|group| costs.of_group(&order, group)).sum();
        let mut first = vec![0];
        for index in 1..count {
            let target = total * f64::from(index) / f64::from(count);
            let previous = first.last().copied().unwrap_or(0);
            // Every shard has an episode, unless cells are kept together.
            let last = order.len() - u64::from(count - index);
            let least = if order.pair.is_some() { previous } else { previous + 1 };
            first.push(cut(&order, &groups, costs, target).min(last).max(least));
        }
        Self::of(plan, pair, Cuts { first, audit })
    }

    /// Restores a partition from a file; `None` if these are no cuts of the plan.
    pub(crate) fn restore(plan: &StoredPlan, pair: Option<&[String; 2]>, cuts: Cuts) -> Option<Self> {
        let len = order(plan, pair).len();
        let is_sorted = cuts.first.first() == Some(&0) && cuts.first.is_sorted();
        let is_valid =
            is_sorted && cuts.first.iter().all(|first| *first <= len) && (0.0..=1.0).contains(&cuts.audit);
        is_valid.then(|| Self::of(plan, pair, cuts))
    }

    fn of(plan: &StoredPlan, pair: Option<&[String; 2]>, cuts: Cuts) -> Self {
        let order = order(plan, pair);
        let policies = plan.policies.iter().map(|name| hash(&[name])).collect();
        let conditions =
            plan.conditions.iter().map(|(task, perturbation)| hash(&[task, perturbation])).collect();
        Self { groups: order.groups(), order, names: [policies, conditions], cuts }
    }

    /// Returns the number of shards.
    pub(crate) fn count(&self) -> u32 {
        self.cuts.first.len() as u32
    }

    /// Returns all episodes of the plan.
    fn episodes(&self) -> impl Iterator<Item = EpisodeIdx> + '_ {
        let EpisodeOrder { n_policies, n_conditions, n_episodes, .. } = self.order;
        (0..n_policies).flat_map(move |policy| {
            (0..n_conditions)
                .flat_map(move |condition| (0..n_episodes).map(move |episode| (policy, condition, episode)))
        })
    }

    fn group(&self, policy_idx: usize) -> &PolicyGroup {
        let group = self.groups.iter().find(|group| group.policies.contains(&policy_idx));
        group.expect("every policy of the plan is in a group")
    }

    /// Returns the index of the shard that runs the episode at a position.
    fn owner(&self, position: u64) -> u32 {
        self.cuts.first.partition_point(|first| *first <= position) as u32 - 1
    }

    /// Returns the index of the second shard that runs an episode, if there is one: if possible one that
    /// loads the policy anyhow.
    fn second_owner(&self, idx: EpisodeIdx) -> Option<u32> {
        let (policy, condition, episode) = idx;
        let group = self.group(policy);
        if self.cuts.audit == 0.0 || self.count() == 1 || group.is_pair() {
            return None;
        }
        let mut hash = Xxh3::new();
        [self.names[0][policy], self.names[1][condition], u64::from(episode)]
            .iter()
            .for_each(|number| hash.update(&number.to_le_bytes()));
        let drawn = hash.digest();
        // The upper half decides whether, the lower where.
        if (drawn >> 32) as f64 / (1u64 << 32) as f64 >= self.cuts.audit {
            return None;
        }
        let own = self.owner(self.order.position(group, idx));
        let [low, high] =
            [group.positions.start, group.positions.end - 1].map(|position| self.owner(position));
        let (low, n) = if low < high { (low, high - low + 1) } else { (0, self.count()) };
        let step = 1 + (drawn & 0xFFFF_FFFF) as u32 % (n - 1);
        Some(low + (own - low + step) % n)
    }
}

impl ShardPart {
    /// Returns the part of a shard.
    pub(crate) fn new(partition: Rc<Partition>, shard: SweepShard) -> Self {
        Self { partition, shard, n_second: OnceCell::new() }
    }

    /// Returns what the shard's results file says about it.
    pub(crate) fn stored(&self, machines: Vec<String>, command: Vec<String>) -> StoredShard {
        let (shard, cuts) = (self.shard.index, self.partition.cuts.clone());
        StoredShard { shard, cuts, n_second: self.n_second(), machines, command }
    }

    /// Returns the number of episodes.
    pub(crate) fn len(&self) -> u64 {
        let own = self.range();
        own.end - own.start + self.n_second()
    }

    /// Returns the number of episodes that another shard runs as well, before this one.
    fn n_second(&self) -> u64 {
        let count = || self.partition.episodes().filter(|idx| self.audits(*idx)).count() as u64;
        *self.n_second.get_or_init(|| if self.partition.cuts.audit > 0.0 { count() } else { 0 })
    }

    /// Returns `true` if the shard runs an episode.
    pub(crate) fn contains(&self, idx: EpisodeIdx) -> bool {
        let Partition { order, .. } = &*self.partition;
        self.range().contains(&order.position(self.partition.group(idx.0), idx)) || self.audits(idx)
    }

    /// Returns `true` if the shard runs an episode because it is audited.
    fn audits(&self, idx: EpisodeIdx) -> bool {
        self.partition.second_owner(idx) == Some(self.shard.index)
    }

    fn range(&self) -> std::ops::Range<u64> {
        let Partition { order, cuts, .. } = &*self.partition;
        let index = self.shard.index as usize;
        cuts.first[index]..cuts.first.get(index + 1).copied().unwrap_or(order.len())
    }
}

fn order(plan: &StoredPlan, pair: Option<&[String; 2]>) -> EpisodeOrder {
    let position = |name: &String| plan.policies.iter().position(|policy| policy == name);
    let pair = pair.and_then(|[a, b]| Some([position(a)?, position(b)?]));
    EpisodeOrder {
        n_policies: plan.policies.len(),
        n_conditions: plan.conditions.len(),
        n_episodes: plan.episodes,
        pair,
    }
}

/// Returns the position before which the episodes cost `target`, rounded to whole episodes or cells.
fn cut(order: &EpisodeOrder, groups: &[PolicyGroup], costs: &EpisodeCosts, target: f64) -> u64 {
    let mut left = target;
    for group in groups {
        let cost = costs.of_group(order, group);
        if left >= cost {
            left -= cost;
            continue;
        }
        // A pass has one episode of each condition, or all of each in a group that keeps cells together.
        let unit = if group.is_pair() { 2 * u64::from(order.n_episodes) } else { 1 };
        let pass = if group.is_pair() { cost } else { cost / f64::from(order.n_episodes) };
        let n_passes = (left / pass).floor();
        let mut position = group.positions.start + n_passes as u64 * order.n_conditions as u64;
        left -= n_passes * pass;
        for condition in 0..order.n_conditions {
            let own: f64 = group.policies.iter().map(|policy| costs.get(*policy, condition)).sum();
            let own = if group.is_pair() { own * f64::from(order.n_episodes) } else { own };
            if left < own / 2.0 {
                break;
            }
            left -= own;
            position += unit;
        }
        return position;
    }
    order.len()
}

fn hash(words: &[&str]) -> u64 {
    let mut hash = Xxh3::new();
    for word in words {
        hash.update(&(word.len() as u64).to_le_bytes());
        hash.update(word.as_bytes());
    }
    hash.digest()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(n_policies: usize, n_conditions: usize, episodes: u32) -> StoredPlan {
        StoredPlan {
            policies: (0..n_policies).map(|idx| format!("p{idx}")).collect(),
            conditions: (0..n_conditions).map(|idx| (format!("T{idx}"), "None".to_owned())).collect(),
            episodes,
        }
    }

    /// Returns how often each episode is run, and the cost of each shard.
    fn runs(partition: &Partition, costs: &EpisodeCosts) -> (Vec<u32>, Vec<f64>) {
        let partition = Rc::new(partition.clone());
        let shards = (0..partition.count()).map(|index| SweepShard { index, count: partition.count() });
        let parts: Vec<ShardPart> =
            shards.map(|shard| ShardPart::new(Rc::clone(&partition), shard)).collect();
        let episodes: Vec<EpisodeIdx> = partition.episodes().collect();
        let n_runs =
            episodes.iter().map(|idx| parts.iter().filter(|part| part.contains(*idx)).count() as u32);
        let cost = |part: &ShardPart| {
            let own: Vec<_> = episodes.iter().filter(|idx| part.contains(**idx)).collect();
            assert_eq!(own.len() as u64, part.len());
            own.iter().map(|idx| costs.get(idx.0, idx.1)).sum()
        };
        (n_runs.collect(), parts.iter().map(cost).collect())
    }

    #[test]
    fn every_episode_has_one_shard() {
        for (policies, conditions, episodes) in [(1, 1, 7), (3, 5, 4), (2, 19, 20)] {
            let plan = plan(policies, conditions, episodes);
            let costs: Vec<f64> =
                (0..policies * conditions).map(|idx| 1.0 + (idx * idx % 7) as f64).collect();
            let costs = EpisodeCosts::of(costs, conditions);
            for count in [1, 2, 3, 7] {
                let partition = Partition::new(&plan, None, &costs, count, 0.0);
                let (n_runs, cost) = runs(&partition, &costs);
                assert!(n_runs.iter().all(|n| *n == 1), "{count}: {n_runs:?}");
                let fair = cost.iter().sum::<f64>() / f64::from(count);
                assert!(
                    cost.iter().all(|cost| (cost - fair).abs() <= 8.0 + 1e-9),
                    "{count} of {plan:?}: {cost:?}"
                );
            }
        }
    }

    #[test]
    fn audited_episodes_have_two_shards() {
        let plan = plan(2, 10, 200);
        let costs = EpisodeCosts::of(vec![1.0; 20], 10);
        let partition = Partition::new(&plan, None, &costs, 8, 0.05);
        let (n_runs, _) = runs(&partition, &costs);
        let n_twice = n_runs.iter().filter(|n| **n == 2).count();
        assert_eq!(n_runs.iter().filter(|n| **n != 1).count(), n_twice);
        assert!((140..260).contains(&n_twice), "{n_twice} of 4000");
        let alone = Partition::new(&plan, None, &costs, 1, 0.05);
        assert!(runs(&alone, &costs).0.iter().all(|n| *n == 1));
    }

    #[test]
    fn cuts_of_another_plan_are_refused() {
        let plan = plan(2, 3, 10);
        let restored =
            |first: &[u64], audit| Partition::restore(&plan, None, Cuts { first: first.to_vec(), audit });
        assert!(restored(&[0, 30, 60], 0.5).is_some());
        for (first, audit) in [
            (&[][..], 0.0),
            (&[1, 2], 0.0),
            (&[0, 5, 4], 0.0),
            (&[0, 61], 0.0),
            (&[0], 2.0),
            (&[0], f64::NAN),
        ] {
            assert!(restored(first, audit).is_none(), "{first:?} {audit}");
        }
    }

    #[test]
    fn cells_that_may_end_early_stay_whole() {
        let plan = plan(3, 10, 50);
        let costs = EpisodeCosts::of((0..30).map(|idx| f64::from(1 + idx % 4)).collect(), 10);
        let pair = ["p0", "p2"].map(str::to_owned);
        let partition = Partition::new(&plan, Some(&pair), &costs, 4, 0.1);
        let (n_runs, cost) = runs(&partition, &costs);
        assert!(n_runs.iter().all(|n| (1..=2).contains(n)), "{cost:?}");
        let rc = Rc::new(partition);
        for index in 0..4 {
            let part = ShardPart::new(Rc::clone(&rc), SweepShard { index, count: 4 });
            for condition in 0..10 {
                let own =
                    |policy| (0..50).filter(|episode| part.contains((policy, condition, *episode))).count();
                assert!([(0, 0), (50, 50)].contains(&(own(0), own(2))));
            }
        }
    }
}
