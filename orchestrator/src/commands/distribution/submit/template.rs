//! Templates of scripts and manifests: the built-in ones, or those of a user.

use std::borrow::Cow;
use std::path::PathBuf;

use anyhow::{Context, anyhow};
use clap::Args;
use minijinja::syntax::SyntaxConfig;
use minijinja::{AutoEscape, Environment, ErrorKind, UndefinedBehavior};
use run_config::input;
use serde_json::{Map, Value};

use crate::console::exit::{Failure, OrUser};
use crate::console::output::print_out;

/// Arguments that choose a template.
#[derive(Args, Clone, Debug)]
pub(crate) struct TemplateArgs {
    /// Template to fill instead of the built-in one (syntax of Jinja)
    #[arg(long, value_name = "FILE")]
    pub(crate) template: Option<PathBuf>,
    /// Print the built-in template, as a start for your own
    #[arg(long, exclusive = true)]
    pub(crate) print_template: bool,
}

impl TemplateArgs {
    /// Prints the built-in template if that is wanted, and returns `true` then.
    pub(crate) fn print(&self, built_in: &str) -> Result<bool, Failure> {
        if self.print_template {
            print_out(built_in)?;
        }
        Ok(self.print_template)
    }

    /// Returns the text and the name of the template.
    pub(crate) fn read(&self, built_in: &str) -> Result<Template, Failure> {
        let Some(path) = &self.template else {
            return Ok(Template { name: "built-in".to_owned(), text: built_in.to_owned() });
        };
        let name = path.display().to_string();
        let text = input::read_to_string(path).with_context(|| format!("failed to read the template {name}"));
        Ok(Template { text: text.or_user()?, name })
    }
}

/// A template, not filled yet.
#[derive(Clone, Debug)]
pub(crate) struct Template {
    /// Its path, for errors.
    pub(crate) name: String,
    pub(crate) text: String,
}

impl Template {
    /// Fills the template. A variable that it names and that does not exist is an error.
    pub(crate) fn fill(&self, variables: &Map<String, Value>) -> Result<String, Failure> {
        let mut environment = Environment::new();
        environment.set_undefined_behavior(UndefinedBehavior::Strict);
        environment.set_auto_escape_callback(|_| AutoEscape::None);
        let mut syntax = SyntaxConfig::builder();
        syntax.trim_blocks(true).lstrip_blocks(true).keep_trailing_newline(true);
        environment.set_syntax(syntax.build().context("the syntax of templates is invalid")?);
        environment.add_filter("json", json);
        environment.add_filter("shell", shell);
        let values = minijinja::Value::from(minijinja::value::Serde(variables));
        let filled = environment.template_from_named_str(&self.name, &self.text);
        filled.and_then(|template| template.render(values)).map_err(|error| {
            let (name, line) = (&self.name, error.line().unwrap_or(1));
            let place = format!("the template {name}, line {line}");
            let known = variables.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            let hint = format!("{place}: a variable that is not defined; there are {known}");
            let error = if error.kind() == ErrorKind::UndefinedError {
                anyhow!(hint)
            } else {
                described(&error, &place)
            };
            Failure::User(error)
        })
    }
}

/// Returns an error of a template without its place, which `place` says.
fn described(error: &minijinja::Error, place: &str) -> anyhow::Error {
    let detail = error.detail().map(|detail| format!(": {detail}")).unwrap_or_default();
    anyhow!("{place}: {}{detail}", error.kind())
}

/// Quotes a text for JSON, YAML and TOML.
fn json(text: &str) -> String {
    Value::from(text).to_string()
}

/// Quotes a text as a word of a shell.
fn shell(text: &str) -> Result<String, minijinja::Error> {
    let quoted = shlex::try_quote(text).map(Cow::into_owned);
    quoted.map_err(|error| minijinja::Error::new(ErrorKind::InvalidOperation, error.to_string()))
}
