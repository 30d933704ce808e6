//! The files and folders that a sweep names, which have to be on every machine.

use std::path::{Component, Path};

use anyhow::{Context, Result, bail};
use policy_host::PolicySpec;
use run_config::Instructions;

use crate::commands::distribution::submit::sharded_sweep::ShardedSweep;

/// Returns the paths of the sweep file, the checkpoints and everything else that the sweep reads, relative to
/// the current folder, each once.
///
/// # Errors
/// If one of them, or the results file, is not below the current folder.
pub(crate) fn inputs(sweep: &ShardedSweep, file: Option<&str>) -> Result<Vec<String>> {
    let options = &sweep.options;
    let mut paths: Vec<(String, &Path)> = Vec::new();
    paths.extend(file.map(|path| ("the sweep file".to_owned(), Path::new(path))));
    paths.extend(sweep.cutting.costs.as_deref().map(|path| ("--costs".to_owned(), path)));
    for policy in &options.policies {
        let path = match &policy.spec {
            PolicySpec::Attach(_) => bail!(
                "policy `{}` is a process on this machine, which other machines cannot reach: start it there, and \
                 use a scheduler's template",
                policy.name
            ),
            PolicySpec::Server(server) => server.mapping(),
            spec => spec.checkpoint(),
        };
        paths.extend(path.map(|path| (format!("policy `{}`", policy.name), path)));
    }
    let config = &options.config;
    paths.extend(config.results.language.as_ref().map(|file| ("--language".to_owned(), file.path())));
    if let Some(Instructions::File(file)) = &config.protocol.instructions {
        paths.push(("--instructions".to_owned(), file.path()));
    }
    let mut inputs = paths.iter().map(|(what, path)| below(what, path)).collect::<Result<Vec<_>>>()?;
    below("--db", &options.db)?;
    inputs.sort();
    inputs.dedup();
    Ok(inputs)
}

/// Returns a path below the current folder in its shortest form.
fn below(what: &str, path: &Path) -> Result<String> {
    let is_inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if path.starts_with("~") || !path.components().all(is_inside) {
        bail!(
            "{what}: {} is not below the current folder, which the machines mirror: copy or link it there and \
             name it by a relative path",
            path.display()
        );
    }
    let normal: std::path::PathBuf = path.components().filter(|part| *part != Component::CurDir).collect();
    normal.to_str().map(str::to_owned).with_context(|| format!("{what}: {} is not UTF-8", path.display()))
}
