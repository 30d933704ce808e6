//! VariantFile of LeRobot checkpoints, one for each setting and value that matters: every one is honoured, so
//! that the actions are those that LeRobot executed when `python/make_variants.py` recorded them, or refused
//! by an error that names it, or announced in a note.

mod edits;
mod episode;
mod page;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use safetensors::SafeTensors;
use serde::Deserialize;
use serde_json::Value;

use self::edits::CheckpointEdit;
use self::episode::{VariantEpisode, run};
use crate::data;

/// Maximum absolute difference of an action entry.
const TOLERANCE: f32 = 1e-5;

/// Contents of `variants.json`.
#[derive(Debug, Deserialize)]
struct VariantFile {
    lerobot: String,
    bases: BTreeMap<String, BaseCheckpoint>,
    variants: Vec<CheckpointVariant>,
}

/// A checkpoint that variants change.
#[derive(Debug, Deserialize)]
struct BaseCheckpoint {
    folder: String,
    edits: Vec<CheckpointEdit>,
}

#[derive(Clone, Debug, Deserialize)]
struct CheckpointVariant {
    base: String,
    /// File or processor step, and key.
    setting: String,
    change: String,
    verdict: SettingVerdict,
    #[serde(default)]
    edits: Vec<CheckpointEdit>,
    /// SettingChanges that LeRobot did not see.
    #[serde(default)]
    own: Vec<CheckpointEdit>,
    /// Name of the actions that LeRobot executed.
    actions: Option<String>,
}

/// Treatment of a setting.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum SettingVerdict {
    /// The actions are LeRobot's.
    Honoured,
    /// Loading fails with an error that contains this text.
    Refused(String),
    /// A note contains this text, and the actions are LeRobot's without the setting.
    Announced(String),
}

/// The variants, their actions `[n_steps, action_dim]`, and LeRobot's list of settings.
struct VariantRecording {
    variants: VariantFile,
    actions: BTreeMap<String, Vec<f32>>,
    settings: Value,
}

fn recording() -> &'static VariantRecording {
    static RECORDING: OnceLock<VariantRecording> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let file = |name: &str| std::fs::read(data("variants").join(name)).unwrap();
        let bytes = file("variants.safetensors");
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        let values = |data: &[u8]| data.as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect();
        let actions =
            tensors.tensors().iter().map(|(name, view)| (name.clone(), values(view.data()))).collect();
        let variants = serde_json::from_slice(&file("variants.json")).unwrap();
        VariantRecording {
            variants,
            actions,
            settings: serde_json::from_slice(&file("settings.json")).unwrap(),
        }
    })
}

impl CheckpointVariant {
    /// Returns the difference between the verdict and what happens, or `None`.
    fn complaint(&self) -> Option<String> {
        let episode = run(&self.folder(), &self.base, self.n_values());
        let problem = match (&self.verdict, episode) {
            (SettingVerdict::Refused(text), Err(error)) if error.contains(text) => None,
            (SettingVerdict::Refused(text), Err(error)) => {
                Some(format!("the error does not contain `{text}`: {error}"))
            }
            (SettingVerdict::Refused(_), Ok(VariantEpisode { notes, .. })) => {
                Some(format!("runs, with the notes {notes:?}"))
            }
            (_, Err(error)) => Some(format!("refused: {error}")),
            (SettingVerdict::Announced(text), Ok(VariantEpisode { notes, .. }))
                if !notes.iter().any(|note| note.contains(text)) =>
            {
                Some(format!("no note contains `{text}`: {notes:?}"))
            }
            (_, Ok(VariantEpisode { actions, .. })) => self.difference(&actions),
        };
        problem.map(|problem| format!("{}, {}, {}: {problem}", self.base, self.setting, self.change))
    }

    fn n_values(&self) -> usize {
        self.expected().map_or(1, <[f32]>::len)
    }

    fn expected(&self) -> Option<&'static [f32]> {
        self.actions.as_ref().map(|name| &recording().actions[name][..])
    }

    /// Returns the difference of the actions from LeRobot's if it exceeds the tolerance.
    fn difference(&self, actions: &[f32]) -> Option<String> {
        let expected = self.expected().expect("the actions were recorded");
        assert_eq!(actions.len(), expected.len());
        let differences = actions.iter().zip(expected).map(|(x, y)| (x - y).abs());
        let worst = differences.fold(0.0, f32::max);
        // A difference that is no number exceeds the tolerance too.
        (worst.is_nan() || worst > TOLERANCE).then(|| format!("the actions differ by {worst}"))
    }

    /// Writes the changed checkpoint to a temporary folder.
    fn folder(&self) -> tempfile::TempDir {
        let base = &recording().variants.bases[&self.base];
        let folder = tempfile::tempdir().unwrap();
        copy(&data(&base.folder), folder.path());
        base.edits.iter().chain(&self.edits).chain(&self.own).for_each(|edit| edit.apply(folder.path()));
        folder
    }
}

/// Copies the files of a checkpoint, without recorded inputs and outputs.
fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if !name.starts_with("io.") {
            std::fs::copy(&path, to.join(name)).unwrap();
        }
    }
}

#[test]
#[expect(clippy::print_stdout, reason = "the counts are shown with --nocapture")]
fn variants_are_honoured_refused_or_announced() {
    let variants = &recording().variants.variants;
    let complaints: Vec<_> = variants.iter().filter_map(CheckpointVariant::complaint).collect();
    for complaint in &complaints {
        println!("{complaint}");
    }
    let count =
        |is: fn(&SettingVerdict) -> bool| variants.iter().filter(|variant| is(&variant.verdict)).count();
    println!(
        "{} variants: {} honoured, {} refused, {} announced",
        variants.len(),
        count(|verdict| matches!(verdict, SettingVerdict::Honoured)),
        count(|verdict| matches!(verdict, SettingVerdict::Refused(_))),
        count(|verdict| matches!(verdict, SettingVerdict::Announced(_))),
    );
    assert!(
        complaints.is_empty(),
        "{} variants with another outcome:\n{}",
        complaints.len(),
        complaints.join("\n")
    );
}

/// Steps that LeRobot registers for other policies and robots.
#[test]
fn other_processor_steps_are_refused_by_name() {
    for base in recording().variants.bases.keys() {
        for name in strings(&recording().settings["other_steps"]) {
            for file in ["policy_preprocessor.json", "policy_postprocessor.json"] {
                let step = format!(r#"{{"registry_name": "{name}", "config": {{}}}}"#);
                let edit = format!(r#"{{"op": "insert", "file": "{file}", "idx": 1, "step": {step}}}"#);
                let variant = CheckpointVariant {
                    base: base.clone(),
                    setting: format!("{file} steps"),
                    change: name.clone(),
                    verdict: SettingVerdict::Refused(name.clone()),
                    edits: vec![serde_json::from_str(&edit).unwrap()],
                    own: Vec::new(),
                    actions: None,
                };
                assert_eq!(variant.complaint(), None);
            }
        }
    }
}

/// A setting of a new LeRobot needs a variant in `python/variants`, and with it a decision.
#[test]
fn settings_of_lerobot_have_variants() {
    let VariantRecording { variants, settings, .. } = recording();
    assert_eq!(settings["lerobot"], variants.lerobot, "both files are from one version");
    let mut missing = Vec::new();
    let mut require = |policy: &str, setting: String, value: Option<&str>| {
        let fits = |variant: &&CheckpointVariant| variant.base == policy && variant.setting == setting;
        let mentions = |variant: &CheckpointVariant| {
            value.is_none_or(|value| format!("{:?}", variant.edits).contains(value))
        };
        if !variants.variants.iter().filter(fits).any(mentions) {
            missing.push(format!("{policy}, {setting} {}", value.unwrap_or_default()));
        }
    };
    for (policy, pipelines) in settings["pipelines"].as_object().unwrap() {
        for key in keys(&settings["configs"][policy]) {
            require(policy, format!("config.json {key}"), None);
        }
        for step in pipelines.as_object().unwrap().values().flat_map(strings) {
            for key in keys(&settings["steps"][&step]) {
                require(policy, format!("{step} {key}"), None);
            }
        }
        for mode in strings(&settings["normalization_modes"]) {
            require(policy, "normalizer_processor norm_map".to_owned(), Some(&mode));
            require(policy, "unnormalizer_processor norm_map".to_owned(), Some(&mode));
        }
        for kind in strings(&settings["feature_types"])
            .iter()
            .filter(|kind| !["ACTION", "ENV", "STATE"].contains(&kind.as_str()))
        {
            require(policy, "config.json input_features".to_owned(), Some(kind));
        }
    }
    for key in keys(&settings["configs"]["rtc_config"]) {
        require("pi05", "config.json rtc_config".to_owned(), Some(&key));
    }
    assert!(missing.is_empty(), "no variant of\n{}", missing.join("\n"));
}

fn keys(object: &Value) -> impl Iterator<Item = String> {
    object.as_object().unwrap().keys().cloned()
}

fn strings(list: &Value) -> Vec<String> {
    list.as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect()
}
