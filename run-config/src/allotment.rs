//! Cores and memory that this process may use: what remains within all limits in force.

use std::path::{Component, Path, PathBuf};

use rustix::thread::sched_getaffinity;

/// Limits above this are none, in bytes: version 1 of control groups has no word for it.
const UNLIMITED: u64 = 1 << 60;
/// The folder below which the kernel shows its files.
const ROOT: &str = "/";

/// A bound of a resource.
#[derive(Clone, Debug, PartialEq)]
pub struct ResourceBound<T> {
    /// All that it allows.
    pub limit: T,
    /// Rest of that.
    pub remaining: T,
    /// Its origin: a mask, a file of a control group, or a variable of the batch system.
    pub source: String,
}

/// Returns the number of cores this process may use. A quota of a part of a core counts as a whole one,
/// because a thread less could not use it.
#[must_use]
pub fn n_cores() -> u32 {
    let cores = core_bounds().into_iter().map(|bound| bound.remaining).fold(f64::INFINITY, f64::min);
    if cores.is_finite() { cores.ceil().max(1.0) as u32 } else { 1 }
}

/// Returns all bounds on the cores: the affinity mask, the quota of every control group of this process, and
/// the batch system's.
#[must_use]
pub fn core_bounds() -> Vec<ResourceBound<f64>> {
    let mask = sched_getaffinity(None).ok().map(|mask| f64::from(mask.count()));
    // The mask has room for 1024 cores. Of more, the standard library can tell.
    let n_cores = mask.or_else(|| Some(std::thread::available_parallelism().ok()?.get() as f64));
    let mask = n_cores.map(|limit| ResourceBound::new(limit, limit, "the affinity mask"));
    mask.into_iter().chain(quotas(Path::new(ROOT))).chain(batch_cores(&variable)).collect()
}

/// Returns the core-seconds since the start of the machine in which cores of the affinity mask were idle;
/// `None` if the system does not count them.
#[must_use]
pub fn idle_core_s() -> Option<f64> {
    let mask = sched_getaffinity(None).ok()?;
    let ticks = idle_ticks(&read(Path::new("/proc/stat"))?, |core| mask.is_set(core))?;
    Some(ticks as f64 / rustix::param::clock_ticks_per_second() as f64)
}

/// Sums the idle ticks of some cores in the kernel's statistics, those of waiting for disks included.
fn idle_ticks(statistics: &str, is_counted: impl Fn(usize) -> bool) -> Option<u64> {
    let by_core = statistics.lines().filter_map(|line| {
        let mut words = line.strip_prefix("cpu")?.split(' ');
        let core: usize = words.next()?.parse().ok()?;
        let times: Vec<u64> = words.map_while(|word| word.parse().ok()).collect();
        is_counted(core).then(|| times.get(3..5).map(|idle| idle.iter().sum::<u64>()))
    });
    // Sandboxes show a file of zeros.
    by_core.sum::<Option<u64>>().filter(|ticks| *ticks > 0)
}

/// Returns the memory that this process may still use, in bytes; `None` if the system tells nothing.
#[must_use]
pub fn available_memory() -> Option<u64> {
    memory_bounds().into_iter().map(|bound| bound.remaining).min()
}

/// Returns all bounds on the memory in bytes: what the kernel estimates to be available without swapping, the
/// limit of every control group of this process minus its usage, and the batch system's.
#[must_use]
pub fn memory_bounds() -> Vec<ResourceBound<u64>> {
    let groups = memory_limits(Path::new(ROOT));
    free_memory(Path::new(ROOT)).into_iter().chain(groups).chain(slurm_memory(&variable)).collect()
}

/// Returns how many processes of this process's control group, or of the machine where that does not count
/// them, the kernel has killed for lack of memory.
#[must_use]
pub fn oom_kills() -> u64 {
    let folder = group_folders(Path::new(ROOT), "memory").into_iter().next().unwrap_or_default();
    let counted =
        ["memory.events", "memory.oom_control"].map(|file| value_in(&folder.join(file), "oom_kill"));
    let [v2, v1] = counted;
    v2.or(v1).or_else(|| value_in(Path::new("/proc/vmstat"), "oom_kill")).unwrap_or(0)
}

impl<T> ResourceBound<T> {
    fn new(limit: T, remaining: T, source: impl Into<String>) -> Self {
        Self { limit, remaining, source: source.into() }
    }
}

/// Returns a variable of the environment.
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

/// Returns the cores that a batch system gives to a task: Slurm (or to its job on this node), Grid Engine,
/// LSF, PBS, or HyperQueue, which names each core. `variable` reads the environment.
fn batch_cores(variable: &dyn Fn(&str) -> Option<String>) -> Option<ResourceBound<f64>> {
    // `NCPUS` alone may be anybody's.
    let is_pbs = variable("PBS_JOBID").is_some();
    let names =
        ["SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE", "NSLOTS", "LSB_DJOB_NUMPROC", "NCPUS", "HQ_CPUS"];
    names.into_iter().filter(|name| is_pbs || *name != "NCPUS").find_map(|name| {
        let text = variable(name)?;
        let count = if name == "HQ_CPUS" { text.split(',').count() as f64 } else { text.parse().ok()? };
        (count > 0.0).then(|| ResourceBound::new(count, count, name))
    })
}

/// Returns the memory of a Slurm job on this node, which Slurm states in MiB; 0 is all of it.
fn slurm_memory(variable: &dyn Fn(&str) -> Option<String>) -> Option<ResourceBound<u64>> {
    let mebibytes = |name| variable(name)?.parse::<u64>().ok().filter(|count| *count > 0);
    let per_core = || {
        let cores = variable("SLURM_CPUS_ON_NODE").and_then(|count| count.parse().ok()).unwrap_or(1);
        Some((mebibytes("SLURM_MEM_PER_CPU")?.saturating_mul(cores), "SLURM_MEM_PER_CPU"))
    };
    let per_node = mebibytes("SLURM_MEM_PER_NODE").map(|count| (count, "SLURM_MEM_PER_NODE"));
    let (count, name) = per_node.or_else(per_core)?;
    let bytes = count.saturating_mul(1 << 20);
    Some(ResourceBound::new(bytes, bytes, name))
}

fn free_memory(root: &Path) -> Option<ResourceBound<u64>> {
    let kibibytes = |key| value_in(&root.join("proc/meminfo"), key);
    let (total, available) = (kibibytes("MemTotal:")?, kibibytes("MemAvailable:")?);
    Some(ResourceBound::new(total << 10, available << 10, "the memory of the machine"))
}

/// Returns the limits of all control groups, and what remains of them. What the page cache can drop counts as
/// free.
fn memory_limits(root: &Path) -> Vec<ResourceBound<u64>> {
    let bounds = |folder: PathBuf| {
        let dropped = |names: [&str; 2]| {
            names.iter().filter_map(|name| value_in(&folder.join("memory.stat"), name)).sum::<u64>()
        };
        let v2 = dropped(["inactive_file", "active_file"]);
        let v1 = dropped(["total_inactive_file", "total_active_file"]);
        [
            ("memory.max", "memory.current", v2),
            ("memory.high", "memory.current", v2),
            ("memory.limit_in_bytes", "memory.usage_in_bytes", v1),
        ]
        .into_iter()
        .filter_map(|(limit, usage, dropped)| {
            let path = folder.join(limit);
            let limit: u64 = read(&path)?.trim().parse().ok()?;
            let usage: u64 = read(&folder.join(usage))?.trim().parse().ok()?;
            let remaining = limit.saturating_sub(usage.saturating_sub(dropped));
            (limit < UNLIMITED).then(|| ResourceBound::new(limit, remaining, path.display().to_string()))
        })
        .collect::<Vec<_>>()
    };
    group_folders(root, "memory").into_iter().flat_map(bounds).collect()
}

/// Returns the quotas of all control groups, in cores.
fn quotas(root: &Path) -> Vec<ResourceBound<f64>> {
    let quota = |folder: PathBuf| {
        let v2 = || {
            let path = folder.join("cpu.max");
            let text = read(&path)?;
            let (quota, period) = text.trim().split_once(' ')?;
            Some((quota.parse::<f64>().ok()?, period.parse::<f64>().ok()?, path))
        };
        let v1 = || {
            let path = folder.join("cpu.cfs_quota_us");
            let number = |path: &Path| read(path)?.trim().parse::<f64>().ok();
            Some((number(&path)?, number(&folder.join("cpu.cfs_period_us"))?, path))
        };
        let (quota, period, path) = v2().or_else(v1)?;
        // Without a quota, version 1 has -1.
        let is_quota = quota > 0.0 && period > 0.0;
        is_quota.then(|| ResourceBound::new(quota / period, quota / period, path.display().to_string()))
    };
    group_folders(root, "cpu").into_iter().filter_map(quota).collect()
}

/// Returns the folders of the control groups that hold this process for a controller, the innermost first, up
/// to where they are mounted (cgroups(7)).
fn group_folders(root: &Path, controller: &str) -> Vec<PathBuf> {
    let groups = read(&root.join("proc/self/cgroup")).unwrap_or_default();
    let mounts = read(&root.join("proc/self/mountinfo")).unwrap_or_default();
    let has = |list: &str| list.split(',').any(|word| word == controller);
    let mut folders = Vec::new();
    for group in groups.lines() {
        let mut fields = group.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else { continue };
        if !(controllers.is_empty() || has(controllers)) {
            continue;
        }
        let mount = mounts.lines().find_map(|line| {
            let (place, kind) = line.split_once(" - ")?;
            let (mut place, mut kind) = (place.split(' ').skip(3), kind.split(' '));
            let (top, point) = (place.next()?, place.next()?);
            let fits = match kind.next()? {
                "cgroup2" => controllers.is_empty(),
                "cgroup" => !controllers.is_empty() && has(kind.nth(1)?),
                _ => false,
            };
            fits.then_some((top, point))
        });
        let Some((top, point)) = mount else { continue };
        // A group outside what is mounted, as in some containers, shows itself only by its mount point.
        let below = Path::new(path).strip_prefix(top).unwrap_or(Path::new(""));
        let is_below = below.components().all(|part| matches!(part, Component::Normal(_)));
        let point = root.join(point.trim_start_matches('/'));
        let innermost = if is_below { point.join(below) } else { point.clone() };
        folders
            .extend(innermost.ancestors().take_while(|folder| folder.starts_with(&point)).map(PathBuf::from));
    }
    folders
}

/// Returns the number behind a word at the start of a line.
fn value_in(path: &Path, word: &str) -> Option<u64> {
    let text = read(path)?;
    text.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        (words.next()? == word).then(|| words.next()?.parse().ok()).flatten()
    })
}

fn read(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes the files of a machine below a temporary folder.
    fn machine(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        root
    }

    fn remaining<T: Copy>(bounds: &[ResourceBound<T>]) -> Vec<T> {
        bounds.iter().map(|bound| bound.remaining).collect()
    }

    #[test]
    fn every_group_above_counts_in_version_2() {
        let root = machine(&[
            ("proc/self/cgroup", "0::/user.slice/job\n"),
            ("proc/self/mountinfo", "30 23 0:26 / /sys/fs/cgroup rw - cgroup2 cgroup2 rw,nsdelegate\n"),
            ("sys/fs/cgroup/user.slice/job/memory.max", "max\n"),
            ("sys/fs/cgroup/user.slice/job/memory.high", "94371840\n"),
            ("sys/fs/cgroup/user.slice/job/memory.current", "10485760\n"),
            ("sys/fs/cgroup/user.slice/job/memory.stat", "anon 1\ninactive_file 1048576\nactive_file 0\n"),
            ("sys/fs/cgroup/user.slice/job/cpu.max", "150000 100000\n"),
            ("sys/fs/cgroup/user.slice/memory.max", "209715200\n"),
            ("sys/fs/cgroup/user.slice/memory.current", "4096\n"),
            ("sys/fs/cgroup/user.slice/cpu.max", "max 100000\n"),
        ]);
        let memory = memory_limits(root.path());
        assert_eq!(remaining(&memory), [(90 - 9) << 20, (200 << 20) - 4096]);
        assert!(memory[0].source.ends_with("user.slice/job/memory.high"), "{}", memory[0].source);
        assert_eq!(remaining(&quotas(root.path())), [1.5]);
    }

    #[test]
    fn controllers_of_version_1_have_their_own_mounts() {
        let root = machine(&[
            ("proc/self/cgroup", "5:cpu,cpuacct:/job\n4:memory:/job\n0::/\n"),
            (
                "proc/self/mountinfo",
                "31 23 0:28 / /sys/fs/cgroup rw - tmpfs tmpfs rw\n32 31 0:29 / /sys/fs/cgroup/cpu rw - cgroup cgroup \
                 rw,cpu,cpuacct\n33 31 0:30 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n",
            ),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "0\n"),
            ("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "94371840\n"),
            ("sys/fs/cgroup/memory/job/memory.usage_in_bytes", "199999999\n"),
            ("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n"),
            ("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n"),
            ("sys/fs/cgroup/cpu/job/cpu.cfs_quota_us", "50000\n"),
            ("sys/fs/cgroup/cpu/job/cpu.cfs_period_us", "100000\n"),
        ]);
        assert_eq!(remaining(&memory_limits(root.path())), [0]);
        assert_eq!(remaining(&quotas(root.path())), [0.5]);
    }

    #[test]
    fn idle_time_counts_for_own_cores() {
        let file = "cpu  9 0 9 60 6 0 0 0 0 0\ncpu0 1 0 1 10 1 0 0 0 0 0\ncpu1 1 0 1 20 2 0 0 0 0 0\ncpu10 7 0 7 30 3 0 0 0 0 0\n\
                    intr 5 4 3\n";
        assert_eq!(idle_ticks(file, |core| core != 1), Some(10 + 1 + 30 + 3));
        assert_eq!(idle_ticks("cpu  0 0 0 0 0\ncpu0 0 0 0 0 0\n", |_| true), None);
        assert_eq!(idle_ticks("cpu0 1 2\n", |_| true), None);
    }

    #[test]
    fn container_sees_its_group_at_the_mount_point() {
        for (group, top) in [("0::/../outside\n", "/"), ("0::/docker/abc\n", "/docker/abc")] {
            let mount = format!("30 23 0:26 {top} /sys/fs/cgroup rw - cgroup2 cgroup rw\n");
            let root = machine(&[
                ("proc/self/cgroup", group),
                ("proc/self/mountinfo", &mount),
                ("sys/fs/cgroup/memory.max", "1048576\n"),
                ("sys/fs/cgroup/memory.current", "0\n"),
            ]);
            assert_eq!(remaining(&memory_limits(root.path())), [1 << 20], "{group}");
        }
    }

    #[test]
    fn batch_system_counts_cores_and_memory() {
        let of = |variables: &'static [(&str, &str)]| {
            let read = move |name: &str| {
                variables.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
            };
            let bytes = slurm_memory(&read).map(|bound| bound.limit >> 20);
            (batch_cores(&read).map(|bound| bound.limit), bytes)
        };
        assert_eq!(of(&[]), (None, None));
        assert_eq!(of(&[("SLURM_CPUS_PER_TASK", "3"), ("SLURM_CPUS_ON_NODE", "8")]), (Some(3.0), None));
        assert_eq!(of(&[("SLURM_CPUS_ON_NODE", "8"), ("SLURM_MEM_PER_CPU", "500")]), (Some(8.0), Some(4000)));
        assert_eq!(of(&[("SLURM_MEM_PER_NODE", "0"), ("SLURM_CPUS_PER_TASK", "x")]), (None, None));
        assert_eq!(of(&[("HQ_CPUS", "0,2,5")]), (Some(3.0), None));
        assert_eq!(of(&[("NSLOTS", "4")]), (Some(4.0), None));
        assert_eq!(of(&[("NCPUS", "4")]), (None, None));
        assert_eq!(of(&[("PBS_JOBID", "1.host"), ("NCPUS", "4")]), (Some(4.0), None));
    }

    #[test]
    fn a_machine_that_tells_nothing_has_no_bounds() {
        let root = machine(&[("proc/meminfo", "MemTotal: 5 kB\nMemAvailable:    4 kB\n")]);
        assert_eq!(free_memory(root.path()).map(|bound| bound.remaining), Some(4096));
        assert!(memory_limits(root.path()).is_empty() && quotas(root.path()).is_empty());
        assert!(n_cores() >= 1 && f64::from(n_cores()) >= core_bounds()[0].remaining.min(1.0));
    }
}
