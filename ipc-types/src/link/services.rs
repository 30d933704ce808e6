//! The two message services of a lane: their names, settings, and the attributes with which both sides verify
//! that they agree.

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::Node;
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, MessagingPattern, NodeState, PortFactory as _, SemanticString,
    Service as _, ServiceName, ZeroCopySend,
};
use iceoryx2::service::attribute::{AttributeKey, AttributeSet, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::error::LinkError;
use super::lane_spec::LaneSpec;
use super::node::LinkNode;
use super::retry::AttemptError;
use super::type_names::Ipc;
use crate::layout::Page;
use crate::link::memory::shortage::Shortage;

/// A publish-subscribe service whose messages are pages with a header `H`.
pub(crate) type MessageService<H> = PortFactory<Ipc, [Page], H>;

/// Maximum number of processes that have a service open: two, plus exited processes not reaped yet.
const MAX_NODES: usize = 16;

/// Returns the name of the lane's service `kind`: `observation`, `action` or `wake`.
pub(crate) fn lane_service(spec: &LaneSpec, kind: &str) -> String {
    format!("hyp/lane/{}/{kind}", spec.lane)
}

/// Properties that both sides of a lane must agree on, stored as attributes of its services. The run number
/// is stored too, but not compared.
pub(crate) struct Agreement<'a> {
    pub(crate) schema_hash: u64,
    pub(crate) spec: &'a LaneSpec,
}

impl Agreement<'_> {
    fn fields(&self) -> [(&'static str, String); 6] {
        let Self { schema_hash, spec } = self;
        [
            ("schema", format!("{schema_hash:016x}")),
            ("lane", spec.lane.to_string()),
            ("policy", spec.policy.clone()),
            ("max_envs", spec.max_envs.to_string()),
            ("block_pages", spec.block_pages.to_string()),
            ("in_flight", spec.in_flight.to_string()),
        ]
    }

    /// Checks a service's attributes. The error names the first one that differs.
    fn check(&self, service: &str, attributes: &AttributeSet) -> Result<(), LinkError> {
        for (field, expected) in self.fields() {
            let found = attribute_key(service, field)
                .map(|key| attributes.key_value(&key, 0).map_or("absent".into(), ToString::to_string))?;
            if found == expected {
                continue;
            }
            return Err(match u64::from_str_radix(&found, 16) {
                Ok(found) if field == "schema" => LinkError::Schema { expected: self.schema_hash, found },
                _ => LinkError::Spec { service: service.into(), field, expected, found },
            });
        }
        Ok(())
    }

    fn verifier(&self, service: &str, run: u64) -> Result<AttributeVerifier, LinkError> {
        let mut verifier = AttributeVerifier::new();
        for (field, value) in self.fields().into_iter().chain([("run", format!("{run:016x}"))]) {
            let value = AttributeValue::new(value.as_bytes())
                .map_err(|error| attribute_error(service, field, &error))?;
            verifier = verifier
                .require(&attribute_key(service, field)?, &value)
                .map_err(|error| attribute_error(service, field, &error))?;
        }
        Ok(verifier)
    }
}

/// Creates a message service, or opens the one that an exited sim has left behind.
pub(crate) fn create<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
    run: u64,
    agreement: &Agreement<'_>,
) -> Result<MessageService<H>, AttemptError> {
    use PublishSubscribeOpenOrCreateError::{
        PublishSubscribeCreateError as Create, PublishSubscribeOpenError as Open, SystemInFlux,
    };
    let verifier = agreement.verifier(service, run)?;
    let in_flight = agreement.spec.in_flight as usize;
    builder(node, service)?
        .enable_safe_overflow(false)
        .history_size(0)
        .max_publishers(1)
        .max_subscribers(1)
        .max_nodes(MAX_NODES)
        .subscriber_max_buffer_size(in_flight)
        .subscriber_max_borrowed_samples(in_flight)
        .open_or_create_with_attributes(&verifier)
        .map_err(|error| match error {
            Open(PublishSubscribeOpenError::IncompatibleAttributes) => {
                AttemptError::Permanent(match find(node, service, agreement) {
                    Err(AttemptError::Permanent(difference)) => difference,
                    _ => service_error(service, &error),
                })
            }
            Open(error) => open_failure(service, error),
            Create(
                PublishSubscribeCreateError::AlreadyExists
                | PublishSubscribeCreateError::IsBeingCreatedByAnotherInstance
                | PublishSubscribeCreateError::HangsInCreation,
            )
            | SystemInFlux => AttemptError::Transient(service_error(service, &error)),
            Create(_) => AttemptError::Permanent(service_error(service, &error)),
        })
}

/// Opens a message service created by a sim.
pub(crate) fn open<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
    agreement: &Agreement<'_>,
) -> Result<MessageService<H>, AttemptError> {
    // Check the attributes first: a different schema may imply different types, and the schema error tells
    // the user what to do.
    find(node, service, agreement)?;
    builder(node, service)?.open().map_err(|error| open_failure(service, error))
}

/// Returns `true` if the process of an attached port is alive. A node that is being cleaned up cannot be read
/// and counts as exited.
pub(crate) fn is_alive<H: ZeroCopySend + core::fmt::Debug>(
    messages: &MessageService<H>,
    node: UniqueNodeId,
) -> bool {
    let mut alive = false;
    let listed = messages.nodes(|state| {
        alive |=
            *state.node_id() == node && matches!(state, NodeState::Alive(_) | NodeState::Inaccessible(_));
        CallbackProgression::Continue
    });
    alive && listed.is_ok()
}

fn find(node: &LinkNode, service: &str, agreement: &Agreement<'_>) -> Result<(), AttemptError> {
    match Ipc::details(&service_name(service)?, node.config(), MessagingPattern::PublishSubscribe) {
        Ok(Some(details)) => Ok(agreement.check(service, details.static_details.attributes())?),
        Ok(None) => Err(AttemptError::Transient(LinkError::Absent { service: service.into() })),
        Err(error) => Err(AttemptError::Transient(service_error(service, &error))),
    }
}

fn builder<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
) -> Result<Builder<[Page], H, Ipc>, LinkError> {
    let node: &Node<Ipc> = node.inner();
    Ok(node.service_builder(&service_name(service)?).publish_subscribe::<[Page]>().user_header::<H>())
}

fn open_failure(service: &str, error: PublishSubscribeOpenError) -> AttemptError {
    use PublishSubscribeOpenError as E;
    match error {
        E::DoesNotExist | E::HangsInCreation | E::IsMarkedForDestruction => {
            AttemptError::Transient(LinkError::Absent { service: service.into() })
        }
        E::ExceedsMaxNumberOfNodes => AttemptError::Transient(occupied(service, &error)),
        E::IncompatibleTypes => AttemptError::Permanent(LinkError::Types { service: service.into() }),
        E::Interrupt => AttemptError::Transient(service_error(service, &error)),
        _ => AttemptError::Permanent(service_error(service, &error)),
    }
}

/// Converts a service name to iceoryx2's type.
pub(crate) fn service_name(service: &str) -> Result<ServiceName, LinkError> {
    ServiceName::new(service).map_err(|error| service_error(service, &error))
}

/// Returns the error for a port whose only slot another process holds.
pub(crate) fn occupied(service: &str, reason: &dyn core::fmt::Debug) -> LinkError {
    LinkError::Occupied { service: service.into(), reason: format!("{reason:?}") }
}

/// Returns the error for an iceoryx2 failure without a [`LinkError`] variant of its own.
pub(crate) fn service_error(service: &str, reason: &dyn core::fmt::Debug) -> LinkError {
    match Shortage::find() {
        Some(source) => LinkError::Shortage { failure: format!("service {service}: {reason:?}"), source },
        None => LinkError::Service { service: service.into(), reason: format!("{reason:?}") },
    }
}

fn attribute_key(service: &str, field: &str) -> Result<AttributeKey, LinkError> {
    AttributeKey::new(field.as_bytes()).map_err(|error| attribute_error(service, field, &error))
}

fn attribute_error(service: &str, field: &str, error: &dyn core::fmt::Debug) -> LinkError {
    LinkError::Service { service: service.into(), reason: format!("attribute {field}: {error:?}") }
}
