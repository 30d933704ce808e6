//! Files of a run outside shared memory: the base folder of a user's runs, and the descriptions for foreign
//! hosts.

use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use ipc_types::link::{Domain, LaneSpec};
use ipc_types::run_config::{QueryMode, ResultOptions};
use ipc_types::{Morphology, SCHEMA_HASH};
use serde::Serialize;

use super::error::{BaseError, FleetError};

/// Returns the folder under which all runs of this user live: `$XDG_RUNTIME_DIR/hypogeum`, or
/// `/tmp/hypogeum_<uid>` if that is not set.
pub(crate) fn base() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|path| path.is_dir());
    runtime.map_or_else(
        || PathBuf::from(format!("/tmp/hypogeum_{}", rustix::process::getuid().as_raw())),
        |path| path.join("hypogeum"),
    )
}

/// Creates the base folder if needed. Since anybody can create it in `/tmp`, a folder of another user is
/// refused.
pub(super) fn prepare(base: &Path) -> Result<(), FleetError> {
    let failed = |source: BaseError| FleetError::Base { path: base.into(), source };
    std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(base)
        .map_err(|error| failed(error.into()))?;
    let owner = std::fs::symlink_metadata(base).map_err(|error| failed(error.into()))?.uid();
    if owner == rustix::process::getuid().as_raw() {
        Ok(())
    } else {
        Err(failed(BaseError::ForeignOwner { owner }))
    }
}

/// The description of a lane for a foreign host.
#[derive(Serialize)]
struct LaneDescription<'a> {
    domain: &'a Domain,
    run: u64,
    lane: &'a LaneSpec,
    /// Hexadecimal, since JSON numbers of some languages do not hold 64 bits.
    schema_hash: String,
    morphologies: &'a [Morphology],
    images: bool,
    execute: u32,
    mode: QueryMode,
}

/// Writes the description of a lane to `<root>/attach/<name>.json` and returns that path.
pub(super) fn write_lane_description(
    domain: &Domain,
    run_id: u64,
    name: &str,
    lane: &sim::serve::protocol::Lane,
    morphologies: &[Morphology],
    options: &ResultOptions,
) -> Result<PathBuf, FleetError> {
    let description = LaneDescription {
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
    // The rename is atomic, so that a host that watches the folder never reads a partial file.
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&part, format!("{:#}\n", serde_json::json!(description))))
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|source| FleetError::Attach { name: name.to_owned(), path: path.clone(), source })?;
    Ok(path)
}
