//! The columns of the table `episodes`, each defined once: the table, its statements, the checks of what a
//! file contains, comparisons of episodes and exports follow from this list. Their meanings are in
//! `docs/results.md`.

use rusqlite::types::Value;
use sim::serve::protocol::Outcome;

use crate::selection::condition::Condition;
use crate::store::stored_episode::format_fingerprint;

/// Most control steps of an episode, far above every horizon.
const MAX_STEPS: i64 = 100_000;

/// The values that a column may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Values {
    /// Text.
    Text,
    /// Integers from 0 to this one.
    UpTo(i64),
    /// The same, or NULL.
    UpToOrNull(i64),
    /// Times in s.
    Seconds,
    /// Hashes and what they protect.
    Sealed,
}

/// Declares the columns in the order of the table: the name, the SQL type and the values of each.
macro_rules! columns {
    ($($(#[$attribute:meta])* $column:ident = $name:literal $sql:literal $values:expr;)*) => {
        /// A column of the table `episodes`. Its number is its position in the table.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Column {
            $($(#[$attribute])* $column,)*
        }

        impl Column {
            /// All columns.
            pub(crate) const ALL: &[Self] = &[$(Self::$column,)*];

            /// Returns the name of the column.
            pub(crate) const fn name(self) -> &'static str {
                match self { $(Self::$column => $name,)* }
            }

            /// Returns the SQL type.
            pub(crate) const fn sql(self) -> &'static str {
                match self { $(Self::$column => $sql,)* }
            }

            /// Returns the values that the column may have.
            pub(crate) const fn values(self) -> Values {
                match self { $(Self::$column => $values,)* }
            }
        }
    };
}

columns! {
    /// Name of the policy.
    Policy = "policy" "TEXT    NOT NULL" Values::Text;
    Task = "task" "TEXT    NOT NULL" Values::Text;
    Perturbation = "perturbation" "TEXT    NOT NULL" Values::Text;
    /// Index of the episode under the suite seed.
    Episode = "episode" "INTEGER NOT NULL" Values::UpTo(u32::MAX as i64);
    /// Episode seed, below 2⁶³.
    Seed = "seed" "INTEGER NOT NULL" Values::UpTo(i64::MAX);
    Steps = "steps" "INTEGER NOT NULL" Values::UpTo(MAX_STEPS);
    SuccessOnce = "success_once" "INTEGER NOT NULL" Values::UpTo(1);
    SuccessAtEnd = "success_at_end" "INTEGER NOT NULL" Values::UpTo(1);
    FirstSuccessStep = "first_success_step" "INTEGER" Values::UpToOrNull(MAX_STEPS);
    FailedPredicate = "failed_predicate" "TEXT" Values::Text;
    /// 16 hexadecimal digits.
    Fingerprint = "fingerprint" "TEXT    NOT NULL" Values::Text;
    Error = "error" "TEXT" Values::Text;
    PhysicsS = "physics_s" "REAL    NOT NULL" Values::Seconds;
    RenderS = "render_s" "REAL    NOT NULL" Values::Seconds;
    PolicyS = "policy_s" "REAL    NOT NULL" Values::Seconds;
    WaitS = "wait_s" "REAL    NOT NULL" Values::Seconds;
    /// Hash of the columns before it.
    Checksum = "checksum" "INTEGER NOT NULL" Values::Sealed;
    /// Executed rows `[steps, action_dim]` in little-endian f32 with a checksum of their own, or NULL.
    Actions = "actions" "BLOB" Values::Sealed;
}

/// The primary key of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EpisodeKey<'a> {
    /// Name of the policy.
    pub(crate) policy: &'a str,
    pub(crate) condition: Condition,
    /// Index of the episode under the suite seed.
    pub(crate) episode: u32,
}

impl Column {
    /// The primary key.
    pub(crate) const KEY: [Self; 4] = [Self::Policy, Self::Task, Self::Perturbation, Self::Episode];

    /// Seconds of physics, rendering, policy and waiting.
    pub(crate) const TIMES: [Self; 4] = [Self::PhysicsS, Self::RenderS, Self::PolicyS, Self::WaitS];

    /// Returns all columns before the checksum.
    pub(crate) fn checked() -> &'static [Self] {
        &Self::ALL[..Self::Checksum as usize]
    }

    /// Returns the columns that an episode has again whenever it is run again.
    pub(crate) fn reproducible() -> impl Iterator<Item = Self> {
        Self::checked().iter().copied().filter(|it| !Self::KEY.contains(it) && !Self::TIMES.contains(it))
    }

    /// Returns the value of an episode in a column before the checksum.
    pub(crate) fn of_outcome(self, key: &EpisodeKey<'_>, seed: u64, outcome: &Outcome) -> Value {
        match self {
            Self::Policy => key.policy.to_owned().into(),
            Self::Task => key.condition.task.name().to_owned().into(),
            Self::Perturbation => key.condition.perturbation.name().into(),
            Self::Episode => key.episode.into(),
            Self::Seed => seed.cast_signed().into(),
            Self::Steps => outcome.steps.into(),
            Self::SuccessOnce => outcome.success_once.into(),
            Self::SuccessAtEnd => outcome.success_at_end.into(),
            Self::FirstSuccessStep => outcome.first_success_step.into(),
            Self::FailedPredicate => outcome.failed_predicate.clone().into(),
            Self::Fingerprint => format_fingerprint(outcome.fingerprint).into(),
            Self::Error => outcome.error.clone().into(),
            Self::PhysicsS => outcome.ledger.physics_s.into(),
            Self::RenderS => outcome.ledger.render_s.into(),
            Self::PolicyS => outcome.ledger.policy_s.into(),
            Self::WaitS => outcome.ledger.wait_s.into(),
            Self::Checksum | Self::Actions => Value::Null,
        }
    }
}

/// Returns the names of columns, separated by commas.
pub(crate) fn names(columns: &[Column]) -> String {
    columns.iter().map(|column| column.name()).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documentation_lists_every_column() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/results.md");
        let text = std::fs::read_to_string(path).unwrap();
        let table = text.split("## The `episodes` table").nth(1).unwrap().split("\n## ").next().unwrap();
        let cells = table.lines().filter_map(|line| line.strip_prefix("| `")?.split('|').next());
        let listed: Vec<&str> =
            cells.flat_map(|cell| cell.split(", ")).map(|it| it.trim_matches(['`', ' '])).collect();
        let columns: Vec<&str> = Column::ALL.iter().map(|column| column.name()).collect();
        assert_eq!(listed, columns);
    }
}
