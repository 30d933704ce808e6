//! The SQL of a results file. Changing a table means a new [`VERSION`].

use crate::store::results::columns::{Column, names};

/// Application id of results files: "HYPG" in ASCII.
pub(crate) const APPLICATION_ID: i64 = 0x4859_5047;
/// Version of the tables below.
pub(crate) const VERSION: i64 = 3;

/// Creates the tables.
pub(crate) fn create() -> String {
    let column = |column: &Column| format!("        {:<18} {},\n", column.name(), column.sql());
    let columns: String = Column::ALL.iter().map(column).collect();
    format!(
        "
    CREATE TABLE manifest (
        key   TEXT NOT NULL PRIMARY KEY,
        value TEXT NOT NULL CHECK (json_valid(value))
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE episodes (
{columns}        PRIMARY KEY ({})
    ) STRICT, WITHOUT ROWID;
",
        names(&Column::KEY)
    )
}

/// Stores an episode. Only a row with an error is replaced.
pub(crate) fn record() -> String {
    let replaced = Column::ALL.iter().filter(|column| !Column::KEY.contains(column));
    let updates: Vec<String> =
        replaced.map(|column| format!("{name} = excluded.{name}", name = column.name())).collect();
    format!(
        "{} ON CONFLICT DO UPDATE SET {} WHERE episodes.{} IS NOT NULL",
        insert(),
        updates.join(", "),
        Column::Error.name()
    )
}

/// Selects the keys of episodes without an error.
pub(crate) fn finished() -> String {
    let key = names(&Column::KEY);
    format!("SELECT {key} FROM episodes WHERE {} IS NULL ORDER BY {key}", Column::Error.name())
}

/// Counts them.
pub(crate) fn n_finished() -> String {
    format!("SELECT count(*) FROM episodes WHERE {} IS NULL", Column::Error.name())
}

/// Selects all episodes: every column up to the checksum, by its number, and one more that tells whether
/// there are actions.
pub(crate) fn rows() -> String {
    format!(
        "SELECT {}, {}, {} IS NOT NULL FROM episodes ORDER BY {}",
        names(Column::checked()),
        Column::Checksum.name(),
        Column::Actions.name(),
        names(&Column::KEY)
    )
}

/// Selects all episodes with all columns, by their numbers.
pub(crate) fn whole_rows() -> String {
    format!("SELECT {} FROM episodes ORDER BY {}", names(Column::ALL), names(&Column::KEY))
}

/// Inserts an episode that is not there.
pub(crate) fn insert() -> String {
    let values: Vec<String> = (1..=Column::ALL.len()).map(|number| format!("?{number}")).collect();
    format!("INSERT INTO episodes ({}) VALUES ({})", names(Column::ALL), values.join(", "))
}

/// Selects the episodes that can be replayed: every column before the checksum, by its number.
pub(crate) fn recorded() -> String {
    format!(
        "SELECT {} FROM episodes WHERE {} IS NULL AND {} IS NOT NULL ORDER BY {}",
        names(Column::checked()),
        Column::Error.name(),
        Column::Actions.name(),
        names(&Column::KEY)
    )
}

/// Selects the actions of an episode.
pub(crate) fn actions() -> String {
    format!("SELECT {} FROM episodes WHERE {}", Column::Actions.name(), is_episode())
}

/// Selects sums over the first episodes of one cell.
pub(crate) fn sums() -> String {
    let [policy, task, perturbation, episode] = Column::KEY.map(Column::name);
    let error = Column::Error.name();
    let sums = [Column::SuccessOnce, Column::SuccessAtEnd, Column::Steps]
        .map(|column| format!("coalesce(sum({}) FILTER (WHERE {error} IS NULL), 0)", column.name()));
    format!(
        "SELECT count(*) FILTER (WHERE {error} IS NULL), {}, count({error}) FROM episodes
        WHERE {policy} = ?1 AND {task} = ?2 AND {perturbation} = ?3 AND {episode} < ?4",
        sums.join(", ")
    )
}

/// Selects the episodes of a policy with their success, NULL if they could not be run.
pub(crate) fn successes() -> String {
    let [policy, task, perturbation, episode] = Column::KEY.map(Column::name);
    format!(
        "SELECT {task}, {perturbation}, {episode}, CASE WHEN {} IS NULL THEN {} END
        FROM episodes WHERE {policy} = ?1 ORDER BY {task}, {perturbation}, {episode}",
        Column::Error.name(),
        Column::SuccessOnce.name()
    )
}

/// Asks whether there is an episode of a policy.
pub(crate) fn has_policy() -> String {
    format!("SELECT EXISTS (SELECT 1 FROM episodes WHERE {} = ?1)", Column::Policy.name())
}

/// Returns the condition on the key of an episode, whose values are the first parameters.
pub(crate) fn is_episode() -> String {
    let conditions: Vec<String> =
        (1..).zip(Column::KEY).map(|(number, column)| format!("{} = ?{number}", column.name())).collect();
    conditions.join(" AND ")
}

/// Selects all entries of the manifest.
pub(crate) const MANIFEST: &str = "SELECT key, value FROM manifest ORDER BY key";

/// Counts the episodes.
pub(crate) const COUNT: &str = "SELECT count(*) FROM episodes";
