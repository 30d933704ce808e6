//! JSON objects of a checkpoint, of which no key is ignored in silence.
//!
//! A reader takes the keys that it knows. Whatever is left in the end is refused by name, unless the user has
//! listed it under `ignore` in `hypogeum.json`.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use serde::de::{DeserializeOwned, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;

use super::error::CheckpointError;
use super::files::MAPPING_FILE;

/// Longest text of a value in an error.
const MAX_SHOWN: usize = 60;

/// The keys of a JSON object that have not been taken yet.
#[derive(Debug)]
pub(crate) struct Settings {
    path: PathBuf,
    /// Name of the object in front of its keys: empty, or for example `tokenizer_processor.`.
    scope: String,
    entries: Vec<(String, Box<RawValue>)>,
}

/// Names of settings that the user allows to be ignored.
#[derive(Debug, Default)]
pub(crate) struct IgnoreList {
    names: Vec<String>,
    used: RefCell<BTreeSet<String>>,
}

/// The entries of an object in the order of the file.
#[derive(Clone, Debug)]
pub(crate) struct Features<T>(pub(crate) Vec<(String, T)>);

type Entries = Features<Box<RawValue>>;

impl Settings {
    /// Reads the object in the file at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self, CheckpointError> {
        let text = run_config::input::read(path)
            .map_err(|source| CheckpointError::Read { path: path.to_owned(), source })?;
        Self::parse(path, &text)
    }

    /// Parses the object in the file at `path`, which contains `text`.
    pub(crate) fn parse(path: &Path, text: &[u8]) -> Result<Self, CheckpointError> {
        let Features(entries) = parse::<Entries>(path, text)?;
        Ok(Self { path: path.to_owned(), scope: String::new(), entries })
    }

    /// Takes a key. Returns `None` if it is absent or `null`.
    pub(crate) fn take<T: DeserializeOwned>(&mut self, key: &str) -> Result<Option<T>, CheckpointError> {
        let Some(value) = self.remove(key) else { return Ok(None) };
        serde_json::from_str::<Option<T>>(value.get())
            .map_err(|error| self.value(key, shown(&value), format!("another type ({error})")))
    }

    /// Takes a key. Returns `default` if it is absent or `null`.
    pub(crate) fn take_or<T: DeserializeOwned>(
        &mut self,
        key: &str,
        default: T,
    ) -> Result<T, CheckpointError> {
        Ok(self.take(key)?.unwrap_or(default))
    }

    /// Takes a key that must be there.
    pub(crate) fn require<T: DeserializeOwned>(
        &mut self,
        key: &str,
        expected: &str,
    ) -> Result<T, CheckpointError> {
        self.take(key)?.ok_or_else(|| self.value(key, "missing", expected))
    }

    /// Takes a key whose value is an object, as `scope.key.` in messages.
    pub(crate) fn object(&mut self, key: &str, scope: &str) -> Result<Option<Self>, CheckpointError> {
        let Some(Features(entries)) = self.take::<Entries>(key)? else { return Ok(None) };
        Ok(Some(Self { path: self.path.clone(), scope: scope.to_owned(), entries }))
    }

    /// Takes a key whose value is a list of objects.
    pub(crate) fn objects(&mut self, key: &str) -> Result<Vec<Self>, CheckpointError> {
        let objects: Vec<Entries> = self.require(key, "a list")?;
        let settings = (0..).zip(objects).map(|(idx, Features(entries))| Self {
            path: self.path.clone(),
            scope: format!("{}{key}[{idx}].", self.scope),
            entries,
        });
        Ok(settings.collect())
    }

    /// Returns `true` if there is a setting with this key.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.entries.iter().any(|(name, _)| name == key)
    }

    /// Takes a switch, if it is there.
    pub(crate) fn switch(&mut self, key: &str) -> Result<Option<bool>, CheckpointError> {
        Ok(self.take::<Flag>(key)?.map(Flag::is_set))
    }

    /// Takes a switch that must be off.
    pub(crate) fn refuse_switch(&mut self, key: &str, expected: &str) -> Result<(), CheckpointError> {
        match self.switch(key)? {
            Some(true) => Err(self.value(key, "true", expected)),
            _ => Ok(()),
        }
    }

    /// Takes keys that have no influence on actions.
    pub(crate) fn discard(&mut self, keys: &[&str]) {
        self.entries.retain(|(name, _)| !keys.contains(&name.as_str()));
    }

    /// Returns the error that a key has this value instead of what is expected.
    pub(crate) fn value(
        &self,
        key: &str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> CheckpointError {
        CheckpointError::Value {
            path: self.path.clone(),
            key: format!("{}{key}", self.scope),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }

    /// Ends the reading: refuses the first key that was not taken, and notes those that the user ignores.
    pub(crate) fn finish(self, ignore: &IgnoreList, notes: &mut Vec<String>) -> Result<(), CheckpointError> {
        for (name, value) in self.entries {
            let (setting, found) = (format!("{}{name}", self.scope), shown(&value));
            if !ignore.allows(&setting) {
                return Err(CheckpointError::UnknownSetting { path: self.path, setting, found });
            }
            notes.push(format!("ignores the setting `{setting}` ({found}), as {MAPPING_FILE} says"));
        }
        Ok(())
    }

    fn remove(&mut self, key: &str) -> Option<Box<RawValue>> {
        let mut found = None;
        // As in Python, the last of several values counts.
        while let Some(idx) = self.entries.iter().rposition(|(name, _)| name == key) {
            let (_, value) = self.entries.remove(idx);
            found.get_or_insert(value);
        }
        found
    }
}

impl IgnoreList {
    pub(crate) fn new(names: Vec<String>) -> Self {
        Self { names, used: RefCell::default() }
    }

    fn allows(&self, setting: &str) -> bool {
        let allowed = self.names.iter().any(|name| name == setting);
        if allowed {
            self.used.borrow_mut().insert(setting.to_owned());
        }
        allowed
    }

    /// Refuses names that no unknown setting has: a known one cannot be ignored.
    pub(crate) fn finish(&self, folder: &Path) -> Result<(), CheckpointError> {
        let used = self.used.borrow();
        let unused = self.names.iter().find(|name| !used.contains(*name));
        unused.map_or(Ok(()), |name| {
            Err(CheckpointError::Value {
                path: folder.join(MAPPING_FILE),
                key: "ignore".to_owned(),
                found: format!("`{name}`"),
                expected: "names of settings that are unknown otherwise".to_owned(),
            })
        })
    }
}

impl<T> Default for Features<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Features<T> {
    /// Returns the entry with this name.
    pub(crate) fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(own, _)| own == name).map(|(_, entry)| entry)
    }

    /// Adds an entry at the end, unless there is one with this name.
    pub(crate) fn add(&mut self, name: String, entry: T) {
        if self.get(&name).is_none() {
            self.0.push((name, entry));
        }
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Features<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for InOrder<T> {
            type Value = Features<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Features<T>, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Features(entries))
            }
        }
        deserializer.deserialize_map(InOrder(PhantomData))
    }
}

/// A boolean that some LeRobot versions write as a number.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum Flag {
    Bool(bool),
    Number(i64),
}

impl Flag {
    fn is_set(self) -> bool {
        match self {
            Self::Bool(set) => set,
            Self::Number(number) => number != 0,
        }
    }
}

/// Parses the JSON in the file at `path`, which contains `text`, as a type that knows all of its keys.
pub(crate) fn parse<'a, T: Deserialize<'a>>(path: &Path, text: &'a [u8]) -> Result<T, CheckpointError> {
    serde_json::from_slice(text).map_err(|source| CheckpointError::Json { path: path.to_owned(), source })
}

/// Returns the JSON text of a value, shortened if it is long.
fn shown(value: &RawValue) -> String {
    let words: Vec<&str> = value.get().split_whitespace().collect();
    let text = words.join(" ");
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str) -> Settings {
        Settings::parse(Path::new("config.json"), text.as_bytes()).unwrap()
    }

    #[test]
    fn keys_that_nobody_takes_are_refused() {
        let mut config = settings(r#"{"a": 1, "b": null, "c": [1, 2], "a": 2}"#);
        assert_eq!(config.take::<u32>("a").unwrap(), Some(2));
        assert_eq!(config.take_or("b", 7).unwrap(), 7);
        let error = config.finish(&IgnoreList::default(), &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("`c`") && error.contains("[1, 2]") && error.contains("ignore"), "{error}");
    }

    #[test]
    fn ignored_keys_are_noted_and_must_exist() {
        let ignore = IgnoreList::new(vec!["steps[0].c".to_owned()]);
        let mut notes = Vec::new();
        let mut steps = settings(r#"{"steps": [{"c": true}]}"#).objects("steps").unwrap();
        steps.remove(0).finish(&ignore, &mut notes).unwrap();
        assert_eq!(notes.len(), 1);
        ignore.finish(Path::new(".")).unwrap();
        let unused = IgnoreList::new(vec!["d".to_owned()]).finish(Path::new(".")).unwrap_err().to_string();
        assert!(unused.contains("`d`"), "{unused}");
    }

    #[test]
    fn wrong_types_name_the_key() {
        let error = settings(r#"{"n_heads": "eight"}"#).take::<usize>("n_heads").unwrap_err().to_string();
        assert!(error.contains("`n_heads`") && error.contains("eight"), "{error}");
    }

    #[test]
    fn switches_may_be_numbers() {
        assert!(settings(r#"{"dilated": 1}"#).refuse_switch("dilated", "false").is_err());
        assert!(settings(r#"{"dilated": 0}"#).refuse_switch("dilated", "false").is_ok());
    }
}
