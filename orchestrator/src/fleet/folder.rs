//! Files of a run outside shared memory: the base folder of a user's runs, and the descriptions for foreign
//! hosts.

use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use ipc_types::link::{Domain, LaneSpec};
use ipc_types::{ImageSizes, Morphology, SCHEMA_HASH};
use policy_host::PolicySpec;
use run_config::{QueryMode, QueryOptions};
use serde::{Deserialize, Serialize};

use super::config::FleetConfig;
use super::error::{BaseError, FleetError};
use super::event::{FleetEvent, Observer};
use crate::plan::lanes::PolicyLane;

/// Permission bits of everybody but the owner.
const OTHERS: u32 = 0o077;
/// Permission of everybody to add and remove files.
const WRITABLE_BY_ALL: u32 = 0o002;
/// Bit of a folder in which only the owner of a file may remove it, such as `/tmp` (inode(7)).
const STICKY: u32 = 0o1000;

/// Returns the folder under which all runs of this user live: `$XDG_RUNTIME_DIR/hypogeum`, or
/// `/tmp/hypogeum_<uid>` if that variable names no folder by an absolute path, as its specification demands.
pub(crate) fn runtime_folder() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    runtime.filter(|path| path.is_absolute() && path.is_dir()).map_or_else(
        || PathBuf::from(format!("/tmp/hypogeum_{}", rustix::process::getuid().as_raw())),
        |path| path.join("hypogeum"),
    )
}

/// Creates the base folder if needed, and takes all permissions of other users away, who could otherwise
/// replace the files of a run. Since anybody can create it in `/tmp`, a folder of another user is refused,
/// and so is a symbolic link.
pub(crate) fn prepare(base: &Path) -> Result<(), FleetError> {
    prepare_base(base).map_err(|source| FleetError::Base { path: base.into(), source })
}

fn prepare_base(base: &Path) -> Result<(), BaseError> {
    check_parents(base)?;
    let created = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(base);
    let found = std::fs::symlink_metadata(base).map_err(|missing| created.err().unwrap_or(missing))?;
    if found.is_symlink() {
        return Err(BaseError::NotAFolder { found: "a symbolic link" });
    }
    if !found.is_dir() {
        return Err(BaseError::NotAFolder { found: "no folder" });
    }
    if found.uid() != rustix::process::getuid().as_raw() {
        return Err(BaseError::ForeignOwner { owner: found.uid() });
    }
    // Nobody else can replace the folder after this check: it is this user's, and its parents are closed.
    if found.mode() & OTHERS != 0 {
        std::fs::set_permissions(base, std::fs::Permissions::from_mode(0o700))?;
    }
    Ok(())
}

/// Checks that no other user can replace a folder above `base`.
fn check_parents(base: &Path) -> Result<(), BaseError> {
    for parent in base.ancestors().skip(1) {
        // A parent that does not exist yet is created for this user only.
        let Ok(metadata) = std::fs::metadata(parent) else { continue };
        let mode = metadata.mode() & 0o7777;
        if mode & WRITABLE_BY_ALL != 0 && mode & STICKY == 0 {
            return Err(BaseError::OpenParent { parent: parent.into(), mode });
        }
    }
    Ok(())
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
    /// Sizes of the images; null without images.
    images: Option<ImageSizes>,
    answer_timeout_s: u32,
    execute: u32,
    mode: QueryMode,
    /// The user's request: a host that was trained for something else can say so.
    requested: QueryOptions,
}

/// Returns the name under which the host of a policy in a server finds its lane, which no other run has.
pub(crate) fn server_endpoint(run_id: u64, lane: u32) -> String {
    format!("server.{run_id:016x}.{lane}")
}

/// Writes the descriptions of all lanes whose host may be in another language, and reports the paths of
/// foreign ones.
pub(crate) fn describe_foreign_lanes(
    config: &FleetConfig,
    domain: &Domain,
    observer: &mut dyn Observer,
) -> Result<(), FleetError> {
    for policy in &config.lanes {
        if let PolicySpec::Server(_) = &policy.spec {
            let name = server_endpoint(config.run_id, policy.lane.spec.lane);
            write_lane_description(config, domain, &name, policy)?;
        }
        if let PolicySpec::Attach(name) = &policy.spec {
            let path = write_lane_description(config, domain, name, policy)?;
            let policy = &policy.lane.spec.policy;
            let line =
                format!("policy `{policy}` waits for a foreign host; its lane is in {}", path.display());
            observer.on_event(&FleetEvent::Log(&line)).map_err(FleetError::Observer)?;
        }
    }
    Ok(())
}

/// Writes the description of a lane to `<root>/attach/<name>.json` and returns that path.
fn write_lane_description(
    config: &FleetConfig,
    domain: &Domain,
    name: &str,
    PolicyLane { lane, execution, .. }: &PolicyLane,
) -> Result<PathBuf, FleetError> {
    let description = LaneDescription {
        domain,
        run: config.run_id,
        lane: &lane.spec,
        schema_hash: format!("{SCHEMA_HASH:#018x}"),
        morphologies: &config.morphologies,
        images: lane.images,
        answer_timeout_s: lane.answer_timeout_s,
        execute: execution.execute,
        mode: execution.mode,
        requested: config.run.query,
    };
    let folder = domain.root.join("attach");
    let path = folder.join(format!("{name}.json"));
    let part = folder.join(format!(".{name}.json"));
    // The rename is atomic, so that a host that watches the folder never reads a partial file.
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&part, format!("{:#}\n", serde_json::json!(description))))
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|source| FleetError::Attach { name: name.to_owned(), path: path.clone(), source })?;
    // Checked after writing, so that of two runs that start at the same time at least one is told.
    match other_description(&domain.root, name) {
        Some(path) => Err(FleetError::NameTaken { name: name.to_owned(), path }),
        None => Ok(path),
    }
}

/// Returns the description of a lane with this name that belongs to another run in progress. A host that
/// attaches by name could not tell the two apart.
fn other_description(root: &Path, name: &str) -> Option<PathBuf> {
    #[derive(Deserialize)]
    struct OtherLane {
        domain: Domain,
    }
    let runs = std::fs::read_dir(root.parent()?).ok()?;
    let paths = runs.flatten().map(|run| run.path()).filter(|path| path != root);
    paths.map(|path| path.join("attach").join(format!("{name}.json"))).find(|path| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        serde_json::from_str(&text).is_ok_and(|other: OtherLane| other.domain.is_in_use())
    })
}
