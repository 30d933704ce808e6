//! Policies in servers of other projects: their addresses, and the modules of the Python package that ask
//! them.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

/// A protocol of policy servers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ServerProtocol {
    /// openpi's WebSocket server.
    OpenPi,
    /// Model servers of vla-eval.
    VlaEval,
    /// LeRobot's server for asynchronous inference.
    LeRobotAsync,
}

/// An option of the modules that ask servers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ServerOption {
    /// File with the mapping of requests.
    Mapping,
    /// Number of connections (openpi).
    Connections,
    /// Checkpoint that the server loads (LeRobot).
    Checkpoint,
    /// Type of that policy (LeRobot).
    Type,
    /// Device of that policy (LeRobot).
    Device,
}

/// A policy in a server.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct PolicyServer {
    /// The protocol that the server speaks.
    pub protocol: ServerProtocol,
    url: String,
    options: Vec<(ServerOption, String)>,
}

impl ServerProtocol {
    /// All protocols.
    pub const ALL: [Self; 3] = [Self::OpenPi, Self::VlaEval, Self::LeRobotAsync];

    /// Returns the name of the protocol, which is also that of the Python package's extra.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::OpenPi => "openpi",
            Self::VlaEval => "vla-eval",
            Self::LeRobotAsync => "lerobot-async",
        }
    }

    /// Returns the Python module.
    #[must_use]
    pub fn module(self) -> String {
        format!("hypogeum.{}", self.name().replace('-', "_"))
    }
}

impl ServerOption {
    const ALL: [Self; 5] = [Self::Mapping, Self::Connections, Self::Checkpoint, Self::Type, Self::Device];

    const fn name(self) -> &'static str {
        match self {
            Self::Mapping => "mapping",
            Self::Connections => "connections",
            Self::Checkpoint => "checkpoint",
            Self::Type => "type",
            Self::Device => "device",
        }
    }

    /// Returns the names of all options.
    pub(crate) fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl PolicyServer {
    /// Parses `URL` or `URL?OPTION=VALUE&…`. The error is the option that is unknown.
    pub(crate) fn parse(protocol: ServerProtocol, text: &str) -> Result<Self, &str> {
        let (url, query) = text.split_once('?').unwrap_or((text, ""));
        let option = |pair: &'_ str| {
            let (name, value) = pair.split_once('=')?;
            let option = ServerOption::ALL.into_iter().find(|option| option.name() == name)?;
            Some((option, value.to_owned()))
        };
        let pairs = query.split('&').filter(|pair| !pair.is_empty());
        let options = pairs.map(|pair| option(pair).ok_or(pair)).collect::<Result<_, _>>()?;
        Ok(Self { protocol, url: url.to_owned(), options })
    }

    /// Returns the file with the mapping of requests.
    #[must_use]
    pub fn mapping(&self) -> Option<&Path> {
        let mapping = self.options.iter().find(|(option, _)| *option == ServerOption::Mapping);
        mapping.map(|(_, path)| Path::new(path))
    }

    /// Returns the same policy without the path of its mapping, whose content identifies it.
    #[must_use]
    pub(crate) fn without_mapping(mut self) -> Self {
        self.options.retain(|(option, _)| *option != ServerOption::Mapping);
        self
    }

    /// Returns the arguments of Python with which the module offers the policy as a host called `name`.
    #[must_use]
    pub fn arguments(&self, name: &str) -> Vec<String> {
        let module = ["-m".to_owned(), self.protocol.module(), self.url.clone(), name.to_owned()];
        let options = self.options.iter().map(|(option, value)| format!("--{}={value}", option.name()));
        module.into_iter().chain(options).collect()
    }
}

impl fmt::Display for PolicyServer {
    /// Writes the address without a user and a password, and the options.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&without_credentials(&self.url))?;
        for (idx, (option, value)) in self.options.iter().enumerate() {
            write!(f, "{}{}={value}", if idx == 0 { '?' } else { '&' }, option.name())?;
        }
        Ok(())
    }
}

/// Returns a text with an address in it without the address's user and password.
#[must_use]
pub fn without_credentials(text: &str) -> String {
    let Some((before, address)) = text.split_once("://") else { return text.to_owned() };
    let (authority, path) = address.split_at(address.find(['/', '?']).unwrap_or(address.len()));
    let host = authority.rsplit_once('@').map_or(authority, |(_, host)| host);
    format!("{before}://{host}{path}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_those_of_the_module() {
        let text = "ws://host:8000/p?mapping=a/b.json&connections=2";
        let server = PolicyServer::parse(ServerProtocol::OpenPi, text).unwrap();
        let expected =
            ["-m", "hypogeum.openpi", "ws://host:8000/p", "name", "--mapping=a/b.json", "--connections=2"];
        assert_eq!(server.arguments("name"), expected);
        assert_eq!((server.to_string().as_str(), server.mapping()), (text, Some(Path::new("a/b.json"))));
        assert_eq!(server.without_mapping().to_string(), "ws://host:8000/p?connections=2");
    }

    #[test]
    fn credentials_are_not_shown() {
        let server = PolicyServer::parse(ServerProtocol::VlaEval, "wss://user:secret@host:8000").unwrap();
        assert_eq!(server.to_string(), "wss://host:8000");
        assert_eq!(server.arguments("name")[2], "wss://user:secret@host:8000");
        let word = "p=openpi:ws://user:secret@host:1?mapping=a@b";
        assert_eq!(without_credentials(word), "p=openpi:ws://host:1?mapping=a@b");
        assert_eq!(without_credentials("p=act:a@b"), "p=act:a@b");
    }

    #[test]
    fn unknown_option_is_an_error() {
        let parse = |text| PolicyServer::parse(ServerProtocol::OpenPi, text).map(|_| ());
        assert_eq!(parse("ws://host:1?map=x"), Err("map=x"));
        assert_eq!(parse("ws://host:1?mapping"), Err("mapping"));
    }
}
