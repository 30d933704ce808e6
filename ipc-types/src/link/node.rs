//! A process's membership in a run's domain. Each process has exactly one.

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::{NodeName, SignalHandlingMode};

use super::domain::Domain;
use super::error::LinkError;
use super::lease::DomainLease;
use super::management;
use super::type_names::Ipc;
use crate::link::memory::shortage::Shortage;

/// A process's membership in a domain, from which its lanes are opened. Joining also cleans up after exited
/// members.
#[derive(Debug)]
pub struct LinkNode {
    node: Node<Ipc>,
    domain: Domain,
    // Dropped last: the domain must not appear unused while the node is still leaving it.
    _lease: DomainLease,
}

impl LinkNode {
    /// Joins `domain` as `name`. The name appears in node listings and need not be unique.
    ///
    /// iceoryx2's signal handlers stay disabled: a signal merely ends a wait early.
    ///
    /// # Errors
    /// If the domain's names or paths are too long for the system, or its files cannot be created.
    pub fn new(domain: &Domain, name: &str) -> Result<Self, LinkError> {
        let config = domain.config()?;
        let node_name = NodeName::new(name)
            .map_err(|error| LinkError::NodeName { name: name.into(), reason: format!("{error:?}") })?;
        let lease = domain.lease()?;
        management::create(&domain.prefix)?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|source| match Shortage::find() {
                Some(shortage) => {
                    LinkError::Shortage { failure: format!("node {name}: {source:?}"), source: shortage }
                }
                None => LinkError::Node { name: name.into(), source },
            })?;
        Ok(Self { node, domain: domain.clone(), _lease: lease })
    }

    /// Returns the joined domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    pub(crate) fn config(&self) -> &Config {
        self.node.config()
    }

    pub(crate) fn inner(&self) -> &Node<Ipc> {
        &self.node
    }
}
