//! Error rates of the statistics by simulation, and the speed of `compare` and `report` on a million rows.
//!
//! `cargo bench -p benches --bench conclusions [-- --quick]`

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod means;
mod million_rows;

use orchestrator::statistics::{
    ConfidenceSequence, Decision, Levels, PairRates, PairedSequence, Pairs, TestedDifference, equivalence_p,
    judge, mcnemar_mid_p, tango_interval, wilson_interval,
};
use rayon::prelude::*;
use sim::scene::stream::Stream;

const LEVELS: Levels = Levels { alpha: 0.05, margin: 0.05 };

/// Probabilities that only A and that only B succeeds, and that both do.
#[derive(Clone, Copy)]
struct Rates {
    only_a: f64,
    only_b: f64,
    both: f64,
}

impl Rates {
    fn difference(self) -> f64 {
        self.only_a - self.only_b
    }

    fn draw(self, random: &mut Stream) -> (bool, bool) {
        let u = random.unit();
        if u < self.only_a {
            (true, false)
        } else if u < self.only_a + self.only_b {
            (false, true)
        } else {
            let both = u < self.only_a + self.only_b + self.both;
            (both, both)
        }
    }
}

fn main() -> anyhow::Result<()> {
    let is_quick = std::env::args().any(|word| word == "--quick");
    let n_streams = if is_quick { 1000 } else { 10_000 };
    false_positives(n_streams);
    family_wise_errors(n_streams / 5);
    coverage(n_streams);
    means::means(if is_quick { 200 } else { 2000 });
    planned(n_streams / 5);
    episodes_saved(n_streams / 5);
    million_rows::million_rows(if is_quick { 100 } else { 1000 })
}

fn streams(n: usize, name: &str) -> impl IndexedParallelIterator<Item = Stream> {
    (0..n).into_par_iter().map(move |idx| Stream::new(idx as u64, name))
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole as f64
}

/// Looks at every stream after every pair, up to 500, under equal rates.
fn false_positives(n: usize) {
    println!(
        "false decisions for A or B under equal rates, looking after every one of 500 pairs, {n} streams"
    );
    for (discordant, both) in [(0.1, 0.4), (0.3, 0.4), (0.5, 0.25), (0.02, 0.9)] {
        let rates = Rates { only_a: discordant / 2.0, only_b: discordant / 2.0, both };
        let is_wrong = |mut random: Stream| {
            let mut sequence = PairedSequence::new(LEVELS);
            let mut fixed = false;
            for _ in 0..500 {
                let (a, b) = rates.draw(&mut random);
                sequence.push(a, b);
                fixed |= mcnemar_mid_p(sequence.pairs()) <= LEVELS.alpha;
            }
            (sequence.tested().p <= LEVELS.alpha, fixed)
        };
        let found: Vec<(bool, bool)> = streams(n, "null").map(is_wrong).collect();
        let sequential = found.iter().filter(|(wrong, _)| *wrong).count();
        let fixed = found.iter().filter(|(_, wrong)| *wrong).count();
        println!(
            "  discordance {discordant:4}: e-values {:5.2} %; a fixed-sample test looked at as often {:5.2} %",
            percent(sequential, n),
            percent(fixed, n)
        );
    }
}

/// Counts tables with any false decision among 25 cells: 20 equal ones and 5 with a difference, or all with
/// a difference of the margin.
fn family_wise_errors(n: usize) {
    let null = Rates { only_a: 0.15, only_b: 0.15, both: 0.4 };
    let better = Rates { only_a: 0.35, only_b: 0.05, both: 0.4 };
    let at_margin = Rates { only_a: 0.05, only_b: 0.0, both: 0.4 };
    println!("any false decision in a table of 25 cells, 200 pairs each, {n} tables");
    for (what, first, last, is_false) in [
        ("20 equal cells", null, better, [Decision::ABetter, Decision::BBetter]),
        ("20 cells at the margin", at_margin, better, [Decision::Equivalent; 2]),
    ] {
        let run = |mut random: Stream| {
            let mut cells = vec![PairedSequence::new(LEVELS); 25];
            let is_wrong = |tested: Vec<TestedDifference>| {
                let judged = judge(&tested, LEVELS.alpha);
                judged[..20].iter().any(|cell| is_false.contains(&cell.decision))
            };
            let mut at_any_time = false;
            for _ in 0..200 {
                for (idx, cell) in cells.iter_mut().enumerate() {
                    let (a, b) = if idx < 20 { first } else { last }.draw(&mut random);
                    cell.push(a, b);
                }
                at_any_time |= is_wrong(cells.iter().map(PairedSequence::tested).collect());
            }
            let once = cells.iter().map(|cell| {
                let pairs = cell.pairs();
                TestedDifference {
                    difference: pairs.difference().unwrap_or(0.0),
                    p: mcnemar_mid_p(pairs),
                    equivalence_p: equivalence_p(pairs, LEVELS.margin),
                }
            });
            [is_wrong(once.collect()), at_any_time]
        };
        let found: Vec<[bool; 2]> = streams(n, "family").map(run).collect();
        let share = |idx: usize| percent(found.iter().filter(|wrong| wrong[idx]).count(), n);
        println!(
            "  {what}: judged once {:.2} %, judged after every pair with sequential tests {:.2} %",
            share(0),
            share(1)
        );
    }
}

fn coverage(n: usize) {
    let z = LEVELS.z();
    println!("coverage of 95 % intervals, {n} samples each");
    for (rates, size) in [
        (Rates { only_a: 0.15, only_b: 0.15, both: 0.4 }, 50),
        (Rates { only_a: 0.3, only_b: 0.1, both: 0.3 }, 50),
        (Rates { only_a: 0.15, only_b: 0.05, both: 0.7 }, 200),
        (Rates { only_a: 0.04, only_b: 0.02, both: 0.9 }, 200),
    ] {
        let covered = |mut random: Stream| {
            let mut pairs = Pairs::default();
            let mut sequence = PairedSequence::new(LEVELS);
            let mut rate = ConfidenceSequence::new(LEVELS.alpha);
            let (difference, success) = (rates.difference(), rates.only_a + rates.both);
            let holds = |interval: [f64; 2], value: f64| interval[0] <= value && value <= interval[1];
            for _ in 0..size {
                let (a, b) = rates.draw(&mut random);
                pairs.add(a, b);
                sequence.push(a, b);
                rate.push(f64::from(u8::from(a)));
            }
            let of =
                |interval: Option<[f64; 2]>, value| interval.is_some_and(|interval| holds(interval, value));
            // Sequences are intersected over time, so the last interval covers only if all did.
            [
                of(wilson_interval(pairs.successes()[0], size, z), success),
                of(tango_interval(&pairs, z), difference),
                holds(sequence.interval(), difference),
                holds(rate.interval(), success),
            ]
        };
        let found: Vec<[bool; 4]> = streams(n, "coverage").map(covered).collect();
        let share = |idx: usize| percent(found.iter().filter(|covers| covers[idx]).count(), n);
        println!(
            "  n {size:3}, A only {:.2}, B only {:.2}: Wilson {:.1}, Tango {:.1}, at all times: \
             difference {:.1}, rate {:.1} %",
            rates.only_a,
            rates.only_b,
            share(0),
            share(1),
            share(2),
            share(3)
        );
    }
}

/// Plans numbers of pairs for a decision at 80 % power, and counts how often there is one.
fn planned(n: usize) {
    println!("share of decisions with the planned number of pairs for 80 %, {n} runs");
    for (difference, discordance) in
        [(0.05, 0.1), (0.1, 0.3), (0.2, 0.3), (0.4, 0.5), (0.0, 0.1), (0.0, 0.3), (0.02, 0.1)]
    {
        let rates = Rates {
            only_a: 0.5 * (discordance + difference),
            only_b: 0.5 * (discordance - difference),
            both: 0.0,
        };
        let needed = PairRates { difference, discordance }.pairs_needed(LEVELS, [1, 1]).ceil() as u32;
        let is_decided = |mut random: Stream| {
            let mut pairs = Pairs::default();
            for _ in 0..needed {
                let (a, b) = rates.draw(&mut random);
                pairs.add(a, b);
            }
            mcnemar_mid_p(&pairs) <= LEVELS.alpha || equivalence_p(&pairs, LEVELS.margin) <= LEVELS.alpha
        };
        let decided = streams(n, "planned").filter(|random| is_decided(random.clone())).count();
        println!(
            "  difference {difference}, discordance {discordance}: {needed} pairs, {:.1} %",
            percent(decided, n)
        );
    }
}

/// Compares the mean number of pairs until a decision with a test at a fixed number of pairs.
fn episodes_saved(n: usize) {
    println!("pairs until a decision for the better policy, discordance 0.3, {n} runs");
    for difference in [0.2, 0.1, 0.05] {
        let rates = Rates { only_a: 0.15 + difference / 2.0, only_b: 0.15 - difference / 2.0, both: 0.4 };
        let fixed = PairRates { difference, discordance: 0.3 }.pairs_needed(LEVELS, [1, 1]).ceil() as usize;
        let budget = 3 * fixed;
        let run = |mut random: Stream| {
            let mut sequence = PairedSequence::new(LEVELS);
            for idx in 1..=budget {
                let (a, b) = rates.draw(&mut random);
                sequence.push(a, b);
                let decision = judge(&[sequence.tested()], LEVELS.alpha)[0].decision;
                if decision != Decision::Undecided {
                    return (idx, decision == Decision::ABetter);
                }
            }
            (budget, false)
        };
        let found: Vec<(usize, bool)> = streams(n, "saved").map(run).collect();
        let mean = found.iter().map(|(n_pairs, _)| n_pairs).sum::<usize>() as f64 / n as f64;
        let right = found.iter().filter(|(_, right)| *right).count();
        println!(
            "  difference {difference:4}: mean {mean:.0} of at most {budget} ({:.0} % saved), {:.1} % right; fixed sample at 80 % \
             power: {fixed}",
            100.0 * (1.0 - mean / budget as f64),
            percent(right, n)
        );
    }
}
