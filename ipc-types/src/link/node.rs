//! A process's membership in a run's domain. There is one per process.

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::{NodeName, SignalHandlingMode};

use super::domain::Domain;
use super::error::LinkError;
use super::lease::DomainLease;
use super::type_names::Ipc;

/// A process's membership in a domain; its lanes are made from it. Joining also cleans up after dead members.
#[derive(Debug)]
pub struct LinkNode {
    node: Node<Ipc>,
    domain: Domain,
    // Released last: the domain must not look unused while the node is still leaving it.
    _lease: DomainLease,
}

impl LinkNode {
    /// Joins `domain` under `name` (for people who list nodes; it need not be unique).
    ///
    /// Signals are left to the process: a signal ends a wait early and nothing else.
    ///
    /// # Errors
    /// If the domain's names or paths are too long for the system, or its files cannot be created.
    pub fn new(domain: &Domain, name: &str) -> Result<Self, LinkError> {
        let config = domain.config()?;
        let node_name = NodeName::new(name)
            .map_err(|error| LinkError::NodeName { name: name.into(), reason: format!("{error:?}") })?;
        let lease = domain.lease()?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|source| LinkError::Node { name: name.into(), source })?;
        Ok(Self { node, domain: domain.clone(), _lease: lease })
    }

    /// The domain joined.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    pub(super) fn config(&self) -> &Config {
        self.node.config()
    }

    pub(super) fn inner(&self) -> &Node<Ipc> {
        &self.node
    }
}
