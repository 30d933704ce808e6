//! The SQL of a results file. Changing a table means a new [`VERSION`].

/// Application id of results files: "HYPG" in ASCII.
pub(crate) const APPLICATION_ID: i64 = 0x4859_5047;
/// Version of the tables below.
pub(crate) const VERSION: i64 = 3;

/// Creates the tables. Times are in seconds, `seed` is the episode seed, `fingerprint` has 16 hexadecimal
/// digits, `checksum` is that of the columns before it, and `actions` are the executed rows
/// `[steps, action_dim]` in little-endian f32 with a checksum of their own, if they were recorded.
pub(crate) const CREATE: &str = "
    CREATE TABLE manifest (
        key   TEXT NOT NULL PRIMARY KEY,
        value TEXT NOT NULL CHECK (json_valid(value))
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE episodes (
        policy             TEXT    NOT NULL,
        task               TEXT    NOT NULL,
        perturbation       TEXT    NOT NULL,
        episode            INTEGER NOT NULL,
        seed               INTEGER NOT NULL,
        steps              INTEGER NOT NULL,
        success_once       INTEGER NOT NULL,
        success_at_end     INTEGER NOT NULL,
        first_success_step INTEGER,
        failed_predicate   TEXT,
        fingerprint        TEXT    NOT NULL,
        error              TEXT,
        physics_s          REAL    NOT NULL,
        render_s           REAL    NOT NULL,
        policy_s           REAL    NOT NULL,
        wait_s             REAL    NOT NULL,
        checksum           INTEGER NOT NULL,
        actions            BLOB,
        PRIMARY KEY (policy, task, perturbation, episode)
    ) STRICT, WITHOUT ROWID;
";

/// Stores an episode. Only a row with an error is replaced.
pub(crate) const RECORD: &str = "
    INSERT INTO episodes (policy, task, perturbation, episode, seed, steps, success_once, success_at_end,
        first_success_step, failed_predicate, fingerprint, error, physics_s, render_s, policy_s, wait_s,
        checksum, actions)
    VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18)
    ON CONFLICT DO UPDATE SET seed = excluded.seed, steps = excluded.steps, success_once = excluded.success_once,
        success_at_end = excluded.success_at_end, first_success_step = excluded.first_success_step,
        failed_predicate = excluded.failed_predicate, fingerprint = excluded.fingerprint, error = excluded.error,
        physics_s = excluded.physics_s, render_s = excluded.render_s, policy_s = excluded.policy_s,
        wait_s = excluded.wait_s, checksum = excluded.checksum, actions = excluded.actions
    WHERE episodes.error IS NOT NULL";

/// Selects the keys of episodes without an error.
pub(crate) const FINISHED: &str = "
    SELECT policy, task, perturbation, episode FROM episodes WHERE error IS NULL
    ORDER BY policy, task, perturbation, episode";

/// Counts them.
pub(crate) const N_FINISHED: &str = "SELECT count(*) FROM episodes WHERE error IS NULL";

/// Number of columns of which [`CHECKED`] selects the checksum.
pub(crate) const N_CHECKED: usize = 16;

/// Selects all episodes with their checksums.
pub(crate) const CHECKED: &str = "
    SELECT policy, task, perturbation, episode, seed, steps, success_once, success_at_end,
        first_success_step, failed_predicate, fingerprint, error, physics_s, render_s, policy_s, wait_s,
        checksum
    FROM episodes ORDER BY policy, task, perturbation, episode";

/// Selects the episodes that can be replayed.
pub(crate) const RECORDED: &str = "
    SELECT policy, task, perturbation, episode, seed, steps, fingerprint FROM episodes
    WHERE error IS NULL AND actions IS NOT NULL ORDER BY policy, task, perturbation, episode";

/// Selects the actions of an episode.
pub(crate) const ACTIONS: &str =
    "SELECT actions FROM episodes WHERE policy = ?1 AND task = ?2 AND perturbation = ?3 AND episode = ?4";

/// Sums over the first episodes of one cell.
pub(crate) const SUMS: &str = "
    SELECT count(*) FILTER (WHERE error IS NULL),
        coalesce(sum(success_once) FILTER (WHERE error IS NULL), 0),
        coalesce(sum(success_at_end) FILTER (WHERE error IS NULL), 0),
        coalesce(sum(steps) FILTER (WHERE error IS NULL), 0),
        count(error)
    FROM episodes WHERE policy = ?1 AND task = ?2 AND perturbation = ?3 AND episode < ?4";

/// Selects all entries of the manifest.
pub(crate) const MANIFEST: &str = "SELECT key, value FROM manifest ORDER BY key";

/// Counts the episodes.
pub(crate) const COUNT: &str = "SELECT count(*) FROM episodes";

/// Selects all episodes, without their actions.
pub(crate) const ROWS: &str = "
    SELECT policy, task, perturbation, episode, seed, steps, success_once, success_at_end, first_success_step,
        failed_predicate, fingerprint, error, physics_s, render_s, policy_s, wait_s, actions IS NOT NULL
    FROM episodes ORDER BY policy, task, perturbation, episode";

/// Selects the episodes of a policy with their success, NULL if they could not be run.
pub(crate) const SUCCESSES: &str = "
    SELECT task, perturbation, episode, CASE WHEN error IS NULL THEN success_once END
    FROM episodes WHERE policy = ?1 ORDER BY task, perturbation, episode";
