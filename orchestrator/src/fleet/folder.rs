//! Files of a run outside shared memory: the folder all runs of a user share, and the notes for foreign hosts.

use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use ipc_types::link::{Domain, LaneSpec};
use ipc_types::run_config::{QueryMode, ResultOptions};
use ipc_types::{Morphology, SCHEMA_HASH};
use serde::Serialize;

use super::error::FleetError;

/// The folder under which the runs of this user live: `$XDG_RUNTIME_DIR/hypogeum`, or `/tmp/hypogeum_<uid>` where there is
/// none.
pub(crate) fn base() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|path| path.is_dir());
    runtime.map_or_else(
        || PathBuf::from(format!("/tmp/hypogeum_{}", rustix::process::getuid().as_raw())),
        |path| path.join("hypogeum"),
    )
}

/// Creates the folder if needed. `/tmp` is everybody's, so a folder of that name may be somebody else's: it is not used.
pub(super) fn prepare(base: &Path) -> Result<(), FleetError> {
    let failed = |reason: String| FleetError::Base { path: base.into(), reason };
    std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(base)
        .map_err(|error| failed(error.to_string()))?;
    let owner = std::fs::symlink_metadata(base).map_err(|error| failed(error.to_string()))?.uid();
    if owner == rustix::process::getuid().as_raw() {
        Ok(())
    } else {
        Err(failed(format!("it belongs to user {owner}")))
    }
}

/// All a foreign host needs to find its lane.
#[derive(Serialize)]
struct Invitation<'a> {
    domain: &'a Domain,
    run: u64,
    lane: &'a LaneSpec,
    /// Hexadecimal, because JSON numbers do not reach so far everywhere.
    schema_hash: String,
    morphologies: &'a [Morphology],
    images: bool,
    execute: u32,
    mode: QueryMode,
}

/// Writes `<root>/attach/<name>.json` and returns its path.
pub(super) fn invite(
    domain: &Domain,
    run_id: u64,
    name: &str,
    lane: &sim::serve::protocol::Lane,
    morphologies: &[Morphology],
    options: &ResultOptions,
) -> Result<PathBuf, FleetError> {
    let invitation = Invitation {
        domain,
        run: run_id,
        lane: &lane.spec,
        schema_hash: format!("{SCHEMA_HASH:#018x}"),
        morphologies,
        images: lane.images,
        execute: options.execute,
        mode: options.mode,
    };
    let folder = domain.root.join("attach");
    let path = folder.join(format!("{name}.json"));
    let part = folder.join(format!(".{name}.json"));
    // Renamed into place, so that a host that watches the folder never reads half of it.
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&part, format!("{:#}\n", serde_json::json!(invitation))))
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|source| FleetError::Attach { name: name.to_owned(), path: path.clone(), source })?;
    Ok(path)
}
