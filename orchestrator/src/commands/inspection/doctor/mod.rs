//! `hypogeum doctor`: checks whether this machine is ready for runs, and says what to do where it is not.

mod check;
mod limits;

use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Command, Stdio};

use clap::Args;
use ipc_types::link::SHM;
use ipc_types::{ControlMode, ImageSizes};
use run_config::{RendererChoice, Samples};
use serde_json::json;
use sim::demo::Recording;
use sim::episode::EpisodeSpec;
use sim::perturb::Strength;
use sim::render::{CpuOptions, CpuRenderer, OpenRendererError, RenderScene, Renderer};
use sim::scene::stream::episode_seed;
use sim::{Perturbation, Profile, TaskId};
use xxhash_rust::xxh3::Xxh3Default;

use self::check::{Check, CheckStatus};
use crate::console::exit::{ExitStatus, Failure};
use crate::console::output::print_out;
use crate::console::threads::start_threads;
use crate::fleet;
use crate::store::build_identity;
use crate::study::machine::Machine;

/// Shared memory below which runs with many envs do not start, in bytes. A lane of 16 envs with images needs
/// about 10 MB.
const COMFORTABLE_SHM: u64 = 256 << 20;
/// Fingerprint of the reference episode: the expert on RaiseCube, unperturbed, suite seed 0, episode 0.
const EPISODE_FINGERPRINT: u64 = 0x0759_9ef0_88b3_4ca2;
/// Hash of all images at the start of the reference episode.
const IMAGES_HASH: u64 = 0x2bd4_d8ee_6b9c_20cf;

/// Arguments of `doctor`.
#[derive(Args, Debug)]
pub(crate) struct DoctorArgs {
    /// Print one JSON object instead of lines
    #[arg(long)]
    pub(crate) json: bool,
    /// Python interpreter to look at
    #[arg(long, value_name = "PYTHON", default_value = "python3")]
    pub(crate) python: String,
}

/// Runs all checks. The exit code is 1 if there is a problem.
pub(crate) fn doctor(args: &DoctorArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    let mut checks = vec![shared_memory(), run_folder(), left_overs(), cpu()];
    checks.extend([limits::cores(), limits::memory(), limits::resources(), limits::logout()]);
    checks.extend(reference_episode());
    checks.push(vulkan());
    checks.extend(adapters());
    checks.push(python(&args.python));
    if args.json {
        let machine = Machine::detect();
        let version = build_identity::VERSION;
        print_out(&format!("{:#}\n", json!({ "version": version, "machine": machine, "checks": checks })))?;
    } else {
        print_out(&checks.iter().map(Check::text).collect::<String>())?;
    }
    let has_problem = checks.iter().any(|check| check.status == CheckStatus::Problem);
    Ok(if has_problem { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

fn shared_memory() -> Check {
    const NAME: &str = "shared memory";
    let shm = Path::new(SHM);
    let stat = match rustix::fs::statvfs(shm) {
        Ok(stat) => stat,
        Err(error) => {
            let advice = "mount a tmpfs on /dev/shm; without it no run starts";
            return Check::new(
                NAME,
                CheckStatus::Problem,
                format!("/dev/shm cannot be queried: {error}"),
                advice,
            );
        }
    };
    let [free, size] = [stat.f_bavail, stat.f_blocks].map(|blocks| blocks.saturating_mul(stat.f_frsize));
    let found = format!("/dev/shm has {} MiB, {} MiB free", size >> 20, free >> 20);
    let probe = shm.join(format!("hypogeum-doctor-{}", std::process::id()));
    let written = std::fs::write(&probe, [0_u8; 4096]);
    // A file that was not created need not be removed.
    let _ = std::fs::remove_file(&probe);
    if let Err(error) = written {
        let advice = "give this user write permission to /dev/shm (mode 1777), or free some of it";
        return Check::new(
            NAME,
            CheckStatus::Problem,
            format!("{found}, but it cannot be written: {error}"),
            advice,
        );
    }
    if free < COMFORTABLE_SHM {
        let advice =
            "enlarge it (mount -o remount,size=2G /dev/shm; docker run --shm-size 2g), or use a small --envs";
        return Check::new(NAME, CheckStatus::Warning, found, advice);
    }
    Check::ok(NAME, found)
}

fn run_folder() -> Check {
    const NAME: &str = "run folder";
    let base = fleet::runtime_folder();
    let path = base.display();
    let Ok(metadata) = std::fs::symlink_metadata(&base) else {
        return Check::ok(NAME, format!("{path}, which the first run creates"));
    };
    let (owner, mode) = (metadata.uid(), metadata.mode() & 0o777);
    if owner != rustix::process::getuid().as_raw() || !metadata.is_dir() {
        let advice = "remove it, or set XDG_RUNTIME_DIR to a folder of your own";
        return Check::new(NAME, CheckStatus::Problem, format!("{path} belongs to user {owner}"), advice);
    }
    if mode & 0o077 != 0 {
        let advice = format!("chmod 700 {path}: other users can interfere with runs");
        return Check::new(NAME, CheckStatus::Warning, format!("{path} has mode {mode:o}"), advice);
    }
    Check::ok(NAME, format!("{path}, mode {mode:o}"))
}

fn left_overs() -> Check {
    const NAME: &str = "left-overs";
    let uid = rustix::process::getuid().as_raw();
    let prefix = format!("hyp_{uid}_");
    let entries = std::fs::read_dir(SHM).into_iter().flatten().flatten();
    let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
    let ours = named.filter_map(|entry| entry.metadata().ok()).filter(|metadata| metadata.uid() == uid);
    let sizes: Vec<u64> = ours.map(|metadata| metadata.len()).collect();
    let runs = std::fs::read_dir(fleet::runtime_folder()).into_iter().flatten().flatten().count();
    if sizes.is_empty() && runs == 0 {
        return Check::ok(NAME, "none");
    }
    let bytes: u64 = sizes.iter().sum();
    let found = format!("{} segments of {runs} runs in /dev/shm, {} MiB", sizes.len(), bytes >> 20);
    let advice = "a run in progress has some; those of crashed runs are removed when the next run starts";
    Check::new(NAME, CheckStatus::Warning, found, advice)
}

fn cpu() -> Check {
    const NAME: &str = "CPU";
    let machine = Machine::detect();
    let renderer = CpuRenderer::with_options(1, CpuOptions::default()).name();
    let features = &machine.vector_extensions;
    let found = format!(
        "{}, {} cores, {}; renderer {renderer}",
        machine.cpu,
        machine.n_cores,
        if features.is_empty() { "no vector extensions".to_owned() } else { features.join(" ") },
    );
    if !features.contains(&"avx2") {
        let advice = "results are the same, but rendering and inference use portable code, which is several times slower";
        return Check::new(NAME, CheckStatus::Warning, found, advice);
    }
    if !machine.is_fast_in_int8() {
        let advice = "act-int8 is about twice as fast as act only with AVX-512 VNNI";
        return Check::new(NAME, CheckStatus::Ok, found, advice);
    }
    Check::ok(NAME, found)
}

/// Runs and renders the reference episode and compares it, bit for bit, with what every machine gives.
fn reference_episode() -> [Check; 2] {
    let (episode, images) = reference_hashes();
    let compare = |name, found: u64, expected: u64| {
        if found == expected {
            return Check::ok(name, format!("{found:016x}, as on every machine"));
        }
        let found = format!("{found:016x}, expected {expected:016x}");
        let advice =
            "results of this build cannot be compared with others'; please report CPU and compiler version";
        Check::new(name, CheckStatus::Problem, found, advice)
    };
    [
        compare("episode fingerprint", episode, EPISODE_FINGERPRINT),
        compare("image checksum", images, IMAGES_HASH),
    ]
}

/// Returns the fingerprint of the reference episode and the hash of the images at its start.
fn reference_hashes() -> (u64, u64) {
    let task = TaskId::RaiseCube;
    let spec = EpisodeSpec {
        task,
        perturbation: Perturbation::None.into(),
        strength: Strength::FULL,
        profile: Profile::Strict,
    };
    let Ok(recording) = Recording::of_expert(spec, episode_seed(0, task.name(), 0), ControlMode::JointPos)
    else {
        return (0, 0);
    };
    let mut renderer = CpuRenderer::with_options(1, CpuOptions::default());
    let mut hash = Xxh3Default::new();
    let scene = RenderScene::new(recording.scene(), ImageSizes::BENCHMARK);
    for (_, image) in renderer.render_cameras(&scene, recording.snapshot(0)) {
        hash.update(&image);
    }
    (recording.fingerprint(), hash.digest())
}

fn vulkan() -> Check {
    const NAME: &str = "Vulkan";
    match sim::render::open(RendererChoice::Gpu, None, Samples::One, ImageSizes::BENCHMARK, 1) {
        Ok(renderer) => Check::ok(NAME, renderer.name()),
        Err(OpenRendererError::NotBuilt) => {
            Check::ok(NAME, "this program was built without the GPU renderer; runs render on the CPU")
        }
        Err(error) => {
            let advice =
                "runs render on the CPU; for a GPU install its Vulkan driver (vulkaninfo must list it)";
            Check::new(NAME, CheckStatus::Warning, run_config::error_chain(&error), advice)
        }
    }
}

/// Lists the adapters on which policies can compute.
#[cfg(feature = "gpu")]
fn adapters() -> Vec<Check> {
    let adapters = policy_host::nn::gpu::adapters();
    adapters.into_iter().map(|adapter| Check::ok("adapter", adapter.to_string())).collect()
}

#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<Check> {
    Vec::new()
}

fn python(program: &str) -> Check {
    const NAME: &str = "Python";
    const SCRIPT: &str = "import sys, importlib.metadata as m\n\
        def v(name):\n    try: return name + ' ' + m.version(name)\n    except m.PackageNotFoundError: return ''\n\
        print('Python ' + sys.version.split()[0], *filter(None, map(v, ('hypogeum', 'numpy', 'torch', 'lerobot'))), sep=', ')";
    let output = Command::new(program).args(["-c", SCRIPT]).stdin(Stdio::null()).output();
    let found = match output {
        Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout).trim().to_owned(),
        Ok(output) => format!("{program} failed: {}", String::from_utf8_lossy(&output.stderr).trim()),
        Err(error) => format!("{program} cannot be started: {error}"),
    };
    let version = format!("hypogeum {}", build_identity::VERSION);
    if found.contains(&version) {
        return Check::ok(NAME, found);
    }
    let advice = if found.contains("hypogeum ") {
        "the Python package has another version than this program: pip install ./python"
    } else {
        "only needed for policies in Python: pip install ./python"
    };
    Check::new(NAME, CheckStatus::Warning, found, advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_hashes_are_current() {
        let found = reference_hashes();
        assert_eq!(
            found,
            (EPISODE_FINGERPRINT, IMAGES_HASH),
            "if images or physics changed on purpose, update the constants to {found:#x?}"
        );
    }
}
