//! Sweep files: the options of `run` as TOML keys.
//!
//! A key is the name of a field of [`SweepArgs`] or [`RunConfig`](run_config::RunConfig). Its value is
//! translated into the flag of that field, so that the command line's parser is the only one and an option
//! needs no second declaration.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::error::Error;
use std::ffi::OsString;
use std::num::{ParseFloatError, ParseIntError};
use std::path::{Path, PathBuf};

use clap::error::{ContextKind, ContextValue};
use clap::{Arg, ArgAction, Args, Command};
use run_config::{LanguageFile, input};
use thiserror::Error;
use toml::{Spanned, Value};

use crate::plan::sweep::SweepArgs;
use crate::selection::names::UnknownName;

/// Errors that can occur while reading a sweep file.
#[derive(Debug, Error)]
pub(crate) enum SweepFileError {
    #[error("failed to read the sweep file {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("the sweep file {}, line {line}: it is not TOML: {reason}", path.display())]
    Parse { path: PathBuf, line: usize, reason: String },
    #[error("the sweep file {}, line {line}", path.display())]
    UnknownKey { path: PathBuf, line: usize, source: UnknownName },
    #[error("the sweep file {}, line {line}, key `{key}`: {reason}", path.display())]
    Value { path: PathBuf, line: usize, key: String, reason: String },
}

/// Returns the flags that the sweep file at `path` stands for, except those of the options for which
/// `is_overridden` returns `true`. Overridden keys are checked nevertheless.
///
/// # Errors
/// If the file cannot be read, is not TOML, or has an unknown key or an invalid value.
pub(crate) fn flags(
    path: &Path,
    is_overridden: impl Fn(&str) -> bool,
) -> Result<Vec<OsString>, SweepFileError> {
    let text =
        input::read_to_string(path).map_err(|source| SweepFileError::Read { path: path.into(), source })?;
    let table: BTreeMap<String, Spanned<Value>> =
        toml::from_str(&text).map_err(|error: toml::de::Error| SweepFileError::Parse {
            path: path.into(),
            line: line_at(&text, error.span().map_or(0, |span| span.start)),
            reason: error.message().to_owned(),
        })?;
    let mut entries: Vec<_> = table.into_iter().collect();
    // In the order of the file, so that the first error is reported.
    entries.sort_by_key(|(_, value)| value.span().start);
    let command = SweepArgs::augment_args(Command::new("sweep").no_binary_name(true));
    let mut flags = Vec::new();
    for (key, value) in entries {
        let line = line_at(&text, value.span().start);
        let Some(arg) = command.get_arguments().find(|arg| arg.get_id() == key.as_str()) else {
            let known: Vec<&str> = command.get_arguments().map(|arg| arg.get_id().as_str()).collect();
            let source = UnknownName::new("key", &key, &known);
            return Err(SweepFileError::UnknownKey { path: path.into(), line, source });
        };
        let invalid = |reason| SweepFileError::Value { path: path.into(), line, key: key.clone(), reason };
        let own = flags_of(arg, value.get_ref()).map_err(invalid)?;
        command.clone().try_get_matches_from(&own).map_err(|error| invalid(reason(&error)))?;
        if !is_overridden(&key) {
            flags.extend(own);
        }
    }
    Ok(flags)
}

/// Returns the number of the line that contains the byte at `offset`, from 1.
fn line_at(text: &str, offset: usize) -> usize {
    text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1
}

/// Translates the value of one key.
fn flags_of(arg: &Arg, value: &Value) -> Result<Vec<OsString>, String> {
    let flag = format!("--{}", arg.get_long().expect("every option of a sweep has a long flag"));
    let parsed = arg.get_value_parser().type_id();
    let is_path = [TypeId::of::<PathBuf>(), TypeId::of::<LanguageFile>()].iter().any(|id| parsed == *id);
    let with_value = |value: &Value| {
        if is_path && !value.is_str() {
            return Err(format!("found {value}, expected the path of a file in quotes"));
        }
        Ok(format!("{flag}={}", scalar(value)?).into())
    };
    match (arg.get_action(), value) {
        (ArgAction::SetTrue, Value::Boolean(true)) => Ok(vec![flag.into()]),
        (ArgAction::SetTrue, Value::Boolean(false)) => Ok(Vec::new()),
        (ArgAction::SetTrue, other) => Err(format!("found {other}, expected true or false")),
        (ArgAction::Append, Value::Array(values)) => values.iter().map(with_value).collect(),
        (_, value) => Ok(vec![with_value(value)?]),
    }
}

/// Returns a value that is no list and no table as it would be typed on the command line.
fn scalar(value: &Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Integer(number) => Ok(number.to_string()),
        Value::Float(number) => Ok(number.to_string()),
        Value::Boolean(value) => Ok(value.to_string()),
        Value::Datetime(_) | Value::Array(_) | Value::Table(_) => {
            Err(format!("found {value}, expected one string or number"))
        }
    }
}

/// Returns the reason for which clap refuses a value.
fn reason(error: &clap::Error) -> String {
    let found = match error.get(ContextKind::InvalidValue) {
        Some(ContextValue::String(found)) => found.as_str(),
        _ => "",
    };
    match (error.source(), error.get(ContextKind::ValidValue)) {
        (Some(source), _) if source.is::<ParseIntError>() => {
            format!("found `{found}`, expected a whole number")
        }
        (Some(source), _) if source.is::<ParseFloatError>() => format!("found `{found}`, expected a number"),
        (Some(source), _) => source.to_string(),
        (None, Some(ContextValue::Strings(known))) => {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            UnknownName::new("value", found, &known).to_string()
        }
        (None, _) => error.kind().to_string(),
    }
}
