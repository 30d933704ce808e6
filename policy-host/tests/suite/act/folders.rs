//! Paths that a user may name as a checkpoint: folders, training runs, and others that are recognised.

use std::path::Path;

use ipc_types::Morphology;
use policy_host::formats::resolve;
use policy_host::models::act::checkpoint::ActCheckpoint;
use safetensors::SafeTensors;

use crate::data;

/// Copies the files of a folder.
fn copy_files(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

#[test]
fn training_run_resolves_to_its_last_checkpoint() {
    let base = tempfile::tempdir().unwrap();
    let run = base.path().canonicalize().unwrap().join("outputs");
    let steps = ["000900", "001000"].map(|step| run.join("checkpoints").join(step).join("pretrained_model"));
    steps.iter().for_each(|folder| copy_files(&data("lerobot/robot"), folder));
    for typed in [run.clone(), run.join("checkpoints"), run.join("checkpoints/001000"), steps[1].clone()] {
        assert_eq!(resolve(&typed).unwrap(), steps[1], "{}", typed.display());
    }
    // LeRobot's link wins over the numbers, and moving it later changes nothing.
    let last = run.join("checkpoints/last");
    std::os::unix::fs::symlink("000900", &last).unwrap();
    for typed in [run.clone(), last] {
        assert_eq!(resolve(&typed).unwrap(), steps[0], "{}", typed.display());
    }
}

#[test]
fn other_kinds_of_checkpoints_name_the_next_step() {
    let base = tempfile::tempdir().unwrap();
    let error = |files: &[&str]| {
        let folder = tempfile::tempdir_in(base.path()).unwrap();
        for file in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "{}").unwrap();
        }
        resolve(folder.path()).unwrap_err().to_string()
    };
    let file = base.path().join("best.pt");
    std::fs::write(&file, "").unwrap();
    let of_path = |path: &Path| resolve(path).unwrap_err().to_string();
    for (error, part) in [
        (error(&["config.json", "adapter_config.json"]), "merge_and_unload"),
        (error(&["params/_METADATA"]), "convert_jax_model_to_pytorch.py"),
        (error(&["pytorch_model.bin", "config.json"]), "save_pretrained"),
        (of_path(&file), "convert_act_checkpoint.py"),
        (of_path(Path::new("somebody/act-aloha")), "hf download somebody/act-aloha --local-dir act-aloha"),
        (of_path(&base.path().join("absent")), "does not exist"),
    ] {
        assert!(error.contains(part) && error.lines().count() == 1, "{error} lacks {part}");
    }
}

#[test]
fn names_of_wrapped_networks_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    copy_files(&data("act-tiny/single"), folder.path());
    let path = folder.path().join("model.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let wrapped = tensors.iter().map(|(name, tensor)| (format!("module._orig_mod.{name}"), tensor));
    std::fs::write(&path, safetensors::serialize(wrapped, None).unwrap()).unwrap();
    let mut checkpoint = ActCheckpoint::open(folder.path()).unwrap();
    assert_eq!(checkpoint.mapping().unwrap().morphology, Morphology::Single);
    let plain = ActCheckpoint::open(&data("act-tiny/single")).unwrap().state_dict().unwrap();
    assert!(checkpoint.state_dict().unwrap() == plain);
}
