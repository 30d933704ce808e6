//! Tests of the generated scripts, definitions and manifests.

use std::ffi::OsString;

use serde_json::{Map, Value, json};

use super::EngineArgs;
use super::sharded_sweep::{EngineDefaults, ShardedSweep, line};
use super::ssh::{Remote, SshHost, inputs};
use super::template::Template;
use super::tool::ToolOptions;
use super::{hyperqueue, kubernetes, slurm};
use crate::cli::{Cli, Command};
use crate::console::exit::Failure;

/// Returns what `hypogeum submit ENGINE SWEEP.toml ARGUMENTS` would submit, or its error.
fn generated(engine: &str, arguments: &str) -> Result<String, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my sweep.toml");
    std::fs::write(&path, "policies = [\"idle\"]\ntasks = [\"RaiseCube\"]\nepisodes = 4\ndb = \"out.db\"\n")
        .unwrap();
    let here = std::env::current_dir().unwrap().display().to_string();
    let shown =
        |text: String| text.replace(&path.display().to_string(), "my sweep.toml").replace(&here, "/shared");
    let words = ["hypogeum", "submit", engine, path.to_str().unwrap(), "--program", "hypogeum"];
    let words = words.map(str::to_owned).into_iter().chain(shlex::split(arguments).unwrap());
    let parsed = Cli::parse_with_sweep_file(&words.map(OsString::from).collect::<Vec<_>>());
    let parsed =
        parsed.map_err(|error| shown(error.to_string().lines().next().unwrap_or_default().to_owned()))?;
    let Command::Submit(args) = parsed.command else { panic!("the command is `submit`") };
    let fill = || -> Result<String, Failure> {
        let resolve = |args, defaults| ShardedSweep::resolve(args, defaults, &Cli::parse_run);
        match &args.engine {
            EngineArgs::Slurm(args) => {
                let scripts = slurm::scripts(args, &resolve(&args.sharding, EngineDefaults::default())?)?;
                Ok(scripts.array + "----\n" + &scripts.merge)
            }
            EngineArgs::Hyperqueue(args) => {
                hyperqueue::definition(args, &resolve(&args.sharding, EngineDefaults::default())?)
            }
            EngineArgs::Kubernetes(args) => {
                kubernetes::manifest(args, &resolve(&args.sharding, kubernetes::IN_POD)?)
            }
            EngineArgs::Ssh(_) => panic!("it has no text"),
        }
    };
    fill().map(shown).map_err(|error| shown(error.to_string()))
}

#[test]
fn slurm_scripts_run_and_merge() {
    let arguments = "--shards 3 --audit 1% --scratch '/local disk' --sbatch '-p long --cpus-per-task=8' \
        --sbatch=--time=1:00:00 -- --seed 7";
    insta::assert_snapshot!(generated("slurm", arguments).unwrap(), @r#"
    #!/bin/bash
    #SBATCH --job-name=my-sweep
    #SBATCH --array=0-2
    #SBATCH --output=/shared/out.shards/shard-%1a-of-3.log
    #SBATCH --requeue
    #SBATCH --signal=B:USR1@120
    #SBATCH --open-mode=append
    #SBATCH -p long --cpus-per-task=8
    #SBATCH --time=1:00:00

    cd -- /shared || exit 2

    # A task runs one shard and may be preempted or killed at any time: the next one continues from the shard's file.
    hypogeum run 'my sweep.toml' --seed 7 --audit 0.01 --scratch '/local disk' --shard auto/3 &
    program=$!
    out_of_time=
    # Preemption and scancel. A task that is cancelled must not be requeued.
    trap 'kill -TERM "$program" 2>/dev/null' TERM INT
    # Two minutes before the time limit.
    trap 'out_of_time=yes; kill -TERM "$program" 2>/dev/null' USR1
    # A signal also ends `wait`.
    while kill -0 "$program" 2>/dev/null; do wait "$program"; done
    wait "$program"
    status=$?
    if [ "$out_of_time" ] && [ "$status" -eq 130 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt 100 ]; then
        scontrol requeue "$SLURM_JOB_ID"
    fi
    exit "$status"
    ----
    #!/bin/bash
    #SBATCH --job-name=my-sweep-merge
    #SBATCH --output=/shared/out.shards/merge.log
    #SBATCH --open-mode=append
    #SBATCH -p long --cpus-per-task=8
    #SBATCH --time=1:00:00

    cd -- /shared || exit 2
    exec hypogeum merge out.db out.shards
    "#);
}

#[test]
fn hyperqueue_definition_has_dependent_merge() {
    let definition = generated("hyperqueue", "--shards 2 --cpus 4").unwrap();
    let parsed: toml::Table = toml::from_str(&definition).unwrap();
    assert_eq!(parsed["task"].as_array().unwrap().len(), 3);
    insta::assert_snapshot!(definition, @r#"
    name = "my-sweep"

    [[task]]
    id = 0
    # Exit code 1 means that some episodes could not be run, which the merge reports.
    command = ["sh", "-c", "exec >> out.shards/shard-0-of-2.log 2>&1; hypogeum run 'my sweep.toml' --shard auto/2; code=$?; [ $code -eq 1 ] || exit $code"]
    cwd = "/shared"
    stdout = "none"
    stderr = "none"
    # The shard takes as many threads as it has cores.
    pin = "taskset"
    # Lost workers: each task continues from the shard's file.
    crash_limit = 20
    [[task.request]]
    resources = { "cpus" = 4 }

    [[task]]
    id = 1
    # Exit code 1 means that some episodes could not be run, which the merge reports.
    command = ["sh", "-c", "exec >> out.shards/shard-1-of-2.log 2>&1; hypogeum run 'my sweep.toml' --shard auto/2; code=$?; [ $code -eq 1 ] || exit $code"]
    cwd = "/shared"
    stdout = "none"
    stderr = "none"
    # The shard takes as many threads as it has cores.
    pin = "taskset"
    # Lost workers: each task continues from the shard's file.
    crash_limit = 20
    [[task.request]]
    resources = { "cpus" = 4 }

    [[task]]
    id = 2
    command = ["sh", "-c", "exec >> out.shards/merge.log 2>&1; exec hypogeum merge out.db out.shards"]
    cwd = "/shared"
    stdout = "none"
    stderr = "none"
    deps = [0, 1]
    "#);
}

/// Returns a manifest in three parts: the Job of the shards, the template of its pods, and the merge.
fn manifest() -> [String; 3] {
    let arguments = "--shards 4 --image lab/hypogeum:1 --claim shared --cpus 8 --memory 16Gi";
    let manifest = generated("kubernetes", arguments).unwrap();
    let (job, rest) = manifest.split_once("    template:\n").unwrap();
    let (pod, merge) = rest.split_once("- apiVersion").unwrap();
    [job, pod, merge].map(str::to_owned)
}

#[test]
fn kubernetes_job_survives_evictions() {
    insta::assert_snapshot!(manifest()[0], @r#"
    apiVersion: v1
    kind: List
    items:
    - apiVersion: batch/v1
      kind: Job
      metadata:
        name: "hypogeum-my-sweep"
      spec:
        completionMode: Indexed
        completions: 4
        parallelism: 4
        backoffLimitPerIndex: 6
        podFailurePolicy:
          rules:
          # Evicted and preempted pods continue from the shard's file and count as no failure.
          - action: Ignore
            onPodConditions:
            - type: DisruptionTarget
              status: "True"
          # The program ended in order after SIGTERM.
          - action: Ignore
            onExitCodes:
              containerName: shard
              operator: In
              values: [130]
          # Some episodes could not be run, or something is wrong that another attempt does not change.
          - action: FailIndex
            onExitCodes:
              containerName: shard
              operator: In
              values: [1, 2]
    "#);
}

#[test]
fn kubernetes_pod_has_shared_memory() {
    insta::assert_snapshot!(manifest()[1], @r#"
    spec:
      restartPolicy: Never
      terminationGracePeriodSeconds: 120
      containers:
      - name: shard
        image: "lab/hypogeum:1"
        # Without a shell, so that SIGTERM arrives.
        command: ["hypogeum", "run", "my sweep.toml", "--scratch", "/scratch", "--shard", "auto/4"]
        workingDir: "/shared"
        resources:
          requests:
            cpu: "8"
            memory: "16Gi"
          limits:
            cpu: "8"
            memory: "16Gi"
        volumeMounts:
        - name: sweep
          mountPath: "/shared"
        - name: scratch
          mountPath: "/scratch"
        - name: shared-memory
          mountPath: /dev/shm
      volumes:
      - name: sweep
        persistentVolumeClaim:
          claimName: "shared"
      - name: scratch
        emptyDir: {}
      # Images and actions travel through shared memory, of which a container has 64 MiB otherwise.
      - name: shared-memory
        emptyDir:
          medium: Memory
    "#);
}

#[test]
fn kubernetes_merge_waits_for_all_shards() {
    insta::assert_snapshot!(manifest()[2], @r#"
    : batch/v1
      kind: Job
      metadata:
        name: "hypogeum-my-sweep-merge"
      spec:
        backoffLimit: 6
        podFailurePolicy:
          rules:
          - action: Ignore
            onPodConditions:
            - type: DisruptionTarget
              status: "True"
        template:
          spec:
            restartPolicy: Never
            containers:
            - name: merge
              image: "lab/hypogeum:1"
              command: ["sh", "-c", "hypogeum status out.shards --watch && exec hypogeum merge out.db out.shards"]
              workingDir: "/shared"
              volumeMounts:
              - name: sweep
                mountPath: "/shared"
            volumes:
            - name: sweep
              persistentVolumeClaim:
                claimName: "shared"
    "#);
}

#[test]
fn kubernetes_pods_work_in_the_mount() {
    let elsewhere = generated("kubernetes", "--shards 4 --image i --claim c --mount /data").unwrap();
    assert!(elsewhere.contains("workingDir: \"/data\"") && !elsewhere.contains("resources"), "{elsewhere}");
}

#[test]
fn ssh_tasks_run_in_mirrored_folder() {
    let ssh = ["ssh", "-p", "22"].map(str::to_owned);
    let remote = Remote { host: "me@c", ssh: &ssh, root: "my sweep", folder: "out.shards" };
    let words = remote.task_words(&["run".to_owned(), "a b.toml".to_owned()]).unwrap();
    insta::assert_snapshot!(line(&words).map_err(|error| error.to_string()).unwrap(), @r#"ssh -p 22 me@c "cd 'my sweep'/files && exec ../bin/hypogeum run 'a b.toml' --end-with-stdin""#);
}

#[test]
fn wrong_arguments_give_one_sentence() {
    let wrong = |engine, arguments| generated(engine, arguments).unwrap_err();
    insta::assert_snapshot!(wrong("slurm", ""), @"name the sweep file and the number of shards: SWEEP.toml --shards N");
    insta::assert_snapshot!(wrong("slurm", "--shards 5"), @"there are 5 shards, but only 4 episodes");
    insta::assert_snapshot!(wrong("slurm", "--shards 0"), @"error: invalid value '0' for '--shards <N>': 0 is not in 1..=10000");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 --audit 101%"), @"error: invalid value '101%' for '--audit <SHARE>': expected a share above 0 and up to 1, for example 1% or 0.01");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 --sbatch \"-p 'long\""), @"error: invalid value '-p 'long' for '--sbatch <OPTIONS>': expected options on one line, with all quotes closed");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 -- --shard 0/2"), @"--shard is what `submit` tells the shards: name --shards, --audit, --costs, --scratch before `--`");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 -- --costs=a.db"), @"--costs=a.db is what `submit` tells the shards: name --shards, --audit, --costs, --scratch before `--`");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 -- --tasks RiseCube"), @"options of `run`: invalid value 'RiseCube' for '--tasks <LIST>': unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 -- --help"), @"options of `run`: help and version are not for shards");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 -- --policy act:absent"), @"policy `act`: checkpoint absent does not exist");
    insta::assert_snapshot!(wrong("slurm", "--shards 2 --template absent.sh"), @"failed to read the template absent.sh: No such file or directory (os error 2)");
    insta::assert_snapshot!(wrong("kubernetes", "--shards 2"), @"name the container image and the claim: --image IMAGE --claim PVC");
    insta::assert_snapshot!(wrong("kubernetes", "--shards 2 --image i --claim c --mount data"), @"--mount is data, expected an absolute path without a colon");
    insta::assert_snapshot!(wrong("ssh", "--shards 2 --hosts a,-oProxyCommand=x"), @"error: invalid value '-oProxyCommand=x' for '--hosts <HOST[:N],…>': expected HOST, USER@HOST or HOST:N");
    insta::assert_snapshot!(wrong("ssh", "--shards 2 --hosts a:0"), @"error: invalid value 'a:0' for '--hosts <HOST[:N],…>': expected 1 to 1024 shards after the colon");
}

#[test]
fn template_errors_name_file_and_line() {
    let Value::Object(variables) = json!({ "name": "it's", "shards": 2 }) else { panic!("it is an object") };
    let fill = |text: &str, variables: &Map<String, Value>| {
        let template = Template { name: "my.sh".to_owned(), text: text.to_owned() };
        template.fill(variables).map_err(|error| error.to_string())
    };
    let fill = |text| fill(text, &variables);
    assert_eq!(fill("{{ name | shell }} {{ name | json }}\n"), Ok("\"it's\" \"it's\"\n".to_owned()));
    insta::assert_snapshot!(fill("a\n{{ shard }}\n").unwrap_err(), @"the template my.sh, line 2: a variable that is not defined; there are name, shards");
    insta::assert_snapshot!(fill("a\n{% if name %}\n").unwrap_err(), @"the template my.sh, line 2: syntax error: unexpected end of input, expected end of block");
    insta::assert_snapshot!(fill("{{ name | quote }}\n").unwrap_err(), @"the template my.sh, line 1: unknown filter: filter quote is unknown");
}

#[test]
fn paths_outside_the_folder_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sweep.toml");
    std::fs::write(&path, "policies = [\"idle\"]\nepisodes = 4\n").unwrap();
    let words = ["hypogeum", "submit", "ssh", path.to_str().unwrap(), "--shards=2", "--hosts=a"];
    let parsed = Cli::parse_with_sweep_file(&words.map(OsString::from)).unwrap();
    let Command::Submit(args) = parsed.command else { panic!("the command is `submit`") };
    let EngineArgs::Ssh(args) = &args.engine else { panic!("the engine is ssh") };
    let resolved = ShardedSweep::resolve(&args.sharding, EngineDefaults::default(), &Cli::parse_run);
    let sweep = resolved.map_err(|error| error.to_string()).unwrap();
    let inputs = |file| inputs(&sweep, Some(file)).map_err(|error| error.to_string());
    assert_eq!(inputs("./a/./sweep.toml"), Ok(vec!["a/sweep.toml".to_owned()]));
    insta::assert_snapshot!(inputs("../sweep.toml").unwrap_err(), @"the sweep file: ../sweep.toml is not below the current folder, which the machines mirror: copy or link it there and name it by a relative path");
    insta::assert_snapshot!(inputs("~/sweep.toml").unwrap_err(), @"the sweep file: ~/sweep.toml is not below the current folder, which the machines mirror: copy or link it there and name it by a relative path");
    insta::assert_snapshot!(inputs("/sweep.toml").unwrap_err(), @"the sweep file: /sweep.toml is not below the current folder, which the machines mirror: copy or link it there and name it by a relative path");
}

#[test]
fn typed_values_are_parsed_at_the_edge() {
    let options: ToolOptions = "-p 'a b'".parse().unwrap();
    assert_eq!(ToolOptions::words(&[options]), ["-p", "a b"]);
    let host = |typed: &str| typed.parse::<SshHost>().map(|host| (host.name, host.n_tasks));
    assert_eq!(host("me@c.lab:12"), Ok(("me@c.lab".to_owned(), 12)));
    assert_eq!(host("a"), Ok(("a".to_owned(), 1)));
}
