//! The page for users with the verdict on every setting, generated from the variants.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{CheckpointVariant, SettingVerdict, VariantRecording, recording};

/// Environment variable that makes the test write the page before the comparison.
const BLESS: &str = "HYPOGEUM_BLESS";
const PAGE: &str = "docs/settings.md";

/// SettingChanges of one setting, by verdict.
#[derive(Default)]
struct SettingChanges<'a> {
    honoured: Vec<&'a str>,
    refused: Vec<&'a str>,
    announced: Vec<&'a str>,
}

#[test]
fn settings_page_lists_every_verdict() {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    let path = std::path::Path::new(&package).join("..").join(PAGE);
    let expected = page();
    if std::env::var_os(BLESS).is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == expected,
        "{PAGE} differs from the variants; update it with `{BLESS}=1 cargo test -p policy-host settings_page`"
    );
}

fn page() -> String {
    let VariantRecording { variants, settings, .. } = recording();
    let others = settings["other_steps"].as_array().unwrap();
    let mut out = format!(
        "# Settings of LeRobot's checkpoints\n\n\
         Every setting of ACT's and π0.5's checkpoints in LeRobot {} that changes an action is honoured, refused by an \
         error that names it, or announced in a note at the start of a run, which its results keep. The test \
         `variants` of policy-host tries the values below: those honoured give the actions that LeRobot's own loop \
         executes within 1e-5, except that relative actions are added to the state of their query \
         ([differences](differences.md#evaluation)). A setting that is unknown is refused.\n\n\
         This page is generated: `{BLESS}=1 cargo test -p policy-host settings_page`.\n",
        variants.lerobot
    );
    for (base, title, kind) in [("act", "ACT", "act"), ("pi05", "π0.5", "pi05")] {
        let own: Vec<_> = variants.variants.iter().filter(|variant| variant.base == base).collect();
        let mut by_setting: Vec<(&str, SettingChanges<'_>)> = Vec::new();
        let mut places = BTreeMap::new();
        for variant in &own {
            let place = *places.entry(&variant.setting).or_insert_with(|| {
                by_setting.push((&variant.setting, SettingChanges::default()));
                by_setting.len() - 1
            });
            by_setting[place].1.add(variant);
        }
        let count = |list: fn(&SettingChanges<'_>) -> usize| {
            by_setting.iter().map(|(_, changes)| list(changes)).sum::<usize>()
        };
        let _ = write!(
            out,
            "\n## {title} (`{kind}:`)\n\n{} variants: {} honoured, {} refused, {} announced.\n\n\
             | setting | honoured | refused | announced |\n|--|--|--|--|\n",
            own.len(),
            count(|changes| changes.honoured.len()),
            count(|changes| changes.refused.len()),
            count(|changes| changes.announced.len()),
        );
        for (setting, SettingChanges { honoured, refused, announced }) in &by_setting {
            let (place, key) = setting.split_once(' ').unwrap_or((setting, ""));
            let key = if key.is_empty() { String::new() } else { format!(" `{key}`") };
            let cells = [honoured, refused, announced].map(|changes| changes.join("; "));
            let _ = writeln!(out, "| {place}{key} | {} |", cells.join(" | "));
        }
    }
    let names: Vec<_> = others.iter().map(|name| format!("`{}`", name.as_str().unwrap())).collect();
    let _ = write!(
        out,
        "\n## Other processor steps\n\nThe {} steps that LeRobot registers for other policies and robots are refused by \
         name: {}.\n",
        names.len(),
        names.join(", ")
    );
    out
}

impl<'a> SettingChanges<'a> {
    fn add(&mut self, variant: &'a CheckpointVariant) {
        let list = match variant.verdict {
            SettingVerdict::Honoured => &mut self.honoured,
            SettingVerdict::Refused(_) => &mut self.refused,
            SettingVerdict::Announced(_) => &mut self.announced,
        };
        list.push(&variant.change);
    }
}
