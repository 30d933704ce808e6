//! One machine: its folder, and the files and tasks there.

use std::fs::File;
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail};

use crate::commands::distribution::submit::tool::refusal;

/// Longest time without data before rsync gives up, in s.
const TIMEOUT: &str = "--timeout=120";

/// A machine that ssh reaches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Remote<'a> {
    pub(crate) host: &'a str,
    /// ssh with its options.
    pub(crate) ssh: &'a [String],
    /// Folder of the sweep there.
    pub(crate) root: &'a str,
    /// Folder of the shards, relative to the working folder, there as here.
    pub(crate) folder: &'a str,
}

impl Remote<'_> {
    /// Copies the program and the inputs.
    ///
    /// # Errors
    /// If the machine cannot be reached, or something cannot be copied.
    pub(crate) fn set_up(&self, program: &str, inputs: &[String]) -> Result<()> {
        let folders = [format!("{}/bin", self.root), format!("{}/files/{}", self.root, self.folder)];
        let words = [vec!["mkdir".to_owned(), "-p".to_owned(), "--".to_owned()], folders.to_vec()].concat();
        complete(self.ssh(&words)?, "")?;
        let program = if program.starts_with('/') { program.to_owned() } else { format!("./{program}") };
        let target = self.path("bin/hypogeum");
        complete(self.rsync(&["-a", "--copy-links", &program, &target])?, "")?;
        let inputs: Vec<String> = inputs.iter().map(|path| format!("./{path}")).collect();
        let target = self.path("files/");
        let options = ["-a", "--copy-links", "--relative"].into_iter();
        let arguments = options.chain(inputs.iter().map(String::as_str)).chain([target.as_str()]);
        complete(self.rsync(&arguments.collect::<Vec<_>>())?, "")
    }

    /// Copies files in the folder of the shards to the machine, those that are here. Which of two is newer is
    /// not asked: clocks differ, and what is here was fetched last.
    ///
    /// # Errors
    /// If they cannot be copied.
    pub(crate) fn push(&self, names: &[String]) -> Result<()> {
        let (here, there) = (format!("./{}/", self.folder), self.path(&format!("files/{}/", self.folder)));
        let options = ["-a", "--ignore-missing-args", "--files-from=-", &here, &there];
        complete(self.rsync(&options)?, &names.join("\n"))
    }

    /// Copies results in the folder of the shards from the machine, whose task is the latest.
    ///
    /// # Errors
    /// If they cannot be copied.
    pub(crate) fn fetch_results(&self, names: &[String]) -> Result<()> {
        self.fetch(&["-a"], names)
    }

    /// Copies results from the machine that are not here.
    ///
    /// # Errors
    /// If they cannot be copied.
    pub(crate) fn fetch_leftovers(&self, names: &[String]) -> Result<()> {
        self.fetch(&["-a", "--ignore-existing"], names)
    }

    /// Copies a state from the machine. The copy's time is that of this machine's clock.
    ///
    /// # Errors
    /// If it cannot be copied.
    pub(crate) fn fetch_state(&self, name: &str) -> Result<()> {
        self.fetch(&["--ignore-times"], &[name.to_owned()])
    }

    fn fetch(&self, options: &[&str], names: &[String]) -> Result<()> {
        let (here, there) = (format!("./{}/", self.folder), self.path(&format!("files/{}/", self.folder)));
        let files = ["--ignore-missing-args", "--files-from=-", &there, &here];
        complete(self.rsync(&[options, &files].concat())?, &names.join("\n"))
    }

    /// Starts the program with these arguments. It ends in order when its standard input does.
    ///
    /// # Errors
    /// If ssh cannot be started.
    pub(crate) fn start(&self, arguments: &[String], log: File) -> Result<Child> {
        let mut ssh = command(&self.task_words(arguments)?);
        let errors = log.try_clone().context("failed to open the log twice")?;
        ssh.stdin(Stdio::piped()).stdout(log).stderr(errors).spawn().context("failed to start ssh")
    }

    /// Returns the words that start the program with these arguments on the machine.
    ///
    /// # Errors
    /// If they cannot be quoted.
    pub(crate) fn task_words(&self, arguments: &[String]) -> Result<Vec<String>> {
        let program = ["../bin/hypogeum".to_owned()];
        let task = [&program, arguments, &["--end-with-stdin".to_owned()]].concat();
        let folder = shlex::try_quote(self.root).context("the folder cannot be quoted")?;
        let task =
            shlex::try_join(task.iter().map(String::as_str)).context("an argument cannot be quoted")?;
        Ok([self.ssh, &[self.host.to_owned(), format!("cd {folder}/files && exec {task}")]].concat())
    }

    /// Returns ssh with a command for the machine.
    fn ssh(&self, words: &[String]) -> Result<Command> {
        let line = shlex::try_join(words.iter().map(String::as_str)).context("a path cannot be quoted")?;
        Ok(command(&[self.ssh, &[self.host.to_owned(), line]].concat()))
    }

    fn rsync(&self, arguments: &[&str]) -> Result<Command> {
        let shell = shlex::try_join(self.ssh.iter().map(String::as_str)).context("--ssh cannot be quoted")?;
        let mut words = vec!["rsync".to_owned(), TIMEOUT.to_owned(), "-s".to_owned(), "-e".to_owned(), shell];
        words.extend(arguments.iter().map(|word| (*word).to_owned()));
        Ok(command(&words))
    }

    /// Returns a path in the folder on the machine, as rsync writes it.
    fn path(&self, path: &str) -> String {
        format!("{}:{}/{path}", self.host, self.root)
    }
}

/// Makes a child that Ctrl-C does not reach, because its end has to wait for that of the task.
fn command(words: &[String]) -> Command {
    let mut command = Command::new(&words[0]);
    command.args(&words[1..]).process_group(0);
    command
}

/// Runs a command with this input to its end.
fn complete(mut command: Command, input: &str) -> Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let started = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut child = started.with_context(|| format!("failed to start {program}"))?;
    if let Some(mut stdin) = child.stdin.take() {
        // A child that does not read its input has an error to report.
        let _ = stdin.write_all(input.as_bytes());
    }
    let output = child.wait_with_output().with_context(|| format!("failed to wait for {program}"))?;
    if !output.status.success() {
        bail!("{}", refusal(&program, output.status, &output.stderr));
    }
    Ok(())
}
